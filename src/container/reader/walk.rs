//! Walks through the whole index.
//!
//! Depth first, children along the Hilbert curve: so the tiles of every level come in storage order. A walk ends with an
//! error as soon as it has seen more tiles, or more bytes of chunks, than the file can hold; its time is bounded.

use super::{Loaded, Reader};
use crate::container::directory::{Found, TileEntry};
use crate::error::{Error, Result};
use crate::tile::TileId;

impl Reader {
    /// Visits every tile, parents before children, children along the Hilbert curve: tiles of one level come in storage
    /// order. Fails if the tiles are not as many, or do not fill their section, as the file says.
    pub fn walk(&self, visit: &mut dyn FnMut(&TileEntry) -> Result<()>) -> Result<()> {
        let (mut tiles, mut bytes) = (0, 0);
        let mut count = |entry: &TileEntry| {
            tiles += 1;
            bytes += entry.chunks.bytes();
            self.check_counts(tiles, bytes, false)?;
            visit(entry)
        };
        self.walk_from(TileId::ROOT, &self.root, u8::MAX, &mut count)?;
        self.check_counts(tiles, bytes, true)
    }

    /// The existing tiles of a level in storage order.
    pub fn tiles(&self, level: u8) -> Result<Vec<TileId>> {
        let (mut ids, mut tiles) = (Vec::new(), 0);
        let mut keep = |entry: &TileEntry| {
            tiles += 1;
            self.check_counts(tiles, 0, false)?;
            if entry.id.level == level {
                ids.push(entry.id);
            }
            Ok(())
        };
        self.walk_from(TileId::ROOT, &self.root, level, &mut keep)?;
        Ok(ids)
    }

    /// Columns of the existing tiles of one row of a level, from west to east: only what leads there is read.
    pub fn row(&self, level: u8, y: u32) -> Result<Vec<u32>> {
        let mut columns = Vec::new();
        self.row_from(TileId::ROOT, &self.root, (level, y), &mut columns)?;
        columns.sort_unstable();
        Ok(columns)
    }

    fn row_from(
        &self,
        id: TileId,
        page: &Loaded,
        (level, y): (u8, u32),
        columns: &mut Vec<u32>,
    ) -> Result<()> {
        let loaded;
        let (page, found) = match page.page.find(id) {
            Found::Below(root, place) => {
                loaded = self.page(root, place, page.offset)?;
                (&*loaded, loaded.page.find(id))
            }
            found => (page, found),
        };
        let Found::Tile(entry) = found else { return Ok(()) };
        if id.level == level {
            columns.push(id.x);
            return self.check_counts(columns.len() as u64, 0, false);
        }
        let leads_there = |child: &TileId| y >> (level - child.level) == child.y;
        let children: Vec<_> = entry.child_ids().filter(leads_there).collect();
        children.into_iter().try_for_each(|child| self.row_from(child, page, (level, y), columns))
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

    /// Fails if a walk has seen more than there is, or, at its end, not all of it.
    fn check_counts(&self, tiles: u64, bytes: u64, end: bool) -> Result<()> {
        let counts = [
            ("tiles in the index", tiles, self.header().tile_count),
            ("bytes of all chunks in the index", bytes, self.tiles.length),
        ];
        for (what, got, expected) in counts {
            if got > expected || (end && got < expected) {
                return Err(Error::format(what, expected, got).at(&self.path));
            }
        }
        Ok(())
    }

    fn walk_from(
        &self,
        id: TileId,
        page: &Loaded,
        to_level: u8,
        visit: &mut dyn FnMut(&TileEntry) -> Result<()>,
    ) -> Result<()> {
        let loaded;
        let (page, found) = match page.page.find(id) {
            Found::Below(root, place) => {
                loaded = self.page(root, place, page.offset)?;
                (&*loaded, loaded.page.find(id))
            }
            found => (page, found),
        };
        let Found::Tile(entry) = found else { return Ok(()) };
        visit(entry)?;
        if id.level >= to_level {
            return Ok(());
        }
        let mut children: Vec<_> = entry.child_ids().collect();
        children.sort_by_key(|child| child.hilbert());
        children.into_iter().try_for_each(|child| self.walk_from(child, page, to_level, visit))
    }
}
