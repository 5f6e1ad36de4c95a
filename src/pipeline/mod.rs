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
pub mod imagery;
mod memory;
mod merge;
mod occupied;
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

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use crate::container::layout::{Header, Metric};
use crate::container::metadata::Statistics;
use crate::container::writer::FileSummary;
use crate::error::{Error, Result};
use crate::source::Source;
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
            jobs: None,
            force: false,
            resume: false,
            checkpoint: None,
            memory: None,
        }
    }
}

/// Time between two checkpoints unless told otherwise: what is lost at most when a build is killed.
pub const CHECKPOINT: Duration = Duration::from_secs(4);

impl BuildOptions {
    /// The first thing that would make another file.
    fn difference(&self, other: &Self) -> Option<String> {
        let differ = |name: &str, a: &dyn std::fmt::Debug, b: &dyn std::fmt::Debug| {
            let (a, b) = (format!("{a:?}"), format!("{b:?}"));
            (a != b).then(|| format!("{name} was {a}, now it is {b}"))
        };
        differ("--tile", &self.tile, &other.tile)
            .or_else(|| differ("--patch", &self.patch, &other.patch))
            .or_else(|| differ("--metric", &self.metric, &other.metric))
            .or_else(|| differ("--precision", &self.precision_m, &other.precision_m))
            .or_else(|| differ("--nodata", &self.nodata, &other.nodata))
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
        if let Some(imagery) = imagery {
            // What is wrong with the pictures is to be known before the heights are built.
            imagery.check(&plan.ground())?;
            imagery.keep_within(&plan.ground(), plan.jobs, options.memory)?;
        }
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
        merge::assemble(done, &plan, (source.info(), options), imagery, observer, start)
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
        let all = Extent::of_level(&plan, plan.levels);
        if window.is_empty() || !all.covers(window) {
            return Err(Error::usage(format!("--window {window}: expected tiles of the leaf level, {all}")));
        }
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
    threads(jobs)?.install(|| merge::merge(pieces, output, force, observer))
}

fn threads(jobs: Option<usize>) -> Result<rayon::ThreadPool> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(jobs.unwrap_or(0))
        .build()
        .map_err(|e| Error::usage(format!("cannot start {jobs:?} threads: {e}")))
}
