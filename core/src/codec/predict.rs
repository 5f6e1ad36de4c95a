//! Prediction of newborn samples from their parents and from the centres (`format-spec.md`, section
//! 9.2).
//!
//! Samples stand in planes with one sample of padding around them, so that every row is predicted
//! by the same branch-free loop. The arithmetic is generic: 64 bits always suffice, 32 bits do for
//! a *narrow* tile.

use crate::codec::neighbours::{Neighbours, Predict};
use crate::codec::word::{Weights, Word};
use crate::simd::{self, Kernel};

/// A plane of samples with one sample of padding on every side.
#[derive(Default)]
pub struct Plane<W> {
    width: usize,
    height: usize,
    data: Vec<W>,
}

impl<W: Word> Plane<W> {
    /// Sets the size to `width x height` samples, whose values are not defined.
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
        simd::run(SetRow { row: self.row_mut(row), codes, base });
    }

    /// Sets the padding: rows and columns continue by one sample in a straight line, a single
    /// sample unchanged.
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

/// Kernel: sets samples to codes relative to `base`.
struct SetRow<'a, W> {
    row: &'a mut [W],
    codes: &'a [i32],
    base: i32,
}

impl<W: Word> Kernel for SetRow<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let (row, codes) = (self.row, self.codes);
        let codes = &codes[..row.len()];
        for a in 0..row.len() {
            row[a] = W::from_code(codes[a], self.base);
        }
    }
}

/// The next sample of a line after `last`, whose neighbour is `before`.
#[inline]
fn beyond<W: Word>(last: W, before: W) -> W {
    last.up(1).minus(before)
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
}

impl<W: Word> Planes<W> {
    /// Starts a stage of `(m + 1)^2` parents, given row by row with their void samples replaced,
    /// from row `first` on. The rows that are not given are not defined.
    pub fn start(&mut self, m: usize, (first, parents): (usize, &[i32]), base: i32) {
        self.base = base;
        self.parents.resize(m + 1, m + 1);
        self.centres.resize(m, m);
        for (row, codes) in parents.chunks_exact(m + 1).enumerate() {
            self.parents.set_row(first + row, codes, base);
        }
        self.parents.pad();
    }

    /// Sets row `row` of the centres to `codes`.
    pub fn set_centres(&mut self, row: usize, codes: &[i32]) {
        self.centres.set_row(row, codes, self.base);
    }

    /// Ends the centres; call it when all of them are set, before H and V are predicted.
    pub fn finish_centres(&mut self) {
        self.centres.pad();
    }

    /// Predicts row `b` of the centres.
    pub fn predict_centres(&self, b: usize, sharpness: i32, out: &mut [i32]) {
        let (from, weights) = (self.centres(b, out.len()), Weights { sharpness, skew: 0 });
        simd::run(Predict { from, weights, base: self.base, out });
    }

    /// Predicts row `b` of H.
    pub fn predict_horizontals(&self, b: usize, weights: Weights, out: &mut [i32]) {
        let (m, base) = (out.len(), self.base);
        if b == 0 || b == m {
            let [ww, w, e, ee] = quartet(self.parents.padded(b + 1), m);
            for a in 0..m {
                out[a] = four_taps(w[a].plus(e[a]), ww[a].plus(ee[a])).code(base);
            }
        } else {
            simd::run(Predict { from: self.horizontals(b, m), weights, base, out });
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
        simd::run(Predict { from: self.verticals(b, m - 1), weights, base, out: &mut out[1..m] });
    }

    /// The neighbours of row `b` of the centres.
    pub(super) fn centres(&self, b: usize, m: usize) -> Neighbours<'_, W> {
        let [_, above_w, above_e] = triplet(self.parents.padded(b), m);
        let [upper_ww, upper_w, upper_e, upper_ee] = quartet(self.parents.padded(b + 1), m);
        let [lower_ww, lower_w, lower_e, lower_ee] = quartet(self.parents.padded(b + 2), m);
        let [_, below_w, below_e] = triplet(self.parents.padded(b + 3), m);
        Neighbours {
            near: [upper_w, upper_e, lower_w, lower_e],
            sides: [upper_ww, upper_ee, lower_ww, lower_ee],
            ends: [above_w, above_e, below_w, below_e],
        }
    }

    /// The neighbours of an inner row of H.
    pub(super) fn horizontals(&self, b: usize, m: usize) -> Neighbours<'_, W> {
        let [_, above_w, above_e] = triplet(self.parents.padded(b), m);
        let [_, west, east] = triplet(self.parents.padded(b + 1), m);
        let [_, below_w, below_e] = triplet(self.parents.padded(b + 2), m);
        let [north_w, north, north_e] = triplet(self.centres.padded(b), m);
        let [south_w, south, south_e] = triplet(self.centres.padded(b + 1), m);
        Neighbours {
            near: [west, east, north, south],
            sides: [north_w, south_w, north_e, south_e],
            ends: [above_w, above_e, below_w, below_e],
        }
    }

    /// The neighbours of the inner columns of row `b` of V, numbered from 0.
    pub(super) fn verticals(&self, b: usize, count: usize) -> Neighbours<'_, W> {
        let [upper_w, upper, upper_e] = triplet(&self.parents.padded(b + 1)[1..], count);
        let [lower_w, lower, lower_e] = triplet(&self.parents.padded(b + 2)[1..], count);
        let [_, north_w, north_e] = triplet(self.centres.padded(b), count);
        let [_, west, east] = triplet(self.centres.padded(b + 1), count);
        let [_, south_w, south_e] = triplet(self.centres.padded(b + 2), count);
        Neighbours {
            near: [west, east, upper, lower],
            sides: [upper_w, upper_e, lower_w, lower_e],
            ends: [north_w, north_e, south_w, south_e],
        }
    }
}

/// `(9 near - far + 8) >> 4`: the cubic through four samples of a line.
#[inline]
fn four_taps<W: Word>(near: W, far: W) -> W {
    near.up(3).plus(near).minus(far).rounded_down(4)
}

/// `row` from its first, second and third sample on, `count` each.
fn triplet<W>(row: &[W], count: usize) -> [&[W]; 3] {
    [&row[..count], &row[1..=count], &row[2..count + 2]]
}

/// `row` from its first, second, third and fourth sample on, `count` each.
fn quartet<W>(row: &[W], count: usize) -> [&[W]; 4] {
    [&row[..count], &row[1..=count], &row[2..count + 2], &row[3..count + 3]]
}
