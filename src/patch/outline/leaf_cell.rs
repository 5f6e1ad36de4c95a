//! The evaluation of one cell of a leaf tile: its misdrawn points, and the pieces of the outline
//! near it.

use super::bound::{Bound, UpperBounds};
use super::distance_transform::{DistanceTransform, HalfPoint};
use super::grid::{Grid, beside, halvings, is_mixed};
use super::patterns::Patterns;
use super::search::Cells;
use super::shape::{Corners, Farthest, Fault, Segments};
use crate::geo::{Plane, Planes};
use crate::patch::blocks::MIXED;
use crate::simd;

/// Calls `take` with the features nearest to the corners and to the centre of cell `(x, y)` in a
/// plane, each once.
pub(super) fn around(
    transform: &DistanceTransform,
    plane: Plane,
    (x, y): (usize, usize),
    mut take: impl FnMut(HalfPoint),
) {
    let mut seen = [[-1; 2]; 5];
    for (count, (i, j)) in [(1, 1), (0, 0), (2, 0), (0, 2), (2, 2)].into_iter().enumerate() {
        let Some(feature) = transform.nearest([2 * x + i, 2 * y + j], plane) else { return };
        if !seen.contains(&feature) {
            seen[count] = feature;
            take(feature);
        }
    }
}

/// Squared distance from a feature to the farthest corner of square `(x, y)` of `2^level` cells, to
/// whose centre it is the nearest feature. It may lie anywhere within `extent` half intervals of
/// its place.
pub(super) fn farthest_corner(
    [feature_x, feature_y]: HalfPoint,
    level: usize,
    (x, y): (usize, usize),
    plane: Plane,
    extent: i32,
) -> f64 {
    let away = |feature: i16, place: usize| i32::from(feature) - ((2 * place as i32 + 1) << level);
    let (across, down, size) = (away(feature_x, x), away(feature_y, y), (1 << level) + extent);
    let half = |intervals: i32| 0.5 * f64::from(intervals);
    if plane.skew == 0.0 {
        return plane.squared(half(across.abs() + size), half(down.abs() + size));
    }
    let corners = [(1, 1), (1, -1), (-1, 1), (-1, -1)];
    let squared = |(i, j): (i32, i32)| plane.squared(half(across + i * size), half(down + j * size));
    corners.into_iter().map(squared).fold(0.0, f64::max)
}

/// First and last row of samples around a square of `2^level` cells in row `y` and a feature that
/// may lie `extent` half intervals away from its place.
pub(super) fn rows_to(feature_y: i16, level: usize, y: usize, extent: i32) -> (usize, usize) {
    let (north, south) = (i32::from(feature_y) - extent, i32::from(feature_y) + extent);
    let (north, south) = (north.max(0) as usize / 2, (south.max(0) as usize).div_ceil(2));
    (north.min(y << level), south.max((y + 1) << level))
}

/// Cells of a leaf tile.
pub(super) struct LeafCells<'a> {
    pub(super) grid: Grid<'a>,
    pub(super) planes: &'a Planes,
    /// Distances to the vertices of the outline.
    pub(super) transform: &'a DistanceTransform,
    pub(super) patterns: &'a mut Patterns,
    pub(super) segments: &'a mut Segments,
    /// Scratch memory: the cells near one.
    pub(super) near: &'a mut Vec<(usize, usize)>,
}

impl LeafCells<'_> {
    /// Collects the pieces of the outline near a cell. Returns their plane.
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

    /// Adds the cells beside one to `near`.
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

    /// Adds to `near` the cells at the vertices of the outline that are nearest to the corners and
    /// the centre of a cell: at most five vertices, each of up to four cells.
    fn around(&mut self, at: (usize, usize), plane: Plane) {
        let n = self.grid.n;
        around(self.transform, plane, at, |[fx, fy]| {
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
    fn upper_bound(&mut self, level: usize, at: (usize, usize), bits: u8) -> [f64; 2] {
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
        let Some(feature) = self.transform.nearest(centre, plane) else { return [0.0; 2] };
        let (first, last) = rows_to(feature[1], level, at.1, 0);
        [farthest_corner(feature, level, at, self.planes.over(first, last), 0); 2]
    }

    fn evaluate(
        &mut self,
        at: (usize, usize),
        drawn: Corners,
        faults: [bool; 2],
        upper_bounds: &mut UpperBounds,
        bound: &mut Bound,
    ) {
        let mut collected = None;
        for fault in [Fault::Shown, Fault::Hidden] {
            if !faults[fault as usize] || bound.prunes(upper_bounds.of(fault as usize)) {
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
            let mut branch = bound.branch();
            let sites = &mut *self.segments;
            simd::run(Farthest { polygons: &parts, sites, halvings: halvings(plane), bound: &mut branch });
            let upper = bound.merge(branch);
            if drawn.iter().all(|&value| fault.concerns(value)) {
                upper_bounds.lower(fault as usize, upper);
            }
        }
    }
}
