//! Most memory that a check takes, computed before any tile is read, and the way to read the source
//! within a limit.

use super::VerifyOptions;
use crate::container::layout::Header;
use crate::container::reader::Reader;
use crate::error::Result;
use crate::pipeline::memory::{Bands, PROGRAM, THREAD, THREAD_SAMPLE, within};
use crate::source::Source;

/// Bytes of the decoded values of a band, if there is no limit.
const BAND_BYTES: u64 = 256 << 20;
/// Bytes of a decoded value.
pub(super) const VALUE_BYTES: u64 = size_of::<Option<f64>>() as u64;
/// Most bands that a row of tiles is cut into: each decodes its tiles again.
const MOST_BANDS: u32 = 16;
/// Fewest columns of a part of a band: each part decodes the blocks and tiles at its sides again.
const LEAST_COLUMNS: u32 = 4096;
/// Bytes of a border sample.
const BORDER_SAMPLE: u64 = 12;
/// Tiles in memory at a time.
pub(super) const BATCH: usize = 64;
/// Bytes for each tile besides its samples: index row, checks, containers.
const EACH: u64 = 1 << 10;
/// Bytes of the counts of each level: errors by code, heights by bin.
const LEVEL: u64 = 256 << 10;
/// Bytes for each texel of an imagery tile while it is decoded.
const TEXEL: u64 = 32;
/// Bytes of an entry of the imagery's index, which is sorted as a whole.
const IMAGERY_ENTRY: u64 = 128;

/// Columns and rows of the source that are compared at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shape {
    pub columns: u32,
    pub rows: u32,
}

/// The way to read the source: in bands as high as a tile, or lower, or also in parts, as the limit
/// demands.
///
/// # Errors
/// [`crate::Error::Usage`] if the reader's limit of memory is not enough.
pub(super) fn shape(reader: &Reader, source: Option<&dyn Source>, options: &VerifyOptions) -> Result<Shape> {
    let (header, threads) = (reader.header(), rayon::current_num_threads());
    let fixed = fixed(reader, options, threads);
    let whole = Shape { columns: header.width, rows: header.tile() };
    let compared =
        source.map(Source::info).filter(|info| (info.width, info.height) == (header.width, header.height));
    let bands = compared.map(|info| Bands::new(info, header.tile()));
    let of = |shape: Shape| bands.as_ref().map_or(0, |bands| of_bands(header, bands, shape, threads));
    let all: Vec<Shape> = bands.as_ref().map_or_else(|| vec![whole], |bands| shapes(header, bands));
    let limit = reader.memory_limit();
    let fits = |shape: &&Shape| {
        let values = u64::from(shape.columns) * u64::from(shape.rows) * VALUE_BYTES;
        limit.map_or(values <= BAND_BYTES, |limit| fixed.saturating_add(of(**shape)) <= limit)
    };
    if let Some(shape) = all.iter().find(fits) {
        return Ok(*shape);
    }
    let least = all.iter().map(|shape| of(*shape)).min().unwrap_or(0);
    within(limit, fixed.saturating_add(least), || {
        let what = format!("a check of {} on {threads} threads", reader.path().display());
        let help = match (options.deep, source.is_some()) {
            (true, _) => "leave out the deep check",
            (_, true) => "leave out the source",
            _ => "use fewer threads",
        };
        (what, help)
    })?;
    Ok(all.last().copied().unwrap_or(whole))
}

/// The possible ways to read, from the fastest to the one that takes the least memory.
fn shapes(header: &Header, bands: &Bands) -> Vec<Shape> {
    let tile = header.tile();
    let widest = bands.columns.max(1) as u32;
    let halved = |rows: &u32| Some(rows / 2).filter(|&rows| rows > 0 && tile / rows <= MOST_BANDS);
    let rows = std::iter::successors(Some(tile), halved);
    let least = (tile / MOST_BANDS).max(1);
    let narrower = |columns: &u32| {
        Some((columns / 2).next_multiple_of(tile)).filter(|next| next < columns && *next >= LEAST_COLUMNS)
    };
    let columns = std::iter::successors(narrower(&widest), narrower);
    let bands = rows.map(|rows| Shape { columns: widest, rows });
    bands.chain(columns.map(|columns| Shape { columns, rows: least })).collect()
}

/// Bytes of the bands: values, samples, and the tiles they are assembled from.
fn of_bands(header: &Header, bands: &Bands, shape: Shape, threads: usize) -> u64 {
    let (columns, rows) = (u64::from(shape.columns), u64::from(shape.rows).min(header.height.into()));
    let tiles = (columns / u64::from(header.tile()) + 2).min(BATCH as u64);
    let values = columns.saturating_mul(rows).saturating_mul(VALUE_BYTES);
    values.saturating_add(bands.memory((columns, rows), threads)).saturating_add(tiles * lattice(header))
}

/// Bytes of a decoded tile.
fn lattice(header: &Header) -> u64 {
    samples(header) * if header.coding.has_low() { 9 } else { 5 } + EACH
}

fn samples(header: &Header) -> u64 {
    (u64::from(header.tile()) + 1).pow(2)
}

/// Bytes of everything but the source.
fn fixed(reader: &Reader, options: &VerifyOptions, threads: usize) -> u64 {
    let header = reader.header();
    let (patches, steps) = (u64::from(header.patches()).pow(2), u64::from(header.steps()));
    let table = patches * (4 * steps + 1) + EACH;
    let border = 4 * (u64::from(header.tile()) + 1) * BORDER_SAMPLE + EACH;
    let (tiles, levels) = (header.tile_count, u64::from(header.levels) + 1);
    let side =
        |samples: u32, level: u8| (u64::from(samples) >> (header.tile_log2 + header.levels - level)) + 1;
    // Tiles come in storage order, so borders that wait for a neighbour lie along the edge of the
    // part already read.
    let along = |level: u8| 4 * (side(header.width, level) + side(header.height, level));
    let waiting = (0..=header.levels).map(along).fold(0, u64::saturating_add).min(tiles);
    let batch = tiles.min(BATCH as u64);
    let mut bytes = PROGRAM + levels * (LEVEL + 2 * table);
    let of_threads = threads as u64 * (THREAD + samples(header) * THREAD_SAMPLE);
    let of_tiles = batch * (table + border).saturating_add(waiting.saturating_mul(border));
    for more in [reader.memory(threads), of_threads, of_tiles] {
        bytes = bytes.saturating_add(more);
    }
    if let Some(layer) = reader.imagery() {
        let header = layer.header();
        let texels = (u64::from(header.tile) + 2 * u64::from(header.gutter)).pow(2) * TEXEL;
        bytes = bytes.saturating_add(threads as u64 * texels + header.tiles.saturating_mul(IMAGERY_ENTRY));
    }
    let deep = options.deep && u64::from(header.width) * u64::from(header.height) <= options.max_deep_samples;
    if deep { bytes.saturating_add(of_deep(header, table)) } else { bytes }
}

/// Bytes of the deep check: code, low and state of each sample of full resolution, occupancy, fills
/// while they are computed, errors of all patches at a few spacings, and the error tables of all
/// tiles with their tightness.
fn of_deep(header: &Header, table: u64) -> u64 {
    let (columns, rows) = (u64::from(header.width) + 1, u64::from(header.height) + 1);
    let (all, patch) = (columns * rows, u64::from(header.patch()).pow(2));
    let errors = u64::from(header.patches()).pow(2) * u64::from(header.steps()) * 2;
    let each = if header.coding.has_low() { 9 } else { 5 } + 2;
    let fills = columns * rows.min(super::full::FILL_ROWS as u64) * 64;
    let grids = (all / patch + columns + rows) * 8 * 12;
    let tiles =
        header.tile_count.saturating_mul(2 * table + 4 * errors + 8 * errors / u64::from(header.levels + 1));
    (all * each).saturating_add(fills).saturating_add(grids).saturating_add(tiles)
}
