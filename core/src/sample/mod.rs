//! Samples as integer codes: the form in which split, errors and codec handle heights.
//!
//! An integer sample is its own code. A float is mapped to the integer of the same order (its bits,
//! those of negative numbers flipped), so that prediction works on it too. Of a float64 the upper
//! 32 ordered bits are the code, and the lower 32 a second number beside it. Each map is one to
//! one: nothing is lost.

pub mod interpolate;
pub mod state;

use serde::{Deserialize, Serialize};

/// Type of the samples of a source raster, with the number that the container header stores.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "write", derive(wincode::SchemaRead, wincode::SchemaWrite))]
#[serde(rename_all = "lowercase")]
#[repr(u8)]
pub enum SampleType {
    /// 8-bit signed.
    Int8 = 1,
    /// 8-bit unsigned.
    Uint8 = 2,
    /// 16-bit signed.
    Int16 = 3,
    /// 16-bit unsigned.
    Uint16 = 4,
    /// 32-bit signed.
    Int32 = 5,
    /// 32-bit unsigned.
    Uint32 = 6,
    /// 32-bit IEEE float.
    Float32 = 7,
    /// 64-bit IEEE float.
    Float64 = 8,
}

impl SampleType {
    /// All types in the order of their numbers.
    pub const ALL: [Self; 8] = [
        Self::Int8,
        Self::Uint8,
        Self::Int16,
        Self::Uint16,
        Self::Int32,
        Self::Uint32,
        Self::Float32,
        Self::Float64,
    ];

    /// The type of a number stored in a header.
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|&kind| kind as u8 == number)
    }

    /// Bytes of one sample.
    pub fn bytes(self) -> usize {
        match self {
            Self::Int8 | Self::Uint8 => 1,
            Self::Int16 | Self::Uint16 => 2,
            Self::Int32 | Self::Uint32 | Self::Float32 => 4,
            Self::Float64 => 8,
        }
    }

    /// True for the two float types.
    pub fn is_float(self) -> bool {
        matches!(self, Self::Float32 | Self::Float64)
    }

    /// GDAL's name of the type.
    ///
    /// ```
    /// use relevo_core::SampleType;
    ///
    /// assert_eq!((SampleType::Int16.gdal_name(), SampleType::Int16.bytes()), ("Int16", 2));
    /// ```
    pub fn gdal_name(self) -> &'static str {
        match self {
            Self::Int8 => "Int8",
            Self::Uint8 => "Byte",
            Self::Int16 => "Int16",
            Self::Uint16 => "UInt16",
            Self::Int32 => "Int32",
            Self::Uint32 => "UInt32",
            Self::Float32 => "Float32",
            Self::Float64 => "Float64",
        }
    }

    /// The shortest text of a value that reads back as the same sample of this type: `-9999`,
    /// `-3.4028235e38`.
    pub fn text(self, value: f64) -> String {
        let single = value as f32;
        let text = if self == Self::Float32 && f64::from(single) == value {
            format!("{single:?}")
        } else {
            format!("{value:?}")
        };
        text.strip_suffix(".0").map_or(text.clone(), str::to_owned)
    }
}

/// How a code becomes the source's value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coding {
    /// `value = offset + scale * code`.
    Integer {
        /// Value of one unit of code: 1 for an integer raster kept without loss, else the
        /// precision.
        scale: f64,
        /// Value of code 0.
        offset: f64,
    },
    /// The code is the ordered bit pattern of a float32.
    Float32,
    /// The code and `low` are the upper and lower half of the ordered bit pattern of a float64.
    Float64,
}

impl Coding {
    /// Value of a code, as the source has it (before GDAL's scale, offset and unit). Only `Float64`
    /// uses `low`.
    #[inline]
    pub fn value(self, code: i32, low: u32) -> f64 {
        match self {
            Self::Integer { scale, offset } => offset + scale * f64::from(code),
            Self::Float32 => f64::from(f32_from_code(code)),
            Self::Float64 => f64_from_code(code, low),
        }
    }

    /// True if tiles carry a second plane of lower halves.
    pub fn has_low(self) -> bool {
        self == Self::Float64
    }
}

/// Code of a float32: codes have the order of the floats. NaN is void and never gets a code.
#[inline]
pub fn code_from_f32(value: f32) -> i32 {
    let bits = value.to_bits() as i32;
    bits ^ ((bits >> 31) & i32::MAX)
}

/// Inverse of [`code_from_f32`].
#[inline]
pub fn f32_from_code(code: i32) -> f32 {
    f32::from_bits((code ^ ((code >> 31) & i32::MAX)) as u32)
}

/// Upper and lower half of the ordered bits of a float64.
#[inline]
pub fn code_from_f64(value: f64) -> (i32, u32) {
    let bits = value.to_bits() as i64;
    let ordered = bits ^ ((bits >> 63) & i64::MAX);
    ((ordered >> 32) as i32, ordered as u32)
}

/// Inverse of [`code_from_f64`].
#[inline]
pub fn f64_from_code(code: i32, low: u32) -> f64 {
    let ordered = (i64::from(code) << 32) | i64::from(low);
    f64::from_bits((ordered ^ ((ordered >> 63) & i64::MAX)) as u64)
}

/// State of a void sample whose code means nothing.
pub const VOID: u8 = 0;
/// State of a void sample with a fill height, made from its neighbours.
pub const FILLED: u8 = 1;
/// State of a valid sample.
pub const VALID: u8 = 2;

/// The samples of one tile: `(n + 1)^2` of them, row by row from the north-west.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lattice {
    /// Intervals on a side.
    pub n: usize,
    /// Codes, `(n + 1)^2`.
    pub code: Vec<i32>,
    /// Lower halves of float64 samples, `(n + 1)^2`; empty for every other coding.
    pub low: Vec<u32>,
    /// [`VOID`], [`FILLED`] or [`VALID`], `(n + 1)^2`. A reader cannot tell `FILLED` from `VOID`
    /// and uses `VOID` for both.
    pub state: Vec<u8>,
}

impl Lattice {
    /// A lattice of `n` intervals, all void, code 0.
    pub fn new(n: usize, coding: Coding) -> Self {
        let count = (n + 1) * (n + 1);
        Self {
            n,
            code: vec![0; count],
            low: if coding.has_low() { vec![0; count] } else { Vec::new() },
            state: vec![VOID; count],
        }
    }

    /// Makes it equal to [`Lattice::new`], reusing its memory.
    pub fn reset(&mut self, n: usize, coding: Coding) {
        let count = (n + 1) * (n + 1);
        self.n = n;
        refill(&mut self.code, count, 0);
        refill(&mut self.low, if coding.has_low() { count } else { 0 }, 0);
        refill(&mut self.state, count, VOID);
    }

    /// Index of column `x`, row `y`.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// let tile = reader.read_tile(TileId::ROOT)?;
    /// assert_eq!(tile.at(3, 2), 2 * 17 + 3);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> usize {
        y * (self.n + 1) + x
    }

    /// Lower half at an index; 0 where there is none.
    #[inline]
    pub fn low_at(&self, index: usize) -> u32 {
        self.low.get(index).copied().unwrap_or(0)
    }

    /// Value at an index.
    #[inline]
    pub fn value(&self, index: usize, coding: Coding) -> f64 {
        coding.value(self.code[index], self.low_at(index))
    }
}

/// Sets a plane to `count` times `value`, reusing its memory.
pub fn refill<T: Copy>(plane: &mut Vec<T>, count: usize, value: T) {
    plane.clear();
    plane.reserve_exact(count);
    plane.resize(count, value);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_samples_are_short_and_read_back() {
        use SampleType::{Float32, Float64, Int16};
        for (kind, value, text) in [
            (Int16, -9999.0, "-9999"),
            (Float32, f64::from(f32::MIN), "-3.4028235e38"),
            (Float64, f64::from(f32::MIN), "-3.4028234663852886e38"),
            (Float32, f64::from(0.1_f32), "0.1"),
            (Float64, -1.797_693_134_862_315_7e308, "-1.7976931348623157e308"),
            (Float32, -3.4e38, "-3.4e38"),
            (Float64, f64::NAN, "NaN"),
            (Int16, -0.0, "-0"),
        ] {
            assert_eq!(kind.text(value), text);
            let back: f64 = text.parse().unwrap();
            let same = if kind == Float32 { back as f32 == value as f32 } else { back == value };
            assert!(same || value.is_nan(), "{text}");
        }
    }
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn float32_codes_keep_bits_and_order(a: f32, b: f32) {
            prop_assume!(!a.is_nan() && !b.is_nan());
            prop_assert_eq!(f32_from_code(code_from_f32(a)).to_bits(), a.to_bits());
            if a < b {
                prop_assert!(code_from_f32(a) < code_from_f32(b));
            }
        }

        #[test]
        fn float64_codes_keep_bits_and_order(a: f64, b: f64) {
            prop_assume!(!a.is_nan() && !b.is_nan());
            let (high, low) = code_from_f64(a);
            prop_assert_eq!(f64_from_code(high, low).to_bits(), a.to_bits());
            if a < b {
                prop_assert!(code_from_f64(a) < code_from_f64(b));
            }
        }
    }
}
