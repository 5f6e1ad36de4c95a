//! Draws the output of egui on a target.

use egui::{Context, FullOutput};
use egui_wgpu::{Renderer, RendererOptions, ScreenDescriptor};
use relevo_core::Result;

use crate::gpu::Gpu;

/// Draws the output of egui over what a target shows.
pub(super) struct Painter {
    renderer: Renderer,
}

impl Painter {
    /// A painter for targets of a format.
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Result<Self> {
        let renderer = Renderer::new(&gpu.device, format, RendererOptions::default());
        gpu.check()?;
        Ok(Self { renderer })
    }

    /// Draws an output of `context` on a target of `size` pixels.
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        context: &Context,
        output: FullOutput,
        target: &wgpu::TextureView,
        size: (u32, u32),
    ) -> Result<()> {
        // Uploaded even if nothing is drawn: the next output does not list them again.
        let mut textures = output.textures_delta;
        for (id, deltas) in textures.set.drain() {
            for delta in &deltas {
                self.renderer.update_texture(&gpu.device, &gpu.queue, id, delta);
            }
        }
        let pixels_per_point = output.pixels_per_point;
        let screen = ScreenDescriptor { size_in_pixels: size.into(), pixels_per_point };
        let meshes = context.tessellate(output.shapes, pixels_per_point);
        if !meshes.is_empty() {
            self.paint(gpu, &meshes, &screen, target);
        }
        textures.free.drain().for_each(|id| self.renderer.free_texture(&id));
        gpu.check()
    }

    fn paint(
        &mut self,
        gpu: &Gpu,
        meshes: &[egui::ClippedPrimitive],
        screen: &ScreenDescriptor,
        target: &wgpu::TextureView,
    ) {
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let more = self.renderer.update_buffers(&gpu.device, &gpu.queue, &mut encoder, meshes, screen);
        let attachment = wgpu::RenderPassColorAttachment {
            view: target,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
        };
        {
            let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("panel"),
                color_attachments: &[Some(attachment)],
                ..Default::default()
            });
            self.renderer.render(&mut pass.forget_lifetime(), meshes, screen);
        }
        gpu.queue.submit(more.into_iter().chain([encoder.finish()]));
    }
}

#[cfg(test)]
mod tests {
    use egui::{Area, Color32, Id, RawInput, Rect, pos2, vec2};

    use super::*;
    use crate::gpu::RenderTarget;
    use crate::gpu::target::FORMAT;
    use crate::panel::context;
    use crate::stage::headless_gpu;

    /// The colour of the sky under everything, as the target stores it.
    const SKY: [u8; 3] = [0, 0, 255];

    fn clear(gpu: &Gpu, target: &RenderTarget) {
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let load = wgpu::LoadOp::Clear(wgpu::Color::BLUE);
        let attachment = wgpu::RenderPassColorAttachment {
            view: target.view(),
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
        };
        drop(encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(attachment)],
            ..Default::default()
        }));
        gpu.queue.submit([encoder.finish()]);
    }

    #[test]
    fn what_egui_draws_lies_over_the_picture_and_changes_nothing_beside_it() {
        let gpu = headless_gpu("software").expect("a software adapter");
        let target = RenderTarget::new(&gpu, (64, 48), FORMAT).expect("a target");
        let mut painter = Painter::new(&gpu, FORMAT).expect("a painter");
        let context = context();
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(64.0, 48.0));
        let mut read = |shown: bool| {
            clear(&gpu, &target);
            let input = RawInput { screen_rect: Some(screen), ..RawInput::default() };
            let output = context.run_ui(input, |ui| {
                if shown {
                    Area::new(Id::unique("box")).fixed_pos([8.0, 16.0]).fade_in(false).show(ui.ctx(), |ui| {
                        let (place, _) = ui.allocate_exact_size(vec2(20.0, 24.0), egui::Sense::empty());
                        ui.painter().rect_filled(place, 0.0, Color32::RED);
                    });
                }
            });
            painter.draw(&gpu, &context, output, target.view(), target.size()).expect("drawn");
            target.read(&gpu).expect("its pixels")
        };
        // The first frame of an area finds its size.
        read(true);
        for shown in [true, false] {
            let pixels = read(shown);
            for (index, pixel) in pixels.chunks_exact(4).enumerate() {
                let (x, y) = (index % 64, index / 64);
                let inside = shown && (8..28).contains(&x) && (16..40).contains(&y);
                // The rim may be smooth.
                let rim = shown && (7..29).contains(&x) && (15..41).contains(&y);
                if inside == rim || !shown {
                    let colour = if inside { [255, 0, 0] } else { SKY };
                    assert_eq!(pixel[..3], colour, "{x}, {y}, {shown}");
                }
            }
        }
    }
}
