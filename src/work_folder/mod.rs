//! The work folder of a build that is not finished: `<output>.work`, beside the output.
//!
//! None of these files is part of the format: they are what a build keeps so that it can be
//! resumed, and what a piece (a window of tiles, to be merged with others) consists of.
//!
//! ```text
//! relevo.lock    locked while a build runs
//! state          what the build is of and how far the other files count (`pipeline::state`)
//! records        one row of the index for each tile, in the order in which the tiles came
//! level-00 ...   the chunks of the tiles of each level, in the same order
//! ```
//!
//! [`WorkFolder`] locks, cleans, keeps and publishes the folder; [`TileStore`] keeps the tiles in
//! it. The crate's `writer` makes the finished file of them.

mod folder;
mod level_file;
mod tile_list;
mod tile_store;

pub use folder::{Earlier, NewState, WorkFolder, resumable, state_path};
pub use tile_store::{Mark, TileStore};

pub(crate) use folder::open_file;
pub(crate) use level_file::BUFFER;
pub(crate) use tile_store::spent;
