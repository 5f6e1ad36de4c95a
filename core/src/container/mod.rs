//! The container: one `.rlv` file, byte for byte as `format-spec.md` says.
//!
//! `opening`, `layout`, `sections`, `directory`, `entry`, `imagery` and `metadata` hold the
//! structures, each with encoding and decoding side by side (sections 3-4, 6, and 5 and 11 of the
//! specification). The reader and the writers build on them. Nothing here knows a raster: a tile is
//! a lattice and some chunks of bytes.

#[cfg(feature = "write")]
pub mod assemble;
mod bytes;
mod cache;
pub mod directory;
mod entry;
mod foreign;
pub mod imagery;
pub mod layout;
pub mod metadata;
pub mod opening;
pub mod reader;
pub mod sections;

pub use directory::{ChunkKind, TileEntry};
pub use imagery::{ImageryEntry, ImageryHeader};
pub use layout::{Header, Metric, leaf_level};
pub use metadata::{Metadata, Statistics};
pub use reader::ImageryLayer;
pub use reader::{Reader, ReaderOptions};
