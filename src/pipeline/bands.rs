//! [`Bands`]: rows of leaf tiles from bands of the source, `T + 1` rows of samples each.

use rayon::prelude::*;

use super::buffers::Buffers;
use super::job::Job;
use super::sweep::{Slot, TileRow};
use super::tile_work::TileWork;
use crate::error::Result;
use crate::rect::Rect;
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

impl Bands<'_> {
    /// Row `y` of leaf tiles, with one tile on either side of the window. Tiles in rows before
    /// `first` are only looked at.
    pub fn row(&self, y: u32, first: u32) -> Result<TileRow> {
        let Job { source, plan, .. } = self.job;
        let (pyramid, spares) = (&plan.pyramid, &self.buffers.lattices);
        let columns = self.window.columns.start.saturating_sub(1)
            ..(self.window.columns.end + 1).min(pyramid.leaves().columns.end);
        let rows = pyramid.sample_rows(&(y..y + 1));
        let own = |x: u32| y >= first && self.window.contains(x, y);
        let mut slots = Vec::new();
        for run in plan.occupied.runs(y, &columns) {
            let samples = pyramid.sample_columns(&run);
            let window = source.read_window(samples.clone(), rows.clone())?;
            slots.par_extend(run.clone().into_par_iter().filter_map(|x| {
                let local = (x - run.start) as usize;
                let mut lattice = spares.take(pyramid.tile);
                if !split::leaf((&window, samples.len()), local, pyramid.tile, &plan.recipe, &mut lattice) {
                    spares.give(pyramid.tile, lattice);
                    return None;
                }
                if !own(x) {
                    return Some((x, Slot::Seen(lattice)));
                }
                fill::inside(&mut lattice);
                Some((x, Slot::TileWork(Box::new(TileWork::leaf(lattice)))))
            }));
            source.take_back(window);
        }
        Ok(TileRow { y, slots })
    }
}
