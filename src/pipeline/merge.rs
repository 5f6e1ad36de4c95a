//! Pieces to one file.

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::container::metadata::{LevelNote, LevelStatistics, Metadata, SourceNote, Statistics};
use crate::container::opening::OPENING_BYTES;
use crate::error::{Error, Result};
use crate::output;
use crate::pipeline::buffers::Buffers;
use crate::pipeline::imagery::{self, Imagery};
use crate::pipeline::odd;
use crate::pipeline::plan::Plan;
use crate::pipeline::reach::{Extent, Reach};
use crate::pipeline::run::{Done, recipe};
use crate::pipeline::seam::{SeamFile, Seams};
use crate::pipeline::state::State;
use crate::pipeline::sweep::Sweep;
use crate::pipeline::tally::Tally;
use crate::pipeline::{BuildOptions, Observer, Report, Stage, outcome, plan, refuse_odd, workers};
use crate::source::{Part, SourceInfo};
use crate::work_folder::{Earlier, WorkFolder};
use crate::writer::ContainerWriter;

/// Bytes of metadata that the list of sources may take.
const SOURCES_BYTES: usize = 20 << 10;

/// Joins finished windows that cover the raster.
pub fn merge(
    pieces: &[PathBuf],
    output: &Path,
    (jobs, memory, force): (Option<usize>, Option<u64>, bool),
    observer: &dyn Observer,
) -> Result<Report> {
    let start = Instant::now();
    output::check_apart(output, &files(pieces))?;
    let earlier = if force { Earlier::Discard } else { Earlier::Refuse };
    let work = |plan: &Plan, windows: &[Extent]| {
        let mut plan = plan.clone();
        plan.jobs = workers(jobs);
        plan.check_merge(windows, memory)?;
        WorkFolder::take(output, force, earlier)
    };
    join(pieces, work, (None, false), observer, start)
}

/// Pieces and the files in them.
fn files(pieces: &[PathBuf]) -> Vec<PathBuf> {
    let entries = |piece: &PathBuf| {
        let entries = std::fs::read_dir(piece).into_iter().flatten().flatten();
        std::iter::once(piece.clone()).chain(entries.map(|entry| entry.path())).collect::<Vec<_>>()
    };
    pieces.iter().flat_map(entries).collect()
}

/// Joins pieces in a work folder, which is taken when the pieces have been found good.
pub fn join(
    pieces: &[PathBuf],
    work: impl FnOnce(&Plan, &[Extent]) -> Result<WorkFolder>,
    (imagery, strict): (Option<&Imagery<'_>>, bool),
    observer: &dyn Observer,
    start: Instant,
) -> Result<Report> {
    let mut seams = Seams::default();
    let mut states = Vec::with_capacity(pieces.len());
    for piece in pieces {
        if piece.is_file() {
            let hint = "pieces are the folders that a build of a window makes";
            return Err(Error::unsupported("a file, not a piece", hint).at(piece));
        }
        let state = State::read(piece, &mut seams)?;
        if state.next != state.window.rows.end {
            let got = format!("one that is done up to tile row {} of {}", state.next, state.window);
            return Err(Error::format("state", "a finished window", got).at(piece));
        }
        states.push(state);
    }
    let Some(first) = states.first() else {
        return Err(Error::usage("there is no piece to merge"));
    };
    let mut plan = plan(&first.info, &first.options)?;
    plan.recipe = recipe(&first.info, &first.options, first.largest)?;
    check_alike(pieces, &states)?;
    check_cover(&plan, pieces, &states)?;
    let windows: Vec<Extent> = states.iter().map(|state| state.window.clone()).collect();
    let mut writer = ContainerWriter::begin(work(&plan, &windows)?)?;
    let mut tally = Tally::new(&plan);
    for (piece, state) in pieces.iter().zip(&states) {
        writer.adopt(piece, &state.mark)?;
        if !tally.join(&state.tally) {
            return Err(Error::format("state", "counts of all levels", "others").at(piece));
        }
    }
    let done = pass_all(&plan, writer, tally, seams, observer)?;
    assemble(done, &plan, (&first.info, &first.options, strict), imagery, observer, start)
}

/// Sends what pieces have left through the levels.
fn pass_all(
    plan: &Plan,
    writer: ContainerWriter,
    tally: Tally,
    seams: Seams,
    observer: &dyn Observer,
) -> Result<Done> {
    let seam = SeamFile::create(writer.store().folder().folder().join("seam-0"))?;
    let all = Extent::of_level(plan, plan.levels);
    let buffers = Buffers::default();
    let mut sweep = Sweep::new((plan, &buffers), Reach::new(plan, &all), (writer, tally), seams, seam);
    for y in all.rows.clone() {
        if observer.cancelled() {
            return Err(Error::Interrupted);
        }
        sweep.pass(y)?;
        observer.rows(Stage::Merge, u64::from(y + 1), u64::from(all.rows.end));
    }
    sweep.finish()?;
    let (writer, tally) = sweep.into_writer();
    Ok(Done::new(writer, tally))
}

/// Fails unless all pieces are of one raster, built with the same options.
fn check_alike(pieces: &[PathBuf], states: &[State]) -> Result<()> {
    for (piece, state) in pieces.iter().zip(states).skip(1) {
        // The input may have been copied to several machines, at different times.
        let sizes = |state: &State| state.fingerprint.files.iter().map(|file| file.bytes).collect::<Vec<_>>();
        let mut like_first = State { fingerprint: state.fingerprint.clone(), ..states[0].clone() };
        like_first.window = state.window.clone();
        like_first.check_same(state, piece)?;
        if sizes(state) != sizes(&states[0]) || state.largest.to_bits() != states[0].largest.to_bits() {
            let what = format!("{} is not of the same input as {}", piece.display(), pieces[0].display());
            return Err(Error::usage(what));
        }
    }
    Ok(())
}

/// Fails unless every leaf tile is in one window, and in one only.
fn check_cover(plan: &Plan, pieces: &[PathBuf], states: &[State]) -> Result<()> {
    let all = Extent::of_level(plan, plan.levels);
    for (i, state) in states.iter().enumerate() {
        if !all.covers(&state.window) || state.window.is_empty() {
            return Err(Error::format("window", format!("tiles of {all}"), &state.window).at(&pieces[i]));
        }
        for (j, other) in states[..i].iter().enumerate() {
            let both = state.window.common(&other.window);
            if !both.is_empty() {
                let (a, b) = (pieces[j].display(), pieces[i].display());
                return Err(Error::usage(format!("{a} and {b} both have the tiles {both}; leave one away")));
            }
        }
    }
    for y in all.rows.clone() {
        let mut x = all.columns.start;
        while x < all.columns.end {
            let Some(window) = states.iter().map(|s| &s.window).find(|window| window.contains(x, y)) else {
                return Err(Error::usage(format!(
                    "no piece has leaf tile {x}/{y}; build it with --window (all tiles: {all})"
                )));
            };
            x = window.columns.end;
        }
    }
    Ok(())
}

/// Puts the file together when all tiles are finished, with the imagery layer, which is made here.
pub fn assemble(
    done: Done,
    plan: &Plan,
    (info, options, strict): (&SourceInfo, &BuildOptions, bool),
    imagery: Option<&Imagery<'_>>,
    observer: &dyn Observer,
    start: Instant,
) -> Result<Report> {
    let Done { mut writer, tally, .. } = done;
    if writer.tile_count() == 0 {
        writer.store_mut().folder_mut().discard();
        return Err(all_void(info, plan));
    }
    let header = plan.header(info, writer.tile_count());
    let [all, rest] = tally.values();
    let mut warnings = info.warnings.clone();
    warnings.extend(odd::warnings(all, rest, plan, info, &header));
    if let Err(error) = refuse_odd(&warnings, strict) {
        writer.store_mut().folder_mut().discard();
        return Err(error);
    }
    let statistics = tally.statistics(&header);
    outcome::check_heights(info, &statistics)?;
    let mut metadata = metadata(info, plan, &statistics, options);
    let mut layer_report = None;
    if let Some(imagery) = imagery {
        let layer = imagery::layer(imagery, &plan.ground(), writer.store().folder().folder(), observer)?;
        layer_report = Some(layer.report());
        metadata.imagery = Some(layer.note);
        writer.attach(layer.sections);
    }
    let file =
        writer.finish_while(&header, &metadata, &statistics, &outcome::inspect, &mut |tiles, total| {
            observer.rows(Stage::Write, tiles, total);
            !observer.cancelled()
        })?;
    let origins = info.origins.texts();
    Ok(Report {
        header,
        statistics,
        file,
        imagery: layer_report,
        warnings,
        origins,
        elapsed: start.elapsed(),
    })
}

fn all_void(info: &SourceInfo, plan: &Plan) -> Error {
    let nodata = plan.recipe.nodata.value().map_or_else(|| "none".to_owned(), |v| info.sample_type.text(v));
    Error::format(
        "elevation band",
        "at least one valid sample",
        format!(
            "{} x {} samples that are all void (nodata value: {nodata}); if that value is wrong, give --nodata",
            info.width, info.height
        ),
    )
}

/// Fails if what the raster says of itself leaves no room in the first bytes of a file, which hold all of it: better now than when all
/// is built. Figures are not known yet, so that this is the least that there will be.
pub fn check_metadata(plan: &Plan, info: &SourceInfo, options: &BuildOptions) -> Result<()> {
    let least = metadata(info, plan, &Statistics::default(), options).encode()?.len() as u64;
    if least > OPENING_BYTES {
        let what = "bytes of what the raster says of itself (names, coordinate system, unit)";
        return Err(Error::limit(what, least, OPENING_BYTES));
    }
    Ok(())
}

fn metadata(info: &SourceInfo, plan: &Plan, statistics: &Statistics, options: &BuildOptions) -> Metadata {
    let sources = source_notes(&info.parts);
    Metadata {
        tool: concat!("relevo ", env!("CARGO_PKG_VERSION")).to_owned(),
        crs: info.geo.crs.clone(),
        pixel_is_point: info.geo.pixel_is_point,
        bounds: info.geo.transform.map(|_| info.geo.bounds(info.width, info.height)),
        vertical_unit: info.vertical_unit.1.clone(),
        origins: info.origins.texts(),
        more_sources: (info.parts.len() - sources.len()) as u64,
        sources,
        options: plan.options_json(options, info),
        levels: statistics.levels.iter().map(level_note).collect(),
        imagery: None,
    }
}

/// The first of the files: they share the first 64 KiB of the container with much else.
fn source_notes(parts: &[Part]) -> Vec<SourceNote> {
    let mut room = SOURCES_BYTES;
    let fits = |note: &SourceNote| {
        room = room.saturating_sub(serde_json::to_vec(note).map_or(0, |json| json.len() + 1));
        room > 0
    };
    let note = |part: &Part| SourceNote { name: part.name.clone(), description: part.description.clone() };
    parts.iter().map(note).take_while(fits).collect()
}

fn level_note(level: &LevelStatistics) -> LevelNote {
    let finest = level.steps.first();
    LevelNote {
        tiles: level.tiles,
        bytes: level.heights_bytes + level.masks_bytes + level.errors_bytes,
        max_vertical_m: finest.map_or(0.0, |s| s.vertical.max),
        max_horizontal_m: finest.map_or(0.0, |s| s.horizontal.max),
    }
}
