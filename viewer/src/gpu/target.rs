//! A texture to draw on, and its pixels as bytes or as a PNG file.

use std::io::BufWriter;
use std::path::Path;

use relevo_core::output::NewFile;
use relevo_core::{Error, Result};

use super::device::Gpu;

/// Format of render targets without a window.
pub const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;

/// A texture that is drawn on and read back.
#[derive(Debug)]
pub struct RenderTarget {
    texture: wgpu::Texture,
    view: wgpu::TextureView,
}

/// Refuses sizes that the device cannot draw.
pub(crate) fn check(gpu: &Gpu, (width, height): (u32, u32)) -> Result<()> {
    let most = gpu.device.limits().max_texture_dimension_2d;
    if width == 0 || height == 0 {
        return Err(Error::usage(format!("a picture of {width} x {height} pixels has none")));
    }
    if width.max(height) > most {
        return Err(Error::limit("the side of a picture, in pixels,", width.max(height).into(), most.into()));
    }
    Ok(())
}

impl RenderTarget {
    /// Returns a target of `size` pixels; `format` has four bytes a pixel, as [`FORMAT`] has.
    pub fn new(gpu: &Gpu, size: (u32, u32), format: wgpu::TextureFormat) -> Result<Self> {
        check(gpu, size)?;
        if format.block_copy_size(None) != Some(4) {
            return Err(Error::usage(format!("pictures of {format:?} cannot be read back")));
        }
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("render target"),
            size: wgpu::Extent3d { width: size.0, height: size.1, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        gpu.check()?;
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Ok(Self { texture, view })
    }

    /// Returns the view to draw on.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }

    /// Returns width and height in pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.texture.width(), self.texture.height())
    }

    /// Returns its pixels, red, green, blue and alpha, row by row from the top; waits for the
    /// drawing.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<u8>> {
        gpu.check()?;
        let (width, height) = self.size();
        let row = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let staging = gpu.buffer("pixels", u64::from(row) * u64::from(height), usage)?;
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_texture_to_buffer(
            self.texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &staging,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row),
                    rows_per_image: None,
                },
            },
            self.texture.size(),
        );
        gpu.queue.submit([encoder.finish()]);
        let padded = gpu.read(&staging)?;
        let rows = padded.chunks_exact(row as usize).take(height as usize);
        let mut out: Vec<u8> = rows.flat_map(|padded| &padded[..4 * width as usize]).copied().collect();
        if self.texture.format().remove_srgb_suffix() == wgpu::TextureFormat::Bgra8Unorm {
            out.chunks_exact_mut(4).for_each(|pixel| pixel.swap(0, 2));
        }
        Ok(out)
    }

    /// Writes it as a PNG file, in place of another one only if `force` holds.
    pub fn save(&self, gpu: &Gpu, path: &Path, force: bool) -> Result<()> {
        save_png(path, self.size(), &self.read(gpu)?, force)
    }
}

/// Writes pixels (red, green, blue, alpha) as an opaque PNG file, in place of another one only if
/// `force` holds.
pub fn save_png(path: &Path, (width, height): (u32, u32), rgba: &[u8], force: bool) -> Result<()> {
    let mut file = NewFile::create(path, force)?;
    let mut encoder = png::Encoder::new(BufWriter::new(&mut file), width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    let rgb: Vec<u8> = rgba.chunks_exact(4).flat_map(|pixel| &pixel[..3]).copied().collect();
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(&rgb)?;
        writer.finish()
    });
    written.map_err(|error| Error::io(path, "write the picture", std::io::Error::other(error)))?;
    file.commit()
}
