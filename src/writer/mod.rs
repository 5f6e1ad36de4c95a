//! Writers of the format: they lay tiles, index and metadata out as one `.rlv` file.
//!
//! - [`ContainerWriter`] takes the tiles of heights in any order and makes a file of them.
//! - [`ImageryWriter`] takes the tiles of an imagery layer and makes sections of them, which a
//!   [`ContainerWriter`] puts into its file, or [`amend`] into a file that exists.
//!
//! The same tiles give the same bytes in whatever order they came. A writer knows no samples: a
//! chunk is bytes that the codec made. Until a file is finished, its tiles lie in a
//! [`work_folder`](crate::work_folder).

pub mod amend;
mod container;
mod imagery;
mod sections;
mod tile;

pub use container::ContainerWriter;
pub use imagery::{ImagerySections, ImageryWriter};
pub use tile::{FileSummary, LevelBytes, TileChunks, TileRecord};
