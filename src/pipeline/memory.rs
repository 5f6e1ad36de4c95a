//! How much memory a build takes at most, known before a sample is read; and constants that exports
//! and verification share with it.

use std::collections::BTreeSet;
use std::ops::Range;

use super::carry::AT_ONCE;
use super::occupied::Occupied;
use super::plan::Plan;
use super::window_levels::WindowLevels;
use crate::error::{Error, Result};
use crate::rect::Rect;
use crate::source::{ReadMemory, SourceInfo};

/// Bytes that the program takes before it has read a sample.
pub const PROGRAM: u64 = 24 << 20;
/// Bytes that a thread takes whatever the size of tiles: its stack, its part of the allocator,
/// buffers of the compression.
pub const THREAD: u64 = 3 << 19;
/// Bytes for each sample of a tile that a thread works in.
pub const THREAD_SAMPLE: u64 = 64;
/// Bytes of the index for each tile of the file: its row, where it is found, and its share of a
/// packed page.
const INDEX: u64 = 128;
/// Bytes that the parts of a tile take beside their content.
const EACH: u64 = 512;

/// Bytes of the parts of a tile that are kept.
struct Sizes {
    /// Samples.
    lattice: u64,
    /// Extremes and occupancy.
    blocks: u64,
    /// Its child summary without errors: a fourth of both.
    summary: u64,
    /// Errors of its child summary.
    errors: u64,
    /// A finished tile before it is written, if nothing of it can be compressed.
    finished: u64,
    /// Fills, if half of the samples get one.
    fills: u64,
}

impl Sizes {
    fn of(plan: &Plan) -> Self {
        let (n, patches) = (plan.pyramid.tile as u64, (plan.pyramid.tile / plan.patch) as u64);
        let steps = u64::from(plan.patch.trailing_zeros()) + 1;
        let sample = if plan.recipe.coding.has_low() { 9 } else { 5 };
        let samples = |n: u64| (n + 1) * (n + 1);
        let count = patches * patches;
        let vectors = 2 * (steps + u64::from(patches.trailing_zeros()));
        Self {
            lattice: samples(n) * sample + EACH,
            blocks: n * n * 9 + EACH,
            summary: samples(n / 2) * sample + n * n / 4 * 9 + EACH,
            errors: 16 * (count * steps + count / 3) + 40 * vectors,
            finished: samples(n) * plan.sample_bytes + n * n / 8 + count * (8 * steps + 2) + EACH,
            fills: samples(n) * 6,
        }
    }
}

/// Bytes of the samples of a tile.
pub fn of_lattice(plan: &Plan) -> u64 {
    Sizes::of(plan).lattice
}

/// Bytes of memory in use when the imagery layer over so many tiles of heights is begun.
pub fn beside_heights(tiles: u64, threads: usize) -> u64 {
    PROGRAM + threads as u64 * THREAD + tiles * INDEX
}

/// Fails if more bytes are `needed` than `limit`. `what` returns what takes them, and what helps.
pub fn within<T: Into<String>>(
    limit: Option<u64>,
    needed: u64,
    what: impl FnOnce() -> (String, T),
) -> Result<()> {
    let Some(limit) = limit.filter(|&limit| needed > limit) else { return Ok(()) };
    let ((what, help), mib) = (what(), needed.div_ceil(1 << 20));
    let (help, allowed) = (help.into(), limit as f64 / f64::from(1 << 20));
    Err(Error::usage(format!(
        "memory: {what} takes about {mib} MiB, and {allowed:.1} MiB are allowed; allow more, or {help}"
    )))
}

/// The memory that reading a raster in bands takes, for a reader that goes by the tiles of an
/// existing file.
pub struct Bands {
    reading: (ReadMemory, u32),
    size: (u32, u32),
    sample_bytes: u64,
    /// Most samples of a band that are read one beside the other, and in how many runs.
    pub columns: u64,
    runs: u64,
}

impl Bands {
    /// Of a source, of which only the parts are read that its footprint has, in tiles of `tile`
    /// samples.
    pub fn new(info: &SourceInfo, tile: u32) -> Self {
        let along = |samples: u32| samples.div_ceil(tile).max(1);
        let all = Rect { columns: 0..along(info.width), rows: 0..along(info.height) };
        let (tiles, runs) = Occupied::new(info.footprint.as_deref(), tile, &all).fullest(&all.columns);
        Self {
            reading: (info.reading, info.block_rows),
            size: (info.width, info.height),
            sample_bytes: info.sample_type.bytes() as u64,
            columns: (tiles * u64::from(tile) + 1).min(info.width.into()),
            runs,
        }
    }

    /// Bytes of memory that bands of so many columns and rows take at most.
    pub fn memory(&self, (columns, rows): (u64, u64), threads: usize) -> u64 {
        let (reading, block_rows) = self.reading;
        let window = columns.saturating_mul(rows).saturating_mul(reading.sample.max(self.sample_bytes));
        let blocks = reading.blocks((columns, self.runs), (rows, block_rows), self.size, threads as u64);
        window.saturating_add(blocks)
    }
}

/// Bytes of memory that a sweep over these columns of leaf tiles takes at most. It goes by the
/// tiles of each level's fullest row: N of the leaves, A of all levels together, U of those above
/// the leaves, M and V the most of one level among these.
///
/// - Lattices of `(T + 1)^2 s` bytes (s = 5, or 9 for float64): two rows of every level (north and
///   current), one more of the level that is worked on (south), one of leaves that is being read:
///   `2 A + M + N`.
/// - Blocks of `9 T^2` bytes: the rows above the leaves that are not finished, `U + V`.
/// - Child summaries, each a fourth of both: a row that waits at every level, one more where a row
///   is finished: `A + M`.
/// - Errors of `16 (T / P)^2 (log2 P + 4 / 3)` bytes, for the summaries and four for each tile of
///   the rows that are not finished: `A + M + 4 (U + V)`.
/// - Finished tiles that wait to be written, as large as in the source, 2 M; the fills of a row are
///   there before them.
/// - The samples of a band, and what reading it takes beside them ([`of_reading`]); the buffers of
///   each thread; what a checkpoint encodes at a time; the index of the whole file; and the program
///   itself. (A band that waits for its tiles to be cut takes less than their lattices would.)
///
/// It is for voids everywhere; terrain without them takes half of it or less: leaf tiles wait in
/// their band, and of the levels above only what finished tiles leave. Memory that is done with is
/// kept for the next tile (`buffers`), so that the memory of one kind of these never becomes that
/// of another. Imagery is made afterwards ([`super::imagery::Imagery::memory`]). What GDAL keeps
/// while it warps is not in it.
pub fn estimate(plan: &Plan, columns: &Range<u32>) -> u64 {
    let rows: Vec<u64> = (0..=plan.pyramid.levels).map(|up| plan.occupied.widest(up, columns)).collect();
    (rows[0] * Sizes::of(plan).lattice)
        .saturating_add(of_rows(plan, &rows))
        .saturating_add(of_reading(plan, columns))
}

/// Bytes of memory that reading bands of these columns of leaf tiles takes at most: samples, blocks
/// that are kept from one band to the next, and those that threads are decoding. Blocks are whole,
/// however few of their columns are wanted, so that strips do not help against wide ones.
pub fn of_reading(plan: &Plan, columns: &Range<u32>) -> u64 {
    let (reading, block_rows) = plan.reading;
    let tile = plan.pyramid.tile as u64;
    let (tiles, runs) = plan.occupied.fullest(columns);
    let samples = tiles.saturating_mul((tile + 1) * (tile + 1));
    let window = samples.saturating_mul(reading.sample.max(plan.sample_bytes));
    let wide = (tiles * tile).min(plan.pyramid.width.into());
    let size = (plan.pyramid.width, plan.pyramid.height);
    window.saturating_add(reading.blocks((wide, runs), (tile + 1, block_rows), size, plan.jobs as u64))
}

/// Fails if joining pieces of these windows takes more than `limit`.
pub fn check_merge(plan: &Plan, windows: &[Rect], limit: Option<u64>) -> Result<()> {
    let needed = of_merge(plan, windows);
    within(limit, needed, || {
        let (tile, jobs) = (plan.pyramid.tile, plan.jobs);
        let what = format!("joining these pieces, of tiles of {tile} x {tile} samples on {jobs} threads,");
        (what, "use fewer threads, or pieces with fewer tiles at their sides")
    })
}

/// Bytes of memory that joining windows takes at most: a sweep over the tiles that none of them has
/// finished, and over the borders of those beside them. The summaries of a row are read all at
/// once, packed.
pub fn of_merge(plan: &Plan, passes: &[Rect]) -> u64 {
    let all = plan.pyramid.leaves().columns;
    let windows: Vec<WindowLevels> =
        passes.iter().map(|pass| WindowLevels::new(&plan.pyramid, pass)).collect();
    let unfinished = |up: u8| {
        let finished: Vec<&Rect> =
            windows.iter().map(|window_levels| window_levels.finished(plan.pyramid.levels - up)).collect();
        let whole = plan.occupied.widest(up, &all);
        let of_row = |y: u32| {
            let here = finished.iter().filter(|extent| extent.rows.contains(&y) && !extent.is_empty());
            let mut columns: Vec<&Range<u32>> = here.map(|extent| &extent.columns).collect();
            columns.sort_unstable_by_key(|columns| columns.start);
            let (mut tiles, mut from) = (2 * columns.len() as u64, 0);
            for columns in columns {
                tiles += plan.occupied.widest(up, &(from << up..columns.start << up));
                from = columns.end;
            }
            tiles + plan.occupied.widest(up, &(from << up..all.end))
        };
        // Rows that the same windows have finished have the same tiles left.
        let rows = plan.pyramid.rows(plan.pyramid.levels - up);
        let edges = finished.iter().flat_map(|extent| [extent.rows.start, extent.rows.end]);
        let edges: BTreeSet<u32> = edges.chain([0]).filter(|&y| y < rows).collect();
        edges.into_iter().map(of_row).max().unwrap_or(whole).min(whole)
    };
    let rows: Vec<u64> = (0..=plan.pyramid.levels).map(unfinished).collect();
    let most = rows.iter().copied().max().unwrap_or(0);
    most * Sizes::of(plan).summary + of_rows(plan, &rows)
}

/// Bytes for rows of so many tiles, leaves first, and for what does not depend on them.
fn of_rows(plan: &Plan, rows: &[u64]) -> u64 {
    let sizes = Sizes::of(plan);
    let (all, most) = (rows.iter().sum::<u64>(), rows.iter().copied().max().unwrap_or(0));
    let (above, most_above) = (all - rows[0], rows.iter().skip(1).copied().max().unwrap_or(0));
    let (summaries, unfinished) = (all + most, above + most_above);
    let samples = ((plan.pyramid.tile + 1) * (plan.pyramid.tile + 1)) as u64;
    (2 * all + most) * sizes.lattice
        + unfinished * (sizes.blocks + 4 * sizes.errors)
        + summaries * (sizes.summary + sizes.errors)
        + most * (sizes.finished + sizes.finished.max(sizes.fills))
        + plan.jobs as u64 * (samples * THREAD_SAMPLE + THREAD)
        + AT_ONCE.min(most as usize * 4) as u64 * sizes.summary
        + plan.most_tiles().iter().sum::<u64>() * INDEX
        + PROGRAM
}
