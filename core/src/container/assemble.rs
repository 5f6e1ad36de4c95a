//! The index of a writer: one row a tile while it grows, then a checked, placed and packed tree.
//!
//! Tiles come in any order. Then [`Tree::check`] tests that they are a tree, [`Tree::place`] sorts
//! them into storage order, and [`Tree::pages`] cuts the index into pages. Pages are built from the
//! leaves up: a page names the CRC of those below it.

use std::collections::HashMap;

use super::directory::{self, IndexPage, PageRef, Quadtree, Row, TileEntry, existing_children};
use crate::codec::frame;
use crate::error::{Error, Result};
use crate::tile::TileId;

/// The place of errors: tiles come from a builder, or from the list in a piece that is merged.
const PLACE: &str = "list of tiles";

/// Rows of one level.
struct Rows<R> {
    entries: Vec<R>,
    index: HashMap<(u32, u32), usize>,
}

impl<R> Default for Rows<R> {
    fn default() -> Self {
        Self { entries: Vec::new(), index: HashMap::new() }
    }
}

/// The rows of all tiles appended so far.
pub struct Tree<R = TileEntry> {
    levels: Vec<Rows<R>>,
}

impl<R> Default for Tree<R> {
    fn default() -> Self {
        Self { levels: Vec::new() }
    }
}

/// The packed index.
pub struct PackedIndex {
    /// The root page as stored.
    pub root: Vec<u8>,
    /// All other pages as stored, one after the other.
    pub pages: Vec<u8>,
}

impl<R: Row> Tree<R> {
    /// Fails if this tile cannot be added: it is outside the square of its level, or has a row
    /// already.
    pub fn check_new(&self, id: TileId) -> Result<()> {
        if id.level > R::MAX_LEVEL || id.x >> id.level != 0 || id.y >> id.level != 0 {
            let side = 1_u64 << id.level.min(R::MAX_LEVEL);
            let expected = format!("tiles within the {side} x {side} of their level");
            return Err(Error::format(PLACE, expected, format!("tile {id}, which is outside")));
        }
        let Some(rows) = self.levels.get(usize::from(id.level)) else { return Ok(()) };
        let Some(first) = rows.index.get(&(id.x, id.y)) else { return Ok(()) };
        let (first, again) = (first + 1, rows.entries.len() + 1);
        let got = format!("tile {id} came twice: number {first} and number {again} of its level");
        Err(Error::format(PLACE, "every tile once", got))
    }

    /// Adds a row that [`Tree::check_new`] has passed.
    pub fn push(&mut self, entry: R) {
        let id = entry.id();
        let level = usize::from(id.level);
        if self.levels.len() <= level {
            self.levels.resize_with(level + 1, Rows::default);
        }
        let rows = &mut self.levels[level];
        rows.index.insert((id.x, id.y), rows.entries.len());
        rows.entries.push(entry);
    }

    /// How many rows there are.
    pub fn count(&self) -> u64 {
        self.levels.iter().map(|rows| rows.entries.len() as u64).sum()
    }

    /// The rows of a level.
    pub fn level(&self, level: u8) -> &[R] {
        self.levels.get(usize::from(level)).map_or(&[], |rows| &rows.entries)
    }

    fn get(&self, id: TileId) -> Option<&R> {
        let rows = self.levels.get(usize::from(id.level))?;
        rows.entries.get(*rows.index.get(&(id.x, id.y))?)
    }

    /// Fails unless the rows are one tree within the raster: every child that a row names has a
    /// row, and no other tile has.
    pub fn check(&self, tree: &impl Quadtree) -> Result<()> {
        if self.get(TileId::ROOT).is_none() {
            return Err(Error::usage("there is no root tile: a container holds at least one valid sample"));
        }
        for entry in self.levels.iter().flat_map(|rows| &rows.entries) {
            let id = entry.id();
            if !tree.holds(id) {
                let leaf = tree.leaf();
                let what = format!("tile {id} is outside the raster, or below leaf level {leaf}");
                return Err(Error::usage(what));
            }
            if let Some(child) =
                existing_children(id, entry.children()).find(|&child| self.get(child).is_none())
            {
                return Err(Error::usage(format!("tile {id} names its child {child}, which did not come")));
            }
            let Some(parent) = id.parent() else { continue };
            if self.get(parent).is_none_or(|parent| parent.children() >> id.quadrant() & 1 == 0) {
                return Err(Error::usage(format!(
                    "tile {id} came, but its parent {parent} does not name it"
                )));
            }
        }
        Ok(())
    }

    /// How many levels have rows.
    pub fn depth(&self) -> usize {
        self.levels.len()
    }

    /// The rows of a level, whose ids must stay as they are.
    pub fn level_mut(&mut self, level: u8) -> &mut [R] {
        self.levels.get_mut(usize::from(level)).map_or(&mut [], |rows| &mut rows.entries)
    }

    /// Sorts every level into storage order.
    pub fn sort(&mut self) {
        for rows in &mut self.levels {
            rows.entries.sort_by_cached_key(|entry| entry.id().hilbert());
            for (place, entry) in rows.entries.iter().enumerate() {
                rows.index.insert((entry.id().x, entry.id().y), place);
            }
        }
    }

    /// Sorts every level into storage order and gives each tile its chunk offset in the tiles
    /// section. Returns the offsets that the rows had before, level by level in the new order, and
    /// the length of the section.
    pub fn place(&mut self) -> (Vec<Vec<u64>>, u64) {
        self.sort();
        let mut end = 0;
        let mut sources = Vec::new();
        for rows in &mut self.levels {
            let mut old = Vec::with_capacity(rows.entries.len());
            for entry in &mut rows.entries {
                old.push(entry.offset());
                entry.set_offset(end);
                end += entry.chunk_bytes();
            }
            sources.push(old);
        }
        (sources, end)
    }

    /// Packs the index: the pages of the deepest level first, each level in storage order, the root
    /// page apart.
    pub fn pages(&self, leaf: u8) -> Result<PackedIndex> {
        let mut pages = Vec::new();
        let mut below = HashMap::new();
        for level in (1..=leaf).rev().filter(|&level| directory::is_page_root(level, leaf)) {
            let mut these = HashMap::new();
            for entry in self.level(level) {
                let packed = self.pack(entry.id(), leaf, &below)?;
                let page = PageRef {
                    offset: pages.len() as u64,
                    length: packed.len() as u32,
                    crc: crc32fast::hash(&packed),
                };
                these.insert(entry.id(), page);
                pages.extend(packed);
            }
            below = these;
        }
        Ok(PackedIndex { root: self.pack(TileId::ROOT, leaf, &below)?, pages })
    }

    /// The page that begins with a tile, as stored; `below` holds the pages of the next page level.
    fn pack(&self, root: TileId, leaf: u8, below: &HashMap<TileId, PageRef>) -> Result<Vec<u8>> {
        let depth = directory::page_depth(root.level, leaf);
        let mut ids = vec![root];
        let mut tiles = Vec::new();
        for _ in 0..depth {
            let rows: Vec<_> = ids.iter().filter_map(|&id| self.get(id).copied()).collect();
            ids = rows.iter().flat_map(|row| existing_children(row.id(), row.children())).collect();
            tiles.extend(rows);
        }
        let pages = ids.iter().filter_map(|id| below.get(id).copied()).collect();
        let mut packed = Vec::new();
        frame::compress(&IndexPage::new(depth, tiles, pages).encode(), &mut packed)?;
        Ok(packed)
    }
}
