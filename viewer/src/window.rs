//! The event loop of the window. What a frame does is in [`crate::show`].

use std::sync::Arc;
use std::time::{Duration, Instant};

use relevo_core::{Error, Result};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::window::{Window, WindowId};

use crate::scene::Terrain;
use crate::settings::Settings;
use crate::show::Show;

/// Time between two frames while nothing moves and nothing is loaded.
const AT_REST: Duration = Duration::from_secs(1);

/// Shows a file until the window is closed. `report` is called with a sentence for each tile that
/// cannot be read and each file that was written.
pub fn run(settings: &Settings, report: &mut dyn FnMut(&str)) -> Result<()> {
    // Before the window opens, so that a bad file is an error in the terminal.
    let terrain = Terrain::open(&settings.file, settings.ram_cache)?;
    let hint = "there may be no display; --headless and --shot work without one";
    let events = EventLoop::new().map_err(|error| no_window(&error, hint))?;
    let mut app =
        App { settings, report, terrain: Some(terrain), show: None, outcome: Ok(()), hidden: false };
    let ran = events.run_app(&mut app);
    app.show = None;
    app.outcome?;
    ran.map_err(|error| {
        Error::unsupported(format!("the window's events have ended ({})", plain(&error.to_string())), hint)
    })
}

fn no_window(error: &dyn std::fmt::Display, hint: &str) -> Error {
    Error::unsupported(format!("cannot open a window ({})", plain(&error.to_string())), hint)
}

/// Returns an error text of winit without the path of its source file on the machine that compiled
/// it: `os error at /…/mod.rs:767: `.
fn plain(words: &str) -> &str {
    let after_line = |rest: &'_ str| -> Option<usize> {
        let digits = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_digit()).len();
        (digits > 0 && rest[digits..].starts_with(": ")).then_some(digits + 2)
    };
    let ends = words.match_indices(".rs:").filter_map(|(at, found)| {
        let from = at + found.len();
        after_line(&words[from..]).map(|length| from + length)
    });
    &words[ends.last().unwrap_or(0)..]
}

struct App<'a> {
    settings: &'a Settings,
    report: &'a mut dyn FnMut(&str),
    terrain: Option<Terrain>,
    show: Option<Show>,
    outcome: Result<()>,
    hidden: bool,
}

impl App<'_> {
    fn open(&mut self, events: &ActiveEventLoop) -> Result<()> {
        let (width, height) = self.settings.size;
        let name =
            self.settings.file.file_name().map_or_else(String::new, |name| name.to_string_lossy().into());
        let attributes = Window::default_attributes()
            .with_title(format!("Relevo - {name}"))
            .with_inner_size(PhysicalSize::new(width, height));
        let window = events.create_window(attributes);
        let window = window.map_err(|error| no_window(&error, "--headless and --shot work without one"))?;
        let terrain = match self.terrain.take() {
            Some(terrain) => terrain,
            None => Terrain::open(&self.settings.file, self.settings.ram_cache)?,
        };
        let display = Box::new(events.owned_display_handle());
        self.show = Some(Show::new(Arc::new(window), display, terrain, self.settings, name)?);
        Ok(())
    }

    /// Ends the program with an error.
    fn fail(&mut self, events: &ActiveEventLoop, error: Error) {
        self.outcome = Err(error);
        self.show = None;
        events.exit();
    }

    fn draw(&mut self, events: &ActiveEventLoop) {
        let Some(show) = &mut self.show else { return };
        if let Err(error) = show.frame() {
            return self.fail(events, error);
        }
        show.take_messages().iter().for_each(|message| (self.report)(message));
    }
}

impl ApplicationHandler for App<'_> {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.show.is_some() {
            return;
        }
        match self.open(events) {
            Ok(()) => events.set_control_flow(ControlFlow::Poll),
            Err(error) => self.fail(events, error),
        }
    }

    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, Some(show)) = (cause, &self.show) {
            show.window().request_redraw();
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(show) = &mut self.show else { return };
        if show.panel_takes(&event) {
            return;
        }
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::Resized(size) => show.resize((size.width, size.height)),
            WindowEvent::Occluded(hidden) => self.hidden = hidden,
            WindowEvent::Focused(false) => show.input.release(),
            // A key that is down when the window gets the focus comes as pressed, and once more if
            // it was pressed just then.
            WindowEvent::KeyboardInput { is_synthetic: true, .. } => {}
            WindowEvent::KeyboardInput { event, .. } => {
                match show.input.key(&event).map(|command| show.obey(command)) {
                    Some(Ok(false)) => events.exit(),
                    Some(Err(error)) => self.fail(events, error),
                    _ => {}
                }
            }
            WindowEvent::MouseInput { state, button, .. } => show.input.button(button, state),
            WindowEvent::CursorMoved { position, .. } => show.input.moved([position.x, position.y]),
            WindowEvent::MouseWheel { delta, .. } => show.input.wheel(delta),
            WindowEvent::RedrawRequested => self.draw(events),
            _ => {}
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let Some(show) = &self.show else { return };
        if self.hidden || !show.visible() {
            events.set_control_flow(ControlFlow::Wait);
        } else if show.busy() {
            events.set_control_flow(ControlFlow::Poll);
            show.window().request_redraw();
        } else if !matches!(events.control_flow(), ControlFlow::WaitUntil(at) if at > Instant::now()) {
            events.set_control_flow(ControlFlow::WaitUntil(Instant::now() + AT_REST));
        }
    }

    fn suspended(&mut self, _: &ActiveEventLoop) {
        // The surface is not valid any more; `resumed` makes another one.
        self.show = None;
    }
}

#[cfg(test)]
mod tests {
    use super::plain;

    #[test]
    fn no_place_of_another_machine_is_told() {
        let words = "os error at /home/x/.cargo/registry/src/index-1/winit-0.30/src/mod.rs:767: neither WAYLAND_DISPLAY nor DISPLAY is set.";
        assert_eq!(plain(words), "neither WAYLAND_DISPLAY nor DISPLAY is set.");
        for words in ["no display", "a.rs: b", "a.rs:12 b", ""] {
            assert_eq!(plain(words), words);
        }
    }
}
