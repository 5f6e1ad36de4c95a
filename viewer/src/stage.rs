//! A scene and the renderer that draws it.

use relevo_core::select::levels::patch_box;
use relevo_core::select::tile::TileData;
use relevo_core::select::{Frame, Levels, Selection, View};
use relevo_core::texel::Texels;
use relevo_core::{Error, Result};

use crate::gpu::{FrameInput, Gpu, Look, Paint, Renderer};
use crate::residency::Store;
use crate::scene::{FramePlan, Scene, Terrain};
use crate::settings::Settings;

/// Device, renderer and scene.
pub struct Stage {
    /// The device.
    pub gpu: Gpu,
    /// The renderer.
    pub renderer: Renderer,
    /// The scene.
    pub scene: Scene,
}

/// A store that uploads to the renderer.
struct Uploads<'a> {
    gpu: &'a Gpu,
    renderer: &'a mut Renderer,
}

impl Store for Uploads<'_> {
    fn put_tile(&mut self, slot: u32, data: &TileData) -> Result<()> {
        self.renderer.upload_tile(self.gpu, slot, data)
    }

    fn put_image(&mut self, slot: u32, texels: &Texels) -> Result<()> {
        self.renderer.upload_image(self.gpu, slot, texels)
    }
}

/// How a plan is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Drawing<'a> {
    /// The camera.
    pub view: &'a View,
    /// Tolerance in pixels.
    pub tolerance: f64,
    /// Colours and lines.
    pub look: Look,
    /// Steps to draw instead of those that belong to the view.
    pub levels: Option<&'a Levels>,
}

impl Stage {
    /// Returns a stage for pictures of at most `size` pixels on targets of a format.
    pub fn new(
        gpu: Gpu,
        terrain: Terrain,
        settings: &Settings,
        size: (u32, u32),
        format: wgpu::TextureFormat,
    ) -> Result<Self> {
        let sizes = terrain.sizes().within(&gpu, settings.gpu_memory, size)?;
        let renderer = Renderer::new(&gpu, sizes, format)?;
        let scene = Scene::new(terrain, sizes, settings.rule, settings.exaggeration)?;
        Ok(Self { gpu, renderer, scene })
    }

    /// Plans a frame of the resident tiles; never waits for the loader.
    pub fn stream(&mut self, view: &View, tolerance: f64) -> Result<FramePlan> {
        let mut uploads = Uploads { gpu: &self.gpu, renderer: &mut self.renderer };
        self.scene.stream(&mut uploads, view, tolerance)
    }

    /// Plans a frame after all tiles that it wants are loaded.
    pub fn settle(&mut self, view: &View, tolerance: f64) -> Result<FramePlan> {
        let mut uploads = Uploads { gpu: &self.gpu, renderer: &mut self.renderer };
        self.scene.settle(&mut uploads, view, tolerance)
    }

    /// Draws a plan on a target of `size` pixels.
    pub fn draw(
        &mut self,
        plan: &FramePlan,
        drawing: &Drawing<'_>,
        target: &wgpu::TextureView,
        size: (u32, u32),
    ) -> Result<()> {
        let frame = *self.scene.frame();
        let input = FrameInput {
            selection: &plan.selection,
            slots: &plan.slots,
            draws: &plan.draws,
            images: &plan.images,
            view: drawing.view,
            frame: &frame,
            tolerance: drawing.tolerance,
            rule: self.scene.rule(),
            levels: drawing.levels,
            look: drawing.look,
        };
        self.renderer.render(&self.gpu, &input, target, size)
    }

    /// Returns the bytes of graphics memory that the renderer has.
    pub fn gpu_bytes(&self) -> u64 {
        self.renderer.bytes()
    }

    /// Returns the look for the file: tints over its range of heights, the sun in the north-west.
    pub fn look(&self, settings: &Settings) -> Look {
        let (low, high) = self.scene.heights();
        Look {
            paint: settings.paint,
            wireframe: settings.wireframe,
            borders: settings.borders,
            clear: CLEAR,
            sun: SUN,
            range: [low, high],
        }
    }
}

/// Colour of the sky, linear RGB.
const CLEAR: [f64; 3] = [0.30, 0.46, 0.68];
/// Direction of the sun: in the north-west, 40 degrees high.
const SUN: [f32; 3] = [-0.541_675, 0.541_675, 0.642_788];

/// Returns the largest projected error of a drawn patch in pixels, from the tables at the steps
/// that were drawn.
pub fn promised(selection: &Selection, levels: &Levels, frame: &Frame, view: &View) -> f64 {
    let count = (selection.patches * selection.patches) as usize;
    let planes = view.planes();
    let mut worst = 0.0_f64;
    for (tile, inner) in selection.tiles.iter().zip(levels.inner.chunks_exact(count.max(1))) {
        let table = &*tile.table;
        for at in (0..count).filter(|&at| table.drawable[at]) {
            let space = patch_box(table, tile.exponent, selection.patch_log2, frame, at);
            if !space.is_inside(&planes) {
                continue;
            }
            let step = inner[at].saturating_sub(tile.exponent).min(selection.patch_log2);
            let index = usize::from(step) * count + at;
            let vertical = f64::from(table.vertical[index]) * frame.exaggeration;
            worst = worst.max(view.projected(&space, vertical, table.horizontal[index].into()));
        }
    }
    worst
}

/// Returns a device without a window; `adapter` is `auto`, `software`, or a part of an adapter's
/// name.
pub fn headless_gpu(adapter: &str) -> Result<Gpu> {
    match adapter {
        "auto" => Gpu::headless(false),
        "software" => Gpu::headless(true),
        name => {
            let descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
            named_gpu(wgpu::Instance::new(descriptor), name, None)
        }
    }
}

/// Returns a device of the adapter of that name that can draw on `surface`; `software` is one that
/// draws on the processor.
pub fn named_gpu(instance: wgpu::Instance, name: &str, surface: Option<&wgpu::Surface<'_>>) -> Result<Gpu> {
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let fits = |adapter: &&wgpu::Adapter| {
        let info = adapter.get_info();
        let named = if name == "software" {
            info.device_type == wgpu::DeviceType::Cpu
        } else {
            info.name.to_lowercase().contains(&name.to_lowercase())
        };
        named && surface.is_none_or(|surface| adapter.is_surface_supported(surface))
    };
    if let Some(adapter) = adapters.iter().find(fits).cloned() {
        return Gpu::on(instance, adapter);
    }
    let names: Vec<String> = adapters.iter().map(|adapter| adapter.get_info().name).collect();
    let there = if names.is_empty() { "none".into() } else { names.join("; ") };
    let hint = if name == "software" { "; install mesa-vulkan-drivers, which draws in software" } else { "" };
    Err(Error::usage(format!("--adapter {name}: no such graphics adapter; there are: {there}{hint}")))
}

/// Names of the paint modes, in the order of their keys.
pub const PAINTS: [(&str, Paint); 5] = [
    ("terrain", Paint::Terrain),
    ("tint", Paint::Tint),
    ("level", Paint::TileLevel),
    ("step", Paint::Step),
    ("error", Paint::Error),
];
