//! The cells of a leaf tile at full resolution: their validity, their shape, and the outline in
//! them.

use super::shape::{Corners, Fault, Polygon, Segment, Segments, triangles};
use crate::geo::Plane;

/// Most halvings of a triangle of a square leaf cell: its sides shrink to 1/32.
const LEAF_HALVINGS: u32 = 10;
/// Largest ratio of a cell's length to its width at which the cells next to it are near enough.
const LONG: f64 = 2.0;
/// Most cells to either side that are near.
const MOST_BESIDE: f64 = 64.0;

/// Most halvings of a triangle of a leaf cell.
pub(super) fn halvings(plane: Plane) -> u32 {
    LEAF_HALVINGS + more_halvings(plane)
}

/// How many more halvings a triangle of a long cell may have than one of a square cell.
pub(super) fn more_halvings(plane: Plane) -> u32 {
    let (across, down) = beside(plane);
    across.max(down).next_power_of_two().ilog2()
}

/// How many cells to either side, across and down, are near: the next one, and if cells are narrow
/// all that are nearer than a cell is long.
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

/// How many cells across, and how many down, are together as wide as the longer side of a cell is
/// long.
fn elongation(plane: Plane) -> (f64, f64) {
    let row = plane.row();
    let long = plane.dx.max(row);
    (long * row / (plane.dx * plane.dy), long / plane.dy)
}

/// True if not all corners are alike.
pub(super) fn is_mixed(full: [u8; 4]) -> bool {
    full != [0; 4] && full != [1; 4]
}

/// The samples of a tile at full resolution, which define the outline.
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

    /// The parts of the two triangles of a cell that are misdrawn by a fault, where validity as
    /// drawn is `drawn` at its corners.
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

    /// Adds the pieces of the outline in cell `(x, y)`, in a plane whose origin is the corner of
    /// cell `from`.
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
            // The outline runs between the midpoints of the two sides at the corner that differs
            // from the others.
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
