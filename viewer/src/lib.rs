//! Relevo's viewer: draws a `.rlv` file at a stated pixel error, on any adapter that wgpu finds.
//!
//! [`gpu`] draws what `relevo::select` has chosen and knows no file.

pub mod gpu;
