//! The surface of a window, and the device that draws on it.

use std::sync::Arc;

use relevo_core::{Error, Result};
use wgpu::CurrentSurfaceTexture as Current;
use winit::event_loop::OwnedDisplayHandle;
use winit::window::Window;

use crate::gpu::Gpu;
use crate::stage::named_gpu;

/// A window's surface.
#[derive(Debug)]
pub struct Canvas {
    window: Arc<Window>,
    surface: wgpu::Surface<'static>,
    configuration: wgpu::SurfaceConfiguration,
    /// True if the surface must be configured again.
    stale: bool,
    /// How often in a row no texture could be had.
    refused: u32,
}

/// Failures in a row after which the surface counts as lost.
const MOST_REFUSED: u32 = 100;

impl Canvas {
    /// Returns the surface of a window and a device for it; `adapter` is the value of `--adapter`.
    pub fn new(window: Arc<Window>, display: Box<OwnedDisplayHandle>, adapter: &str) -> Result<(Self, Gpu)> {
        let descriptor = wgpu::InstanceDescriptor::new_with_display_handle_from_env(display);
        let instance = wgpu::Instance::new(descriptor);
        let surface = make(&instance, &window)?;
        let gpu = match adapter {
            "auto" => Gpu::new(instance, Some(&surface))?,
            name => named_gpu(instance, name, Some(&surface))?,
        };
        let size = window.inner_size();
        let (width, height) = (size.width.max(1), size.height.max(1));
        let no = || {
            Error::unsupported(
                "the graphics adapter cannot draw on this window",
                "use another one (--adapter)",
            )
        };
        let mut configuration = surface.get_default_config(&gpu.adapter, width, height).ok_or_else(no)?;
        let formats = surface.get_capabilities(&gpu.adapter).formats;
        // Eight bits a channel can be read back for a picture; sRGB is what the renderer writes
        // without detours.
        let wanted = [
            wgpu::TextureFormat::Bgra8UnormSrgb,
            wgpu::TextureFormat::Rgba8UnormSrgb,
            wgpu::TextureFormat::Bgra8Unorm,
            wgpu::TextureFormat::Rgba8Unorm,
        ];
        if let Some(format) = wanted.into_iter().find(|format| formats.contains(format)) {
            configuration.format = format;
        }
        configuration.present_mode = wgpu::PresentMode::AutoVsync;
        surface.configure(&gpu.device, &configuration);
        gpu.check()?;
        Ok((Self { window, surface, configuration, stale: false, refused: 0 }, gpu))
    }

    /// Returns the window.
    pub fn window(&self) -> &Window {
        &self.window
    }

    /// Returns the format of its textures.
    pub fn format(&self) -> wgpu::TextureFormat {
        self.configuration.format
    }

    /// Returns its width and height in pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.configuration.width, self.configuration.height)
    }

    /// Sets the size of the window; both sides are above 0.
    pub fn resize(&mut self, (width, height): (u32, u32)) {
        self.stale |= self.size() != (width, height);
        (self.configuration.width, self.configuration.height) = (width, height);
    }

    /// Returns the texture to draw on; `None` if the window cannot be seen at the moment.
    pub fn acquire(&mut self, gpu: &Gpu) -> Result<Option<wgpu::SurfaceTexture>> {
        if std::mem::take(&mut self.stale) {
            self.surface.configure(&gpu.device, &self.configuration);
        }
        let texture = match self.surface.get_current_texture() {
            Current::Success(texture) => Some(texture),
            Current::Suboptimal(texture) => {
                self.stale = true;
                Some(texture)
            }
            Current::Timeout | Current::Occluded => return Ok(None),
            Current::Outdated => {
                self.stale = true;
                None
            }
            Current::Lost => {
                self.surface = make(&gpu.instance, &self.window)?;
                self.stale = true;
                None
            }
            Current::Validation => None,
        };
        gpu.check()?;
        self.refused = if texture.is_some() { 0 } else { self.refused + 1 };
        if self.refused > MOST_REFUSED {
            let hint = "start again; --adapter software draws without the graphics card";
            return Err(Error::unsupported("the window's surface is lost", hint));
        }
        Ok(texture)
    }
}

fn make(instance: &wgpu::Instance, window: &Arc<Window>) -> Result<wgpu::Surface<'static>> {
    instance.create_surface(Arc::clone(window)).map_err(|error| {
        let hint =
            "install the driver of your graphics card, or mesa-vulkan-drivers, which draws in software";
        Error::unsupported(format!("no graphics on this window ({error})"), hint)
    })
}
