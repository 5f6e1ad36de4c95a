//! [`Bands`]: rows of leaf tiles from bands of the source, `T + 1` rows of samples each.
//!
//! A tile with voids is cut from its band at once: fills look at it and at its neighbours. One
//! without is cut by the task that finishes it, which then has it in the processor's cache. Until
//! then the samples stay as they were read, which takes less memory.

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use super::buffers::Buffers;
use super::job::Job;
use super::plan::Plan;
use super::tile_row::{Slot, TileRow};
use super::tile_work::TileWork;
use crate::error::Result;
use crate::rect::Rect;
use crate::sample::Lattice;
use crate::source::{Source, Window};
use crate::tile::{fill, split};

/// Reads the bands of the source that a window needs.
pub struct Bands<'a> {
    /// The build.
    pub job: &'a Job<'a>,
    /// Memory of tiles that are done with.
    pub buffers: &'a Buffers,
    /// The leaf tiles that are to be made.
    pub window: Rect,
}

impl<'a> Bands<'a> {
    /// Row `y` of leaf tiles, with one tile on either side of the window. Tiles in rows before
    /// `first` are only looked at.
    pub fn row(&self, y: u32, first: u32) -> Result<TileRow<'a>> {
        let (plan, spares) = (&self.job.plan, &self.buffers.lattices);
        let columns = self.window.columns.start.saturating_sub(1)
            ..(self.window.columns.end + 1).min(plan.pyramid.leaves().columns.end);
        let band = Arc::new(Band::read(self.job, y, &columns)?);
        let own = |x: u32| y >= first && self.window.contains(x, y);
        let slot = |x: u32| {
            if own(x) && band.is_valid(x) {
                return Some((x, Slot::TileWork(Box::new(TileWork::uncut(band.clone(), x)))));
            }
            let mut lattice = spares.take(plan.pyramid.tile);
            if !band.cut(x, &mut lattice) {
                spares.give(plan.pyramid.tile, lattice);
                return None;
            }
            if !own(x) {
                return Some((x, Slot::Seen(lattice)));
            }
            fill::inside(&mut lattice);
            Some((x, Slot::TileWork(Box::new(TileWork::leaf(lattice)))))
        };
        let columns: Vec<u32> = band.columns().collect();
        let slots = columns.into_par_iter().filter_map(slot).collect();
        let mut row = TileRow { y, slots };
        row.cut_if_smaller(plan, self.buffers);
        Ok(row)
    }
}

/// The samples of a row of leaf tiles, as they were read.
pub struct Band<'a> {
    source: &'a dyn Source,
    plan: &'a Plan,
    /// For each run of tiles, from west to east: its columns, how many samples a row has, and the
    /// rows.
    runs: Vec<(Range<u32>, usize, Window)>,
    /// Bytes of all samples.
    pub bytes: u64,
}

impl<'a> Band<'a> {
    fn read(job: &'a Job<'a>, y: u32, columns: &Range<u32>) -> Result<Self> {
        let (plan, pyramid) = (&job.plan, &job.plan.pyramid);
        let rows = pyramid.sample_rows(&(y..y + 1));
        let mut band = Self { source: job.source, plan, runs: Vec::new(), bytes: 0 };
        for run in plan.occupied.runs(y, columns) {
            let samples = pyramid.sample_columns(&run);
            let window = job.source.read_window(samples.clone(), rows.clone())?;
            let mask = window.mask.as_ref().map_or(0, |mask| mask.len() as u64);
            band.bytes += window.samples.len() as u64 * plan.sample_bytes + mask;
            band.runs.push((run, samples.len(), window));
        }
        Ok(band)
    }

    /// The tiles that may exist, by their column.
    fn columns(&self) -> impl Iterator<Item = u32> + '_ {
        self.runs.iter().flat_map(|(run, ..)| run.clone())
    }

    /// The run of a tile: its rows, how many samples each has, and the number of the tile in it.
    fn place(&self, x: u32) -> Option<(&Window, usize, usize)> {
        let (run, width, window) = self.runs.get(self.runs.partition_point(|(run, ..)| run.end <= x))?;
        Some((window, *width, (x - run.start) as usize))
    }

    /// True if the tile in column `x` has no void sample.
    fn is_valid(&self, x: u32) -> bool {
        let Plan { recipe, pyramid, .. } = self.plan;
        self.place(x)
            .is_some_and(|(window, width, x)| split::is_valid((window, width), x, pyramid.tile, recipe))
    }

    /// Sets `out` to the tile in column `x`. Returns false if it does not exist.
    pub fn cut(&self, x: u32, out: &mut Lattice) -> bool {
        let Plan { recipe, pyramid, .. } = self.plan;
        self.place(x)
            .is_some_and(|(window, width, x)| split::leaf((window, width), x, pyramid.tile, recipe, out))
    }
}

impl Drop for Band<'_> {
    fn drop(&mut self) {
        self.runs.drain(..).for_each(|(.., window)| self.source.take_back(window));
    }
}
