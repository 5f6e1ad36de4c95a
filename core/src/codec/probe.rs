//! An encoder's choice of weights: those that leave the least residuals in a part of the rows.

use crate::codec::neighbours::{Cost, Neighbours, Note};
use crate::codec::order::{Row, Stage};
use crate::codec::predict::Planes;
use crate::codec::word::{Weights, Word};
use crate::sample::VALID;
use crate::sample::state;
use crate::simd;

/// Rows of a plane that are tried, at least; all, if it has fewer.
const ROWS: usize = 16;

/// The samples that weights are tried on: the residual of each is `rest - weight * slope`, in units
/// of 1/128.
#[derive(Default)]
pub struct Probe<W> {
    rest: Vec<W>,
    slope: Vec<W>,
    /// Codes of one row.
    codes: Vec<i32>,
}

/// The heights that a stage is to predict.
#[derive(Clone, Copy)]
pub struct Target<'a> {
    /// Codes of the whole lattice.
    pub codes: &'a [i32],
    /// States of the whole lattice: only valid samples count.
    pub state: &'a [u8],
    /// The stage.
    pub stage: Stage,
}

impl Target<'_> {
    /// Evenly spread rows of `first..last`, about [`ROWS`] of them.
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

    /// Adds the valid samples of a row, whose neighbours are `from`. The sharpness is given if the
    /// skew is to be chosen.
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

    /// Sum of the absolute residuals with `weight`.
    fn cost(&self, weight: i32) -> u64 {
        simd::run(Cost { rest: &self.rest, slope: &self.slope, weight })
    }

    /// The weight of the least sum. The sum is convex in the weight, so a descent from `start`
    /// finds it.
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

    /// The sharpness that suits the centres of `planes`, after [`Planes::start`].
    pub fn choose_sharpness(&mut self, planes: &Planes<W>, target: Target<'_>) -> i32 {
        self.clear();
        let m = target.stage.m;
        for b in target.some(0, m) {
            self.take(target.stage.centres(b), planes.centres(b, m), target, planes.base, None);
        }
        self.best(0, Weights::MAX, Weights::USUAL.sharpness)
    }

    /// The skew that suits H and V of `planes`, after [`Planes::finish_centres`].
    pub fn choose_skew(&mut self, planes: &Planes<W>, target: Target<'_>, sharpness: i32) -> i32 {
        self.clear();
        let m = target.stage.m;
        for b in target.some(1, m) {
            let (row, from) = (target.stage.horizontals(b), planes.horizontals(b, m));
            self.take(row, from, target, planes.base, Some(sharpness));
        }
        for b in target.some(0, m) {
            // Without the columns at the borders, which have no weights.
            let row = target.stage.verticals(b);
            let inner = Row { first: row.first + row.step, count: m - 1, ..row };
            if inner.count > 0 {
                self.take(inner, planes.verticals(b, m - 1), target, planes.base, Some(sharpness));
            }
        }
        self.best(-Weights::MAX, Weights::MAX, Weights::USUAL.skew)
    }
}
