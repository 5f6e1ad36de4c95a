//! The sweep: rows of tiles go through every level from north to south.
//!
//! A row is worked on when the row below it is known, since fills look at all eight neighbours. At each level a window of
//! three rows is kept, and one row of quarters that waits for its partner.

use rayon::prelude::*;

use crate::codec::Scratch;
use crate::container::writer::ContainerWriter;
use crate::error::Result;
use crate::pipeline::plan::Plan;
use crate::pipeline::quarter::Quarter;
use crate::pipeline::tally::Tally;
use crate::pipeline::work::{Finished, Work};
use crate::sample::Lattice;
use crate::tile::TileId;
use crate::tile::fill::{self, Fill, Neighbourhood};

/// Tiles of one row of a level; `None` where there is no tile.
pub struct TileRow {
    /// The row.
    pub y: u32,
    /// Its tiles from west to east.
    pub tiles: Vec<Option<Work>>,
}

/// All levels of a build in progress.
pub struct Sweep<'a> {
    plan: &'a Plan,
    levels: Vec<Level>,
    writer: ContainerWriter,
    tally: Tally,
}

#[derive(Default)]
struct Level {
    /// Finished: only its lattices are of use.
    north: Option<TileRow>,
    /// Next to be worked on.
    current: Option<TileRow>,
    /// Quarters of the last finished row, if it is an even one.
    waiting: Option<(u32, Vec<Option<Quarter>>)>,
}

impl<'a> Sweep<'a> {
    /// A sweep that appends what it finishes to `writer`.
    pub fn new(plan: &'a Plan, writer: ContainerWriter) -> Self {
        let levels = (0..=plan.levels).map(|_| Level::default()).collect();
        Self { plan, levels, writer, tally: Tally::new(plan) }
    }

    /// The next row of leaf tiles.
    pub fn push(&mut self, row: TileRow) -> Result<()> {
        self.push_at(self.plan.levels, row)
    }

    /// Works off what is left, and hands back the writer.
    pub fn finish(mut self) -> Result<(ContainerWriter, Tally)> {
        for level in (0..=self.plan.levels).rev() {
            if self.levels[usize::from(level)].current.is_some() {
                self.work(level, None)?;
            }
            if let Some((y, north)) = self.levels[usize::from(level)].waiting.take() {
                self.lift(level, y, north, Vec::new())?;
            }
        }
        Ok((self.writer, self.tally))
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
        let state = &mut self.levels[usize::from(level)];
        let Some(mut row) = state.current.take() else { return Ok(()) };
        let fills = self.plan.fills(level, state.north.as_ref(), &row, south);
        let plan = self.plan;
        let y = row.y;
        let finished: Vec<Option<Result<Finished>>> = row
            .tiles
            .par_iter_mut()
            .zip(fills)
            .enumerate()
            .map_init(Scratch::default, |scratch, (x, (work, fills))| {
                let work = work.as_mut()?;
                fill::apply(&mut work.lattice, &fills);
                Some(work.finish(TileId::new(level, x as u32, y), plan, scratch))
            })
            .collect();
        state.north = Some(row);
        let mut quarters = Vec::with_capacity(finished.len());
        for tile in finished {
            let Some(tile) = tile.transpose()? else {
                quarters.push(None);
                continue;
            };
            self.writer.append(&tile.record, &tile.chunks)?;
            self.tally.add(&tile, &self.plan.geometry(tile.record.id));
            quarters.push(Some(tile.quarter));
        }
        self.stack(level, y, quarters)
    }

    /// Pairs a finished row with the one it waits for.
    fn stack(&mut self, level: u8, y: u32, quarters: Vec<Option<Quarter>>) -> Result<()> {
        if level == 0 {
            return Ok(());
        }
        if y.is_multiple_of(2) {
            self.levels[usize::from(level)].waiting = Some((y, quarters));
            return Ok(());
        }
        match self.levels[usize::from(level)].waiting.take() {
            Some((_, north)) => self.lift(level, y, north, quarters),
            None => self.lift(level, y, Vec::new(), quarters),
        }
    }

    /// Makes the parents of two rows, and pushes them a level up.
    fn lift(
        &mut self,
        level: u8,
        y: u32,
        north: Vec<Option<Quarter>>,
        south: Vec<Option<Quarter>>,
    ) -> Result<()> {
        if level == 0 {
            return Ok(());
        }
        let columns = north.len().max(south.len()).div_ceil(2);
        let mut quads: Vec<[Option<Quarter>; 4]> = Vec::new();
        quads.resize_with(columns, Default::default);
        for (half, row) in [north, south].into_iter().enumerate() {
            for (x, quarter) in row.into_iter().enumerate() {
                quads[x / 2][2 * half + x % 2] = quarter;
            }
        }
        let plan = self.plan;
        let tiles = quads.into_par_iter().map(|quad| Work::parent(quad, plan)).collect();
        self.push_at(level - 1, TileRow { y: y / 2, tiles })
    }
}

impl Plan {
    /// Fills of every tile of a row.
    fn fills(
        &self,
        level: u8,
        north: Option<&TileRow>,
        row: &TileRow,
        south: Option<&TileRow>,
    ) -> Vec<Vec<Fill>> {
        // A leaf settles every spacing up to its size; above, only the size itself is new.
        let from = if level == self.levels { 1 } else { self.tile };
        let rows =
            [tiles_at(north, row.y.checked_sub(1)), Some(&row.tiles), tiles_at(south, row.y.checked_add(1))];
        (0..row.tiles.len())
            .into_par_iter()
            .map(|x| {
                let lattice = |r: usize, x: Option<usize>| -> Option<&Lattice> {
                    rows[r]?.get(x?)?.as_ref().map(|work| &work.lattice)
                };
                let around =
                    [0, 1, 2].map(|r| [x.checked_sub(1), Some(x), x.checked_add(1)].map(|c| lattice(r, c)));
                Neighbourhood(around).fills(from, self.tile)
            })
            .collect()
    }
}

/// Tiles of a neighbouring row, if it is the row `y`.
fn tiles_at(row: Option<&TileRow>, y: Option<u32>) -> Option<&Vec<Option<Work>>> {
    row.filter(|row| Some(row.y) == y).map(|row| &row.tiles)
}
