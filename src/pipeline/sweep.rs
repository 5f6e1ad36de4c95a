//! The sweep: rows of tiles go through every level from north to south.
//!
//! A row is worked on when the row below it is known, since fills look at all eight neighbours. At each level a window of
//! three rows is kept, and one row of quarters that waits for its partner. Tiles at the seams of the sweep's window, which it cannot
//! finish, are left in the seam file; what other builds have left is put in its place as its row comes by. A row holds the tiles that
//! there are and nothing for the others: work and memory follow the tiles, however large the raster is.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::buffers::Buffers;
use super::plan::Plan;
use super::pyramid::Pyramid;
use super::quarter::Quarter;
use super::reach::Reach;
use super::seam::{Item, SeamFile, Seams, encode_each};
use super::tally::Tally;
use super::work::{Finished, Work};
use crate::error::Result;
use crate::sample::{Lattice, VOID};
use crate::tile::TileId;
use crate::tile::fill::{self, Fill, Neighbourhood};
use crate::writer::ContainerWriter;

/// A tile's place in a row.
pub enum Slot {
    /// To be finished; afterwards its lattice is still looked at.
    Work(Box<Work>),
    /// Finished elsewhere, or outside the window: only looked at.
    Seen(Lattice),
}

impl Slot {
    fn lattice(&self) -> &Lattice {
        match self {
            Self::Work(work) => &work.lattice,
            Self::Seen(lattice) => lattice,
        }
    }

    fn into_lattice(self) -> Lattice {
        match self {
            Self::Work(work) => work.lattice,
            Self::Seen(lattice) => lattice,
        }
    }
}

/// Tiles of one row of a level.
pub struct TileRow {
    /// The row.
    pub y: u32,
    /// The tiles that there are by their column, from west to east.
    pub slots: Vec<(u32, Slot)>,
}

impl TileRow {
    fn slot(&self, x: u32) -> Option<&Slot> {
        let index = self.slots.binary_search_by_key(&x, |(x, _)| *x).ok()?;
        self.slots.get(index).map(|(_, slot)| slot)
    }

    /// The row without the tiles that nobody in the row to the south will look at: only fills look, and only voids are filled.
    fn needed_by(mut self, south: &Self, buffers: &Buffers) -> Self {
        let has_void = |slot: &Slot| matches!(slot, Slot::Work(work) if work.lattice.state.contains(&VOID));
        let looking: Vec<u32> =
            south.slots.iter().filter(|(_, slot)| has_void(slot)).map(|(x, _)| *x).collect();
        let unseen = |(x, _): &mut (u32, Slot)| {
            let next = looking.partition_point(|looking| looking + 1 < *x);
            looking.get(next).is_none_or(|looking| *looking > *x + 1)
        };
        give_back(self.slots.extract_if(.., unseen), buffers);
        self
    }

    /// What the tiles in some columns leave: their rims if they are finished, else their quarters.
    fn leave(
        &self,
        level: u8,
        wanted: impl Fn(u32) -> bool,
        put: &mut dyn FnMut(&[u8]) -> Result<()>,
    ) -> Result<()> {
        let mut items = Vec::new();
        for (x, slot) in self.slots.iter().filter(|(x, _)| wanted(*x)) {
            let (id, before) = (TileId::new(level, *x, self.y), items.len());
            if let Slot::Work(work) = slot {
                items.extend(work.quadrants().map(|quadrant| Item::Part(id.child(quadrant), work)));
            }
            if items.len() == before {
                items.push(Item::Rim(id, slot.lattice()));
            }
        }
        encode_each(&items, put)
    }
}

/// Lets go of tiles that nobody will look at any more.
fn give_back(slots: impl Iterator<Item = (u32, Slot)>, buffers: &Buffers) {
    slots.map(|(_, slot)| slot.into_lattice()).for_each(|lattice| buffers.lattices.give(lattice.n, lattice));
}

/// Quarters of a row by column, ascending.
type Quarters = Vec<(u32, Quarter)>;

/// All levels of a build in progress.
pub struct Sweep<'a> {
    plan: &'a Plan,
    reach: Reach,
    levels: Vec<Level>,
    output: Output,
    /// Memory that nobody is using.
    buffers: &'a Buffers,
    /// Finished tiles that are written and counted while the next row is worked on.
    unwritten: Vec<Finished>,
    /// What others left for this sweep.
    earlier: Seams,
    /// Rows of leaf tiles before this one have been passed: if they come, they are only to be looked at.
    passed: u32,
}

/// Where a sweep puts what it makes.
pub struct Output {
    /// Gets the finished tiles.
    pub writer: ContainerWriter,
    /// Counts them.
    pub tally: Tally,
    /// Gets what this sweep leaves for others.
    pub seam: SeamFile,
}

#[derive(Default)]
struct Level {
    /// Finished: only its lattices are of use.
    north: Option<TileRow>,
    /// Next to be worked on.
    current: Option<TileRow>,
    /// Quarters of the last finished row, if its partner is still to come.
    waiting: Option<(u32, Quarters)>,
}

impl<'a> Sweep<'a> {
    /// A sweep over the tiles of a window. `earlier` is what other builds have left for it.
    pub fn new(plan: &'a Plan, buffers: &'a Buffers, reach: Reach, output: Output, earlier: Seams) -> Self {
        let levels = (0..=plan.pyramid.levels).map(|_| Level::default()).collect();
        Self { plan, reach, levels, output, buffers, unwritten: Vec::new(), earlier, passed: 0 }
    }

    /// The next row of leaf tiles.
    pub fn push(&mut self, row: TileRow) -> Result<()> {
        self.push_at(self.plan.pyramid.levels, row)
    }

    /// A row of leaf tiles that others have finished: what they left of it goes on from here.
    pub fn pass(&mut self, y: u32) -> Result<()> {
        self.passed = y + 1;
        self.stack(self.plan.pyramid.levels, y, Vec::new())
    }

    /// Works off what is left.
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

    /// Writes and counts what has been finished.
    pub fn settle(&mut self) -> Result<()> {
        let tiles = std::mem::take(&mut self.unwritten);
        self.output.write(tiles, self.plan)
    }

    /// What stands in the levels now, as items: with the seam file and what is settled, all that a sweep needs to go on from here.
    pub fn standing(&self, put: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
        for (level, state) in (0..).zip(&self.levels) {
            if let Some((y, waiting)) = &state.waiting {
                let items = waiting.iter().map(|(x, q)| Item::Quarter(TileId::new(level, *x, *y), q));
                encode_each(&items.collect::<Vec<_>>(), put)?;
            }
            if level == self.plan.pyramid.levels {
                // Leaves come from the source again.
                continue;
            }
            for row in [&state.north, &state.current].into_iter().flatten() {
                row.leave(level, |_| true, put)?;
            }
        }
        Ok(())
    }

    /// The writer, to mark how far it is.
    pub fn writer(&mut self) -> &mut ContainerWriter {
        &mut self.output.writer
    }

    /// The seam file, likewise.
    pub fn seam(&mut self) -> &mut SeamFile {
        &mut self.output.seam
    }

    /// What has been counted.
    pub fn tally(&self) -> &Tally {
        &self.output.tally
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

    /// Works on the current row of a level, of which the row to the south is known now.
    fn work(&mut self, level: u8, south: Option<&TileRow>) -> Result<()> {
        let Some(mut row) = self.levels[usize::from(level)].current.take() else { return Ok(()) };
        let passed = level == self.plan.pyramid.levels && row.y < self.passed;
        let quarters = if self.reach.finished(level).rows.contains(&row.y) && !passed {
            Some(self.finish_row(level, &mut row, south)?)
        } else {
            None
        };
        self.leave(level, &row)?;
        let y = row.y;
        let row = match south {
            Some(south) => Some(row.needed_by(south, self.buffers)),
            None => None,
        };
        let north = std::mem::replace(&mut self.levels[usize::from(level)].north, row);
        give_back(north.into_iter().flat_map(|row| row.slots), self.buffers);
        quarters.map_or(Ok(()), |quarters| self.stack(level, y, quarters))
    }

    /// Finishes the tiles of a row that can be.
    fn finish_row(&mut self, level: u8, row: &mut TileRow, south: Option<&TileRow>) -> Result<Quarters> {
        let (plan, y) = (self.plan, row.y);
        let columns = self.reach.finished(level).columns.clone();
        let north = self.levels[usize::from(level)].north.as_ref();
        let fills = fills(&plan.pyramid, level, north, row, south, &columns);
        let buffers = self.buffers;
        let work = || -> Vec<Option<Result<(Finished, Quarter)>>> {
            row.slots
                .par_iter_mut()
                .zip(fills)
                .map_init(
                    || buffers.lend(),
                    |lent, ((x, slot), fills)| match slot {
                        Slot::Work(work) if columns.contains(x) => {
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
        let mut quarters = Vec::with_capacity(finished.len());
        for tile in finished.into_iter().flatten() {
            let (tile, quarter) = tile?;
            quarters.push((tile.record.id.x, quarter));
            self.unwritten.push(tile);
        }
        Ok(quarters)
    }

    /// Leaves for others what they will need of a row that has been worked on.
    fn leave(&mut self, level: u8, row: &TileRow) -> Result<()> {
        if level == self.plan.pyramid.levels {
            return Ok(());
        }
        let (seam, reach) = (&mut self.output.seam, &self.reach);
        row.leave(level, |x| reach.is_at_seam(level, x, row.y), &mut |bytes| seam.put(bytes))
    }

    /// Pairs a finished row with the one it waits for.
    fn stack(&mut self, level: u8, y: u32, mut quarters: Quarters) -> Result<()> {
        if level == 0 {
            return Ok(());
        }
        let earlier = self.earlier.take_quarters(level, y, self.plan)?;
        if !earlier.is_empty() {
            quarters.extend(earlier);
            quarters.sort_unstable_by_key(|(x, _)| *x);
        }
        let waiting = &mut self.levels[usize::from(level)].waiting;
        if y.is_multiple_of(2) {
            *waiting = Some((y, quarters));
            return Ok(());
        }
        let north = waiting.take().map_or_else(Vec::new, |(_, north)| north);
        self.lift(level, y, north, quarters)
    }

    /// Makes the parents of two rows, and pushes them a level up; those of tiles that are not all here go to the seam.
    fn lift(&mut self, level: u8, y: u32, north: Quarters, south: Quarters) -> Result<()> {
        if level == 0 {
            return Ok(());
        }
        let (plan, above, y) = (self.plan, level - 1, y / 2);
        let assembled = self.reach.assembled(above).clone();
        let mut quads: BTreeMap<u32, [Option<Quarter>; 4]> = BTreeMap::new();
        let mut left = Vec::new();
        for (half, row) in [north, south].into_iter().enumerate() {
            for (x, quarter) in row {
                if assembled.contains(x / 2, y) {
                    quads.entry(x / 2).or_default()[2 * half + x as usize % 2] = Some(quarter);
                } else {
                    left.push((TileId::new(level, x, 2 * y + half as u32), quarter));
                }
            }
        }
        let items: Vec<_> = left.iter().map(|(id, quarter)| Item::Quarter(*id, quarter)).collect();
        self.output.seam.append(&items)?;
        if !assembled.rows.contains(&y) {
            return Ok(());
        }
        let buffers = self.buffers;
        for (_, quarter) in left {
            quarter.into_errors(buffers);
        }
        let parent = |(x, quad)| Some((x, Slot::Work(Box::new(Work::parent(quad, plan, buffers)?))));
        let quads: Vec<_> = quads.into_iter().collect();
        let mut slots: Vec<(u32, Slot)> = quads.into_par_iter().filter_map(parent).collect();
        let made = slots.len();
        for (x, rim) in self.earlier.take_rims(above, y, plan)? {
            let is_made = slots[..made].binary_search_by_key(&x, |(x, _)| *x).is_ok();
            if assembled.columns.contains(&x) && !is_made {
                slots.push((x, Slot::Seen(rim)));
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
            self.tally.add(&tile, &plan.geometry(tile.record.id));
        }
        Ok(())
    }
}

/// Fills of the tiles of a row in `columns`; none for the others.
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
            if !columns.contains(x) || !matches!(slot, Slot::Work(_)) {
                return Vec::new();
            }
            let around = rows.map(|row| {
                [x.checked_sub(1), Some(*x), x.checked_add(1)].map(|x| row?.slot(x?).map(Slot::lattice))
            });
            Neighbourhood(around).fills(from, pyramid.tile)
        })
        .collect()
}
