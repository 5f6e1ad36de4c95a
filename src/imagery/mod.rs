//! The imagery layer: a quadtree of texel tiles over the root square of the heights, independent of theirs.
//!
//! The texel grid of level `l` has `tile * 2^l` texels along the root square, which runs from lattice sample (0, 0) to sample (S, S),
//! `S = T * 2^L`. Texel (i, j) is the square from `i S / (tile 2^l)` to `(i + 1) S / (tile 2^l)`, so its centre stands at lattice column
//! `(i + 0.5) S / (tile 2^l)`. A tile is stored with a gutter of [`GUTTER`] texels of its neighbours on every side, so that two
//! tiles, filtered bilinearly each by itself, are one picture at their border. A tile exists if one of its texels (the gutter not
//! counted) is not wholly transparent; it has children where some picture is finer than its level.

use crate::error::Result;
use crate::texel::Texels;
use crate::tile::TileId;

/// Texels of the neighbours that a stored tile has on every side: two, so that its side stays a multiple of four.
pub const GUTTER: usize = 2;

/// Where texels lie on the lattice of the heights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TexelGrid {
    /// Texels along the side of a tile, the gutter not counted: a multiple of 4 in 64..=4096.
    pub tile: u32,
    /// Intervals of the lattice along the root square, `T * 2^L`.
    pub intervals: u64,
}

/// Takes the tiles of an imagery layer as they are finished, from several threads, in any order.
pub trait TileSink: Sync {
    /// A finished tile: `children` has bit `q` set if child `q` exists; `texels.side` is the tile's side and two gutters.
    fn tile(&self, id: TileId, children: u8, texels: Texels) -> Result<()>;
}
