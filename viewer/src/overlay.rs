//! Text over the picture: letters of [`crate::font`] as rectangles, on a dark panel.

use relevo_core::Result;

use crate::font;
use crate::gpu::Gpu;

/// Place (x, y, width, height in pixels) and colour of a rectangle.
type Rectangle = [f32; 8];

const PANEL: [f32; 4] = [0.0, 0.0, 0.0, 0.6];
const INK: [f32; 4] = [1.0, 1.0, 1.0, 1.0];
/// Letter pixels around a text, and from a line to the next.
const MARGIN: u32 = 4;
const LINE: u32 = font::HEIGHT + 3;
/// From a letter to the next.
const ADVANCE: u32 = font::WIDTH + 1;

/// A block of text in the upper left or the lower left corner.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Text {
    /// Its lines.
    pub lines: Vec<String>,
    /// In the lower corner.
    pub bottom: bool,
}

/// Draws text on a target.
#[derive(Debug)]
pub struct Overlay {
    pipeline: wgpu::RenderPipeline,
    screen: wgpu::Buffer,
    group: wgpu::BindGroup,
    buffer: wgpu::Buffer,
    count: u32,
    /// What the buffer holds.
    drawn: Option<(Vec<Text>, (u32, u32))>,
}

impl Overlay {
    /// For targets of a format.
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Result<Self> {
        let device = &gpu.device;
        let module = device.create_shader_module(wgpu::include_wgsl!("overlay.wgsl"));
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("overlay"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vs"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[Some(wgpu::VertexBufferLayout {
                    array_stride: size_of::<Rectangle>() as u64,
                    step_mode: wgpu::VertexStepMode::Instance,
                    attributes: &wgpu::vertex_attr_array![0 => Float32x4, 1 => Float32x4],
                })],
            },
            primitive: wgpu::PrimitiveState {
                topology: wgpu::PrimitiveTopology::TriangleStrip,
                ..Default::default()
            },
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("fs"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(wgpu::ColorTargetState {
                    format,
                    blend: Some(wgpu::BlendState::ALPHA_BLENDING),
                    write_mask: wgpu::ColorWrites::ALL,
                })],
            }),
            multiview_mask: None,
            cache: None,
        });
        let uniform = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let screen = buffer(device, 16, uniform);
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("overlay"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: screen.as_entire_binding() }],
        });
        gpu.check()?;
        Ok(Self {
            pipeline,
            screen,
            group,
            buffer: buffer(device, 1 << 12, RECTANGLES),
            count: 0,
            drawn: None,
        })
    }

    /// Draws texts over what the target shows.
    pub fn draw(&mut self, gpu: &Gpu, texts: &[Text], target: &wgpu::TextureView, size: (u32, u32)) {
        if texts.iter().all(|text| text.lines.is_empty()) {
            return;
        }
        self.fill(gpu, texts, size);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let attachment = wgpu::RenderPassColorAttachment {
            view: target,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
        };
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("overlay"),
                color_attachments: &[Some(attachment)],
                ..Default::default()
            });
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.group, &[]);
            pass.set_vertex_buffer(0, self.buffer.slice(..));
            pass.draw(0..4, 0..self.count);
        }
        gpu.queue.submit([encoder.finish()]);
    }

    fn fill(&mut self, gpu: &Gpu, texts: &[Text], size: (u32, u32)) {
        if self.drawn.as_ref().is_some_and(|(drawn, at)| drawn == texts && *at == size) {
            return;
        }
        let rectangles: Vec<Rectangle> = texts.iter().flat_map(|text| lay_out(text, size)).collect();
        let bytes: &[u8] = bytemuck::cast_slice(&rectangles);
        if bytes.len() as u64 > self.buffer.size() {
            self.buffer = buffer(&gpu.device, bytes.len() as u64, RECTANGLES);
        }
        gpu.queue.write_buffer(&self.buffer, 0, bytes);
        let screen = [size.0 as f32, size.1 as f32, 0.0, 0.0];
        gpu.queue.write_buffer(&self.screen, 0, bytemuck::cast_slice(&screen));
        self.count = rectangles.len() as u32;
        self.drawn = Some((texts.to_vec(), size));
    }
}

const RECTANGLES: wgpu::BufferUsages = wgpu::BufferUsages::VERTEX.union(wgpu::BufferUsages::COPY_DST);

fn buffer(device: &wgpu::Device, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let descriptor =
        wgpu::BufferDescriptor { label: Some("overlay"), size, usage, mapped_at_creation: false };
    device.create_buffer(&descriptor)
}

/// The panel, then a rectangle for every run of ink.
fn lay_out(text: &Text, (_, height): (u32, u32)) -> Vec<Rectangle> {
    let scale = (height / 300).clamp(1, 4);
    let columns = text.lines.iter().map(|line| line.chars().count() as u32).max().unwrap_or(0);
    if columns == 0 {
        return Vec::new();
    }
    let rows = text.lines.len() as u32;
    let panel = [columns * ADVANCE + 2 * MARGIN, rows * LINE + 2 * MARGIN].map(|side| side * scale);
    let top = if text.bottom { height.saturating_sub(panel[1]) } else { 0 };
    let mut out = vec![rectangle([0, top, panel[0], panel[1]], PANEL)];
    for (row, line) in (0..).zip(&text.lines) {
        for (column, letter) in (0..).zip(line.chars()) {
            for (y, bits) in (0..).zip(font::glyph(letter)) {
                for (x, length) in runs(bits) {
                    let left = (MARGIN + column * ADVANCE + x) * scale;
                    let place = [left, top + (MARGIN + row * LINE + y) * scale, length * scale, scale];
                    out.push(rectangle(place, INK));
                }
            }
        }
    }
    out
}

/// First pixel and length of each run of set pixels in a row of a letter.
fn runs(bits: u8) -> Vec<(u32, u32)> {
    let set = |x: u32| x < font::WIDTH && bits >> (font::WIDTH - 1 - x) & 1 != 0;
    let starts = (0..font::WIDTH).filter(|&x| set(x) && !(x > 0 && set(x - 1)));
    starts.map(|x| (x, (x..font::WIDTH).take_while(|&x| set(x)).count() as u32)).collect()
}

fn rectangle(place: [u32; 4], colour: [f32; 4]) -> Rectangle {
    let [x, y, width, height] = place.map(|side| side as f32);
    let [r, g, b, a] = colour;
    [x, y, width, height, r, g, b, a]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_stays_on_its_panel_and_inks_what_its_letters_have() {
        assert_eq!(runs(0b10110), [(0, 1), (2, 2)]);
        assert_eq!((runs(0), runs(0b11111)), (vec![], vec![(0, 5)]));
        for bottom in [false, true] {
            let text = Text { lines: vec!["Hi".into(), "there".into()], bottom };
            let rectangles = lay_out(&text, (640, 360));
            let [x, y, width, height, ..] = rectangles[0];
            assert!(
                rectangles
                    .iter()
                    .all(|r| r[0] >= x && r[1] >= y && r[0] + r[2] <= width && r[1] + r[3] <= y + height)
            );
            let ink: f32 = rectangles[1..].iter().map(|r| r[2] * r[3]).sum();
            let bits: u32 = "Hithere".chars().flat_map(font::glyph).map(u8::count_ones).sum();
            assert_eq!(ink, bits as f32);
            assert_eq!(y == 0.0, !bottom);
        }
        assert!(lay_out(&Text::default(), (640, 360)).is_empty());
    }
}
