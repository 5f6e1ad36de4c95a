//! The drawn surface of a cell in additions only, scaled by the cell size `s`, so that integers stay integers.
//!
//! Here are the terms. The same sums of them, in the same order, are made for many samples at a time: of the smallest cells in `comb`,
//! of the others in `squares`.

use crate::patch::cell::Cell;
use crate::patch::number::Number;

/// The drawn surface of a cell, times `s`.
///
/// With corners a, b, c, d (north-west, north-east, south-west, south-east) and `u`, `v` from the north-west,
/// `s D = s a + u (b - a) + v (d - b) + max(v - u, 0) (b + c - a - d)` on both sides of a falling diagonal, and
/// `s D = s a + u (b - a) + v (c - a) + max(u + v - s, 0) (a + d - b - c)` on both sides of a rising one.
#[derive(Clone, Copy)]
pub struct Drawn<N> {
    /// Its size and diagonal.
    pub cell: Cell,
    /// Bits of the size.
    pub bits: u32,
    /// At the north-west corner.
    pub start: N,
    /// `b - a`.
    pub across: N,
    /// The factor of `v`.
    pub down: N,
    /// The factor of the maximum.
    pub bend: N,
}

impl<N: Number> Drawn<N> {
    /// The surface through four corners.
    #[inline(always)]
    pub fn new(cell: Cell, [a, b, c, d]: [N; 4]) -> Self {
        let bits = cell.s.trailing_zeros();
        let (down, bend) = if cell.falling {
            (d.minus(b), b.plus(c).minus(a).minus(d))
        } else {
            (c.minus(a), a.plus(d).minus(b).minus(c))
        };
        Self { cell, bits, start: a.scaled(bits), across: b.minus(a), down, bend }
    }

    /// `s D` at the samples of a cell of `S <= 4` intervals, row by row; the order of these sums is another.
    #[inline(always)]
    pub fn values<const S: usize>(&self) -> [[N; 5]; 5] {
        let falling = self.cell.falling;
        // What the bend does from one row to the next in the first column, and along a row where it does something.
        let (first, along) =
            if falling { (self.bend, N::ZERO.minus(self.bend)) } else { (N::ZERO, self.bend) };
        let mut out = [[N::ZERO; 5]; 5];
        let mut west = self.start;
        for (v, row) in out.iter_mut().enumerate().take(S + 1) {
            let mut next = west;
            for (u, value) in row.iter_mut().enumerate().take(S + 1) {
                *value = next;
                let bent = if falling { u < v } else { u + v >= S };
                next = next.plus(self.across).plus(if bent { along } else { N::ZERO });
            }
            west = west.plus(self.down).plus(first);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patch::comb::{Comb, SmallCells};
    use crate::patch::squares::{Place, Squares};
    use crate::sample::{VALID, VOID};
    use crate::simd;
    use proptest::prelude::*;

    proptest! {
        /// Floats are rounded: all ways must add in the same order to find the same bits.
        #[test]
        fn squares_and_combs_find_the_bits_of_the_plain_sums(
            seed in proptest::collection::vec((-1e4_f64..1e4, 0..5_u8), 17 * 17),
            falling: bool,
        ) {
            let n = 16;
            let z: Vec<f64> = seed.iter().map(|v| v.0).collect();
            let valid = vec![VALID; z.len()];
            let mut small = simd::run(Comb::<_, _, _, 8> { z: &z, n, lane: |z| z });
            for s in SmallCells::<f64>::SIZES {
                for (column, row) in (0..n / s * (n / s)).map(|i| (i % (n / s), i / (n / s))) {
                    let cell = Cell { s, falling: (column + row).is_multiple_of(2) };
                    let from = row * s * (n + 1) + column * s;
                    let plain = narrow_cell(&z[from..], n + 1, cell);
                    prop_assert_eq!(*small.of(s, column, row), plain);
                }
            }
            let eights = small.plain(8, |e| e);
            let mut squares = Squares::new((&z, &valid, n), 1e-6, eights.clone(), &[]);
            for (at, eight) in eights.iter().enumerate() {
                let cell = Cell { s: 8, falling: at == 0 || at == 3 };
                let place = Place { cell, x: at % 2 * 8, y: at / 2 * 8 };
                prop_assert_eq!(squares.whole(place, 0.0), eight / 8.0);
            }
            let mut state: Vec<u8> = seed.iter().map(|v| if v.1 == 0 { VOID } else { VALID }).collect();
            for corner in [0, 16, 17 * 16, 17 * 16 + 16] {
                state[corner] = VALID;
            }
            let place = Place { cell: Cell { s: 16, falling }, x: 0, y: 0 };
            let most = |state: &[u8]| plain_sums(&z, state, place.cell) / 16.0;
            prop_assert_eq!(squares.whole(place, 0.0), most(&valid));
            let mut squares = Squares::new((&z, &state, n), 1e-6, eights, &[3; 4]);
            prop_assert_eq!(squares.holed(place, false, 0.0)[0], most(&state));
        }
    }

    /// Largest `s |z - D|` over the samples of a cell of `s <= 8` intervals: the same sums, one by one.
    fn narrow_cell(z: &[f64], stride: usize, cell: Cell) -> f64 {
        let s = cell.s;
        let at = |x: usize, y: usize| y * stride + x;
        let mut worst = 0.0_f64;
        if s == 2 {
            let [a, b] = if cell.falling { [at(0, 0), at(2, 2)] } else { [at(2, 0), at(0, 2)] };
            for (c, a, b) in [
                (at(1, 0), at(0, 0), at(2, 0)),
                (at(0, 1), at(0, 0), at(0, 2)),
                (at(2, 1), at(2, 0), at(2, 2)),
                (at(1, 2), at(0, 2), at(2, 2)),
                (at(1, 1), a, b),
            ] {
                worst = worst.max((2.0 * z[c] - z[a] - z[b]).abs());
            }
            return worst;
        }
        let drawn = Drawn::new(cell, [z[0], z[s], z[at(0, s)], z[at(s, s)]]);
        let mut bend = [0.0; 9];
        for m in 0..s {
            bend[m + 1] = bend[m] + drawn.bend;
        }
        let mut base = drawn.start;
        for v in 0..=s {
            let mut across = 0.0;
            for u in 0..=s {
                let beyond = if cell.falling { v.saturating_sub(u) } else { (u + v).saturating_sub(s) };
                let difference = z[at(u, v)].scaled(drawn.bits) - base - across - bend[beyond];
                worst = worst.max(difference.abs());
                across += drawn.across;
            }
            base += drawn.down;
        }
        worst
    }

    /// Largest `s |z - D|` over the valid samples of a cell that is a tile.
    fn plain_sums(z: &[f64], state: &[u8], cell: Cell) -> f64 {
        let (s, stride) = (cell.s, cell.s + 1);
        let drawn = Drawn::new(cell, [z[0], z[s], z[s * stride], z[s * stride + s]]);
        let sum = |start: f64, step: f64, times: usize| (0..times).fold(start, |sum, _| sum + step);
        let difference = |i: usize| {
            let (u, v) = (i % stride, i / stride);
            let beyond = if cell.falling { v.saturating_sub(u) } else { (u + v).saturating_sub(s) };
            let base = z[i].scaled(drawn.bits) - sum(drawn.start, drawn.down, v);
            base - sum(0.0, drawn.across, u) - sum(0.0, drawn.bend, beyond)
        };
        let valid = (0..z.len()).filter(|&i| state[i] == VALID);
        valid.fold(0.0, |worst: f64, i| worst.max(difference(i).abs()))
    }
}
