//! The imagery layer: a quadtree of texel tiles over the root square of the heights, independent of theirs.
//!
//! The texel grid of level `l` has `tile * 2^l` texels along the root square, which runs from lattice sample (0, 0) to sample (S, S),
//! `S = T * 2^L`. Texel (i, j) is the square from `i S / (tile 2^l)` to `(i + 1) S / (tile 2^l)`, so its centre stands at lattice column
//! `(i + 0.5) S / (tile 2^l)`. A tile is stored with a gutter of [`GUTTER`] texels of its neighbours on every side, so that two
//! tiles, filtered bilinearly each by itself, are one picture at their border. A tile exists if one of its texels (the gutter not
//! counted) is not wholly transparent; it has children where some picture is finer than its level.
//!
//! Each picture has a level of its own, the one whose texels are nearest to its pixels in size. There and at finer levels (where it
//! shows through a finer picture) it is resampled once; above, texels are means of 2 x 2 finer ones. All filters work in linear
//! light and leave out what is transparent: `light`, `resample`, `half`, `composite`. `sweep` makes the tiles, `fill` gives
//! transparent texels a colour; `memory` says how much all of it takes.

mod composite;
mod fill;
mod ground;
mod half;
mod light;
mod memory;
mod oblique;
mod place;
mod resample;
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

/// Texels of the neighbours that a stored tile has on every side: two, so that its side stays a multiple of four.
pub const GUTTER: usize = 2;

/// Where texels lie on the lattice of the heights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TexelGrid {
    /// Texels along the side of a tile, the gutter not counted: a multiple of 4 in 64..=4096.
    pub tile: u32,
    /// Intervals of the lattice along the root square, `T * 2^L`.
    pub intervals: u64,
    /// Columns and rows of samples that the lattice has: tiles wholly beside them are not made.
    pub samples: (u32, u32),
}

/// Takes the tiles of an imagery layer as they are finished, from several threads, in any order.
pub trait TileSink: Sync {
    /// A finished tile: `children` has bit `q` set if child `q` exists; `texels.side` is the tile's side and two gutters.
    fn tile(&self, id: TileId, children: u8, texels: Texels) -> Result<()>;
}

/// Which level a picture belongs to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Resolution {
    /// The one whose texels are nearest to its pixels in size, as a ratio.
    #[default]
    Closest,
    /// The coarsest whose texels are not larger than its pixels.
    Finer,
    /// The finest whose texels are not smaller than its pixels.
    Coarser,
}

/// A picture in the layer.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedPicture {
    /// What it is.
    pub note: PictureNote,
    /// The finest level that it is resampled to.
    pub level: u8,
    /// Its pixels that a texel of that level spans, along columns and along rows.
    pub pixels_per_texel: (f64, f64),
    /// The part of its area over the lattice, 0 to 1.
    pub inside: f64,
}

/// What [`build`] has made.
#[derive(Clone, Debug, PartialEq)]
pub struct PyramidReport {
    /// What the colours of all tiles are.
    pub kind: Colour,
    /// Tiles of each level, from the root.
    pub tiles: Vec<u64>,
    /// How opaque the tiles without children are in the mean, 0 to 1.
    pub opaque: f64,
    /// The pictures, in their order.
    pub pictures: Vec<PlacedPicture>,
}

/// Where pictures lie, without reading them: what [`build`] would refuse at once is refused here.
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

/// Makes the tiles of pictures, of which the last lies on top, over a lattice that lies at `geo`.
///
/// Runs on the current thread pool. What the sink gets does not depend on the number of threads, only the order does. Fails with
/// [`Error::Interrupted`] if `progress` says so, and if no picture has anything to show.
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
