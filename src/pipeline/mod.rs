//! A raster becomes a file, in stages that stream from north to south.
//!
//! 1. [`plan()`] says what the file will be: the pyramid of levels, the memory and the options.
//! 2. `run` reads the window of the build in bands of T + 1 rows; `bands` makes of each a row of
//!    leaf tiles.
//! 3. `sweep` takes the rows. As soon as the row below is known, it fills voids, measures errors,
//!    encodes, appends to the writer and halves. Two finished rows make one row of the level above,
//!    up to the root. A tile without voids is cut, or put together from its children, by the task
//!    that finishes it (`tile_work`), while it is in the processor's cache.
//! 4. `assemble` makes imagery, metadata and statistics, and lets the writer put the file together.
//!
//! A build works on a window of leaf tiles, by default all of them. What it cannot finish at the
//! sides of the window it leaves for a merge (`window_levels`, `carry`). Three things are merges:
//! [`merge()`] joins pieces that were built apart; a resumed build takes what was finished before
//! as a piece (`state`, `checkpoint`); a build within a limit of memory joins strips of columns
//! ([`column_passes`]).
//!
//! Memory grows with the width of the window. Everything is written in a fixed order: any number of
//! threads, and any number of pieces, gives the same bytes.

mod assemble;
mod bands;
mod begun;
mod buffers;
mod build;
mod carry;
mod checkpoint;
mod child_summary;
pub mod column_passes;
mod counts;
mod encoding;
pub mod estimate;
pub mod imagery;
mod job;
pub mod memory;
mod merge;
mod metadata;
mod occupied;
mod odd;
mod options;
mod outcome;
mod plan;
mod pyramid;
mod report;
mod run;
mod state;
mod statistics;
mod sweep;
mod threads;
mod tile_row;
mod tile_work;
mod value_range;
mod window_levels;

pub use build::{build, build_window, build_with, merge, merge_within};
pub use options::{BuildOptions, CHECKPOINT};
pub use plan::{Plan, plan};
pub use pyramid::Pyramid;
pub use report::Report;
pub use threads::workers;

pub use crate::progress::{Progress, Silent, Stage};
