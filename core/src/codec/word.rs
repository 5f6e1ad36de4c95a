//! The numbers of predictions: the integers they are computed in, and their two weights.

/// An integer type that predictions are computed in. All operations wrap.
pub trait Word: Copy + Default {
    /// A code, relative to `base`.
    fn from_code(code: i32, base: i32) -> Self;
    /// The code of a number relative to `base`, modulo 2^32.
    fn code(self, base: i32) -> i32;
    /// `self + other`.
    fn plus(self, other: Self) -> Self;
    /// `self - other`.
    fn minus(self, other: Self) -> Self;
    /// `self * 2^bits`.
    fn up(self, bits: u32) -> Self;
    /// `self * factor`.
    fn times(self, factor: i32) -> Self;
    /// `|self|`.
    fn magnitude(self) -> u64;
    /// `floor((self + 2^(bits - 1)) / 2^bits)`.
    fn rounded_down(self, bits: u32) -> Self;
}

impl Word for i32 {
    #[inline(always)]
    fn from_code(code: i32, base: i32) -> Self {
        code.wrapping_sub(base)
    }
    #[inline(always)]
    fn code(self, base: i32) -> i32 {
        self.wrapping_add(base)
    }
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }
    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }
    #[inline(always)]
    fn up(self, bits: u32) -> Self {
        self << bits
    }
    #[inline(always)]
    fn times(self, factor: i32) -> Self {
        self.wrapping_mul(factor)
    }
    #[inline(always)]
    fn magnitude(self) -> u64 {
        u64::from(self.unsigned_abs())
    }
    #[inline(always)]
    fn rounded_down(self, bits: u32) -> Self {
        self.wrapping_add(1 << (bits - 1)) >> bits
    }
}

impl Word for i64 {
    #[inline(always)]
    fn from_code(code: i32, base: i32) -> Self {
        Self::from(code) - Self::from(base)
    }
    #[inline(always)]
    fn code(self, base: i32) -> i32 {
        (self as i32).wrapping_add(base)
    }
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }
    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }
    #[inline(always)]
    fn up(self, bits: u32) -> Self {
        self << bits
    }
    #[inline(always)]
    fn times(self, factor: i32) -> Self {
        self.wrapping_mul(Self::from(factor))
    }
    #[inline(always)]
    fn magnitude(self) -> u64 {
        self.unsigned_abs()
    }
    #[inline(always)]
    fn rounded_down(self, bits: u32) -> Self {
        self.wrapping_add(1 << (bits - 1)) >> bits
    }
}

/// The two weights of a prediction: how it departs from the mean of the four nearest samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Weights {
    /// Weight, 0 to 7, of the eight samples around the four nearest, which is subtracted. With 0
    /// the prediction is the mean of the four.
    pub sharpness: i32,
    /// -7 to 7. Above 0 the samples to the east and west count more, below 0 those to the north and
    /// south.
    pub skew: i32,
}

impl Weights {
    /// The weights that suit most terrain.
    pub const USUAL: Self = Self { sharpness: 5, skew: 0 };
    /// Greatest sharpness, and greatest absolute skew.
    pub const MAX: i32 = 7;

    /// The weights of a chunk's byte; `None` if they are out of range.
    pub fn from_byte(byte: u8) -> Option<Self> {
        let weights = Self { sharpness: i32::from(byte & 15), skew: i32::from(byte >> 4) - 8 };
        (weights.sharpness <= Self::MAX && weights.skew >= -Self::MAX).then_some(weights)
    }

    /// The byte that a chunk stores.
    pub fn byte(self) -> u8 {
        (self.sharpness | (self.skew + 8) << 4) as u8
    }
}
