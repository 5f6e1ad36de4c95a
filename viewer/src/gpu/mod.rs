//! Drawing: device, atlases of heights and images, the pass that finds steps, the draws.
//!
//! [`Gpu`] is an adapter and its device. [`Sizes::within`] says how many tiles and images fit a
//! budget; a [`Renderer`] of these sizes takes tiles and images by slot and draws a [`FrameInput`]
//! on a target, a window's or a [`RenderTarget`]. No call waits for the device but those that give
//! something back: [`Renderer::drawn`], [`Renderer::levels`], [`RenderTarget::read`]. No optional
//! feature of an adapter is used, and of its limits only sizes of textures and buffers.
//!
//! A picture is two passes. The first has one thread a patch: steps (`shaders/levels.wgsl`), then
//! instances sorted into buckets, one for each index mesh (`shaders/sort.wgsl`). The second is one
//! indirect draw a bucket (`shaders/terrain.wgsl`). Two things keep the surface closed: a vertex
//! that tiles share has the same column and row from the camera in both, as integers, and the same
//! height; and the same instructions place it. Coordinates are single precision only after the
//! camera is subtracted, so places far from the origin look like those near it.

mod atlas;
mod buffers;
pub mod device;
mod input;
mod meshes;
mod pipelines;
mod readback;
pub mod renderer;
pub mod sizes;
pub mod target;

use relevo_core::select::imagery::Draw;
use relevo_core::select::{EdgeRule, Frame, Levels, Selection, View};

pub use device::Gpu;
pub use renderer::Renderer;
pub use sizes::Sizes;
pub use target::RenderTarget;

/// What the colours show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Paint {
    /// Imagery where there is some, hypsometric tint elsewhere; sun shading.
    #[default]
    Terrain,
    /// Tint and shading even where there is imagery.
    Tint,
    /// Level of the tile.
    TileLevel,
    /// Step of the patch.
    Step,
    /// Projected error of what is drawn, in pixels: blue 0, red the tolerance.
    Error,
    /// Every fragment adds 1/16 to the red channel, depth test off: for tests of coverage.
    Count,
}

/// Colours and lines of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Colours.
    pub paint: Paint,
    /// Draw the edges of triangles.
    pub wireframe: bool,
    /// Draw the borders of tiles.
    pub borders: bool,
    /// Colour where nothing is drawn, linear RGB.
    pub clear: [f64; 3],
    /// Unit vector of the frame towards the sun.
    pub sun: [f32; 3],
    /// Heights of the lowest and the highest tint, metres.
    pub range: [f32; 2],
}

/// The input of one frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameInput<'a> {
    /// The tiles to draw.
    pub selection: &'a Selection,
    /// Height slot of each tile of the selection.
    pub slots: &'a [u32],
    /// Virtual tiles: tiles, each once for every image on it.
    pub draws: &'a [Draw],
    /// Image slot of each draw; `None` without image.
    pub images: &'a [Option<u32>],
    /// The camera.
    pub view: &'a View,
    /// Spacing of the samples and exaggeration.
    pub frame: &'a Frame,
    /// Tolerance in pixels.
    pub tolerance: f64,
    /// Rule for the steps of shared edges.
    pub rule: EdgeRule,
    /// Steps to draw instead of those that the pass finds: for tests.
    pub levels: Option<&'a Levels>,
    /// Colours and lines.
    pub look: Look,
}

/// Counts of what was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Drawn {
    /// Patches.
    pub patches: u32,
    /// Triangles.
    pub triangles: u64,
}
