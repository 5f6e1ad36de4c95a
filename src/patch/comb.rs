//! The inner loops of metric `bound` for cells of 2, 4 and 8 intervals, too narrow for vectors along their rows.
//!
//! Samples are combed: column `16 l + t` of a row becomes lane `l` of tooth `t`. Cells in the same place among the 16 columns
//! are then lanes of one vector, and all of them have their diagonals the same way. The sums are those of
//! [`rows`](crate::patch::rows), in the same order.

use crate::patch::number::Number;
use crate::simd::Kernel;

/// Columns that are combed apart.
pub const TEETH: usize = 16;
/// Lanes that are worked on together.
const LANES: usize = 8;
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
/// count as any other sample.
pub struct Comb<'a, N> {
    /// Heights, `(n + 1)^2`.
    pub z: &'a [N],
    /// Intervals on a side.
    pub n: usize,
}

impl<N: Number> Kernel for Comb<'_, N> {
    type Output = SmallCells<N>;

    #[inline(always)]
    fn run(self) -> SmallCells<N> {
        let n = self.n;
        let lanes = (n / TEETH).next_multiple_of(LANES);
        let worst = SmallCells::<N>::SIZES.map(|s| vec![N::ZERO; n / s * (TEETH / s) * lanes]);
        let mut out = SmallCells { lanes, worst };
        let mut band = Band { teeth: vec![N::ZERO; ROWS * (TEETH + 1) * lanes], lanes };
        let row = |y: usize| &self.z[y * (n + 1)..(y + 1) * (n + 1)];
        band.comb(ROWS - 1, row(0));
        for y in (0..n).step_by(ROWS - 1) {
            band.next();
            for i in 1..ROWS {
                band.comb(i, row(y + i));
            }
            let [two, four, eight] = &mut out.worst;
            band.pairs(y / 2, two);
            band.cells::<4>(y / 4, four);
            band.cells::<8>(y / 8, eight);
        }
        out
    }
}

/// Combed rows: tooth after tooth, row after row.
struct Band<N> {
    teeth: Vec<N>,
    lanes: usize,
}

impl<N: Number> Band<N> {
    /// The last row becomes the first.
    #[inline(always)]
    fn next(&mut self) {
        let row = (TEETH + 1) * self.lanes;
        self.teeth.copy_within((ROWS - 1) * row.., 0);
    }

    /// Combs a row of samples. Tooth 16 is tooth 0 of the next lane.
    #[inline(always)]
    fn comb(&mut self, y: usize, row: &[N]) {
        let lanes = self.lanes;
        let teeth = &mut self.teeth[y * (TEETH + 1) * lanes..(y + 1) * (TEETH + 1) * lanes];
        for (lane, run) in row.windows(TEETH + 1).step_by(TEETH).enumerate() {
            for (tooth, &z) in run.iter().enumerate() {
                teeth[tooth * lanes + lane] = z;
            }
        }
    }

    /// Eight lanes of a tooth of a row.
    #[inline(always)]
    fn load(&self, y: usize, tooth: usize, lane: usize) -> [N; LANES] {
        let from = (y * (TEETH + 1) + tooth) * self.lanes + lane;
        let mut out = [N::ZERO; LANES];
        out.copy_from_slice(&self.teeth[from..from + LANES]);
        out
    }

    /// Cells of two intervals, the first of them in row `row`: only five dropped vertices can differ.
    #[inline(always)]
    fn pairs(&self, row: usize, worst: &mut [N]) {
        let cells = TEETH / 2;
        for r in 0..4 {
            for h in 0..cells {
                for lane in (0..self.lanes).step_by(LANES) {
                    let at = |x: usize, y: usize| self.load(2 * r + y, 2 * h + x, lane);
                    let diagonal =
                        if (r + h).is_multiple_of(2) { [at(0, 0), at(2, 2)] } else { [at(2, 0), at(0, 2)] };
                    let middles = [
                        (at(1, 0), at(0, 0), at(2, 0)),
                        (at(0, 1), at(0, 0), at(0, 2)),
                        (at(2, 1), at(2, 0), at(2, 2)),
                        (at(1, 2), at(0, 2), at(2, 2)),
                        (at(1, 1), diagonal[0], diagonal[1]),
                    ];
                    let to = ((row + r) * cells + h) * self.lanes + lane;
                    let out = &mut worst[to..to + LANES];
                    for i in 0..LANES {
                        let off = |(c, a, b): &([N; LANES], [N; LANES], [N; LANES])| {
                            c[i].scaled(1).minus(a[i]).minus(b[i]).magnitude()
                        };
                        out[i] = middles.iter().map(off).fold(N::ZERO, N::larger);
                    }
                }
            }
        }
    }

    /// Cells of `S` intervals, the first of them in row `row`.
    #[inline(always)]
    fn cells<const S: usize>(&self, row: usize, worst: &mut [N]) {
        let cells = TEETH / S;
        for r in 0..8 / S {
            for h in 0..cells {
                for lane in (0..self.lanes).step_by(LANES) {
                    let most = self.cell::<S>(S * r, S * h, lane, (row + r + h).is_multiple_of(2));
                    let to = ((row + r) * cells + h) * self.lanes + lane;
                    worst[to..to + LANES].copy_from_slice(&most);
                }
            }
        }
    }

    /// Eight cells of `S` intervals from row `y` and tooth `x` on.
    #[inline(always)]
    fn cell<const S: usize>(&self, y: usize, x: usize, lane: usize, falling: bool) -> [N; LANES] {
        let bits = S.trailing_zeros();
        let corner = |u: usize, v: usize| self.load(y + v, x + u, lane);
        let (a, b, c, d) = (corner(0, 0), corner(S, 0), corner(0, S), corner(S, S));
        // Multiples 0..=S of the slope along a row and of the bend; the longest cell has nine.
        let (mut across, mut bend) = ([[N::ZERO; LANES]; ROWS], [[N::ZERO; LANES]; ROWS]);
        let (mut down, mut base, mut worst) = ([N::ZERO; LANES], [N::ZERO; LANES], [N::ZERO; LANES]);
        for i in 0..LANES {
            base[i] = a[i].scaled(bits);
            down[i] = if falling { d[i].minus(b[i]) } else { c[i].minus(a[i]) };
            let k = if falling {
                b[i].plus(c[i]).minus(a[i]).minus(d[i])
            } else {
                a[i].plus(d[i]).minus(b[i]).minus(c[i])
            };
            for m in 0..S {
                across[m + 1][i] = across[m][i].plus(b[i].minus(a[i]));
                bend[m + 1][i] = bend[m][i].plus(k);
            }
        }
        for v in 0..=S {
            for u in 0..=S {
                let z = self.load(y + v, x + u, lane);
                let beyond = if falling { v.saturating_sub(u) } else { (u + v).saturating_sub(S) };
                let (across, bend) = (&across[u], &bend[beyond]);
                for i in 0..LANES {
                    let difference = z[i].scaled(bits).minus(base[i]).minus(across[i]).minus(bend[i]);
                    worst[i] = worst[i].larger(difference.magnitude());
                }
            }
            for i in 0..LANES {
                base[i] = base[i].plus(down[i]);
            }
        }
        worst
    }
}
