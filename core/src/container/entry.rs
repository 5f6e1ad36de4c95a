//! The rows of the heights' index (section 6 of the specification): one a tile, with everything
//! about it but its content.

use super::bytes::Bytes;
use super::directory::{Row, column, encode_columns, existing_children};
use super::layout::MAX_LEVEL;
use crate::error::{Error, Result};
use crate::error_code;
use crate::tile::TileId;

const HAS_VALID: u8 = 1;
const HAS_VOID: u8 = 2;

/// The kinds of chunks of a tile, in the order in which they are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ChunkKind {
    /// Heights, section 9.
    Heights = 0,
    /// Void mask, section 8.
    Mask = 1,
    /// Error table, section 10.
    Errors = 2,
}

impl ChunkKind {
    /// All kinds, in order.
    pub const ALL: [Self; 3] = [Self::Heights, Self::Mask, Self::Errors];

    /// Its name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Heights => "heights",
            Self::Mask => "mask",
            Self::Errors => "errors",
        }
    }
}

/// Where the chunks of a tile are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChunkPlace<const N: usize = 3> {
    /// Offset of the first chunk from the start of the tiles section.
    pub offset: u64,
    /// Bytes of each chunk in order: of heights by [`ChunkKind`].
    pub lengths: [u32; N],
    /// CRC of each chunk as stored.
    pub crcs: [u32; N],
}

impl<const N: usize> Default for ChunkPlace<N> {
    fn default() -> Self {
        Self { offset: 0, lengths: [0; N], crcs: [0; N] }
    }
}

impl<const N: usize> ChunkPlace<N> {
    /// Bytes of all chunks.
    pub fn bytes(&self) -> u64 {
        self.lengths.iter().map(|&length| u64::from(length)).sum()
    }

    /// Offset (from the start of the tiles section), length and CRC of chunk `index`, which is
    /// below `N`.
    pub fn at(&self, index: usize) -> (u64, u32, u32) {
        let before: u64 = self.lengths.iter().take(index).map(|&length| u64::from(length)).sum();
        (self.offset.saturating_add(before), self.lengths[index], self.crcs[index])
    }
}

impl ChunkPlace {
    /// Offset (from the start of the tiles section), length and CRC of one chunk.
    pub fn chunk(&self, kind: ChunkKind) -> (u64, u32, u32) {
        self.at(kind as usize)
    }
}

/// A row of the index: everything about a tile but its content.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileEntry {
    /// Which tile.
    pub id: TileId,
    /// Bit `q` is set if child `q` exists; 0 for a leaf.
    pub children: u8,
    /// True if the tile's own lattice has a valid sample.
    pub has_valid: bool,
    /// True if the tile's own lattice has a void sample.
    pub has_void: bool,
    /// Error code: the largest vertical error of its patches at step 0.
    pub vertical: u16,
    /// Error code: the largest horizontal error of its patches at step 0.
    pub horizontal: u16,
    /// Lowest height, in metres, of the full resolution below the tile, rounded down.
    pub min_m: f32,
    /// Greatest height below it, rounded up.
    pub max_m: f32,
    /// Where its chunks are stored.
    pub chunks: ChunkPlace,
}

impl TileEntry {
    /// True if no child exists.
    pub fn is_leaf(&self) -> bool {
        self.children == 0
    }

    /// True if child `quadrant` exists.
    pub fn has_child(&self, quadrant: u8) -> bool {
        self.children >> quadrant & 1 != 0
    }

    /// The children that exist, by quadrant.
    pub fn child_ids(&self) -> impl Iterator<Item = TileId> + use<> {
        existing_children(self.id, self.children)
    }

    /// Vertical error in metres.
    pub fn vertical_m(&self) -> f32 {
        error_code::metres_from_code(self.vertical)
    }

    /// Horizontal error in metres.
    pub fn horizontal_m(&self) -> f32 {
        error_code::metres_from_code(self.horizontal)
    }

    /// Fails if the row contradicts itself.
    pub fn check(&self) -> Result<()> {
        let demand = |is: bool, expected: &str, got: String| {
            if is {
                Ok(())
            } else {
                Err(Error::format(format!("index row of tile {}", self.id), expected, got))
            }
        };
        demand(self.children < 16, "children in bits 0 to 3", format!("{:#x}", self.children))?;
        demand(self.has_valid || self.has_void, "valid or void samples", "neither".into())?;
        let worst = self.vertical.max(self.horizontal);
        demand(worst <= error_code::MAX_CODE, "error codes up to 0xFF00", format!("{worst:#06x}"))?;
        let range = format!("{} to {}", self.min_m, self.max_m);
        demand(self.min_m <= self.max_m, "a height range", range)?;
        let [heights, mask, errors] = self.chunks.lengths;
        demand(errors > 0, "an error table", "none".into())?;
        let mixed = self.has_valid && self.has_void;
        let expected = if mixed { "a mask" } else { "no mask" };
        demand((mask > 0) == mixed, expected, format!("one of {mask} bytes"))?;
        let [heights_crc, mask_crc, _] = self.chunks.crcs;
        let absent = |length: u32, crc: u32| length > 0 || crc == 0;
        demand(absent(heights, heights_crc) && absent(mask, mask_crc), "CRC 0 of no bytes", "another".into())
    }
}

impl Row for TileEntry {
    const BYTES: usize = 46;
    const LAYER: &'static str = "";
    const MAX_LEVEL: u8 = MAX_LEVEL;

    fn id(&self) -> TileId {
        self.id
    }

    fn children(&self) -> u8 {
        self.children
    }

    fn offset(&self) -> u64 {
        self.chunks.offset
    }

    fn set_offset(&mut self, offset: u64) {
        self.chunks.offset = offset;
    }

    fn lengths(&self) -> &[u32] {
        &self.chunks.lengths
    }

    fn encode(rows: &[Self], out: &mut Vec<u8>) {
        let flags = |entry: &Self| {
            (if entry.has_valid { HAS_VALID } else { 0 }) | (if entry.has_void { HAS_VOID } else { 0 })
        };
        out.extend(rows.iter().map(flags));
        encode_columns(rows, out, |entry| entry.vertical.to_le_bytes());
        encode_columns(rows, out, |entry| entry.horizontal.to_le_bytes());
        encode_columns(rows, out, |entry| entry.min_m.to_le_bytes());
        encode_columns(rows, out, |entry| entry.max_m.to_le_bytes());
        encode_columns(rows, out, |entry| entry.chunks.offset.to_le_bytes());
        for kind in 0..3 {
            encode_columns(rows, out, |entry| entry.chunks.lengths[kind].to_le_bytes());
        }
        for kind in 0..3 {
            encode_columns(rows, out, |entry| entry.chunks.crcs[kind].to_le_bytes());
        }
    }

    fn decode(bytes: &mut Bytes, ids: &[TileId], children: &[u8]) -> Result<Vec<Self>> {
        let count = ids.len();
        let flags = bytes.take(count)?;
        let vertical = column(bytes, count, Bytes::u16)?;
        let horizontal = column(bytes, count, Bytes::u16)?;
        let min_m = column(bytes, count, Bytes::f32)?;
        let max_m = column(bytes, count, Bytes::f32)?;
        let offset = column(bytes, count, Bytes::u64)?;
        let mut six = || column(bytes, count, Bytes::u32);
        let lengths = [six()?, six()?, six()?];
        let crcs = [six()?, six()?, six()?];
        let mut tiles = Vec::with_capacity(count);
        for (index, &id) in ids.iter().enumerate() {
            if flags[index] & !(HAS_VALID | HAS_VOID) != 0 {
                return Err(Error::format(format!("index row of tile {id}"), "flags 1 to 3", flags[index]));
            }
            let entry = Self {
                id,
                children: children[index],
                has_valid: flags[index] & HAS_VALID != 0,
                has_void: flags[index] & HAS_VOID != 0,
                vertical: vertical[index],
                horizontal: horizontal[index],
                min_m: min_m[index],
                max_m: max_m[index],
                chunks: ChunkPlace {
                    offset: offset[index],
                    lengths: lengths.each_ref().map(|column| column[index]),
                    crcs: crcs.each_ref().map(|column| column[index]),
                },
            };
            entry.check()?;
            tiles.push(entry);
        }
        Ok(tiles)
    }
}
