//! [`TileRow`]: the tiles of one row of a level, and which of them others look at.

use rayon::prelude::*;

use super::buffers::Buffers;
use super::carry::{Item, encode_each};
use super::child_summary::ChildSummary;
use super::memory;
use super::plan::Plan;
use super::pyramid::Pyramid;
use super::tile_work::TileWork;
use crate::error::Result;
use crate::sample::Lattice;
use crate::tile::TileId;
use crate::tile::fill::{Fill, Neighbourhood};

/// A tile's place in a row.
pub enum Slot<'a> {
    /// A tile to be finished.
    TileWork(Box<TileWork<'a>>),
    /// A tile that is finished, but not its row: what it leaves for its parent, and its samples if
    /// its neighbours look at it.
    Finished(Box<ChildSummary>, Option<Lattice>),
    /// A tile whose row is finished, or one that is finished elsewhere, or lies outside the window:
    /// its neighbours look at it.
    Seen(Lattice),
}

impl Slot<'_> {
    /// True if the tile looks at its neighbours.
    fn looks(&self) -> bool {
        matches!(self, Self::TileWork(work) if work.has_void())
    }

    /// Its samples; `None` if no tile looks at it. [`TileRow::show_to`] comes first.
    fn lattice(&self) -> Option<&Lattice> {
        match self {
            Self::TileWork(work) => {
                debug_assert!(work.lattice().is_some(), "a tile that is looked at has been put together");
                work.lattice()
            }
            Self::Finished(_, lattice) => lattice.as_ref(),
            Self::Seen(lattice) => Some(lattice),
        }
    }
}

/// Tiles of one row of a level.
pub struct TileRow<'a> {
    /// The row.
    pub y: u32,
    /// The tiles that exist, by their column, from west to east.
    pub slots: Vec<(u32, Slot<'a>)>,
}

/// Summaries of a row by column, ascending.
pub type Summaries = Vec<(u32, ChildSummary)>;

/// Columns, ascending, of tiles that look at their neighbours.
pub struct Looking(Vec<u32>);

impl Looking {
    /// True if one of them looks at the tile in column `x` of the same row or one beside it.
    pub fn at(&self, x: u32) -> bool {
        let next = self.0.partition_point(|looking| looking + 1 < x);
        self.0.get(next).is_some_and(|looking| *looking <= x + 1)
    }
}

impl<'a> TileRow<'a> {
    fn slot(&self, x: u32) -> Option<&Slot<'a>> {
        let index = self.slots.binary_search_by_key(&x, |(x, _)| *x).ok()?;
        self.slots.get(index).map(|(_, slot)| slot)
    }

    /// The tiles that look at their neighbours: only those with voids do.
    pub fn looking(&self) -> Looking {
        Looking(self.slots.iter().filter(|(_, slot)| slot.looks()).map(|(x, _)| *x).collect())
    }

    /// Puts the tiles together that others look at.
    pub fn show_to(&mut self, looking: &Looking, plan: &Plan, buffers: &Buffers) {
        self.make(|x| looking.at(x), plan, buffers);
        self.cut_if_smaller(plan, buffers);
    }

    /// Cuts all leaf tiles if they take no more memory so than the band that some are still in.
    pub fn cut_if_smaller(&mut self, plan: &Plan, buffers: &Buffers) {
        let uncut = |(_, slot): &(u32, Slot<'a>)| match slot {
            Slot::TileWork(work) => work.band_bytes(),
            _ => None,
        };
        let (count, band) =
            self.slots.iter().filter_map(uncut).fold((0, 0), |(count, _), bytes| (count + 1, bytes));
        if count * memory::of_lattice(plan) <= band {
            self.make(|_| true, plan, buffers);
        }
    }

    fn make(&mut self, wanted: impl Fn(u32) -> bool + Sync, plan: &Plan, buffers: &Buffers) {
        self.slots.par_iter_mut().filter(|(x, _)| wanted(*x)).for_each(|(_, slot)| {
            if let Slot::TileWork(work) = slot {
                work.make(plan, buffers);
            }
        });
    }

    /// Takes the summaries out of a finished row, which keeps the tiles that others look at.
    pub fn take_summaries(&mut self) -> Summaries {
        let mut summaries = Summaries::new();
        let seen = std::mem::take(&mut self.slots).into_iter().filter_map(|(x, slot)| match slot {
            Slot::Finished(summary, lattice) => {
                summaries.push((x, *summary));
                Some((x, Slot::Seen(lattice?)))
            }
            other => Some((x, other)),
        });
        self.slots = seen.collect();
        summaries
    }

    /// The row without the tiles that no tile of the row to the south looks at.
    pub fn needed_by(mut self, south: &Looking, buffers: &Buffers) -> Self {
        let unseen = |(x, _): &mut (u32, Slot)| !south.at(*x);
        give_back(self.slots.extract_if(.., unseen), buffers);
        self
    }

    /// Hands to `put` what the tiles in some columns carry: their borders if they are finished,
    /// else the summaries of their children.
    pub fn carry_over(
        &self,
        level: u8,
        wanted: impl Fn(u32) -> bool,
        put: &mut dyn FnMut(&[u8]) -> Result<()>,
    ) -> Result<()> {
        let mut items = Vec::new();
        for (x, slot) in self.slots.iter().filter(|(x, _)| wanted(*x)) {
            let id = TileId::new(level, *x, self.y);
            match slot {
                Slot::TileWork(work) => {
                    items.extend(work.quadrants().map(|quadrant| Item::Part(id.child(quadrant), work)));
                }
                Slot::Finished(summary, lattice) => {
                    items.push(Item::Summary(id, summary));
                    items.extend(lattice.as_ref().map(|lattice| Item::Border(id, lattice)));
                }
                Slot::Seen(lattice) => items.push(Item::Border(id, lattice)),
            }
        }
        encode_each(&items, put)
    }
}

/// Gives the memory of tiles back that no tile will look at any more.
pub fn give_back<'a>(slots: impl Iterator<Item = (u32, Slot<'a>)>, buffers: &Buffers) {
    for (_, slot) in slots {
        match slot {
            Slot::TileWork(work) => work.give_back(buffers),
            Slot::Finished(summary, lattice) => {
                summary.into_errors(buffers);
                if let Some(lattice) = lattice {
                    buffers.lattices.give(lattice.n, lattice);
                }
            }
            Slot::Seen(lattice) => buffers.lattices.give(lattice.n, lattice),
        }
    }
}

/// Fills of the tiles of a row that lie in `columns`; no fills for the others.
pub fn fills(
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
            if !columns.contains(x) || !slot.looks() {
                return Vec::new();
            }
            let around = rows
                .map(|row| [x.checked_sub(1), Some(*x), x.checked_add(1)].map(|x| row?.slot(x?)?.lattice()));
            Neighbourhood(around).fills(from, pyramid.tile)
        })
        .collect()
}
