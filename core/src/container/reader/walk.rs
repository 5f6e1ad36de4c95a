//! Walks through the whole index.

use super::Reader;
use crate::container::directory::TileEntry;
use crate::error::Result;
use crate::tile::TileId;

impl Reader {
    /// Visits every tile, parents before children, children along the Hilbert curve: tiles of one
    /// level come in storage order. Fails if the number of tiles is not the one stated, or their
    /// chunks do not fill their section.
    pub fn walk(&self, visit: &mut dyn FnMut(&TileEntry) -> Result<()>) -> Result<()> {
        self.index.walk(&self.input, visit)
    }

    /// The existing tiles of a level in storage order.
    pub fn tiles(&self, level: u8) -> Result<Vec<TileId>> {
        self.index.tiles_of(&self.input, level)
    }

    /// Columns of the existing tiles of one row of a level, from west to east. Only pages on the
    /// way to that row are read.
    pub fn row(&self, level: u8, y: u32) -> Result<Vec<u32>> {
        self.index.row(&self.input, level, y)
    }

    /// The tiles without children, along the Hilbert curve.
    pub fn leaves(&self) -> Result<Vec<TileId>> {
        let mut ids = Vec::new();
        self.walk(&mut |entry| {
            if entry.is_leaf() {
                ids.push(entry.id);
            }
            Ok(())
        })?;
        Ok(ids)
    }
}
