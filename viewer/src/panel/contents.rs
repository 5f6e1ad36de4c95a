//! The contents of the interface: the panel of controls and figures, the help, the messages.

use egui::{
    Align2, Area, Checkbox, Context, Frame, Grid, Id, Label, RichText, ScrollArea, Slider, SliderClamping,
    Ui, Window,
};

use super::{Change, State};
use crate::camera::Mode;
use crate::input::{Command, HELP};
use crate::metrics::Figures;
use crate::stage::PAINTS;

/// Pixels and factors of the sliders.
const RANGE: std::ops::RangeInclusive<f64> = 0.1..=20.0;
/// Width of the panel, and the distance of everything from the window's sides, in points.
const WIDTH: f32 = 210.0;
const MARGIN: f32 = 6.0;
/// Height of a title and its border, in points.
const TITLE: f32 = 50.0;
/// Width of the borders and margins inside them, on both sides together, in points.
const BORDER: f32 = 20.0;

/// Lays everything out for one frame: the panel if it is `open`, the help and the messages as
/// `state` says. Returns what the user has changed.
pub(super) fn show(context: &Context, state: &State<'_>, open: bool) -> Vec<Change> {
    messages(context, state.messages);
    if state.help {
        help(context);
    }
    if open { panel(context, state) } else { Vec::new() }
}

/// A scroll area that is as high as its contents if the window has room for them.
fn scroll(context: &Context) -> ScrollArea {
    let room = (context.viewport_rect().height() - TITLE - 2.0 * MARGIN).max(1.0);
    // Without the minimum egui keeps the height that a lower window once had.
    ScrollArea::vertical().max_height(room).min_scrolled_height(room)
}

/// The panel in the upper right corner.
fn panel(context: &Context, state: &State<'_>) -> Vec<Change> {
    let window = Window::new("Relevo").anchor(Align2::RIGHT_TOP, [-MARGIN, MARGIN]).auto_sized();
    let shown = window.show(context, |ui| {
        let mut changes = Vec::new();
        ui.set_width(WIDTH);
        scroll(context).show(ui, |ui| {
            ui.add(Label::new(RichText::new(state.name).strong()).truncate());
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

/// The keys and what each does, in the upper left corner.
fn help(context: &Context) {
    let window =
        Window::new("Keys").anchor(Align2::LEFT_TOP, [MARGIN, MARGIN]).auto_sized().collapsible(false);
    window.show(context, |ui| {
        scroll(context).show(ui, |ui| {
            Grid::new("keys").num_columns(2).show(ui, |ui| {
                for (key, what) in HELP {
                    ui.monospace(*key);
                    ui.label(*what);
                    ui.end_row();
                }
            });
        });
    });
}

/// Lines in the lower left corner; the mouse goes through them.
fn messages(context: &Context, lines: &[String]) {
    if lines.is_empty() {
        return;
    }
    let area = Area::new(Id::unique("messages")).anchor(Align2::LEFT_BOTTOM, [MARGIN, -MARGIN]);
    area.interactable(false).show(context, |ui| {
        Frame::window(ui.style()).show(ui, |ui| {
            ui.set_max_width((context.viewport_rect().width() - 2.0 * MARGIN - BORDER).max(1.0));
            for line in lines {
                ui.add(Label::new(line).wrap().selectable(false));
            }
        });
    });
}

fn numbers(ui: &mut Ui, state: &State<'_>, changes: &mut Vec<Change>) {
    let mut number = |name: &str, unit: &str, now: f64, change: fn(f64) -> Change| {
        let mut value = now;
        ui.label(name);
        // A value that the keys have set beyond the range stays until the slider is dragged.
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

#[cfg(test)]
mod tests {
    use egui::{RawInput, Rect, Shape};

    use super::*;
    use crate::gpu::{Look, Paint};
    use crate::panel::context;

    fn state(messages: &[String]) -> State<'_> {
        let look = Look {
            paint: Paint::Terrain,
            wireframe: false,
            borders: false,
            clear: [0.0; 3],
            sun: [0.0, 0.0, 1.0],
            range: [0.0, 1.0],
        };
        let figures =
            Figures { tiles: 71, triangles: 12_345, tolerance: 1.0, promised: 0.75, ..Figures::default() };
        State {
            name: "alps.rlv",
            tolerance: 1.0,
            exaggeration: 1.0,
            look,
            frozen: false,
            mode: Mode::Fly,
            help: false,
            figures,
            messages,
        }
    }

    fn collect(shape: &Shape, clip: Rect, texts: &mut Vec<(Rect, String)>) {
        match shape {
            Shape::Text(text) => {
                let seen = text.visual_bounding_rect().intersect(clip);
                if seen.is_positive() {
                    texts.push((seen, text.galley.text().to_owned()));
                }
            }
            Shape::Vec(shapes) => shapes.iter().for_each(|shape| collect(shape, clip, texts)),
            _ => {}
        }
    }

    /// The texts that are seen in a window of a size, with their places.
    fn texts(state: &State<'_>, open: bool, size: [f32; 2]) -> Vec<(Rect, String)> {
        let context = context();
        let all = Rect::from_min_size(egui::Pos2::ZERO, size.into());
        let mut texts = Vec::new();
        // egui takes the sizes of a frame from the one before, and fades windows in.
        for frame in 0..10 {
            let time = Some(f64::from(frame));
            let input = RawInput { screen_rect: Some(all), time, ..RawInput::default() };
            let mut output = context.run_ui(input, |ui| assert!(show(ui.ctx(), state, open).is_empty()));
            output.textures_delta.clear();
            texts.clear();
            output
                .shapes
                .iter()
                .for_each(|shape| collect(&shape.shape, shape.clip_rect.intersect(all), &mut texts));
            assert!(texts.iter().all(|(place, _)| all.contains_rect(*place)), "{texts:?}");
        }
        texts
    }

    fn place(texts: &[(Rect, String)], text: &str) -> Option<Rect> {
        texts.iter().find(|(_, other)| other == text).map(|(place, _)| *place)
    }

    #[test]
    fn the_panel_shows_controls_and_figures_while_it_is_open() {
        let state = state(&[]);
        let open = texts(&state, true, [800.0, 600.0]);
        let all = ["alps.rlv", "Tolerance", "terrain", "Wireframe", "71", "12345", "0.75 of 1.00 px"];
        for text in all {
            let place = place(&open, text).unwrap_or_else(|| panic!("no {text:?} in {open:?}"));
            assert!(place.left() > 800.0 - WIDTH - 4.0 * MARGIN - BORDER, "{text} at {place:?}");
        }
        assert_eq!(texts(&state, false, [800.0, 600.0]), []);
    }

    #[test]
    fn the_help_shows_every_key_with_the_panel_and_without_it() {
        let state = State { help: true, ..state(&[]) };
        for open in [true, false] {
            let texts = texts(&state, open, [800.0, 600.0]);
            for (key, what) in HELP {
                let (key, what) = (place(&texts, key), place(&texts, what));
                let (key, what) = key.zip(what).unwrap_or_else(|| panic!("{texts:?}"));
                assert!(key.right() < what.left() && (key.center().y - what.center().y).abs() < 4.0);
            }
        }
    }

    #[test]
    fn messages_are_in_the_lower_left_corner_in_their_order() {
        let messages = ["tolerance 0.80 pixels".to_owned(), "long ".repeat(60).trim().to_owned()];
        let texts = texts(&state(&messages), false, [400.0, 300.0]);
        let places: Vec<_> = messages.iter().filter_map(|text| place(&texts, text)).collect();
        assert_eq!(places.len(), 2, "{texts:?}");
        assert!(places[0].left() < 2.0 * BORDER && places[0].bottom() <= places[1].top());
        assert!(places[1].bottom() > 300.0 - 2.0 * BORDER && places[1].height() > 2.0 * places[0].height());
    }

    #[test]
    fn a_low_window_shows_the_top_of_what_scrolls() {
        let state = State { help: true, ..state(&[]) };
        let texts = texts(&state, true, [800.0, 150.0]);
        assert!(place(&texts, "alps.rlv").is_some() && place(&texts, HELP[0].1).is_some(), "{texts:?}");
        assert_eq!((place(&texts, "71"), place(&texts, "quit")), (None, None));
    }
}
