//! The container: one `.rlv` file, byte for byte as `format-spec.md` says.
//!
//! `opening`, `layout`, `sections`, `directory`, `entry`, `imagery` and `metadata` hold the structures, each with encoding and decoding side by side (sections
//! 3-4, 6, and 5 and 11 of the specification). The writer and the reader both build on them and never import each
//! other. Nothing here knows a raster: tiles arrive and leave as chunks of bytes and as lattices.

pub mod amend;
mod assemble;
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
mod records;
pub mod sections;
pub mod work;
pub mod writer;

pub use directory::{ChunkKind, TileEntry};
pub use imagery::{ImageryEntry, ImageryHeader};
pub use layout::{Header, Metric, leaf_level};
pub use metadata::{Metadata, Statistics};
pub use reader::ImageryLayer;
pub use reader::{Reader, ReaderOptions};
pub use writer::{ContainerWriter, FileSummary, TileChunks, TileRecord};
