//! The buffers of one frame: the selection, and the results of the passes.

use relevo_core::Result;
use relevo_core::select::neighbours::edges_of_tile;
use wgpu::BufferUsages;

use super::device::Gpu;
use super::input::{DRAW_BYTES, GpuFrame, Packed, TILE_BYTES};
use super::meshes::ARGUMENTS;
use super::sizes::Sizes;

/// The buffers of a frame. Each is as large as the largest frame so far needed.
#[derive(Debug)]
pub(crate) struct Buffers {
    pub frame: wgpu::Buffer,
    pub tiles: wgpu::Buffer,
    pub draws: wgpu::Buffer,
    /// Two words for each patch of each tile.
    pub steps: wgpu::Buffer,
    /// Two words for each edge number.
    pub edges: wgpu::Buffer,
    /// Three words for each bucket.
    pub buckets: wgpu::Buffer,
    pub instances: wgpu::Buffer,
    pub arguments: wgpu::Buffer,
    /// Copy of the arguments that is read back.
    pub staging: wgpu::Buffer,
}

/// Bytes of the instances of a patch: at most five of 8 bytes.
const INSTANCES: u64 = 5 * 8;
const STORAGE: BufferUsages = BufferUsages::STORAGE.union(BufferUsages::COPY_DST);

impl Buffers {
    /// Returns buffers for all tiles of a renderer at once, each drawn once.
    pub fn new(gpu: &Gpu, sizes: Sizes, buckets: u32) -> Result<Self> {
        let (m, tiles, b) = (sizes.patches(), u64::from(sizes.tiles), u64::from(buckets));
        let parts = tiles * u64::from(m * m);
        let back = BufferUsages::COPY_SRC;
        Ok(Self {
            frame: gpu.buffer(
                "frame",
                size_of::<GpuFrame>() as u64,
                BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            )?,
            tiles: gpu.buffer("tiles", tiles * TILE_BYTES, STORAGE)?,
            draws: gpu.buffer("draws", 2 * tiles * DRAW_BYTES, STORAGE)?,
            steps: gpu.buffer("steps", parts * 8, STORAGE | back)?,
            edges: gpu.buffer("edges", tiles * u64::from(edges_of_tile(m)) * 8, STORAGE | back)?,
            buckets: gpu.buffer("counters", b * 12, STORAGE)?,
            instances: gpu.buffer("instances", parts * INSTANCES, STORAGE)?,
            arguments: gpu.buffer(
                "draw arguments",
                2 * b * ARGUMENTS,
                STORAGE | back | BufferUsages::INDIRECT,
            )?,
            staging: gpu.buffer("counts", b * ARGUMENTS, BufferUsages::MAP_READ | BufferUsages::COPY_DST)?,
        })
    }

    /// Grows the buffers for a frame with more draws; returns true if one has grown.
    pub fn fit(&mut self, gpu: &Gpu, packed: &Packed) -> Result<bool> {
        let mut grown = false;
        for (buffer, label, need) in [
            (&mut self.draws, "draws", packed.draws.len() as u64 * DRAW_BYTES),
            (&mut self.instances, "instances", packed.parts * INSTANCES),
        ] {
            if need > buffer.size() {
                *buffer = gpu
                    .buffer(label, need + need / 4, STORAGE)
                    .or_else(|_| gpu.buffer(label, need, STORAGE))?;
                grown = true;
            }
        }
        Ok(grown)
    }

    pub fn bytes(&self) -> u64 {
        let all = [&self.frame, &self.tiles, &self.draws, &self.steps, &self.edges, &self.buckets];
        let rest = [&self.instances, &self.arguments, &self.staging];
        all.iter().chain(&rest).map(|buffer| buffer.size()).sum()
    }
}
