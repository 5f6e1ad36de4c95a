//! [`TileWork`]: one tile on its way through a level. It is assembled, filled, measured, encoded
//! and halved.

use std::borrow::Cow;
use std::sync::Arc;

use crate::codec::height::Fills;
use crate::codec::table::ErrorTable;
use crate::codec::{height, mask, table};
use crate::container::layout::Metric;
use crate::error::{Error, Result};
use crate::error_code::code_from_metres;
use crate::patch::blocks::{Blocks, occupied};
use crate::patch::{Errors, TileGeometry, inherit};
use crate::pipeline::bands::Band;
use crate::pipeline::buffers::{Buffers, Lent};
use crate::pipeline::child_summary::ChildSummary;
use crate::pipeline::odd;
use crate::pipeline::plan::Plan;
use crate::pipeline::value_range::ValueRange;
use crate::sample::{Lattice, VALID, VOID};
use crate::sample::{interpolate, state};
use crate::tile::fill::{self, Fill};
use crate::tile::{TileId, downsample};
use crate::writer::{TileChunks, TileRecord};

/// A tile that is not finished.
pub struct TileWork<'a> {
    samples: Samples<'a>,
    /// True if it may have void samples: its fills look at its neighbours.
    has_void: bool,
}

enum Samples<'a> {
    /// Those of a leaf without voids, in the column of a band.
    Uncut(Arc<Band<'a>>, u32),
    /// Those of a parent, as its children left them.
    Apart(Box<[Option<ChildSummary>; 4]>),
    /// The lattice, and what else the children left; `None` for a leaf.
    Whole(Lattice, Option<Box<Below>>),
}

struct Below {
    blocks: Blocks,
    errors: [Option<Errors>; 4],
    range: ValueRange,
    children: u8,
}

/// A finished tile.
pub struct Finished {
    /// Its row of the index.
    pub record: TileRecord,
    /// Its stored bytes.
    pub chunks: TileChunks,
    /// Its error table, for the statistics.
    pub table: ErrorTable,
    /// Patches with a valid sample in or below them.
    pub occupied: Vec<bool>,
    /// Its own samples, for the statistics.
    pub census: Census,
}

/// The valid samples of a tile's own lattice.
pub struct Census {
    /// How many: of the last column and row only where no other tile counts them.
    pub valid: u64,
    /// Lowest and highest in metres.
    pub range_m: Option<(f64, f64)>,
    /// Of a leaf: lowest and highest value, and the same without those that look like void.
    pub values: Option<[ValueRange; 2]>,
}

impl<'a> TileWork<'a> {
    /// A leaf tile.
    pub fn leaf(lattice: Lattice) -> Self {
        let has_void = lattice.state.contains(&VOID);
        Self { samples: Samples::Whole(lattice, None), has_void }
    }

    /// A leaf tile without voids that is still in its band.
    pub fn uncut(band: Arc<Band<'a>>, x: u32) -> Self {
        Self { samples: Samples::Uncut(band, x), has_void: false }
    }

    /// The parent of up to four finished tiles; `None` if there are none.
    pub fn parent(summaries: [Option<ChildSummary>; 4]) -> Option<Self> {
        if summaries.iter().all(Option::is_none) {
            return None;
        }
        let is_valid = |summary: &Option<ChildSummary>| {
            summary.as_ref().is_some_and(|summary| !summary.lattice.state.contains(&VOID))
        };
        let has_void = !summaries.iter().all(is_valid);
        Some(Self { samples: Samples::Apart(Box::new(summaries)), has_void })
    }

    /// True if it may have void samples without a fill.
    pub fn has_void(&self) -> bool {
        self.has_void
    }

    /// Its lattice; `None` before [`TileWork::make`].
    pub fn lattice(&self) -> Option<&Lattice> {
        if let Samples::Whole(lattice, _) = &self.samples { Some(lattice) } else { None }
    }

    /// Bytes of the band that its samples are still in; `None` if they have been cut.
    pub fn band_bytes(&self) -> Option<u64> {
        if let Samples::Uncut(band, _) = &self.samples { Some(band.bytes) } else { None }
    }

    /// Cuts its samples, or puts them together.
    pub fn make(&mut self, plan: &Plan, buffers: &Buffers) {
        let (lattice, below) =
            match std::mem::replace(&mut self.samples, Samples::Whole(Lattice::default(), None)) {
                Samples::Uncut(band, x) => {
                    let mut lattice = buffers.lattices.take(plan.pyramid.tile);
                    band.cut(x, &mut lattice);
                    (lattice, None)
                }
                Samples::Apart(summaries) => {
                    let (lattice, below) = put_together(*summaries, self.has_void, plan, buffers);
                    self.has_void = lattice.state.contains(&VOID);
                    (lattice, Some(Box::new(below)))
                }
                Samples::Whole(lattice, below) => (lattice, below),
            };
        self.samples = Samples::Whole(lattice, below);
    }

    /// Quadrants that [`TileWork::parent`] was given summaries for; none of a leaf.
    pub fn quadrants(&self) -> impl Iterator<Item = u8> {
        let children = match &self.samples {
            Samples::Apart(summaries) => (0..4)
                .filter(|&quadrant| summaries[quadrant].is_some())
                .fold(0, |bits, quadrant| bits | 1 << quadrant),
            Samples::Whole(_, Some(below)) => below.children,
            Samples::Uncut(..) | Samples::Whole(_, None) => 0,
        };
        (0..4).filter(move |quadrant| children >> quadrant & 1 == 1)
    }

    /// The summary that [`TileWork::parent`] was given for a quadrant, for a tile that will be
    /// finished elsewhere.
    pub fn summary(&self, quadrant: u8) -> Option<Cow<'_, ChildSummary>> {
        match &self.samples {
            Samples::Apart(summaries) => summaries[usize::from(quadrant)].as_ref().map(Cow::Borrowed),
            Samples::Whole(lattice, Some(below)) => {
                let errors = below.errors[usize::from(quadrant)].clone()?;
                Some(Cow::Owned(ChildSummary::cut(lattice, &below.blocks, quadrant, errors, below.range)))
            }
            Samples::Uncut(..) | Samples::Whole(_, None) => None,
        }
    }

    /// Gives its memory back.
    pub fn give_back(self, buffers: &Buffers) {
        match self.samples {
            Samples::Uncut(..) => {}
            Samples::Apart(summaries) => summaries.into_iter().flatten().for_each(|summary| {
                summary.into_errors(buffers);
            }),
            Samples::Whole(lattice, below) => {
                buffers.lattices.give(lattice.n, lattice);
                if let Some(below) = below {
                    buffers.blocks.give(below.blocks.n, below.blocks);
                }
            }
        }
    }

    /// Measures, encodes and halves the tile with these fills. Returns the tile, its summary for
    /// the parent, and its samples.
    pub fn finish(
        mut self,
        id: TileId,
        fills: &[Fill],
        plan: &Plan,
        lent: &mut Lent<'_>,
    ) -> Result<(Finished, ChildSummary, Lattice)> {
        self.make(plan, lent.owner);
        let Samples::Whole(mut lattice, below) = self.samples else {
            return Err(Error::internal(format!("tile {id} has no samples")));
        };
        fill::apply(&mut lattice, fills);
        let (finished, summary) = finish(&mut lattice, below.map(|below| *below), id, plan, lent)?;
        Ok((finished, summary, lattice))
    }
}

/// The samples of a parent, and what else its children left.
fn put_together(
    summaries: [Option<ChildSummary>; 4],
    has_void: bool,
    plan: &Plan,
    buffers: &Buffers,
) -> (Lattice, Below) {
    let (tile, coding) = (plan.pyramid.tile, plan.recipe.coding);
    let (mut lattice, mut blocks) = (buffers.lattices.take(tile), buffers.blocks.take(tile));
    // Four children set every block, and without voids every sample.
    if has_void || lattice.n != tile {
        lattice.reset(tile, coding);
    }
    if summaries.iter().any(Option::is_none) || blocks.n != tile {
        blocks.reset(tile);
    }
    let mut range = ValueRange::EMPTY;
    let mut children = 0;
    let mut quadrant = 0;
    let errors = summaries.map(|summary| {
        let place = quadrant;
        quadrant += 1;
        let summary = summary?;
        downsample::place(&summary.lattice, place, &mut lattice);
        blocks.place(&summary.blocks, place);
        range = range.join(summary.range);
        children |= 1 << place;
        Some(summary.into_errors(buffers))
    });
    (lattice, Below { blocks, errors, range, children })
}

/// Measures, encodes and halves a tile whose fills are in place.
fn finish(
    lattice: &mut Lattice,
    below: Option<Below>,
    id: TileId,
    plan: &Plan,
    lent: &mut Lent<'_>,
) -> Result<(Finished, ChildSummary)> {
    let Lent { scratch, chunks, owner: buffers } = lent;
    let coding = plan.recipe.coding;
    let geometry = plan.geometry(id);
    let all_valid = state::all_valid(&lattice.state);
    let [own, valid] = ValueRange::of(lattice, all_valid, coding);
    let fills = if below.is_none() { Fills::Beside } else { Fills::Any };
    if below.is_none() && !all_valid {
        // Samples without a height are never drawn. The bounds of what is drawn are sharper if
        // they do not stick out.
        let Lattice { n, code, state, .. } = lattice;
        interpolate::across_unfilled(code, state, *n + 1);
    }
    let lattice = &*lattice;
    let children = below.as_ref().map_or(0, |b| b.children);
    let range = below.as_ref().map_or(own, |b| own.join(b.range));
    let (occupied, blocks, errors) = measure(lattice, below, plan, &geometry, buffers);
    let table = stored_table(lattice, &errors, &occupied, plan, &geometry);
    for chunk in [&mut chunks.mask, &mut chunks.heights, &mut chunks.errors] {
        chunk.clear();
    }
    let root = id == TileId::ROOT;
    let occupancy = mask::encode(lattice, root, scratch, &mut chunks.mask)?;
    height::encode((lattice, fills), coding, root, scratch, &mut chunks.heights)?;
    table::encode(&table, &mut chunks.errors)?;
    let (min_m, max_m) = range.outward(plan);
    if min_m.is_nan() || max_m.is_nan() {
        let got = format!("samples from {:e} to {:e}", range.low, range.high);
        return Err(Error::format("heights", "numbers of metres", got));
    }
    let patches = table.patches * table.patches;
    let largest = |codes: &[u16]| codes[..patches].iter().copied().max().unwrap_or(0);
    let record = TileRecord {
        id,
        children,
        has_valid: occupancy.has_valid,
        has_void: occupancy.has_void,
        vertical: largest(&table.vertical),
        horizontal: largest(&table.horizontal),
        min_m,
        max_m,
    };
    let mut half = buffers.lattices.take(plan.pyramid.tile / 2);
    downsample::halve(lattice, &mut half);
    let summary = ChildSummary { lattice: half, blocks, errors, range };
    let census = census(lattice, all_valid, valid, id, plan);
    Ok((Finished { record, chunks: chunks.clone(), table, occupied, census }, summary))
}

/// Patches with a valid sample in or below them, blocks for the parent, and errors.
fn measure(
    lattice: &Lattice,
    below: Option<Below>,
    plan: &Plan,
    geometry: &TileGeometry,
    buffers: &Buffers,
) -> (Vec<bool>, Blocks, Errors) {
    let coding = plan.recipe.coding;
    let mut halved = buffers.blocks.take(plan.pyramid.tile / 2);
    match below {
        None => {
            let unit = halved.set_leaf(lattice, coding, geometry);
            let errors = match plan.metric {
                Metric::Bound => inherit::leaf_bound(lattice, &unit, coding, geometry),
                Metric::Paper => inherit::leaf_paper(lattice, coding, geometry),
            };
            (occupied(&unit, plan.pyramid.tile, plan.patch), halved, errors)
        }
        Some(Below { blocks, errors, .. }) => {
            let children = errors.each_ref().map(Option::as_ref);
            let errors = match plan.metric {
                Metric::Bound => inherit::parent_bound(children, lattice, &blocks, coding, geometry),
                Metric::Paper => inherit::parent_paper(children, lattice, coding, geometry),
            };
            let occupied = occupied(&blocks.state, plan.pyramid.tile, plan.patch);
            blocks.halve(&mut halved);
            buffers.blocks.give(blocks.n, blocks);
            (occupied, halved, errors)
        }
    }
}

/// Counts the tile's own samples; `range` is that of the valid ones. A column or row that two tiles
/// share belongs to the tile that starts with it.
fn census(lattice: &Lattice, all_valid: bool, range: ValueRange, id: TileId, plan: &Plan) -> Census {
    let last = (1_u32 << id.level) - 1;
    let (columns, rows) = (lattice.n + usize::from(id.x == last), lattice.n + usize::from(id.y == last));
    let row = |y: usize| &lattice.state[lattice.at(0, y)..lattice.at(0, y) + columns];
    // As many at a time as a byte can count.
    let count = |run: &[u8]| u64::from(run.iter().map(|&state| u8::from(state == VALID)).sum::<u8>());
    let valid = if all_valid {
        columns as u64 * rows as u64
    } else {
        (0..rows).flat_map(|y| row(y).chunks(usize::from(u8::MAX))).map(count).sum()
    };
    let known = range.low <= range.high;
    let values = (known && id.level == plan.pyramid.levels).then(|| [range, odd::rest(lattice, range, plan)]);
    Census { valid, range_m: known.then(|| range.metres(plan)), values }
}

/// The table as stored: rounded up, with the quantisation error on top of every vertical one.
fn stored_table(
    lattice: &Lattice,
    errors: &Errors,
    occupied: &[bool],
    plan: &Plan,
    geometry: &TileGeometry,
) -> ErrorTable {
    let quantisation = if plan.quantised() { plan.quantisation_error_m } else { 0.0 };
    let vertical = errors.vertical.iter().flat_map(|step| {
        step.iter().zip(occupied).map(|(&e, &o)| code_from_metres(if o { e + quantisation } else { e }))
    });
    let horizontal = errors.horizontal.iter().flatten().map(|&e| code_from_metres(e));
    ErrorTable {
        patches: geometry.patches(),
        steps: geometry.steps(),
        drawable: drawable(lattice, plan.patch),
        vertical: vertical.collect(),
        horizontal: horizontal.collect(),
    }
}

/// Patches with a valid sample of the tile's own lattice, borders included.
fn drawable(lattice: &Lattice, patch: usize) -> Vec<bool> {
    let side = lattice.n / patch;
    (0..side * side)
        .map(|i| {
            let (x, y) = (i % side * patch, i / side * patch);
            (y..=y + patch).any(|row| {
                let from = lattice.at(x, row);
                lattice.state[from..=from + patch].contains(&VALID)
            })
        })
        .collect()
}
