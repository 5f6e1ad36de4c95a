//! How far a build is: a bar on a terminal, a line now and then in a log, JSON lines for machines.

use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use relevo::pipeline::{Observer, Stage};
use serde_json::json;

use crate::cli::{stopped, table};

/// How to show progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Mode {
    /// A bar if stderr is a terminal, else a line every ten seconds
    Auto,
    /// One JSON object a line on stderr
    Json,
    /// Nothing
    None,
}

/// Seconds between two lines in a log, and between two JSON objects.
const LOG_EVERY: Duration = Duration::from_secs(10);
const JSON_EVERY: Duration = Duration::from_millis(250);

/// An observer that shows.
pub struct Show {
    mode: Mode,
    bar: Option<ProgressBar>,
    state: Mutex<State>,
}

struct State {
    stage: Option<Stage>,
    stage_start: Instant,
    last_line: Instant,
    /// Said after the name of the stage.
    note: String,
}

impl Show {
    /// Starts the clock.
    pub fn new(mode: Mode) -> Self {
        let bar = (mode == Mode::Auto && std::io::stderr().is_terminal()).then(|| {
            let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
            let style = "{msg:7} [{bar:40}] {percent:>3} %  {elapsed} elapsed, {eta} left";
            bar.set_style(
                ProgressStyle::with_template(style).unwrap_or_else(|_| ProgressStyle::default_bar()),
            );
            bar
        });
        let now = Instant::now();
        let state = State { stage: None, stage_start: now, last_line: now, note: String::new() };
        Self { mode, bar, state: Mutex::new(state) }
    }

    /// Words that go with the progress from now on.
    pub fn note(&self, note: &str) {
        if let Ok(mut state) = self.state.lock() {
            note.clone_into(&mut state.note);
        }
    }

    /// A line on stderr, above the bar if there is one.
    pub fn say(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| {
                let _ = writeln!(std::io::stderr(), "{line}");
            }),
            None => {
                let _ = writeln!(std::io::stderr(), "{line}");
            }
        }
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    fn line(&self, (stage, note): (Stage, &str), done: u64, total: u64, elapsed: f64) {
        // Rows cost about the same each, so the rest takes as long a row as what is done.
        let left = if done > 0 { elapsed * (total - done) as f64 / done as f64 } else { f64::NAN };
        let mut err = std::io::stderr().lock();
        let _ = if self.mode == Mode::Json {
            writeln!(
                err,
                "{}",
                json!({ "stage": name(stage), "note": Some(note).filter(|note| !note.is_empty()),
                        "done": done, "total": total, "seconds": elapsed, "seconds_left": if left.is_finite() { Some(left) } else { None } })
            )
        } else {
            let percent = 100.0 * done as f64 / total.max(1) as f64;
            let (elapsed, left) = (table::seconds(elapsed), table::seconds(left));
            let stage = [name(stage), note].join(" ");
            writeln!(err, "relevo: {} {percent:.0} %, {elapsed} elapsed, about {left} left", stage.trim_end())
        };
    }
}

fn name(stage: Stage) -> &'static str {
    match stage {
        Stage::Scan => "scan",
        Stage::Build => "build",
        Stage::Merge => "merge",
        Stage::Imagery => "imagery",
        Stage::Write => "write",
    }
}

impl Observer for Show {
    fn rows(&self, stage: Stage, done: u64, total: u64) {
        let Ok(mut state) = self.state.lock() else { return };
        if state.stage != Some(stage) {
            state.stage = Some(stage);
            state.stage_start = Instant::now();
            if let Some(bar) = &self.bar {
                bar.reset();
            }
        }
        if let Some(bar) = &self.bar {
            bar.set_message([name(stage), &state.note].join(" "));
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
            self.line((stage, &state.note), done, total, elapsed);
        }
    }

    fn cancelled(&self) -> bool {
        stopped()
    }
}
