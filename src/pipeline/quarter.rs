//! What a finished tile leaves for its parent: half its samples, blocks, errors, and the range of heights below.

use crate::patch::Errors;
use crate::patch::blocks::Blocks;
use crate::pipeline::plan::Plan;
use crate::sample::{Coding, Lattice};

/// A quarter of a parent.
#[derive(Clone, Debug, PartialEq)]
pub struct Quarter {
    /// Every second sample of the tile, `(n / 2 + 1)^2`.
    pub lattice: Lattice,
    /// Its blocks, `(n / 2)^2`.
    pub blocks: Blocks,
    /// Its errors.
    pub errors: Errors,
    /// Heights of it and of all below.
    pub range: Range,
}

/// Lowest and highest value; empty if `low > high`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Lowest.
    pub low: f64,
    /// Highest.
    pub high: f64,
}

impl Range {
    /// No value.
    pub const EMPTY: Self = Self { low: f64::INFINITY, high: f64::NEG_INFINITY };

    /// The range of both.
    #[must_use]
    pub fn join(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Range of the samples whose state is at least `state`.
    pub fn of(lattice: &Lattice, coding: Coding, least: u8) -> Self {
        if coding.has_low() {
            let known = (0..lattice.state.len()).filter(|&i| lattice.state[i] >= least);
            return known
                .map(|i| lattice.value(i, coding))
                .fold(Self::EMPTY, |range, v| Self { low: range.low.min(v), high: range.high.max(v) });
        }
        let codes = || lattice.code.iter().zip(&lattice.state);
        let low = codes()
            .fold(i32::MAX, |low, (&code, &state)| low.min(if state >= least { code } else { i32::MAX }));
        let high = codes()
            .fold(i32::MIN, |high, (&code, &state)| high.max(if state >= least { code } else { i32::MIN }));
        if low > high {
            return Self::EMPTY;
        }
        let (a, b) = (coding.value(low, 0), coding.value(high, 0));
        Self { low: a.min(b), high: a.max(b) }
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
