//! Heights and kinds of single samples of a file, for one thread: the last tile is remembered.

use std::sync::Arc;

use super::square::{HAS_VALID, HAS_VOID};
use super::terrain::{Terrain, kind, number};
use super::vertex::Vertex;
use crate::error::Result;
use crate::sample::Lattice;
use crate::tile::TileId;

/// A part of the terrain whose kinds are known.
struct Known {
    corner: (i64, i64),
    side: i64,
    kinds: Kinds,
}

enum Kinds {
    Same(u8),
    Each(Arc<Lattice>),
}

/// Looks up samples.
pub(super) struct Lookup<'a> {
    terrain: &'a Terrain<'a>,
    known: Option<Known>,
    tile: Option<(TileId, Arc<Lattice>)>,
}

impl<'a> Lookup<'a> {
    /// Looks up samples of this terrain.
    pub fn new(terrain: &'a Terrain<'a>) -> Self {
        Self { terrain, known: None, tile: None }
    }

    /// Kind of a sample; outside the window that of the nearest one in it.
    pub fn kind(&mut self, vertex: Vertex) -> Result<u8> {
        if !self.terrain.extent.contains(vertex) {
            return Ok(self.terrain.outside(vertex).1);
        }
        let (x, y) = (i64::from(vertex.x), i64::from(vertex.y));
        loop {
            if let Some(Known { corner: (left, top), side, kinds }) = &self.known
                && (0..=*side).contains(&(x - left))
                && (0..=*side).contains(&(y - top))
            {
                return Ok(match kinds {
                    Kinds::Same(kind) => *kind,
                    Kinds::Each(lattice) => {
                        kind(lattice, lattice.at((x - left) as usize, (y - top) as usize))
                    }
                });
            }
            self.known = Some(self.know(x, y)?);
        }
    }

    /// What is known of the part of the terrain around a sample.
    fn know(&self, x: i64, y: i64) -> Result<Known> {
        let (terrain, reader) = (self.terrain, self.terrain.reader);
        let mut id = TileId::ROOT;
        loop {
            let (corner, side) = terrain.square(id);
            let Some(entry) = reader.entry(id)? else {
                return Ok(Known { corner, side, kinds: Kinds::Same(HAS_VOID) });
            };
            if terrain.between(&entry)?.is_finite() && !entry.has_void {
                return Ok(Known { corner, side, kinds: Kinds::Same(HAS_VALID) });
            }
            if entry.is_leaf() {
                return Ok(Known { corner, side, kinds: Kinds::Each(reader.read_tile(id)?) });
            }
            id = quadrant(id, (x - corner.0, y - corner.1), side);
        }
    }

    /// The number of a sample; outside the window that of the nearest one in it. It is read from a
    /// tile on the side of `toward`, in units of half an interval.
    pub fn number(&mut self, vertex: Vertex, toward: (i64, i64)) -> Result<f64> {
        let header = self.terrain.reader.header();
        if !self.terrain.extent.contains(vertex) {
            return Ok(self.terrain.outside(vertex).0);
        }
        let level = u32::from(header.levels).saturating_sub(vertex.scale().trailing_zeros()) as u8;
        let spacing = i64::from(header.spacing(level));
        let intervals = i64::from(header.tile());
        let tile = |at: u32, toward: i64| {
            let at = i64::from(at) / spacing;
            let is_border = at % intervals == 0 && at > 0;
            let is_before = is_border && (toward < 2 * at * spacing || at / intervals == 1 << level);
            (at / intervals - i64::from(is_before)) as u32
        };
        let id = TileId::new(level, tile(vertex.x, toward.0), tile(vertex.y, toward.1));
        if self.tile.as_ref().is_none_or(|(last, _)| *last != id) {
            self.tile = Some((id, self.terrain.reader.read_tile(id)?));
        }
        let Some((_, lattice)) = &self.tile else { return Ok(0.0) };
        let (left, top) = header.origin(id);
        let at = lattice.at(
            ((i64::from(vertex.x) - left as i64) / spacing) as usize,
            ((i64::from(vertex.y) - top as i64) / spacing) as usize,
        );
        Ok(number(lattice, at, header.coding))
    }
}

/// The child of a tile that has a place, in samples from the tile's corner.
fn quadrant(id: TileId, (x, y): (i64, i64), side: i64) -> TileId {
    id.child(u8::from(2 * x >= side) | u8::from(2 * y >= side) << 1)
}
