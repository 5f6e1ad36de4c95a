//! Relevo: digital elevation models of any size as one streamable tile pyramid (`.rlv`), with a
//! proven geometric error for every patch at every tessellation step.
//!
//! The library reads DEMs, builds containers, and reads them back: the index, tiles (heights,
//! voids, errors) and the surface they define. `format-spec.md` describes the bytes,
//! `ARCHITECTURE.md` the code.
//!
//! ```
//! use relevo::container::Reader;
//! use relevo::limits::Limits;
//! use relevo::pipeline::{self, BuildOptions, Silent};
//! use relevo::{TileId, source, surface};
//!
//! # fn main() -> relevo::Result<()> {
//! let dem = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem/rmnp_dem_uint16.tif");
//! # let folder = tempfile::tempdir().unwrap();
//! let output = std::env::temp_dir().join("rmnp.rlv");
//! # let output = folder.path().join("rmnp.rlv");
//! let source = source::open(&dem, &Limits::default())?;
//! let options = BuildOptions { tile: 64, patch: 16, force: true, ..BuildOptions::default() };
//! let report = pipeline::build(&*source, &output, &options, &Silent)?;
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

pub mod export;
mod file;
pub mod geotiff_write;
pub mod hillshade;
pub mod imagery;
pub mod patch;
pub mod pipeline;
pub mod progress;
mod rect;
pub mod source;
pub mod tile;
pub mod verify;
pub mod work_folder;
pub mod writer;

pub use rect::Rect;
use relevo_core::lru;
pub use relevo_core::{
    Error, Result, TileId, codec, container, crs, error, error_code, geo, limits, observed, output, sample,
    select, simd, surface, texel, text,
};

// The code of README.md is compiled, so that it stays true.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
