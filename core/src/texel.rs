//! Squares of colour texels: imagery tiles before encoding and after decoding.

/// The colour type of a texel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Colour {
    /// One byte, sRGB-coded lightness.
    Grey,
    /// Three bytes: red, green, blue, sRGB.
    Rgb,
}

impl Colour {
    /// Bytes of the colour of a texel.
    pub fn channels(self) -> usize {
        match self {
            Self::Grey => 1,
            Self::Rgb => 3,
        }
    }
}

/// A square of texels, row by row from the north-west.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texels {
    /// Texels along a side, the gutter included.
    pub side: usize,
    /// Colour type of the texels.
    pub kind: Colour,
    /// `side * side * kind.channels()` bytes. Wholly transparent texels also have a colour, near
    /// that of their neighbours.
    pub colour: Vec<u8>,
    /// `side * side` bytes, 0 transparent to 255 opaque, not premultiplied; `None` if all are
    /// opaque.
    pub alpha: Option<Vec<u8>>,
}
