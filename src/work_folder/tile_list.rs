//! The list of tiles in a work folder: one row for each tile, with a checksum.
//!
//! A row is appended with every tile. The list is read back when a build is resumed or a piece is
//! merged. It is not part of the container format.

use crate::TileId;
use crate::container::directory::{ChunkPlace, TileEntry};
use crate::error::{Error, Result};

/// Bytes of what a row says.
const SAYS: usize = 55;
/// Bytes of one row: what it says, and the CRC of that.
pub(super) const BYTES: usize = SAYS + 4;

/// A row as bytes, little endian.
pub(super) fn encode(entry: &TileEntry) -> [u8; BYTES] {
    let mut out = [0; BYTES];
    let mut at = 0;
    let mut put = |bytes: &[u8]| {
        out[at..at + bytes.len()].copy_from_slice(bytes);
        at += bytes.len();
    };
    put(&[entry.id.level]);
    put(&entry.id.x.to_le_bytes());
    put(&entry.id.y.to_le_bytes());
    put(&[entry.children, u8::from(entry.has_valid) | u8::from(entry.has_void) << 1]);
    put(&entry.vertical.to_le_bytes());
    put(&entry.horizontal.to_le_bytes());
    put(&entry.min_m.to_le_bytes());
    put(&entry.max_m.to_le_bytes());
    put(&entry.chunks.offset.to_le_bytes());
    for number in entry.chunks.lengths.into_iter().chain(entry.chunks.crcs) {
        put(&number.to_le_bytes());
    }
    let crc = crc32fast::hash(&out[..SAYS]);
    out[SAYS..].copy_from_slice(&crc.to_le_bytes());
    out
}

/// The inverse of [`encode`].
pub(super) fn decode(bytes: &[u8; BYTES]) -> Result<TileEntry> {
    let u16_at = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
    let u32_at = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let three = |at: usize| [u32_at(at), u32_at(at + 4), u32_at(at + 8)];
    if crc32fast::hash(&bytes[..SAYS]) != u32_at(SAYS) {
        return Err(Error::format(
            "list of tiles of an unfinished build",
            "the bytes that were written",
            "damaged ones; begin anew with --force",
        ));
    }
    let entry = TileEntry {
        id: TileId::new(bytes[0], u32_at(1), u32_at(5)),
        children: bytes[9],
        has_valid: bytes[10] & 1 != 0,
        has_void: bytes[10] & 2 != 0,
        vertical: u16_at(11),
        horizontal: u16_at(13),
        min_m: f32::from_bits(u32_at(15)),
        max_m: f32::from_bits(u32_at(19)),
        chunks: ChunkPlace {
            offset: u64::from(u32_at(23)) | u64::from(u32_at(27)) << 32,
            lengths: three(31),
            crcs: three(43),
        },
    };
    if bytes[10] > 3 {
        return Err(Error::format("row of the work folder", "flags 0 to 3", bytes[10]));
    }
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
        assert_eq!(decode(&encode(&entry())).expect("row"), entry());
    }

    #[test]
    fn a_damaged_row_is_refused() {
        for bit in 0..8 * BYTES {
            let mut row = encode(&entry());
            row[bit / 8] ^= 1 << (bit % 8);
            assert!(decode(&row).is_err(), "bit {bit}");
        }
    }
}
