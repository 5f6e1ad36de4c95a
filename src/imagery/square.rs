//! Squares of texels, and the texels that one picture gives them.

use super::light::TABLES;
use crate::texel::Colour;

/// Fraction of a pixel by which a centre may lie outside a picture: rounding must not open a gap
/// between two pictures.
pub(super) const EDGE: f64 = 1e-6;

/// A square of texels of a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Square {
    pub(super) level: u8,
    /// The first column; that of a gutter may be negative.
    pub(super) left: i64,
    /// The first row; that of a gutter may be negative.
    pub(super) top: i64,
    /// Texels along a side.
    pub(super) side: usize,
}

/// Resampled texels of a square, row by row. Colours of transparent ones are 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Layer {
    pub(super) kind: Colour,
    pub(super) colour: Vec<u8>,
    /// `None` if all are opaque.
    pub(super) alpha: Option<Vec<u8>>,
}

/// Sets the colour of a texel from its sums, and returns its alpha. An opaque texel is not divided
/// by its opacity, so it is the same as among opaque pixels alone.
#[inline(always)]
pub(super) fn texel<const C: usize, const K: usize>(sums: [f32; K], colour: &mut [u8; C]) -> u8 {
    let opacity = sums[C];
    let alpha = (opacity * 255.0 + 0.5) as u8;
    if alpha > 0 {
        let divisor = if alpha == 255 { 1.0 } else { opacity };
        for (colour, sum) in colour.iter_mut().zip(sums) {
            *colour = TABLES.byte((sum / divisor).min(16384.0));
        }
    }
    alpha
}
