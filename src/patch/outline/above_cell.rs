//! The evaluation of one block of a tile above the leaves: its misdrawn points, and the points of
//! the outline near it.

use super::bound::{Bound, UpperBounds};
use super::distance_transform::{DistanceTransform, HalfPoint};
use super::grid::{beside, is_long, more_halvings};
use super::leaf_cell::{around, farthest_corner, rows_to};
use super::search::Cells;
use super::shape::{Corners, Farthest, Fault, Polygon, UncertainPoint, UncertainPoints, triangles};
use crate::geo::{Plane, Planes};
use crate::patch::blocks::{HAS_VALID, HAS_VOID};
use crate::simd;

/// Most halvings of a triangle of a square block: the uncertainty within the block is larger.
const ABOVE_HALVINGS: u32 = 2;

/// True if a feature of a tile above the leaves is a block, not a sample.
fn is_block([x, y]: HalfPoint) -> bool {
    x % 2 == 1 && y % 2 == 1
}

/// Blocks of a tile above the leaves.
pub(super) struct AboveCells<'a> {
    /// 1 for each sample that is valid.
    pub(super) samples: &'a [u8],
    /// [`HAS_VALID`], [`HAS_VOID`] of each of the `n x n` blocks.
    pub(super) block: &'a [u8],
    pub(super) n: usize,
    /// The next finer spacing.
    pub(super) finer: usize,
    /// Distances to void samples and to blocks with void samples: a valid point is no farther from
    /// the outline.
    pub(super) void: &'a DistanceTransform,
    /// Distances to valid samples and to blocks with valid samples: a void point is no farther from
    /// the outline.
    pub(super) valid: &'a DistanceTransform,
    pub(super) planes: &'a Planes,
    pub(super) points: &'a mut UncertainPoints,
}

impl AboveCells<'_> {
    /// Validity at sample `(x, y)`, drawn at the next finer spacing.
    fn drawn_finer(&self, (x, y): (usize, usize)) -> f64 {
        let s = self.finer;
        let (i, j) = ((x / s).min(self.n / s - 1), (y / s).min(self.n / s - 1));
        let at = |i: usize, j: usize| f64::from(self.samples[j * s * (self.n + 1) + i * s]);
        let (nw, ne, sw, se) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
        let (u, v) = ((x - i * s) as f64 / s as f64, (y - j * s) as f64 / s as f64);
        match ((i + j) % 2 == 0, u > v, u + v < 1.0) {
            (true, true, _) => nw + u * (ne - nw) + v * (se - ne),
            (true, false, _) => nw + u * (se - sw) + v * (sw - nw),
            (false, _, true) => nw + u * (ne - nw) + v * (sw - nw),
            (false, _, false) => se + (1.0 - u) * (sw - se) + (1.0 - v) * (ne - se),
        }
    }

    /// Collects the samples and blocks near a block that have the kind which its misdrawn points
    /// lack. Returns their plane.
    fn collect(&mut self, (x, y): (usize, usize), fault: Fault) -> Plane {
        let (transform, kind) =
            if fault == Fault::Shown { (self.valid, HAS_VALID) } else { (self.void, HAS_VOID) };
        let own = self.planes.over(y, y + 1);
        let (mut near, mut count, mut rows) = ([[0; 2]; 5], 0, (y, y + 1));
        let mut include = |first: usize, last: usize| rows = (rows.0.min(first), rows.1.max(last));
        around(transform, own, (x, y), |feature| {
            let (first, last) = rows_to(feature[1], 0, y, i32::from(is_block(feature)));
            include(first, last);
            near[count] = feature;
            count += 1;
        });
        let (is_across, sides) = self.facing((x, y), kind, own);
        if !is_across {
            sides.into_iter().flatten().for_each(|row| include(row, row));
        }
        let plane = self.planes.over(rows.0, rows.1);
        self.points.clear();
        for &feature in &near[..count] {
            let away = |feature: i16, block: usize| 0.5 * f64::from(feature) - block as f64;
            let centre = plane.at(away(feature[0], x), away(feature[1], y));
            self.points.push(if is_block(feature) {
                UncertainPoint::block(centre, plane)
            } else {
                UncertainPoint::point(centre)
            });
        }
        for side in sides.into_iter().flatten() {
            let away = side as f64 - if is_across { x as f64 } else { y as f64 };
            let ends =
                [0.0, 1.0].map(|end| if is_across { plane.at(away, end) } else { plane.at(end, away) });
            self.points.push(UncertainPoint::segment(ends[0], ends[1]));
        }
        plane
    }

    /// The sides that face a long block of the nearest blocks of one kind only, across its narrow
    /// side, where its own corners are far away. True if the sides are columns, false if they are
    /// rows.
    fn facing(&self, (x, y): (usize, usize), kind: u8, plane: Plane) -> (bool, [Option<usize>; 2]) {
        if !is_long(plane) {
            return (true, [None; 2]);
        }
        let (across, down) = beside(plane);
        let (is_across, count) = (across > down, across.max(down));
        let own = if is_across { x } else { y };
        let is_kind = |along: usize| {
            let (x, y) = if is_across { (along, y) } else { (x, along) };
            self.block[y * self.n + x] == kind
        };
        let before = (own.saturating_sub(count)..own).rev().find(|&along| is_kind(along));
        let after = (own + 1..(own + 1 + count).min(self.n)).find(|&along| is_kind(along));
        (is_across, [before.map(|along| along + 1), after])
    }
}

impl Cells for AboveCells<'_> {
    fn upper_bound(&mut self, level: usize, at: (usize, usize), _: u8) -> [f64; 2] {
        let centre = [(2 * at.0 + 1) << level, (2 * at.1 + 1) << level];
        let own = self.planes.over(at.1 << level, (at.1 + 1) << level);
        let upper_bound = |feature: HalfPoint| {
            let extent = i32::from(is_block(feature));
            let (first, last) = rows_to(feature[1], level, at.1, extent);
            farthest_corner(feature, level, at, self.planes.over(first, last), extent)
        };
        [self.valid, self.void].map(|transform| transform.nearest(centre, own).map_or(0.0, upper_bound))
    }

    fn evaluate(
        &mut self,
        (x, y): (usize, usize),
        drawn: Corners,
        faults: [bool; 2],
        _: &mut UpperBounds,
        bound: &mut Bound,
    ) {
        let at = |sample| self.drawn_finer(sample);
        let finer = [at((x, y)), at((x + 1, y)), at((x, y + 1)), at((x + 1, y + 1))];
        for fault in [Fault::Shown, Fault::Hidden] {
            if !faults[fault as usize] {
                continue;
            }
            let [first, second] = triangles((x + y) % 2 == 0);
            let misdrawn = |triangle, plane| Polygon::misdrawn(triangle, plane, finer, drawn, fault);
            // Whether there is such a part does not depend on the plane.
            let own = self.planes.over(y, y + 1);
            let mut parts = [misdrawn(first, own), misdrawn(second, own)];
            if parts.iter().any(Option::is_some) {
                let plane = self.collect((x, y), fault);
                if plane != own {
                    parts = [misdrawn(first, plane), misdrawn(second, plane)];
                }
                let sites = &mut *self.points;
                let halvings = ABOVE_HALVINGS + more_halvings(plane);
                simd::run(Farthest { polygons: &parts, sites, halvings, bound });
            }
        }
    }
}
