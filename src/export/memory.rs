//! Memory of an export: chooses rows of tiles, fewer rows, or large blocks within a limit, or says
//! how much is needed at least.

use super::sparse::Blocks;
use super::{BAND_BYTES, VALUE_BYTES, Void};
use crate::container::reader::Reader;
use crate::error::{Error, Result};
use crate::geotiff_write::{GeotiffSpec, GeotiffWriter};
use crate::pipeline::memory::{PROGRAM, THREAD, within};
use crate::sample::SampleType;

/// Bytes of samples from which on voids are left out of the file.
const SPARSE_FROM: u64 = 1 << 30;
/// Most bands that a row of tiles is cut into: each decodes its tiles again.
const MOST_BANDS: u64 = 16;
/// Bytes of blocks that are made at a time, if there is no limit.
const AT_ONCE: u64 = 256 << 20;
/// Bytes for the validity of a sample on its way to the file.
const MASKED: u64 = 1;

/// How a level is written.
pub(super) enum WriteMode {
    /// In bands of at most this many rows.
    Bands(u32),
    /// In blocks, within this many bytes at a time.
    Blocks(Blocks, u64),
}

/// Part of a level that is exported.
#[derive(Clone, Copy)]
pub(super) struct Extract {
    pub level: u8,
    pub columns: u32,
    pub rows: u32,
}

/// Bytes of everything but the samples.
pub(super) fn fixed(reader: &Reader, threads: usize) -> u64 {
    PROGRAM + rayon::current_num_threads() as u64 * THREAD + reader.memory(threads)
}

/// Fails if a PNG or a tile exceeds the reader's memory limit.
pub(super) fn check(reader: &Reader, what: &str, bytes: u64) -> Result<()> {
    let needed = fixed(reader, 1).saturating_add(bytes);
    within(reader.memory_limit(), needed, || {
        (format!("{what} of {}", reader.path().display()), "choose a coarser level, or a part of it")
    })
}

/// The most rows of a band, at `each` bytes a sample, within `limit` bytes: those of a tile, or
/// 1/2, 1/4 .. 1/16 of them. `None` if 1/16 is still too much.
pub(super) fn band_rows(reader: &Reader, extract: Extract, each: u64, limit: u64) -> Option<u32> {
    let tile = reader.header().tile();
    let mut rows = std::iter::successors(Some(tile), |rows| Some(rows / 2))
        .take_while(|&rows| rows > 0 && u64::from(tile / rows) <= MOST_BANDS);
    rows.find(|&rows| band_bytes(extract, rows, each) <= limit)
}

/// Bytes of a band. The last row of tiles also owns its lower border.
fn band_bytes(extract: Extract, rows: u32, each: u64) -> u64 {
    u64::from(extract.columns) * (u64::from(rows) + 1).min(extract.rows.into()) * each
}

/// How to write a GeoTIFF of a level, or of a part of one (never in blocks), within the reader's
/// memory limit.
///
/// # Errors
/// [`Error::Usage`] if that is not enough, [`Error::Limit`] if it is too wide.
pub(super) fn way(
    reader: &Reader,
    extract: Extract,
    void: Void,
    spec: &GeotiffSpec,
    part: bool,
) -> Result<WriteMode> {
    let (header, masked) = (reader.header(), matches!(void, Void::Mask));
    let sample = header.source_type.bytes() as u64;
    let each = VALUE_BYTES + sample + if masked { MASKED } else { 0 };
    let for_bands = fixed(reader, 1).saturating_add(GeotiffWriter::memory(spec));
    let blocks = || -> Result<Blocks> {
        Blocks::new(extract.level, header.tile(), (extract.columns, extract.rows), sample)
    };
    let for_blocks = |blocks: &Blocks| {
        fixed(reader, rayon::current_num_threads()).saturating_add(blocks.fixed(reader.header().tile_count))
    };
    let may_be_blocks = !part && !masked;
    let sparse = may_be_blocks && is_sparse(reader, extract)?;
    let wide =
        band_bytes(extract, header.tile(), VALUE_BYTES) > if part { 4 * BAND_BYTES } else { BAND_BYTES };
    let Some(limit) = reader.memory_limit() else {
        if may_be_blocks && (sparse || wide) {
            let blocks = blocks()?;
            return Ok(WriteMode::Blocks(blocks, AT_ONCE));
        }
        let most = if part { 4 * BAND_BYTES } else { BAND_BYTES };
        return band_rows(reader, extract, VALUE_BYTES, most)
            .map(WriteMode::Bands)
            .ok_or_else(|| too_wide(extract, header.tile(), most));
    };
    let room = limit.saturating_sub(for_bands);
    let bands =
        if for_bands < limit { band_rows(reader, extract, each, room.min(4 * BAND_BYTES)) } else { None };
    if bands == Some(header.tile()) && !sparse {
        return Ok(WriteMode::Bands(header.tile()));
    }
    let mut least =
        for_bands.saturating_add(band_bytes(extract, (header.tile() / MOST_BANDS as u32).max(1), each));
    if may_be_blocks && let Ok(blocks) = blocks() {
        let needed = for_blocks(&blocks).saturating_add(blocks.bytes(header.tile_count));
        if needed <= limit {
            let at_once = (limit - for_blocks(&blocks)).min(AT_ONCE);
            return Ok(WriteMode::Blocks(blocks, at_once));
        }
        least = least.min(needed);
    }
    if let Some(rows) = bands {
        return Ok(WriteMode::Bands(rows));
    }
    within(Some(limit), least.max(limit.saturating_add(1)), || {
        let (columns, rows, level) = (extract.columns, extract.rows, extract.level);
        let what = format!("an export of {columns} x {rows} samples of level {level}");
        (what, "choose a coarser level, or a part of it (a box, a tile)")
    })?;
    Err(too_wide(extract, header.tile(), limit))
}

/// True if a level is large enough to leave out voids, and mostly void.
fn is_sparse(reader: &Reader, extract: Extract) -> Result<bool> {
    let header = reader.header();
    let [columns, rows, tile] = [extract.columns, extract.rows, header.tile()].map(u64::from);
    let bytes = (columns * rows).saturating_mul(header.source_type.bytes() as u64);
    if bytes < SPARSE_FROM {
        return Ok(false);
    }
    let all = columns.div_ceil(tile) * rows.div_ceil(tile);
    Ok(reader.tiles(extract.level)?.len() as u64 * 4 <= all)
}

fn too_wide(extract: Extract, tile: u32, most: u64) -> Error {
    let rows = (tile / MOST_BANDS as u32).max(1);
    let what = "bytes of a few rows of samples (choose a coarser level, one tile, or a narrower box)";
    Error::limit(what, band_bytes(extract, rows, VALUE_BYTES), most)
}

/// Bytes for a PNG of `pixel` bytes a pixel: the pixels, and the PNG, which may be as large.
pub(super) fn of_png(columns: u32, rows: u32, pixel: u64) -> u64 {
    u64::from(columns) * u64::from(rows) * 3 * pixel + (2 << 20)
}

/// Bytes for a shaded PNG: heights and pixels, after the rows of tiles.
pub(super) fn of_relief(extract: Extract, rows: u32) -> u64 {
    let heights = u64::from(extract.columns) * u64::from(extract.rows) * 4;
    let band = band_bytes(extract, rows, VALUE_BYTES);
    heights.saturating_add(band).saturating_add(of_png(extract.columns, extract.rows, 4))
}

/// Bytes for a tile of heights: values, samples, and the encoded file.
pub(super) fn of_tile(tile: u32, kind: SampleType) -> u64 {
    (u64::from(tile) + 1).pow(2) * (VALUE_BYTES + 8 * kind.bytes().max(2) as u64)
}
