//! Cells of 8 intervals and more, in squares of 8 intervals.
//!
//! The surface of a square's own is linear where that of the cell is, so inside a square the samples are no farther from the cell's
//! than the square's own error and the largest difference at its corners add up to. Most squares are left at that: they cannot
//! have the worst sample. The others are measured, in additions only and times the cell size, so that integers stay integers.

use crate::patch::blocks::{HAS_VALID, HAS_VOID};
use crate::patch::cell::Cell;
use crate::patch::number::Number;
use crate::patch::rows::Drawn;
use crate::patch::sums::{Lanes, ROWS, SIDE, Sums};
use crate::sample::VALID;
use crate::simd::{self, Kernel};

/// A cell in its tile: column and row of its north-west corner.
#[derive(Clone, Copy)]
pub struct Place {
    /// The cell.
    pub cell: Cell,
    /// Column.
    pub x: usize,
    /// Row.
    pub y: usize,
}

/// A tile whose cells are measured.
pub struct Squares<'a, N> {
    /// Heights, `(n + 1)^2`.
    z: &'a [N],
    /// States of the samples.
    state: &'a [u8],
    n: usize,
    /// More than rounding can make of a bound, if they are not.
    margin: f64,
    /// Errors of the squares, times 8.
    errors: Vec<N>,
    /// Occupancy of the squares; none if there are no voids.
    occupancy: &'a [u8],
    /// Of the cell that is measured.
    heights: Sums<N>,
    /// Its drawn validity.
    shown: Sums<N>,
    /// Differences at the corners of its squares.
    corners: Vec<N>,
}

impl<'a, N: Number> Squares<'a, N> {
    /// A tile of `n` intervals; `errors` are those of its squares as if all samples were valid.
    pub fn new(
        (z, state, n): (&'a [N], &'a [u8], usize),
        margin: f64,
        errors: Vec<N>,
        occupancy: &'a [u8],
    ) -> Self {
        let corners = vec![N::ZERO; (n / SIDE + 1).pow(2)];
        let sums = || Sums::new(n);
        Self { z, state, n, margin, errors, occupancy, heights: sums(), shown: sums(), corners }
    }

    /// Largest `|z - D|` of a cell without voids, if that is more than `worst`; else anything that is not.
    pub fn whole(&mut self, place: Place, worst: f64) -> f64 {
        let [valid, _] = self.run::<false, false>(place, worst);
        valid
    }

    /// The same of a cell with voids, where both surfaces are shown; with `MIXED` some of its corners are void.
    ///
    /// At valid samples, and in the middles of edges from a valid to a void one.
    pub fn holed(&mut self, place: Place, mixed: bool, worst: f64) -> [f64; 2] {
        if mixed { self.run::<true, true>(place, worst) } else { self.run::<true, false>(place, worst) }
    }

    fn run<const VOIDS: bool, const MIXED: bool>(&mut self, place: Place, worst: f64) -> [f64; 2] {
        // Middles are halves.
        let scale = (2 * place.cell.s) as f64;
        let (worst, margin) = (N::narrow(worst * scale), N::narrow(self.margin * scale));
        simd::run(Measure::<N, VOIDS, MIXED> { squares: self, place, worst, margin })
            .map(|d| d.wide() / scale)
    }

    #[inline(always)]
    fn at(&self, x: usize, y: usize) -> usize {
        y * (self.n + 1) + x
    }

    /// Measures the corners of a cell's squares. Gives the largest difference at those that are shown.
    #[inline(always)]
    fn measure_corners<const VOIDS: bool, const MIXED: bool>(&mut self, place: Place) -> N {
        let Place { cell: Cell { s, .. }, x, y } = place;
        let (half, sums) = (N::whole((s / 2) as i32), &self.heights);
        let mut worst = N::ZERO;
        // Chunks, for the columns of their first samples.
        for (v, corners) in (0..=s).step_by(SIDE).zip(self.corners.chunks_exact_mut(s / SIDE + 1)) {
            let from = (y + v) * (self.n + 1) + x;
            let (z, bend) = (&self.z[from..=from + s], &sums.bend[sums.bend_at(0, v)..][..=s]);
            let terms = sums.across[..=s].chunks(SIDE).zip(bend.chunks(SIDE));
            for ((to, z), (across, bend)) in corners.iter_mut().zip(z.chunks(SIDE)).zip(terms) {
                let difference = z[0].scaled(sums.bits).minus(sums.base[v]);
                *to = difference.minus(across[0]).minus(bend[0]).magnitude();
                if !VOIDS {
                    worst = worst.larger(*to);
                }
            }
            for (u, &corner) in (0..=s).step_by(SIDE).zip(&*corners).filter(|_| VOIDS) {
                if self.state[from + u] == VALID && (!MIXED || self.shown.value(u, v) >= half) {
                    worst = worst.larger(corner);
                }
            }
        }
        worst
    }

    /// True if the drawn surface is shown nowhere in a square: its validity is linear between the corners.
    #[inline(always)]
    fn is_hidden(&self, u: usize, v: usize) -> bool {
        let half = N::whole((self.shown.s / 2) as i32);
        [(u, v), (u + SIDE, v), (u, v + SIDE), (u + SIDE, v + SIDE)]
            .into_iter()
            .all(|(u, v)| self.shown.value(u, v) < half)
    }

    /// Largest difference in a square of a cell.
    #[inline(always)]
    fn whole_square(&self, from: usize, u: usize, v: usize) -> N {
        let window = self.heights.window(u, v);
        let mut worst = [N::ZERO; SIDE];
        for (r, z) in self.z[from..].chunks(self.n + 1).take(ROWS).enumerate() {
            for (worst, difference) in worst.iter_mut().zip(window.differences(z, r)) {
                *worst = worst.larger(difference.magnitude());
            }
        }
        worst.into_iter().fold(N::ZERO, N::larger)
    }

    /// Twice the largest difference in a square with voids, as [`Self::holed`].
    #[inline(always)]
    fn holed_square<const MIXED: bool>(&self, from: usize, s: usize, u: usize, v: usize) -> [N; 2] {
        let heights = [self.heights.window(u, v), self.heights.window(u + 1, v)];
        // Not looked at without `MIXED`.
        let shown = if MIXED { &self.shown } else { &self.heights };
        let shown = [shown.window(u, v), shown.window(u + 1, v)];
        let half = N::whole((s / 2) as i32);
        let (mut worst, mut middles) = ([N::ZERO; SIDE], [N::ZERO; SIDE]);
        let mut north = [Row { differences: [N::ZERO; SIDE], kind: [HIDDEN; SIDE] }; 2];
        for r in 0..ROWS {
            let at = from + r * (self.n + 1);
            let (z, state) = (&self.z[at..=at + SIDE], &self.state[at..=at + SIDE]);
            let mut south = [
                Row::new(state, heights[0].differences(z, r)),
                Row::new(&state[1..], heights[1].differences(&z[1..], r)),
            ];
            if MIXED {
                for (row, shown) in south.iter_mut().zip(&shown) {
                    row.hide(shown.values(r), half);
                }
            }
            for row in &south {
                row.valid_samples(&mut worst);
            }
            edges(&north, &south, r, &mut middles);
            north = south;
        }
        [worst.into_iter().fold(N::ZERO, N::larger), middles.into_iter().fold(N::ZERO, N::larger)]
    }
}

/// A sample where the drawn surface is not shown.
const HIDDEN: i32 = 0;
/// A void sample where it is.
const SHOWN_VOID: i32 = 1;
/// A valid one.
const SHOWN_VALID: i32 = 2;

/// Eight samples of a row.
#[derive(Clone, Copy)]
struct Row<N> {
    differences: Lanes<N>,
    kind: [i32; SIDE],
}

impl<N: Number> Row<N> {
    #[inline(always)]
    fn new(state: &[u8], differences: Lanes<N>) -> Self {
        let state = &state[..SIDE];
        let mut kind = [HIDDEN; SIDE];
        for lane in 0..SIDE {
            kind[lane] = if state[lane] == VALID { SHOWN_VALID } else { SHOWN_VOID };
        }
        Self { differences, kind }
    }

    /// Hides samples whose drawn validity is below `half`.
    #[inline(always)]
    fn hide(&mut self, shown: Lanes<N>, half: N) {
        for (kind, shown) in self.kind.iter_mut().zip(shown) {
            *kind = if shown >= half { *kind } else { HIDDEN };
        }
    }

    /// Takes in twice the differences of the valid samples.
    #[inline(always)]
    fn valid_samples(&self, worst: &mut Lanes<N>) {
        for (lane, worst) in worst.iter_mut().enumerate() {
            let twice = self.differences[lane].scaled(1).magnitude();
            *worst = worst.larger(if self.kind[lane] == SHOWN_VALID { twice } else { N::ZERO });
        }
    }

    /// Takes in the middles of edges from these samples to others, from a valid to a void one.
    #[inline(always)]
    fn middles(&self, other: &Self, worst: &mut Lanes<N>) {
        for (lane, worst) in worst.iter_mut().enumerate() {
            let twice = self.differences[lane].plus(other.differences[lane]).magnitude();
            let crossed = self.kind[lane] + other.kind[lane] == SHOWN_VALID + SHOWN_VOID;
            *worst = worst.larger(if crossed { twice } else { N::ZERO });
        }
    }

    /// Lanes of this row and of another by turns, this one first where `lane + r` is even.
    #[inline(always)]
    fn by_turns(&self, other: &Self, r: usize) -> Self {
        let mut out = *self;
        for lane in 0..SIDE {
            if (lane + r) % 2 == 1 {
                out.differences[lane] = other.differences[lane];
                out.kind[lane] = other.kind[lane];
            }
        }
        out
    }
}

/// Edges between two rows of samples, and along the southern one, row `r` of a square. Each row also comes one column farther east.
#[inline(always)]
fn edges<N: Number>([a, b]: &[Row<N>; 2], [c, d]: &[Row<N>; 2], r: usize, worst: &mut Lanes<N>) {
    c.middles(d, worst);
    a.middles(c, worst);
    b.middles(d, worst);
    // The unit cell to the north of row 1 is in row 0.
    a.by_turns(b, r + 1).middles(&d.by_turns(c, r + 1), worst);
}

/// Measures a cell: with `VOIDS` where its samples are valid, with `MIXED` only where the drawn surface is shown. All differences
/// are times `2 s`.
struct Measure<'s, 'a, N, const VOIDS: bool, const MIXED: bool> {
    squares: &'s mut Squares<'a, N>,
    place: Place,
    worst: N,
    margin: N,
}

impl<N: Number, const VOIDS: bool, const MIXED: bool> Kernel for Measure<'_, '_, N, VOIDS, MIXED> {
    type Output = [N; 2];

    #[inline(always)]
    fn run(self) -> [N; 2] {
        let Self { squares, place, .. } = self;
        let Place { cell, x, y } = place;
        let s = cell.s;
        let ends = [(0, 0), (s, 0), (0, s), (s, s)].map(|(u, v)| squares.at(x + u, y + v));
        squares.heights.set(&Drawn::new(cell, ends.map(|i| squares.z[i])));
        if MIXED {
            let valid = |i: usize| N::whole(i32::from(squares.state[i] == VALID));
            squares.shown.set(&Drawn::new(cell, ends.map(valid)));
        }
        let mut worst = squares.measure_corners::<VOIDS, MIXED>(place).scaled(1);
        let mut middles = N::ZERO;
        let (side, across) = (s / SIDE, squares.n / SIDE);
        let bits_more = squares.heights.bits - SIDE.trailing_zeros();
        for row in 0..side {
            let corners = squares.corners[row * (side + 1)..(row + 2) * (side + 1)].split_at(side + 1);
            let pairs = corners.0.windows(2).zip(corners.1.windows(2));
            let first = (y / SIDE + row) * across + x / SIDE;
            let errors = &squares.errors[first..first + side];
            for (column, ((north, south), own)) in pairs.zip(errors).enumerate() {
                let corner = north[0].larger(north[1]).larger(south[0].larger(south[1]));
                let bound = corner.plus(own.scaled(bits_more)).scaled(1).plus(self.margin);
                // What is not a number bounds nothing.
                if bound <= self.worst.larger(worst).larger(middles) {
                    continue;
                }
                let bits = if VOIDS { squares.occupancy[first + column] } else { HAS_VALID };
                let (u, v) = (column * SIDE, row * SIDE);
                if bits == HAS_VOID || MIXED && squares.is_hidden(u, v) {
                    continue;
                }
                let from = squares.at(x + u, y + v);
                if VOIDS && (MIXED || bits != HAS_VALID) {
                    let [valid, middle] = squares.holed_square::<MIXED>(from, s, u, v);
                    (worst, middles) = (worst.larger(valid), middles.larger(middle));
                    continue;
                }
                worst = worst.larger(squares.whole_square(from, u, v).scaled(1));
                // Its eastern border is that of the next square, but for the last.
                if u + SIDE == s {
                    worst = worst.larger(squares.whole_square(from + 1, u + 1, v).scaled(1));
                }
            }
        }
        [worst, middles]
    }
}
