//! [`ValueRange`]: the lowest and the highest value of some samples.

use super::plan::Plan;
use crate::sample::state;
use crate::sample::{Coding, FILLED, Lattice, VALID};

/// Lowest and highest value; empty if `low > high`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueRange {
    /// Lowest.
    pub low: f64,
    /// Highest.
    pub high: f64,
}

impl ValueRange {
    /// No value.
    pub const EMPTY: Self = Self { low: f64::INFINITY, high: f64::NEG_INFINITY };

    /// The range that holds both.
    #[must_use]
    pub fn join(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Range of the samples that have a height, filled or valid, and of the valid ones alone.
    /// `all_valid` says whether they all are.
    pub fn of(lattice: &Lattice, all_valid: bool, coding: Coding) -> [Self; 2] {
        if coding.has_low() {
            return [FILLED, VALID].map(|least| {
                let known = (0..lattice.state.len()).filter(|&i| lattice.state[i] >= least);
                known
                    .map(|i| lattice.value(i, coding))
                    .fold(Self::EMPTY, |range, v| Self { low: range.low.min(v), high: range.high.max(v) })
            });
        }
        let (code, state) = (&lattice.code, &lattice.state);
        let (known, valid) = if all_valid {
            let range = state::range(code);
            (range, range)
        } else {
            (state::known_range(code, state), state::valid_range(code, state))
        };
        [known, valid].map(|range| {
            range.map_or(Self::EMPTY, |(low, high)| {
                let (a, b) = (coding.value(low, 0), coding.value(high, 0));
                Self { low: a.min(b), high: a.max(b) }
            })
        })
    }

    /// In metres.
    pub fn metres(self, plan: &Plan) -> (f64, f64) {
        let (a, b) = (plan.metres_of(self.low), plan.metres_of(self.high));
        (a.min(b), a.max(b))
    }

    /// In metres as f32, rounded outward.
    pub fn outward(self, plan: &Plan) -> (f32, f32) {
        let (low, high) = self.metres(plan);
        let down = if f64::from(low as f32) > low { (low as f32).next_down() } else { low as f32 };
        let up = if f64::from(high as f32) < high { (high as f32).next_up() } else { high as f32 };
        (down, up)
    }
}
