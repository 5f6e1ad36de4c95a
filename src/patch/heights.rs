//! The heights of a tile, as the numbers in which errors are measured.

use std::borrow::Cow;

use crate::sample::state;
use crate::sample::{Coding, Lattice, f32_from_code};
use crate::simd::{self, Kernel};

/// The heights of a lattice.
pub enum Heights<'a> {
    /// Integer codes, less the lowest one if they are large; their range is small enough for 32-bit
    /// arithmetic.
    Narrow(Cow<'a, [i32]>),
    /// As `Narrow`, and differences of the smallest cells fit 16 bits.
    Short(Cow<'a, [i32]>),
    /// Codes or values in f64.
    Wide(Vec<f64>),
    /// Values so large that sums of them would overflow f64, divided by 2^64.
    Small(Vec<f64>),
}

/// Up to this range no partial sum of `s (z - D)`, `s <= 2^10`, leaves 32 bits: its terms add up to
/// at most 12 s ranges.
const NARROW_RANGE: i64 = 1 << 17;

/// Up to this range `s (z - D)`, `s <= 8`, fits 16 bits.
const SHORT_RANGE: i64 = i16::MAX as i64 / 8;

/// Up to this height no sum of `s (z - D)`, `s <= 2^10`, leaves f64.
const LARGE: f64 = 1e300;
/// The unit in which larger heights are measured, 2^64. The division is exact but for bits that no
/// sum keeps.
const LARGE_UNIT: f64 = 18_446_744_073_709_551_616.0;

/// Kernel: codes clamped to a range, less its lowest code.
struct Clamped<'a> {
    codes: &'a [i32],
    low: i32,
    high: i32,
}

impl Kernel for Clamped<'_> {
    type Output = Vec<i32>;

    #[inline(always)]
    fn run(self) -> Vec<i32> {
        self.codes.iter().map(|&code| code.max(self.low).min(self.high).wrapping_sub(self.low)).collect()
    }
}

impl<'a> Heights<'a> {
    /// The heights of a tile. Those of void samples without a fill mean nothing: no shown triangle
    /// has them.
    pub fn new(lattice: &'a Lattice, coding: Coding) -> Self {
        match coding {
            Coding::Integer { .. } => Self::of_codes(lattice),
            Coding::Float32 => {
                Self::Wide(lattice.code.iter().map(|&code| f64::from(f32_from_code(code))).collect())
            }
            Coding::Float64 => {
                let z: Vec<f64> = (0..lattice.code.len()).map(|i| lattice.value(i, coding)).collect();
                if z.iter().any(|z| z.abs() > LARGE) {
                    return Self::Small(z.into_iter().map(|z| z / LARGE_UNIT).collect());
                }
                Self::Wide(z)
            }
        }
    }

    fn of_codes(lattice: &'a Lattice) -> Self {
        let codes = &lattice.code;
        let range = |low: i32, high: i32| i64::from(high) - i64::from(low);
        let (low, high) = state::range(codes).unwrap_or_default();
        let near = i64::from(low) > -NARROW_RANGE / 2 && i64::from(high) < NARROW_RANGE / 2;
        if near && range(low, high) <= SHORT_RANGE {
            return Self::Short(Cow::Borrowed(codes));
        }
        let (low, high) = state::known_range(codes, &lattice.state).unwrap_or_default();
        let clamped = || Cow::Owned(simd::run(Clamped { codes, low, high }));
        if range(low, high) <= SHORT_RANGE {
            return Self::Short(clamped());
        }
        if near {
            return Self::Narrow(Cow::Borrowed(codes));
        }
        if range(low, high) < NARROW_RANGE {
            return Self::Narrow(clamped());
        }
        Self::Wide(codes.iter().map(|&c| f64::from(c)).collect())
    }

    /// Largest rounding error of a difference, for each interval of the size of its cell; 0 for
    /// integers, whose arithmetic is exact.
    ///
    /// With `u = 2^-53` and heights up to `z`, adding up a surface of `s` intervals loses at most
    /// `(5 s^2 + 25 s) u z` where each of its three terms has its own sum (down a column, along a
    /// row, the bend), and `112 u z` or `256 u z` where the smallest cells, of 2 or 4 intervals, go
    /// from sample to sample. All this is of `s` times the difference, and so less than the
    /// `32 s u z` given here.
    pub fn slack(&self, coding: Coding) -> f64 {
        match (self, coding) {
            (_, Coding::Integer { .. }) | (Self::Narrow(_) | Self::Short(_), _) => 0.0,
            (Self::Wide(z) | Self::Small(z), _) => {
                z.iter().fold(0.0, |a: f64, v| a.max(v.abs())) * (0.5_f64).powi(48)
            }
        }
    }

    /// The unit of these heights: errors are multiplied by it.
    pub fn unit(&self) -> f64 {
        if matches!(self, Self::Small(_)) { LARGE_UNIT } else { 1.0 }
    }
}
