//! The frames of the window: camera, selection, drawing, panel, title. `commands` carries out what
//! keys and the panel ask for.

mod commands;

use std::sync::Arc;
use std::time::{Duration, Instant};

use relevo_core::Result;
use relevo_core::select::{Levels, View};
use winit::event::WindowEvent;
use winit::event_loop::OwnedDisplayHandle;
use winit::window::Window;

use crate::camera::{FOV, Rig, moved, near};
use crate::canvas::Canvas;
use crate::flyover;
use crate::governor::{Governor, Load};
use crate::gpu::{Drawn, Look};
use crate::input::Input;
use crate::metrics::Figures;
use crate::panel::{Change, Panel, State};
use crate::path::Key;
use crate::scene::{FramePlan, Terrain};
use crate::settings::Settings;
use crate::stage::{Drawing, Stage, promised};

/// Time for which a message is shown.
const NOTICE: Duration = Duration::from_secs(6);
/// Time between two titles.
const TITLE: Duration = Duration::from_millis(500);
/// The message that is shown until the first key or drag.
const HINT: &str = "H shows the keys, Tab hides the panel, Home shows the whole terrain";
/// Frames that are drawn after the last change, as uploads and counters take some.
const SETTLE_FRAMES: u32 = 4;

/// The state of the window and what draws it.
pub struct Show {
    canvas: Canvas,
    stage: Stage,
    panel: Panel,
    /// Keys and mouse.
    pub input: Input,
    name: String,
    rig: Rig,
    look: Look,
    /// As asked; `drawn_tolerance` may be higher while the camera moves.
    tolerance: f64,
    governor: Governor,
    drawn_tolerance: f64,
    help: bool,
    /// True until the first key or drag.
    hint: bool,
    /// The plan that is drawn although the camera moves, with its steps.
    frozen: Option<(FramePlan, Levels)>,
    recording: Option<(Instant, Vec<Key>)>,
    notices: Vec<(String, Instant)>,
    messages: Vec<String>,
    /// The last frame: its view and when it began.
    last: Option<(View, Instant)>,
    drawn: Drawn,
    quiet: u32,
    counted: (Instant, u32),
    /// As the title shows them.
    figures: Figures,
    visible: bool,
}

impl Show {
    /// Returns device, scene and camera for a window.
    pub fn new(
        window: Arc<Window>,
        display: Box<OwnedDisplayHandle>,
        terrain: Terrain,
        settings: &Settings,
        name: String,
    ) -> Result<Self> {
        let overview = flyover::overview(terrain.reader(), settings.exaggeration)?;
        let (canvas, gpu) = Canvas::new(Arc::clone(&window), display, &settings.adapter)?;
        // A window may become as large as its monitor: its depth buffer is part of the budget.
        let monitor =
            window.current_monitor().map_or((0, 0), |monitor| (monitor.size().width, monitor.size().height));
        let size = canvas.size();
        let largest = (size.0.max(monitor.0), size.1.max(monitor.1));
        let stage = Stage::new(gpu, terrain, settings, largest, canvas.format())?;
        let panel = Panel::new(&stage.gpu, canvas.format(), canvas.window())?;
        let look = stage.look(settings);
        let rig = Rig::new(&overview, stage.scene.frame());
        let mut show = Self {
            canvas,
            panel,
            input: Input::default(),
            name,
            rig,
            look,
            tolerance: settings.tolerance,
            governor: Governor::new(settings.target, settings.tolerance),
            drawn_tolerance: settings.tolerance,
            help: false,
            hint: true,
            frozen: None,
            recording: None,
            notices: Vec::new(),
            messages: Vec::new(),
            last: None,
            drawn: Drawn::default(),
            quiet: 0,
            counted: (Instant::now(), 0),
            figures: Figures::default(),
            visible: true,
            stage,
        };
        show.notice(show.stage.gpu.name());
        Ok(show)
    }

    /// Returns the window.
    pub fn window(&self) -> &Window {
        self.canvas.window()
    }

    /// Returns false while one side of the window is 0.
    pub fn visible(&self) -> bool {
        self.visible
    }

    /// Returns true while the next frame may differ from the last.
    pub fn busy(&self) -> bool {
        if self.panel.busy() {
            return true;
        }
        self.input.active() || self.quiet < SETTLE_FRAMES || self.recording.is_some()
    }

    /// Sets the size in pixels; nothing is drawn while one side is 0.
    pub fn resize(&mut self, size: (u32, u32)) {
        self.visible = size.0 > 0 && size.1 > 0;
        if self.visible {
            self.canvas.resize(size);
        }
        self.quiet = 0;
    }

    /// Returns and forgets the messages for the terminal.
    pub fn take_messages(&mut self) -> Vec<String> {
        std::mem::take(&mut self.messages)
    }

    /// Hides the hint.
    pub fn end_hint(&mut self) {
        if std::mem::take(&mut self.hint) {
            self.quiet = 0;
        }
    }

    fn notice(&mut self, text: String) {
        self.notices.push((text, Instant::now()));
        let old = self.notices.len().saturating_sub(5);
        self.notices.drain(..old);
        self.quiet = 0;
    }

    /// Shows a message in the window and in the terminal.
    fn say(&mut self, text: String) {
        self.messages.push(text.clone());
        self.notice(text);
    }

    /// Returns the height of the eye above the ground in metres of the frame, at least 40 near
    /// planes.
    fn above(&self) -> f64 {
        let frame = self.stage.scene.frame();
        let ground = self.stage.scene.ground();
        let (low, high) = self.stage.scene.heights();
        let middle = f64::from(low + high) / 2.0 * frame.exaggeration;
        (self.rig.eye[2] - ground.unwrap_or(middle)).abs().max(40.0 * near(frame))
    }

    fn view(&self) -> View {
        let frame = self.stage.scene.frame();
        self.rig.pose(frame).view(frame, FOV, self.canvas.size())
    }

    /// Draws a frame. An error ends the program.
    pub fn frame(&mut self) -> Result<()> {
        if !self.visible {
            return Ok(());
        }
        let now = Instant::now();
        let seconds = self.last.map_or(0.0, |(_, before)| (now - before).as_secs_f64());
        self.drive(seconds.min(0.2));
        let view = self.view();
        let moving = self.last.is_none_or(|(before, _)| moved(&before, &view));
        self.last = Some((view, now));
        self.record(now);
        // The pause of a window at rest is not what a frame costs.
        let seconds = if self.quiet < SETTLE_FRAMES { seconds } else { 0.0 };
        let load = Load { seconds, triangles: self.drawn.triangles, moving };
        let tolerance = self.governor.next(self.tolerance, load);
        let steady = tolerance == self.drawn_tolerance;
        self.drawn_tolerance = tolerance;

        let plan = self.choose(&view)?;
        for problem in self.stage.scene.take_problems() {
            self.say(problem);
        }
        let Some(texture) = self.canvas.acquire(&self.stage.gpu)? else { return Ok(()) };
        let target = texture.texture.create_view(&wgpu::TextureViewDescriptor::default());
        let size = self.canvas.size();
        let levels = self.frozen.as_ref().map(|(_, levels)| levels);
        let drawing = Drawing { view: &view, tolerance, look: self.look, levels };
        self.stage.draw(&plan, &drawing, &target, size)?;
        let changes = self.draw_panel(now, &target)?;
        self.stage.gpu.queue.present(texture);
        let drawn = self.stage.renderer.latest(&self.stage.gpu)?;
        let same = drawn == self.drawn && steady && !moving && plan.pending == 0 && self.notices.is_empty();
        self.drawn = drawn;
        self.quiet = if same { self.quiet.saturating_add(1) } else { 0 };
        self.title(now, &plan, &view);
        changes.into_iter().try_for_each(|change| self.change(change))?;
        Ok(())
    }

    /// Gives an event to the panel; returns true if the camera must not take it.
    pub fn panel_takes(&mut self, event: &WindowEvent) -> bool {
        self.panel.takes(self.canvas.window(), event)
    }

    /// Draws the panel over the picture; returns what the user changed in it.
    fn draw_panel(&mut self, now: Instant, target: &wgpu::TextureView) -> Result<Vec<Change>> {
        let messages = self.lines(now);
        let state = State {
            name: &self.name,
            tolerance: self.tolerance,
            exaggeration: self.stage.scene.frame().exaggeration,
            look: self.look,
            frozen: self.frozen.is_some(),
            mode: self.rig.mode,
            help: self.help,
            figures: self.figures,
            messages: &messages,
        };
        self.panel.draw(&self.stage.gpu, &self.canvas, &state, target)
    }

    /// Moves the camera to where it shows the whole terrain, as at the start.
    fn go_home(&mut self) -> Result<()> {
        let frame = *self.stage.scene.frame();
        let overview = flyover::overview(self.stage.scene.reader(), frame.exaggeration)?;
        self.rig = Rig { mode: self.rig.mode, ..Rig::new(&overview, &frame) };
        Ok(())
    }

    fn drive(&mut self, seconds: f64) {
        if self.input.active() {
            self.end_hint();
        }
        let above = self.above();
        let height = self.canvas.size().1;
        self.input.drive(&mut self.rig, seconds, above, height);
        if let Some(ground) = self.stage.scene.ground() {
            self.rig.stay_above(ground, 4.0 * near(self.stage.scene.frame()));
        }
    }

    fn choose(&mut self, view: &View) -> Result<FramePlan> {
        let Some((plan, _)) = &self.frozen else { return self.stage.stream(view, self.drawn_tolerance) };
        self.stage.scene.advance();
        self.stage.scene.keep(plan);
        Ok(plan.clone())
    }

    /// Returns the messages that are not too old, and the hint.
    fn lines(&mut self, now: Instant) -> Vec<String> {
        self.notices.retain(|(_, since)| now - *since < NOTICE);
        let hint = self.hint.then(|| HINT.to_owned());
        self.notices.iter().map(|(text, _)| text.clone()).chain(hint).collect()
    }

    fn title(&mut self, now: Instant, plan: &FramePlan, view: &View) {
        self.counted.1 += 1;
        let seconds = (now - self.counted.0).as_secs_f64();
        if seconds < TITLE.as_secs_f64() {
            return;
        }
        let fps = f64::from(self.counted.1) / seconds;
        self.counted = (now, 0);
        let (frame, rule) = (self.stage.scene.frame(), self.stage.scene.rule());
        let of_view = || Levels::of(&plan.selection, frame, view, self.drawn_tolerance, rule);
        let levels = self.frozen.as_ref().map_or_else(of_view, |(_, levels)| levels.clone());
        let figures = Figures {
            fps,
            tiles: plan.selection.tiles.len(),
            patches: self.drawn.patches,
            triangles: self.drawn.triangles,
            megabytes: self.stage.gpu_bytes() as f64 / f64::from(1 << 20),
            pending: plan.pending,
            tolerance: self.drawn_tolerance,
            promised: promised(&plan.selection, &levels, frame, view),
        };
        self.figures = figures;
        let state = match (&self.frozen, &self.recording) {
            (_, Some(_)) => ", recording",
            (Some(_), None) => ", frozen",
            (None, None) => "",
        };
        let title = format!(
            "Relevo - {} - {:.0} fps, {} tiles, {} patches, {} triangles, {:.0} MB, error {:.2} of {:.2} px{state}",
            self.name,
            figures.fps,
            figures.tiles,
            figures.patches,
            figures.triangles,
            figures.megabytes,
            figures.promised,
            figures.tolerance,
        );
        self.canvas.window().set_title(&title);
    }
}
