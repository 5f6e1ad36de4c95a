//! The interface over the picture, drawn with egui: controls and figures, the help of keys,
//! messages.
//!
//! [`Panel`] takes the events of a window; `contents` lays out what is seen; `painter` draws it.

mod contents;
mod painter;

use std::time::Duration;

use egui::{Context, Order, ViewportId};
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
use painter::Painter;

/// A frame that the panel wants within this time is drawn even while the picture rests.
const SOON: Duration = Duration::from_millis(100);

/// What the panel shows of the state of the window.
#[derive(Clone, Copy, Debug)]
pub struct State<'a> {
    /// The file's name.
    pub name: &'a str,
    /// Tolerance as asked, pixels.
    pub tolerance: f64,
    /// Factor of heights.
    pub exaggeration: f64,
    /// Colours and lines.
    pub look: Look,
    /// True if the selection does not follow the camera.
    pub frozen: bool,
    /// How the camera moves.
    pub mode: Mode,
    /// True if the help is shown.
    pub help: bool,
    /// Figures of the last frames.
    pub figures: Figures,
    /// Lines in the lower left corner.
    pub messages: &'a [String],
}

/// What the user changed in the panel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// A new tolerance, pixels.
    Tolerance(f64),
    /// A new factor of heights.
    Exaggeration(f64),
    /// The command of a key.
    Obey(Command),
}

/// The panel of a window.
pub struct Panel {
    context: Context,
    events: egui_winit::State,
    painter: Painter,
    open: bool,
    /// True if it may look different from what was drawn last.
    stale: bool,
    /// The place of the mouse, in pixels, and whether it is over the panel.
    pointer: Option<PhysicalPosition<f64>>,
    over: bool,
}

impl Panel {
    /// Returns an open panel for targets of a format.
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat, window: &Window) -> Result<Self> {
        let context = context();
        let side = gpu.device.limits().max_texture_dimension_2d as usize;
        let scale = Some(window.scale_factor() as f32);
        let events =
            egui_winit::State::new(context.clone(), ViewportId::ROOT, window, scale, None, Some(side));
        let painter = Painter::new(gpu, format)?;
        Ok(Self { context, events, painter, open: true, stale: true, pointer: None, over: false })
    }

    /// Opens or closes it.
    pub fn toggle(&mut self) {
        self.open = !self.open;
        self.stale = true;
    }

    /// Returns true while it must be drawn again.
    pub fn busy(&self) -> bool {
        self.stale
    }

    /// Takes an event of the window; returns true if it is for the panel alone.
    ///
    /// The release of a key or a button is never for the panel alone: a drag that began over the
    /// picture may end over the panel.
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

    /// Returns whether the mouse is over it now; egui itself only knows where it was in the last
    /// frame.
    fn is_over(&self, window: &Window) -> bool {
        let scale = egui_winit::pixels_per_point(&self.context, window);
        let at = self.pointer.map(|at| egui::pos2(at.x as f32 / scale, at.y as f32 / scale));
        let layer = at.and_then(|at| self.context.layer_id_at(at));
        layer.is_some_and(|layer| layer.order != Order::Background)
    }

    /// Draws it over what the target shows; returns what the user has changed in it.
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        canvas: &Canvas,
        state: &State<'_>,
        target: &wgpu::TextureView,
    ) -> Result<Vec<Change>> {
        let input = self.events.take_egui_input(canvas.window());
        let mut changes = Vec::new();
        let mut output = self.context.run_ui(input, |ui| {
            changes.extend(contents::show(ui.ctx(), state, self.open));
        });
        let soon = output.viewport_output.values().any(|viewport| viewport.repaint_delay < SOON);
        self.stale = soon || !changes.is_empty();
        let platform = std::mem::take(&mut output.platform_output);
        self.events.handle_platform_output(canvas.window(), platform);
        self.painter.draw(gpu, &self.context, output, target, canvas.size())?;
        Ok(changes)
    }
}

/// Returns an egui context with the options of the viewer.
fn context() -> Context {
    let context = Context::default();
    context.set_theme(egui::Theme::Dark);
    // Plus and minus are the tolerance.
    context.options_mut(|options| options.zoom_with_keyboard = false);
    context
}
