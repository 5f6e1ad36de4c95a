//! A panel over the picture, with the feature `ui`: what the keys do, for the mouse.

use std::time::Duration;

use egui::{Align2, Checkbox, Context, Grid, Order, Slider, SliderClamping, Ui, ViewportId};
use egui_wgpu::{Renderer, RendererOptions, ScreenDescriptor};
use relevo_core::Result;
use winit::dpi::PhysicalPosition;
use winit::event::{ElementState, WindowEvent};
use winit::keyboard::{Key, NamedKey};
use winit::window::Window;

use crate::camera::Mode;
use crate::canvas::Canvas;
use crate::gpu::{Gpu, Look};
use crate::input::Command;
use crate::metrics::Figures;
use crate::stage::PAINTS;

/// Pixels and factors of the sliders.
const RANGE: std::ops::RangeInclusive<f64> = 0.1..=20.0;
/// Width of the panel, and its distance from the window's sides, in points.
const WIDTH: f32 = 210.0;
const MARGIN: f32 = 6.0;
/// Height of its title and its border, in points.
const TITLE: f32 = 50.0;
/// A frame that the panel wants within this time is drawn even while the picture rests.
const SOON: Duration = Duration::from_millis(100);

/// What the panel shows.
#[derive(Clone, Copy, Debug)]
pub struct State<'a> {
    /// The file's name.
    pub name: &'a str,
    /// As asked, pixels.
    pub tolerance: f64,
    /// Factor of heights.
    pub exaggeration: f64,
    /// Colours and lines.
    pub look: Look,
    /// The selection stays whatever the camera does.
    pub frozen: bool,
    /// How the camera moves.
    pub mode: Mode,
    /// The help is shown.
    pub help: bool,
    /// Of the last frames.
    pub figures: Figures,
}

/// What was asked for in the panel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// This tolerance, pixels.
    Tolerance(f64),
    /// This factor of heights.
    Exaggeration(f64),
    /// What a key stands for.
    Obey(Command),
}

/// The panel of a window.
pub struct Panel {
    context: Context,
    events: egui_winit::State,
    renderer: Renderer,
    open: bool,
    /// It may look otherwise than it was drawn.
    stale: bool,
    /// The mouse, in pixels, and whether it is over the panel.
    pointer: Option<PhysicalPosition<f64>>,
    over: bool,
}

impl Panel {
    /// Open, for targets of a format.
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat, window: &Window) -> Result<Self> {
        let context = Context::default();
        context.set_theme(egui::Theme::Dark);
        // Plus and minus are the tolerance.
        context.options_mut(|options| options.zoom_with_keyboard = false);
        let side = gpu.device.limits().max_texture_dimension_2d as usize;
        let scale = Some(window.scale_factor() as f32);
        let events =
            egui_winit::State::new(context.clone(), ViewportId::ROOT, window, scale, None, Some(side));
        let renderer = Renderer::new(&gpu.device, format, RendererOptions::default());
        gpu.check()?;
        Ok(Self { context, events, renderer, open: true, stale: true, pointer: None, over: false })
    }

    /// Open or closed.
    pub fn toggle(&mut self) {
        self.open = !self.open;
        self.stale = true;
    }

    /// True while it wants to be drawn again.
    pub fn busy(&self) -> bool {
        self.stale
    }

    /// Hears of an event; true if it is for the panel alone.
    ///
    /// The end of a key or a button is for all: what was begun over the picture may end over the panel.
    pub fn takes(&mut self, window: &Window, event: &WindowEvent) -> bool {
        match event {
            WindowEvent::RedrawRequested => return false,
            // Opens and closes the panel; it does not walk through the controls.
            WindowEvent::KeyboardInput { event, .. } if event.logical_key == Key::Named(NamedKey::Tab) => {
                return false;
            }
            WindowEvent::CursorMoved { position, .. } => self.pointer = Some(*position),
            WindowEvent::CursorLeft { .. } => self.pointer = None,
            _ => {}
        }
        let typing = self.context.egui_wants_keyboard_input();
        let taken = self.events.on_window_event(window, event).consumed;
        let (before, pulled) = (self.over, self.context.egui_is_using_pointer());
        self.over = self.is_over(window);
        let touched = before || self.over || pulled;
        match event {
            WindowEvent::CursorMoved { .. } | WindowEvent::CursorLeft { .. } => {
                self.stale |= touched;
                false
            }
            WindowEvent::MouseInput { state, .. } => {
                // A click beside it ends what is typed in it.
                self.stale |= touched || typing;
                touched && *state == ElementState::Pressed
            }
            WindowEvent::MouseWheel { .. } => {
                self.stale |= touched;
                touched
            }
            WindowEvent::KeyboardInput { event, .. } => {
                self.stale |= typing;
                taken && event.state == ElementState::Pressed
            }
            _ => false,
        }
    }

    /// Whether the mouse is over it now: egui itself knows where it was in the last frame.
    fn is_over(&self, window: &Window) -> bool {
        let scale = egui_winit::pixels_per_point(&self.context, window);
        let at = self.pointer.map(|at| egui::pos2(at.x as f32 / scale, at.y as f32 / scale));
        let layer = at.and_then(|at| self.context.layer_id_at(at));
        layer.is_some_and(|layer| layer.order != Order::Background)
    }

    /// Draws it over what the target shows; what was asked for in it.
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        canvas: &Canvas,
        state: &State<'_>,
        target: &wgpu::TextureView,
    ) -> Result<Vec<Change>> {
        let input = self.events.take_egui_input(canvas.window());
        let mut changes = Vec::new();
        let output = self.context.run_ui(input, |ui| {
            if self.open {
                changes.extend(show(ui.ctx(), state));
            }
        });
        let soon = output.viewport_output.values().any(|viewport| viewport.repaint_delay < SOON);
        self.stale = soon || !changes.is_empty();
        self.events.handle_platform_output(canvas.window(), output.platform_output);
        // All of them, in any case: the next frame does not tell of them again.
        let mut textures = output.textures_delta;
        for (id, deltas) in textures.set.drain() {
            for delta in &deltas {
                self.renderer.update_texture(&gpu.device, &gpu.queue, id, delta);
            }
        }
        let (width, height) = canvas.size();
        let screen =
            ScreenDescriptor { size_in_pixels: [width, height], pixels_per_point: output.pixels_per_point };
        let meshes = self.context.tessellate(output.shapes, output.pixels_per_point);
        if !meshes.is_empty() {
            self.paint(gpu, &meshes, &screen, target);
        }
        textures.free.drain().for_each(|id| self.renderer.free_texture(&id));
        gpu.check()?;
        Ok(changes)
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

/// The panel in the upper right corner; it scrolls if the window is too low for it.
fn show(context: &Context, state: &State<'_>) -> Vec<Change> {
    let window = egui::Window::new("Relevo").anchor(Align2::RIGHT_TOP, [-MARGIN, MARGIN]).auto_sized();
    let room = (context.viewport_rect().height() - TITLE - 2.0 * MARGIN).max(1.0);
    let shown = window.show(context, |ui| {
        let mut changes = Vec::new();
        ui.set_width(WIDTH);
        // As high as its contents if there is room; otherwise egui keeps the height that a lower window once had.
        let scroll = egui::ScrollArea::vertical().max_height(room).min_scrolled_height(room);
        scroll.show(ui, |ui| {
            ui.add(egui::Label::new(egui::RichText::new(state.name).strong()).truncate());
            numbers(ui, state, &mut changes);
            ui.separator();
            switches(ui, state, &mut changes);
            ui.separator();
            figures(ui, &state.figures);
        });
        changes
    });
    shown.and_then(|shown| shown.inner).unwrap_or_default()
}

fn numbers(ui: &mut Ui, state: &State<'_>, changes: &mut Vec<Change>) {
    let mut number = |name: &str, unit: &str, now: f64, change: fn(f64) -> Change| {
        let mut value = now;
        ui.label(name);
        // What the keys have set beyond the range stays until it is pulled.
        let slider = Slider::new(&mut value, RANGE)
            .logarithmic(true)
            .clamping(SliderClamping::Edits)
            .max_decimals(2)
            .suffix(unit);
        if ui.add(slider).changed() && value.is_finite() {
            changes.push(change(value));
        }
    };
    number("Tolerance", " px", state.tolerance, Change::Tolerance);
    number("Exaggeration", "", state.exaggeration, Change::Exaggeration);
}

fn switches(ui: &mut Ui, state: &State<'_>, changes: &mut Vec<Change>) {
    ui.label("Colours");
    ui.horizontal_wrapped(|ui| {
        for (name, paint) in PAINTS {
            if ui.radio(state.look.paint == paint, name).clicked() && state.look.paint != paint {
                changes.push(Change::Obey(Command::Paint(paint)));
            }
        }
    });
    ui.label("Camera");
    ui.horizontal(|ui| {
        for (name, mode) in [("fly", Mode::Fly), ("orbit", Mode::Orbit)] {
            if ui.radio(state.mode == mode, name).clicked() && state.mode != mode {
                changes.push(Change::Obey(Command::Mode));
            }
        }
    });
    let switches = [
        ("Wireframe", state.look.wireframe, Command::Wireframe),
        ("Borders of tiles", state.look.borders, Command::Borders),
        ("Freeze the selection", state.frozen, Command::Freeze),
        ("Help", state.help, Command::Help),
    ];
    for (name, mut on, command) in switches {
        if ui.add(Checkbox::new(&mut on, name)).changed() {
            changes.push(Change::Obey(command));
        }
    }
    if ui.button("Picture to a file").clicked() {
        changes.push(Change::Obey(Command::Screenshot));
    }
}

fn figures(ui: &mut Ui, figures: &Figures) {
    let rows = [
        ("Frames a second", format!("{:.0}", figures.fps)),
        ("Tiles", figures.tiles.to_string()),
        ("Patches", figures.patches.to_string()),
        ("Triangles", figures.triangles.to_string()),
        ("Memory", format!("{:.0} MB", figures.megabytes)),
        ("Promised error", format!("{:.2} of {:.2} px", figures.promised, figures.tolerance)),
        ("Still to load", figures.pending.to_string()),
    ];
    Grid::new("figures").num_columns(2).show(ui, |ui| {
        for (name, value) in rows {
            ui.label(name);
            ui.monospace(value);
            ui.end_row();
        }
    });
}
