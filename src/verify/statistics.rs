//! Recounts the statistics and the level notes of a file.

use std::collections::BTreeMap;

use super::ground::Ground;
use super::report::{Check, Place};
use crate::codec::table::ErrorTable;
use crate::container::directory::TileEntry;
use crate::container::layout::Header;
use crate::container::metadata::{ErrorStatistics, LevelStatistics, Statistics};
use crate::container::reader::Reader;
use crate::error::Result;
use crate::error_code::metres_from_code;

/// Relative difference allowed because f64 sums were taken in another order.
const SLACK: f64 = 1e-9;
/// Relative amount by which writers may round spacings up, to cover their own rounding.
const ROUNDED_UP: f64 = 1.5e-9;
/// Metres that a spacing may be off by: at a pole, a parallel's length is nothing but the rounding
/// of a right angle.
const SLACK_M: f64 = 1e-6;

/// Counts by level.
pub(super) struct Recount {
    levels: Vec<LevelCounts>,
}

#[derive(Default)]
struct LevelCounts {
    tiles: u64,
    patches: u64,
    valid: u64,
    range_m: Option<(f64, f64)>,
    bytes: [u64; 3],
    spacing_m: (f64, f64),
    /// Largest vertical and horizontal error codes of the tiles at step 0.
    largest: [u16; 2],
    /// For each step, the number of patches with each code: vertical, horizontal.
    codes: Vec<[BTreeMap<u16, u64>; 2]>,
}

impl Recount {
    /// Empty counts for a file.
    pub fn new(header: &Header) -> Self {
        let steps = header.steps() as usize;
        let level = || LevelCounts { codes: vec![<_>::default(); steps], ..LevelCounts::default() };
        Self { levels: (0..=header.levels).map(|_| level()).collect() }
    }

    /// Counts a tile: its own valid samples and their range in metres.
    pub fn add(&mut self, reader: &Reader, entry: &TileEntry, valid: u64, range_m: Option<(f64, f64)>) {
        let level = &mut self.levels[usize::from(entry.id.level)];
        level.tiles += 1;
        level.valid += valid;
        for (sum, length) in level.bytes.iter_mut().zip(entry.chunks.lengths) {
            *sum += u64::from(length);
        }
        level.range_m = match (level.range_m, range_m) {
            (Some((a, b)), Some((low, high))) => Some((a.min(low), b.max(high))),
            (known, new) => known.or(new),
        };
        let [dx, dy] = Ground::of(reader).intervals(reader.header(), entry.id);
        level.spacing_m = (level.spacing_m.0.max(dx), level.spacing_m.1.max(dy));
    }

    /// Counts the drawable patches of a tile.
    pub fn add_drawable(&mut self, entry: &TileEntry, table: &ErrorTable) {
        let level = &mut self.levels[usize::from(entry.id.level)];
        level.patches += table.drawable.iter().filter(|&&drawable| drawable).count() as u64;
        level.largest = [level.largest[0].max(entry.vertical), level.largest[1].max(entry.horizontal)];
    }

    /// Counts the errors of patches that have a valid sample on or below them.
    pub fn add_errors(&mut self, entry: &TileEntry, table: &ErrorTable, occupied: &[bool]) {
        let level = &mut self.levels[usize::from(entry.id.level)];
        for (plane, name) in [&table.vertical, &table.horizontal].into_iter().zip(0..2) {
            for (counts, codes) in level.codes.iter_mut().zip(plane.chunks_exact(occupied.len())) {
                for (&code, _) in codes.iter().zip(occupied).filter(|(_, occupied)| **occupied) {
                    *counts[name].entry(code).or_default() += 1;
                }
            }
        }
    }

    /// Compares the counts with the file's. They are incomplete, and not compared, unless all tiles
    /// could be read.
    pub fn check(&self, reader: &Reader, whole: bool, keep: usize) -> Result<Check> {
        let mut check = Check::new("statistics", "numbers", keep);
        if !whole {
            check.note = "not checked, for not every tile could be read".into();
            return Ok(check);
        }
        let read = reader.statistics();
        match check.take(read, Place::of("statistics"))? {
            Some(Some(stored)) => self.compare(&stored, reader.header(), &mut check),
            Some(None) => check.note = "the file has none".into(),
            None => {}
        }
        self.compare_notes(reader, &mut check);
        Ok(check)
    }

    fn compare(&self, stored: &Statistics, header: &Header, check: &mut Check) {
        for ((level, stored), number) in self.levels.iter().zip(&stored.levels).zip(0..) {
            let place = format!("statistics of level {number}");
            let size = header.level_size(number);
            let mut same = |name: &str, expected: f64, got: f64| same(check, &place, name, expected, got);
            for (name, expected, got) in [
                ("level", u64::from(number), u64::from(stored.level)),
                ("tiles", level.tiles, stored.tiles),
                ("patches", level.patches, stored.patches),
                ("columns", size.0.into(), stored.columns),
                ("rows", size.1.into(), stored.rows),
                ("valid samples", level.valid, stored.valid),
                ("bytes of heights", level.bytes[0], stored.heights_bytes),
                ("bytes of masks", level.bytes[1], stored.masks_bytes),
                ("bytes of errors", level.bytes[2], stored.errors_bytes),
                ("steps", level.codes.len() as u64, stored.steps.len() as u64),
            ] {
                same(name, expected as f64, got as f64);
            }
            let range = level.range_m.unzip();
            same("minimum", range.0.unwrap_or(f64::NAN), stored.min_m.unwrap_or(f64::NAN));
            same("maximum", range.1.unwrap_or(f64::NAN), stored.max_m.unwrap_or(f64::NAN));
            level.compare_steps(stored, &place, check);
        }
    }

    fn compare_notes(&self, reader: &Reader, check: &mut Check) {
        let notes = &reader.metadata().levels;
        if notes.len() != self.levels.len() {
            check.fail(Place::of("levels in the metadata"), self.levels.len(), notes.len());
            return;
        }
        for (number, (level, note)) in self.levels.iter().zip(notes).enumerate() {
            let place = format!("metadata of level {number}");
            let metres = level.largest.map(|code| f64::from(metres_from_code(code)));
            for (name, expected, got) in [
                ("tiles", level.tiles as f64, note.tiles as f64),
                ("bytes", level.bytes.iter().sum::<u64>() as f64, note.bytes as f64),
                ("largest vertical error", metres[0], note.max_vertical_m),
                ("largest horizontal error", metres[1], note.max_horizontal_m),
            ] {
                same(check, &place, name, expected, got);
            }
        }
    }
}

impl LevelCounts {
    fn compare_steps(&self, stored: &LevelStatistics, place: &str, check: &mut Check) {
        for ((counts, stored), step) in self.codes.iter().zip(&stored.steps).zip(0..) {
            let place = format!("{place}, step {step}");
            let scale = f64::from(1_u32 << step);
            for (name, spacing, got) in [
                ("spacing east", self.spacing_m.0 * scale, stored.spacing_m[0]),
                ("spacing south", self.spacing_m.1 * scale, stored.spacing_m[1]),
            ] {
                let rounded = got.clamp(spacing, spacing * (1.0 + ROUNDED_UP) + SLACK_M);
                same(check, &place, name, rounded, got);
            }
            for (name, counts, stored) in
                [("vertical", &counts[0], &stored.vertical), ("horizontal", &counts[1], &stored.horizontal)]
            {
                compare_errors(&format!("{place}, {name}"), counts, stored, check);
            }
        }
    }
}

fn compare_errors(place: &str, counts: &BTreeMap<u16, u64>, stored: &ErrorStatistics, check: &mut Check) {
    // The plainest way: all errors, sorted.
    let sorted: Vec<f64> = counts
        .iter()
        .flat_map(|(&code, &count)| std::iter::repeat_n(f64::from(metres_from_code(code)), count as usize))
        .collect();
    let count = sorted.len();
    let rank =
        |percent: usize| sorted.get((count * percent).div_ceil(100).max(1) - 1).copied().unwrap_or(0.0);
    let mean = if count == 0 { 0.0 } else { sorted.iter().sum::<f64>() / count as f64 };
    for (name, expected, got) in [
        ("count", count as f64, stored.count as f64),
        ("min", rank(0), stored.min),
        ("mean", mean, stored.mean),
        ("max", rank(100), stored.max),
        ("p50", rank(50), stored.p50),
        ("p90", rank(90), stored.p90),
        ("p99", rank(99), stored.p99),
    ] {
        same(check, place, name, expected, got);
    }
    let mut bins: BTreeMap<u16, u64> = BTreeMap::new();
    for (code, count) in counts {
        *bins.entry(code >> 6).or_default() += count;
    }
    let bins: Vec<_> = bins.into_iter().collect();
    check.looked_at += 1;
    if bins != stored.histogram {
        check.fail(Place::of(format!("{place}, histogram")), words(&bins), words(&stored.histogram));
    }
}

/// The non-empty bins of a histogram, as text.
fn words(bins: &[(u16, u64)]) -> String {
    let bins: Vec<String> = bins.iter().map(|(bin, count)| format!("{count} in bin {bin}")).collect();
    if bins.is_empty() { "no bins".into() } else { bins.join(", ") }
}

/// Checks that two numbers are equal; NaN stands for a missing one.
fn same(check: &mut Check, place: &str, name: &str, expected: f64, got: f64) {
    check.looked_at += 1;
    // An infinite number is close only to itself.
    let largest = expected.abs().max(got.abs());
    let near = largest.is_finite() && (expected - got).abs() <= SLACK * largest;
    let is = expected == got || near || (expected.is_nan() && got.is_nan());
    check.demand(is, || Place::of(format!("{place}, {name}")), expected, got);
}
