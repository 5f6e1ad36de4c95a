//! Shaders, their bind groups, and the pipelines that run them.

use wgpu::{BindGroupLayoutEntry, BindingType, BufferBindingType, ShaderStages};

use super::Paint;
use super::atlas::Atlas;
use super::buffers::Buffers;
use super::device::Gpu;
use super::meshes::GpuMeshes;

const COMPUTE: &str = concat!(
    include_str!("shaders/common.wgsl"),
    include_str!("shaders/compute.wgsl"),
    include_str!("shaders/levels.wgsl"),
    include_str!("shaders/sort.wgsl")
);
const TERRAIN: &str = concat!(include_str!("shaders/common.wgsl"), include_str!("shaders/terrain.wgsl"));

/// Format of the depth buffer.
pub(crate) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// All pipelines.
#[derive(Debug)]
pub(crate) struct Pipelines {
    compute_layout: wgpu::BindGroupLayout,
    terrain_layout: wgpu::BindGroupLayout,
    pub base: wgpu::ComputePipeline,
    pub coarsen: wgpu::ComputePipeline,
    pub join: wgpu::ComputePipeline,
    pub balance: wgpu::ComputePipeline,
    pub finish: wgpu::ComputePipeline,
    pub count: wgpu::ComputePipeline,
    pub layout_buckets: wgpu::ComputePipeline,
    pub scatter: wgpu::ComputePipeline,
    surface: wgpu::RenderPipeline,
    counted: wgpu::RenderPipeline,
    pub lines: wgpu::RenderPipeline,
    /// Group 1: the number of a bucket.
    pub bucket: wgpu::BindGroup,
    sampler: wgpu::Sampler,
}

/// The bind groups of the passes of a frame.
#[derive(Debug)]
pub(crate) struct Bound {
    pub compute: wgpu::BindGroup,
    pub terrain: wgpu::BindGroup,
}

fn entry(binding: u32, visibility: ShaderStages, ty: BindingType) -> BindGroupLayoutEntry {
    BindGroupLayoutEntry { binding, visibility, ty, count: None }
}

fn buffer(ty: BufferBindingType, has_dynamic_offset: bool) -> BindingType {
    BindingType::Buffer { ty, has_dynamic_offset, min_binding_size: None }
}

fn texture(sample_type: wgpu::TextureSampleType) -> BindingType {
    BindingType::Texture {
        sample_type,
        view_dimension: wgpu::TextureViewDimension::D2Array,
        multisampled: false,
    }
}

fn layout(gpu: &Gpu, entries: &[BindGroupLayoutEntry]) -> wgpu::BindGroupLayout {
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries })
}

fn group(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    resources: Vec<wgpu::BindingResource<'_>>,
) -> wgpu::BindGroup {
    let entries: Vec<_> = resources
        .into_iter()
        .enumerate()
        .map(|(i, resource)| wgpu::BindGroupEntry { binding: i as u32, resource })
        .collect();
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}

fn whole<'a>(buffers: &[&'a wgpu::Buffer]) -> Vec<wgpu::BindingResource<'a>> {
    buffers.iter().map(|buffer| buffer.as_entire_binding()).collect()
}

fn pipeline_layout(gpu: &Gpu, groups: &[Option<&wgpu::BindGroupLayout>]) -> wgpu::PipelineLayout {
    let descriptor =
        wgpu::PipelineLayoutDescriptor { label: None, bind_group_layouts: groups, immediate_size: 0 };
    gpu.device.create_pipeline_layout(&descriptor)
}

fn shader(gpu: &Gpu, label: &str, source: &str) -> wgpu::ShaderModule {
    gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    })
}

fn compute_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    let uniform = buffer(BufferBindingType::Uniform, false);
    let read = buffer(BufferBindingType::Storage { read_only: true }, false);
    let write = buffer(BufferBindingType::Storage { read_only: false }, false);
    let all = [uniform, uniform, read, read, read, write, write, write, write, write];
    let entries: Vec<_> =
        all.into_iter().enumerate().map(|(i, ty)| entry(i as u32, ShaderStages::COMPUTE, ty)).collect();
    layout(gpu, &entries)
}

fn terrain_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    let read = buffer(BufferBindingType::Storage { read_only: true }, false);
    let all = [
        buffer(BufferBindingType::Uniform, false),
        read,
        read,
        read,
        read,
        read,
        texture(wgpu::TextureSampleType::Float { filterable: false }),
        texture(wgpu::TextureSampleType::Uint),
        texture(wgpu::TextureSampleType::Float { filterable: true }),
        BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
    ];
    let entries: Vec<_> = all
        .into_iter()
        .enumerate()
        .map(|(i, ty)| entry(i as u32, ShaderStages::VERTEX_FRAGMENT, ty))
        .collect();
    layout(gpu, &entries)
}

/// Shaders and fixed state of a render pipeline.
struct Kind {
    vertex: &'static str,
    fragment: &'static str,
    topology: wgpu::PrimitiveTopology,
    blend: Option<wgpu::BlendState>,
    depth_write: bool,
    depth_compare: wgpu::CompareFunction,
}

const SURFACE: Kind = Kind {
    vertex: "surface_vertex",
    fragment: "surface",
    topology: wgpu::PrimitiveTopology::TriangleList,
    blend: None,
    depth_write: true,
    depth_compare: wgpu::CompareFunction::GreaterEqual,
};

const LINES: Kind = Kind {
    vertex: "line_vertex",
    fragment: "line",
    topology: wgpu::PrimitiveTopology::LineList,
    blend: Some(wgpu::BlendState::ALPHA_BLENDING),
    depth_write: false,
    depth_compare: wgpu::CompareFunction::GreaterEqual,
};

const ADD: wgpu::BlendComponent = wgpu::BlendComponent {
    src_factor: wgpu::BlendFactor::One,
    dst_factor: wgpu::BlendFactor::One,
    operation: wgpu::BlendOperation::Add,
};

const COUNTED: Kind = Kind {
    vertex: "surface_vertex",
    fragment: "counted",
    topology: wgpu::PrimitiveTopology::TriangleList,
    blend: Some(wgpu::BlendState { color: ADD, alpha: ADD }),
    depth_write: false,
    depth_compare: wgpu::CompareFunction::Always,
};

fn render(
    gpu: &Gpu,
    layout: &wgpu::PipelineLayout,
    module: &wgpu::ShaderModule,
    format: wgpu::TextureFormat,
    kind: &Kind,
) -> wgpu::RenderPipeline {
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(kind.fragment),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(kind.vertex),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState {
            topology: kind.topology,
            // Triangles run clockwise seen from above; from below nothing is seen.
            front_face: wgpu::FrontFace::Cw,
            cull_mode: Some(wgpu::Face::Back),
            ..Default::default()
        },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(kind.depth_write),
            depth_compare: Some(kind.depth_compare),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(kind.fragment),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(wgpu::ColorTargetState {
                format,
                blend: kind.blend,
                write_mask: wgpu::ColorWrites::ALL,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}

fn bucket_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    layout(gpu, &[entry(0, ShaderStages::VERTEX, buffer(BufferBindingType::Uniform, true))])
}

fn bucket_group(gpu: &Gpu, layout: &wgpu::BindGroupLayout, meshes: &GpuMeshes) -> wgpu::BindGroup {
    let number =
        wgpu::BufferBinding { buffer: &meshes.numbers, offset: 0, size: std::num::NonZeroU64::new(16) };
    group(gpu, layout, vec![wgpu::BindingResource::Buffer(number)])
}

impl Pipelines {
    pub fn new(gpu: &Gpu, meshes: &GpuMeshes, format: wgpu::TextureFormat) -> Self {
        let (compute_layout, terrain_layout) = (compute_layout(gpu), terrain_layout(gpu));
        let module = shader(gpu, "levels", COMPUTE);
        let layout = pipeline_layout(gpu, &[Some(&compute_layout)]);
        let compute = |name: &str| {
            gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(name),
                layout: Some(&layout),
                module: &module,
                entry_point: Some(name),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        };
        let terrain = shader(gpu, "terrain", TERRAIN);
        let bucket_layout = bucket_layout(gpu);
        let drawn = pipeline_layout(gpu, &[Some(&terrain_layout), Some(&bucket_layout)]);
        Self {
            base: compute("base"),
            coarsen: compute("coarsen"),
            join: compute("join"),
            balance: compute("balance"),
            finish: compute("finish"),
            count: compute("count"),
            layout_buckets: compute("layout_buckets"),
            scatter: compute("scatter"),
            surface: render(gpu, &drawn, &terrain, format, &SURFACE),
            counted: render(gpu, &drawn, &terrain, format, &COUNTED),
            lines: render(gpu, &drawn, &terrain, format, &LINES),
            bucket: bucket_group(gpu, &bucket_layout, meshes),
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
            compute_layout,
            terrain_layout,
        }
    }

    /// Returns the pipeline that draws triangles.
    pub fn triangles(&self, paint: Paint) -> &wgpu::RenderPipeline {
        if paint == Paint::Count { &self.counted } else { &self.surface }
    }

    pub fn bind(&self, gpu: &Gpu, atlas: &Atlas, buffers: &Buffers, meshes: &GpuMeshes) -> Bound {
        let b = buffers;
        let compute = whole(&[
            &b.frame,
            &meshes.table,
            &b.tiles,
            &atlas.tables,
            &b.draws,
            &b.steps,
            &b.edges,
            &b.buckets,
            &b.instances,
            &b.arguments,
        ]);
        let mut drawn = whole(&[&b.frame, &b.tiles, &b.draws, &b.steps, &b.buckets, &b.instances]);
        let views = atlas.views();
        drawn.extend(views.iter().map(wgpu::BindingResource::TextureView));
        drawn.push(wgpu::BindingResource::Sampler(&self.sampler));
        Bound {
            compute: group(gpu, &self.compute_layout, compute),
            terrain: group(gpu, &self.terrain_layout, drawn),
        }
    }
}
