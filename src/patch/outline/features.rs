//! What the search of a tile starts from, for all its cells at once: where its outline is, and how far away at most.

use super::search::{HAS_VALID, HAS_VOID, MIXED};
use crate::patch::distance::Nearest;
use crate::sample::VALID;
use crate::simd::Kernel;

/// Sets `valid` to 1 where a sample is valid, 0 elsewhere.
pub(super) struct Validity<'a> {
    pub(super) state: &'a [u8],
    pub(super) valid: &'a mut Vec<u8>,
}

impl Kernel for Validity<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let state = self.state;
        self.valid.resize(state.len(), 0);
        let valid = &mut self.valid[..state.len()];
        for i in 0..state.len() {
            valid[i] = u8::from(state[i] == VALID);
        }
    }
}

/// Two rows of samples, as the corners of the cells between them: north-west, north-east, south-west, south-east.
#[inline(always)]
fn corners(valid: &[u8], n: usize, row: usize) -> [&[u8]; 4] {
    let rows = &valid[row * (n + 1)..(row + 2) * (n + 1)];
    [&rows[..n], &rows[1..][..n], &rows[n + 1..][..n], &rows[n + 2..][..n]]
}

/// The marks of a half row, two by two, and the last.
#[inline(always)]
fn pairs(marks: &mut [u8], n: usize) -> (&mut [[u8; 2]], &mut u8) {
    let (pairs, last) = marks.split_at_mut(2 * n);
    (&mut pairs.as_chunks_mut::<2>().0[..n], &mut last[0])
}

/// Sets for each cell what its closed square holds.
pub(super) struct CellBits<'a> {
    pub(super) valid: &'a [u8],
    pub(super) n: usize,
    pub(super) bits: &'a mut [u8],
}

impl Kernel for CellBits<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let n = self.n;
        for y in 0..n {
            let bits = &mut self.bits[y * n..(y + 1) * n];
            let [nw, ne, sw, se] = corners(self.valid, n, y);
            for x in 0..n {
                let (any, all) = (nw[x] | ne[x] | sw[x] | se[x], nw[x] & ne[x] & sw[x] & se[x]);
                bits[x] = (any * HAS_VALID) | ((all ^ 1) * HAS_VOID);
            }
        }
    }
}

/// Marks the vertices of the outline: midpoints of the sides and diagonals that join a valid and a void sample.
pub(super) struct OutlineMarks<'a> {
    pub(super) valid: &'a [u8],
    pub(super) n: usize,
    pub(super) nearest: &'a mut Nearest,
}

impl Kernel for OutlineMarks<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { valid, n, nearest } = self;
        for y in 0..=n {
            let row = &valid[y * (n + 1)..(y + 1) * (n + 1)];
            let (pairs, last) = pairs(nearest.row_mut(2 * y), n);
            let (west, east) = (&row[..n], &row[1..][..n]);
            for x in 0..n {
                pairs[x] = [0, west[x] ^ east[x]];
            }
            *last = 0;
        }
        for y in 0..n {
            let [nw, ne, sw, se] = corners(valid, n, y);
            let (pairs, last) = pairs(nearest.row_mut(2 * y + 1), n);
            for x in 0..n {
                let (falling, rising) = (nw[x] ^ se[x], ne[x] ^ sw[x]);
                let odd = (x ^ y) as u8 & 1;
                pairs[x] = [nw[x] ^ sw[x], falling & (odd ^ 1) | rising & odd];
            }
            *last = ne[n - 1] ^ se[n - 1];
        }
    }
}

/// Marks the samples of one kind, and the centres of the blocks that hold some of that kind inside only.
pub(super) struct PlaceMarks<'a> {
    pub(super) valid: &'a [u8],
    pub(super) block: &'a [u8],
    pub(super) n: usize,
    /// 1 for valid, 0 for void.
    pub(super) kind: u8,
    pub(super) nearest: &'a mut Nearest,
}

impl Kernel for PlaceMarks<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { valid, block, n, kind, nearest } = self;
        let other = kind ^ 1;
        for y in 0..=n {
            let row = &valid[y * (n + 1)..][..=n];
            let (pairs, last) = pairs(nearest.row_mut(2 * y), n);
            for x in 0..n {
                pairs[x] = [row[x] ^ other, 0];
            }
            *last = row[n] ^ other;
        }
        for y in 0..n {
            let blocks = &block[y * n..(y + 1) * n];
            let [nw, ne, sw, se] = corners(valid, n, y);
            let (pairs, last) = pairs(nearest.row_mut(2 * y + 1), n);
            for x in 0..n {
                let any_corner = (nw[x] ^ other) | (ne[x] ^ other) | (sw[x] ^ other) | (se[x] ^ other);
                pairs[x] = [0, u8::from(blocks[x] & MIXED == MIXED) & (any_corner ^ 1)];
            }
            *last = 0;
        }
    }
}

/// Squared distance within which every point of a cell has the nearest feature of the cell's centre.
pub(super) struct Reach<'a> {
    pub(super) nearest: &'a Nearest,
    pub(super) n: usize,
    pub(super) half: (f64, f64),
    pub(super) to: &'a mut [f64],
}

impl Kernel for Reach<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { nearest, n, half, to } = self;
        for y in 0..n {
            let reach = &mut to[y * n..][..n];
            let Some((xs, ys)) = nearest.row(y) else { return reach.fill(0.0) };
            let (xs, ys) = (&xs[..n], &ys[..n]);
            for x in 0..n {
                reach[x] = squared([xs[x], ys[x]], [x, y], half, 1);
            }
        }
    }
}

/// The same for blocks, whose features are of two kinds: the larger of both, of those that a block needs. A feature at
/// the centre of a block stands for a point somewhere in that block.
pub(super) struct BlockReach<'a> {
    /// For what is valid in a block, the nearest that has something void.
    pub(super) void: &'a Nearest,
    /// The other way round.
    pub(super) valid: &'a Nearest,
    pub(super) block: &'a [u8],
    pub(super) n: usize,
    pub(super) half: (f64, f64),
    pub(super) to: &'a mut [f64],
}

impl Kernel for BlockReach<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { void, valid, block, n, half, to } = self;
        for y in 0..n {
            let (reach, block) = (&mut to[y * n..][..n], &block[y * n..][..n]);
            let (Some(void), Some(valid)) = (void.row(y), valid.row(y)) else { return reach.fill(0.0) };
            let ((void_x, void_y), (valid_x, valid_y)) = (void, valid);
            let (void_x, void_y) = (&void_x[..n], &void_y[..n]);
            let (valid_x, valid_y) = (&valid_x[..n], &valid_y[..n]);
            for x in 0..n {
                let extent = |feature: [i16; 2]| 1 + i32::from(feature[0] & feature[1] & 1);
                let (void, valid) = ([void_x[x], void_y[x]], [valid_x[x], valid_y[x]]);
                let from_valid = squared(void, [x, y], half, extent(void));
                let from_void = squared(valid, [x, y], half, extent(valid));
                let from_valid = if block[x] & HAS_VALID == 0 { 0.0 } else { from_valid };
                let from_void = if block[x] & HAS_VOID == 0 { 0.0 } else { from_void };
                reach[x] = if from_valid > from_void { from_valid } else { from_void };
            }
        }
    }
}

/// Squared distance of the farthest corner of a cell from a feature that is on the other side of its centre; `extent` is
/// half the cell's size and half the feature's, in half intervals.
#[inline(always)]
fn squared([fx, fy]: [i16; 2], [x, y]: [usize; 2], half: (f64, f64), extent: i32) -> f64 {
    let away =
        |feature: i16, cell: usize| f64::from((i32::from(feature) - (2 * cell as i32 + 1)).abs() + extent);
    let (across, down) = (away(fx, x) * half.0, away(fy, y) * half.1);
    across * across + down * down
}
