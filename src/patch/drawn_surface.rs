//! The drawn surface of a cell in additions only, scaled by the cell size `s`, so that integers
//! stay integers.
//!
//! [`DrawnSurface`] has the coefficients. Vectors of samples use the same sums of them in the same
//! order: `small_cells` for the smallest cells, [`SurfaceSums`] for the others. So floats are
//! rounded in the same way everywhere.

use crate::patch::cell::Cell;
use crate::patch::number::Number;

/// The coefficients of the drawn surface of a cell, times `s`.
///
/// With corners a, b, c, d (north-west, north-east, south-west, south-east) and `u`, `v` from the
/// north-west, `s D = s a + u (b - a) + v (d - b) + max(v - u, 0) (b + c - a -
/// d)` on both sides of a falling diagonal, and `s D = s a + u (b - a) + v (c - a) + max(u + v - s,
/// 0) (a + d - b - c)` on both sides of a rising one.
#[derive(Clone, Copy)]
pub struct DrawnSurface<N> {
    /// Size and diagonal of the cell.
    pub cell: Cell,
    /// Binary logarithm of the size.
    pub bits: u32,
    /// `s a`, the value at the north-west corner.
    pub start: N,
    /// `b - a`, the increase from one column to the next.
    pub per_column: N,
    /// The factor of `v`, the increase from one row to the next.
    pub per_row: N,
    /// The factor of the maximum: the change of slope at the diagonal.
    pub crease: N,
}

impl<N: Number> DrawnSurface<N> {
    /// The surface through four corners.
    #[inline(always)]
    pub fn new(cell: Cell, [a, b, c, d]: [N; 4]) -> Self {
        let bits = cell.s.trailing_zeros();
        let (per_row, crease) = if cell.falling {
            (d.minus(b), b.plus(c).minus(a).minus(d))
        } else {
            (c.minus(a), a.plus(d).minus(b).minus(c))
        };
        Self { cell, bits, start: a.scaled(bits), per_column: b.minus(a), per_row, crease }
    }

    /// `s D` at the samples of a cell of `S <= 4` intervals, row by row. These sums are made in
    /// another order than those of [`SurfaceSums`].
    #[inline(always)]
    pub fn values<const S: usize>(&self) -> [[N; 5]; 5] {
        let falling = self.cell.falling;
        // The part of the crease from one row to the next in the first column, and along a row
        // beyond the diagonal.
        let (first, along) =
            if falling { (self.crease, N::ZERO.minus(self.crease)) } else { (N::ZERO, self.crease) };
        let mut out = [[N::ZERO; 5]; 5];
        let mut west = self.start;
        for (v, row) in out.iter_mut().enumerate().take(S + 1) {
            let mut next = west;
            for (u, value) in row.iter_mut().enumerate().take(S + 1) {
                *value = next;
                let bent = if falling { u < v } else { u + v >= S };
                next = next.plus(self.per_column).plus(if bent { along } else { N::ZERO });
            }
            west = west.plus(self.per_row).plus(first);
        }
        out
    }
}

/// Intervals on a side of a block.
pub const SIDE: usize = 8;
/// Rows of samples of a block.
pub const ROWS: usize = SIDE + 1;

/// Numbers of the eight columns of a block.
pub type Lanes<N> = [N; SIDE];

/// The terms of a drawn surface, each added up from one row, column or diagonal to the next:
/// `s D = by_row[v] + by_column[u] + by_diagonal[diagonal_at(u, v)]`.
pub struct SurfaceSums<N> {
    /// Intervals of the cell.
    pub s: usize,
    falling: bool,
    /// Binary logarithm of `s`.
    pub bits: u32,
    /// `s a` plus the increase of `v` rows.
    pub by_row: Vec<N>,
    /// The increase of `u` columns.
    pub by_column: Vec<N>,
    /// The part of the crease, by distance from the diagonal of the cell.
    pub by_diagonal: Vec<N>,
}

impl<N: Number> SurfaceSums<N> {
    /// Memory for the cells of a tile of `n` intervals.
    pub fn new(n: usize) -> Self {
        let zeros = |count: usize| vec![N::ZERO; count];
        Self {
            s: n,
            falling: false,
            bits: 0,
            by_row: zeros(n + 1),
            by_column: zeros(n + 1),
            by_diagonal: zeros(2 * n + 1),
        }
    }

    /// Sets the terms to those of a surface.
    #[inline(always)]
    pub fn set(&mut self, surface: &DrawnSurface<N>) {
        let s = surface.cell.s;
        (self.s, self.falling, self.bits) = (s, surface.cell.falling, surface.bits);
        progress(self.by_row[..=s].iter_mut(), surface.start, surface.per_row);
        progress(self.by_column[..=s].iter_mut(), N::ZERO, surface.per_column);
        let (west, east) = self.by_diagonal[..=2 * s].split_at_mut(s);
        if self.falling {
            east.fill(N::ZERO);
            progress(west.iter_mut().rev(), N::ZERO.plus(surface.crease), surface.crease);
        } else {
            west.fill(N::ZERO);
            progress(east.iter_mut(), N::ZERO, surface.crease);
        }
    }

    /// Index of a sample in `by_diagonal`.
    #[inline(always)]
    pub fn diagonal_at(&self, u: usize, v: usize) -> usize {
        u + if self.falling { self.s - v } else { v }
    }

    /// `s D` at a sample.
    #[inline(always)]
    pub fn value(&self, u: usize, v: usize) -> N {
        self.by_row[v].plus(self.by_column[u]).plus(self.by_diagonal[self.diagonal_at(u, v)])
    }

    /// The terms of eight columns from `u` on and nine rows from `v` on.
    #[inline(always)]
    pub fn block(&self, u: usize, v: usize) -> BlockSums<N> {
        let mut block = BlockSums {
            falling: self.falling,
            bits: self.bits,
            by_row: [N::ZERO; ROWS],
            by_column: [N::ZERO; SIDE],
            by_diagonal: [N::ZERO; 2 * SIDE],
        };
        let first = self.diagonal_at(u, if self.falling { v + SIDE } else { v });
        block.by_row.copy_from_slice(&self.by_row[v..v + ROWS]);
        block.by_column.copy_from_slice(&self.by_column[u..u + SIDE]);
        block.by_diagonal.copy_from_slice(&self.by_diagonal[first..first + 2 * SIDE]);
        block
    }
}

/// Sets numbers to an arithmetic progression.
#[inline(always)]
fn progress<'a, N: Number + 'a>(numbers: impl Iterator<Item = &'a mut N>, first: N, step: N) {
    let mut next = first;
    for number in numbers {
        *number = next;
        next = next.plus(step);
    }
}

/// The terms of a block of 8 x 8 intervals.
pub struct BlockSums<N> {
    falling: bool,
    bits: u32,
    by_row: [N; ROWS],
    by_column: Lanes<N>,
    by_diagonal: [N; 2 * SIDE],
}

impl<N: Number> BlockSums<N> {
    /// The terms of `by_diagonal` along row `r`.
    #[inline(always)]
    fn diagonal(&self, r: usize) -> &[N] {
        let first = if self.falling { SIDE - r } else { r };
        &self.by_diagonal[first..first + SIDE]
    }

    /// `s (z - D)` along row `r`.
    #[inline(always)]
    pub fn differences(&self, z: &[N], r: usize) -> Lanes<N> {
        let (z, diagonal) = (&z[..SIDE], self.diagonal(r));
        let mut out = [N::ZERO; SIDE];
        for lane in 0..SIDE {
            let difference = z[lane].scaled(self.bits).minus(self.by_row[r]);
            out[lane] = difference.minus(self.by_column[lane]).minus(diagonal[lane]);
        }
        out
    }

    /// `s D` along row `r`.
    #[inline(always)]
    pub fn values(&self, r: usize) -> Lanes<N> {
        let diagonal = self.diagonal(r);
        let mut out = [N::ZERO; SIDE];
        for lane in 0..SIDE {
            out[lane] = self.by_row[r].plus(self.by_column[lane]).plus(diagonal[lane]);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patch::blocked::{Blocked, PlacedCell};
    use crate::patch::small_cells::{MeasureSmallCells, SmallCells};
    use crate::sample::{VALID, VOID};
    use crate::simd;
    use proptest::prelude::*;

    proptest! {
        /// Floats are rounded: all ways must add in the same order to find the same bits.
        #[test]
        fn blocked_and_small_cells_find_the_bits_of_the_plain_sums(
            seed in proptest::collection::vec((-1e4_f64..1e4, 0..5_u8), 17 * 17),
            falling: bool,
        ) {
            let n = 16;
            let z: Vec<f64> = seed.iter().map(|v| v.0).collect();
            let valid = vec![VALID; z.len()];
            let mut small = simd::run(MeasureSmallCells::<_, _, _, 8> { z: &z, n, lane: |z| z });
            for s in SmallCells::<f64>::SIZES {
                for (column, row) in (0..n / s * (n / s)).map(|i| (i % (n / s), i / (n / s))) {
                    let cell = Cell { s, falling: (column + row).is_multiple_of(2) };
                    let from = row * s * (n + 1) + column * s;
                    let plain = narrow_cell(&z[from..], n + 1, cell);
                    prop_assert_eq!(*small.of(s, column, row), plain);
                }
            }
            let eights = small.row_by_row(8, |e| e);
            let mut blocked = Blocked::new((&z, &valid, n), 1e-6, eights.clone(), &[]);
            for (at, eight) in eights.iter().enumerate() {
                let cell = Cell { s: 8, falling: at == 0 || at == 3 };
                let place = PlacedCell { cell, x: at % 2 * 8, y: at / 2 * 8 };
                prop_assert_eq!(blocked.error_full(place, 0.0), eight / 8.0);
            }
            let mut state: Vec<u8> = seed.iter().map(|v| if v.1 == 0 { VOID } else { VALID }).collect();
            for corner in [0, 16, 17 * 16, 17 * 16 + 16] {
                state[corner] = VALID;
            }
            let place = PlacedCell { cell: Cell { s: 16, falling }, x: 0, y: 0 };
            let most = |state: &[u8]| plain_sums(&z, state, place.cell) / 16.0;
            prop_assert_eq!(blocked.error_full(place, 0.0), most(&valid));
            let mut blocked = Blocked::new((&z, &state, n), 1e-6, eights, &[3; 4]);
            prop_assert_eq!(blocked.error_with_voids(place, false, 0.0)[0], most(&state));
        }
    }

    /// Largest `s |z - D|` over the samples of a cell of `s <= 8` intervals: the same sums, one by
    /// one.
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
        let surface = DrawnSurface::new(cell, [z[0], z[s], z[at(0, s)], z[at(s, s)]]);
        let mut by_diagonal = [0.0; 9];
        for m in 0..s {
            by_diagonal[m + 1] = by_diagonal[m] + surface.crease;
        }
        let mut base = surface.start;
        for v in 0..=s {
            let mut across = 0.0;
            for u in 0..=s {
                let beyond = if cell.falling { v.saturating_sub(u) } else { (u + v).saturating_sub(s) };
                let difference = z[at(u, v)].scaled(surface.bits) - base - across - by_diagonal[beyond];
                worst = worst.max(difference.abs());
                across += surface.per_column;
            }
            base += surface.per_row;
        }
        worst
    }

    /// Largest `s |z - D|` over the valid samples of a cell that is a tile.
    fn plain_sums(z: &[f64], state: &[u8], cell: Cell) -> f64 {
        let (s, stride) = (cell.s, cell.s + 1);
        let surface = DrawnSurface::new(cell, [z[0], z[s], z[s * stride], z[s * stride + s]]);
        let sum = |start: f64, step: f64, times: usize| (0..times).fold(start, |sum, _| sum + step);
        let difference = |i: usize| {
            let (u, v) = (i % stride, i / stride);
            let beyond = if cell.falling { v.saturating_sub(u) } else { (u + v).saturating_sub(s) };
            let base = z[i].scaled(surface.bits) - sum(surface.start, surface.per_row, v);
            base - sum(0.0, surface.per_column, u) - sum(0.0, surface.crease, beyond)
        };
        let valid = (0..z.len()).filter(|&i| state[i] == VALID);
        valid.fold(0.0, |worst: f64, i| worst.max(difference(i).abs()))
    }
}
