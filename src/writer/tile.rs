//! What a writer is given, and what it reports: tiles with their chunks; sizes.

use std::path::PathBuf;

use crate::container::directory::{ChunkPlace, TileEntry};
use crate::tile::TileId;

/// What the index says of a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileRecord {
    /// Which tile.
    pub id: TileId,
    /// Bit `q` is set if child `q` exists.
    pub children: u8,
    /// True if the tile's own lattice has a valid sample.
    pub has_valid: bool,
    /// True if it has a void one.
    pub has_void: bool,
    /// Error code: the largest vertical error of its patches at step 0.
    pub vertical: u16,
    /// Error code: the largest horizontal error likewise.
    pub horizontal: u16,
    /// Lowest height in metres of what is below, rounded down.
    pub min_m: f32,
    /// Greatest height in metres, rounded up.
    pub max_m: f32,
}

/// The chunks of a tile as they are stored.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TileChunks {
    /// Heights (section 9); empty if all residuals are 0.
    pub heights: Vec<u8>,
    /// Void mask (section 8); empty unless the tile has valid and void samples.
    pub mask: Vec<u8>,
    /// Error table (section 10).
    pub errors: Vec<u8>,
}

/// What a level takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LevelBytes {
    /// Tiles.
    pub tiles: u64,
    /// Bytes of their heights.
    pub heights: u64,
    /// Bytes of their masks.
    pub masks: u64,
    /// Bytes of their error tables.
    pub errors: u64,
}

impl LevelBytes {
    /// Bytes of all chunks.
    pub fn bytes(self) -> u64 {
        self.heights + self.masks + self.errors
    }
}

/// What was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileSummary {
    /// The file.
    pub path: PathBuf,
    /// Its length.
    pub file_bytes: u64,
    /// Tiles of all levels.
    pub tiles: u64,
    /// The levels, root first.
    pub levels: Vec<LevelBytes>,
    /// Bytes of the index as stored.
    pub index_bytes: u64,
    /// Bytes of the metadata section.
    pub metadata_bytes: u64,
    /// Bytes of the statistics section as stored.
    pub statistics_bytes: u64,
    /// Bytes of the imagery layer.
    pub imagery_bytes: u64,
}

impl TileRecord {
    /// The row of the index of this tile, whose chunks lie at a place.
    pub(super) fn entry(&self, chunks: ChunkPlace) -> TileEntry {
        TileEntry {
            id: self.id,
            children: self.children,
            has_valid: self.has_valid,
            has_void: self.has_void,
            vertical: self.vertical,
            horizontal: self.horizontal,
            min_m: self.min_m,
            max_m: self.max_m,
            chunks,
        }
    }
}
