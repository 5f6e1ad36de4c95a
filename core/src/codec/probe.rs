//! An encoder's choice of weights: some rows of samples are tried out, and the weights that leave least are taken.

use crate::codec::neighbours::{Cost, Neighbours, Note};
use crate::codec::order::{Row, Stage};
use crate::codec::predict::{Planes, Weights, Word};
use crate::sample::VALID;
use crate::sample::state;
use crate::simd;

/// Rows of a plane that are tried out, at least.
const ROWS: usize = 16;

/// What weights are judged by: samples whose residual is `rest - weight * slope`, in units of 1/128.
#[derive(Default)]
pub struct Probe<W> {
    rest: Vec<W>,
    slope: Vec<W>,
    /// Codes of one row.
    codes: Vec<i32>,
}

/// The heights that are to be predicted.
#[derive(Clone, Copy)]
pub struct Target<'a> {
    /// Codes of the whole lattice.
    pub codes: &'a [i32],
    /// States of the whole lattice: only valid samples count.
    pub state: &'a [u8],
    /// The stage in question.
    pub stage: Stage,
}

impl Target<'_> {
    /// Some of the rows from `first` to `last`, spread evenly.
    fn some(self, first: usize, last: usize) -> impl Iterator<Item = usize> {
        let step = (self.stage.m / ROWS).max(1);
        (first + step / 2..last).step_by(step)
    }
}

impl<W: Word> Probe<W> {
    /// Forgets all samples.
    fn clear(&mut self) {
        self.rest.clear();
        self.slope.clear();
    }

    /// Takes the valid samples of a row, whose neighbours are `from`. To choose a skew, the sharpness is given.
    fn take(
        &mut self,
        row: Row,
        from: Neighbours<'_, W>,
        target: Target<'_>,
        base: i32,
        sharpness: Option<i32>,
    ) {
        self.codes.clear();
        row.gather(target.codes, &mut self.codes);
        let start = self.rest.len();
        self.rest.resize(start + row.count, W::default());
        self.slope.resize(start + row.count, W::default());
        let (rest, slope) = (&mut self.rest[start..], &mut self.slope[start..]);
        simd::run(Note { from, codes: &self.codes, base, sharpness, rest, slope });
        if state::all_valid(&target.state[row.first..row.end()]) {
            return;
        }
        let mut end = start;
        for (sample, &state) in (start..).zip(row.of(target.state)) {
            if state == VALID {
                (self.rest[end], self.slope[end]) = (self.rest[sample], self.slope[sample]);
                end += 1;
            }
        }
        self.rest.truncate(end);
        self.slope.truncate(end);
    }

    /// Sum of what `weight` leaves.
    fn cost(&self, weight: i32) -> u64 {
        simd::run(Cost { rest: &self.rest, slope: &self.slope, weight })
    }

    /// The weight that leaves least. The sum is convex in the weight: downhill from `start` is enough.
    fn best(&self, lowest: i32, highest: i32, start: i32) -> i32 {
        let mut best = (self.cost(start), start);
        for step in [1, -1] {
            loop {
                let weight = best.1 + step;
                let cost = if (lowest..=highest).contains(&weight) { self.cost(weight) } else { u64::MAX };
                if cost >= best.0 {
                    break;
                }
                best = (cost, weight);
            }
        }
        best.1
    }
}

impl<W: Word> Planes<W> {
    /// The sharpness that suits the centres; to be called after [`Planes::start`].
    pub fn choose_sharpness(&mut self, target: Target<'_>) -> i32 {
        let mut probe = std::mem::take(&mut self.probe);
        probe.clear();
        let m = target.stage.m;
        for b in target.some(0, m) {
            probe.take(target.stage.centres(b), self.centres(b, m), target, self.base, None);
        }
        let best = probe.best(0, Weights::MAX, Weights::USUAL.sharpness);
        self.probe = probe;
        best
    }

    /// The skew that suits H and V; to be called after [`Planes::finish_centres`].
    pub fn choose_skew(&mut self, target: Target<'_>, sharpness: i32) -> i32 {
        let mut probe = std::mem::take(&mut self.probe);
        probe.clear();
        let m = target.stage.m;
        for b in target.some(1, m) {
            let (row, from) = (target.stage.horizontals(b), self.horizontals(b, m));
            probe.take(row, from, target, self.base, Some(sharpness));
        }
        for b in target.some(0, m) {
            // Without the columns at the borders, which have no weights.
            let row = target.stage.verticals(b);
            let inner = Row { first: row.first + row.step, count: m - 1, ..row };
            if inner.count > 0 {
                probe.take(inner, self.verticals(b, m - 1), target, self.base, Some(sharpness));
            }
        }
        let best = probe.best(-Weights::MAX, Weights::MAX, Weights::USUAL.skew);
        self.probe = probe;
        best
    }
}
