//! The number types in which heights are compared.

/// A number type in which heights are compared: `i32` where the range of a tile allows it, `f64`
/// elsewhere; for the smallest cells `i16` where that is wide enough.
pub trait Number: Copy + PartialOrd {
    /// Zero.
    const ZERO: Self;
    /// Sum.
    fn plus(self, other: Self) -> Self;
    /// Difference.
    fn minus(self, other: Self) -> Self;
    /// Times `2^bits`.
    fn scaled(self, bits: u32) -> Self;
    /// Absolute value.
    fn magnitude(self) -> Self;
    /// A small whole number.
    fn whole(number: i32) -> Self;
    /// As f64, which is exact.
    fn wide(self) -> f64;
    /// The number equal to an f64.
    fn narrow(wide: f64) -> Self;

    /// Maximum of two.
    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        if other > self { other } else { self }
    }
}

/// Sums wrap: a result that fits 16 bits is right, whatever its terms are.
impl Number for i16 {
    const ZERO: Self = 0;

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }

    #[inline(always)]
    fn scaled(self, bits: u32) -> Self {
        self << bits
    }

    #[inline(always)]
    fn magnitude(self) -> Self {
        self.wrapping_abs()
    }

    #[inline(always)]
    fn whole(number: i32) -> Self {
        number as i16
    }

    #[inline(always)]
    fn wide(self) -> f64 {
        f64::from(self)
    }

    #[inline(always)]
    fn narrow(wide: f64) -> Self {
        wide as i16
    }
}

impl Number for i32 {
    const ZERO: Self = 0;

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self + other
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self - other
    }

    #[inline(always)]
    fn scaled(self, bits: u32) -> Self {
        self << bits
    }

    #[inline(always)]
    fn magnitude(self) -> Self {
        self.abs()
    }

    #[inline(always)]
    fn whole(number: i32) -> Self {
        number
    }

    #[inline(always)]
    fn wide(self) -> f64 {
        f64::from(self)
    }

    #[inline(always)]
    fn narrow(wide: f64) -> Self {
        wide as i32
    }
}

impl Number for f64 {
    const ZERO: Self = 0.0;

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self + other
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self - other
    }

    #[inline(always)]
    fn scaled(self, bits: u32) -> Self {
        self * f64::from(1_u32 << bits)
    }

    #[inline(always)]
    fn magnitude(self) -> Self {
        self.abs()
    }

    #[inline(always)]
    fn whole(number: i32) -> Self {
        f64::from(number)
    }

    #[inline(always)]
    fn wide(self) -> f64 {
        self
    }

    #[inline(always)]
    fn narrow(wide: f64) -> Self {
        wide
    }
}
