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
use crate::patch::cell::{Cell, Plane, Vertex};
use crate::patch::number::Number;
use crate::patch::rows::narrow_cell;
use crate::patch::squares::{Place, Squares};
use crate::patch::sums::SIDE;
use crate::sample::VALID;

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
            return if self.exact { self.small(place, worst) } else { self.clipped(place, mixed, worst) };
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
            // Most rows of most cells have no outline, and this is a fast way to see it.
            if !row.contains(&MIXED) {
                continue;
            }
            for (x, _) in row.iter().enumerate().filter(|(_, bits)| **bits == MIXED) {
                visit(x, y);
            }
        }
    }

    /// Exact sums: the middles of edges from a valid to a void sample. `worst` is at least the difference at the valid samples that
    /// are shown; then a middle can be worse only if its void end is.
    fn edges(&self, place: Place, worst: f64) -> f64 {
        let cell = place.cell;
        let [heights, validity] = self.planes(place);
        let mut worst = worst;
        self.mixed_units(place, |x, y| {
            let corners = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
            let mut worse = false;
            let vertices = corners.map(|(x, y)| {
                let index = self.at(place.x + x, place.y + y);
                let (i, j) = (x as f64, y as f64);
                let triangle = cell.triangle(i, j);
                let difference = self.z[index].wide() - heights[triangle].value(i, j);
                let fine = self.validity(index);
                worse |= fine == 0.0 && difference.abs() > worst;
                Vertex { fine, drawn: validity[triangle].value(i, j), difference }
            });
            if !worse {
                return;
            }
            let falling = (place.x + x + place.y + y).is_multiple_of(2);
            for (a, b) in [(0, 1), (0, 2), (1, 3), (2, 3), if falling { (0, 3) } else { (1, 2) }] {
                let (a, b) = (vertices[a], vertices[b]);
                if a.fine != b.fine && a.drawn >= 0.5 && b.drawn >= 0.5 {
                    worst = worst.max(0.5 * (a.difference + b.difference).abs());
                }
            }
        });
        worst
    }

    /// Exact sums, a cell of 2 or 4 intervals.
    fn small(&self, place: Place, worst: f64) -> f64 {
        let (cell, s) = (place.cell, place.cell.s);
        let [heights, validity] = self.planes(place);
        let mut worst = worst;
        for y in 0..=s {
            for x in 0..=s {
                let index = self.at(place.x + x, place.y + y);
                let (i, j) = (x as f64, y as f64);
                let triangle = cell.triangle(i, j);
                if self.state[index] == VALID && validity[triangle].value(i, j) >= 0.5 {
                    worst = worst.max((self.z[index].wide() - heights[triangle].value(i, j)).abs());
                }
            }
        }
        worst = self.edges(place, worst);
        if s == 2 {
            for triangle in 0..2 {
                // The outline around the corner at the right angle, or around the other two, crosses a fine edge.
                let [a, right, b] = right_angle(cell, triangle).map(|i| self.state[self.corners(place)[i]]);
                if (a == VALID) == (b == VALID) && (a == VALID) != (right == VALID) {
                    worst = worst.max(self.clipped_triangle(place, triangle, &[heights, validity]));
                }
            }
        }
        worst
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

/// Indices into the corners of a triangle, the one at the right angle in the middle.
fn right_angle(cell: Cell, triangle: usize) -> [usize; 3] {
    match (cell.falling, triangle) {
        (true, 0) => [0, 1, 3],
        (true, _) => [0, 2, 3],
        (false, 0) => [1, 0, 2],
        (false, _) => [1, 3, 2],
    }
}
