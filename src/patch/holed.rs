//! Vertical error of cells with voids: where both surfaces are shown, and nowhere else.
//!
//! All that is linear on a fine triangle is largest at a vertex of the part of it that is shown. These are valid samples, and points
//! where an outline crosses an edge. The fine outline crosses the edges from a valid to a void sample in the middle. The drawn one
//! crosses a drawn triangle along a line between the middles of two sides, which for cells of 4 intervals and more
//! consists of fine edges: what is shown is whole fine triangles, and the drawn outline adds no vertex. Then
//!
//! `max |z - D| = max { |z - D| at valid samples, |e + f| / 2 at edges with e valid and f void }`,
//!
//! both only where the drawn validity is at least 1/2. That is used for integers, whose sums are exact. Floats are clipped triangle by
//! triangle, so that rounding is what it is in `relevo verify`; but only where a bound on the result says that it matters.

use crate::patch::blocks::{HAS_VALID, HAS_VOID};
use crate::patch::cell::{Cell, Plane};
use crate::patch::number::Number;
use crate::patch::rows::{Drawn, narrow_cell};
use crate::patch::squares::{Place, Squares};
use crate::patch::sums::SIDE;
use crate::sample::{FILLED, VALID, VOID};
use crate::states;

/// Both bits: an outline may run through the unit cell.
pub const MIXED: u8 = HAS_VALID | HAS_VOID;

/// A tile with voids.
pub struct Holed<'a, N> {
    /// Heights, `(n + 1)^2`.
    pub z: &'a [N],
    /// Occupancy of its unit cells.
    pub unit: &'a [u8],
    /// Intervals on a side.
    pub n: usize,
    /// True if sums are exact.
    pub exact: bool,
    /// More than rounding can make of a height difference, if they are not.
    pub margin: f64,
    /// States of the samples.
    pub state: &'a [u8],
}

impl<N: Number> Holed<'_, N> {
    pub(super) fn at(&self, x: usize, y: usize) -> usize {
        y * (self.n + 1) + x
    }

    pub(super) fn corners(&self, place: Place) -> [usize; 4] {
        let Place { cell: Cell { s, .. }, x, y } = place;
        [self.at(x, y), self.at(x + s, y), self.at(x, y + s), self.at(x + s, y + s)]
    }

    pub(super) fn validity(&self, index: usize) -> f64 {
        f64::from(u8::from(self.state[index] == VALID))
    }

    /// The larger one of `worst` and of the largest `|z - D|` over a cell where both surfaces are shown.
    ///
    /// `bound` is at least `|z - D|` at all samples of the cell, shown or not.
    pub fn cell(&self, squares: &mut Squares<N>, place: Place, bound: f64, worst: f64) -> f64 {
        if bound + self.margin <= worst {
            return worst;
        }
        let valid = self.corners(place).map(|i| self.state[i] == VALID);
        if valid == [false; 4] {
            return worst;
        }
        let mixed = valid != [true; 4];
        if place.cell.s < SIDE {
            return match (self.exact, place.cell.s) {
                (true, 2) => self.small::<2>(place, worst),
                (true, _) => self.small::<4>(place, worst),
                _ => self.clipped(place, mixed, worst),
            };
        }
        let [valid, middle] = squares.holed(place, mixed, worst);
        if self.exact {
            return worst.max(valid).max(middle);
        }
        if valid.max(middle) + self.margin <= worst {
            return worst;
        }
        // Without a drawn outline the samples have been measured.
        if mixed {
            return self.clipped(place, mixed, worst);
        }
        let worst = worst.max(valid);
        if middle + self.margin <= worst { worst } else { self.outlined(place, worst) }
    }

    /// The two surfaces that a cell is drawn with: heights and validity.
    pub(super) fn planes(&self, place: Place) -> [[Plane; 2]; 2] {
        let corners = self.corners(place);
        [
            place.cell.planes(corners.map(|i| self.z[i].wide())),
            place.cell.planes(corners.map(|i| self.validity(i))),
        ]
    }

    /// Calls `visit` with the unit cells of a cell that have both kinds of samples, counted from its corner.
    pub(super) fn mixed_units(&self, place: Place, mut visit: impl FnMut(usize, usize)) {
        for y in 0..place.cell.s {
            let from = (place.y + y) * self.n + place.x;
            let row = &self.unit[from..from + place.cell.s];
            states::each_place(row, MIXED, |x| visit(x, y));
        }
    }

    /// Exact sums, a cell of `S` intervals: 2 or 4.
    fn small<const S: usize>(&self, place: Place, worst: f64) -> f64 {
        let samples = self.samples::<S>(place);
        let [valid, filled, any] = samples.worst.map(|d| d.scaled(1));
        // Middles are halves.
        let scale = (2 * S) as f64;
        let mut most = N::narrow(worst * scale).larger(valid);
        // The middle of an edge is no worse than the worse one of its ends.
        if filled > most {
            let even = (place.x + place.y).is_multiple_of(2);
            most = most.larger(samples.middles::<S>(even, most));
        }
        let mut worst = worst.max(most.wide() / scale);
        if S == 2 && any > most {
            let planes = self.planes(place);
            for triangle in 0..2 {
                // The outline around the corner at the right angle, or around the other two, crosses a fine edge.
                let [a, right, b] =
                    right_angle(place.cell, triangle).map(|i| self.state[self.corners(place)[i]]);
                if (a == VALID) == (b == VALID) && (a == VALID) != (right == VALID) {
                    worst = worst.max(self.clipped_triangle(place, triangle, &planes));
                }
            }
        }
        worst
    }

    /// The samples of a cell of `S` intervals, if sums are exact.
    fn samples<const S: usize>(&self, place: Place) -> Samples<N> {
        let cell = Cell { s: S, ..place.cell };
        let [a, b, c, d] = self.corners(place);
        let heights = Drawn::new(cell, [self.z[a], self.z[b], self.z[c], self.z[d]]).values::<S>();
        let valid = |i: usize| i32::from(self.state[i] == VALID);
        let validity = Drawn::new(cell, [valid(a), valid(b), valid(c), valid(d)]).values::<S>();
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

    /// Triangle by triangle.
    fn clipped(&self, place: Place, mixed: bool, worst: f64) -> f64 {
        let mut worst = worst;
        if !mixed {
            let from = self.at(place.x, place.y);
            let samples = narrow_cell(&self.z[from..], &self.state[from..], self.n + 1, place.cell);
            return self.outlined(place, worst.max(samples.wide() / place.cell.s as f64));
        }
        let planes = self.planes(place);
        for triangle in 0..2 {
            worst = worst.max(self.clipped_triangle(place, triangle, &planes));
        }
        worst
    }
}

/// Samples of a cell of 2 or 4 intervals, row by row.
struct Samples<N> {
    /// `s (z - D)`.
    differences: [[N; 5]; 5],
    /// States where the drawn surface is shown, elsewhere `VOID`.
    kinds: [[u8; 5]; 5],
    /// Largest `s |z - D|`: at the valid samples that are shown, at the fills that are, and at all samples but those without a fill.
    worst: [N; 3],
}

impl<N: Number> Samples<N> {
    /// Largest `2 s |z - D|` in the middles of edges from a valid to a void sample of a cell of `S` intervals, if that is more than `most`.
    /// Samples whose column and row add up to an even number have diagonals; `even` says so of the first.
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

/// Indices into the corners of a triangle, the one at the right angle in the middle.
fn right_angle(cell: Cell, triangle: usize) -> [usize; 3] {
    match (cell.falling, triangle) {
        (true, 0) => [0, 1, 3],
        (true, _) => [0, 2, 3],
        (false, 0) => [1, 0, 2],
        (false, _) => [1, 3, 2],
    }
}
