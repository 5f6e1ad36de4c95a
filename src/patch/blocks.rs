//! Minimum, maximum and occupancy of the full-resolution surface over square blocks, handed up the pyramid.
//!
//! A block is closed: its border samples count. At a leaf a block is one interval; a parent's block is the union of 2 x 2
//! blocks of its children, so that every tile has T x T blocks of one interval of its own. Where a block is mixed, the extremes
//! also take in the midpoints of edges between a valid and a void sample: there the surface ends.

use crate::patch::TileGeometry;
use crate::sample::{Coding, Lattice, VALID, code_from_f32};

/// Bit of [`Blocks::state`]: some sample of the block is valid.
pub const HAS_VALID: u8 = 1;
/// Bit of [`Blocks::state`]: some sample of the block is void.
pub const HAS_VOID: u8 = 2;

/// `n x n` blocks, row by row. Extremes are codes of [`extreme_coding`], rounded outward; a block without valid samples has
/// `min > max`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Blocks {
    /// Blocks on a side.
    pub n: usize,
    /// Lowest.
    pub min: Vec<i32>,
    /// Highest.
    pub max: Vec<i32>,
    /// Occupancy bits.
    pub state: Vec<u8>,
}

/// The coding that extremes are kept in: that of the samples, but float64 as float32 rounded outward.
pub fn extreme_coding(coding: Coding) -> Coding {
    if coding == Coding::Float64 { Coding::Float32 } else { coding }
}

impl Blocks {
    /// Blocks that are all void.
    pub fn void(n: usize) -> Self {
        let count = n * n;
        Self { n, min: vec![i32::MAX; count], max: vec![i32::MIN; count], state: vec![HAS_VOID; count] }
    }

    /// Blocks of a leaf tile: one for each unit cell.
    pub fn of_leaf(lattice: &Lattice, coding: Coding, geometry: &TileGeometry) -> Self {
        let n = lattice.n;
        let mut blocks = Self::void(n);
        for y in 0..n {
            if coding != Coding::Float64 && blocks.full_row(lattice, y) {
                continue;
            }
            for x in 0..n {
                let corners =
                    [lattice.at(x, y), lattice.at(x + 1, y), lattice.at(x, y + 1), lattice.at(x + 1, y + 1)];
                let valid = corners.map(|i| lattice.state[i] == VALID);
                let at = y * n + x;
                match valid.iter().filter(|&&v| v).count() {
                    0 => {}
                    4 if coding != Coding::Float64 => {
                        let codes = corners.map(|i| lattice.code[i]);
                        blocks.min[at] = codes[0].min(codes[1]).min(codes[2]).min(codes[3]);
                        blocks.max[at] = codes[0].max(codes[1]).max(codes[2]).max(codes[3]);
                        blocks.state[at] = HAS_VALID;
                    }
                    count => {
                        let falling = geometry.falling(1, x, y);
                        blocks.mixed(at, lattice, coding, corners, valid, falling);
                        blocks.state[at] = if count == 4 { HAS_VALID } else { HAS_VALID | HAS_VOID };
                    }
                }
            }
        }
        blocks
    }

    /// Blocks of row `y` if all their samples are valid; false, and nothing done, if not.
    fn full_row(&mut self, lattice: &Lattice, y: usize) -> bool {
        let n = self.n;
        let (north, south) = (y * (n + 1), (y + 1) * (n + 1));
        if !lattice.state[north..=south + n].iter().all(|&state| state == VALID) {
            return false;
        }
        let (north, south) = (&lattice.code[north..south], &lattice.code[south..=south + n]);
        let out = y * n..(y + 1) * n;
        let pairs = north.windows(2).zip(south.windows(2));
        for ((min, max), (a, b)) in
            self.min[out.clone()].iter_mut().zip(&mut self.max[out.clone()]).zip(pairs)
        {
            *min = a[0].min(a[1]).min(b[0]).min(b[1]);
            *max = a[0].max(a[1]).max(b[0]).max(b[1]);
        }
        self.state[out].fill(HAS_VALID);
        true
    }

    /// Extremes over the valid corners and the midpoints of the mixed edges of one cell.
    fn mixed(
        &mut self,
        at: usize,
        lattice: &Lattice,
        coding: Coding,
        corners: [usize; 4],
        valid: [bool; 4],
        falling: bool,
    ) {
        for (&corner, _) in corners.iter().zip(valid).filter(|(_, valid)| *valid) {
            self.include(at, lattice, coding, corner, corner);
        }
        let diagonal = if falling { (0, 3) } else { (1, 2) };
        for (a, b) in [(0, 1), (0, 2), (1, 3), (2, 3), diagonal] {
            if valid[a] != valid[b] {
                self.include(at, lattice, coding, corners[a], corners[b]);
            }
        }
    }

    /// Takes the midpoint of two samples into a block, rounded outward.
    fn include(&mut self, at: usize, lattice: &Lattice, coding: Coding, a: usize, b: usize) {
        let (low, high) = if let Coding::Integer { .. } = coding {
            let sum = i64::from(lattice.code[a]) + i64::from(lattice.code[b]);
            (sum.div_euclid(2) as i32, (sum + 1).div_euclid(2) as i32)
        } else {
            let middle = 0.5 * lattice.value(a, coding) + 0.5 * lattice.value(b, coding);
            let near = middle as f32;
            let down = if f64::from(near) > middle { near.next_down() } else { near };
            let up = if f64::from(near) < middle { near.next_up() } else { near };
            (code_from_f32(down), code_from_f32(up))
        };
        self.min[at] = self.min[at].min(low);
        self.max[at] = self.max[at].max(high);
    }

    /// The same surface in blocks twice as large: what a parent takes over from this tile.
    #[must_use]
    pub fn halved(&self) -> Self {
        let half = self.n / 2;
        let mut out = Self::void(half);
        for y in 0..half {
            let (north, south) = (2 * y * self.n, (2 * y + 1) * self.n);
            for x in 0..half {
                let four = [north + 2 * x, north + 2 * x + 1, south + 2 * x, south + 2 * x + 1];
                let to = y * half + x;
                out.min[to] = four.iter().fold(i32::MAX, |low, &i| low.min(self.min[i]));
                out.max[to] = four.iter().fold(i32::MIN, |high, &i| high.max(self.max[i]));
                out.state[to] = four.iter().fold(0, |bits, &i| bits | self.state[i]);
            }
        }
        out
    }

    /// Puts the halved blocks of the child in quadrant `quadrant` in their place.
    pub fn place(&mut self, quarter: &Self, quadrant: u8) {
        let half = quarter.n;
        let (x0, y0) = (usize::from(quadrant & 1) * half, usize::from(quadrant >> 1) * half);
        for y in 0..half {
            let (from, to) = (y * half, (y0 + y) * self.n + x0);
            self.min[to..to + half].copy_from_slice(&quarter.min[from..from + half]);
            self.max[to..to + half].copy_from_slice(&quarter.max[from..from + half]);
            self.state[to..to + half].copy_from_slice(&quarter.state[from..from + half]);
        }
    }

    /// Which patches of `patch` blocks on a side have a valid sample in or below them, row by row.
    pub fn occupied(&self, patch: usize) -> Vec<bool> {
        let side = self.n / patch;
        let mut out = vec![false; side * side];
        for (y, row) in self.state.chunks_exact(self.n).enumerate() {
            for (x, run) in row.chunks_exact(patch).enumerate() {
                out[y / patch * side + x] |= run.iter().fold(0, |bits, b| bits | b) & HAS_VALID != 0;
            }
        }
        out
    }
}

/// Occupancy of blocks twice as large, as [`Blocks::state`]; `n` is the number of blocks on a side before.
pub fn reduce_state(state: &[u8], n: usize) -> Vec<u8> {
    let half = n / 2;
    let mut out = Vec::with_capacity(half * half);
    for y in 0..half {
        for x in 0..half {
            let at = 2 * y * n + 2 * x;
            out.push(state[at] | state[at + 1] | state[at + n] | state[at + n + 1]);
        }
    }
    out
}
