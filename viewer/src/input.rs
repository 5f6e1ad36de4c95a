//! Keys and mouse: commands, and motion of the camera.

use std::collections::HashSet;

use winit::event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta};
use winit::keyboard::{Key, KeyCode, NamedKey, PhysicalKey};

use crate::camera::{FOV, Mode, Rig};
use crate::gpu::Paint;
use crate::stage::PAINTS;

/// The help: keys, and what they do.
pub const HELP: &[(&str, &str)] = &[
    ("W A S D", "fly ahead, left, back, right"),
    ("Q E", "fly down, up"),
    ("Shift", "fly 5 times as fast"),
    ("drag", "look round (orbit: go round)"),
    ("right drag", "drag the ground along"),
    ("wheel", "nearer, farther"),
    ("Home", "the whole terrain, as at the start"),
    ("O", "orbit or fly"),
    ("- +", "tolerance in pixels"),
    ("[ ]", "exaggeration of heights"),
    ("1", "imagery or tint, shaded"),
    ("2", "tint, shaded"),
    ("3", "level of the tile"),
    ("4", "step of the patch"),
    ("5", "projected error: blue 0, red the tolerance"),
    ("F B", "wireframe, borders of tiles"),
    ("L", "freeze what is selected"),
    ("P", "picture to a file"),
    ("R", "record the camera path to a file, on and off"),
    ("Tab", "panel on and off"),
    ("H F1", "this help"),
    ("Esc", "quit"),
];

/// What a key press asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// End the program.
    Quit,
    /// Show or hide the help.
    Help,
    /// Multiply the tolerance by this.
    Tolerance(f64),
    /// Multiply the exaggeration by this.
    Exaggeration(f64),
    /// Use these colours.
    Paint(Paint),
    /// Show or hide the edges of triangles.
    Wireframe,
    /// Show or hide the borders of tiles.
    Borders,
    /// Freeze the selection, or let it follow the camera again.
    Freeze,
    /// Write a picture to a file.
    Screenshot,
    /// Record the camera path, or end and write it.
    Record,
    /// Change between flight and orbit.
    Mode,
    /// Go back to the view of the start.
    Home,
    /// Open or close the panel.
    Panel,
}

/// Factor of a step of the tolerance or the exaggeration.
const STEP: f64 = 1.25;

/// Returns the command of a key, if it has one.
pub fn command(key: &Key) -> Option<Command> {
    let text = match key {
        Key::Named(NamedKey::Escape) => return Some(Command::Quit),
        Key::Named(NamedKey::F1) => return Some(Command::Help),
        Key::Named(NamedKey::Home) => return Some(Command::Home),
        Key::Named(NamedKey::Tab) => return Some(Command::Panel),
        Key::Character(text) => text.to_lowercase(),
        _ => return None,
    };
    Some(match text.as_str() {
        "h" => Command::Help,
        "-" | "_" => Command::Tolerance(1.0 / STEP),
        "+" | "=" => Command::Tolerance(STEP),
        "[" => Command::Exaggeration(1.0 / STEP),
        "]" => Command::Exaggeration(STEP),
        "f" => Command::Wireframe,
        "b" => Command::Borders,
        "l" => Command::Freeze,
        "p" => Command::Screenshot,
        "r" => Command::Record,
        "o" => Command::Mode,
        digit => {
            let index = digit.parse::<usize>().ok()?.checked_sub(1)?;
            Command::Paint(PAINTS.get(index)?.1)
        }
    })
}

/// Radians that a drag over the height of the window turns the camera.
const TURN: f64 = 1.8;
/// Speed of flight, in heights above the ground a second.
const PACE: f64 = 0.9;

/// Keys and buttons that are down, and motion of the mouse since the last frame.
#[derive(Clone, Debug, Default)]
pub struct Input {
    held: HashSet<KeyCode>,
    /// The button that is down: the left one turns the camera, the right one moves it.
    dragging: Option<MouseButton>,
    cursor: Option<[f64; 2]>,
    turned: [f64; 2],
    pulled: [f64; 2],
    notches: f64,
}

impl Input {
    /// Takes a key that went down or up; returns the command that it stands for.
    pub fn key(&mut self, event: &KeyEvent) -> Option<Command> {
        let down = event.state == ElementState::Pressed;
        if let PhysicalKey::Code(code) = event.physical_key {
            if down {
                self.held.insert(code);
            } else {
                self.held.remove(&code);
            }
        }
        let changes = |command: &Command| matches!(command, Command::Tolerance(_) | Command::Exaggeration(_));
        let command = command(&event.logical_key)?;
        // A key that is held repeats changes of a number, but does not repeat a switch.
        (down && (!event.repeat || changes(&command))).then_some(command)
    }

    /// Takes a button that went down or up.
    pub fn button(&mut self, button: MouseButton, state: ElementState) {
        if !matches!(button, MouseButton::Left | MouseButton::Right) {
            return;
        }
        if state == ElementState::Pressed {
            self.dragging = Some(button);
        } else if self.dragging == Some(button) {
            self.dragging = None;
        }
    }

    /// Takes a new place of the mouse, in pixels.
    pub fn moved(&mut self, to: [f64; 2]) {
        if let Some((from, button)) = self.cursor.zip(self.dragging) {
            let drag = if button == MouseButton::Left { &mut self.turned } else { &mut self.pulled };
            *drag = [drag[0] + to[0] - from[0], drag[1] + to[1] - from[1]];
        }
        self.cursor = Some(to);
    }

    /// Takes a turn of the wheel.
    pub fn wheel(&mut self, delta: MouseScrollDelta) {
        self.notches += match delta {
            MouseScrollDelta::LineDelta(_, y) => f64::from(y),
            MouseScrollDelta::PixelDelta(pixels) => pixels.y / 60.0,
        };
    }

    /// Forgets all keys and buttons that are down: the window has lost the focus.
    pub fn release(&mut self) {
        *self = Self { cursor: self.cursor, ..Self::default() };
    }

    /// Returns true if [`Input::drive`] would move the camera.
    pub fn active(&self) -> bool {
        self.turned != [0.0; 2]
            || self.pulled != [0.0; 2]
            || self.notches != 0.0
            || self.direction() != [0.0; 3]
    }

    /// Returns the direction of the keys that are down: ahead, right, up.
    fn direction(&self) -> [f64; 3] {
        let axis = |plus: KeyCode, minus: KeyCode| {
            f64::from(u8::from(self.held.contains(&plus))) - f64::from(u8::from(self.held.contains(&minus)))
        };
        [
            axis(KeyCode::KeyW, KeyCode::KeyS),
            axis(KeyCode::KeyD, KeyCode::KeyA),
            axis(KeyCode::KeyE, KeyCode::KeyQ),
        ]
    }

    /// Moves the camera by the input of the last `seconds`; `above` is its height above the ground
    /// in metres, `pixels` the window's height.
    pub fn drive(&mut self, rig: &mut Rig, seconds: f64, above: f64, pixels: u32) {
        let scale = TURN / f64::from(pixels.max(1));
        let [x, y] = std::mem::take(&mut self.turned);
        // In flight the direction of view follows the mouse; in an orbit the same turn makes the
        // near side follow it.
        rig.turn(x * scale, -y * scale);
        // The ground follows the mouse: a point as far ahead as the ground is below moves with it.
        let [x, y] = std::mem::take(&mut self.pulled);
        let metres = 2.0 * above * (FOV.to_radians() / 2.0).tan() / f64::from(pixels.max(1));
        rig.slide(y * metres, -x * metres);
        let notches = std::mem::take(&mut self.notches);
        match rig.mode {
            Mode::Orbit => rig.zoom(notches),
            Mode::Fly => rig.walk(notches * above * 0.15, 0.0, 0.0),
        }
        let fast = self.held.contains(&KeyCode::ShiftLeft) || self.held.contains(&KeyCode::ShiftRight);
        let step = above * PACE * seconds * if fast { 5.0 } else { 1.0 };
        let [ahead, right, up] = self.direction();
        rig.walk(ahead * step, right * step, up * step);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_commands() {
        let key = |text: &str| command(&Key::Character(text.into()));
        assert_eq!(key("3"), Some(Command::Paint(Paint::TileLevel)));
        assert_eq!((key("0"), key("6"), key("w")), (None, None, None));
        assert_eq!((key("F"), key("f")), (Some(Command::Wireframe), Some(Command::Wireframe)));
        assert_eq!(command(&Key::Named(NamedKey::Escape)), Some(Command::Quit));
        assert_eq!(key("="), Some(Command::Tolerance(1.25)));
    }

    #[test]
    fn only_a_drag_turns() {
        let mut rig = Rig { mode: Mode::Fly, eye: [0.0; 3], yaw: 0.0, pitch: 0.0, distance: 1.0 };
        let mut input = Input::default();
        input.moved([10.0, 10.0]);
        input.moved([50.0, 10.0]);
        assert!(!input.active());
        input.button(MouseButton::Left, ElementState::Pressed);
        input.moved([150.0, 10.0]);
        assert!(input.active());
        input.drive(&mut rig, 0.1, 100.0, 720);
        assert!(rig.yaw > 0.0 && rig.pitch == 0.0 && !input.active());
        assert_eq!(rig.eye, [0.0; 3]);
    }

    #[test]
    fn the_right_button_drags_the_ground() {
        let mut rig = Rig { mode: Mode::Fly, eye: [0.0; 3], yaw: 0.0, pitch: -0.5, distance: 1.0 };
        let mut input = Input::default();
        input.moved([10.0, 10.0]);
        input.button(MouseButton::Right, ElementState::Pressed);
        // The other button ends nothing.
        input.button(MouseButton::Left, ElementState::Released);
        input.moved([110.0, 60.0]);
        input.drive(&mut rig, 0.1, 100.0, 720);
        assert!(rig.eye[0] < 0.0 && rig.eye[1] > 0.0 && rig.eye[2] == 0.0, "{:?}", rig.eye);
        assert_eq!((rig.yaw, rig.pitch), (0.0, -0.5));
        assert_eq!(command(&Key::Named(NamedKey::Home)), Some(Command::Home));
    }
}
