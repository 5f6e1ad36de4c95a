//! Makes one streamable tile pyramid (`.rlv`) of digital elevation models and imagery of any size,
//! with a proven geometric error for every patch at every tessellation step.
//!
//! [`relevo_core`], whose names are here too, reads such files and chooses what to draw of them; it
//! is all that a renderer needs. `format-spec.md` describes the bytes, `ARCHITECTURE.md` the code.
//!
//! # Build a file
//!
//! A [`source`] is opened, and a [`Build`] makes a file of it.
//!
//! ```
//! use relevo::{Build, Limits, Reader, TileId, source, surface};
//!
//! # fn main() -> relevo::Result<()> {
//! # let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
//! let dem = root.join("fixtures/dem/rmnp_dem_uint16.tif");
//! # let folder = tempfile::tempdir().unwrap();
//! # let output = folder.path().join("rmnp.rlv");
//! let source = source::open(&dem, &Limits::default())?;
//! let report = Build::new(&*source).tile(64).patch(16).run(&output)?;
//! assert_eq!(report.header.levels, 2);
//!
//! let reader = Reader::open(&output)?;
//! // The index alone says what to load: children, error, height range.
//! let root = reader.entry(TileId::ROOT)?.unwrap();
//! assert!(root.min_m >= 2281.0 && root.max_m <= 4261.0 && root.vertical_m() > 0.0);
//! // A tile: 65 x 65 samples, and the error of each of its 4 x 4 patches at steps 0 to 4.
//! let leaf = TileId::new(2, 1, 1);
//! let tile = reader.read_tile(leaf)?;
//! let height = reader.header().metres_of(tile.code[tile.at(10, 20)], 0);
//! let errors = reader.read_errors(leaf)?;
//! assert_eq!((tile.n, errors.patches, errors.steps), (64, 4, 5));
//! // The surface, anywhere: sample (64 + 10, 64 + 20) is that sample of the tile.
//! let (x, y) = reader.geo().world_from_sample(74.0, 84.0);
//! let there = surface::height_at(&reader, x, y)?.unwrap();
//! assert!((there - height).abs() < 1e-6);
//! # Ok(())
//! # }
//! ```
//!
//! # Join, add, check, export
//!
//! [`merge`] joins windows that were built apart, [`add_imagery`] puts pictures over the heights of
//! a file, [`verify`] recomputes what a file promises, [`export`] writes any level of it.
//!
//! # Features
//!
//! `cli` (on by default) is the command line; a library user turns it off. `gdal` reads any raster
//! that GDAL opens, and warps.

mod build;
pub mod export;
mod file;
#[doc(hidden)]
pub mod geotiff_write;
#[doc(hidden)]
pub mod hillshade;
#[doc(hidden)]
pub mod imagery;
pub mod mesh;
pub mod mesh_file;
#[doc(hidden)]
pub mod patch;
#[doc(hidden)]
pub mod pipeline;
#[doc(hidden)]
pub mod progress;
mod rect;
pub mod source;
#[doc(hidden)]
pub mod tile;
pub mod verify;
#[doc(hidden)]
pub mod work_folder;
#[doc(hidden)]
pub mod writer;

pub use build::Build;
#[doc(inline)]
pub use pipeline::imagery::{LayerOptions, add as add_imagery};
#[doc(inline)]
pub use pipeline::{BuildOptions, Plan, Report, merge};
#[doc(inline)]
pub use progress::{Progress, Silent, Stage};
pub use rect::Rect;
use relevo_core::lru;
pub use relevo_core::{
    ChunkKind, Codec, Crs, CrsKind, Ellipsoid, Error, ErrorTable, Geo, Header, ImageryEntry, ImageryHeader,
    ImageryLayer, Lattice, Limits, Metadata, Metric, Projection, ReadAt, Reader, ReaderOptions, Result,
    SampleType, Statistics, Texels, TileEntry, TileId, observed, select, surface,
};
#[doc(hidden)]
pub use relevo_core::{
    codec, container, crs, error, error_code, geo, limits, output, sample, simd, texel, text,
};

// The code of README.md is compiled, so that it stays true.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
