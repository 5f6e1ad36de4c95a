//! True horizontal displacements: distances of misdrawn points from the outline at full resolution.
//!
//! A point is misdrawn if it is shown at a step and hidden at full resolution, or the reverse. The
//! largest distance is estimated from below: distances are exact, in the metres of [`Ground`], but
//! taken only at the corners of every misdrawn polygon of every fine triangle and at its points on
//! quarters of an interval. Squares whose upper bound is no more than the largest distance found
//! are skipped.

use rayon::prelude::*;

use super::full::Full;
use super::ground::{Ground, Point};
use super::shape::{Cell, Fine, Grid, HAS_VALID, HAS_VOID, MIXED, Occupancy, Polygon};
use crate::sample::VALID;

/// The outline at full resolution, and the ground to measure it on.
pub(super) struct Outline<'a> {
    full: &'a Full,
    occupancy: &'a Occupancy,
    ground: Ground,
}

/// The nearest point of the outline found so far.
#[derive(Clone, Copy)]
struct Nearest {
    metres: f64,
    /// The unit cell that the point lies in.
    block: [u64; 2],
}

impl<'a> Outline<'a> {
    /// The outline of a lattice.
    pub fn new(ground: Ground, full: &'a Full, occupancy: &'a Occupancy) -> Self {
        Self { full, occupancy, ground }
    }

    /// Largest displacements of cells of spacing `2^q`, in metres: one number for each square of
    /// `2^group` intervals, `group >= q`.
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

    /// The nearest point of the outline to a point, or any point of it that is at most `enough`
    /// metres away. `near` is a cell to search first.
    fn nearest(&self, point: Point, near: [u64; 2], enough: f64) -> Nearest {
        let mut best = Nearest { metres: f64::INFINITY, block: near };
        self.nearest_in(0, near, point, enough, &mut best);
        self.nearest_in(self.occupancy.top(), [0, 0], point, enough, &mut best);
        best
    }

    /// Improves `best` by the outline in a block, until it is at most `enough` metres away.
    fn nearest_in(&self, log: u32, block: [u64; 2], point: Point, enough: f64, best: &mut Nearest) {
        if best.metres <= enough || self.occupancy.bits(log, block[0], block[1]) != MIXED {
            return;
        }
        if log == 0 {
            for segment in self.segments(block) {
                if let Some(metres) = self.ground.to_segment(point, segment, best.metres) {
                    *best = Nearest { metres, block };
                }
            }
            return;
        }
        let mut children = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| {
            let child = [2 * block[0] + i, 2 * block[1] + j];
            (self.to_block(point, log - 1, child), child)
        });
        children.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        for (distance, child) in children {
            if distance < best.metres {
                self.nearest_in(log - 1, child, point, enough, best);
            }
        }
    }

    fn to_block(&self, point: Point, log: u32, block: [u64; 2]) -> f64 {
        let side = (1_u64 << log) as f64;
        let start = block.map(|v| v as f64 * side);
        self.ground.to_block(point, start, start.map(|v| v + side))
    }

    /// Segments of the outline in a unit cell: they join the midpoints of those sides of a triangle
    /// that have one valid and one void end.
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

    /// Validity of the corners of a unit cell.
    fn valid(&self, x: u64, y: u64) -> [bool; 4] {
        [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|(x, y)| {
            let inside = x < self.full.columns as u64 && y < self.full.rows as u64;
            inside && self.full.is_valid(self.full.at(x as usize, y as usize))
        })
    }
}

/// Search for the farthest misdrawn point of one drawn cell.
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
    /// A search in cell (column, row) of spacing `2^q` for a displacement above `worst`.
    fn new(outline: &'a Outline<'a>, q: u32, column: u64, row: u64, worst: f64) -> Self {
        let s = 1_u64 << q;
        let valid = [(0, 0), (1, 0), (0, 1), (1, 1)]
            .map(|(i, j)| outline.full.sample((column + i) * s, (row + j) * s).2 == VALID);
        let place = [column, row];
        Self { outline, cell: Cell::new(s, column, row), q, place, valid, worst, near: [0, 0] }
    }

    fn run(mut self) -> f64 {
        self.search(self.q, self.place);
        self.worst
    }

    /// North-west corner of a block in quarters of an interval, relative to that of the cell.
    fn origin(&self, log: u32, block: [u64; 2]) -> (i64, i64) {
        let along = |i: usize| 4 * ((block[i] << log) - (self.place[i] << self.q)) as i64;
        (along(0), along(1))
    }

    /// Searches a block for misdrawn points.
    fn search(&mut self, log: u32, block: [u64; 2]) {
        let bits = self.outline.occupancy.bits(log, block[0], block[1]);
        let (left, top) = self.origin(log, block);
        let side = 4_i64 << log;
        let corners = [(left, top), (left + side, top), (left, top + side), (left + side, top + side)];
        // The drawn validity is linear in the block, or on both sides of its diagonal.
        let shown = corners.map(|point| self.cell.shown(self.cell.triangle(point), self.valid, point));
        let (least, most) = (shown.into_iter().min().unwrap_or(0), shown.into_iter().max().unwrap_or(0));
        if (bits == HAS_VALID && least >= 0) || (bits == HAS_VOID && most <= 0) {
            return;
        }
        if log == 0 {
            self.search_unit(block);
            return;
        }
        let size = (1_u64 << log) as f64;
        let centre = block.map(|v| (v as f64 + 0.5) * size);
        self.near = self.outline.nearest(centre, self.near, 0.0).block;
        if self.upper_bound(centre, 0.5 * size) <= self.worst {
            return;
        }
        for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            self.search(log - 1, [2 * block[0] + i, 2 * block[1] + j]);
        }
    }

    /// An upper bound of the metres from any point of a block to the outline, by a piece of it in
    /// the cell found last.
    fn upper_bound(&self, centre: Point, half: f64) -> f64 {
        let segments = self.outline.segments(self.near);
        segments
            .map(|[end, _]| self.outline.ground.upper_bound(centre, half, end))
            .fold(f64::INFINITY, f64::min)
    }

    /// Measures the misdrawn polygons of the two fine triangles of a unit cell.
    fn search_unit(&mut self, block: [u64; 2]) {
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

    /// Measures the distances of a misdrawn polygon's points on quarters of an interval, corners
    /// included. Misdrawn is what is drawn but hidden at full resolution, or with `sign` -1, the
    /// reverse.
    fn measure(&mut self, fine: &Fine, valid: [bool; 4], sign: i64, block: [u64; 2]) {
        let under = fine.within(self.cell);
        for (x, y) in (0..5).flat_map(|y| (0..5).map(move |x| (x, y))) {
            let local = (fine.origin.0 + x, fine.origin.1 + y);
            let inside = fine.cell.weights(fine.part, (x, y)).iter().all(|&weight| weight >= 0);
            let hidden = sign * fine.shown(valid, local) <= 0;
            if !inside || !hidden || sign * self.cell.shown(under, self.valid, local) < 0 {
                continue;
            }
            let point = [block[0] as f64 + 0.25 * x as f64, block[1] as f64 + 0.25 * y as f64];
            let mut known = Nearest { metres: f64::INFINITY, block: self.near };
            self.outline.nearest_in(0, self.near, point, self.worst, &mut known);
            if known.metres > self.worst {
                let nearest = self.outline.nearest(point, self.near, self.worst);
                self.near = nearest.block;
                self.worst = self.worst.max(nearest.metres);
            }
        }
    }
}
