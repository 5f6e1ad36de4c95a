//! Squares of colour texels: what imagery tiles are made of, before and after the codec.

/// What a texel's colour is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Colour {
    /// One byte, sRGB-coded lightness.
    Grey,
    /// Three bytes: red, green, blue, sRGB.
    Rgb,
}

impl Colour {
    /// Bytes of a texel.
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
    /// What `colour` holds.
    pub kind: Colour,
    /// `side * side * kind.channels()` bytes. Texels that are wholly transparent have a colour too, near that of their neighbours.
    pub colour: Vec<u8>,
    /// `side * side` bytes, 0 transparent to 255 opaque, not premultiplied; `None` if all are opaque.
    pub alpha: Option<Vec<u8>>,
}
