//! The imagery layer: a quadtree of texel tiles over the root square of the heights, independent of
//! theirs.
//!
//! The texel grid of level `l` has `tile * 2^l` texels along the root square, which runs from
//! lattice sample (0, 0) to sample (S, S), `S = T * 2^L`. Texel (i, j) is the square from
//! `i S / (tile 2^l)` to `(i + 1) S / (tile 2^l)`, so its centre is at lattice column
//! `(i + 0.5) S / (tile 2^l)`. A tile is stored with a gutter of [`GUTTER`] texels of its
//! neighbours on every side, so that two tiles, filtered bilinearly each by itself, agree at their
//! border. A tile exists if one of its texels (the gutter not counted) is not wholly transparent;
//! it has children where some picture is finer than its level.
//!
//! Each picture has a level of its own, the one whose texels are nearest to its pixels in size. At
//! that level, and at finer levels where a finer picture lets it show through, it is resampled
//! once; above, texels are means of 2 x 2 finer ones. All filters work in linear light and ignore
//! transparent texels: `light`, `resample`, `half`, `composite`. `sweep` makes the tiles, `fill`
//! gives transparent texels a colour; `memory` computes how much memory all of it takes.

mod composite;
mod fill;
mod ground;
mod half;
mod light;
mod memory;
mod place;
mod resample;
mod square;
mod sweep;

pub use self::ground::Ground;
pub use self::memory::memory;
use self::place::Placed;
use self::sweep::Sweep;
use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::progress::Progress;
use crate::source::picture::{Picture, PictureNote};
use crate::texel::{Colour, Texels};
use crate::tile::TileId;

/// Texels of its neighbours that a stored tile repeats on every side: two, so that its side stays a
/// multiple of four.
pub const GUTTER: usize = 2;

/// The texel grid over the lattice of the heights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TexelGrid {
    /// Texels along the side of a tile, the gutter not counted: a multiple of 4 in 64..=4096.
    pub tile: u32,
    /// Intervals of the lattice along the root square, `T * 2^L`.
    pub intervals: u64,
    /// Columns and rows of samples of the lattice: tiles wholly outside them are not made.
    pub samples: (u32, u32),
}

/// The receiver of the finished tiles of an imagery layer, which come from several threads in any
/// order.
pub trait TileSink: Sync {
    /// Takes a finished tile: `children` has bit `q` set if child `q` exists; `texels.side` is the
    /// side of the tile plus two gutters.
    fn tile(&self, id: TileId, children: u8, texels: Texels) -> Result<()>;
}

/// The rule for the level of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Resolution {
    /// The level whose texels are nearest to its pixels in size, as a ratio.
    #[default]
    Closest,
    /// The coarsest level whose texels are not larger than its pixels.
    Finer,
    /// The finest level whose texels are not smaller than its pixels.
    Coarser,
}

/// A picture in the layer.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedPicture {
    /// Its name and properties.
    pub note: PictureNote,
    /// The finest level that it is resampled to.
    pub level: u8,
    /// How many of its pixels a texel of that level spans, along columns and along rows.
    pub pixels_per_texel: (f64, f64),
    /// The part of its area over the lattice, 0 to 1.
    pub inside: f64,
}

/// The result of [`build`].
#[derive(Clone, Debug, PartialEq)]
pub struct PyramidReport {
    /// The colour type of all tiles.
    pub kind: Colour,
    /// Number of tiles of each level, from the root.
    pub tiles: Vec<u64>,
    /// Mean opacity of the tiles without children, 0 to 1.
    pub opaque: f64,
    /// The pictures, in their order.
    pub pictures: Vec<PlacedPicture>,
}

/// The places of pictures, without reading them. Pictures that [`build`] would refuse at once are
/// refused here.
pub fn place(
    pictures: &[Box<dyn Picture>],
    geo: &Geo,
    grid: &TexelGrid,
    resolution: Resolution,
) -> Result<Vec<PlacedPicture>> {
    Ok(placed(pictures, geo, grid, resolution)?.iter().map(Placed::describe).collect())
}

fn placed<'a>(
    pictures: &'a [Box<dyn Picture>],
    geo: &Geo,
    grid: &TexelGrid,
    resolution: Resolution,
) -> Result<Vec<Placed<'a>>> {
    if !(64..=4096).contains(&grid.tile) || !grid.tile.is_multiple_of(4) {
        return Err(Error::usage(format!(
            "an imagery tile of {} texels: it takes a multiple of 4 from 64 to 4096",
            grid.tile
        )));
    }
    pictures.iter().map(|picture| Placed::new(&**picture, geo, grid, resolution)).collect()
}

/// Makes the tiles of pictures, of which the last lies on top, over a lattice with georeference
/// `geo`.
///
/// Runs on the current thread pool. The tiles do not depend on the number of threads, only their
/// order does. Fails with [`Error::Interrupted`] if `progress` cancels, and if no picture has a
/// texel to show.
pub fn build(
    pictures: &[Box<dyn Picture>],
    geo: &Geo,
    grid: &TexelGrid,
    resolution: Resolution,
    sink: &dyn TileSink,
    progress: &dyn Progress,
) -> Result<PyramidReport> {
    let placed = placed(pictures, geo, grid, resolution)?;
    let is_rgb = pictures.iter().any(|picture| picture.info().kind == Colour::Rgb);
    let kind = if is_rgb { Colour::Rgb } else { Colour::Grey };
    let counts = Sweep { placed: &placed, kind, tile: grid.tile as usize, sink, progress }.run()?;
    if counts.leaf_texels == 0 {
        return Err(Error::usage(
            "the imagery is wholly transparent over the heights: there is nothing to store",
        ));
    }
    Ok(PyramidReport {
        kind,
        tiles: counts.tiles,
        opaque: counts.leaf_alpha as f64 / (255.0 * counts.leaf_texels as f64),
        pictures: placed.iter().map(Placed::describe).collect(),
    })
}
