//! [`Ground`]: what an imagery layer needs to know of the heights under it.

use super::TexelGrid;
use crate::geo::Geo;

/// The heights, as far as imagery needs to know them.
#[derive(Clone, Copy)]
pub struct Ground<'a> {
    /// Where the lattice lies.
    pub geo: &'a Geo,
    /// Intervals along the root square.
    pub intervals: u64,
    /// Columns and rows of the lattice.
    pub samples: (u32, u32),
    /// Tiles of heights, at most.
    pub tiles: u64,
}

impl Ground<'_> {
    /// Where texels lie on them, in tiles of `tile` texels.
    pub fn grid(&self, tile: u32) -> TexelGrid {
        TexelGrid { tile, intervals: self.intervals, samples: self.samples }
    }
}
