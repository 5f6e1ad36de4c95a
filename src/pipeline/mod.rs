//! `build`: a raster becomes a container, in stages that stream from north to south.
//!
//! open, plan, (scan), then for every band of T + 1 rows: read, code, split into leaf tiles; and for every row of tiles, as soon as the
//! row below it is there: fill voids, measure errors, encode, append, halve. Two finished rows make one row of the level above. Memory
//! grows with the width of the raster. The order of all that is written is fixed: any number of threads gives the same bytes.

pub mod plan;
mod quarter;
mod sweep;
mod tally;
mod work;

use std::path::Path;
use std::time::{Duration, Instant};

use crate::container::layout::{Header, Metric};
use crate::container::metadata::{LevelNote, LevelStatistics, Metadata, SourceNote, Statistics};
use crate::container::writer::{ContainerWriter, FileSummary};
use crate::error::{Error, Result};
use crate::source::Source;
use crate::tile::code::{CodeRows, Recipe, max_magnitude};
use crate::tile::split;
use sweep::{Sweep, TileRow};
use work::Work;

pub use plan::{Plan, plan};

/// What a build is asked for.
#[derive(Clone, Debug, PartialEq)]
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
    pub jobs: Option<usize>,
    /// Replace an existing output.
    pub force: bool,
    /// Name of the source as recorded in the file.
    pub source_name: String,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self {
            tile: 256,
            patch: 64,
            metric: Metric::Bound,
            precision_m: None,
            nodata: None,
            jobs: None,
            force: false,
            source_name: String::new(),
        }
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
    /// Wall time.
    pub elapsed: Duration,
}

/// Builds `output` from a source.
///
/// On any error nothing of the output's name is written, and the work folder is gone.
pub fn build(
    source: &dyn Source,
    output: &Path,
    options: &BuildOptions,
    observer: &dyn Observer,
) -> Result<Report> {
    let start = Instant::now();
    let threads = rayon::ThreadPoolBuilder::new()
        .num_threads(options.jobs.unwrap_or(0))
        .build()
        .map_err(|e| Error::usage(format!("cannot start {:?} threads: {e}", options.jobs)))?;
    threads.install(|| {
        let mut plan = plan(source.info(), options)?;
        let writer = ContainerWriter::create(output, options.force)?;
        plan.recipe = recipe(source, options, observer)?;
        let mut sweep = Sweep::new(&plan, writer);
        read_bands(source, &plan, &mut sweep, observer)?;
        let (writer, tally) = sweep.finish()?;
        if writer.tile_count() == 0 {
            return Err(all_void(source, &plan));
        }
        observer.rows(Stage::Write, 0, 1);
        let header = plan.header(source.info(), writer.tile_count());
        let statistics = tally.statistics(&header);
        let metadata = metadata(source, &plan, &statistics, options);
        let file = writer.finish(&header, &metadata, &statistics)?;
        observer.rows(Stage::Write, 1, 1);
        Ok(Report { header, statistics, file, elapsed: start.elapsed() })
    })
}

/// The recipe of the samples; quantising needs the largest height first, which costs one more pass over the source.
fn recipe(source: &dyn Source, options: &BuildOptions, observer: &dyn Observer) -> Result<Recipe> {
    let mut info = source.info().clone();
    info.nodata = options.nodata.or(info.nodata);
    let Some(precision) = options.precision_m else { return Ok(Recipe::lossless(&info)) };
    let mut largest = 0.0_f64;
    let mut row = 0;
    while row < info.height {
        if observer.cancelled() {
            return Err(Error::Interrupted);
        }
        let end = (row + options.tile).min(info.height);
        largest = largest.max(max_magnitude(&source.read_rows(row..end)?, info.nodata));
        row = end;
        observer.rows(Stage::Scan, u64::from(row), u64::from(info.height));
    }
    Recipe::quantised(&info, precision, largest)
}

/// Reads the raster band by band, each `T + 1` rows, and hands the leaf tiles to the sweep.
fn read_bands(source: &dyn Source, plan: &Plan, sweep: &mut Sweep, observer: &dyn Observer) -> Result<()> {
    let info = source.info();
    let tile = plan.tile as u32;
    let mut codes = CodeRows::default();
    for band in 0..plan.rows_of_tiles(plan.levels) {
        if observer.cancelled() {
            return Err(Error::Interrupted);
        }
        let first = band * tile;
        let end = (u64::from(first) + u64::from(tile) + 1).min(u64::from(info.height)) as u32;
        let window = source.read_rows(first..end)?;
        plan.recipe.encode(&window, &mut codes);
        drop(window);
        let tiles = split_band(&codes, info.width as usize, band, plan);
        sweep.push(tiles)?;
        observer.rows(Stage::Build, u64::from(end), u64::from(info.height));
    }
    Ok(())
}

/// Leaf tiles of a band.
fn split_band(codes: &CodeRows, width: usize, band: u32, plan: &Plan) -> TileRow {
    use rayon::prelude::*;
    let columns = plan.columns_of_tiles(plan.levels);
    let tiles = (0..columns)
        .into_par_iter()
        .map(|x| {
            let lattice = split::leaf(codes, width, x as usize, plan.tile, plan.recipe.coding)?;
            Some(Work::leaf(lattice))
        })
        .collect();
    TileRow { y: band, tiles }
}

fn all_void(source: &dyn Source, plan: &Plan) -> Error {
    let info = source.info();
    let nodata = plan.recipe.nodata.map_or_else(|| "none".to_owned(), |v| v.to_string());
    Error::format(
        "elevation band",
        "at least one valid sample",
        format!(
            "{} x {} samples that are all void (nodata value: {nodata}); if that value is wrong, give --nodata",
            info.width, info.height
        ),
    )
}

fn metadata(source: &dyn Source, plan: &Plan, statistics: &Statistics, options: &BuildOptions) -> Metadata {
    let info = source.info();
    Metadata {
        tool: concat!("relevo ", env!("CARGO_PKG_VERSION")).to_owned(),
        crs: info.geo.crs.clone(),
        pixel_is_point: info.geo.pixel_is_point,
        bounds: info.geo.transform.map(|_| info.geo.bounds(info.width, info.height)),
        vertical_unit: info.vertical_unit.1.clone(),
        sources: vec![SourceNote {
            name: options.source_name.clone(),
            description: info.description.clone(),
        }],
        options: plan.options_json(options),
        levels: statistics.levels.iter().map(level_note).collect(),
    }
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
