//! Progress of a build: a bar on a terminal, a line from time to time in a log, or JSON lines.

use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use relevo::progress::{Progress, Stage};
use serde_json::json;

use crate::cli::{stopped, table, voice};

/// How progress is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Mode {
    /// A bar if stderr is a terminal, else a line every ten seconds
    Auto,
    /// One JSON object a line on stderr
    Json,
    /// Nothing
    None,
}

/// Time between two lines in a log, and between two JSON objects.
const LOG_EVERY: Duration = Duration::from_secs(10);
const JSON_EVERY: Duration = Duration::from_millis(250);

/// Prints progress as the command line asks for.
pub struct Show {
    mode: Mode,
    bar: Option<ProgressBar>,
    state: Mutex<State>,
}

struct State {
    stage: Option<Stage>,
    stage_start: Instant,
    /// Rows done when the stage began: in a resumed build, those of the earlier run.
    before: u64,
    last_line: Instant,
    /// Text printed after the name of the stage.
    note: String,
}

impl Show {
    /// Starts the clock.
    pub fn new(mode: Mode) -> Self {
        let mode = if voice::quiet() && mode == Mode::Auto { Mode::None } else { mode };
        let bar = (mode == Mode::Auto && std::io::stderr().is_terminal()).then(|| {
            let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
            let style = "{msg:7} [{bar:40}] {percent:>3} %  {elapsed} elapsed, {eta} left";
            bar.set_style(
                ProgressStyle::with_template(style).unwrap_or_else(|_| ProgressStyle::default_bar()),
            );
            bar
        });
        let now = Instant::now();
        let state = State { stage: None, stage_start: now, before: 0, last_line: now, note: String::new() };
        Self { mode, bar, state: Mutex::new(state) }
    }

    /// Sets the text printed after the name of the stage.
    pub fn note(&self, note: &str) {
        if let Ok(mut state) = self.state.lock() {
            note.clone_into(&mut state.note);
        }
    }

    /// Runs `speak`, which prints to standard error, with the bar out of its way.
    pub fn aside(&self, speak: impl FnOnce()) {
        match &self.bar {
            Some(bar) => bar.suspend(speak),
            None => speak(),
        }
    }

    /// Prints the duration of the last stage if `--verbose` is set.
    fn print_stage_time(&self, state: &State) {
        let Some(stage) = state.stage else { return };
        let took = table::seconds(state.stage_start.elapsed().as_secs_f64());
        self.aside(|| voice::detail(&format!("{} took {took}", stage.as_str())));
    }

    /// Removes the bar.
    pub fn finish(&self) {
        if let Ok(mut state) = self.state.lock() {
            self.print_stage_time(&state);
            state.stage = None;
        }
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    fn line(&self, (stage, note): (Stage, &str), (before, done, total): (u64, u64, u64), elapsed: f64) {
        let left = seconds_left((before, done, total), elapsed);
        let mut err = std::io::stderr().lock();
        let _ = if self.mode == Mode::Json {
            writeln!(
                err,
                "{}",
                json!({ "stage": stage.as_str(), "note": Some(note).filter(|note| !note.is_empty()),
                        "done": done, "total": total, "seconds": elapsed, "seconds_left": left })
            )
        } else {
            let percent = 100.0 * done as f64 / total.max(1) as f64;
            let elapsed = table::seconds(elapsed);
            let left = left.map_or_else(String::new, |left| format!(", about {} left", table::seconds(left)));
            let stage = [stage.as_str(), note].join(" ");
            writeln!(err, "relevo: {} {percent:.0} %, {elapsed} elapsed{left}", stage.trim_end())
        };
    }
}

/// Estimated seconds left, at the rate so far; `None` before the first row is done.
fn seconds_left((before, done, total): (u64, u64, u64), elapsed: f64) -> Option<f64> {
    let (made, rest) = (done.checked_sub(before)?, total.saturating_sub(done));
    if rest == 0 {
        return Some(0.0);
    }
    (made > 0).then(|| elapsed * rest as f64 / made as f64)
}

impl Progress for Show {
    fn report(&self, stage: Stage, done: u64, total: u64) {
        let Ok(mut state) = self.state.lock() else { return };
        if state.stage != Some(stage) {
            self.print_stage_time(&state);
            state.stage = Some(stage);
            (state.stage_start, state.before) = (Instant::now(), done);
            if let Some(bar) = &self.bar {
                bar.reset();
                bar.set_position(done);
                bar.reset_eta();
            }
        }
        if let Some(bar) = &self.bar {
            bar.set_message([stage.as_str(), &state.note].join(" "));
            bar.set_length(total);
            bar.set_position(done);
            return;
        }
        let every = match self.mode {
            Mode::Json => JSON_EVERY,
            Mode::Auto => LOG_EVERY,
            Mode::None => return,
        };
        let last = self.mode == Mode::Json && done == total;
        if last || state.last_line.elapsed() >= every {
            state.last_line = Instant::now();
            let elapsed = state.stage_start.elapsed().as_secs_f64();
            self.line((stage, &state.note), (state.before, done, total), elapsed);
        }
    }

    fn is_cancelled(&self) -> bool {
        stopped()
    }
}

/// Shows nothing; stops a task when the program is told to stop.
pub struct UntilStopped;

impl Progress for UntilStopped {
    fn report(&self, _: Stage, _: u64, _: u64) {}

    fn is_cancelled(&self) -> bool {
        stopped()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_done_before_took_no_time_now() {
        assert_eq!(seconds_left((0, 25, 100), 10.0), Some(30.0));
        assert_eq!(seconds_left((20, 40, 100), 10.0), Some(30.0));
        assert_eq!(seconds_left((20, 20, 100), 1.0), None);
        assert_eq!(seconds_left((0, 100, 100), 1.0), Some(0.0));
        assert_eq!(seconds_left((50, 10, 100), 1.0), None);
    }
}
