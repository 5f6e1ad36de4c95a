//! The inner loops of metric `bound` for cells of 2, 4 and 8 intervals, too narrow for vectors along their rows.
//!
//! Samples are combed: column `16 l + t` of a row becomes lane `l` of tooth `t`. Cells in the same place among the 16 columns
//! are then lanes of one vector, and all of them have their diagonals the same way. The sums are those of
//! [`rows`](crate::patch::rows), in the same order.

use crate::patch::number::Number;
use crate::simd::Kernel;

/// Columns that are combed apart.
pub const TEETH: usize = 16;
/// Rows of a band: cells of 8 intervals with both borders.
const ROWS: usize = 9;

/// Largest `s |z - D|` of every cell of 2, 4 and 8 intervals.
#[derive(Debug, Default)]
pub struct SmallCells<N> {
    lanes: usize,
    worst: [Vec<N>; 3],
}

impl<N: Number> SmallCells<N> {
    /// Sizes that are measured.
    pub const SIZES: [usize; 3] = [2, 4, 8];

    /// That of cell `(column, row)` of size `s`.
    #[inline(always)]
    pub fn of(&mut self, s: usize, column: usize, row: usize) -> &mut N {
        // Shifts: the sizes are powers of two, which the compiler cannot know.
        let bits = TEETH.trailing_zeros() - s.trailing_zeros();
        let place = column & ((1 << bits) - 1);
        let at = ((row << bits) + place) * self.lanes + (column >> bits);
        &mut self.worst[s.trailing_zeros() as usize - 1][at]
    }

    /// All of a size, row by row, as other numbers.
    pub fn plain<T>(&self, s: usize, number: impl Fn(N) -> T) -> Vec<T> {
        let worst = &self.worst[s.trailing_zeros() as usize - 1];
        let bits = TEETH.trailing_zeros() - s.trailing_zeros();
        let cells = (worst.len() / self.lanes) >> bits;
        let mut out = Vec::with_capacity(cells * cells);
        for row in worst.chunks_exact(self.lanes << bits) {
            out.extend((0..cells).map(|x| number(row[(x & ((1 << bits) - 1)) * self.lanes + (x >> bits)])));
        }
        out
    }

    /// Largest of rows `rows` of cells of size `s`, for each 16 columns of the tile.
    pub fn columns(&self, s: usize, rows: std::ops::Range<usize>, out: &mut Vec<N>) {
        let per_row = TEETH / s * self.lanes;
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

/// Measures the small cells of a tile of `n >= 16` intervals, whose cell 0 of each small size has a falling diagonal. Voids
/// count as any other sample. `L` lanes are worked on together.
pub struct Comb<'a, N, T, F: Fn(N) -> T, const L: usize> {
    /// Heights, `(n + 1)^2`.
    pub z: &'a [N],
    /// Intervals on a side.
    pub n: usize,
    /// A height in the numbers that are added.
    pub lane: F,
}

impl<N: Copy, T: Number, F: Fn(N) -> T, const L: usize> Kernel for Comb<'_, N, T, F, L> {
    type Output = SmallCells<T>;

    #[inline(always)]
    fn run(self) -> SmallCells<T> {
        let n = self.n;
        let lanes = (n / TEETH).next_multiple_of(L);
        let worst = SmallCells::<T>::SIZES.map(|s| vec![T::ZERO; n / s * (TEETH / s) * lanes]);
        let mut out = SmallCells { lanes, worst };
        for first in (0..lanes).step_by(L) {
            let mut band = Band { rows: [[[T::ZERO; L]; TEETH + 1]; ROWS], lanes, first };
            let row = |y: usize| &self.z[y * (n + 1) + first * TEETH..(y + 1) * (n + 1)];
            comb(&mut band.rows[ROWS - 1], row(0), &self.lane);
            for y in (0..n).step_by(ROWS - 1) {
                // The last row becomes the first.
                band.rows[0] = band.rows[ROWS - 1];
                for (teeth, y) in band.rows[1..].iter_mut().zip(y + 1..) {
                    comb(teeth, row(y), &self.lane);
                }
                let [two, four, eight] = &mut out.worst;
                band.pairs(y / 2, two);
                band.cells::<4>(y / 4, four);
                band.cells::<8>(y / 8, eight);
            }
        }
        out
    }
}

/// The teeth of a row, lane by lane.
type Teeth<T, const L: usize> = [[T; L]; TEETH + 1];

/// Combs a row of samples. Tooth 16 is tooth 0 of the next lane.
#[inline(always)]
fn comb<N: Copy, T, const L: usize>(teeth: &mut Teeth<T, L>, row: &[N], number: &impl Fn(N) -> T) {
    for (lane, run) in (0..L).zip(row.windows(TEETH + 1).step_by(TEETH)) {
        for (tooth, &z) in teeth.iter_mut().zip(run) {
            tooth[lane] = number(z);
        }
    }
}

/// Combed rows.
struct Band<T, const L: usize> {
    rows: [Teeth<T, L>; ROWS],
    /// Lanes of a row of the tile.
    lanes: usize,
    /// The first of these.
    first: usize,
}

impl<T: Number, const L: usize> Band<T, L> {
    /// Where the cells go that are `place` within 16 columns, `cells` of them.
    #[inline(always)]
    fn put(&self, worst: &mut [T], (row, place, cells): (usize, usize, usize), most: [T; L]) {
        let to = (row * cells + place) * self.lanes + self.first;
        worst[to..to + L].copy_from_slice(&most);
    }

    /// Cells of two intervals, the first of them in row `row`: only five dropped vertices can differ.
    #[inline(always)]
    fn pairs(&self, row: usize, worst: &mut [T]) {
        for (r, rows) in self.rows.windows(3).step_by(2).enumerate() {
            for place in 0..TEETH / 2 {
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
                self.put(worst, (row + r, place, TEETH / 2), most);
            }
        }
    }

    /// Cells of `S` intervals, the first of them in row `row`.
    #[inline(always)]
    fn cells<const S: usize>(&self, row: usize, worst: &mut [T]) {
        for (r, rows) in self.rows.windows(S + 1).step_by(S).enumerate() {
            for place in 0..TEETH / S {
                let most = if (row + r + place).is_multiple_of(2) {
                    cell::<T, S, L, true>(rows, S * place)
                } else {
                    cell::<T, S, L, false>(rows, S * place)
                };
                self.put(worst, (row + r, place, TEETH / S), most);
            }
        }
    }
}

/// Cells of `S` intervals from tooth `x` on, between the first and the last of these rows.
#[inline(always)]
fn cell<T: Number, const S: usize, const L: usize, const FALLING: bool>(
    rows: &[Teeth<T, L>],
    x: usize,
) -> [T; L] {
    let bits = S.trailing_zeros();
    let (a, b, c, d) = (&rows[0][x], &rows[0][x + S], &rows[S][x], &rows[S][x + S]);
    // Multiples 0..=S of the slope along a row and of the bend; the longest cell has nine.
    let (mut across, mut bend) = ([[T::ZERO; L]; ROWS], [[T::ZERO; L]; ROWS]);
    let (mut down, mut base, mut worst) = ([T::ZERO; L], [T::ZERO; L], [T::ZERO; L]);
    for i in 0..L {
        base[i] = a[i].scaled(bits);
        down[i] = if FALLING { d[i].minus(b[i]) } else { c[i].minus(a[i]) };
        let k = if FALLING {
            b[i].plus(c[i]).minus(a[i]).minus(d[i])
        } else {
            a[i].plus(d[i]).minus(b[i]).minus(c[i])
        };
        for m in 0..S {
            across[m + 1][i] = across[m][i].plus(b[i].minus(a[i]));
            bend[m + 1][i] = bend[m][i].plus(k);
        }
    }
    for (v, row) in rows.iter().enumerate().take(S + 1) {
        for (u, z) in row[x..=x + S].iter().enumerate().take(S + 1) {
            let beyond = if FALLING { v.saturating_sub(u) } else { (u + v).saturating_sub(S) };
            let (across, bend) = (&across[u], &bend[beyond]);
            for i in 0..L {
                let difference = z[i].scaled(bits).minus(base[i]).minus(across[i]).minus(bend[i]);
                worst[i] = worst[i].larger(difference.magnitude());
            }
        }
        for i in 0..L {
            base[i] = base[i].plus(down[i]);
        }
    }
    worst
}
