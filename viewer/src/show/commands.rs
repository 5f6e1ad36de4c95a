//! The commands of keys and panel.

use std::path::{Path, PathBuf};
use std::time::Instant;

use relevo_core::Result;
use relevo_core::select::Levels;

use super::Show;
use crate::camera::{FOV, Mode};
use crate::gpu::RenderTarget;
use crate::gpu::target::save_png;
use crate::input::Command;
use crate::panel::Change;
use crate::path::{CameraPath, Key};
use crate::stage::{Drawing, PAINTS};

/// Seconds between two keys of a recorded path.
const KEY_EVERY: f64 = 0.25;

impl Show {
    /// Carries out the command of a key; returns false if it ends the program.
    pub fn obey(&mut self, command: Command) -> Result<bool> {
        self.quiet = 0;
        self.end_hint();
        match command {
            Command::Quit => {
                self.stop_recording();
                return Ok(false);
            }
            Command::Help => self.help = !self.help,
            Command::Tolerance(factor) => {
                self.tolerate(self.tolerance * factor);
                self.notice(format!("tolerance {:.2} pixels", self.tolerance));
            }
            Command::Exaggeration(factor) => {
                self.exaggerate(self.stage.scene.frame().exaggeration * factor);
                self.notice(format!("exaggeration {:.2}", self.stage.scene.frame().exaggeration));
            }
            Command::Paint(paint) => {
                self.look.paint = paint;
                let name = PAINTS.iter().find(|(_, other)| *other == paint).map_or("", |(name, _)| name);
                self.notice(format!("colours: {name}"));
            }
            Command::Wireframe => self.look.wireframe = !self.look.wireframe,
            Command::Borders => self.look.borders = !self.look.borders,
            Command::Freeze => self.freeze(),
            Command::Screenshot => self.screenshot()?,
            Command::Record if self.recording.is_some() => self.stop_recording(),
            Command::Record => {
                self.recording = Some((Instant::now(), Vec::new()));
                self.notice("recording the camera path".into());
            }
            Command::Mode => self.change_mode(),
            Command::Home => self.go_home()?,
            Command::Panel => self.panel.toggle(),
        }
        Ok(true)
    }

    fn tolerate(&mut self, pixels: f64) {
        self.tolerance = pixels.clamp(0.05, 100.0);
    }

    fn exaggerate(&mut self, factor: f64) {
        let before = self.stage.scene.frame().exaggeration;
        let after = factor.clamp(0.1, 50.0);
        let (low, high) = self.stage.scene.heights();
        let ground = self.stage.scene.ground().map(|metres| metres / before);
        self.stage.scene.exaggerate(after);
        self.rig.exaggerate(before, after, ground.unwrap_or(f64::from(low + high) / 2.0));
    }

    fn change_mode(&mut self) {
        self.rig.mode = if self.rig.mode == Mode::Fly { Mode::Orbit } else { Mode::Fly };
        if self.rig.mode == Mode::Orbit {
            // About the point where the direction of view meets the ground, if that is near.
            let down = -self.rig.forward()[2];
            let above = self.above();
            self.rig.distance = if down > 0.05 { above / down } else { 4.0 * above };
        }
        self.notice(if self.rig.mode == Mode::Fly { "flying".into() } else { "orbiting".into() });
    }

    fn freeze(&mut self) {
        if self.frozen.take().is_some() {
            self.notice("selection follows the camera".into());
            return;
        }
        let view = self.view();
        let plan = self.stage.scene.choose(&view, self.drawn_tolerance);
        let (frame, rule) = (self.stage.scene.frame(), self.stage.scene.rule());
        let levels = Levels::of(&plan.selection, frame, &view, self.drawn_tolerance, rule);
        self.frozen = Some((plan, levels));
        self.notice("selection is frozen".into());
    }

    fn stop_recording(&mut self) {
        // With the motion since the last frame, so that the path ends where the camera is now.
        self.drive(0.0);
        let pose = self.rig.pose(self.stage.scene.frame());
        let Some((begun, mut keys)) = self.recording.take() else { return };
        keys.push(Key { time: begun.elapsed().as_secs_f64(), pose });
        keys.dedup_by(|b, a| b.time <= a.time);
        let file = free_name(Path::new(""), "relevo-path", "json");
        let written = CameraPath::new(FOV, keys).and_then(|path| path.write(&file));
        self.say(match written {
            Ok(()) => format!("camera path: {}", file.display()),
            Err(error) => format!("no camera path: {error}"),
        });
    }

    /// Carries out a change of the panel.
    pub(super) fn change(&mut self, change: Change) -> Result<()> {
        self.quiet = 0;
        match change {
            Change::Tolerance(pixels) => self.tolerate(pixels),
            Change::Exaggeration(factor) => self.exaggerate(factor),
            Change::Obey(command) => drop(self.obey(command)?),
        }
        Ok(())
    }

    /// Adds the pose to the path that is recorded, if enough time has passed.
    pub(super) fn record(&mut self, now: Instant) {
        let pose = self.rig.pose(self.stage.scene.frame());
        let Some((begun, keys)) = &mut self.recording else { return };
        let time = (now - *begun).as_secs_f64();
        if keys.last().is_none_or(|key| time >= key.time + KEY_EVERY) {
            keys.push(Key { time, pose });
        }
    }

    fn screenshot(&mut self) -> Result<()> {
        let file = free_name(Path::new(""), "relevo-picture", "png");
        let size = self.canvas.size();
        let target = RenderTarget::new(&self.stage.gpu, size, self.canvas.format())?;
        let view = self.view();
        let chosen = match &self.frozen {
            Some((plan, _)) => plan.clone(),
            None => self.stage.scene.choose(&view, self.drawn_tolerance),
        };
        let levels = self.frozen.as_ref().map(|(_, levels)| levels);
        let drawing = Drawing { view: &view, tolerance: self.drawn_tolerance, look: self.look, levels };
        self.stage.draw(&chosen, &drawing, target.view(), size)?;
        // A device that is gone ends the program; a file that cannot be written does not.
        let pixels = target.read(&self.stage.gpu)?;
        self.say(match save_png(&file, size, &pixels, false) {
            Ok(()) => format!("picture: {}", file.display()),
            Err(error) => format!("no picture: {error}"),
        });
        Ok(())
    }
}

/// Returns the first path with a number that neither a file nor a link has.
fn free_name(folder: &Path, stem: &str, extension: &str) -> PathBuf {
    let names = (1..10_000).map(|number| folder.join(format!("{stem}-{number:03}.{extension}")));
    let mut free = names.filter(|name| name.symlink_metadata().is_err());
    free.next().unwrap_or_else(|| folder.join(format!("{stem}.{extension}")))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_free_name_is_neither_a_file_nor_a_link() {
        let folder = tempfile::tempdir().unwrap();
        let at = |number: u32| folder.path().join(format!("a-{number:03}.png"));
        std::fs::write(at(1), "").unwrap();
        std::os::unix::fs::symlink("a-001.png", at(2)).unwrap();
        std::os::unix::fs::symlink("nowhere", at(3)).unwrap();
        assert_eq!(free_name(folder.path(), "a", "png"), at(4));
        assert_eq!(free_name(Path::new(""), "a", "png"), Path::new("a-001.png"));
    }
}
