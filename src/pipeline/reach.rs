//! What a window of leaf tiles can work on, level by level.
//!
//! A window is a rectangle of leaf tiles; the samples around it are there to be looked at. A tile above is *assembled* where
//! all children that the lattice has are finished, and *finished* where its eight neighbours are assembled too, since its fills look
//! at them. What is left over at the sides of the window is the seam, for a merge to work on: at most a few tiles deep at each level.

use std::ops::Range;

use super::pyramid::Pyramid;
use crate::rect::Rect;

/// The rectangles of a window, by level.
#[derive(Clone, Debug)]
pub struct Reach {
    lattice: Vec<Rect>,
    assembled: Vec<Rect>,
    finished: Vec<Rect>,
}

impl Reach {
    /// The reach of a window of leaf tiles.
    pub fn new(pyramid: &Pyramid, window: &Rect) -> Self {
        let lattice: Vec<Rect> = (0..=pyramid.levels).map(|level| pyramid.tiles(level)).collect();
        let (mut assembled, mut finished) = (vec![window.clone()], vec![window.clone()]);
        for level in (0..pyramid.levels).map(usize::from).rev() {
            let (below, here) = (&lattice[level + 1], &lattice[level]);
            let children = &finished[finished.len() - 1];
            let whole = Rect {
                columns: parents(&children.columns, below.columns.end),
                rows: parents(&children.rows, below.rows.end),
            };
            finished.push(Rect {
                columns: inner(&whole.columns, here.columns.end),
                rows: inner(&whole.rows, here.rows.end),
            });
            assembled.push(whole);
        }
        assembled.reverse();
        finished.reverse();
        Self { lattice, assembled, finished }
    }

    /// Tiles of a level that can be put together from their children.
    pub fn assembled(&self, level: u8) -> &Rect {
        &self.assembled[usize::from(level)]
    }

    /// Tiles of a level that can be finished.
    pub fn finished(&self, level: u8) -> &Rect {
        &self.finished[usize::from(level)]
    }

    /// True if a tile next to this one exists in the lattice, but cannot be finished here: it will look at this one.
    pub fn is_at_seam(&self, level: u8, x: u32, y: u32) -> bool {
        let (lattice, finished) = (&self.lattice[usize::from(level)], self.finished(level));
        let around = |v: u32, end: u32| v.saturating_sub(1)..(v + 2).min(end);
        around(y, lattice.rows.end).any(|y| around(x, lattice.columns.end).any(|x| !finished.contains(x, y)))
    }
}

/// Along one axis: the tiles whose children, of which the lattice has `lattice`, are all in `children`.
fn parents(children: &Range<u32>, lattice: u32) -> Range<u32> {
    let end = if children.end == lattice { children.end.div_ceil(2) } else { children.end / 2 };
    some(children.start.div_ceil(2)..end, children)
}

/// Along one axis: the tiles whose neighbours, as far as the lattice has them, are all in `tiles`.
fn inner(tiles: &Range<u32>, lattice: u32) -> Range<u32> {
    let start = tiles.start + u32::from(tiles.start > 0);
    some(start..tiles.end.saturating_sub(u32::from(tiles.end < lattice)), tiles)
}

/// The range, or 0..0 if it or what it was made from is empty.
fn some(range: Range<u32>, from: &Range<u32>) -> Range<u32> {
    if range.is_empty() || from.is_empty() { 0..0 } else { range }
}
