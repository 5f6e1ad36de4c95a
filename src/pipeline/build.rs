//! The entries of the pipeline: a whole file, a window of it, and the merge of windows.

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::assemble::Assembly;
use super::begun::Begun;
use super::imagery::Imagery;
use super::job::Job;
use super::options::BuildOptions;
use super::plan::plan;
use super::report::Report;
use super::threads::threads;
use super::{column_passes, outcome, run};
use crate::error::{Error, Result};
use crate::output;
use crate::progress::Progress;
use crate::rect::Rect;
use crate::source::Source;

/// Builds `output` from a source.
///
/// On any error the output is not written. If the build has reached its first checkpoint, its work
/// folder stays, and [`BuildOptions::resume`] goes on from there; otherwise the folder is removed.
pub fn build(
    source: &dyn Source,
    output: &Path,
    options: &BuildOptions,
    progress: &dyn Progress,
) -> Result<Report> {
    build_with(source, None, output, options, progress)
}

/// [`build`] with an imagery layer, which is made when the heights are done. A resumed build makes
/// the layer anew.
pub fn build_with(
    source: &dyn Source,
    imagery: Option<&Imagery<'_>>,
    output: &Path,
    options: &BuildOptions,
    progress: &dyn Progress,
) -> Result<Report> {
    let start = Instant::now();
    threads(options.jobs)?.install(|| {
        let plan = plan(source.info(), options)?;
        outcome::check_warnings(&source.info().warnings, options.strict)?;
        if let Some(imagery) = imagery {
            // What is wrong with the pictures is to be known before the heights are built.
            imagery.check(&plan.ground())?;
            imagery.keep_within(&plan.ground(), plan.jobs, options.memory)?;
        }
        check_output(output, source, imagery)?;
        let window = plan.pyramid.tiles(plan.pyramid.levels);
        let passes = column_passes::windows(&plan, options.memory)?;
        let mut job = Job { source, plan, options, progress };
        let begun = Begun::new(&mut job, output, window, None)?;
        if !begun.is_new() {
            column_passes::check_limit(&job.plan, &begun.state.passes, options.memory)?;
        }
        if begun.is_new() && passes.len() > 1 || !begun.state.passes.is_empty() {
            return column_passes::build(&job, imagery, begun, passes, start);
        }
        let done = run::run(&job, begun)?;
        let Job { plan, .. } = &job;
        Assembly { info: source.info(), plan, options, imagery, progress, start }.finish(done)
    })
}

/// Builds a piece: the tiles that can be finished with a window of leaf tiles alone. A piece is a
/// folder, for [`merge()`].
///
/// # Errors
/// As [`build`], and if the window is not in the lattice.
pub fn build_window(
    source: &dyn Source,
    output: &Path,
    window: &Rect,
    options: &BuildOptions,
    progress: &dyn Progress,
) -> Result<()> {
    threads(options.jobs)?.install(|| {
        let plan = plan(source.info(), options)?;
        outcome::check_warnings(&source.info().warnings, options.strict)?;
        let all = plan.pyramid.tiles(plan.pyramid.levels);
        if window.is_empty() || !all.covers(window) {
            return Err(Error::usage(format!("`window` {window}: expected tiles of the leaf level, {all}")));
        }
        check_output(output, source, None)?;
        let mut job = Job { source, plan, options, progress };
        let begun = Begun::new(&mut job, output, window.clone(), None)?;
        run::run(&job, begun)?.into_piece()
    })
}

/// Joins finished windows that cover the raster into one file: the same bytes as those of one
/// build.
pub fn merge(
    pieces: &[PathBuf],
    output: &Path,
    jobs: Option<usize>,
    force: bool,
    progress: &dyn Progress,
) -> Result<Report> {
    merge_within(None, pieces, output, jobs, force, progress)
}

/// [`merge()`] within `memory` bytes.
///
/// # Errors
/// Those of [`merge()`], and [`Error::Usage`] before anything is written if that is not enough
/// memory.
pub fn merge_within(
    memory: Option<u64>,
    pieces: &[PathBuf],
    output: &Path,
    jobs: Option<usize>,
    force: bool,
    progress: &dyn Progress,
) -> Result<Report> {
    threads(jobs)?.install(|| super::merge::merge(pieces, output, jobs, memory, force, progress))
}

/// Fails if the output is one of the files that it is made of.
fn check_output(output: &Path, source: &dyn Source, imagery: Option<&Imagery<'_>>) -> Result<()> {
    let mut files = source.files();
    files.extend(imagery.iter().flat_map(|imagery| imagery.pictures).flat_map(|picture| picture.files()));
    output::check_apart(output, &files)
}
