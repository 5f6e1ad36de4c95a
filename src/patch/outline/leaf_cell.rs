//! A look into one cell of a leaf tile: its misdrawn points, and the pieces of the outline near it.

use super::marks::{HalfPoint, Marks};
use super::patterns::Patterns;
use super::search::{Bound, Ceilings, Cells, Corners, MIXED};
use super::shape::{Farthest, Fault, Polygon, Segment, Segments, triangles};
use crate::geo::{Plane, Planes};
use crate::simd;

/// Halvings of a triangle of a square leaf cell: its sides shrink to 1/32.
const LEAF_HALVINGS: u32 = 10;
/// Times that one side of a cell may be as long as the other is wide before more cells than those beside it are looked at.
const LONG: f64 = 2.0;
/// Cells to either side that are looked at, at most.
const MOST_BESIDE: f64 = 64.0;

/// How often a triangle of a leaf cell may be halved.
pub(super) fn halvings(plane: Plane) -> u32 {
    LEAF_HALVINGS + more_halvings(plane)
}

/// How much more often a triangle of a long cell may be halved.
pub(super) fn more_halvings(plane: Plane) -> u32 {
    let (across, down) = beside(plane);
    across.max(down).next_power_of_two().ilog2()
}

/// How many cells to either side, across and down, are looked at: the next, and where cells are narrow those that are nearer than a
/// cell is long.
pub(super) fn beside(plane: Plane) -> (usize, usize) {
    let (across, down) = elongation(plane);
    let count = |long: f64| if long > LONG { long.min(MOST_BESIDE).ceil() as usize } else { 1 };
    (count(across), count(down))
}

/// True if cells are much longer than they are wide.
pub(super) fn is_long(plane: Plane) -> bool {
    let (across, down) = elongation(plane);
    across.max(down) > LONG
}

/// How many cells across, and how many down, are as wide as the longer side of a cell is long.
fn elongation(plane: Plane) -> (f64, f64) {
    let row = plane.row();
    let long = plane.dx.max(row);
    (long * row / (plane.dx * plane.dy), long / plane.dy)
}

/// The marks nearest to the corners and to the centre of cell `(x, y)` in a plane, each once.
pub(super) fn around(marks: &Marks, plane: Plane, (x, y): (usize, usize), mut take: impl FnMut(HalfPoint)) {
    let mut seen = [[-1; 2]; 5];
    for (count, (i, j)) in [(1, 1), (0, 0), (2, 0), (0, 2), (2, 2)].into_iter().enumerate() {
        let Some(mark) = marks.nearest([2 * x + i, 2 * y + j], plane) else { return };
        if !seen.contains(&mark) {
            seen[count] = mark;
            take(mark);
        }
    }
}

/// Squared distance from a mark to the farthest corner of square `(x, y)` of `2^level` cells, whose centre is nearer to
/// the mark than to the others. The mark may be anywhere within `extent` half intervals of its place.
pub(super) fn farthest_corner(
    [mark_x, mark_y]: HalfPoint,
    level: usize,
    (x, y): (usize, usize),
    plane: Plane,
    extent: i32,
) -> f64 {
    let away = |mark: i16, place: usize| i32::from(mark) - ((2 * place as i32 + 1) << level);
    let (across, down, size) = (away(mark_x, x), away(mark_y, y), (1 << level) + extent);
    let half = |intervals: i32| 0.5 * f64::from(intervals);
    if plane.skew == 0.0 {
        return plane.squared(half(across.abs() + size), half(down.abs() + size));
    }
    let corners = [(1, 1), (1, -1), (-1, 1), (-1, -1)];
    let squared = |(i, j): (i32, i32)| plane.squared(half(across + i * size), half(down + j * size));
    corners.into_iter().map(squared).fold(0.0, f64::max)
}

/// Rows of samples that a square of `2^level` cells and a mark that is `extent` half intervals tall are in.
pub(super) fn rows_to(mark_y: i16, level: usize, y: usize, extent: i32) -> (usize, usize) {
    let (north, south) = (i32::from(mark_y) - extent, i32::from(mark_y) + extent);
    let (north, south) = (north.max(0) as usize / 2, (south.max(0) as usize).div_ceil(2));
    (north.min(y << level), south.max((y + 1) << level))
}

/// True if not all corners are alike.
fn is_mixed(full: [u8; 4]) -> bool {
    full != [0; 4] && full != [1; 4]
}

/// A lattice of samples at full resolution, and its outline.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid<'a> {
    /// 1 for each of `(n + 1)^2` samples that is valid.
    pub(super) valid: &'a [u8],
    pub(super) n: usize,
}

impl Grid<'_> {
    /// Validity at the corners of a cell.
    pub(super) fn full(self, x: usize, y: usize) -> [u8; 4] {
        let i = y * (self.n + 1) + x;
        let (north, south) = (&self.valid[i..i + 2], &self.valid[i + self.n + 1..i + self.n + 3]);
        [north[0], north[1], south[0], south[1]]
    }

    /// The parts of the two triangles of a cell that are misdrawn by a fault, where validity as drawn is `drawn` at its corners.
    pub(super) fn misdrawn(
        self,
        (x, y): (usize, usize),
        drawn: Corners,
        fault: Fault,
        plane: Plane,
    ) -> [Option<Polygon>; 2] {
        let full = self.full(x, y).map(f64::from);
        triangles((x + y).is_multiple_of(2))
            .map(|triangle| Polygon::misdrawn(triangle, plane, full, drawn, fault))
    }

    /// Adds the pieces of the outline in cell `(x, y)`, as seen from the corner of cell `from` in a plane.
    pub(super) fn push_segments(
        self,
        segments: &mut Segments,
        from: (usize, usize),
        (x, y): (usize, usize),
        plane: Plane,
    ) {
        let full = self.full(x, y);
        if !is_mixed(full) {
            return;
        }
        for [a, b, c] in triangles((x + y) % 2 == 0) {
            // The outline runs between the midpoints of the sides that meet at the odd one out.
            let [odd, u, v] = match (full[a] == full[b], full[b] == full[c]) {
                (true, true) => continue,
                (true, false) => [c, a, b],
                (false, true) => [a, b, c],
                (false, false) => [b, a, c],
            };
            let midpoint = |other: usize| {
                let away = |cell: usize, from: usize, corners: usize| {
                    cell as f64 - from as f64 + 0.5 * corners as f64
                };
                plane.at(away(x, from.0, odd % 2 + other % 2), away(y, from.1, odd / 2 + other / 2))
            };
            segments.push(Segment::new(midpoint(u), midpoint(v)));
        }
    }
}

/// Cells of a leaf tile.
pub(super) struct LeafCells<'a> {
    pub(super) grid: Grid<'a>,
    pub(super) planes: &'a Planes,
    /// Vertices of the outline.
    pub(super) marks: &'a Marks,
    pub(super) patterns: &'a mut Patterns,
    pub(super) segments: &'a mut Segments,
    /// Room for the cells near one.
    pub(super) near: &'a mut Vec<(usize, usize)>,
}

impl LeafCells<'_> {
    /// Collects the pieces of the outline near a cell. Gives the plane that they are in.
    fn collect(&mut self, at: (usize, usize)) -> Plane {
        self.near.clear();
        let own = self.planes.over(at.1, at.1 + 1);
        self.beside(at, own);
        // The outline within a cell and beside it is near enough to all of it.
        if !is_mixed(self.grid.full(at.0, at.1)) {
            self.around(at, own);
        }
        let (first, last) = self.near.iter().fold((at.1, at.1), |(a, b), &(_, y)| (a.min(y), b.max(y)));
        let plane = self.planes.over(first, last + 1);
        self.segments.clear();
        for &cell in &*self.near {
            self.grid.push_segments(self.segments, at, cell, plane);
        }
        plane
    }

    /// Adds the cells beside one.
    fn beside(&mut self, at: (usize, usize), plane: Plane) {
        let last = self.grid.n - 1;
        let (across, down) = beside(plane);
        for y in at.1.saturating_sub(down)..=(at.1 + down).min(last) {
            for x in at.0.saturating_sub(across)..=(at.0 + across).min(last) {
                if is_mixed(self.grid.full(x, y)) {
                    self.near.push((x, y));
                }
            }
        }
    }

    /// Adds the cells of the vertices nearest to the corners and to the centre of one: five at most, each of up to four cells.
    fn around(&mut self, at: (usize, usize), plane: Plane) {
        let n = self.grid.n;
        around(self.marks, plane, at, |[fx, fy]| {
            // A vertex on a side belongs to the cells on both sides of it.
            let cells = |feature: i16| {
                let feature = feature as usize;
                (feature.saturating_sub(1) / 2, (feature / 2).min(n - 1))
            };
            let ((west, east), (north, south)) = (cells(fx), cells(fy));
            for y in north..=south {
                for x in west..=east {
                    if is_mixed(self.grid.full(x, y)) && !self.near.contains(&(x, y)) {
                        self.near.push((x, y));
                    }
                }
            }
        });
    }
}

impl Cells for LeafCells<'_> {
    fn reach(&mut self, level: usize, at: (usize, usize), bits: u8) -> [f64; 2] {
        let (first, last) = (at.1 << level, (at.1 + 1) << level);
        let plane = self.planes.over(first, last);
        if bits == MIXED {
            // The outline is within.
            return match level {
                0 => self.patterns.cell(self.grid, at, plane, self.segments),
                1 => self.patterns.square(self.grid, at, plane, self.segments),
                _ => {
                    let size = f64::from(1 << level);
                    [plane.squared(size, size).max(plane.squared(size, -size)); 2]
                }
            };
        }
        let centre = [(2 * at.0 + 1) << level, (2 * at.1 + 1) << level];
        let Some(mark) = self.marks.nearest(centre, plane) else { return [0.0; 2] };
        let (first, last) = rows_to(mark[1], level, at.1, 0);
        [farthest_corner(mark, level, at, self.planes.over(first, last), 0); 2]
    }

    fn look(
        &mut self,
        at: (usize, usize),
        drawn: Corners,
        faults: [bool; 2],
        ceilings: &mut Ceilings,
        bound: &mut Bound,
    ) {
        let mut collected = None;
        for fault in [Fault::Shown, Fault::Hidden] {
            if !faults[fault as usize] || bound.settles(ceilings.of(fault as usize)) {
                continue;
            }
            // Whether there is such a part does not depend on the plane.
            let own = self.planes.over(at.1, at.1 + 1);
            let parts = self.grid.misdrawn(at, drawn, fault, own);
            if parts.iter().all(Option::is_none) {
                continue;
            }
            let plane = *collected.get_or_insert_with(|| self.collect(at));
            let parts = if plane == own { parts } else { self.grid.misdrawn(at, drawn, fault, plane) };
            let mut part = bound.part();
            let things = &mut *self.segments;
            simd::run(Farthest { polygons: &parts, things, halvings: halvings(plane), bound: &mut part });
            let top = bound.join(part);
            if drawn.iter().all(|&value| fault.concerns(value)) {
                ceilings.lower(fault as usize, top);
            }
        }
    }
}
