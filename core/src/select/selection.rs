//! The result of selection: the tiles to draw and the tiles to load.

use std::sync::Arc;

use super::neighbours::Side;
use super::tile::TileTable;
use crate::tile::TileId;

/// A tile that is to be loaded: it would be drawn if it were.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// The tile.
    pub id: TileId,
    /// Projected error, in pixels, of the ancestor drawn in its place.
    pub priority: f64,
}

/// A tile to draw.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// The tile.
    pub id: TileId,
    /// Exponent of its lattice: neighbours are `2^exponent` samples of the raster apart.
    pub exponent: u8,
    /// Its sides: north, east, south, west.
    pub sides: [Side; 4],
    /// Its error table.
    pub table: Arc<TileTable>,
}

/// The tiles to draw, and those to load.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// The tiles to draw, coarse ones first, row by row: a cut of the quadtree, without the tiles
    /// outside the view.
    pub tiles: Vec<Chosen>,
    /// Patches along a side of a tile, `m`.
    pub patches: u32,
    /// `p`: step exponents of a tile are `exponent..=exponent + p`.
    pub patch_log2: u8,
    /// Bound on the rounds of [`super::levels`].
    pub rounds: u32,
    /// Tiles to load, the most urgent first.
    pub wanted: Vec<Wanted>,
    /// Largest projected error, in pixels, of a drawn tile at its full resolution: above the
    /// tolerance while tiles are wanted.
    pub promised: f64,
}
