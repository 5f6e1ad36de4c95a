//! Relevo's viewer: draws a `.rlv` file at a stated pixel error, on any adapter that wgpu finds.
//!
//! [`gpu`] draws what `relevo_core::select` has chosen and knows no file. [`loader`] is the second
//! thread; [`scene`] brings both together for one frame.

pub mod camera;
pub mod canvas;
pub mod flyover;
pub mod governor;
pub mod gpu;
pub mod headless;
pub mod input;
pub mod known;
pub mod loader;
pub mod metrics;
pub mod panel;
pub mod path;
pub mod pool;
pub mod residency;
pub mod scene;
pub mod settings;
pub mod show;
pub mod stage;
pub mod window;
