//! The twelve samples around each sample of a row, and the sums of them that predictions are made
//! of: the loops in which the codec spends most of its time.

#![expect(
    clippy::needless_range_loop,
    reason = "kernels count: an iterator's `next` may not be inlined there"
)]

use crate::codec::word::{Weights, Word};
use crate::simd::Kernel;

/// Neighbours of the samples of a row: slices of one length, where number `a` belongs to sample
/// `a`.
#[derive(Clone, Copy)]
pub struct Neighbours<'a, W> {
    /// The four nearest: two on the axis that a positive skew favours, and two on the other axis.
    pub near: [&'a [W]; 4],
    /// Four of the eight around the nearest: those towards the first axis.
    pub sides: [&'a [W]; 4],
    /// The other four of the eight.
    pub ends: [&'a [W]; 4],
}

/// Sums of neighbours, of which predictions are made.
struct Sums<W> {
    /// The four nearest.
    near: W,
    /// Twice the four nearest less the eight around them.
    bend: W,
    /// Four times the nearest of the first axis less those of the other, less `sides` less `ends`.
    tilt: W,
}

impl<'a, W: Word> Neighbours<'a, W> {
    /// The first `count` of each slice, so that the compiler knows their length.
    #[inline(always)]
    fn cut(self, count: usize) -> Self {
        let cut = |[a, b, c, d]: [&'a [W]; 4]| [&a[..count], &b[..count], &c[..count], &d[..count]];
        Self { near: cut(self.near), sides: cut(self.sides), ends: cut(self.ends) }
    }

    /// The sums of sample `a`.
    #[inline(always)]
    fn sums(&self, a: usize) -> Sums<W> {
        let ([e, w, n, s], [p, q, r, t], [h, i, j, k]) = (self.near, self.sides, self.ends);
        let near = [e[a].plus(w[a]), n[a].plus(s[a])];
        let far = [p[a].plus(q[a]).plus(r[a]).plus(t[a]), h[a].plus(i[a]).plus(j[a]).plus(k[a])];
        let (sum, rest) = (near[0].plus(near[1]), far[0].plus(far[1]));
        let tilt = near[0].minus(near[1]).up(2).minus(far[0].minus(far[1]));
        Sums { near: sum, bend: sum.up(1).minus(rest), tilt }
    }
}

/// Kernel: the predictions of a row.
pub struct Predict<'a, W> {
    pub from: Neighbours<'a, W>,
    pub weights: Weights,
    pub base: i32,
    pub out: &'a mut [i32],
}

impl<W: Word> Kernel for Predict<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { from, weights, base, out } = self;
        let from = from.cut(out.len());
        for a in 0..out.len() {
            let Sums { near, bend, tilt } = from.sums(a);
            let straight = near.up(5).plus(bend.times(weights.sharpness));
            out[a] = straight.plus(tilt.times(weights.skew)).rounded_down(7).code(base);
        }
    }
}

/// Kernel: what a weight does for each sample of a row, `rest - weight * slope`; see
/// [`crate::codec::probe::Probe`].
pub struct Note<'a, W> {
    pub from: Neighbours<'a, W>,
    /// The true codes of the samples.
    pub codes: &'a [i32],
    pub base: i32,
    /// The sharpness if the skew is to be chosen, `None` if the sharpness is.
    pub sharpness: Option<i32>,
    pub rest: &'a mut [W],
    pub slope: &'a mut [W],
}

impl<W: Word> Kernel for Note<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let count = self.rest.len();
        let (from, base) = (self.from.cut(count), self.base);
        let (rest, slope, codes) = (&mut self.rest[..count], &mut self.slope[..count], &self.codes[..count]);
        // The code less the mean of the four nearest, times 128.
        let left = |a: usize, near: W| W::from_code(codes[a], base).up(7).minus(near.up(5));
        match self.sharpness {
            None => {
                for a in 0..count {
                    let Sums { near, bend, .. } = from.sums(a);
                    (rest[a], slope[a]) = (left(a, near), bend);
                }
            }
            Some(sharpness) => {
                for a in 0..count {
                    let Sums { near, bend, tilt } = from.sums(a);
                    (rest[a], slope[a]) = (left(a, near).minus(bend.times(sharpness)), tilt);
                }
            }
        }
    }
}

/// Kernel: the sum of the absolute residuals with a weight, times 128.
pub struct Cost<'a, W> {
    pub rest: &'a [W],
    pub slope: &'a [W],
    pub weight: i32,
}

impl<W: Word> Kernel for Cost<'_, W> {
    type Output = u64;

    #[inline(always)]
    fn run(self) -> u64 {
        let (rest, slope) = (self.rest, &self.slope[..self.rest.len()]);
        let mut sum = 0;
        for a in 0..rest.len() {
            sum += rest[a].minus(slope[a].times(self.weight)).magnitude();
        }
        sum
    }
}
