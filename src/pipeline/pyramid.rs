//! [`Pyramid`]: the sizes of the levels, in samples and in tiles.
//!
//! Level 0 is the root, one tile; level `levels` holds the leaves, whose samples are those of the
//! raster. A tile of a level spans two by two tiles of the next.

use std::ops::Range;

use crate::container::layout::leaf_level;
use crate::rect::Rect;

/// The levels over a raster.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pyramid {
    /// Columns of samples of the raster.
    pub width: u32,
    /// Rows of samples.
    pub height: u32,
    /// Intervals of a tile.
    pub tile: usize,
    /// The leaves' level, L.
    pub levels: u8,
}

impl Pyramid {
    /// The levels over a raster of this size, of tiles of `tile` intervals.
    pub fn new(width: u32, height: u32, tile: u32) -> Self {
        Self { width, height, tile: tile as usize, levels: leaf_level(width, height, tile) }
    }

    /// Columns of tiles of a level that can hold samples.
    pub fn columns(&self, level: u8) -> u32 {
        tiles_along(self.width, self.span(level), 1 << level)
    }

    /// Rows of tiles of a level that can hold samples.
    pub fn rows(&self, level: u8) -> u32 {
        tiles_along(self.height, self.span(level), 1 << level)
    }

    /// All tiles of a level that can hold samples.
    pub fn tiles(&self, level: u8) -> Rect {
        Rect { columns: 0..self.columns(level), rows: 0..self.rows(level) }
    }

    /// All leaf tiles that can hold samples.
    pub fn leaves(&self) -> Rect {
        self.tiles(self.levels)
    }

    /// Intervals of the raster along the side of a tile of a level.
    pub fn span(&self, level: u8) -> u64 {
        (self.tile as u64) << (self.levels - level)
    }

    /// Columns of samples of some columns of leaf tiles, the shared ones at both ends included.
    pub fn sample_columns(&self, tiles: &Range<u32>) -> Range<u32> {
        self.samples(tiles, self.width)
    }

    /// Rows of samples of some rows of leaf tiles, the shared ones at both ends included.
    pub fn sample_rows(&self, tiles: &Range<u32>) -> Range<u32> {
        self.samples(tiles, self.height)
    }

    fn samples(&self, tiles: &Range<u32>, most: u32) -> Range<u32> {
        let size = self.tile as u64;
        let end = (u64::from(tiles.end) * size + 1).min(u64::from(most));
        tiles.start * self.tile as u32..end as u32
    }

    /// Rows of samples from the first to the end of a row of leaf tiles.
    pub fn rows_down_to(&self, y: u32) -> u64 {
        self.sample_rows(&(0..y + 1)).end.into()
    }
}

/// Tiles along an axis of so many samples. A tile is closed: one more that starts exactly at the
/// last sample exists too, inside the root square, which is `most` tiles wide.
fn tiles_along(samples: u32, span: u64, most: u32) -> u32 {
    ((u64::from(samples) - 1) / span + 1).min(most.into()) as u32
}
