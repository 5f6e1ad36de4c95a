//! Reads `.rlv` terrain, and chooses what to draw of it.
//!
//! A `.rlv` file holds a digital elevation model of any size as a quadtree of tiles, each a lattice
//! of samples with proven geometric errors for every patch at every tessellation step, and, if
//! there is any, imagery in a quadtree of its own. `format-spec.md` describes the bytes; the crate
//! `relevo` makes such files of rasters.
//!
//! # Read a tile
//!
//! A [`Reader`] is opened on a file or on anything that is a [`ReadAt`]. The index alone says what
//! to load.
//!
//! ```
//! use relevo_core::{Reader, TileId};
//!
//! # fn main() -> relevo_core::Result<()> {
//! # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
//! let reader = Reader::open(path)?;
//! let root = reader.entry(TileId::ROOT)?.unwrap();
//! assert!(root.min_m < root.max_m);
//! let tile = reader.read_tile(TileId::ROOT)?;
//! // T + 1 samples along a side, as codes; the header makes metres of them.
//! assert_eq!(tile.code.len(), (tile.n + 1) * (tile.n + 1));
//! let metres = reader.header().metres_of(tile.code[tile.at(0, 0)], 0);
//! assert!(metres.is_finite());
//! // The error of each patch at each step: step s draws every 2^s-th sample.
//! let errors = reader.read_errors(TileId::ROOT)?;
//! assert_eq!(errors.steps, reader.header().steps() as usize);
//! # Ok(())
//! # }
//! ```
//!
//! # Ask for a height
//!
//! [`surface::height_at`] interpolates the samples as the specification says.
//!
//! ```
//! use relevo_core::{Reader, surface};
//!
//! # fn main() -> relevo_core::Result<()> {
//! # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
//! let reader = Reader::open(path)?;
//! let (x, y) = reader.geo().world_from_sample(2.0, 3.0);
//! assert!(surface::height_at(&reader, x, y)?.is_some());
//! # Ok(())
//! # }
//! ```
//!
//! # Choose what to draw
//!
//! [`select`] has the level of detail: tiles and steps for a camera and an error in pixels, without
//! a GPU, a file or a thread of its own.
//!
//! # Features
//!
//! `imagery` (on by default) decodes imagery tiles; `projections` has coordinate systems and their
//! longitudes and latitudes; `threads` uses several threads where a call works on many tiles;
//! `write` has what a writer of the format needs; `map` maps files into memory. `libzstd` (on by
//! default) and `ruzstd` decompress, the second in Rust alone.

// Encoders stand beside their decoders; a reader leaves them away.
#[doc(hidden)]
#[cfg_attr(not(feature = "write"), allow(dead_code, unused_imports))]
pub mod codec;
#[doc(hidden)]
pub mod container;
#[doc(hidden)]
#[cfg(feature = "projections")]
pub mod crs;
#[doc(hidden)]
pub mod error;
#[doc(hidden)]
pub mod error_code;
#[doc(hidden)]
pub mod geo;
#[doc(hidden)]
pub mod limits;
#[doc(hidden)]
pub mod lru;
pub mod observed;
#[doc(hidden)]
#[cfg(feature = "write")]
pub mod output;
#[doc(hidden)]
pub mod read_at;
#[doc(hidden)]
pub mod sample;
pub mod select;
#[doc(hidden)]
pub mod simd;
pub mod surface;
#[doc(hidden)]
pub mod texel;
#[doc(hidden)]
pub mod text;
#[doc(hidden)]
pub mod tile;

#[doc(inline)]
pub use codec::imagery::Codec;
#[doc(inline)]
pub use codec::table::ErrorTable;
#[doc(inline)]
pub use container::{
    ChunkKind, Header, ImageryEntry, ImageryHeader, ImageryLayer, Metadata, Metric, Reader, ReaderOptions,
    Statistics, TileEntry,
};
#[cfg(feature = "projections")]
#[doc(inline)]
pub use crs::projection::Projection;
#[doc(inline)]
pub use error::{Error, Result};
#[doc(inline)]
pub use geo::{Crs, CrsKind, Ellipsoid, Geo};
#[doc(inline)]
pub use limits::Limits;
#[cfg(feature = "map")]
#[doc(inline)]
pub use read_at::Map;
#[doc(inline)]
pub use read_at::ReadAt;
#[doc(inline)]
pub use sample::{Lattice, SampleType};
#[doc(inline)]
pub use texel::Texels;
#[doc(inline)]
pub use tile::TileId;
