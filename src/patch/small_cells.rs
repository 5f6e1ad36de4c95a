//! Errors of cells of 2, 4 and 8 intervals, which are too narrow for vectors along their rows.
//!
//! Rows are transposed in groups of [`STRIDE`] columns: column `16 l + t` becomes lane `l` of
//! vector `t`. Cells at the same place within their groups are then lanes of one vector, and all of
//! them have their diagonals the same way:
//!
//! ```text
//! columns of a row      0  1  2 .. 15 | 16 17 18 .. 31 | 32 33 34 .. 47 | ..
//! vector 0              0             , 16             , 32             , ..     lanes 0, 1, 2, ..
//! vector 1                 1          ,    17          ,    33          , ..
//! ```
//!
//! A loop over the rows of each cell, one cell after the other, gives the same errors. With it a
//! build takes 69 % more processor time, 40 to 43 % with voids (16 385 x 16 385, int16).
//!
//! The sums are those of [`DrawnSurface`](crate::patch::drawn_surface::DrawnSurface), in the same
//! order.

use crate::patch::number::Number;
use crate::simd::Kernel;

/// Columns between two lanes of a vector.
pub const STRIDE: usize = 16;
/// Rows of a band: a row of cells of 8 intervals with both borders.
const ROWS: usize = 9;

/// The errors `s |z - D|` of all cells of 2, 4 and 8 intervals of a tile.
#[derive(Debug, Default)]
pub struct SmallCells<N> {
    /// Lanes of a row of the tile.
    lanes: usize,
    /// For each size, by row of cells, place in the group, lane.
    worst: [Vec<N>; 3],
}

impl<N: Number> SmallCells<N> {
    /// Sizes that are measured.
    pub const SIZES: [usize; 3] = [2, 4, 8];

    /// The error of cell `(column, row)` of size `s`.
    #[inline(always)]
    pub fn of(&mut self, s: usize, column: usize, row: usize) -> &mut N {
        // Shifts: the sizes are powers of two, which the compiler cannot know.
        let bits = STRIDE.trailing_zeros() - s.trailing_zeros();
        let place = column & ((1 << bits) - 1);
        let at = ((row << bits) + place) * self.lanes + (column >> bits);
        &mut self.worst[s.trailing_zeros() as usize - 1][at]
    }

    /// The errors of all cells of a size, row by row, each changed by `number`.
    pub fn row_by_row<T>(&self, s: usize, number: impl Fn(N) -> T) -> Vec<T> {
        let worst = &self.worst[s.trailing_zeros() as usize - 1];
        let bits = STRIDE.trailing_zeros() - s.trailing_zeros();
        let cells = (worst.len() / self.lanes) >> bits;
        let mut out = Vec::with_capacity(cells * cells);
        for row in worst.chunks_exact(self.lanes << bits) {
            out.extend((0..cells).map(|x| number(row[(x & ((1 << bits) - 1)) * self.lanes + (x >> bits)])));
        }
        out
    }

    /// Sets `out` to the largest errors of rows `rows` of cells of size `s`, one for each group of
    /// columns.
    pub fn group_maxima(&self, s: usize, rows: std::ops::Range<usize>, out: &mut Vec<N>) {
        let per_row = STRIDE / s * self.lanes;
        out.clear();
        out.resize(self.lanes, N::ZERO);
        let worst = &self.worst[s.trailing_zeros() as usize - 1][rows.start * per_row..rows.end * per_row];
        for run in worst.chunks_exact(self.lanes) {
            for (out, &worst) in out.iter_mut().zip(run) {
                *out = out.larger(worst);
            }
        }
    }
}

/// Kernel: the errors of the small cells of a tile of `n >= 16` intervals, whose cell 0 of each
/// small size has a falling diagonal. Void samples count as any other. `L` lanes are worked on
/// together.
pub struct MeasureSmallCells<'a, N, T, F: Fn(N) -> T, const L: usize> {
    /// Heights, `(n + 1)^2`.
    pub z: &'a [N],
    /// Intervals on a side.
    pub n: usize,
    /// Converts a height to the numbers that are added.
    pub lane: F,
}

impl<N: Copy, T: Number, F: Fn(N) -> T, const L: usize> Kernel for MeasureSmallCells<'_, N, T, F, L> {
    type Output = SmallCells<T>;

    #[inline(always)]
    fn run(self) -> SmallCells<T> {
        let n = self.n;
        let lanes = (n / STRIDE).next_multiple_of(L);
        let worst = SmallCells::<T>::SIZES.map(|s| vec![T::ZERO; n / s * (STRIDE / s) * lanes]);
        let mut out = SmallCells { lanes, worst };
        for first in (0..lanes).step_by(L) {
            let mut band = Band { rows: [[[T::ZERO; L]; STRIDE + 1]; ROWS], lanes, first };
            let row = |y: usize| &self.z[y * (n + 1) + first * STRIDE..(y + 1) * (n + 1)];
            transpose(&mut band.rows[ROWS - 1], row(0), &self.lane);
            for y in (0..n).step_by(ROWS - 1) {
                // The last row becomes the first.
                band.rows[0] = band.rows[ROWS - 1];
                for (vectors, y) in band.rows[1..].iter_mut().zip(y + 1..) {
                    transpose(vectors, row(y), &self.lane);
                }
                let [two, four, eight] = &mut out.worst;
                band.cells_of_two(y / 2, two);
                band.cells::<4>(y / 4, four);
                band.cells::<8>(y / 8, eight);
            }
        }
        out
    }
}

/// A transposed row: its vectors, and once more the first, moved on by a lane.
type Vectors<T, const L: usize> = [[T; L]; STRIDE + 1];

/// Transposes a row of samples. Lane `l` of vector 16 is lane `l + 1` of vector 0.
#[inline(always)]
fn transpose<N: Copy, T, const L: usize>(vectors: &mut Vectors<T, L>, row: &[N], number: &impl Fn(N) -> T) {
    for (lane, run) in (0..L).zip(row.windows(STRIDE + 1).step_by(STRIDE)) {
        for (vector, &z) in vectors.iter_mut().zip(run) {
            vector[lane] = number(z);
        }
    }
}

/// Transposed rows of a tile.
struct Band<T, const L: usize> {
    rows: [Vectors<T, L>; ROWS],
    /// Lanes of a row of the tile.
    lanes: usize,
    /// The first lane of the band.
    first: usize,
}

impl<T: Number, const L: usize> Band<T, L> {
    /// Stores the errors of the cells at `place` of the `cells` in a group.
    #[inline(always)]
    fn store(&self, worst: &mut [T], (row, place, cells): (usize, usize, usize), most: [T; L]) {
        let to = (row * cells + place) * self.lanes + self.first;
        worst[to..to + L].copy_from_slice(&most);
    }

    /// Measures the cells of two intervals, the first of them in row `row`: only the five dropped
    /// vertices can differ.
    #[inline(always)]
    fn cells_of_two(&self, row: usize, worst: &mut [T]) {
        for (r, rows) in self.rows.windows(3).step_by(2).enumerate() {
            for place in 0..STRIDE / 2 {
                let at = |x: usize, y: usize| &rows[y][2 * place + x];
                let falling = (r + place).is_multiple_of(2);
                let diagonal = if falling { [at(0, 0), at(2, 2)] } else { [at(2, 0), at(0, 2)] };
                let middles = [
                    (at(1, 0), at(0, 0), at(2, 0)),
                    (at(0, 1), at(0, 0), at(0, 2)),
                    (at(2, 1), at(2, 0), at(2, 2)),
                    (at(1, 2), at(0, 2), at(2, 2)),
                    (at(1, 1), diagonal[0], diagonal[1]),
                ];
                let mut most = [T::ZERO; L];
                for (c, a, b) in middles {
                    for i in 0..L {
                        most[i] = most[i].larger(c[i].scaled(1).minus(a[i]).minus(b[i]).magnitude());
                    }
                }
                self.store(worst, (row + r, place, STRIDE / 2), most);
            }
        }
    }

    /// Measures the cells of `S` intervals, the first of them in row `row`.
    #[inline(always)]
    fn cells<const S: usize>(&self, row: usize, worst: &mut [T]) {
        for (r, rows) in self.rows.windows(S + 1).step_by(S).enumerate() {
            for place in 0..STRIDE / S {
                let most = if (row + r + place).is_multiple_of(2) {
                    cell::<T, S, L, true>(rows, S * place)
                } else {
                    cell::<T, S, L, false>(rows, S * place)
                };
                self.store(worst, (row + r, place, STRIDE / S), most);
            }
        }
    }
}

/// Errors of the cells of `S` intervals from vector `x` on, between the first and the last of these
/// rows.
#[inline(always)]
fn cell<T: Number, const S: usize, const L: usize, const FALLING: bool>(
    rows: &[Vectors<T, L>],
    x: usize,
) -> [T; L] {
    let bits = S.trailing_zeros();
    let (a, b, c, d) = (&rows[0][x], &rows[0][x + S], &rows[S][x], &rows[S][x + S]);
    // Multiples 0..=S of the slope along a row and of the crease; the largest cell has nine.
    let (mut by_column, mut by_diagonal) = ([[T::ZERO; L]; ROWS], [[T::ZERO; L]; ROWS]);
    let (mut per_row, mut by_row, mut worst) = ([T::ZERO; L], [T::ZERO; L], [T::ZERO; L]);
    for i in 0..L {
        by_row[i] = a[i].scaled(bits);
        per_row[i] = if FALLING { d[i].minus(b[i]) } else { c[i].minus(a[i]) };
        let crease = if FALLING {
            b[i].plus(c[i]).minus(a[i]).minus(d[i])
        } else {
            a[i].plus(d[i]).minus(b[i]).minus(c[i])
        };
        for m in 0..S {
            by_column[m + 1][i] = by_column[m][i].plus(b[i].minus(a[i]));
            by_diagonal[m + 1][i] = by_diagonal[m][i].plus(crease);
        }
    }
    for (v, row) in rows.iter().enumerate().take(S + 1) {
        for (u, z) in row[x..=x + S].iter().enumerate().take(S + 1) {
            let beyond = if FALLING { v.saturating_sub(u) } else { (u + v).saturating_sub(S) };
            let (by_column, by_diagonal) = (&by_column[u], &by_diagonal[beyond]);
            for i in 0..L {
                let difference = z[i].scaled(bits).minus(by_row[i]).minus(by_column[i]).minus(by_diagonal[i]);
                worst[i] = worst[i].larger(difference.magnitude());
            }
        }
        for i in 0..L {
            by_row[i] = by_row[i].plus(per_row[i]);
        }
    }
    worst
}
