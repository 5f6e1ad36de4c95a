//! `build`: a raster becomes a container, in stages that stream from north to south.
//!
//! open, plan, (scan), then for every band of T + 1 rows: read, code, split into leaf tiles; and for every row of tiles, as soon as the
//! row below it is there: fill voids, measure errors, encode, append, halve. Two finished rows make one row of the level above. Memory
//! grows with the width of the raster. The order of all that is written is fixed: any number of threads gives the same bytes, and so
//! does any number of pieces: a build works on a window of the lattice, by default all of it, and what it cannot finish at its sides
//! it leaves for a merge. To be resumed is to be merged with what was finished before.

mod buffers;
mod bytes;
mod checkpoint;
mod counts;
pub mod estimate;
pub mod imagery;
pub(crate) mod memory;
mod merge;
mod occupied;
mod odd;
mod outcome;
pub mod plan;
mod quarter;
pub mod reach;
mod run;
mod seam;
mod state;
mod strips;
mod sweep;
mod tally;
mod work;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use crate::container::layout::{Header, Metric};
use crate::container::metadata::Statistics;
use crate::error::{Error, Result};
use crate::output;
use crate::source::Source;
use crate::writer::FileSummary;
use imagery::{Imagery, LayerReport};
use reach::Extent;
use run::Begun;

pub use plan::{Plan, plan};

/// What a build is asked for. What does not change the file is not kept with the state of a build.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BuildOptions {
    /// Intervals of a tile, a power of two in 16..=1024.
    pub tile: u32,
    /// Intervals of a patch, a power of two in 4..=64, at most `tile`.
    pub patch: u32,
    /// Which geometric error.
    pub metric: Metric,
    /// Quantise to this many metres: heights are then off by at most half of it. `None`: lossless.
    pub precision_m: Option<f64>,
    /// Value that means void, instead of what the source says.
    pub nodata: Option<f64>,
    /// True if what is warned of is an error: then nothing is built.
    #[serde(skip)]
    pub strict: bool,
    /// Threads; `None`: one for each core.
    #[serde(skip)]
    pub jobs: Option<usize>,
    /// Replace an existing output, and an unfinished build of it.
    #[serde(skip)]
    pub force: bool,
    /// Go on with an unfinished build, if there is one.
    #[serde(skip)]
    pub resume: bool,
    /// Time between two checkpoints. `None`: [`CHECKPOINT`].
    #[serde(skip)]
    pub checkpoint: Option<Duration>,
    /// Bytes of memory that the build keeps within, by building strips of columns one after the other if it must. `None`: no limit.
    #[serde(skip)]
    pub memory: Option<u64>,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self {
            tile: 256,
            patch: 32,
            metric: Metric::Bound,
            precision_m: None,
            nodata: None,
            strict: false,
            jobs: None,
            force: false,
            resume: false,
            checkpoint: None,
            memory: None,
        }
    }
}

/// Threads that may share a core, where there are more than [`LEAST_MOST`].
const THREADS_A_CORE: usize = 4;
/// Threads that may be asked for on any machine.
const LEAST_MOST: usize = 16;

/// Time between two checkpoints unless told otherwise: what is lost at most when a build is killed.
pub const CHECKPOINT: Duration = Duration::from_secs(4);

impl BuildOptions {
    /// The first thing that would make another file.
    fn difference(&self, other: &Self) -> Option<String> {
        let differ =
            |name: &str, a: String, b: String| (a != b).then(|| format!("{name} was {a}, now it is {b}"));
        let number = |value: Option<f64>| value.map_or("not given".to_owned(), |value| value.to_string());
        differ("--tile", self.tile.to_string(), other.tile.to_string())
            .or_else(|| differ("--patch", self.patch.to_string(), other.patch.to_string()))
            .or_else(|| differ("--metric", self.metric.as_str().to_owned(), other.metric.as_str().to_owned()))
            .or_else(|| differ("--precision", number(self.precision_m), number(other.precision_m)))
            .or_else(|| differ("--nodata", number(self.nodata), number(other.nodata)))
    }
}

/// What a build tells while it runs, and how it is told to stop.
pub trait Observer: Sync {
    /// `done` of `total` raster rows have been read and put into tiles.
    fn rows(&self, stage: Stage, done: u64, total: u64);

    /// True as soon as the build is to stop; asked between bands.
    fn cancelled(&self) -> bool {
        false
    }
}

/// The parts of a build that take time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Looking for the largest height, with `precision_m` only.
    Scan,
    /// The sweep.
    Build,
    /// Finishing what lies between pieces.
    Merge,
    /// The tiles of the imagery layer.
    Imagery,
    /// Putting the file together.
    Write,
}

/// An observer that hears nothing and never stops a build.
pub struct Silent;

impl Observer for Silent {
    fn rows(&self, _: Stage, _: u64, _: u64) {}
}

/// What a build made.
#[derive(Clone, Debug)]
pub struct Report {
    /// Header of the file.
    pub header: Header,
    /// Statistics as stored in it.
    pub statistics: Statistics,
    /// Sizes.
    pub file: FileSummary,
    /// The imagery layer, if there is one.
    pub imagery: Option<LayerReport>,
    /// What the source warns of, then what the heights look like.
    pub warnings: Vec<String>,
    /// Where place, coordinate system, nodata and the like were found, as in the container's metadata.
    pub origins: BTreeMap<String, String>,
    /// Wall time.
    pub elapsed: Duration,
}

/// Builds `output` from a source.
///
/// On any error nothing of the output's name is written. If the build has come as far as its first checkpoint, its work folder stays,
/// and [`BuildOptions::resume`] goes on from there; else that is gone too.
pub fn build(
    source: &dyn Source,
    output: &Path,
    options: &BuildOptions,
    observer: &dyn Observer,
) -> Result<Report> {
    build_with(source, None, output, options, observer)
}

/// [`build`] with an imagery layer, which is made when the heights are done. A build that is resumed makes it anew.
pub fn build_with(
    source: &dyn Source,
    imagery: Option<&Imagery<'_>>,
    output: &Path,
    options: &BuildOptions,
    observer: &dyn Observer,
) -> Result<Report> {
    let start = Instant::now();
    threads(options.jobs)?.install(|| {
        let mut plan = plan(source.info(), options)?;
        refuse_odd(&source.info().warnings, options.strict)?;
        if let Some(imagery) = imagery {
            // What is wrong with the pictures is to be known before the heights are built.
            imagery.check(&plan.ground())?;
            imagery.keep_within(&plan.ground(), plan.jobs, options.memory)?;
        }
        check_output(output, source, imagery)?;
        let window = Extent::of_level(&plan, plan.levels);
        let strips = plan.strips(options.memory)?;
        let begun = Begun::new(source, output, options, observer, &mut plan, window, None)?;
        if !begun.is_new() {
            plan.check_limit(&begun.state.strips, options.memory)?;
        }
        if begun.is_new() && strips.len() > 1 || !begun.state.strips.is_empty() {
            return strips::build((source, imagery), begun, strips, options, observer, &plan, start);
        }
        let done = begun.run(source, options, observer, &plan)?;
        merge::assemble(done, &plan, (source.info(), options, options.strict), imagery, observer, start)
    })
}

/// Builds the tiles of a window of leaf tiles, as far as they can be without the others: a piece, which is a folder, for [`merge()`].
///
/// # Errors
/// As [`build`], and if the window is not in the lattice.
pub fn build_window(
    source: &dyn Source,
    output: &Path,
    window: &Extent,
    options: &BuildOptions,
    observer: &dyn Observer,
) -> Result<()> {
    threads(options.jobs)?.install(|| {
        let mut plan = plan(source.info(), options)?;
        refuse_odd(&source.info().warnings, options.strict)?;
        let all = Extent::of_level(&plan, plan.levels);
        if window.is_empty() || !all.covers(window) {
            return Err(Error::usage(format!("--window {window}: expected tiles of the leaf level, {all}")));
        }
        check_output(output, source, None)?;
        let begun = Begun::new(source, output, options, observer, &mut plan, window.clone(), None)?;
        begun.run(source, options, observer, &plan)?.into_piece()
    })
}

/// Joins finished windows that cover the raster into one file: the same bytes as those of one build.
pub fn merge(
    pieces: &[PathBuf],
    output: &Path,
    jobs: Option<usize>,
    force: bool,
    observer: &dyn Observer,
) -> Result<Report> {
    merge_within(None, pieces, output, jobs, force, observer)
}

/// [`merge()`] within `memory` bytes.
///
/// # Errors
/// As there, and [`Error::Usage`] before anything is written if that is not enough.
pub fn merge_within(
    memory: Option<u64>,
    pieces: &[PathBuf],
    output: &Path,
    jobs: Option<usize>,
    force: bool,
    observer: &dyn Observer,
) -> Result<Report> {
    threads(jobs)?.install(|| merge::merge(pieces, output, (jobs, memory, force), observer))
}

/// Fails if the output is one of the files that it is made of.
fn check_output(output: &Path, source: &dyn Source, imagery: Option<&Imagery<'_>>) -> Result<()> {
    let mut files = source.files();
    files.extend(imagery.iter().flat_map(|imagery| imagery.pictures).flat_map(|picture| picture.files()));
    output::check_apart(output, &files)
}

/// Fails if there are warnings and they are to be errors.
fn refuse_odd(warnings: &[String], strict: bool) -> Result<()> {
    match warnings {
        [first, rest @ ..] if strict => {
            let more = if rest.is_empty() { String::new() } else { format!(" (and {} more)", rest.len()) };
            Err(Error::usage(format!("{first}{more}; nothing is built, as warnings are to be errors")))
        }
        _ => Ok(()),
    }
}

/// Threads that work, of so many asked for: far more than there are cores only wait for one another.
pub fn workers(jobs: Option<usize>) -> usize {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    jobs.unwrap_or(cores).clamp(1, (THREADS_A_CORE * cores).max(LEAST_MOST))
}

fn threads(jobs: Option<usize>) -> Result<rayon::ThreadPool> {
    let count = workers(jobs);
    rayon::ThreadPoolBuilder::new()
        .num_threads(count)
        .build()
        .map_err(|e| Error::usage(format!("cannot start {count} threads: {e}")))
}
