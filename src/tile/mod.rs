//! How tiles are made: codes of raw samples, tiles of a band, fill heights of voids, and every
//! second sample for the parent.

pub mod code;
pub mod downsample;
pub mod fill;
pub mod split;

pub use relevo_core::tile::*;
