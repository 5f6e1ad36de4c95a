//! The data that is uploaded once and drawn many times: heights, validity and error tables of
//! tiles, and images.

use relevo_core::select::{TileData, TileTable};
use relevo_core::texel::{Colour, Texels};
use relevo_core::{Error, Result};

use super::device::Gpu;
use super::sizes::{Packing, Sizes};

/// Textures and tables by slot.
#[derive(Debug)]
pub(crate) struct Atlas {
    sizes: Sizes,
    heights: wgpu::Texture,
    valid: wgpu::Texture,
    images: wgpu::Texture,
    pub tables: wgpu::Buffer,
    tiles_held: Vec<bool>,
    images_held: Vec<bool>,
}

fn layers(gpu: &Gpu, label: &str, packing: Packing, format: wgpu::TextureFormat) -> Result<wgpu::Texture> {
    let limits = gpu.device.limits();
    let (side, most) = (packing.across * packing.side, limits.max_texture_dimension_2d);
    if side > most {
        return Err(Error::limit(
            format!("the texture of {label}, in texels along a side,"),
            side.into(),
            most.into(),
        ));
    }
    Ok(gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: packing.layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    }))
}

fn view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

/// Writes a square of texels into its slot.
fn write(gpu: &Gpu, texture: &wgpu::Texture, packing: Packing, slot: u32, bytes: &[u8]) {
    let texel = bytes.len() as u32 / (packing.side * packing.side);
    gpu.queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: 0,
            origin: packing.origin(slot),
            aspect: wgpu::TextureAspect::All,
        },
        bytes,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(texel * packing.side),
            rows_per_image: Some(packing.side),
        },
        wgpu::Extent3d { width: packing.side, height: packing.side, depth_or_array_layers: 1 },
    );
}

impl Atlas {
    pub fn new(gpu: &Gpu, sizes: Sizes) -> Result<Self> {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let tables = sizes.table_words() * 4 * u64::from(sizes.tiles);
        Ok(Self {
            sizes,
            heights: layers(gpu, "heights", sizes.height_packing(), wgpu::TextureFormat::R32Float)?,
            valid: layers(gpu, "validity", sizes.height_packing(), wgpu::TextureFormat::R8Uint)?,
            images: layers(gpu, "images", sizes.image_packing(), wgpu::TextureFormat::Rgba8UnormSrgb)?,
            tables: gpu.buffer("error tables", tables, usage)?,
            tiles_held: vec![false; sizes.tiles as usize],
            images_held: vec![false; sizes.images as usize],
        })
    }

    pub fn bytes(&self) -> u64 {
        self.sizes.height_packing().texels() * 5
            + self.sizes.image_packing().texels() * 4
            + self.tables.size()
    }

    /// Returns views of heights, validity and images.
    pub fn views(&self) -> [wgpu::TextureView; 3] {
        [view(&self.heights), view(&self.valid), view(&self.images)]
    }

    pub fn has_tile(&self, slot: u32) -> bool {
        self.tiles_held.get(slot as usize) == Some(&true)
    }

    pub fn has_image(&self, slot: u32) -> bool {
        self.images_held.get(slot as usize) == Some(&true)
    }

    pub fn upload_tile(&mut self, gpu: &Gpu, slot: u32, tile: &TileData) -> Result<()> {
        let sizes = self.sizes;
        let samples = (sizes.tile as usize + 1).pow(2);
        if tile.n != sizes.tile || tile.heights.len() != samples || tile.valid.len() != samples {
            return Err(Error::usage(format!(
                "tile {} has {} intervals and {} heights, a renderer for tiles of {} does not take it",
                tile.table.id,
                tile.n,
                tile.heights.len(),
                sizes.tile
            )));
        }
        let table = packed(&tile.table, sizes)?;
        let held = held(&mut self.tiles_held, slot, "tiles")?;
        write(gpu, &self.heights, sizes.height_packing(), slot, bytemuck::cast_slice(&tile.heights));
        write(gpu, &self.valid, sizes.height_packing(), slot, &tile.valid);
        gpu.queue.write_buffer(
            &self.tables,
            u64::from(slot) * sizes.table_words() * 4,
            bytemuck::cast_slice(&table),
        );
        *held = true;
        Ok(())
    }

    pub fn upload_image(&mut self, gpu: &Gpu, slot: u32, image: &Texels) -> Result<()> {
        let side = self.sizes.image_side as usize;
        let channels = image.kind.channels();
        let alpha = image.alpha.as_ref().is_none_or(|alpha| alpha.len() == side * side);
        if image.side != side || image.colour.len() != side * side * channels || !alpha {
            return Err(Error::usage(format!(
                "an image of {} texels, a renderer for images of {side} does not take it",
                image.side
            )));
        }
        let held = held(&mut self.images_held, slot, "images")?;
        let mut texels = vec![[255_u8; 4]; side * side];
        for (texel, colour) in texels.iter_mut().zip(image.colour.chunks_exact(channels)) {
            match image.kind {
                Colour::Grey => texel[..3].fill(colour[0]),
                Colour::Rgb => texel[..3].copy_from_slice(colour),
            }
        }
        for (texel, &alpha) in texels.iter_mut().zip(image.alpha.iter().flatten()) {
            texel[3] = alpha;
        }
        write(gpu, &self.images, self.sizes.image_packing(), slot, bytemuck::cast_slice(&texels));
        *held = true;
        Ok(())
    }
}

fn held<'a>(held: &'a mut [bool], slot: u32, what: &str) -> Result<&'a mut bool> {
    let count = held.len();
    held.get_mut(slot as usize)
        .ok_or_else(|| Error::usage(format!("slot {slot} of {count} slots of {what} does not exist")))
}

/// Returns a table as the passes read it: rows of `m^2` numbers.
fn packed(table: &TileTable, sizes: Sizes) -> Result<Vec<f32>> {
    let parts = (sizes.patches() as usize).pow(2);
    let errors = parts * (usize::from(sizes.patch_log2) + 1);
    let good = table.patches == sizes.patches()
        && table.steps == u32::from(sizes.patch_log2) + 1
        && [&table.vertical, &table.horizontal].iter().all(|of| of.len() == errors)
        && [&table.low, &table.high].iter().all(|of| of.len() == parts)
        && table.drawable.len() == parts;
    if !good {
        return Err(Error::usage(format!(
            "the error table of tile {} is not of {} patches and {} steps",
            table.id,
            parts,
            sizes.patch_log2 + 1
        )));
    }
    let mut out = Vec::with_capacity(2 * errors + 3 * parts);
    for of in [&table.vertical, &table.horizontal, &table.low, &table.high] {
        out.extend_from_slice(of);
    }
    out.extend(table.drawable.iter().map(|&drawn| f32::from(u8::from(drawn))));
    Ok(out)
}
