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
}

impl Show {
    /// Starts the clock.
    pub fn new(mode: Mode) -> Self {
        let bar = (mode == Mode::Auto && std::io::stderr().is_terminal()).then(|| {
            let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
            let style = "{msg:5} [{bar:40}] {percent:>3} %  {elapsed} elapsed, {eta} left";
            bar.set_style(
                ProgressStyle::with_template(style).unwrap_or_else(|_| ProgressStyle::default_bar()),
            );
            bar
        });
        let now = Instant::now();
        Self { mode, bar, state: Mutex::new(State { stage: None, stage_start: now, last_line: now }) }
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    fn line(&self, stage: Stage, done: u64, total: u64, elapsed: f64) {
        // Rows cost about the same each, so the rest takes as long a row as what is done.
        let left = if done > 0 { elapsed * (total - done) as f64 / done as f64 } else { f64::NAN };
        let mut err = std::io::stderr().lock();
        let _ = if self.mode == Mode::Json {
            writeln!(
                err,
                "{}",
                json!({ "stage": name(stage), "done": done, "total": total, "seconds": elapsed,
                        "seconds_left": if left.is_finite() { Some(left) } else { None } })
            )
        } else {
            let percent = 100.0 * done as f64 / total.max(1) as f64;
            let (elapsed, left) = (table::seconds(elapsed), table::seconds(left));
            writeln!(err, "relevo: {} {percent:.0} %, {elapsed} elapsed, about {left} left", name(stage))
        };
    }
}

fn name(stage: Stage) -> &'static str {
    match stage {
        Stage::Scan => "scan",
        Stage::Build => "build",
        Stage::Merge => "merge",
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
            bar.set_message(name(stage));
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
            self.line(stage, done, total, state.stage_start.elapsed().as_secs_f64());
        }
    }

    fn cancelled(&self) -> bool {
        stopped()
    }
}
