//! The drawing side: device, atlases of heights and images, the pass that finds steps, the draws.

use relevo::select::imagery::Draw;
use relevo::select::{EdgeRule, Frame, Levels, Selection, View};

/// A device to draw with.
#[derive(Debug)]
pub struct Gpu {
    /// What made it; a window's surface comes from it.
    pub instance: wgpu::Instance,
    /// The adapter: its name is what a user wants to see.
    pub adapter: wgpu::Adapter,
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
}

/// Sizes that a [`Renderer`] is made for.
#[derive(Clone, Copy, Debug)]
pub struct Sizes {
    /// Intervals of a tile, T.
    pub tile: u32,
    /// Binary logarithm of the patch size.
    pub patch_log2: u8,
    /// Tiles of heights that fit at once.
    pub tiles: u32,
    /// Images that fit at once; 0 without imagery.
    pub images: u32,
    /// Texels along an image, gutters included.
    pub image_side: u32,
    /// Texels of its gutter.
    pub gutter: u32,
}

/// Colours by what.
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

/// How it is to look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Colours.
    pub paint: Paint,
    /// Edges of the triangles over them.
    pub wireframe: bool,
    /// Borders of tiles.
    pub borders: bool,
    /// Colour where nothing is drawn, linear RGB.
    pub clear: [f64; 3],
    /// Towards the sun, a unit vector of the frame.
    pub sun: [f32; 3],
    /// Heights of the lowest and the highest tint, metres.
    pub range: [f32; 2],
}

/// One picture to draw.
#[derive(Clone, Copy, Debug)]
pub struct FrameInput<'a> {
    /// What to draw.
    pub selection: &'a Selection,
    /// Height slot of each tile of the selection.
    pub slots: &'a [u32],
    /// Virtual tiles.
    pub draws: &'a [Draw],
    /// Image slot of each draw; `None` without image.
    pub images: &'a [Option<u32>],
    /// Camera.
    pub view: &'a View,
    /// Where things stand.
    pub frame: &'a Frame,
    /// Pixels.
    pub tolerance: f64,
    /// Edge rule.
    pub rule: EdgeRule,
    /// Steps to draw instead of those that the pass finds: for tests.
    pub levels: Option<&'a Levels>,
    /// Look.
    pub look: Look,
}

/// What was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Drawn {
    /// Patches.
    pub patches: u32,
    /// Triangles.
    pub triangles: u64,
}
