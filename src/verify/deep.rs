//! Checks every sample against full resolution, and recomputes every error.
//!
//! Spacing `s` at level `l` draws the same surface as spacing `2 s` at level `l + 1`. So the errors
//! of each spacing are computed once, cell by cell over the whole lattice, and combined for the
//! patches of every level that draws it.

use std::collections::{BTreeMap, HashMap};

use rayon::prelude::*;

use super::VerifyOptions;
use super::full::Full;
use super::ground::Ground;
use super::outline::Outline;
use super::paper;
use super::range::Hull;
use super::report::{Check, Place, Ratios, Tightness, VerifyReport};
use super::shape::{Grid, HAS_VALID, Occupancy};
use super::tiles::Tables;
use super::vertical::Surfaces;
use crate::codec::table::ErrorTable;
use crate::container::directory::TileEntry;
use crate::container::layout::{Header, Metric};
use crate::container::reader::Reader;
use crate::error::{Error, Result};
use crate::error_code::metres_from_code;
use crate::progress::{Progress, Stage};
use crate::sample::Coding;
use crate::tile::TileId;

/// Relative rounding allowed in converting an exact deviation to metres, and in measuring a
/// distance.
const SLACK: [f64; 2] = [1e-12, 1e-9];

/// Adds the deep checks and the tightness to the report.
pub(super) fn check(
    reader: &Reader,
    tables: &Tables,
    options: &VerifyOptions,
    progress: &dyn Progress,
    report: &mut VerifyReport,
) -> Result<()> {
    let header = reader.header();
    let mut samples = Check::new("samples across levels", "samples", options.keep);
    if !tables.whole {
        samples.note = "not checked, nor the errors, for not every tile could be read".into();
        report.checks.push(samples);
        return Ok(());
    }
    let count = u64::from(header.width) * u64::from(header.height);
    if count > options.max_deep_samples {
        let what = "number of samples to verify deeply at once (leave out `deep`, or verify a build of a part of the raster)";
        return Err(Error::limit(what, count, options.max_deep_samples).at(reader.path()));
    }
    if tables.by_tile.values().any(|(entry, _)| entry.is_leaf() && entry.id.level < header.levels) {
        let hint = "verify it without `deep`";
        return Err(
            Error::unsupported("leaves above the finest level in a deep check", hint).at(reader.path())
        );
    }
    let full = Full::decode(reader)?;
    compare_samples(reader, tables, &full, progress, &mut samples)?;
    report.checks.push(samples);
    let names = match header.metric {
        Metric::Bound => ["vertical errors", "horizontal errors"],
        Metric::Paper => ["vertical one-step errors", "horizontal one-step errors"],
    };
    let checks = names.map(|name| Check::new(name, "errors", options.keep));
    let mut deep = Deep { reader, tables, checks, ratios: BTreeMap::new() };
    match header.metric {
        Metric::Bound => deep.bound(&full, progress)?,
        Metric::Paper => deep.paper(&full, progress)?,
    }
    report.tightness = deep.tightness();
    report.checks.extend(deep.checks);
    Ok(())
}

fn compare_samples(
    reader: &Reader,
    tables: &Tables,
    full: &Full,
    progress: &dyn Progress,
    check: &mut Check,
) -> Result<()> {
    let entries: Vec<&TileEntry> = tables.by_tile.values().map(|(entry, _)| entry).collect();
    let total = entries.len() as u64;
    let mut hulls = HashMap::new();
    for (done, batch) in (0..).step_by(64).zip(entries.chunks(64)) {
        let parts: Vec<Result<(Check, Hull)>> = batch
            .par_iter()
            .map(|entry| {
                let mut part = check.part();
                let lattice = reader.read_tile(entry.id)?;
                let range = (entry.min_m, entry.max_m);
                let hull = full.compare(reader.header(), entry.id, &lattice, range, &mut part);
                Ok((part, hull))
            })
            .collect();
        for (entry, part) in batch.iter().zip(parts) {
            let (part, hull) = part?;
            check.join(part);
            hulls.insert(entry.id, hull);
        }
        progress.step(Stage::Samples, done, total)?;
    }
    check_ranges(&entries, hulls, check);
    Ok(())
}

/// Checks that the height range of each tile, from the leaves to the root, is no wider than its
/// samples and its children's ranges.
fn check_ranges(entries: &[&TileEntry], mut hulls: HashMap<TileId, Hull>, check: &mut Check) {
    for entry in entries.iter().rev() {
        let Some(hull) = hulls.remove(&entry.id) else { continue };
        hull.check(entry, check);
        if let Some(above) = entry.id.parent().and_then(|parent| hulls.get_mut(&parent)) {
            above.join(hull);
        }
    }
}

/// Ratios of stored to true errors of one level and step: vertical, horizontal.
type Pairs = [Vec<f32>; 2];

struct Deep<'a> {
    reader: &'a Reader,
    tables: &'a Tables,
    checks: [Check; 2],
    ratios: BTreeMap<(u8, u32), Pairs>,
}

/// Metres of one unit of the numbers in which deviations are computed, and metres of the
/// quantisation error.
fn metres_of_number(header: &Header) -> (f64, f64) {
    let metres = header.band_scale.abs() * header.unit_metres;
    let scale = if let Coding::Integer { scale, .. } = header.coding { scale.abs() } else { 1.0 };
    (scale * metres, header.quantisation_error * metres)
}

impl Deep<'_> {
    /// For metric `bound`, checks that no stored error is below the true one.
    fn bound(&mut self, full: &Full, progress: &dyn Progress) -> Result<()> {
        let header = self.reader.header();
        let occupancy = Occupancy::of(full);
        let surfaces = Surfaces::new(full, &occupancy);
        let ground = Ground::of(self.reader).with_rows(header.height.saturating_add(1));
        let outline = Outline::new(ground, full, &occupancy);
        let (metres, quantisation) = metres_of_number(header);
        let (p, levels) = (u32::from(header.patch_log2), u32::from(header.levels));
        let mut hulls: [Option<Grid>; 2] = [None, None];
        for q in 1..=levels + p {
            progress.step(Stage::Errors, u64::from(q) - 1, (levels + p).into())?;
            let group = q.max(p);
            let mut grids = [surfaces.deviations(q, group), outline.displacements(q, group)];
            for (hull, grid) in hulls.iter_mut().zip(&grids) {
                let finer = hull.take().map(|hull| if q > p { hull.halved() } else { hull });
                *hull = Some(finer.map_or_else(|| grid.clone(), |finer| finer.larger(grid)));
            }
            let mut least = hulls.clone();
            let (first, last) = (q.min(p), q.saturating_sub(levels));
            for step in (last..=first).rev() {
                let level = levels + step - q;
                let patch = group + first - step;
                for (kind, check) in self.checks.iter_mut().enumerate() {
                    let truth = |x: usize, y: usize| {
                        let occupied = occupancy.bits(patch, x as u64, y as u64) & HAS_VALID != 0;
                        let at_least = least[kind].as_ref().map_or(0.0, |hull| hull.get(x, y));
                        [grids[kind].get(x, y), at_least].map(|error| match kind {
                            0 => error * metres + if occupied { quantisation } else { 0.0 },
                            _ => error,
                        })
                    };
                    let ratios = compare(self.tables, level as u8, step, kind, truth, check);
                    self.ratios.entry((level as u8, step)).or_default()[kind] = ratios;
                }
                grids = grids.map(|grid| grid.halved());
                least = least.map(|hull| hull.map(|hull| hull.halved()));
            }
        }
        Ok(())
    }

    /// For metric `paper`, checks that stored errors are the one-step errors.
    fn paper(&mut self, full: &Full, progress: &dyn Progress) -> Result<()> {
        let header = self.reader.header();
        let (metres, quantisation) = metres_of_number(header);
        let mut below = HashMap::new();
        for level in (0..=header.levels).rev() {
            let done = u64::from(header.levels - level);
            progress.step(Stage::Errors, done, u64::from(header.levels) + 1)?;
            let tiles: Vec<_> = of_level(self.tables, level).collect();
            let ids: Vec<_> = tiles.iter().map(|(entry, _)| entry.id).collect();
            below = paper::level(self.reader, full, &ids, &below, metres);
            for (entry, table) in tiles {
                let Some(errors) = below.get(&entry.id) else { continue };
                self.compare_paper(full, entry, table, errors, quantisation);
            }
        }
        Ok(())
    }

    fn compare_paper(
        &mut self,
        full: &Full,
        entry: &TileEntry,
        table: &ErrorTable,
        errors: &paper::Errors,
        quantisation: f64,
    ) {
        let header = self.reader.header();
        let patches = table.patches * table.patches;
        let occupied: Vec<bool> =
            (0..patches).map(|patch| has_valid(header, full, entry.id, patch)).collect();
        let planes = [(&table.vertical, &errors.vertical), (&table.horizontal, &errors.horizontal)];
        for (kind, (stored, expected)) in planes.into_iter().enumerate() {
            let check = &mut self.checks[kind];
            for (at, (&code, &error)) in stored.iter().zip(expected.iter().flatten()).enumerate() {
                let (step, patch) = (at / patches, at % patches);
                let error = if kind == 0 && occupied[patch] { error + quantisation } else { error };
                check.looked_at += 1;
                let place = || Place::tile(entry.id).patch(patch, table.patches, step);
                let got = format_args!("{} m", metres_from_code(code));
                check.demand(
                    paper::is_code_of(code, error),
                    place,
                    format_args!("{error} m, rounded up"),
                    got,
                );
            }
        }
    }

    fn tightness(&self) -> Vec<Tightness> {
        let row = |(&(level, step), [vertical, horizontal]): (&(u8, u32), &Pairs)| Tightness {
            level,
            step,
            vertical: Ratios::of(vertical),
            horizontal: Ratios::of(horizontal),
        };
        self.ratios.iter().map(row).filter(|row| row.vertical.is_some() || row.horizontal.is_some()).collect()
    }
}

/// Tiles of a level with their error tables, in a fixed order.
fn of_level(tables: &Tables, level: u8) -> impl Iterator<Item = (&TileEntry, &ErrorTable)> {
    let range = TileId::new(level, 0, 0)..TileId::new(level + 1, 0, 0);
    tables.by_tile.range(range).map(|(_, (entry, table))| (entry, table))
}

/// Checks the stored errors of a level and step. `truth(column, row)` gives, for a patch counted
/// over the level, the true error at this step and the largest at this and all finer steps. Returns
/// the ratios of the stored error to the latter where it is not small.
fn compare(
    tables: &Tables,
    level: u8,
    step: u32,
    kind: usize,
    truth: impl Fn(usize, usize) -> [f64; 2],
    check: &mut Check,
) -> Vec<f32> {
    let mut pairs = Vec::new();
    let mut largest = 0.0_f64;
    for (entry, table) in of_level(tables, level) {
        let side = table.patches;
        let plane = if kind == 0 { &table.vertical } else { &table.horizontal };
        for patch in 0..side * side {
            let (x, y) = (patch % side, patch / side);
            let stored = f64::from(metres_from_code(plane[table.at(step as usize, x, y)]));
            let [truth, least] = truth(entry.id.x as usize * side + x, entry.id.y as usize * side + y);
            check.looked_at += 1;
            let place = || Place::tile(entry.id).patch(patch, side, step as usize);
            let good = stored >= truth * (1.0 - SLACK[kind]);
            check.demand(good, place, format_args!("{truth} m or more"), format_args!("{stored} m"));
            if least > 0.0 {
                largest = largest.max(least);
                pairs.push((stored as f32, least as f32));
            }
        }
    }
    let least = (largest / 256.0) as f32;
    pairs.into_iter().filter(|pair| pair.1 > least).map(|(stored, truth)| stored / truth).collect()
}

/// True if a patch has a valid sample of full resolution, on its borders or inside.
fn has_valid(header: &Header, full: &Full, id: TileId, patch: usize) -> bool {
    let (left, top) = header.origin(id);
    let side = header.patches() as usize;
    let span = u64::from(header.patch()) * u64::from(header.spacing(id.level));
    let range = |start: u64, index: usize, samples: u64| {
        let first = start + index as u64 * span;
        first..(first + span + 1).min(samples)
    };
    let columns = range(left, patch % side, full.raster.0);
    let mut rows = range(top, patch / side, full.raster.1);
    rows.any(|row| columns.clone().any(|column| full.is_valid(full.at(column as usize, row as usize))))
}
