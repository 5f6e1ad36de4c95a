//! Checks the imagery layer: checksum and place of every chunk, every decoded tile, and the header
//! against the tiles.

use rayon::prelude::*;

use super::VerifyOptions;
use super::report::{Check, Place};
use crate::container::imagery::ImageryEntry;
use crate::container::reader::ImageryLayer;
use crate::error::Result;
use crate::progress::{Progress, Stage};

/// Tiles between checks for cancellation.
const BATCH: usize = 256;

/// Checks that tiles follow one another in storage order, and decode to texels of the size and kind
/// in the header.
pub(super) fn tiles(layer: &ImageryLayer, options: &VerifyOptions, progress: &dyn Progress) -> Result<Check> {
    let mut check = Check::new("imagery tiles", "tiles", options.keep);
    let mut entries = Vec::new();
    let walked = layer.walk(&mut |entry| {
        entries.push(*entry);
        Ok(())
    });
    check.take(walked, Place::of("imagery index"))?;
    entries.sort_by_cached_key(|entry| (entry.id.level, entry.id.hilbert()));
    check_places(&entries, &mut check);
    let deepest = entries.last().map_or(0, |entry| entry.id.level);
    let leaf = layer.header().leaf;
    check.demand(deepest == leaf, || Place::of("imagery header"), format_args!("leaf level {deepest}"), leaf);
    let (mut done, mut clear) = (0, false);
    for batch in entries.chunks(BATCH) {
        let parts: Vec<(Check, bool)> =
            batch.par_iter().map(|entry| tile(layer, entry, check.part())).collect::<Result<_>>()?;
        for (part, is_clear) in parts {
            check.join(part);
            clear |= is_clear;
        }
        done += batch.len() as u64;
        progress.step(Stage::Imagery, done, entries.len() as u64)?;
    }
    if check.problems == 0 {
        let (expected, got) = (clear, layer.header().alpha);
        check.demand(expected == got, || Place::of("imagery header, alpha"), expected, got);
    }
    Ok(check)
}

/// Checks that chunks follow one another in storage order without gaps.
fn check_places(entries: &[ImageryEntry], check: &mut Check) {
    let mut end = 0;
    for entry in entries {
        let offset = entry.chunks.offset;
        let place = || Place::tile(entry.id).part("imagery");
        check.demand(offset == end, place, format_args!("chunks at offset {end}"), offset);
        end = offset.saturating_add(entry.chunks.bytes());
    }
}

/// Checks one tile; returns true if it has a texel that is not opaque.
fn tile(layer: &ImageryLayer, entry: &ImageryEntry, mut check: Check) -> Result<(Check, bool)> {
    check.looked_at = 1;
    let place = Place::tile(entry.id).part("imagery");
    let texels = check.take(layer.read_tile(entry.id), place.clone())?;
    let Some(alpha) = texels.and_then(|texels| texels.alpha) else { return Ok((check, false)) };
    let (side, gutter) = (layer.header().side(), usize::from(layer.header().gutter));
    let rows = alpha.chunks_exact(side).skip(gutter).take(side - 2 * gutter);
    let visible = rows.flat_map(|row| &row[gutter..side - gutter]).any(|&a| a > 0);
    check.demand(visible, || place, "a texel that is not wholly transparent", "none");
    Ok((check, alpha.iter().any(|&a| a != 255)))
}
