//! The list of tiles in a work folder: one row for each tile, with a checksum.
//!
//! A row is appended with every tile. The list is read back when a build is resumed or a piece is
//! merged. It is not part of the container format.

use wincode::{SchemaRead, SchemaWrite};

use crate::TileId;
use crate::container::directory::{ChunkPlace, TileEntry};
use crate::error::{Error, Result};

/// Bytes of what a row says.
const SAYS: usize = 55;
/// Bytes of one row: what it says, and the CRC of that.
pub(super) const BYTES: usize = SAYS + 4;

/// What a row says, as it is stored.
#[derive(SchemaRead, SchemaWrite)]
struct Row {
    level: u8,
    x: u32,
    y: u32,
    children: u8,
    /// Bit 0: the tile has a valid sample; bit 1: it has a void one.
    flags: u8,
    vertical: u16,
    horizontal: u16,
    min_m: f32,
    max_m: f32,
    offset: u64,
    lengths: [u32; 3],
    crcs: [u32; 3],
}

/// A row as bytes, little endian.
pub(super) fn encode(entry: &TileEntry) -> Result<[u8; BYTES]> {
    let row = Row {
        level: entry.id.level,
        x: entry.id.x,
        y: entry.id.y,
        children: entry.children,
        flags: u8::from(entry.has_valid) | u8::from(entry.has_void) << 1,
        vertical: entry.vertical,
        horizontal: entry.horizontal,
        min_m: entry.min_m,
        max_m: entry.max_m,
        offset: entry.chunks.offset,
        lengths: entry.chunks.lengths,
        crcs: entry.chunks.crcs,
    };
    let mut out = [0; BYTES];
    wincode::serialize_into(&mut out[..SAYS], &row)
        .map_err(|error| Error::usage(format!("a tile cannot be listed: {error}")))?;
    let crc = crc32fast::hash(&out[..SAYS]);
    out[SAYS..].copy_from_slice(&crc.to_le_bytes());
    Ok(out)
}

/// The inverse of [`encode`].
pub(super) fn decode(bytes: &[u8; BYTES]) -> Result<TileEntry> {
    let (says, crc) = bytes.split_at(SAYS);
    if crc32fast::hash(says).to_le_bytes() != *crc {
        return Err(Error::format(
            "list of tiles of an unfinished build",
            "the bytes that were written",
            "damaged ones; begin anew by `force`",
        ));
    }
    let row: Row = wincode::deserialize_exact(says)
        .map_err(|error| Error::format("row of the work folder", "what this program writes", error))?;
    if row.flags > 3 {
        return Err(Error::format("row of the work folder", "flags 0 to 3", row.flags));
    }
    let entry = TileEntry {
        id: TileId::new(row.level, row.x, row.y),
        children: row.children,
        has_valid: row.flags & 1 != 0,
        has_void: row.flags & 2 != 0,
        vertical: row.vertical,
        horizontal: row.horizontal,
        min_m: row.min_m,
        max_m: row.max_m,
        chunks: ChunkPlace { offset: row.offset, lengths: row.lengths, crcs: row.crcs },
    };
    entry.check()?;
    Ok(entry)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry() -> TileEntry {
        TileEntry {
            id: TileId::new(9, 300, 511),
            children: 5,
            has_valid: true,
            has_void: true,
            vertical: 0x1234,
            horizontal: 0xFE01,
            min_m: -12.5,
            max_m: 8848.0,
            chunks: ChunkPlace { offset: 1 << 40 | 7, lengths: [1, 2, 3], crcs: [4, 5, u32::MAX] },
        }
    }

    #[test]
    fn rows_come_back() {
        assert_eq!(decode(&encode(&entry()).expect("bytes")).expect("row"), entry());
    }

    #[test]
    fn a_damaged_row_is_refused() {
        for bit in 0..8 * BYTES {
            let mut row = encode(&entry()).expect("bytes");
            row[bit / 8] ^= 1 << (bit % 8);
            assert!(decode(&row).is_err(), "bit {bit}");
        }
    }
}
