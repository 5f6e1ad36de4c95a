//! [`WindowLevels`]: which tiles of each level can be made from a window of leaf tiles alone.
//!
//! A window is a rectangle of leaf tiles. The samples around it may be looked at. Above the leaves,
//! a tile is *assembled* if all its children are finished, and *finished* if its eight neighbours
//! are assembled too, since its fills look at them. (Only children and neighbours that the pyramid
//! has count.) Along one axis, where the window does not begin or end with the pyramid:
//!
//! ```text
//!              window: leaf tiles 3 to 13
//! level L    . . . F F F F F F F F F F F . .       F  finished
//!            \_/ \_/ \_/ \_/ \_/ \_/ \_/ \_/       A  assembled, but a neighbour is missing
//! level L-1   .   .   A   F   F   F   A   .        .  neither
//!             \___/   \___/   \___/   \___/
//! level L-2     .       .       A       .          assembled: both its children are F
//!               \_______/       \_______/
//! level L-3         .               .
//! ```
//!
//! What this window cannot use is carried to the merge ([`super::carry`]):
//! - summaries of F tiles whose parent is not assembled here;
//! - summaries of the children of A tiles;
//! - borders of F tiles next to a tile that is not F.
//!
//! So each level carries at most a few tiles along each side of the window. If the window is the
//! whole level, every tile of every level is F.

use std::ops::Range;

use super::pyramid::Pyramid;
use crate::rect::Rect;

/// The tiles that can be made from a window of leaf tiles, level by level.
#[derive(Clone, Debug)]
pub struct WindowLevels {
    all: Vec<Rect>,
    assembled: Vec<Rect>,
    finished: Vec<Rect>,
}

impl WindowLevels {
    /// The levels over a window of leaf tiles.
    pub fn new(pyramid: &Pyramid, window: &Rect) -> Self {
        let all: Vec<Rect> = (0..=pyramid.levels).map(|level| pyramid.tiles(level)).collect();
        let (mut assembled, mut finished) = (vec![window.clone()], vec![window.clone()]);
        for level in (0..pyramid.levels).map(usize::from).rev() {
            let (below, here) = (&all[level + 1], &all[level]);
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
        Self { all, assembled, finished }
    }

    /// Tiles of a level that can be assembled.
    pub fn assembled(&self, level: u8) -> &Rect {
        &self.assembled[usize::from(level)]
    }

    /// Tiles of a level that can be finished.
    pub fn finished(&self, level: u8) -> &Rect {
        &self.finished[usize::from(level)]
    }

    /// True if the pyramid has a tile next to this one that cannot be finished here. That one will
    /// look at this one.
    pub fn is_at_side(&self, level: u8, x: u32, y: u32) -> bool {
        let (all, finished) = (&self.all[usize::from(level)], self.finished(level));
        let around = |v: u32, end: u32| v.saturating_sub(1)..(v + 2).min(end);
        around(y, all.rows.end).any(|y| around(x, all.columns.end).any(|x| !finished.contains(x, y)))
    }
}

/// Along one axis: the tiles whose children are all in `children`. The pyramid has `most` children.
fn parents(children: &Range<u32>, most: u32) -> Range<u32> {
    let end = if children.end == most { children.end.div_ceil(2) } else { children.end / 2 };
    some(children.start.div_ceil(2)..end, children)
}

/// Along one axis: the tiles whose neighbours are all in `tiles`. The pyramid has `most` tiles.
fn inner(tiles: &Range<u32>, most: u32) -> Range<u32> {
    let start = tiles.start + u32::from(tiles.start > 0);
    some(start..tiles.end.saturating_sub(u32::from(tiles.end < most)), tiles)
}

/// The range, or 0..0 if it or what it was made from is empty.
fn some(range: Range<u32>, from: &Range<u32>) -> Range<u32> {
    if range.is_empty() || from.is_empty() { 0..0 } else { range }
}
