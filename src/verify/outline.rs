//! True horizontal displacements: how far misdrawn points are from the outline at full resolution.
//!
//! A point is misdrawn if it is shown at a step and hidden at full resolution, or the other way round. The largest distance
//! is estimated from below: distances are exact, taken at the corners of every misdrawn polygon of every fine
//! triangle, and at all its points on quarters of an interval. Squares in which nothing can be farther than what is known are passed over.

use rayon::prelude::*;

use super::full::{Full, tile_spacing};
use super::shape::{Cell, Fine, Grid, HAS_VALID, HAS_VOID, MIXED, Occupancy, Polygon};
use crate::container::reader::Reader;
use crate::geo::Spacing;
use crate::sample::VALID;
use crate::tile::TileId;

/// The outline at full resolution, with the metres to measure it in.
pub(super) struct Outline<'a> {
    full: &'a Full,
    occupancy: &'a Occupancy,
    /// Spacings of the tiles of the finest level, row by row.
    spacings: Vec<Spacing>,
    columns: u64,
    rows: u64,
    tile_log2: u32,
    /// No smaller than any of them.
    widest: Spacing,
}

impl<'a> Outline<'a> {
    /// Of a lattice.
    ///
    /// Distances are taken in the spacing of the leaf tile that a point lies in, and never in a larger one than any of
    /// the tiles above it has: whichever of them measured the stored error, it must not be below.
    pub fn new(reader: &Reader, full: &'a Full, occupancy: &'a Occupancy) -> Self {
        let header = reader.header();
        let along = |samples: u32| (((samples - 1) >> header.tile_log2) + 1).min(1 << header.levels);
        let (columns, rows) = (along(header.width), along(header.height));
        let ids = (0..rows).flat_map(|y| (0..columns).map(move |x| TileId::new(header.levels, x, y)));
        let spacings: Vec<_> = ids.map(|id| least_spacing(reader, id)).collect();
        let none = Spacing { dx: 0.0, dy: 0.0 };
        let widest = spacings.iter().fold(none, |a, b| Spacing { dx: a.dx.max(b.dx), dy: a.dy.max(b.dy) });
        let tile_log2 = header.tile_log2.into();
        Self { full, occupancy, spacings, columns: columns.into(), rows: rows.into(), tile_log2, widest }
    }

    /// One spacing everywhere.
    #[cfg(test)]
    pub fn uniform(full: &'a Full, occupancy: &'a Occupancy, spacing: Spacing) -> Self {
        let tile_log2 = full.side.trailing_zeros();
        Self { full, occupancy, spacings: vec![spacing], columns: 1, rows: 1, tile_log2, widest: spacing }
    }

    /// Largest displacement of cells of spacing `2^q` in metres: one number for each square of `2^group` intervals,
    /// `group >= q`.
    pub fn displacements(&self, q: u32, group: u32) -> Grid {
        let along = |samples: u64| (((samples - 1) >> group) + 1).min(self.full.side >> group) as usize;
        let (columns, rows) = (along(self.full.raster.0), along(self.full.raster.1));
        let values = (0..columns * rows)
            .into_par_iter()
            .map(|i| {
                let (x, y) = ((i % columns) as u64, (i / columns) as u64);
                if self.occupancy.bits(group, x, y) != MIXED {
                    return 0.0;
                }
                let across = 1_u64 << (group - q);
                let mut worst = 0.0;
                for row in y * across..(y + 1) * across {
                    for column in x * across..(x + 1) * across {
                        worst = Search::new(self, q, column, row, worst).run();
                    }
                }
                worst
            })
            .collect();
        Grid { columns, values }
    }

    /// Spacing within block `(x, y)` of `2^log` cells; an upper bound if it spans several leaf tiles.
    fn spacing(&self, log: u32, x: u64, y: u64) -> Spacing {
        let Some(shift) = self.tile_log2.checked_sub(log) else { return self.widest };
        let (x, y) = ((x >> shift).min(self.columns - 1), (y >> shift).min(self.rows - 1));
        self.spacings[(y * self.columns + x) as usize]
    }

    /// Distance from a point to the outline, and the unit cell where it is nearest. `near` is a cell to look at first.
    fn nearest(&self, point: [f64; 2], spacing: Spacing, near: [u64; 2]) -> (f64, [u64; 2]) {
        let mut best = (f64::INFINITY, near);
        self.nearest_in(0, near, point, spacing, &mut best);
        self.nearest_in(self.occupancy.top(), [0, 0], point, spacing, &mut best);
        best
    }

    /// Improves `best` by the outline in a block.
    fn nearest_in(
        &self,
        log: u32,
        block: [u64; 2],
        point: [f64; 2],
        spacing: Spacing,
        best: &mut (f64, [u64; 2]),
    ) {
        if self.occupancy.bits(log, block[0], block[1]) != MIXED {
            return;
        }
        if log == 0 {
            for [a, b] in self.segments(block) {
                let distance = to_segment(point, a, b, spacing);
                if distance < best.0 {
                    *best = (distance, block);
                }
            }
            return;
        }
        let mut children = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| {
            let child = [2 * block[0] + i, 2 * block[1] + j];
            (to_block(point, log - 1, child, spacing), child)
        });
        children.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        for (distance, child) in children {
            if distance < best.0 {
                self.nearest_in(log - 1, child, point, spacing, best);
            }
        }
    }

    /// Pieces of the outline in a unit cell: between the midpoints of the sides of a triangle that join unlike samples.
    pub fn segments(&self, [x, y]: [u64; 2]) -> impl Iterator<Item = [[f64; 2]; 2]> {
        let valid = self.valid(x, y);
        let cell = Cell::new(1, x, y);
        (0..2).filter_map(move |part| {
            let [a, b, c] = cell.corners(part);
            let [odd, u, v] = match (valid[a] == valid[b], valid[b] == valid[c]) {
                (true, true) => return None,
                (true, false) => [c, a, b],
                (false, true) => [a, b, c],
                (false, false) => [b, a, c],
            };
            let middle = |other: usize| {
                let half = |i: usize, j: usize| 0.5 * (i + j) as f64;
                [x as f64 + half(odd & 1, other & 1), y as f64 + half(odd >> 1, other >> 1)]
            };
            Some([middle(u), middle(v)])
        })
    }

    /// Which corners of a unit cell are valid.
    fn valid(&self, x: u64, y: u64) -> [bool; 4] {
        [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|(x, y)| {
            let inside = x < self.full.columns as u64 && y < self.full.rows as u64;
            inside && self.full.is_valid(self.full.at(x as usize, y as usize))
        })
    }
}

/// The smallest spacings of a tile and of those above it, for intervals of the finest level.
fn least_spacing(reader: &Reader, id: TileId) -> Spacing {
    let chain = std::iter::successors(Some(id), |tile| tile.parent());
    chain.fold(Spacing { dx: f64::INFINITY, dy: f64::INFINITY }, |least, tile| {
        let step = f64::from(reader.header().spacing(tile.level));
        let spacing = tile_spacing(reader, tile);
        Spacing { dx: least.dx.min(spacing.dx / step), dy: least.dy.min(spacing.dy / step) }
    })
}

fn to_block(point: [f64; 2], log: u32, block: [u64; 2], spacing: Spacing) -> f64 {
    let side = (1_u64 << log) as f64;
    let away = |v: f64, block: u64| {
        let low = block as f64 * side;
        (low - v).max(v - low - side).max(0.0)
    };
    (away(point[0], block[0]) * spacing.dx).hypot(away(point[1], block[1]) * spacing.dy)
}

pub(super) fn to_segment(point: [f64; 2], a: [f64; 2], b: [f64; 2], spacing: Spacing) -> f64 {
    let metres = |to: [f64; 2]| ((to[0] - point[0]) * spacing.dx, (to[1] - point[1]) * spacing.dy);
    let ((ax, ay), (bx, by)) = (metres(a), metres(b));
    let (dx, dy) = (bx - ax, by - ay);
    let length = dx * dx + dy * dy;
    let along = if length > 0.0 { (-(ax * dx + ay * dy) / length).clamp(0.0, 1.0) } else { 0.0 };
    (ax + along * dx).hypot(ay + along * dy)
}

/// The search for the farthest misdrawn point of one drawn cell.
struct Search<'a> {
    outline: &'a Outline<'a>,
    cell: Cell,
    q: u32,
    place: [u64; 2],
    valid: [bool; 4],
    worst: f64,
    near: [u64; 2],
}

impl<'a> Search<'a> {
    /// Of cell (column, row) of spacing `2^q`; `worst` is what need not be found again.
    fn new(outline: &'a Outline<'a>, q: u32, column: u64, row: u64, worst: f64) -> Self {
        let s = 1_u64 << q;
        let valid = [(0, 0), (1, 0), (0, 1), (1, 1)]
            .map(|(i, j)| outline.full.sample((column + i) * s, (row + j) * s).2 == VALID);
        let place = [column, row];
        Self { outline, cell: Cell::new(s, column, row), q, place, valid, worst, near: [0, 0] }
    }

    fn run(mut self) -> f64 {
        self.visit(self.q, self.place);
        self.worst
    }

    /// North-west corner of a block in quarters from that of the cell.
    fn origin(&self, log: u32, block: [u64; 2]) -> (i64, i64) {
        let along = |i: usize| 4 * ((block[i] << log) - (self.place[i] << self.q)) as i64;
        (along(0), along(1))
    }

    /// Looks for misdrawn points in a block.
    fn visit(&mut self, log: u32, block: [u64; 2]) {
        let bits = self.outline.occupancy.bits(log, block[0], block[1]);
        let (left, top) = self.origin(log, block);
        let side = 4_i64 << log;
        let corners = [(left, top), (left + side, top), (left, top + side), (left + side, top + side)];
        // The drawn validity is linear, or linear on both sides of a diagonal of the block.
        let shown = corners.map(|point| self.cell.shown(self.cell.triangle(point), self.valid, point));
        let (least, most) = (shown.into_iter().min().unwrap_or(0), shown.into_iter().max().unwrap_or(0));
        if (bits == HAS_VALID && least >= 0) || (bits == HAS_VOID && most <= 0) {
            return;
        }
        if log == 0 {
            self.visit_unit(block);
            return;
        }
        let spacing = self.outline.spacing(log, block[0], block[1]);
        let size = (1_u64 << log) as f64;
        let centre = block.map(|v| (v as f64 + 0.5) * size);
        let (distance, near) = self.outline.nearest(centre, spacing, self.near);
        self.near = near;
        let reach = distance + 0.5 * (size * spacing.dx).hypot(size * spacing.dy);
        if reach <= self.worst {
            return;
        }
        for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            self.visit(log - 1, [2 * block[0] + i, 2 * block[1] + j]);
        }
    }

    /// Misdrawn polygons of the two fine triangles of a unit cell.
    fn visit_unit(&mut self, block: [u64; 2]) {
        let valid = self.outline.valid(block[0], block[1]);
        let origin = self.origin(0, block);
        let fine_cell = Cell::new(1, block[0], block[1]);
        for part in 0..2 {
            let fine = Fine { cell: fine_cell, part, origin };
            let under = fine.within(self.cell);
            for sign in [1, -1] {
                let polygon = Polygon::new(fine.points())
                    .clip(|point| -sign * fine.shown(valid, point))
                    .clip(|point| sign * self.cell.shown(under, self.valid, point));
                if polygon.area() > 0 {
                    self.measure(&fine, valid, sign, block);
                }
            }
        }
    }

    /// Distances of the points of a misdrawn polygon that stand on quarters; its corners are among them. Misdrawn is what is
    /// shown as drawn and hidden at full resolution, or, with `sign` -1, the other way round.
    fn measure(&mut self, fine: &Fine, valid: [bool; 4], sign: i64, block: [u64; 2]) {
        let spacing = self.outline.spacing(0, block[0], block[1]);
        let under = fine.within(self.cell);
        for (x, y) in (0..5).flat_map(|y| (0..5).map(move |x| (x, y))) {
            let local = (fine.origin.0 + x, fine.origin.1 + y);
            let inside = fine.cell.weights(fine.part, (x, y)).iter().all(|&weight| weight >= 0);
            let hidden = sign * fine.shown(valid, local) <= 0;
            if !inside || !hidden || sign * self.cell.shown(under, self.valid, local) < 0 {
                continue;
            }
            let point = [block[0] as f64 + 0.25 * x as f64, block[1] as f64 + 0.25 * y as f64];
            let mut known = (f64::INFINITY, self.near);
            self.outline.nearest_in(0, self.near, point, spacing, &mut known);
            if known.0 > self.worst {
                let (distance, near) = self.outline.nearest(point, spacing, self.near);
                self.near = near;
                self.worst = self.worst.max(distance);
            }
        }
    }
}
