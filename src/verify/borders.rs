//! Checks samples that neighbouring tiles share, and that tiles exist which a neighbour implies.
//!
//! A tile's border is kept until all its neighbours have been read; in storage order few are kept
//! at a time. A void sample is compared if its own tile shows that it has a fill: one of its eight
//! neighbours is valid.

use std::collections::HashMap;

use super::report::{Check, Place};
use crate::container::layout::Header;
use crate::container::reader::Reader;
use crate::error::Result;
use crate::sample::{FILLED, Lattice, VALID, VOID};
use crate::tile::TileId;

/// Directions of the eight neighbours.
const AROUND: [(i64, i64); 8] = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];

/// Code, low and state of a border sample.
type Sample = (i32, u32, u8);

/// The four sides of a tile; a corner belongs to two of them.
pub(super) struct Border {
    north: Vec<Sample>,
    south: Vec<Sample>,
    west: Vec<Sample>,
    east: Vec<Sample>,
}

impl Border {
    /// The border of a lattice.
    pub fn of(lattice: &Lattice) -> Self {
        let n = lattice.n;
        let side = |place: &dyn Fn(usize) -> (usize, usize)| {
            (0..=n).map(place).map(|(x, y)| sample(lattice, x, y)).collect::<Vec<_>>()
        };
        Self {
            north: side(&|i| (i, 0)),
            south: side(&|i| (i, n)),
            west: side(&|i| (0, i)),
            east: side(&|i| (n, i)),
        }
    }

    /// The samples that a tile shares with its neighbour in a direction.
    fn towards(&self, direction: (i64, i64)) -> &[Sample] {
        let last = self.north.len() - 1;
        match direction {
            (0, -1) => &self.north,
            (0, 1) => &self.south,
            (-1, 0) => &self.west,
            (1, 0) => &self.east,
            (-1, -1) => &self.north[..1],
            (1, -1) => &self.north[last..],
            (-1, 1) => &self.south[..1],
            _ => &self.south[last..],
        }
    }
}

fn sample(lattice: &Lattice, x: usize, y: usize) -> Sample {
    let at = lattice.at(x, y);
    let state = if lattice.state[at] == VALID {
        VALID
    } else {
        let columns = x.saturating_sub(1)..=(x + 1).min(lattice.n);
        let mut rows = y.saturating_sub(1)..=(y + 1).min(lattice.n);
        let near =
            rows.any(|row| columns.clone().any(|column| lattice.state[lattice.at(column, row)] == VALID));
        if near { FILLED } else { VOID }
    };
    (lattice.code[at], lattice.low_at(at), state)
}

/// Borders whose neighbours have not all been read.
pub(super) struct Borders<'a> {
    reader: &'a Reader,
    waiting: HashMap<TileId, Waiting>,
    /// The check of shared samples.
    pub check: Check,
    /// The check of neighbours that must exist.
    pub existence: Check,
}

struct Waiting {
    /// `None` if the tile could not be decoded.
    border: Option<Border>,
    neighbours: usize,
}

impl<'a> Borders<'a> {
    /// No borders yet.
    pub fn new(reader: &'a Reader, keep: usize) -> Self {
        let check = Check::new("borders", "shared samples", keep);
        Self {
            reader,
            waiting: HashMap::new(),
            check,
            existence: Check::new("existence", "neighbours", keep),
        }
    }

    /// Adds the next tile in storage order, with its border if it could be decoded.
    pub fn add(&mut self, id: TileId, border: Option<Border>) -> Result<()> {
        let mut open = 0;
        for direction in AROUND {
            let Some(other) = neighbour(id, direction) else { continue };
            if let Some(waiting) = self.waiting.get_mut(&other) {
                if let (Some(border), Some(theirs)) = (&border, &waiting.border) {
                    compare(id, border, other, theirs, direction, self.reader.header(), &mut self.check);
                }
                waiting.neighbours -= 1;
                if waiting.neighbours == 0 {
                    self.waiting.remove(&other);
                }
            } else if self.reader.entry(other)?.is_some() {
                open += 1;
            } else if let Some(border) = &border {
                self.existence.looked_at += 1;
                let shared = border.towards(direction);
                if shared.iter().any(|sample| sample.2 == VALID) && !self.covered(other)? {
                    let got = format!("no tile, though tile {id} shares a valid sample with it");
                    self.existence.fail(Place::tile(other), "a tile", got);
                }
            }
        }
        if open > 0 {
            self.waiting.insert(id, Waiting { border, neighbours: open });
        }
        Ok(())
    }

    /// True if the tile lies in a leaf of a coarser level.
    fn covered(&self, id: TileId) -> Result<bool> {
        for ancestor in std::iter::successors(id.parent(), |tile| tile.parent()) {
            if let Some(entry) = self.reader.entry(ancestor)? {
                return Ok(entry.is_leaf());
            }
        }
        Ok(false)
    }
}

fn neighbour(id: TileId, (dx, dy): (i64, i64)) -> Option<TileId> {
    let side = 1_i64 << id.level;
    let (x, y) = (i64::from(id.x) + dx, i64::from(id.y) + dy);
    let inside = (0..side).contains(&x) && (0..side).contains(&y);
    inside.then(|| TileId::new(id.level, x as u32, y as u32))
}

fn compare(
    id: TileId,
    border: &Border,
    other: TileId,
    theirs: &Border,
    (dx, dy): (i64, i64),
    header: &Header,
    check: &mut Check,
) {
    let (ours, theirs) = (border.towards((dx, dy)), theirs.towards((-dx, -dy)));
    check.looked_at += ours.len() as u64;
    for (index, (a, b)) in ours.iter().zip(theirs).enumerate() {
        let valid = (a.2 == VALID, b.2 == VALID);
        let place = || place_of(id, other, (dx, dy), index, header);
        if valid.0 != valid.1 {
            let word = |valid| if valid { "valid" } else { "void" };
            check.fail(place(), format!("{}, as in tile {other}", word(valid.1)), word(valid.0));
        } else if (a.0, a.1) != (b.0, b.1) && (a.2 != VOID || b.2 != VOID) {
            let what = if valid.0 { "code" } else { "fill" };
            check.fail(place(), format!("{what} {}, as in tile {other}", b.0), a.0);
        }
    }
}

fn place_of(id: TileId, other: TileId, (dx, dy): (i64, i64), index: usize, header: &Header) -> Place {
    let (left, top) = header.origin(id);
    let far = header.origin(TileId::new(id.level, id.x.max(other.x), id.y.max(other.y)));
    let along = index as u64 * u64::from(header.spacing(id.level));
    let column = if dx == 0 { left + along } else { far.0 };
    let row = if dy == 0 { top + along } else { far.1 };
    Place::tile(id).sample(column, row)
}
