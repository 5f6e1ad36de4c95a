//! An encoder's choice of weights: some rows of samples are tried out, and the weights that leave least are taken.

use crate::codec::order::{Row, Stage};
use crate::codec::predict::{Planes, Sums, Weights, Word};
use crate::sample::VALID;

/// Rows of a plane that are tried out, at least.
const ROWS: usize = 16;

/// What weights are judged by: samples whose residual is `rest - weight * slope`, in units of 1/128.
#[derive(Default)]
pub struct Probe<W> {
    rest: Vec<W>,
    slope: Vec<W>,
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
    /// The codes of a row; `None` for the void ones.
    fn row(self, row: Row) -> impl Iterator<Item = Option<i32>> {
        let samples = row.of(self.codes).zip(row.of(self.state));
        samples.map(|(&code, &state)| (state == VALID).then_some(code))
    }

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

    /// Sum of what `weight` leaves.
    fn cost(&self, weight: i32) -> u64 {
        self.rest
            .iter()
            .zip(&self.slope)
            .map(|(rest, slope)| rest.minus(slope.times(weight)).magnitude())
            .sum()
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
            let mut actual = target.row(target.stage.centres(b));
            self.centres(b, m, |_, sums| {
                if let Some(Some(code)) = actual.next() {
                    probe.rest.push(self.rest(code, &sums));
                    probe.slope.push(sums.bend);
                }
            });
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
        let mut push = |actual: Option<i32>, sums: &Sums<W>| {
            if let Some(code) = actual {
                probe.rest.push(self.rest(code, sums).minus(sums.bend.times(sharpness)));
                probe.slope.push(sums.tilt);
            }
        };
        for b in target.some(1, m) {
            let mut actual = target.row(target.stage.horizontals(b));
            self.horizontals(b, m, |_, sums| push(actual.next().flatten(), &sums));
        }
        for b in target.some(0, m) {
            let mut actual = target.row(target.stage.verticals(b)).skip(1);
            self.verticals(b, m - 1, |_, sums| push(actual.next().flatten(), &sums));
        }
        let best = probe.best(-Weights::MAX, Weights::MAX, Weights::USUAL.skew);
        self.probe = probe;
        best
    }

    /// What the mean of the four nearest leaves of a code, times 128.
    fn rest(&self, code: i32, sums: &Sums<W>) -> W {
        W::from_code(code, self.base).up(7).minus(sums.near.up(5))
    }
}
