//! [`estimate`]: how long a build will take and how large its file will be, from some tiles that
//! are built and thrown away.

use std::ops::Range;
use std::time::Instant;

use rayon::prelude::*;

use crate::error::Result;
use crate::pipeline::buffers::Buffers;
use crate::pipeline::child_summary::ChildSummary;
use crate::pipeline::options::BuildOptions;
use crate::pipeline::plan::{Plan, recipe};
use crate::pipeline::threads::threads;
use crate::pipeline::tile_work::{Finished, TileWork};
use crate::source::{Source, Window};
use crate::tile::code::max_magnitude;
use crate::tile::{TileId, fill, split};

/// Tiles of the level above the leaves that are made, at most, each of four leaves.
const BLOCKS: u64 = 16;
/// Samples that are read at most, about, and columns of a band.
const SAMPLES: u64 = 24 << 20;
const COLUMNS: u32 = 1 << 16;
/// Bytes of the index for each tile, of statistics and metadata for each level, and of what every
/// file has.
const ROW: u64 = 24;
const LEVEL: u64 = 1000;
const FIXED: u64 = 1100;
/// Factor for the rest of the time: waiting at the ends of rows, putting the file together.
const REST: f64 = 1.15;
/// Bytes a second that are written, and read and written once more.
const DISK: f64 = 400e6;

/// What a build will take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Bytes of the finished file, without imagery.
    pub bytes: u64,
    /// Seconds until it is there, without imagery.
    pub seconds: f64,
    /// Leaf tiles that were built for it.
    pub tiles: u64,
}

/// Time and bytes of the tiles that were built.
#[derive(Default)]
struct Sample {
    leaves: u64,
    leaf_bytes: u64,
    parents: u64,
    parent_bytes: u64,
    samples: u64,
    read_seconds: f64,
    work_seconds: f64,
}

/// Estimates a build. Reads some bands of the source.
pub fn estimate(source: &dyn Source, options: &BuildOptions, plan: &Plan) -> Result<Estimate> {
    threads(options.jobs)?.install(|| {
        let mut sample = Sample::default();
        let mut plan = plan.clone();
        let buffers = Buffers::default();
        for (row, columns) in blocks(&plan) {
            sample.add((source, options), &mut plan, &buffers, row, &columns)?;
        }
        Ok(sample.of_all(&plan, options))
    })
}

/// Rows of tiles of the level above the leaves, and the columns of each that are made: spread
/// evenly over the tiles that exist.
fn blocks(plan: &Plan) -> Vec<(u32, Vec<u32>)> {
    let leaf_rows = plan.pyramid.leaves().rows.end;
    let band = u64::from(plan.pyramid.width.min(COLUMNS)) * 2 * plan.pyramid.tile as u64;
    let most = (SAMPLES / band.max(1)).clamp(1, 4);
    let of_row = |y: u32| -> u64 {
        plan.occupied.runs(y, &(0..u32::MAX)).iter().map(|run| u64::from(run.end - run.start)).sum()
    };
    let rows: Vec<(u32, u64)> =
        (0..leaf_rows.div_ceil(2)).map(|row| (row, of_row(2 * row) + of_row(2 * row + 1))).collect();
    let all: u64 = rows.iter().map(|(_, tiles)| tiles).sum();
    let mut chosen: Vec<u32> = Vec::new();
    for i in 0..most {
        // The row that holds this tile, counted from the north.
        let wanted = all * (2 * i + 1) / (2 * most);
        let mut before = 0;
        let found = rows.iter().find(|(_, tiles)| {
            before += tiles;
            before > wanted
        });
        chosen.extend(found.map(|(row, _)| *row));
    }
    chosen.dedup();
    let each = BLOCKS.div_ceil(chosen.len().max(1) as u64) as usize;
    chosen.into_iter().map(|row| (row, columns(plan, row, each))).collect()
}

/// At most `most` columns of a row of tiles above the leaves, spread evenly over those that exist
/// and that one band holds.
fn columns(plan: &Plan, row: u32, most: usize) -> Vec<u32> {
    let runs = (2 * row..2 * row + 2).flat_map(|y| plan.occupied.runs(y, &(0..u32::MAX)));
    let mut all: Vec<u32> = runs.flat_map(|run| run.start / 2..run.end.div_ceil(2)).collect();
    all.sort_unstable();
    all.dedup();
    let middle = all.get(all.len() / 2).copied().unwrap_or(0);
    let within = COLUMNS / (4 * plan.pyramid.tile as u32);
    all.retain(|x| x.abs_diff(middle) < within.max(1));
    let count = all.len().min(most);
    (0..count).filter_map(|i| all.get((2 * i + 1) * all.len() / (2 * count)).copied()).collect()
}

impl Sample {
    /// Reads two rows of leaf tiles and makes some tiles of them.
    fn add(
        &mut self,
        (source, options): (&dyn Source, &BuildOptions),
        plan: &mut Plan,
        buffers: &Buffers,
        row: u32,
        columns: &[u32],
    ) -> Result<()> {
        let leaf_rows = plan.pyramid.leaves().rows.end;
        let (first, last) = (columns.first().copied().unwrap_or(0), columns.last().copied().unwrap_or(0));
        // A narrow raster is read as the build reads it; of a wide one, what lies between the
        // tiles.
        let within = if plan.pyramid.width <= COLUMNS { 0..u32::MAX } else { 2 * first..2 * last + 2 };
        let mut leaves = Vec::new();
        for y in (2 * row..2 * row + 2).filter(|&y| y < leaf_rows) {
            for run in plan.occupied.runs(y, &within) {
                let begun = Instant::now();
                let samples = plan.pyramid.sample_columns(&run);
                let window = source.read_window(samples.clone(), plan.pyramid.sample_rows(&(y..y + 1)))?;
                self.read_seconds += begun.elapsed().as_secs_f64();
                self.samples += window.samples.len() as u64;
                if options.precision_m.is_some() {
                    let nodata = plan.recipe.nodata;
                    plan.recipe = recipe(source.info(), options, max_magnitude(&window, nodata).max(1.0))?;
                }
                let begun = Instant::now();
                let made = self.make(plan, buffers, (&window, samples.len()), y, &run, columns)?;
                self.work_seconds += begun.elapsed().as_secs_f64();
                leaves.extend(made);
            }
        }
        let begun = Instant::now();
        self.join(plan, buffers, row, columns, leaves)?;
        self.work_seconds += begun.elapsed().as_secs_f64();
        Ok(())
    }

    /// Makes the leaf tiles of a run that lie below `columns`. Returns their summaries.
    fn make(
        &mut self,
        plan: &Plan,
        buffers: &Buffers,
        band: (&Window, usize),
        y: u32,
        run: &Range<u32>,
        columns: &[u32],
    ) -> Result<Vec<(TileId, ChildSummary)>> {
        let wanted: Vec<u32> = run.clone().filter(|x| columns.contains(&(x / 2))).collect();
        self.leaves += wanted.len() as u64;
        let made: Vec<Option<(TileId, Finished, ChildSummary)>> = wanted
            .into_par_iter()
            .map(|x| {
                let mut lattice = buffers.lattices.take(plan.pyramid.tile);
                if !split::leaf(band, (x - run.start) as usize, plan.pyramid.tile, &plan.recipe, &mut lattice)
                {
                    return Ok(None);
                }
                fill::inside(&mut lattice);
                let id = TileId::new(plan.pyramid.levels, x, y);
                let work = TileWork::leaf(lattice);
                let (finished, summary, _) = work.finish(id, &[], plan, &mut buffers.lend())?;
                Ok(Some((id, finished, summary)))
            })
            .collect::<Result<_>>()?;
        let made = made.into_iter().flatten();
        Ok(made
            .map(|(id, finished, summary)| {
                self.leaf_bytes += bytes(&finished);
                (id, summary)
            })
            .collect())
    }

    /// Makes the tiles above some leaves.
    fn join(
        &mut self,
        plan: &Plan,
        buffers: &Buffers,
        row: u32,
        columns: &[u32],
        mut leaves: Vec<(TileId, ChildSummary)>,
    ) -> Result<()> {
        if plan.pyramid.levels == 0 {
            return Ok(());
        }
        let mut works = Vec::with_capacity(columns.len());
        for &x in columns {
            let id = TileId::new(plan.pyramid.levels - 1, x, row);
            let summaries = [0, 1, 2, 3].map(|quadrant| {
                let at = leaves.iter().position(|(leaf, _)| *leaf == id.child(quadrant))?;
                Some(leaves.swap_remove(at).1)
            });
            works.extend(TileWork::parent(summaries).map(|work| (id, work)));
        }
        let made: Vec<Finished> = works
            .into_par_iter()
            .map(|(id, work)| Ok(work.finish(id, &[], plan, &mut buffers.lend())?.0))
            .collect::<Result<_>>()?;
        self.parents += columns.len() as u64;
        self.parent_bytes += made.iter().map(bytes).sum::<u64>();
        Ok(())
    }

    /// The estimate of the whole build, if all tiles are like these.
    fn of_all(&self, plan: &Plan, options: &BuildOptions) -> Estimate {
        let tiles = plan.most_tiles();
        let (&leaves, above) = tiles.split_last().unwrap_or((&0, &[]));
        let above: u64 = above.iter().sum();
        let each = |bytes: u64, of: u64| bytes as f64 / of.max(1) as f64;
        let chunks = each(self.leaf_bytes, self.leaves) * leaves as f64
            + each(self.parent_bytes, self.parents) * above as f64;
        let bytes = chunks as u64 + (leaves + above) * ROW + tiles.len() as u64 * LEVEL + FIXED;
        let side = (plan.pyramid.tile * plan.pyramid.tile) as f64;
        let samples =
            (leaves as f64 * side).min(f64::from(plan.pyramid.width) * f64::from(plan.pyramid.height));
        let passes = if options.precision_m.is_some() { 2.0 } else { 1.0 };
        let reading = passes * samples * self.read_seconds / self.samples.max(1) as f64;
        let working = self.work_seconds * leaves as f64 / self.leaves.max(1) as f64;
        let seconds = (reading + working) * REST + 2.0 * bytes as f64 / DISK;
        Estimate { bytes, seconds, tiles: self.leaves }
    }
}

/// Bytes that a tile takes in the file.
fn bytes(tile: &Finished) -> u64 {
    let chunks = &tile.chunks;
    (chunks.mask.len() + chunks.heights.len() + chunks.errors.len()) as u64
}
