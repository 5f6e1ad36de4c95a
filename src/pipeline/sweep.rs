//! [`Sweep`]: rows of tiles go through every level from north to south.
//!
//! ```text
//!                 column 0    1    2    3
//! level l, row    +----+----+----+----+
//!   y - 1  north  | done: lattices only |      fills of row y look at all eight neighbours,
//!                 +----+----+----+----+        so that row y waits for row y + 1
//!   y    current  | fill, measure,     |  --> writer, statistics
//!                 | encode, halve      |  --> a child summary for each tile
//!                 +----+----+----+----+
//!   y + 1  south  | has just come      |
//!                 +----+----+----+----+
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

use super::buffers::Buffers;
use super::carry::{Carried, CarryFile, Item, encode_each};
use super::child_summary::ChildSummary;
use super::plan::Plan;
use super::pyramid::Pyramid;
use super::statistics::StatisticsBuilder;
use super::tile_work::{Finished, TileWork};
use super::window_levels::WindowLevels;
use crate::error::Result;
use crate::sample::{Lattice, VOID};
use crate::tile::TileId;
use crate::tile::fill::{self, Fill, Neighbourhood};
use crate::writer::ContainerWriter;

/// A tile's place in a row.
pub enum Slot {
    /// A tile to be finished. Afterwards its neighbours still look at its lattice.
    TileWork(Box<TileWork>),
    /// A tile that is finished elsewhere, or lies outside the window: its neighbours look at it.
    Seen(Lattice),
}

impl Slot {
    fn lattice(&self) -> &Lattice {
        match self {
            Self::TileWork(work) => &work.lattice,
            Self::Seen(lattice) => lattice,
        }
    }

    fn into_lattice(self) -> Lattice {
        match self {
            Self::TileWork(work) => work.lattice,
            Self::Seen(lattice) => lattice,
        }
    }
}

/// Tiles of one row of a level.
pub struct TileRow {
    /// The row.
    pub y: u32,
    /// The tiles that exist, by their column, from west to east.
    pub slots: Vec<(u32, Slot)>,
}

impl TileRow {
    fn slot(&self, x: u32) -> Option<&Slot> {
        let index = self.slots.binary_search_by_key(&x, |(x, _)| *x).ok()?;
        self.slots.get(index).map(|(_, slot)| slot)
    }

    /// The row without the tiles that no tile of the row to the south will look at. Only tiles with
    /// voids look.
    fn needed_by(mut self, south: &Self, buffers: &Buffers) -> Self {
        let has_void =
            |slot: &Slot| matches!(slot, Slot::TileWork(work) if work.lattice.state.contains(&VOID));
        let looking: Vec<u32> =
            south.slots.iter().filter(|(_, slot)| has_void(slot)).map(|(x, _)| *x).collect();
        let unseen = |(x, _): &mut (u32, Slot)| {
            let next = looking.partition_point(|looking| looking + 1 < *x);
            looking.get(next).is_none_or(|looking| *looking > *x + 1)
        };
        give_back(self.slots.extract_if(.., unseen), buffers);
        self
    }

    /// Hands to `put` what the tiles in some columns carry: their borders if they are finished,
    /// else the summaries of their children.
    fn carry_over(
        &self,
        level: u8,
        wanted: impl Fn(u32) -> bool,
        put: &mut dyn FnMut(&[u8]) -> Result<()>,
    ) -> Result<()> {
        let mut items = Vec::new();
        for (x, slot) in self.slots.iter().filter(|(x, _)| wanted(*x)) {
            let (id, before) = (TileId::new(level, *x, self.y), items.len());
            if let Slot::TileWork(work) = slot {
                items.extend(work.quadrants().map(|quadrant| Item::Part(id.child(quadrant), work)));
            }
            if items.len() == before {
                items.push(Item::Border(id, slot.lattice()));
            }
        }
        encode_each(&items, put)
    }
}

/// Gives the memory of tiles back that no tile will look at any more.
fn give_back(slots: impl Iterator<Item = (u32, Slot)>, buffers: &Buffers) {
    slots.map(|(_, slot)| slot.into_lattice()).for_each(|lattice| buffers.lattices.give(lattice.n, lattice));
}

/// Summaries of a row by column, ascending.
type Summaries = Vec<(u32, ChildSummary)>;

/// All levels of a build in progress.
pub struct Sweep<'a> {
    plan: &'a Plan,
    window_levels: WindowLevels,
    levels: Vec<Level>,
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
struct Level {
    /// The last finished row: only its lattices are used.
    north: Option<TileRow>,
    /// The next row to be finished.
    current: Option<TileRow>,
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
    pub fn push(&mut self, row: TileRow) -> Result<()> {
        self.push_at(self.plan.pyramid.levels, row)
    }

    /// Passes over a row of leaf tiles that other builds have finished: goes on from what they have
    /// carried.
    pub fn pass(&mut self, y: u32) -> Result<()> {
        self.passed = y + 1;
        self.stack(self.plan.pyramid.levels, y, Vec::new())
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

    fn push_at(&mut self, level: u8, row: TileRow) -> Result<()> {
        if self.levels[usize::from(level)].current.is_some() {
            self.work(level, Some(&row))?;
        }
        self.levels[usize::from(level)].current = Some(row);
        Ok(())
    }

    /// Finishes the current row of a level, now that the row to the south is known.
    fn work(&mut self, level: u8, south: Option<&TileRow>) -> Result<()> {
        let Some(mut row) = self.levels[usize::from(level)].current.take() else { return Ok(()) };
        let passed = level == self.plan.pyramid.levels && row.y < self.passed;
        let summaries = if self.window_levels.finished(level).rows.contains(&row.y) && !passed {
            Some(self.finish_row(level, &mut row, south)?)
        } else {
            None
        };
        self.carry_over(level, &row)?;
        let y = row.y;
        let row = match south {
            Some(south) => Some(row.needed_by(south, self.buffers)),
            None => None,
        };
        let north = std::mem::replace(&mut self.levels[usize::from(level)].north, row);
        give_back(north.into_iter().flat_map(|row| row.slots), self.buffers);
        summaries.map_or(Ok(()), |summaries| self.stack(level, y, summaries))
    }

    /// Finishes the tiles of a row that can be finished here. Returns their summaries.
    fn finish_row(&mut self, level: u8, row: &mut TileRow, south: Option<&TileRow>) -> Result<Summaries> {
        let (plan, y) = (self.plan, row.y);
        let columns = self.window_levels.finished(level).columns.clone();
        let north = self.levels[usize::from(level)].north.as_ref();
        let fills = fills(&plan.pyramid, level, north, row, south, &columns);
        let buffers = self.buffers;
        let work = || -> Vec<Option<Result<(Finished, ChildSummary)>>> {
            row.slots
                .par_iter_mut()
                .zip(fills)
                .map_init(
                    || buffers.lend(),
                    |lent, ((x, slot), fills)| match slot {
                        Slot::TileWork(work) if columns.contains(x) => {
                            fill::apply(&mut work.lattice, &fills);
                            Some(work.finish(TileId::new(level, *x, y), plan, lent))
                        }
                        _ => None,
                    },
                )
                .collect()
        };
        let unwritten = std::mem::take(&mut self.unwritten);
        let (written, finished) = rayon::join(|| self.output.write(unwritten, plan), work);
        written?;
        let mut summaries = Vec::with_capacity(finished.len());
        for tile in finished.into_iter().flatten() {
            let (tile, summary) = tile?;
            summaries.push((tile.record.id.x, summary));
            self.unwritten.push(tile);
        }
        Ok(summaries)
    }

    /// Carries what the merge will need of a row that has been finished.
    fn carry_over(&mut self, level: u8, row: &TileRow) -> Result<()> {
        if level == self.plan.pyramid.levels {
            return Ok(());
        }
        let (carry, window_levels) = (&mut self.output.carry, &self.window_levels);
        row.carry_over(level, |x| window_levels.is_at_side(level, x, row.y), &mut |bytes| carry.put(bytes))
    }

    /// Pairs a finished row with the one that waits for it.
    fn stack(&mut self, level: u8, y: u32, mut summaries: Summaries) -> Result<()> {
        if level == 0 {
            return Ok(());
        }
        let earlier = self.earlier.take_summaries(level, y, self.plan)?;
        if !earlier.is_empty() {
            summaries.extend(earlier);
            summaries.sort_unstable_by_key(|(x, _)| *x);
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
        let (plan, above, y) = (self.plan, level - 1, y / 2);
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
        let parent = |(x, quad)| Some((x, Slot::TileWork(Box::new(TileWork::parent(quad, plan, buffers)?))));
        let quads: Vec<_> = quads.into_iter().collect();
        let mut slots: Vec<(u32, Slot)> = quads.into_par_iter().filter_map(parent).collect();
        let made = slots.len();
        for (x, border) in self.earlier.take_borders(above, y, plan)? {
            let is_made = slots[..made].binary_search_by_key(&x, |(x, _)| *x).is_ok();
            if assembled.columns.contains(&x) && !is_made {
                slots.push((x, Slot::Seen(border)));
            }
        }
        slots.sort_unstable_by_key(|(x, _)| *x);
        self.push_at(above, TileRow { y, slots })
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

/// Fills of the tiles of a row that lie in `columns`; no fills for the others.
fn fills(
    pyramid: &Pyramid,
    level: u8,
    north: Option<&TileRow>,
    row: &TileRow,
    south: Option<&TileRow>,
    columns: &std::ops::Range<u32>,
) -> Vec<Vec<Fill>> {
    // A leaf settles every spacing up to its size; above, only the size itself is new.
    let from = if level == pyramid.levels { 1 } else { pyramid.tile };
    let north = north.filter(|north| north.y.checked_add(1) == Some(row.y));
    let south = south.filter(|south| row.y.checked_add(1) == Some(south.y));
    let rows = [north, Some(row), south];
    row.slots
        .par_iter()
        .map(|(x, slot)| {
            if !columns.contains(x) || !matches!(slot, Slot::TileWork(_)) {
                return Vec::new();
            }
            let around = rows.map(|row| {
                [x.checked_sub(1), Some(*x), x.checked_add(1)].map(|x| row?.slot(x?).map(Slot::lattice))
            });
            Neighbourhood(around).fills(from, pyramid.tile)
        })
        .collect()
}
