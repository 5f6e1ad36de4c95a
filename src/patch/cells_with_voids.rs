//! Vertical error of cells with voids: the largest difference where both surfaces are shown.
//!
//! A linear function on a fine triangle is largest at a vertex of the part that is shown. These
//! vertices are valid samples, and points where an outline crosses an edge. The fine outline
//! crosses the edges from a valid to a void sample in the middle. The drawn one crosses a drawn
//! triangle along a line between the middles of two sides, which for cells of 4 intervals and more
//! consists of fine edges: whole fine triangles are shown, and the drawn outline adds no vertex.
//! Then
//!
//! `max |z - D| = max { |z - D| at valid samples, |e + f| / 2 at edges with e valid and f void }`,
//!
//! both only where the drawn validity is at least 1/2, which is a whole number of `1 / s` and so
//! exact in any arithmetic. A cell of 2 intervals may have the drawn outline between two samples;
//! its triangles are clipped (`clipped`).

use crate::patch::blocked::{Blocked, PlacedCell};
use crate::patch::cell::{Cell, Plane};
use crate::patch::drawn_surface::DrawnSurface;
use crate::patch::number::Number;
use crate::sample::{FILLED, VALID, VOID};

/// A tile with voids, whose cells are measured.
pub struct CellsWithVoids<'a, N> {
    /// Heights, `(n + 1)^2`.
    pub z: &'a [N],
    /// Occupancy of its unit cells.
    pub unit: &'a [u8],
    /// Intervals on a side.
    pub n: usize,
    /// More than the rounding of a height difference; 0 if sums are exact.
    pub margin: f64,
    /// States of the samples.
    pub state: &'a [u8],
}

impl<N: Number> CellsWithVoids<'_, N> {
    pub(super) fn at(&self, x: usize, y: usize) -> usize {
        y * (self.n + 1) + x
    }

    pub(super) fn corners(&self, place: PlacedCell) -> [usize; 4] {
        let PlacedCell { cell: Cell { s, .. }, x, y } = place;
        [self.at(x, y), self.at(x + s, y), self.at(x, y + s), self.at(x + s, y + s)]
    }

    pub(super) fn validity(&self, index: usize) -> f64 {
        f64::from(u8::from(self.state[index] == VALID))
    }

    /// Largest `|z - D|` over a cell where both surfaces are shown; `worst` if that is larger.
    ///
    /// `bound` is at least `|z - D|` at all samples of the cell, shown or not.
    pub fn error(&self, blocked: &mut Blocked<N>, place: PlacedCell, bound: f64, worst: f64) -> f64 {
        if bound + self.margin <= worst {
            return worst;
        }
        let valid = self.corners(place).map(|i| self.state[i] == VALID);
        if valid == [false; 4] {
            return worst;
        }
        match place.cell.s {
            2 => self.small::<2>(place, worst),
            4 => self.small::<4>(place, worst),
            _ => blocked.error_with_voids(place, valid != [true; 4], worst).into_iter().fold(worst, f64::max),
        }
    }

    /// The drawn surfaces of a cell: heights and validity.
    pub(super) fn planes(&self, place: PlacedCell) -> [[Plane; 2]; 2] {
        let corners = self.corners(place);
        [
            place.cell.planes(corners.map(|i| self.z[i].wide())),
            place.cell.planes(corners.map(|i| self.validity(i))),
        ]
    }

    /// [`Self::error`] of a cell of `S` intervals, 2 or 4.
    fn small<const S: usize>(&self, place: PlacedCell, worst: f64) -> f64 {
        let samples = self.samples::<S>(place);
        let [valid, filled, any] = samples.worst.map(|d| d.scaled(1));
        // Differences in the middles of edges are halves.
        let scale = (2 * S) as f64;
        let mut most = N::narrow(worst * scale).larger(valid);
        // The difference in the middle of an edge is at most the larger one at its ends.
        if filled > most {
            let even = (place.x + place.y).is_multiple_of(2);
            most = most.larger(samples.middles::<S>(even, most));
        }
        let mut worst = worst.max(most.wide() / scale);
        if S == 2 && any > most {
            let planes = self.planes(place);
            for triangle in 0..2 {
                // An outline that separates the corner at the right angle from the other two
                // crosses a fine edge.
                let [a, right, b] =
                    right_angle(place.cell, triangle).map(|i| self.state[self.corners(place)[i]]);
                if (a == VALID) == (b == VALID) && (a == VALID) != (right == VALID) {
                    worst = worst.max(self.clipped_triangle(place, triangle, &planes));
                }
            }
        }
        worst
    }

    /// The differences at the samples of a cell of `S` intervals.
    fn samples<const S: usize>(&self, place: PlacedCell) -> Samples<N> {
        let cell = Cell { s: S, ..place.cell };
        let [a, b, c, d] = self.corners(place);
        let heights = DrawnSurface::new(cell, [self.z[a], self.z[b], self.z[c], self.z[d]]).values::<S>();
        let valid = |i: usize| i32::from(self.state[i] == VALID);
        let validity = DrawnSurface::new(cell, [valid(a), valid(b), valid(c), valid(d)]).values::<S>();
        let (mut differences, mut kinds) = ([[N::ZERO; 5]; 5], [[VOID; 5]; 5]);
        let mut worst = [N::ZERO; 3];
        for v in 0..=S {
            let from = self.at(place.x, place.y + v);
            let (z, state) = (&self.z[from..=from + S], &self.state[from..=from + S]);
            for u in 0..=S {
                let difference = z[u].scaled(S.trailing_zeros()).minus(heights[v][u]);
                let kind = if validity[v][u] >= S as i32 / 2 { state[u] } else { VOID };
                (differences[v][u], kinds[v][u]) = (difference, kind);
                for (worst, counts) in worst.iter_mut().zip([kind == VALID, kind == FILLED, state[u] != VOID])
                {
                    *worst = worst.larger(if counts { difference.magnitude() } else { N::ZERO });
                }
            }
        }
        Samples { differences, kinds, worst }
    }
}

/// The differences at the samples of a cell of 2 or 4 intervals, row by row.
struct Samples<N> {
    /// `s (z - D)`.
    differences: [[N; 5]; 5],
    /// States where the drawn surface is shown, elsewhere `VOID`.
    kinds: [[u8; 5]; 5],
    /// Largest `s |z - D|`: at the valid samples that are shown, at the fills that are shown, and
    /// at all samples that have a height.
    worst: [N; 3],
}

impl<N: Number> Samples<N> {
    /// Largest `2 s |z - D|` in the middles of edges from a valid to a void sample of a cell of `S`
    /// intervals; `most` if that is larger. Samples whose column and row have an even sum have
    /// diagonals; `even` is true if the first sample has.
    fn middles<const S: usize>(&self, even: bool, most: N) -> N {
        let mut most = most;
        for (v, u) in (0..=S).flat_map(|v| (0..=S).map(move |u| (v, u))) {
            let filled = self.differences[v][u];
            if self.kinds[v][u] != FILLED || filled.scaled(1).magnitude() <= most {
                continue;
            }
            let diagonals = (u + v).is_multiple_of(2) == even;
            for y in v.saturating_sub(1)..=S.min(v + 1) {
                for x in u.saturating_sub(1)..=S.min(u + 1) {
                    if self.kinds[y][x] == VALID && (diagonals || x == u || y == v) {
                        most = most.larger(filled.plus(self.differences[y][x]).magnitude());
                    }
                }
            }
        }
        most
    }
}

/// Indices of the corners of a triangle, the corner at the right angle in the middle.
fn right_angle(cell: Cell, triangle: usize) -> [usize; 3] {
    match (cell.falling, triangle) {
        (true, 0) => [0, 1, 3],
        (true, _) => [0, 2, 3],
        (false, 0) => [1, 0, 2],
        (false, _) => [1, 3, 2],
    }
}
