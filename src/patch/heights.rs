//! Heights of a tile in the numbers that errors are measured in.

use std::borrow::Cow;

use crate::sample::{Coding, Lattice, f32_from_code};

/// Heights of a lattice.
pub enum Heights<'a> {
    /// Integer codes, less the lowest one if they are large; their range is small enough for 32-bit arithmetic.
    Narrow(Cow<'a, [i32]>),
    /// Codes or values.
    Wide(Vec<f64>),
}

/// Up to this range no partial sum of `s (z - D)`, `s <= 2^10`, leaves 32 bits: its terms add up to at most 12 s ranges.
const NARROW_RANGE: i64 = 1 << 17;

impl<'a> Heights<'a> {
    /// Heights of a tile. Void samples without a fill are whatever they are: no shown triangle has them.
    pub fn new(lattice: &'a Lattice, coding: Coding) -> Self {
        match coding {
            Coding::Integer { .. } => Self::of_codes(lattice),
            Coding::Float32 => {
                Self::Wide(lattice.code.iter().map(|&code| f64::from(f32_from_code(code))).collect())
            }
            Coding::Float64 => {
                Self::Wide((0..lattice.code.len()).map(|i| lattice.value(i, coding)).collect())
            }
        }
    }

    fn of_codes(lattice: &'a Lattice) -> Self {
        let codes = &lattice.code;
        let near = |code: &i32| i64::from(code.unsigned_abs()) < NARROW_RANGE / 2;
        // No early end: this way the compiler makes vectors of it.
        if codes.iter().fold(true, |all, code| all & near(code)) {
            return Self::Narrow(Cow::Borrowed(codes));
        }
        let known = || codes.iter().zip(&lattice.state).filter(|(_, state)| **state != 0).map(|(&c, _)| c);
        let low = known().min().unwrap_or(0);
        let high = known().max().unwrap_or(0);
        if i64::from(high) - i64::from(low) < NARROW_RANGE {
            return Self::Narrow(codes.iter().map(|&c| c.clamp(low, high) - low).collect());
        }
        Self::Wide(codes.iter().map(|&c| f64::from(c)).collect())
    }

    /// What rounding in f64 may have lost: 0 for integers, whose arithmetic is exact.
    pub fn slack(&self, coding: Coding) -> f64 {
        match (self, coding) {
            (_, Coding::Integer { .. }) | (Self::Narrow(_), _) => 0.0,
            (Self::Wide(z), _) => z.iter().fold(0.0, |a: f64, v| a.max(v.abs())) * (0.5_f64).powi(49),
        }
    }
}
