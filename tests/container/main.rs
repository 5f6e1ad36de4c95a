//! The container from outside: files written from hand-made rasters, read back, damaged, and asked for heights.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests")]

mod hostile;
mod opening;
mod raster;
mod reading;
mod surface;
mod writing;
