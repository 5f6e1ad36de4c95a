//! Minimum, maximum and occupancy of the full-resolution surface over square blocks, handed up the
//! pyramid.
//!
//! A block is closed: its border samples count. At a leaf a block is one interval; a parent's block
//! is the union of 2 x 2 blocks of its children, so that every tile has T x T blocks of one
//! interval of its own. Where a block is mixed, the extremes also take in the midpoints of edges
//! between a valid and a void sample: there the surface ends.

use crate::patch::TileGeometry;
use crate::sample::state;
use crate::sample::{Coding, Lattice, VALID, code_from_f32, refill};
use crate::simd::{self, Kernel};

/// Bit of [`Blocks::state`]: some sample of the block is valid.
pub const HAS_VALID: u8 = 1;
/// Bit of [`Blocks::state`]: some sample of the block is void.
pub const HAS_VOID: u8 = 2;
/// Both bits of [`Blocks::state`]: an outline runs through the block.
pub const MIXED: u8 = HAS_VALID | HAS_VOID;

/// The minimum, maximum and occupancy of `n x n` blocks, row by row. Extremes are codes of
/// [`extreme_coding`], rounded outward; a block without valid samples has `min > max`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Blocks {
    /// Blocks on a side.
    pub n: usize,
    /// Lowest code of each block.
    pub min: Vec<i32>,
    /// Highest code of each block.
    pub max: Vec<i32>,
    /// Occupancy bits of each block.
    pub state: Vec<u8>,
}

/// The coding of extremes: that of the samples, but float32, rounded outward, for float64.
pub fn extreme_coding(coding: Coding) -> Coding {
    if coding == Coding::Float64 { Coding::Float32 } else { coding }
}

impl Blocks {
    /// Makes all blocks void, `n` on a side.
    pub fn reset(&mut self, n: usize) {
        self.n = n;
        refill(&mut self.min, n * n, i32::MAX);
        refill(&mut self.max, n * n, i32::MIN);
        refill(&mut self.state, n * n, HAS_VOID);
    }

    /// The occupancy of the unit cells of a leaf tile, row by row, and its blocks of two intervals.
    #[cfg(test)]
    pub fn of_leaf(lattice: &Lattice, coding: Coding, geometry: &TileGeometry) -> (Vec<u8>, Self) {
        let mut blocks = Self::default();
        (blocks.set_leaf(lattice, coding, geometry), blocks)
    }

    /// Becomes the blocks of two intervals of a leaf tile, which its parent takes over. Returns the
    /// occupancy of the unit cells, row by row.
    ///
    /// The extremes of the unit cells themselves are not needed.
    pub fn set_leaf(&mut self, lattice: &Lattice, coding: Coding, geometry: &TileGeometry) -> Vec<u8> {
        let n = lattice.n;
        let unit = match coding {
            Coding::Float64 => {
                let (low, high) = (outward(lattice, 0), outward(lattice, 1));
                simd::run(LeafBlocks { low: &low, high: &high, lattice, out: self })
            }
            _ => simd::run(LeafBlocks { low: &lattice.code, high: &lattice.code, lattice, out: self }),
        };
        for (y, row) in unit.chunks_exact(n).enumerate() {
            state::each_place(row, MIXED, |x| {
                self.add_middles(y / 2 * self.n + x / 2, (x, y), lattice, coding, geometry);
            });
        }
        unit
    }

    /// Extends the extremes of block `at` by the midpoints of the edges between a valid and a void
    /// sample of a unit cell.
    fn add_middles(
        &mut self,
        at: usize,
        (x, y): (usize, usize),
        lattice: &Lattice,
        coding: Coding,
        geometry: &TileGeometry,
    ) {
        let corners =
            [lattice.at(x, y), lattice.at(x + 1, y), lattice.at(x, y + 1), lattice.at(x + 1, y + 1)];
        // A midpoint is between its ends, and valid samples are within the extremes. Usually the
        // fills are too.
        let within = |code: i32| coding != Coding::Float64 && self.min[at] <= code && code <= self.max[at];
        if corners.iter().all(|&i| lattice.state[i] == VALID || within(lattice.code[i])) {
            return;
        }
        let valid = corners.map(|i| lattice.state[i] == VALID);
        let diagonal = if geometry.falling(1, x, y) { (0, 3) } else { (1, 2) };
        for (a, b) in [(0, 1), (0, 2), (1, 3), (2, 3), diagonal] {
            if valid[a] != valid[b] {
                let (low, high) = middle(lattice, coding, corners[a], corners[b]);
                self.min[at] = self.min[at].min(low);
                self.max[at] = self.max[at].max(high);
            }
        }
    }

    /// Sets `out` to the same surface in blocks twice as large, which a parent takes over from this
    /// tile.
    pub fn halve(&self, out: &mut Self) {
        simd::run(Halved { of: self, out });
    }

    /// Copies the halved blocks of the child in quadrant `quadrant` to their place.
    pub fn place(&mut self, child: &Self, quadrant: u8) {
        let half = child.n;
        let (x0, y0) = (usize::from(quadrant & 1) * half, usize::from(quadrant >> 1) * half);
        for y in 0..half {
            let (from, to) = (y * half, (y0 + y) * self.n + x0);
            self.min[to..to + half].copy_from_slice(&child.min[from..from + half]);
            self.max[to..to + half].copy_from_slice(&child.max[from..from + half]);
            self.state[to..to + half].copy_from_slice(&child.state[from..from + half]);
        }
    }
}

/// For each patch of `patch` blocks on a side, row by row: true if it has a valid sample in or
/// below it. `state` is that of `n x n` blocks.
pub fn occupied(state: &[u8], n: usize, patch: usize) -> Vec<bool> {
    let side = n / patch;
    let mut out = Vec::with_capacity(side * side);
    // The rows of a patch are joined first: rows are long enough for vectors.
    let mut joined = vec![0; n];
    for rows in state.chunks_exact(n * patch) {
        joined.fill(0);
        for row in rows.chunks_exact(n) {
            joined.iter_mut().zip(row).for_each(|(joined, bits)| *joined |= bits);
        }
        let valid = |run: &[u8]| run.iter().fold(0, |bits, b| bits | b) & HAS_VALID != 0;
        out.extend(joined.chunks_exact(patch).map(valid));
    }
    out
}

/// Midpoint of two samples, rounded outward.
fn middle(lattice: &Lattice, coding: Coding, a: usize, b: usize) -> (i32, i32) {
    if let Coding::Integer { .. } = coding {
        let sum = i64::from(lattice.code[a]) + i64::from(lattice.code[b]);
        return (sum.div_euclid(2) as i32, (sum + 1).div_euclid(2) as i32);
    }
    let middle = 0.5 * lattice.value(a, coding) + 0.5 * lattice.value(b, coding);
    let near = middle as f32;
    let down = if f64::from(near) > middle { near.next_down() } else { near };
    let up = if f64::from(near) < middle { near.next_up() } else { near };
    (code_from_f32(down), code_from_f32(up))
}

/// The samples of a float64 lattice rounded to float32, down (`side` 0) or up (1).
fn outward(lattice: &Lattice, side: usize) -> Vec<i32> {
    let sample = |at: usize| {
        let (low, high) = middle(lattice, Coding::Float64, at, at);
        [low, high][side]
    };
    (0..lattice.code.len()).map(sample).collect()
}

/// Kernel: the extremes over the valid samples of blocks of two intervals, and the occupancy of the
/// unit cells.
struct LeafBlocks<'a> {
    low: &'a [i32],
    high: &'a [i32],
    lattice: &'a Lattice,
    out: &'a mut Blocks,
}

impl Kernel for LeafBlocks<'_> {
    type Output = Vec<u8>;

    #[inline(always)]
    fn run(self) -> Vec<u8> {
        let n = self.lattice.n;
        let mut unit = Vec::with_capacity(n * n);
        let Blocks { mut min, mut max, mut state, .. } = std::mem::take(self.out);
        for extremes in [&mut min, &mut max] {
            extremes.clear();
            extremes.reserve_exact(n / 2 * (n / 2));
        }
        // For each column: the extremes of three rows, and the bits of two.
        let (mut low, mut high, mut bits) = (vec![0; n + 1], vec![0; n + 1], vec![0; n + 1]);
        let mut joined = vec![0; n];
        for y in (0..n).step_by(2) {
            let rows = [0, 1, 2].map(|i| (y + i) * (n + 1)..(y + i + 1) * (n + 1));
            let states = rows.clone().map(|row| &self.lattice.state[row]);
            let mut all = 0;
            for (north, south) in [(states[0], states[1]), (states[1], states[2])] {
                for ((bits, &a), &b) in bits.iter_mut().zip(north).zip(south) {
                    *bits = bit(a) | bit(b);
                    all |= *bits;
                }
                unit.extend(bits.iter().zip(&bits[1..]).map(|(a, b)| a | b));
            }
            let full = all == HAS_VALID;
            column_extremes(
                &mut low,
                rows.clone().map(|row| &self.low[row]),
                states,
                full,
                i32::MAX,
                i32::min,
            );
            column_extremes(&mut high, rows.map(|row| &self.high[row]), states, full, i32::MIN, i32::max);
            add_threes(&mut min, &low, &mut joined, i32::min);
            add_threes(&mut max, &high, &mut joined, i32::max);
        }
        join_four(&unit, n, |a, b| a | b, &mut state);
        *self.out = Blocks { n: n / 2, min, max, state };
        unit
    }
}

/// Appends the extreme of columns `2 i`, `2 i + 1` and `2 i + 2` for each `i`; `joined` is scratch
/// memory.
#[inline(always)]
fn add_threes(
    out: &mut Vec<i32>,
    columns: &[i32],
    joined: &mut [i32],
    extreme: impl Fn(i32, i32) -> i32 + Copy,
) {
    for ((joined, &a), &b) in joined.iter_mut().zip(columns).zip(&columns[1..]) {
        *joined = extreme(a, b);
    }
    out.extend(joined.chunks_exact(2).map(|pair| extreme(pair[0], pair[1])));
}

/// Sets `out`, for every column, to the extreme of the valid samples of three rows; `none` if there
/// are none.
#[inline(always)]
fn column_extremes(
    out: &mut [i32],
    [a, b, c]: [&[i32]; 3],
    state: [&[u8]; 3],
    full: bool,
    none: i32,
    extreme: impl Fn(i32, i32) -> i32,
) {
    let rows = out.iter_mut().zip(a.iter().zip(b).zip(c));
    if full {
        for (out, ((&a, &b), &c)) in rows {
            *out = extreme(extreme(a, b), c);
        }
        return;
    }
    let valid = |code: i32, state: u8| if state == VALID { code } else { none };
    let states = state[0].iter().zip(state[1]).zip(state[2]);
    for ((out, ((&a, &b), &c)), ((&sa, &sb), &sc)) in rows.zip(states) {
        *out = extreme(extreme(valid(a, sa), valid(b, sb)), valid(c, sc));
    }
}

/// The occupancy bit of a sample.
#[inline(always)]
fn bit(state: u8) -> u8 {
    if state == VALID { HAS_VALID } else { HAS_VOID }
}

/// Kernel: [`Blocks::halve`].
struct Halved<'a> {
    of: &'a Blocks,
    out: &'a mut Blocks,
}

impl Kernel for Halved<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { of: Blocks { n, min, max, state }, out } = self;
        out.n = n / 2;
        join_four(min, *n, i32::min, &mut out.min);
        join_four(max, *n, i32::max, &mut out.max);
        join_four(state, *n, |a, b| a | b, &mut out.state);
    }
}

/// Sets `out` to the elements of a square of side `n`, joined two by two.
#[inline(always)]
fn join_four<T: Copy + Default>(square: &[T], n: usize, join: impl Fn(T, T) -> T + Copy, out: &mut Vec<T>) {
    out.clear();
    out.reserve_exact(n / 2 * (n / 2));
    let mut joined = vec![T::default(); n];
    for rows in square.chunks_exact(2 * n) {
        let (north, south) = rows.split_at(n);
        for ((joined, &a), &b) in joined.iter_mut().zip(north).zip(south) {
            *joined = join(a, b);
        }
        out.extend(joined.chunks_exact(2).map(|pair| join(pair[0], pair[1])));
    }
}

/// Occupancy of blocks twice as large, as [`Blocks::state`]; `n` is the number of blocks on a side
/// before.
pub fn reduce_state(state: &[u8], n: usize) -> Vec<u8> {
    simd::run(Reduced { state, n })
}

struct Reduced<'a> {
    state: &'a [u8],
    n: usize,
}

impl Kernel for Reduced<'_> {
    type Output = Vec<u8>;

    #[inline(always)]
    fn run(self) -> Vec<u8> {
        let mut out = Vec::new();
        join_four(self.state, self.n, |a, b| a | b, &mut out);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::Spacing;
    use crate::sample::FILLED;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn leaf_blocks_are_the_extremes_of_samples_and_middles(
            seed in proptest::collection::vec((-9..9_i32, 0..3_u8), 17 * 17),
            odd: bool,
        ) {
            let (n, spacing) = (16, Spacing { dx: 1.0, dy: 1.0 });
            let coding = Coding::Integer { scale: 1.0, offset: 0.0 };
            let mut lattice = Lattice::new(n, coding);
            for (i, &(code, kind)) in seed.iter().enumerate() {
                lattice.code[i] = code;
                lattice.state[i] = if kind == 0 && i > 100 { FILLED } else { VALID };
            }
            let geometry = TileGeometry { n, patch: 4, odd, spacing, scale: spacing.into(), metres: 1.0 };
            // Whatever they were before.
            let (mut blocks, mut expected) = (Blocks::default(), Blocks::default());
            blocks.reset(n);
            let unit = blocks.set_leaf(&lattice, coding, &geometry);
            expected.reset(n / 2);
            expected.state.fill(0);
            for (x, y) in (0..n * n).map(|i| (i % n, i / n)) {
                let block = y / 2 * (n / 2) + x / 2;
                let corners = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|(x, y)| lattice.at(x, y));
                let diagonal = if (x + y) % 2 == 0 { (0, 3) } else { (1, 2) };
                let mut bits = 0;
                for i in corners {
                    bits |= if lattice.state[i] == VALID { HAS_VALID } else { HAS_VOID };
                }
                for (a, b) in [(0, 0), (1, 1), (2, 2), (3, 3), (0, 1), (0, 2), (1, 3), (2, 3), diagonal] {
                    let (a, b) = (corners[a], corners[b]);
                    let valid = [a, b].map(|i| lattice.state[i] == VALID);
                    if valid[0] != valid[1] || a == b && valid[0] {
                        let twice = lattice.code[a] + lattice.code[b];
                        expected.min[block] = expected.min[block].min(twice >> 1);
                        expected.max[block] = expected.max[block].max((twice + 1) >> 1);
                    }
                }
                prop_assert_eq!(unit[y * n + x], bits);
                expected.state[block] |= bits;
            }
            prop_assert_eq!(blocks, expected);
        }
    }
}
