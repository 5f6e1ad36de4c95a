//! The container from outside: files written from hand-made rasters, read back, damaged, and asked
//! for heights.

mod hostile;
mod opening;
mod raster;
mod reading;
mod surface;
mod writing;
