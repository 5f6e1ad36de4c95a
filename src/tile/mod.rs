//! Tiles as they are made: raw samples to codes, a band into tiles, heights for voids, every second sample for a parent.

pub mod code;
pub mod downsample;
pub mod fill;
pub mod split;

pub use relevo_core::tile::*;
