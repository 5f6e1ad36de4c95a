//! Walks through the whole index.

use super::Reader;
use crate::container::directory::TileEntry;
use crate::error::Result;
use crate::tile::TileId;

impl Reader {
    /// Visits every tile, parents before children, children along the Hilbert curve: tiles of one
    /// level come in storage order. Fails if the number of tiles is not the one stated, or their
    /// chunks do not fill their section.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// let mut count = 0;
    /// reader.walk(&mut |_| {
    ///     count += 1;
    ///     Ok(())
    /// })?;
    /// assert_eq!(count, 29);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn walk(&self, visit: &mut dyn FnMut(&TileEntry) -> Result<()>) -> Result<()> {
        self.index.walk(&self.input, visit)
    }

    /// The existing tiles of a level in storage order.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// assert_eq!(reader.tiles(0)?, [TileId::ROOT]);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn tiles(&self, level: u8) -> Result<Vec<TileId>> {
        self.index.tiles_of(&self.input, level)
    }

    /// Columns of the existing tiles of one row of a level, from west to east. Only pages on the
    /// way to that row are read.
    pub fn row(&self, level: u8, y: u32) -> Result<Vec<u32>> {
        self.index.row(&self.input, level, y)
    }

    /// The tiles without children, along the Hilbert curve.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// assert!(reader.leaves()?.iter().all(|id| id.level == 3));
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
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
