//! Which tiles to draw.

use std::sync::Arc;

use super::neighbours::Side;
use super::pattern::EdgeRule;
use super::tile::{Node, TileTable};
use super::view::{Frame, View};
use crate::tile::TileId;

/// What selection may know: rows of the index, and tables of the tiles that are loaded.
pub trait Tiles {
    /// The row of a tile; `None` if it does not exist, or is not known (the index page is not loaded). Rows of the children of a
    /// loaded tile are known.
    fn node(&self, id: TileId) -> Option<Node>;
    /// The table of a tile that can be drawn now.
    fn table(&self, id: TileId) -> Option<Arc<TileTable>>;
}

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Pixels by which what is drawn may be off.
    pub tolerance: f64,
    /// How steps of shared edges are chosen.
    pub rule: EdgeRule,
    /// Levels by which drawn tiles that share an edge may differ: 1 with [`EdgeRule::Shared`], up to p with [`EdgeRule::Paper`].
    pub imbalance: u8,
    /// Tiles that may be drawn; refinement ends there, the largest projected errors first.
    pub max_tiles: usize,
}

/// A tile that is not loaded and would be drawn if it were.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// Which.
    pub id: TileId,
    /// Projected error of its parent in pixels: what is seen of its being missing.
    pub priority: f64,
}

/// A tile to draw.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// Which.
    pub id: TileId,
    /// Exponent of its lattice: its samples are `2^exponent` samples of the raster apart.
    pub exponent: u8,
    /// North, east, south, west.
    pub sides: [Side; 4],
    /// Its errors.
    pub table: Arc<TileTable>,
}

/// What to draw.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// Tiles, coarse ones first, row by row: a cut of the quadtree, without the tiles that are not in the picture.
    pub tiles: Vec<Chosen>,
    /// Patches along the side of a tile, `m`.
    pub patches: u32,
    /// `p`: step exponents of a tile are `exponent..=exponent + p`.
    pub patch_log2: u8,
    /// Bound on the rounds of [`super::levels`].
    pub rounds: u32,
    /// What is missing, the most urgent first.
    pub wanted: Vec<Wanted>,
}

/// Chooses tiles.
pub fn select(_tiles: &impl Tiles, _frame: &Frame, _view: &View, _options: &Options) -> Selection {
    Selection::default()
}
