//! `build`: a raster becomes a container, in stages that stream from north to south.
//!
//! open, plan, (scan), then for every band of T + 1 rows: read, code, split into leaf tiles; and for every row of tiles, as soon as the
//! row below it is there: fill voids, measure errors, encode, append, halve. Two finished rows make one row of the level above. Memory
//! grows with the width of the raster. The order of all that is written is fixed: any number of threads gives the same bytes, and so
//! does any number of pieces: a build works on a window of the lattice, by default all of it, and what it cannot finish at its sides
//! it leaves for a merge. To be resumed is to be merged with what was finished before.

mod assemble;
mod bands;
mod begun;
mod buffers;
mod build;
mod bytes;
mod checkpoint;
mod counts;
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
mod quarter;
mod reach;
mod report;
mod run;
mod seam;
mod state;
pub mod strips;
mod sweep;
mod tally;
mod threads;
mod value_range;
mod work;

pub use build::{build, build_window, build_with, merge, merge_within};
pub use options::{BuildOptions, CHECKPOINT};
pub use plan::{Plan, plan};
pub use pyramid::Pyramid;
pub use report::Report;
pub use threads::workers;

pub use crate::progress::{Observer, Silent, Stage};
