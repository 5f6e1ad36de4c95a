//! The window, on a virtual display.
#![expect(clippy::expect_used, reason = "a test that cannot go on says why")]
#![cfg(target_os = "linux")]

mod common;

use std::io::Read;
use std::ops::Range;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use common::{covered, fixture, viewer};
use tempfile::TempDir;

/// A display, for as long as it is kept.
struct Display {
    server: Child,
    name: String,
    /// The folder of the file that holds its screen.
    screen: TempDir,
}

/// Pixels across the screen.
const SCREEN_WIDTH: usize = 800;

/// The fill of egui's windows.
const FILL: u8 = 27;

impl Display {
    fn open() -> Self {
        for (program, package) in [("Xvfb", "xvfb"), ("xdotool", "xdotool")] {
            let there =
                Command::new("sh").args(["-c", &format!("command -v {program}")]).output().expect("sh");
            assert!(
                there.status.success(),
                "{program} is missing: install {package} (./test.sh does), this test needs it"
            );
        }
        let screen = tempfile::tempdir().expect("a folder");
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp", "-noreset", "-fbdir"])
            .arg(screen.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb starts");
        let mut number = String::new();
        let mut out = server.stdout.take().expect("its output");
        let mut byte = [0];
        while out.read(&mut byte).expect("the number of the display") == 1 && byte[0] != b'\n' {
            number.push(byte[0].into());
        }
        assert!(!number.is_empty(), "Xvfb opened no display");
        Self { server, name: format!(":{number}"), screen }
    }

    /// What a program says on this display.
    fn run(&self, program: &str, arguments: &[&str]) -> String {
        let mut command = Command::new(program);
        let output = command.args(arguments).env("DISPLAY", &self.name).output().expect("it starts");
        String::from_utf8_lossy(&output.stdout).trim().to_owned()
    }

    fn xdotool(&self, arguments: &[&str]) -> String {
        self.run("xdotool", arguments)
    }

    /// Titles of the program's windows.
    fn title(&self) -> String {
        let window = self.window().unwrap_or_default();
        if window.is_empty() { window } else { self.xdotool(&["getwindowname", &window]) }
    }

    fn window(&self) -> Option<String> {
        let found = self.xdotool(&["search", "--name", "^Relevo"]);
        found.lines().last().map(String::from)
    }

    /// Share of the pixels of a part of the screen that have the colour of the panel.
    fn filled(&self, columns: Range<usize>, rows: Range<usize>) -> f64 {
        let bytes = std::fs::read(self.screen.path().join("Xvfb_screen0")).expect("the screen");
        // An X window dump: a header, colours, then rows of four bytes a pixel.
        let word = |at: usize| {
            u32::from_be_bytes(bytes[4 * at..4 * at + 4].try_into().expect("four bytes")) as usize
        };
        let (start, row) = (word(0) + 12 * word(19), word(12));
        assert_eq!((word(4), word(11)), (SCREEN_WIDTH, 32), "another screen");
        let count = (columns.len() * rows.len()) as f64;
        let pixels = rows.flat_map(|y| columns.clone().map(move |x| start + y * row + 4 * x));
        let filled = pixels.filter(|&at| bytes[at..at + 3].iter().all(|byte| byte.abs_diff(FILL) < 3));
        filled.count() as f64 / count
    }

    fn key(&self, key: &str) {
        self.xdotool(&["key", key]);
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// The program, ended with the test.
struct Program(Child);

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Program {
    fn start(display: &Display, folder: &Path, file: &Path, more: &[&str]) -> Self {
        let mut command = viewer();
        command.arg(file).args(["--size", "400x300"]).args(more).current_dir(folder);
        command.env("DISPLAY", &display.name).env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
        Self(command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the program starts"))
    }

    /// Waits for the end; the exit code and what it said.
    fn end(mut self) -> (Option<i32>, String) {
        let begun = Instant::now();
        while self.0.try_wait().expect("its state").is_none() {
            assert!(begun.elapsed() < Duration::from_secs(20), "it does not end");
            std::thread::sleep(Duration::from_millis(50));
        }
        let mut errors = String::new();
        let _ = self.0.stderr.take().expect("its words").read_to_string(&mut errors);
        (self.0.wait().expect("its state").code(), errors)
    }
}

/// Waits until something is so.
fn wait(what: &str, mut so: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !so() {
        assert!(begun.elapsed() < Duration::from_secs(25), "{what} did not come about");
        std::thread::sleep(Duration::from_millis(100));
    }
}

#[test]
fn it_opens_reacts_to_keys_and_closes_clean() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = fixture(folder.path(), "rmnp_dem_uint16.tif", 32, 8);
    let display = Display::open();
    let program = Program::start(&display, folder.path(), &file, &[]);
    wait("a title with figures", || display.title().contains("triangles"));
    let title = display.title();
    for word in ["fixture.rlv", "fps", "tiles", "patches", "MB", "of 1.00 px"] {
        assert!(title.contains(word), "{title}");
    }
    display.xdotool(&["windowfocus", "--sync", &display.window().expect("a window")]);
    display.key("minus");
    wait("a smaller tolerance in the title", || display.title().contains("of 0.80 px"));
    for key in ["h", "3", "f", "b", "bracketright"] {
        display.key(key);
    }
    display.key("l");
    wait("a frozen selection", || display.title().contains("frozen"));
    display.key("l");
    wait("a selection that follows", || !display.title().contains("frozen"));
    display.key("p");
    let picture = folder.path().join("relevo-picture-001.png");
    wait("the picture", || {
        picture.exists() && std::fs::metadata(&picture).is_ok_and(|file| file.len() > 100)
    });
    // Nothing lies over the picture while the mouse drags it.
    display.key("h");
    display.key("Tab");
    record(&display, folder.path());
    display.xdotool(&["windowsize", &display.window().expect("a window"), "500", "350"]);
    std::thread::sleep(Duration::from_millis(500));
    display.key("Escape");
    let (code, errors) = program.end();
    assert_eq!(code, Some(0), "{errors}");
    assert!(errors.contains("relevo-picture-001.png") && errors.contains("relevo-path-001.json"), "{errors}");
    assert!(!errors.contains("panicked"), "{errors}");
    assert!(covered(&picture) > 0.05);
    follow(folder.path(), &file);
}

#[test]
fn a_click_in_the_panel_acts_while_it_is_open() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = fixture(folder.path(), "rmnp_dem_uint16.tif", 32, 8);
    let display = Display::open();
    let program = Program::start(&display, folder.path(), &file, &[]);
    wait("a title with figures", || display.title().contains("of 1.00 px"));
    display.xdotool(&["windowfocus", "--sync", &display.window().expect("a window")]);
    // Wide and high enough for all switches.
    display.xdotool(&["windowsize", "--sync", &display.window().expect("a window"), "700", "560"]);
    let panel = || display.filled(480..680, 10..360);
    wait("the panel", || panel() > 0.4);
    let freeze =
        || display.xdotool(&["mousemove", "473", "317", "sleep", "0.5", "click", "1", "sleep", "0.5"]);
    display.key("Tab");
    wait("a closed panel", || panel() < 0.05);
    freeze();
    display.key("minus");
    wait("a smaller tolerance in the title", || display.title().contains("of 0.80 px"));
    assert!(!display.title().contains("frozen"), "a closed panel acts: {}", display.title());
    display.key("Tab");
    wait("an open panel", || panel() > 0.4);
    freeze();
    wait("a frozen selection", || display.title().contains("frozen"));
    display.key("l");
    wait("keys that act beside the panel", || !display.title().contains("frozen"));
    display.key("Escape");
    let (code, errors) = program.end();
    assert!(code == Some(0) && !errors.contains("panicked"), "{code:?} {errors}");
}

#[test]
fn the_panel_the_help_and_the_messages_are_seen() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = fixture(folder.path(), "rmnp_dem_uint16.tif", 32, 8);
    let display = Display::open();
    let program = Program::start(&display, folder.path(), &file, &[]);
    wait("a title with figures", || display.title().contains("of 1.00 px"));
    display.xdotool(&["windowfocus", "--sync", &display.window().expect("a window")]);
    display.xdotool(&["windowsize", "--sync", &display.window().expect("a window"), "800", "600"]);
    let panel = || display.filled(590..780, 10..400);
    let help = || display.filled(15..250, 15..300);
    let messages = || display.filled(10..200, 560..590);
    wait("the panel", || panel() > 0.4);
    wait("the hint", || messages() > 0.4);
    assert!(help() < 0.05, "a help that nobody asked for: {}", help());
    display.key("h");
    wait("the help", || help() > 0.4);
    display.key("Tab");
    wait("a closed panel", || panel() < 0.05);
    assert!(help() > 0.4, "the help is closed too");
    display.key("h");
    wait("a closed help", || help() < 0.05);
    // The hint is gone with the first key, and the name of the adapter after a while.
    wait("the end of the messages", || messages() < 0.05);
    display.key("Escape");
    let (code, errors) = program.end();
    assert!(code == Some(0) && !errors.contains("panicked"), "{code:?} {errors}");
}

/// Records a path while flying and orbiting.
fn record(display: &Display, folder: &Path) {
    display.key("r");
    wait("the recording", || display.title().contains("recording"));
    display.xdotool(&["keydown", "w"]);
    std::thread::sleep(Duration::from_millis(800));
    display.xdotool(&["keyup", "w"]);
    display.xdotool(&[
        "mousemove",
        "200",
        "150",
        "mousedown",
        "1",
        "mousemove",
        "260",
        "170",
        "mouseup",
        "1",
        "click",
        "4",
    ]);
    display.key("o");
    display.xdotool(&[
        "mousemove",
        "200",
        "150",
        "mousedown",
        "1",
        "mousemove",
        "230",
        "160",
        "mouseup",
        "1",
        "click",
        "5",
    ]);
    display.key("r");
    let path = folder.join("relevo-path-001.json");
    wait("the camera path", || path.exists());
}

/// What was recorded can be flown again, and the camera has moved on it.
fn follow(folder: &Path, file: &Path) {
    let path = folder.join("relevo-path-001.json");
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(&path).expect("path")).expect("JSON");
    let keys = json["keys"].as_array().expect("keys");
    let (first, last) = (keys.first().expect("a key"), keys.last().expect("a key"));
    assert!(first["eye"] != last["eye"], "{json}");
    let heading = |key: &serde_json::Value| {
        let along =
            |i: usize| key["target"][i].as_f64().expect("a place") - key["eye"][i].as_f64().expect("a place");
        along(0).atan2(along(1))
    };
    assert!((heading(first) - heading(last)).abs() > 0.1, "no drag has turned the camera: {json}");
    let mut command = viewer();
    command.arg(file).args(["--headless", "--count", "2", "--size", "64x48"]).arg("--path").arg(&path);
    common::run(&mut command, 0);
}

#[test]
fn a_window_that_is_closed_ends_the_program_and_bad_files_open_none() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = fixture(folder.path(), "rmnp_dem_uint16.tif", 32, 8);
    let display = Display::open();
    let program = Program::start(&display, folder.path(), &file, &["--target-fps", "20"]);
    wait("a title with figures", || display.title().contains("triangles"));
    display.xdotool(&["windowclose", &display.window().expect("a window")]);
    drop(program);
    let bad = folder.path().join("bad.rlv");
    std::fs::write(&bad, b"not a terrain").expect("write");
    let (code, errors) = Program::start(&display, folder.path(), &bad, &[]).end();
    assert!(code == Some(2) && errors.contains("bad.rlv"), "{code:?} {errors}");
    let mut command = viewer();
    command.arg(&file).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
    let (_, errors) = common::run(&mut command, 2);
    assert!(errors.contains("--headless"), "{errors}");
    // Nothing of the machine that it was compiled on.
    assert!(!errors.contains(".rs") && !errors.contains("registry"), "{errors}");
}
