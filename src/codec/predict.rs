//! Prediction of newborn samples from their parents and from the centres (`format-spec.md`, section 9.2).
//!
//! Samples stand in planes with one sample of padding around them, so that every row is predicted by the same
//! branch-free loop. The arithmetic is generic: 64 bits always suffice, 32 bits do for a *narrow* tile.

use crate::codec::probe::Probe;

/// Integers that predictions are computed in. All operations wrap.
pub trait Word: Copy + Default {
    /// A code, relative to `base`.
    fn from_code(code: i32, base: i32) -> Self;
    /// The code of a number relative to `base`, modulo 2^32.
    fn code(self, base: i32) -> i32;
    /// `self + other`.
    fn plus(self, other: Self) -> Self;
    /// `self - other`.
    fn minus(self, other: Self) -> Self;
    /// `self * 2^bits`.
    fn up(self, bits: u32) -> Self;
    /// `self * factor`.
    fn times(self, factor: i32) -> Self;
    /// `|self|`.
    fn magnitude(self) -> u64;
    /// `floor((self + 2^(bits - 1)) / 2^bits)`.
    fn rounded_down(self, bits: u32) -> Self;
}

impl Word for i32 {
    #[inline]
    fn from_code(code: i32, base: i32) -> Self {
        code.wrapping_sub(base)
    }
    #[inline]
    fn code(self, base: i32) -> i32 {
        self.wrapping_add(base)
    }
    #[inline]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }
    #[inline]
    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }
    #[inline]
    fn up(self, bits: u32) -> Self {
        self << bits
    }
    #[inline]
    fn times(self, factor: i32) -> Self {
        self.wrapping_mul(factor)
    }
    #[inline]
    fn magnitude(self) -> u64 {
        u64::from(self.unsigned_abs())
    }
    #[inline]
    fn rounded_down(self, bits: u32) -> Self {
        self.wrapping_add(1 << (bits - 1)) >> bits
    }
}

impl Word for i64 {
    #[inline]
    fn from_code(code: i32, base: i32) -> Self {
        Self::from(code) - Self::from(base)
    }
    #[inline]
    fn code(self, base: i32) -> i32 {
        (self as i32).wrapping_add(base)
    }
    #[inline]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }
    #[inline]
    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }
    #[inline]
    fn up(self, bits: u32) -> Self {
        self << bits
    }
    #[inline]
    fn times(self, factor: i32) -> Self {
        self.wrapping_mul(Self::from(factor))
    }
    #[inline]
    fn magnitude(self) -> u64 {
        self.unsigned_abs()
    }
    #[inline]
    fn rounded_down(self, bits: u32) -> Self {
        self.wrapping_add(1 << (bits - 1)) >> bits
    }
}

/// A plane of samples with one sample of padding on every side.
#[derive(Default)]
pub struct Plane<W> {
    width: usize,
    height: usize,
    data: Vec<W>,
}

impl<W: Word> Plane<W> {
    /// Makes room for `width x height` samples; what they are is not defined.
    fn resize(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        self.data.resize((width + 2) * (height + 2), W::default());
    }

    /// Row `row - 1` with its padding: sample `a` stands at `a + 1`.
    #[inline]
    fn padded(&self, row: usize) -> &[W] {
        &self.data[row * (self.width + 2)..][..self.width + 2]
    }

    /// Row `row`, without padding.
    #[inline]
    fn row_mut(&mut self, row: usize) -> &mut [W] {
        &mut self.data[(row + 1) * (self.width + 2) + 1..][..self.width]
    }

    /// Sets row `row` to `codes` relative to `base`.
    pub fn set_row(&mut self, row: usize, codes: &[i32], base: i32) {
        for (sample, &code) in self.row_mut(row).iter_mut().zip(codes) {
            *sample = W::from_code(code, base);
        }
    }

    /// Continues rows and columns by one sample in a straight line; a single sample by itself.
    fn pad(&mut self) {
        let (width, height, stride) = (self.width, self.height, self.width + 2);
        for row in self.data.chunks_exact_mut(stride).skip(1).take(height) {
            row[0] = beyond(row[1], row[2.min(width)]);
            row[width + 1] = beyond(row[width], row[(width - 1).max(1)]);
        }
        for column in 1..=width {
            let at = |row: usize| row * stride + column;
            let (first, second) = (self.data[at(1)], self.data[at(2.min(height))]);
            let (last, before) = (self.data[at(height)], self.data[at((height - 1).max(1))]);
            self.data[at(0)] = beyond(first, second);
            self.data[at(height + 1)] = beyond(last, before);
        }
    }
}

/// The next sample of a line after `last`, whose neighbour is `before`.
#[inline]
fn beyond<W: Word>(last: W, before: W) -> W {
    last.up(1).minus(before)
}

/// How far predictions reach beyond the mean of the four nearest samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Weights {
    /// 0: the mean of the four nearest; up to 7: the eight around them count against it more and more.
    pub sharpness: i32,
    /// Above 0 samples to the east and west count more (up to 7), below 0 those to the north and south (down to -7).
    pub skew: i32,
}

impl Weights {
    /// What suits most terrain.
    pub const USUAL: Self = Self { sharpness: 5, skew: 0 };
    /// Range of both.
    pub const MAX: i32 = 7;

    /// From a chunk's byte; `None` if there are no such weights.
    pub fn from_byte(byte: u8) -> Option<Self> {
        let weights = Self { sharpness: i32::from(byte & 15), skew: i32::from(byte >> 4) - 8 };
        (weights.sharpness <= Self::MAX && weights.skew >= -Self::MAX).then_some(weights)
    }

    /// The byte of a chunk.
    pub fn byte(self) -> u8 {
        (self.sharpness | (self.skew + 8) << 4) as u8
    }
}

/// The planes that one stage predicts from.
#[derive(Default)]
pub struct Planes<W> {
    /// `P`, `(m + 1)^2`.
    parents: Plane<W>,
    /// `C`, `m^2`, padded.
    centres: Plane<W>,
    /// Subtracted from all codes before they become words.
    pub(super) base: i32,
    /// Room for a probe.
    pub(super) probe: Probe<W>,
}

/// Sums of neighbours, of which predictions are made.
pub struct Sums<W> {
    /// The four nearest.
    pub near: W,
    /// Twice those less the eight around them.
    pub bend: W,
    /// Four times east and west less north and south, likewise less the eight around them.
    pub tilt: W,
}

impl<W: Word> Sums<W> {
    /// From the two nearest and the four farther samples to the east and west, and to the north and south.
    #[inline]
    fn new(near: [W; 2], far: [W; 2]) -> Self {
        let (sum, rest) = (near[0].plus(near[1]), far[0].plus(far[1]));
        let tilt = near[0].minus(near[1]).up(2).minus(far[0].minus(far[1]));
        Self { near: sum, bend: sum.up(1).minus(rest), tilt }
    }

    /// The prediction.
    #[inline]
    fn weighted(&self, weights: Weights) -> W {
        let straight = self.near.up(5).plus(self.bend.times(weights.sharpness));
        straight.plus(self.tilt.times(weights.skew)).rounded_down(7)
    }
}

impl<W: Word> Planes<W> {
    /// Starts a stage of `(m + 1)^2` parents, given row by row with their void samples replaced.
    pub fn start(&mut self, m: usize, parents: &[i32], base: i32) {
        self.base = base;
        self.parents.resize(m + 1, m + 1);
        self.centres.resize(m, m);
        for (row, codes) in parents.chunks_exact(m + 1).enumerate() {
            self.parents.set_row(row, codes, base);
        }
        self.parents.pad();
    }

    /// Takes the codes of row `row` of the centres.
    pub fn set_centres(&mut self, row: usize, codes: &[i32]) {
        self.centres.set_row(row, codes, self.base);
    }

    /// To be called when all centres are set, before H and V are predicted.
    pub fn finish_centres(&mut self) {
        self.centres.pad();
    }

    /// Predicts row `b` of the centres.
    pub fn predict_centres(&self, b: usize, sharpness: i32, out: &mut [i32]) {
        let weights = Weights { sharpness, skew: 0 };
        let base = self.base;
        self.centres(b, out.len(), |a, sums| out[a] = sums.weighted(weights).code(base));
    }

    /// Predicts row `b` of H.
    pub fn predict_horizontals(&self, b: usize, weights: Weights, out: &mut [i32]) {
        let (m, base) = (out.len(), self.base);
        if b == 0 || b == m {
            let (ww, w, e, ee) = quartet(self.parents.padded(b + 1), m);
            for a in 0..m {
                out[a] = four_taps(w[a].plus(e[a]), ww[a].plus(ee[a])).code(base);
            }
        } else {
            self.horizontals(b, m, |a, sums| out[a] = sums.weighted(weights).code(base));
        }
    }

    /// Predicts row `b` of V, of `m + 1` samples.
    pub fn predict_verticals(&self, b: usize, weights: Weights, out: &mut [i32]) {
        let (m, base) = (out.len() - 1, self.base);
        let (above, upper) = (self.parents.padded(b), self.parents.padded(b + 1));
        let (lower, below) = (self.parents.padded(b + 2), self.parents.padded(b + 3));
        for a in [0, m] {
            let (near, far) = (upper[a + 1].plus(lower[a + 1]), above[a + 1].plus(below[a + 1]));
            out[a] = four_taps(near, far).code(base);
        }
        let inner = &mut out[1..m];
        self.verticals(b, inner.len(), |a, sums| inner[a] = sums.weighted(weights).code(base));
    }

    /// The neighbours of row `b` of the centres.
    #[inline]
    pub(super) fn centres(&self, b: usize, m: usize, mut take: impl FnMut(usize, Sums<W>)) {
        let (above, upper) = (self.parents.padded(b), self.parents.padded(b + 1));
        let (lower, below) = (self.parents.padded(b + 2), self.parents.padded(b + 3));
        let (above_w, above_e) = (&above[1..=m], &above[2..m + 2]);
        let (below_w, below_e) = (&below[1..=m], &below[2..m + 2]);
        let (upper_ww, upper_w, upper_e, upper_ee) = quartet(upper, m);
        let (lower_ww, lower_w, lower_e, lower_ee) = quartet(lower, m);
        for a in 0..m {
            let near = [upper_w[a].plus(upper_e[a]), lower_w[a].plus(lower_e[a])];
            let sides = upper_ww[a].plus(upper_ee[a]).plus(lower_ww[a]).plus(lower_ee[a]);
            let ends = above_w[a].plus(above_e[a]).plus(below_w[a]).plus(below_e[a]);
            take(a, Sums::new(near, [sides, ends]));
        }
    }

    /// The neighbours of an inner row of H.
    #[inline]
    pub(super) fn horizontals(&self, b: usize, m: usize, mut take: impl FnMut(usize, Sums<W>)) {
        let row = self.parents.padded(b + 1);
        let (w, e) = (&row[1..=m], &row[2..m + 2]);
        let (above, below) = (self.parents.padded(b), self.parents.padded(b + 2));
        let (above_w, above_e) = (&above[1..=m], &above[2..m + 2]);
        let (below_w, below_e) = (&below[1..=m], &below[2..m + 2]);
        let (north_w, north, north_e) = triplet(self.centres.padded(b), m);
        let (south_w, south, south_e) = triplet(self.centres.padded(b + 1), m);
        for a in 0..m {
            let near = [w[a].plus(e[a]), north[a].plus(south[a])];
            let sides = north_w[a].plus(south_w[a]).plus(north_e[a]).plus(south_e[a]);
            let ends = above_w[a].plus(above_e[a]).plus(below_w[a]).plus(below_e[a]);
            take(a, Sums::new(near, [sides, ends]));
        }
    }

    /// The neighbours of the inner columns of row `b` of V, numbered from 0.
    #[inline]
    pub(super) fn verticals(&self, b: usize, count: usize, mut take: impl FnMut(usize, Sums<W>)) {
        let (upper_w, upper, upper_e) = triplet(&self.parents.padded(b + 1)[1..], count);
        let (lower_w, lower, lower_e) = triplet(&self.parents.padded(b + 2)[1..], count);
        let (north, south) = (self.centres.padded(b), self.centres.padded(b + 2));
        let middle = self.centres.padded(b + 1);
        let (north_w, north_e) = (&north[1..=count], &north[2..count + 2]);
        let (west, east) = (&middle[1..=count], &middle[2..count + 2]);
        let (south_w, south_e) = (&south[1..=count], &south[2..count + 2]);
        for a in 0..count {
            let near = [west[a].plus(east[a]), upper[a].plus(lower[a])];
            let sides = upper_w[a].plus(upper_e[a]).plus(lower_w[a]).plus(lower_e[a]);
            let ends = north_w[a].plus(north_e[a]).plus(south_w[a]).plus(south_e[a]);
            take(a, Sums::new(near, [sides, ends]));
        }
    }
}

/// `(9 near - far + 8) >> 4`: the cubic through four samples of a line.
#[inline]
fn four_taps<W: Word>(near: W, far: W) -> W {
    near.up(3).plus(near).minus(far).rounded_down(4)
}

/// `row` from its first, second and third sample on, `count` each.
#[inline]
fn triplet<W>(row: &[W], count: usize) -> (&[W], &[W], &[W]) {
    (&row[..count], &row[1..=count], &row[2..count + 2])
}

/// `row` from its first, second, third and fourth sample on, `count` each.
#[inline]
fn quartet<W>(row: &[W], count: usize) -> (&[W], &[W], &[W], &[W]) {
    (&row[..count], &row[1..=count], &row[2..count + 2], &row[3..count + 3])
}
