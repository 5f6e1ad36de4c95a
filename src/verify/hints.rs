//! Checks hints of the format: writers may give them to make readers faster, and they must not be
//! wrong.
//!
//! Bit 0 of a heights chunk ("narrow") lets a reader predict in 32 bits. The decoded tile must not
//! depend on whether it does. (In version 1 of the format it may: readers must respect the bit
//! there.)

use super::report::{Check, Place};
use crate::codec::{Scratch, height};
use crate::container::directory::TileEntry;
use crate::container::layout::Header;
use crate::error::Result;
use crate::sample::Lattice;
use crate::tile::TileId;

/// Bit 0 of the flags of a heights chunk.
const NARROW: u8 = 1;

/// Decodes a tile's heights once more without the hint and compares them with `lattice`, decoded
/// with it.
pub(super) fn check_narrow(
    header: &Header,
    entry: &TileEntry,
    heights: &[u8],
    lattice: &Lattice,
    check: &mut Check,
) -> Result<()> {
    if header.version < 2 {
        return Ok(());
    }
    let Some(&flags) = heights.first().filter(|&&flags| flags & NARROW != 0) else { return Ok(()) };
    let mut plain = heights.to_vec();
    plain[0] = flags & !NARROW;
    let mut again = lattice.clone();
    let root = entry.id == TileId::ROOT;
    let decoded = height::decode(&plain, &mut again, header.coding, root, &mut Scratch::default());
    let place = Place::tile(entry.id).part("heights");
    if check.take(decoded, place.clone())?.is_none() {
        return Ok(());
    }
    if let Some(at) = (0..again.code.len()).find(|&at| again.code[at] != lattice.code[at]) {
        let (x, y) = ((at % (lattice.n + 1)) as u64, (at / (lattice.n + 1)) as u64);
        let spacing = u64::from(header.spacing(entry.id.level));
        let (left, top) = header.origin(entry.id);
        let expected = format_args!("code {}, as without the flag \"narrow\"", again.code[at]);
        let place = place.sample(left + x * spacing, top + y * spacing);
        check.fail(place, expected, format_args!("code {}", lattice.code[at]));
    }
    Ok(())
}
