//! One picture resampled to a square of texels.
//!
//! Along an axis on which a texel spans at most one pixel the picture is interpolated linearly
//! between pixel centres, else averaged over the pixels that the texel covers, each by its share. A
//! texel belongs to a picture if its centre lies in it: pictures that abut leave no seam. Pixels
//! outside do not count, nor do transparent ones for the colour. Every texel is computed from its
//! own coordinates alone, in one order, so that two squares that share it agree bit for bit.
//!
//! `straight` resamples pictures whose columns are columns of texels, `oblique` the others.

mod oblique;
mod straight;

use super::place::Placed;
use super::square::{Layer, Square};
use crate::error::Result;

/// The texels of a picture in a square; `None` if it does not touch the square.
pub(super) fn resample(placed: &Placed<'_>, square: Square) -> Result<Option<Layer>> {
    let map = placed.map(square.level);
    if map.is_straight() {
        straight::resample(placed, &map, square)
    } else {
        oblique::resample(placed, &map, square)
    }
}
