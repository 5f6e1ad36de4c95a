//! [`Sweep`]: rows of tiles go through every level from north to south.
//!
//! ```text
//!                 column 0    1    2    3
//! level l, row    +----+----+----+----+
//!   y - 1  north  | only what is seen  |      fills of row y look at all eight neighbours,
//!                 +----+----+----+----+        so its tiles with voids wait for row y + 1
//!   y    current  | fill, measure,     |  --> writer, statistics
//!                 | encode, halve      |  --> a child summary for each tile
//!                 +----+----+----+----+
//!   y + 1  south  | has just come      |      above the leaves, tiles without voids are finished
//!                 +----+----+----+----+        as they come
//!
//!   waiting       s0   s1   s2   s3            summaries of row y, if y is even;
//!                 t0   t1   t2   t3            with those of row y + 1 they make
//!                  \  /      \  /              one row of the level above:
//! level l - 1     +---------+---------+
//!   y / 2  south  | s0 s1   | s2 s3   |        pushed there as its next row, up to the root
//!                 | t0 t1   | t2 t3   |
//!                 +---------+---------+
//! carried         at the sides of the window: summaries whose parent is not assembled or not
//!                 finished here, and borders that other tiles look at (`window_levels`, `carry`)
//! ```
//!
//! What other builds have carried is put in its place as its row comes by. A row holds the tiles
//! that exist and nothing for the others: work and memory follow the number of tiles, however large
//! the raster is.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::buffers::{Buffers, Lent};
use super::carry::{Carried, CarryFile, Item, encode_each};
use super::child_summary::ChildSummary;
use super::plan::Plan;
use super::statistics::StatisticsBuilder;
use super::tile_row::{Slot, Summaries, TileRow, fills, give_back};
use super::tile_work::{Finished, TileWork};
use super::window_levels::WindowLevels;
use crate::error::Result;
use crate::tile::TileId;
use crate::tile::fill::Fill;
use crate::writer::ContainerWriter;

/// All levels of a build in progress.
pub struct Sweep<'a> {
    plan: &'a Plan,
    window_levels: WindowLevels,
    levels: Vec<Level<'a>>,
    output: Output,
    /// Memory of tiles that are done with.
    buffers: &'a Buffers,
    /// Finished tiles that are written and counted while the next row is worked on.
    unwritten: Vec<Finished>,
    /// What other builds have carried to this sweep.
    earlier: Carried,
    /// Rows of leaf tiles before this one are finished elsewhere: if they come, they are only
    /// looked at.
    passed: u32,
}

/// Where a sweep puts what it makes.
pub struct Output {
    /// Gets the finished tiles.
    pub writer: ContainerWriter,
    /// Counts them.
    pub statistics: StatisticsBuilder,
    /// Gets what the merge will need.
    pub carry: CarryFile,
}

#[derive(Default)]
struct Level<'a> {
    /// The last finished row: only its lattices are used.
    north: Option<TileRow<'a>>,
    /// The next row to be finished.
    current: Option<TileRow<'a>>,
    /// Summaries of the last finished row, if the row that it is paired with is still to come.
    waiting: Option<(u32, Summaries)>,
}

impl<'a> Sweep<'a> {
    /// A sweep over the tiles of a window. `earlier` is what other builds have carried to it.
    pub fn new(
        plan: &'a Plan,
        buffers: &'a Buffers,
        window_levels: WindowLevels,
        output: Output,
        earlier: Carried,
    ) -> Self {
        let levels = (0..=plan.pyramid.levels).map(|_| Level::default()).collect();
        Self { plan, window_levels, levels, output, buffers, unwritten: Vec::new(), earlier, passed: 0 }
    }

    /// Takes the next row of leaf tiles.
    pub fn push(&mut self, row: TileRow<'a>) -> Result<()> {
        self.push_at(self.plan.pyramid.levels, row)
    }

    /// Passes over a row of leaf tiles that other builds have finished: goes on from what they have
    /// carried.
    pub fn pass(&mut self, y: u32) -> Result<()> {
        self.passed = y + 1;
        let leaves = self.plan.pyramid.levels;
        let summaries = self.earlier.take_summaries(leaves, y, self.plan)?;
        self.stack(leaves, y, summaries)
    }

    /// Finishes the rows that still wait for another, at every level.
    pub fn finish(&mut self) -> Result<()> {
        for level in (0..=self.plan.pyramid.levels).rev() {
            if self.levels[usize::from(level)].current.is_some() {
                self.work(level, None)?;
            }
            if let Some((y, north)) = self.levels[usize::from(level)].waiting.take() {
                self.lift(level, y, north, Vec::new())?;
            }
        }
        self.settle()
    }

    /// Writes and counts the tiles that have been finished.
    pub fn settle(&mut self) -> Result<()> {
        let tiles = std::mem::take(&mut self.unwritten);
        self.output.write(tiles, self.plan)
    }

    /// Hands to `put` all that is in the levels now, as items. With the carry file and the tiles
    /// written so far, it is all that a sweep needs to go on from here.
    pub fn carry_all(&self, put: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
        for (level, state) in (0..).zip(&self.levels) {
            if let Some((y, waiting)) = &state.waiting {
                let items = waiting.iter().map(|(x, q)| Item::Summary(TileId::new(level, *x, *y), q));
                encode_each(&items.collect::<Vec<_>>(), put)?;
            }
            if level == self.plan.pyramid.levels {
                // Leaf tiles are read from the source again.
                continue;
            }
            for row in [&state.north, &state.current].into_iter().flatten() {
                row.carry_over(level, |_| true, put)?;
            }
        }
        Ok(())
    }

    /// The writer, to mark how far it is.
    pub fn writer(&mut self) -> &mut ContainerWriter {
        &mut self.output.writer
    }

    /// The carry file, to mark how far it is.
    pub fn carry_file(&mut self) -> &mut CarryFile {
        &mut self.output.carry
    }

    /// What has been counted.
    pub fn statistics(&self) -> &StatisticsBuilder {
        &self.output.statistics
    }

    /// What has been made.
    pub fn into_output(self) -> Output {
        self.output
    }

    fn push_at(&mut self, level: u8, mut row: TileRow<'a>) -> Result<()> {
        if level < self.plan.pyramid.levels && self.is_finished_here(level, row.y) {
            // Tiles without voids need no neighbour. What they leave takes less memory than what
            // their children left for them. (Leaf tiles take the least while they are in the band.)
            self.finish_tiles(level, &mut row, Vec::new(), |work| !work.has_void(), |_| true)?;
        }
        if self.levels[usize::from(level)].current.is_some() {
            self.work(level, Some(&mut row))?;
        }
        self.levels[usize::from(level)].current = Some(row);
        Ok(())
    }

    /// True if the tiles of this row are finished here, and not only looked at.
    fn is_finished_here(&self, level: u8, y: u32) -> bool {
        let passed = level == self.plan.pyramid.levels && y < self.passed;
        self.window_levels.finished(level).rows.contains(&y) && !passed
    }

    /// Finishes the current row of a level, now that the row to the south is known.
    fn work(&mut self, level: u8, mut south: Option<&mut TileRow<'a>>) -> Result<()> {
        let Some(mut row) = self.levels[usize::from(level)].current.take() else { return Ok(()) };
        let is_finished = self.is_finished_here(level, row.y);
        if is_finished {
            self.finish_row(level, &mut row, south.as_deref_mut())?;
        }
        let (y, summaries) = (row.y, row.take_summaries());
        self.carry_over(level, &row)?;
        let row = south.map(|south| row.needed_by(&south.looking(), self.buffers));
        let north = std::mem::replace(&mut self.levels[usize::from(level)].north, row);
        give_back(north.into_iter().flat_map(|row| row.slots), self.buffers);
        if is_finished { self.stack(level, y, summaries) } else { Ok(()) }
    }

    /// Finishes the tiles of a row that can be finished here.
    fn finish_row(
        &mut self,
        level: u8,
        row: &mut TileRow<'a>,
        mut south: Option<&mut TileRow<'a>>,
    ) -> Result<()> {
        let looking = row.looking();
        let north = self.levels[usize::from(level)].north.as_mut();
        for row in north.into_iter().chain([&mut *row]).chain(south.as_deref_mut()) {
            row.show_to(&looking, self.plan, self.buffers);
        }
        let south = south.as_deref();
        let columns = &self.window_levels.finished(level).columns;
        let north = self.levels[usize::from(level)].north.as_ref();
        let fills = fills(&self.plan.pyramid, level, north, row, south, columns);
        let (looking, y) = (south.map(TileRow::looking), row.y);
        let (window_levels, is_leaf) = (self.window_levels.clone(), level == self.plan.pyramid.levels);
        let is_seen = |x: u32| {
            looking.as_ref().is_some_and(|looking| looking.at(x))
                || !is_leaf && window_levels.is_at_side(level, x, y)
        };
        self.finish_tiles(level, row, fills, |_| true, is_seen)
    }

    /// Finishes those tiles of a row that are `wanted` and can be finished here, with these fills
    /// (none if the list is empty). It keeps the samples of those that are `seen`. Meanwhile the
    /// tiles finished before are written.
    fn finish_tiles(
        &mut self,
        level: u8,
        row: &mut TileRow<'a>,
        mut fills: Vec<Vec<Fill>>,
        wanted: impl Fn(&TileWork<'a>) -> bool + Sync,
        seen: impl Fn(u32) -> bool + Sync,
    ) -> Result<()> {
        let (plan, buffers, y) = (self.plan, self.buffers, row.y);
        let columns = self.window_levels.finished(level).columns.clone();
        fills.resize(row.slots.len(), Vec::new());
        let finish = |lent: &mut Lent<'_>, ((x, slot), fills): ((u32, Slot<'a>), Vec<Fill>)| {
            let work = match slot {
                Slot::TileWork(work) if columns.contains(&x) && wanted(&work) => work,
                other => return Ok(((x, other), None)),
            };
            let (tile, summary, lattice) = work.finish(TileId::new(level, x, y), &fills, plan, lent)?;
            let lattice = if seen(x) {
                Some(lattice)
            } else {
                buffers.lattices.give(lattice.n, lattice);
                None
            };
            Ok(((x, Slot::Finished(Box::new(summary), lattice)), Some(tile)))
        };
        let slots = std::mem::take(&mut row.slots);
        let work = || -> Vec<Result<_>> {
            slots.into_par_iter().zip(fills).map_init(|| buffers.lend(), finish).collect()
        };
        let (unwritten, output) = (std::mem::take(&mut self.unwritten), &mut self.output);
        let (written, finished) = rayon::join(|| output.write(unwritten, plan), work);
        written?;
        for result in finished {
            let (slot, tile) = result?;
            row.slots.push(slot);
            self.unwritten.extend(tile);
        }
        Ok(())
    }

    /// Carries what the merge will need of a row that has been finished.
    fn carry_over(&mut self, level: u8, row: &TileRow<'a>) -> Result<()> {
        if level == self.plan.pyramid.levels {
            return Ok(());
        }
        let (carry, window_levels) = (&mut self.output.carry, &self.window_levels);
        row.carry_over(level, |x| window_levels.is_at_side(level, x, row.y), &mut |bytes| carry.put(bytes))
    }

    /// Pairs a finished row with the one that waits for it.
    fn stack(&mut self, level: u8, y: u32, summaries: Summaries) -> Result<()> {
        if level == 0 {
            return Ok(());
        }
        let waiting = &mut self.levels[usize::from(level)].waiting;
        if y.is_multiple_of(2) {
            *waiting = Some((y, summaries));
            return Ok(());
        }
        let north = waiting.take().map_or_else(Vec::new, |(_, north)| north);
        self.lift(level, y, north, summaries)
    }

    /// Makes the parents of two rows and pushes them to the level above. Summaries whose parent is
    /// not assembled here are carried.
    fn lift(&mut self, level: u8, y: u32, north: Summaries, south: Summaries) -> Result<()> {
        if level == 0 {
            return Ok(());
        }
        let (above, y) = (level - 1, y / 2);
        let assembled = self.window_levels.assembled(above).clone();
        let mut quads: BTreeMap<u32, [Option<ChildSummary>; 4]> = BTreeMap::new();
        let mut carried = Vec::new();
        for (half, row) in [north, south].into_iter().enumerate() {
            for (x, summary) in row {
                if assembled.contains(x / 2, y) {
                    quads.entry(x / 2).or_default()[2 * half + x as usize % 2] = Some(summary);
                } else {
                    carried.push((TileId::new(level, x, 2 * y + half as u32), summary));
                }
            }
        }
        let items: Vec<_> = carried.iter().map(|(id, summary)| Item::Summary(*id, summary)).collect();
        self.output.carry.append(&items)?;
        if !assembled.rows.contains(&y) {
            return Ok(());
        }
        let buffers = self.buffers;
        for (_, summary) in carried {
            summary.into_errors(buffers);
        }
        let parent = |(x, quad)| Some((x, Slot::TileWork(Box::new(TileWork::parent(quad)?))));
        let quads: Vec<_> = quads.into_iter().collect();
        let mut slots: Vec<(u32, Slot)> = quads.into_par_iter().filter_map(parent).collect();
        let earlier = self.take_earlier(above, y)?;
        let is_made = |x: &u32| slots.binary_search_by_key(x, |(x, _)| *x).is_ok();
        let earlier: Vec<_> = earlier.into_iter().filter(|(x, _)| !is_made(x)).collect();
        slots.extend(earlier);
        slots.sort_unstable_by_key(|(x, _)| *x);
        self.push_at(above, TileRow { y, slots })
    }

    /// The tiles of a row that other builds have finished, as far as they are wanted here: what
    /// they left for their parents, and their borders.
    fn take_earlier(&mut self, level: u8, y: u32) -> Result<Vec<(u32, Slot<'a>)>> {
        let columns = self.window_levels.assembled(level).columns.clone();
        let borders = self.earlier.take_borders(level, y, self.plan)?;
        let mut borders: BTreeMap<u32, _> =
            borders.into_iter().filter(|(x, _)| columns.contains(x)).collect();
        let summaries = self.earlier.take_summaries(level, y, self.plan)?;
        let finished = |(x, summary)| (x, Slot::Finished(Box::new(summary), borders.remove(&x)));
        let mut slots: Vec<_> = summaries.into_iter().map(finished).collect();
        slots.extend(borders.into_iter().map(|(x, border)| (x, Slot::Seen(border))));
        Ok(slots)
    }
}

impl Output {
    /// Writes and counts finished tiles.
    fn write(&mut self, tiles: Vec<Finished>, plan: &Plan) -> Result<()> {
        for tile in tiles {
            self.writer.append(&tile.record, &tile.chunks)?;
            self.statistics.add(&tile, &plan.geometry(tile.record.id));
        }
        Ok(())
    }
}
