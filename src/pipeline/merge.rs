//! Joins finished pieces to one file: checks that they belong together, takes over their tiles, and
//! finishes those that no piece could finish.

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::assemble::Assembly;
use super::buffers::Buffers;
use super::carry::{Carried, CarryFile};
use super::imagery::Imagery;
use super::memory::check_merge;
use super::options::BuildOptions;
use super::plan::{Plan, plan, recipe};
use super::report::Report;
use super::run::Done;
use super::state::State;
use super::statistics::StatisticsBuilder;
use super::sweep::{Output, Sweep};
use super::threads::workers;
use super::window_levels::WindowLevels;
use crate::error::{Error, Result};
use crate::output;
use crate::progress::{Progress, Stage};
use crate::rect::Rect;
use crate::work_folder::{Earlier, WorkFolder};
use crate::writer::ContainerWriter;

/// Joins finished windows that cover the raster.
pub fn merge(
    pieces: &[PathBuf],
    output: &Path,
    jobs: Option<usize>,
    memory: Option<u64>,
    force: bool,
    progress: &dyn Progress,
) -> Result<Report> {
    let start = Instant::now();
    output::check_apart(output, &files(pieces))?;
    let earlier = if force { Earlier::Discard } else { Earlier::Refuse };
    let work = |plan: &Plan, windows: &[Rect]| {
        let mut plan = plan.clone();
        plan.jobs = workers(jobs);
        check_merge(&plan, windows, memory)?;
        WorkFolder::take(output, force, earlier)
    };
    join(pieces, work, None, false, progress, start)
}

/// The pieces, and the files in them.
fn files(pieces: &[PathBuf]) -> Vec<PathBuf> {
    let entries = |piece: &PathBuf| {
        let entries = std::fs::read_dir(piece).into_iter().flatten().flatten();
        std::iter::once(piece.clone()).chain(entries.map(|entry| entry.path())).collect::<Vec<_>>()
    };
    pieces.iter().flat_map(entries).collect()
}

/// Joins pieces. `work` takes the work folder when the pieces have been checked.
pub fn join(
    pieces: &[PathBuf],
    work: impl FnOnce(&Plan, &[Rect]) -> Result<WorkFolder>,
    imagery: Option<&Imagery<'_>>,
    strict: bool,
    progress: &dyn Progress,
    start: Instant,
) -> Result<Report> {
    let mut carried = Carried::default();
    let mut states = Vec::with_capacity(pieces.len());
    for piece in pieces {
        if piece.is_file() {
            let hint = "pieces are the folders that a build of a window makes";
            return Err(Error::unsupported("a file, not a piece", hint).at(piece));
        }
        let state = State::read(piece, &mut carried)?;
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
    let windows: Vec<Rect> = states.iter().map(|state| state.window.clone()).collect();
    let mut writer = ContainerWriter::begin(work(&plan, &windows)?)?;
    let mut statistics = StatisticsBuilder::new(&plan);
    for (piece, state) in pieces.iter().zip(&states) {
        writer.adopt(piece, &state.mark)?;
        if !statistics.join(&state.statistics) {
            return Err(Error::format("state", "counts of all levels", "others").at(piece));
        }
    }
    let done = pass_all(&plan, writer, statistics, carried, progress)?;
    let (info, options) = (&first.info, &BuildOptions { strict, ..first.options.clone() });
    Assembly { info, plan: &plan, options, imagery, progress, start }.finish(done)
}

/// Finishes the tiles that no piece could finish, from what the pieces have carried.
fn pass_all(
    plan: &Plan,
    writer: ContainerWriter,
    statistics: StatisticsBuilder,
    carried: Carried,
    progress: &dyn Progress,
) -> Result<Done> {
    let carry = CarryFile::create(writer.store().folder().folder().join("seam-0"))?;
    let all = plan.pyramid.leaves();
    let buffers = Buffers::default();
    let output = Output { writer, statistics, carry };
    let mut sweep = Sweep::new(plan, &buffers, WindowLevels::new(&plan.pyramid, &all), output, carried);
    for y in all.rows.clone() {
        if progress.is_cancelled() {
            return Err(Error::Interrupted);
        }
        sweep.pass(y)?;
        progress.report(Stage::Merge, u64::from(y + 1), u64::from(all.rows.end));
    }
    sweep.finish()?;
    let Output { writer, statistics, .. } = sweep.into_output();
    Ok(Done::new(writer, statistics))
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
    let all = plan.pyramid.leaves();
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
                    "no piece has leaf tile {x}/{y}; build that `window` (all tiles: {all})"
                )));
            };
            x = window.columns.end;
        }
    }
    Ok(())
}
