//! Makes tiles from pictures, from the finest level to the root, in rows from north to south.
//!
//! Texel (i, j) of a level has the same value in every tile that stores it. Where a tile of the
//! next level exists, it is the mean of four texels of that tile; elsewhere it comes from the
//! pictures of this level or a coarser one, resampled. So gutters agree with the neighbours whether
//! those have children or not. Each tile leaves a [`Half`] for the level above; a tile there is
//! made of the halves of its four children and of the twelve around them, which are known once the
//! row of children south of its own is made. So memory holds four rows of halves of each level, of
//! existing tiles only, and no whole tiles.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

use rayon::prelude::*;

use super::composite::Canvas;
use super::half::Half;
use super::place::Placed;
use super::resample::resample;
use super::square::Square;
use super::{GUTTER, TileSink, fill};
use crate::error::{Error, Result};
use crate::progress::{Progress, Stage};
use crate::texel::{Colour, Texels};
use crate::tile::TileId;

/// About how many tiles of a level are made together: enough for many threads, few enough that
/// their halves take little memory.
pub(super) const BATCH: usize = 96;

/// Counts of the tiles that have been made.
#[derive(Debug, Default)]
pub(super) struct Counts {
    /// Number of tiles of each level.
    pub(super) tiles: Vec<u64>,
    /// Number of texels of leaf tiles; the sum of their alphas follows.
    pub(super) leaf_texels: u64,
    pub(super) leaf_alpha: u64,
}

/// One pass over all levels.
pub(super) struct Sweep<'a> {
    pub(super) placed: &'a [Placed<'a>],
    pub(super) kind: Colour,
    pub(super) tile: usize,
    pub(super) sink: &'a dyn TileSink,
    pub(super) progress: &'a dyn Progress,
}

/// The state of one level.
struct Level {
    /// Rows of tiles that pictures touch.
    rows: Range<u32>,
    /// The first row that is not made yet.
    next: u32,
    /// The halves of its tiles, for their parents.
    halves: HashMap<(u32, u32), Half>,
}

/// A tile that has been made.
struct Made {
    half: Half,
    leaf: bool,
    alpha: u64,
}

/// Tiles done, and most tiles.
struct Counter<'a> {
    done: AtomicU64,
    total: u64,
    stopped: AtomicBool,
    progress: &'a dyn Progress,
}

impl Counter<'_> {
    fn goes_on(&self) -> bool {
        !self.stopped.load(Ordering::Relaxed)
    }

    fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
    }

    /// Counts `tiles` tiles that need no work.
    fn skip(&self, tiles: usize) {
        self.done.fetch_add(tiles as u64, Ordering::Relaxed);
    }

    /// Counts one more tile; returns false if the task is to stop.
    fn step(&self) -> bool {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        self.progress.goes_on(Stage::Imagery, done, self.total)
    }
}

impl Sweep<'_> {
    /// Makes all tiles.
    pub(super) fn run(&self) -> Result<Counts> {
        let finest = self.placed.iter().map(|placed| placed.level).max().unwrap_or(0);
        let mut levels: Vec<Level> = (0..=finest).map(|level| self.level(level)).collect();
        let mut counts = Counts { tiles: vec![0; levels.len()], ..Counts::default() };
        let own = |level: usize| {
            levels[level]
                .rows
                .clone()
                .flat_map(move |row| self.own(level, row))
                .map(|columns| columns.len() as u64)
        };
        let progress = Counter {
            done: AtomicU64::new(0),
            total: (0..levels.len()).flat_map(own).sum(),
            stopped: AtomicBool::new(false),
            progress: self.progress,
        };
        self.climb(&mut levels, usize::from(finest), &progress, &mut counts)?;
        Ok(counts)
    }

    fn level(&self, level: u8) -> Level {
        let finer = self.placed.iter().filter(|placed| placed.level >= level);
        let rows = finer.map(|placed| placed.rows(level)).filter(|rows| !rows.is_empty());
        let rows = rows.reduce(|a, b| a.start.min(b.start)..a.end.max(b.end)).unwrap_or(0..0);
        Level { next: rows.start, rows, halves: HashMap::new() }
    }

    /// Makes all rows of a level whose children are made, some at a time, and each time the rows
    /// above that have become possible.
    fn climb(
        &self,
        levels: &mut [Level],
        level: usize,
        progress: &Counter<'_>,
        counts: &mut Counts,
    ) -> Result<()> {
        loop {
            let ready = match levels.get(level + 1) {
                // The row of children south of those of a row must be made.
                Some(below) if below.next < below.rows.end => below.next.saturating_sub(1) / 2,
                _ => u32::MAX,
            };
            let (start, limit) = (levels[level].next, ready.min(levels[level].rows.end));
            let (mut end, mut found) = (start, 0);
            while end < limit && found < BATCH {
                found += 1 + self.own(level, end).iter().map(Range::len).sum::<usize>();
                end += 1;
            }
            if start >= end {
                return Ok(());
            }
            self.rows(levels, level, start..end, progress, counts)?;
            if level > 0 {
                self.climb(levels, level - 1, progress, counts)?;
            }
        }
    }

    /// Columns of tiles in a row that pictures of this level touch.
    fn own(&self, level: usize, row: u32) -> Vec<Range<u32>> {
        let own = self.placed.iter().filter(|placed| usize::from(placed.level) == level);
        let mut all: Vec<Range<u32>> = own
            .filter(|placed| placed.rows(placed.level).contains(&row))
            .map(|placed| placed.columns(placed.level, row))
            .filter(|columns| !columns.is_empty())
            .collect();
        all.sort_unstable_by_key(|columns| columns.start);
        let mut apart: Vec<Range<u32>> = Vec::new();
        for columns in all {
            match apart.last_mut().filter(|last| last.end >= columns.start) {
                Some(last) => last.end = last.end.max(columns.end),
                None => apart.push(columns),
            }
        }
        apart
    }

    /// Tiles of some rows that may exist; true for those in which a picture of their level may
    /// show.
    fn candidates(
        &self,
        level: usize,
        rows: Range<u32>,
        children: &HashMap<(u32, u32), Half>,
    ) -> Vec<(TileId, bool)> {
        let parents = children.keys().map(|&(x, y)| (y / 2, x / 2)).filter(|(y, _)| rows.contains(y));
        let mut all: Vec<(u32, u32, bool)> = parents.map(|(y, x)| (y, x, false)).collect();
        for y in rows.clone() {
            let mut shown = Vec::new();
            self.own(level, y).into_iter().for_each(|columns| self.shown(level, y, columns, &mut shown));
            all.extend(shown.into_iter().map(|x| (y, x, true)));
        }
        // Of two entries for one tile, that of a picture comes first and stays.
        all.sort_unstable_by_key(|&(y, x, own)| (y, x, !own));
        all.dedup_by_key(|&mut (y, x, _)| (y, x));
        all.into_iter().map(|(y, x, own)| (TileId::new(level as u8, x, y), own)).collect()
    }

    /// Appends to `found` the columns of a row in which a picture of this level may have a texel to
    /// show.
    fn shown(&self, level: usize, row: u32, columns: Range<u32>, found: &mut Vec<u32>) {
        let (left, top) = (self.start(columns.start) as f64, self.start(row) as f64);
        let size = (self.tile * columns.len() + 2 * GUTTER, self.tile + 2 * GUTTER);
        let size = (size.0 as f64, size.1 as f64);
        let shows = |placed: &Placed<'_>| {
            usize::from(placed.level) == level && placed.may_show(placed.level, (left, top), size)
        };
        if !self.placed.iter().any(shows) {
            return;
        }
        if columns.len() == 1 {
            found.push(columns.start);
            return;
        }
        let middle = columns.start + columns.len() as u32 / 2;
        self.shown(level, row, columns.start..middle, found);
        self.shown(level, row, middle..columns.end, found);
    }

    /// Makes rows of one level, whose children are all made.
    fn rows(
        &self,
        levels: &mut [Level],
        level: usize,
        rows: Range<u32>,
        progress: &Counter<'_>,
        counts: &mut Counts,
    ) -> Result<()> {
        let none = HashMap::new();
        let children = levels.get(level + 1).map_or(&none, |below| &below.halves);
        let make = |&(id, own): &(TileId, bool)| {
            let made = if progress.goes_on() { self.make(id, children) } else { Err(Error::Interrupted) };
            if made.is_err() || own && !progress.step() {
                progress.stop();
                return made.and(Err(Error::Interrupted));
            }
            Ok(made?.map(|made| (id, made)))
        };
        let candidates = self.candidates(level, rows.clone(), children);
        let touched: usize =
            rows.clone().flat_map(|row| self.own(level, row)).map(|columns| columns.len()).sum();
        progress.skip(touched - candidates.iter().filter(|(_, own)| *own).count());
        let made: Vec<Result<Option<(TileId, Made)>>> = in_turn(&candidates, make);
        // The error of one tile interrupts the others; report that error, not the interruption.
        let is_cause =
            |made: &Result<_>| made.as_ref().is_err_and(|error| !matches!(error, Error::Interrupted));
        let cause = made.iter().position(is_cause);
        for result in made.into_iter().skip(cause.unwrap_or(0)) {
            let Some((id, made)) = result? else { continue };
            counts.tiles[level] += 1;
            if made.leaf {
                counts.leaf_texels += (self.tile * self.tile) as u64;
                counts.leaf_alpha += made.alpha;
            }
            levels[level].halves.insert((id.x, id.y), made.half);
        }
        if let Some(below) = levels.get_mut(level + 1) {
            below.halves.retain(|&(_, y), _| u64::from(y) + 1 >= 2 * u64::from(rows.end));
        }
        levels[level].next = rows.end;
        Ok(())
    }

    /// Makes a tile and passes it to the sink; `None` if it is wholly transparent.
    fn make(&self, id: TileId, halves: &HashMap<(u32, u32), Half>) -> Result<Option<Made>> {
        let cells = cells(id, halves);
        let quadrants = [(1, 1), (2, 1), (1, 2), (2, 2)];
        let children = (0..4).filter(|&q| cells[quadrants[q].1][quadrants[q].0].is_some());
        let children = children.fold(0, |bits, q| bits | 1 << q);
        let side = self.tile + 2 * GUTTER;
        let square = Square { level: id.level, left: self.start(id.x), top: self.start(id.y), side };
        let missing = cells.iter().flatten().any(Option::is_none);
        let (canvas, own) = if missing { self.paint(square)? } else { (None, false) };
        if children == 0 && !own {
            return Ok(None);
        }
        let mut canvas = canvas.unwrap_or_else(|| Canvas::new(self.kind, side));
        for (y, row) in cells.iter().enumerate() {
            for (x, half) in row.iter().enumerate() {
                if let Some(half) = half {
                    half.paste(&mut canvas, x, y);
                }
            }
        }
        let half = Half::of(&canvas);
        let inner = canvas.alpha.chunks_exact(side).take(side - GUTTER).skip(GUTTER);
        let alpha = inner.flat_map(|row| &row[GUTTER..side - GUTTER]).map(|&alpha| u64::from(alpha)).sum();
        fill::fill(&mut canvas.colour, &canvas.alpha, side, self.kind);
        let opaque = canvas.is_opaque();
        let texels =
            Texels { side, kind: self.kind, colour: canvas.colour, alpha: (!opaque).then_some(canvas.alpha) };
        self.sink.tile(id, children, texels)?;
        Ok(Some(Made { half, leaf: children == 0, alpha }))
    }

    /// First texel of a tile, gutter included.
    fn start(&self, index: u32) -> i64 {
        i64::from(index) * self.tile as i64 - GUTTER as i64
    }

    /// The pictures of this level and of coarser ones, resampled to a square. True if one of this
    /// level is visible inside the gutter.
    fn paint(&self, square: Square) -> Result<(Option<Canvas>, bool)> {
        let (mut canvas, mut own) = (None, false);
        // The last picture lies on top.
        for placed in self.placed.iter().rev().filter(|placed| placed.level <= square.level) {
            let (start, side) = ((square.left as f64, square.top as f64), square.side as f64);
            if !placed.may_show(square.level, start, (side, side)) {
                continue;
            }
            let layer = resample(placed, square).map_err(|error| error.at(placed.name()))?;
            let Some(layer) = layer else { continue };
            let canvas = canvas.get_or_insert_with(|| Canvas::new(self.kind, square.side));
            own |= canvas.below(layer, GUTTER) && placed.level == square.level;
            if canvas.is_opaque() {
                break;
            }
        }
        Ok((canvas, own))
    }
}

/// The results of `make` for all items, in order. Threads take one item after the other, so that
/// they all work near each other and need the same blocks of a picture.
fn in_turn<T: Sync, U: Send>(items: &[T], make: impl Fn(&T) -> U + Sync) -> Vec<U> {
    let next = AtomicUsize::new(0);
    let take = |_| {
        let mut own = Vec::new();
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let Some(item) = items.get(number) else { return own };
            own.push((number, make(item)));
        }
    };
    let mut made: Vec<(usize, U)> =
        (0..rayon::current_num_threads()).into_par_iter().with_max_len(1).flat_map_iter(take).collect();
    made.sort_unstable_by_key(|(number, _)| *number);
    made.into_iter().map(|(_, made)| made).collect()
}

/// The halves of the children of a tile and of those around them, row by row, with its own in the
/// middle.
fn cells(id: TileId, halves: &HashMap<(u32, u32), Half>) -> [[Option<&Half>; 4]; 4] {
    let at = |start: u32, cell: usize| (2 * start + cell as u32).checked_sub(1);
    std::array::from_fn(|y| {
        std::array::from_fn(|x| at(id.x, x).zip(at(id.y, y)).and_then(|key| halves.get(&key)))
    })
}
