//! The index meshes of patches on the device: triangles and the lines between them.

use std::collections::BTreeSet;

use relevo_core::Result;
use relevo_core::select::pattern::Meshes;
use wgpu::BufferUsages;

use super::device::Gpu;

/// Bytes of the arguments of an indirect draw.
pub(crate) const ARGUMENTS: u64 = 20;
/// Bytes from one dynamic offset to the next: an alignment that every device supports.
pub(crate) const STRIDE: u64 = 256;
/// Buckets of the largest patches: the length of an array in a shader.
const MOST_BUCKETS: usize = 99;

/// Index buffers, and where each bucket is in them.
#[derive(Debug)]
pub(crate) struct GpuMeshes {
    /// Triangles.
    pub triangles: wgpu::Buffer,
    /// Edges of the triangles.
    pub lines: wgpu::Buffer,
    /// By bucket: first index and count of the triangles, of the lines.
    pub table: wgpu::Buffer,
    /// The number of each bucket, [`STRIDE`] bytes apart.
    pub numbers: wgpu::Buffer,
    /// Triangles of each bucket.
    pub counts: Vec<u32>,
}

/// Returns the lines of all buckets, each edge once, and the table of triangles and lines by
/// bucket.
fn lines(meshes: &Meshes) -> (Vec<u16>, Vec<[u32; 4]>) {
    let mut indices = Vec::new();
    let mut table = Vec::new();
    for mesh in &meshes.buckets {
        let triangles = &meshes.indices[mesh.first as usize..(mesh.first + mesh.count) as usize];
        let edges: BTreeSet<[u16; 2]> = triangles
            .chunks_exact(3)
            .flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]])
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect();
        table.push([mesh.first, mesh.count, indices.len() as u32, 2 * edges.len() as u32]);
        indices.extend(edges.into_iter().flatten());
    }
    (indices, table)
}

impl GpuMeshes {
    pub fn new(gpu: &Gpu, patch_log2: u8) -> Result<Self> {
        let meshes = Meshes::new(patch_log2);
        let (mut lines, mut table) = lines(&meshes);
        let mut triangles = meshes.indices;
        // Copies are whole words.
        for indices in [&mut triangles, &mut lines] {
            indices.resize(indices.len().next_multiple_of(8), 0);
        }
        let counts: Vec<u32> = table.iter().map(|mesh| mesh[1] / 3).collect();
        table.resize(MOST_BUCKETS, [0; 4]);
        let numbers: Vec<u32> = (0..counts.len() as u32)
            .flat_map(|b| [b].into_iter().chain([0; STRIDE as usize / 4 - 1]))
            .collect();
        let filled = |label, usage, bytes: &[u8]| {
            let buffer = gpu.buffer(label, bytes.len() as u64, usage | BufferUsages::COPY_DST)?;
            gpu.queue.write_buffer(&buffer, 0, bytes);
            Ok(buffer)
        };
        Ok(Self {
            triangles: filled("triangles", BufferUsages::INDEX, bytemuck::cast_slice(&triangles))?,
            lines: filled("lines", BufferUsages::INDEX, bytemuck::cast_slice(&lines))?,
            table: filled("buckets", BufferUsages::UNIFORM, bytemuck::cast_slice(&table))?,
            numbers: filled("bucket numbers", BufferUsages::UNIFORM, bytemuck::cast_slice(&numbers))?,
            counts,
        })
    }

    pub fn bytes(&self) -> u64 {
        [&self.triangles, &self.lines, &self.table, &self.numbers].iter().map(|buffer| buffer.size()).sum()
    }
}
