//! The drawn surface at the vertices of a leaf.

use std::ops::Range;

use crate::container::TileEntry;
use crate::select::pattern::{Meshes, Piece};
use crate::select::tile::Heights;

/// A tile as it is drawn.
pub(super) struct Tile {
    /// Its row of the index.
    pub entry: TileEntry,
    /// Samples of the raster between two of its own.
    pub spacing: u64,
    /// Intervals on a side of a patch.
    pub patch: u32,
    /// Patches on a side.
    pub m: u32,
    /// Its heights.
    pub heights: Heights,
    /// Its patches, row by row.
    pub patches: Vec<Patch>,
}

/// A patch as it is drawn.
pub(super) struct Patch {
    /// The pieces; none if it is not drawn.
    pub pieces: Vec<Piece>,
    /// True if each of its samples is a vertex of the mesh.
    pub finest: bool,
}

/// Vertices of a leaf, in its own intervals.
#[derive(Clone, Debug)]
pub(super) struct Window {
    /// Columns.
    pub x: Range<i64>,
    /// Rows.
    pub y: Range<i64>,
}

/// A corner of a drawn triangle, in intervals of a leaf from its north-west corner.
#[derive(Clone, Copy, Debug)]
struct Corner {
    x: i64,
    y: i64,
    z: f64,
    valid: bool,
}

impl Tile {
    /// The triangles of a patch of which a part is shown. Corners are in intervals of a leaf,
    /// `2^shift` to one of this tile's, counted from `origin`.
    fn triangles<'a>(
        &'a self,
        patch: u32,
        meshes: &'a Meshes,
        intervals: i64,
        origin: [i64; 2],
    ) -> impl Iterator<Item = [Corner; 3]> + 'a {
        let row = self.m * self.patch + 1;
        let (left, top) = (patch % self.m * self.patch, patch / self.m * self.patch);
        let corner = move |(x, y): (u32, u32)| {
            let (x, y) = (left + x, top + y);
            let at = (y * row + x) as usize;
            let valid = self.heights.valid[at] != 0;
            let z = f64::from(self.heights.metres[at]);
            Corner {
                x: i64::from(x) * intervals - origin[0],
                y: i64::from(y) * intervals - origin[1],
                z,
                valid,
            }
        };
        let pieces = self.patches[patch as usize].pieces.iter();
        pieces
            .flat_map(move |&piece| meshes.triangles(piece))
            .map(move |corners| corners.map(corner))
            .filter(|corners| corners.iter().any(|corner| corner.valid))
    }

    /// True if a triangle of which a part is shown meets a square of `side` intervals.
    pub fn meets(&self, meshes: &Meshes, intervals: i64, origin: [i64; 2], side: i64) -> bool {
        let window = Window { x: 0..side + 1, y: 0..side + 1 };
        (0..self.m * self.m).any(|patch| {
            self.triangles(patch, meshes, intervals, origin).any(|corners| {
                let (x, y) = (extent(corners.map(|c| c.x)), extent(corners.map(|c| c.y)));
                x.0 < window.x.end && x.1 >= 0 && y.0 < window.y.end && y.1 >= 0
            })
        })
    }
}

fn extent(values: [i64; 3]) -> (i64, i64) {
    let [a, b, c] = values;
    (a.min(b).min(c), a.max(b).max(c))
}

/// Heights of the drawn surface at the vertices of a leaf; NaN where none is drawn.
pub(super) struct Sheet {
    /// Vertices on a side.
    row: usize,
    z: Vec<f64>,
}

impl Sheet {
    /// A sheet for leaves of `n` intervals.
    pub fn new(n: usize) -> Self {
        Self { row: n + 1, z: vec![f64::NAN; (n + 1) * (n + 1)] }
    }

    /// Heights of some vertices of a row.
    pub fn row(&self, y: i64, x: Range<i64>) -> &[f64] {
        let start = y as usize * self.row;
        &self.z[start + x.start as usize..start + x.end as usize]
    }

    /// Draws the part of a patch in a window. One interval of the tile is `intervals` of the leaf;
    /// the leaf starts at `origin`, in its own intervals, from the tile's corner.
    pub fn draw(
        &mut self,
        tile: &Tile,
        patch: u32,
        meshes: &Meshes,
        intervals: i64,
        origin: [i64; 2],
        window: &Window,
    ) {
        let width = (window.x.end - window.x.start) as usize;
        for y in window.y.clone() {
            let start = y as usize * self.row + window.x.start as usize;
            let to = &mut self.z[start..start + width];
            if tile.patches[patch as usize].finest && intervals == 1 {
                // Each sample of the tile is a vertex of the mesh.
                let from = ((y + origin[1]) * i64::from(tile.m * tile.patch + 1) + window.x.start + origin[0])
                    as usize;
                let samples = tile.heights.metres[from..from + width]
                    .iter()
                    .zip(&tile.heights.valid[from..from + width]);
                for (to, (&z, &valid)) in to.iter_mut().zip(samples) {
                    *to = if valid != 0 { f64::from(z) } else { f64::NAN };
                }
            } else {
                to.fill(f64::NAN);
            }
        }
        if tile.patches[patch as usize].finest && intervals == 1 {
            return;
        }
        for corners in tile.triangles(patch, meshes, intervals, origin) {
            self.triangle(corners, window);
        }
    }

    fn triangle(&mut self, corners: [Corner; 3], window: &Window) {
        let (low, high) = extent(corners.map(|c| c.y));
        let (west, east) = extent(corners.map(|c| c.x));
        if east < window.x.start || west >= window.x.end {
            return;
        }
        let plane = Plane::new(corners);
        let whole = corners.iter().all(|corner| corner.valid);
        for y in low.max(window.y.start)..(high + 1).min(window.y.end) {
            let Some((first, last)) = span(corners, y) else { continue };
            let (first, last) = (first.max(window.x.start), last.min(window.x.end - 1));
            let start = y as usize * self.row;
            for x in first..=last {
                if whole || is_shown(corners, (x, y)) {
                    self.z[start + x as usize] = plane.at(x, y);
                }
            }
        }
    }
}

/// First and last whole column of a triangle in a row.
fn span([a, b, c]: [Corner; 3], y: i64) -> Option<(i64, i64)> {
    let (mut first, mut last) = (i64::MAX, i64::MIN);
    for (p, q) in [(a, b), (b, c), (c, a)] {
        let (p, q) = if p.y <= q.y { (p, q) } else { (q, p) };
        if y < p.y || y > q.y {
            continue;
        }
        if p.y == q.y {
            (first, last) = (first.min(p.x.min(q.x)), last.max(p.x.max(q.x)));
            continue;
        }
        let (run, rise) = ((y - p.y) * (q.x - p.x), q.y - p.y);
        let floor = p.x + run.div_euclid(rise);
        first = first.min(floor + i64::from(run.rem_euclid(rise) != 0));
        last = last.max(floor);
    }
    // A row that meets the triangle between two columns has first > last.
    (first <= last).then_some((first, last))
}

/// True if at least half of a point's weight is on valid corners.
fn is_shown([a, b, c]: [Corner; 3], (x, y): (i64, i64)) -> bool {
    let area = |p: (i64, i64), q: (i64, i64), r: (i64, i64)| {
        i128::from(q.0 - p.0) * i128::from(r.1 - p.1) - i128::from(q.1 - p.1) * i128::from(r.0 - p.0)
    };
    let [pa, pb, pc] = [a, b, c].map(|corner| (corner.x, corner.y));
    let p = (x, y);
    let parts = [area(p, pb, pc), area(pa, p, pc), area(pa, pb, p)];
    let valid: i128 =
        parts.iter().zip([a, b, c]).filter(|(_, corner)| corner.valid).map(|(part, _)| part).sum();
    2 * valid.abs() >= area(pa, pb, pc).abs()
}

/// Height over a triangle.
struct Plane {
    corner: Corner,
    east: f64,
    south: f64,
}

impl Plane {
    fn new([a, b, c]: [Corner; 3]) -> Self {
        let [(ux, uy), (vx, vy)] = [b, c].map(|corner| ((corner.x - a.x) as f64, (corner.y - a.y) as f64));
        let (du, dv) = (b.z - a.z, c.z - a.z);
        let area = ux * vy - vx * uy;
        Self { corner: a, east: (du * vy - dv * uy) / area, south: (ux * dv - vx * du) / area }
    }

    fn at(&self, x: i64, y: i64) -> f64 {
        self.corner.z + self.east * (x - self.corner.x) as f64 + self.south * (y - self.corner.y) as f64
    }
}
