//! Draws frames: finds steps, sorts patches into buckets, draws each bucket.

use relevo_core::Result;
use relevo_core::select::{EdgeRule, Levels, TileData};
use relevo_core::texel::Texels;

use super::atlas::Atlas;
use super::buffers::Buffers;
use super::device::Gpu;
use super::input::Packed;
use super::meshes::{ARGUMENTS, GpuMeshes, STRIDE};
use super::pipelines::{Bound, DEPTH, Pipelines};
use super::readback::{Pending, counted};
use super::sizes::Sizes;
use super::{Drawn, FrameInput};

/// Everything on the device that frames are drawn from.
#[derive(Debug)]
pub struct Renderer {
    sizes: Sizes,
    format: wgpu::TextureFormat,
    atlas: Atlas,
    meshes: GpuMeshes,
    buffers: Buffers,
    pipelines: Pipelines,
    bound: Bound,
    depth: Option<(wgpu::TextureView, (u32, u32))>,
    pending: Pending,
    /// Numbers of patches and edges of the last frame.
    last: (u32, u32),
}

/// Threads of a group, and groups along a side.
const THREADS: u32 = 64;
const GROUPS: u32 = 65_535;

fn dispatch(pass: &mut wgpu::ComputePass<'_>, pipeline: &wgpu::ComputePipeline, threads: u32) {
    let groups = threads.div_ceil(THREADS);
    pass.set_pipeline(pipeline);
    pass.dispatch_workgroups(groups.min(GROUPS), groups.div_ceil(GROUPS), 1);
}

impl Renderer {
    /// Returns a renderer for targets of `format`; colours look the same whether it is sRGB or not.
    pub fn new(gpu: &Gpu, sizes: Sizes, format: wgpu::TextureFormat) -> Result<Self> {
        sizes.check()?;
        let atlas = Atlas::new(gpu, sizes)?;
        gpu.check()?;
        let meshes = GpuMeshes::new(gpu, sizes.patch_log2)?;
        let buffers = Buffers::new(gpu, sizes, meshes.counts.len() as u32)?;
        gpu.check()?;
        let pipelines = Pipelines::new(gpu, &meshes, format);
        let bound = pipelines.bind(gpu, &atlas, &buffers, &meshes);
        gpu.check()?;
        let pending = Pending::default();
        Ok(Self {
            sizes,
            format,
            atlas,
            meshes,
            buffers,
            pipelines,
            bound,
            depth: None,
            pending,
            last: (0, 0),
        })
    }

    /// Returns the sizes that it was made for.
    pub fn sizes(&self) -> Sizes {
        self.sizes
    }

    /// Returns the bytes of graphics memory that it has allocated, the depth buffer of the last
    /// frame included.
    pub fn bytes(&self) -> u64 {
        let depth = self.depth.as_ref().map_or(0, |&(_, (w, h))| u64::from(w) * u64::from(h) * 4);
        self.atlas.bytes() + self.meshes.bytes() + self.buffers.bytes() + depth
    }

    /// Puts a tile in a slot.
    pub fn upload_tile(&mut self, gpu: &Gpu, slot: u32, tile: &TileData) -> Result<()> {
        self.atlas.upload_tile(gpu, slot, tile)?;
        gpu.check()
    }

    /// Puts an image in a slot.
    pub fn upload_image(&mut self, gpu: &Gpu, slot: u32, image: &Texels) -> Result<()> {
        self.atlas.upload_image(gpu, slot, image)?;
        gpu.check()
    }

    /// Draws a frame of `size` pixels on `target`; does not wait for it.
    pub fn render(
        &mut self,
        gpu: &Gpu,
        input: &FrameInput<'_>,
        target: &wgpu::TextureView,
        size: (u32, u32),
    ) -> Result<()> {
        gpu.check()?;
        let buckets = self.meshes.counts.len() as u32;
        let packed = Packed::new(input, &self.atlas, self.sizes, self.format.is_srgb(), buckets)?;
        if self.buffers.fit(gpu, &packed)? {
            self.bound = self.pipelines.bind(gpu, &self.atlas, &self.buffers, &self.meshes);
        }
        let depth = self.depth(gpu, size)?;
        self.write(gpu, &packed);
        let mut encoder =
            gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("frame") });
        encoder.clear_buffer(&self.buffers.buckets, 0, None);
        if packed.levels.is_none() {
            encoder.clear_buffer(&self.buffers.edges, 0, None);
        }
        self.choose(&mut encoder, input, &packed);
        self.draw(&mut encoder, input, target, &depth);
        let copied = self.pending.idle();
        if copied {
            let bytes = u64::from(buckets) * ARGUMENTS;
            encoder.copy_buffer_to_buffer(&self.buffers.arguments, 0, &self.buffers.staging, 0, bytes);
        }
        gpu.queue.submit([encoder.finish()]);
        if copied {
            self.pending.ask(&self.buffers.staging);
        }
        // A lost device tells so when it is polled.
        gpu.poll(false)
    }

    fn depth(&mut self, gpu: &Gpu, size: (u32, u32)) -> Result<wgpu::TextureView> {
        if let Some((view, of)) = &self.depth
            && *of == size
        {
            return Ok(view.clone());
        }
        super::target::check(gpu, size)?;
        // The old one is free before the new one is there.
        self.depth = None;
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("depth"),
            size: wgpu::Extent3d { width: size.0, height: size.1, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: DEPTH,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        self.depth = Some((view.clone(), size));
        Ok(view)
    }

    fn write(&mut self, gpu: &Gpu, packed: &Packed) {
        let parts = packed.tiles.len() as u32 * self.sizes.patches().pow(2);
        let edges =
            packed.tiles.len() as u32 * relevo_core::select::neighbours::edges_of_tile(self.sizes.patches());
        self.last = (parts, edges);
        let put = |buffer, at: u32, bytes: &[u8]| {
            if !bytes.is_empty() {
                gpu.queue.write_buffer(buffer, u64::from(at) * 4, bytes);
            }
        };
        put(&self.buffers.frame, 0, bytemuck::bytes_of(&packed.frame));
        put(&self.buffers.tiles, 0, bytemuck::cast_slice(&packed.tiles));
        put(&self.buffers.draws, 0, bytemuck::cast_slice(&packed.draws));
        if let Some((inner, outer)) = &packed.levels {
            put(&self.buffers.steps, 0, bytemuck::cast_slice(inner));
            put(&self.buffers.edges, edges, bytemuck::cast_slice(outer));
        }
    }

    /// Encodes the compute pass: steps of all patches, and the arguments of the draws.
    fn choose(&self, encoder: &mut wgpu::CommandEncoder, input: &FrameInput<'_>, packed: &Packed) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_bind_group(0, &self.bound.compute, &[]);
        let parts = self.last.0;
        let all = &self.pipelines;
        if parts > 0 {
            if packed.levels.is_none() {
                dispatch(&mut pass, &all.base, parts);
            }
            if packed.levels.is_none() && input.rule == EdgeRule::Shared {
                (0..input.selection.rounds).for_each(|_| dispatch(&mut pass, &all.coarsen, parts));
                dispatch(&mut pass, &all.join, parts);
                (0..input.selection.rounds).for_each(|_| dispatch(&mut pass, &all.balance, parts));
            }
            dispatch(&mut pass, &all.finish, parts);
        }
        let drawn = packed.draws.len() as u32 * self.sizes.patches().pow(2);
        if drawn > 0 {
            dispatch(&mut pass, &all.count, drawn);
        }
        pass.set_pipeline(&all.layout_buckets);
        pass.dispatch_workgroups(1, 1, 1);
        if drawn > 0 {
            dispatch(&mut pass, &all.scatter, drawn);
        }
    }

    fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        input: &FrameInput<'_>,
        target: &wgpu::TextureView,
        depth: &wgpu::TextureView,
    ) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("terrain"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(clear(input.look.clear, self.format.is_srgb())),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        if input.draws.is_empty() {
            return;
        }
        pass.set_bind_group(0, &self.bound.terrain, &[]);
        pass.set_pipeline(self.pipelines.triangles(input.look.paint));
        pass.set_index_buffer(self.meshes.triangles.slice(..), wgpu::IndexFormat::Uint16);
        self.buckets(&mut pass, input.rule, 0);
        if input.look.wireframe {
            pass.set_pipeline(&self.pipelines.lines);
            pass.set_index_buffer(self.meshes.lines.slice(..), wgpu::IndexFormat::Uint16);
            self.buckets(&mut pass, input.rule, self.meshes.counts.len() as u64);
        }
    }

    /// Encodes an indirect draw for each bucket that the rule can fill; `first` is the number of
    /// the first arguments.
    fn buckets(&self, pass: &mut wgpu::RenderPass<'_>, rule: EdgeRule, first: u64) {
        let p = u32::from(self.sizes.patch_log2);
        let (strips, zips) = (2 * p + 3, 2 * p + 3 + 5 * (p + 1));
        for (bucket, &triangles) in (0_u32..).zip(&self.meshes.counts) {
            let of_rule = bucket < strips || (bucket >= zips) == (rule == EdgeRule::Paper);
            if triangles > 0 && of_rule {
                pass.set_bind_group(1, &self.pipelines.bucket, &[bucket * STRIDE as u32]);
                pass.draw_indexed_indirect(&self.buffers.arguments, (first + u64::from(bucket)) * ARGUMENTS);
            }
        }
    }

    /// Returns the counts of the last frame; waits for it.
    pub fn drawn(&self, gpu: &Gpu) -> Result<Drawn> {
        let bytes = self.meshes.counts.len() as u64 * ARGUMENTS;
        let arguments = gpu.copy(&self.buffers.arguments, 0, bytes)?;
        Ok(counted(&arguments, &self.meshes.counts, self.sizes.patch_log2))
    }

    /// Returns the counts of the latest frame that is known to be finished; does not wait.
    pub fn latest(&mut self, gpu: &Gpu) -> Result<Drawn> {
        gpu.poll(false)?;
        let (counts, p) = (&self.meshes.counts, self.sizes.patch_log2);
        Ok(self.pending.take(&self.buffers.staging, |bytes| counted(bytes, counts, p)))
    }

    /// Returns the levels that the last frame was drawn with; waits for it.
    pub fn levels(&self, gpu: &Gpu) -> Result<Levels> {
        let (parts, edges) = self.last;
        let words = |bytes: Vec<u8>| bytemuck::pod_collect_to_vec::<u8, u32>(&bytes);
        let inner = words(gpu.copy(&self.buffers.steps, 0, u64::from(parts) * 4)?);
        let outer = words(gpu.copy(&self.buffers.edges, u64::from(edges) * 4, u64::from(edges) * 4)?);
        Ok(Levels {
            inner: inner.iter().map(|word| (word & 255) as u8).collect(),
            edges: outer.iter().map(|word| (255 - word.min(&255)) as u8).collect(),
        })
    }
}

/// Returns a linear colour as the target stores it.
fn clear([r, g, b]: [f64; 3], srgb: bool) -> wgpu::Color {
    let coded = |c: f64| {
        let c = c.clamp(0.0, 1.0);
        if srgb {
            c
        } else if c <= 0.003_130_8 {
            12.92 * c
        } else {
            1.055 * c.powf(1.0 / 2.4) - 0.055
        }
    };
    wgpu::Color { r: coded(r), g: coded(g), b: coded(b), a: 1.0 }
}
