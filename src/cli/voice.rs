//! What is said on standard error: errors, warnings, progress, details; how much of it, and in
//! which colours.

use std::io::{self, Write};
use std::sync::OnceLock;

use anstream::{AutoStream, ColorChoice};

/// Bold red, as clap writes `error:`.
const ERROR: &str = "\x1b[1m\x1b[31m";
/// Bold yellow.
const WARNING: &str = "\x1b[1m\x1b[33m";
/// As before.
const PLAIN: &str = "\x1b[0m";

/// The options that every command has.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
#[command(next_help_heading = "What is said")]
pub struct VoiceArgs {
    /// No progress and no report of what was made; errors, warnings and what was asked for (--json,
    /// tables) stay
    #[arg(long, short, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// More: how long each part took, all sources, all sections
    #[arg(long, short, global = true)]
    verbose: bool,
    /// Colours on standard error: auto is on a terminal, unless `NO_COLOR` is set
    #[arg(long, global = true, value_name = "WHEN", value_enum, default_value = "auto")]
    color: Color,
}

/// When to write in colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Color {
    /// On a terminal
    #[default]
    Auto,
    /// Everywhere
    Always,
    /// Nowhere
    Never,
}

impl Color {
    /// What the words of a command line ask for, before they are parsed: what is wrong with them is
    /// told in these colours.
    pub fn asked() -> Self {
        let words: Vec<String> = std::env::args_os()
            .map(|word| word.to_string_lossy().into_owned())
            .take_while(|word| word != "--")
            .collect();
        let value = |(at, word): (usize, &String)| match word.strip_prefix("--color") {
            Some("") => words.get(at + 1).cloned(),
            Some(value) => value.strip_prefix('=').map(str::to_owned),
            None => None,
        };
        match words.iter().enumerate().filter_map(value).next_back().as_deref() {
            Some("always") => Self::Always,
            Some("never") => Self::Never,
            _ => Self::Auto,
        }
    }

    /// As clap names it.
    pub fn of_clap(self) -> clap::ColorChoice {
        match self {
            Self::Auto => clap::ColorChoice::Auto,
            Self::Always => clap::ColorChoice::Always,
            Self::Never => clap::ColorChoice::Never,
        }
    }

    fn choice(self) -> ColorChoice {
        match self {
            Self::Auto => ColorChoice::Auto,
            Self::Always => ColorChoice::Always,
            Self::Never => ColorChoice::Never,
        }
    }
}

/// Set once, when the command line has been parsed.
static VOICE: OnceLock<VoiceArgs> = OnceLock::new();

/// From here on all that is said is said so.
pub fn set(args: VoiceArgs) {
    // The first word counts; nobody sets it twice.
    let _ = VOICE.set(args);
}

fn voice() -> VoiceArgs {
    VOICE.get().copied().unwrap_or_else(|| VoiceArgs { color: Color::asked(), ..VoiceArgs::default() })
}

/// True if neither progress nor reports are wanted.
pub fn quiet() -> bool {
    voice().quiet
}

/// True if details are wanted.
pub fn verbose() -> bool {
    voice().verbose
}

/// Says why a command, or one of its inputs, failed. Standard error may be gone: then nobody can be
/// told.
pub fn error(message: &str) {
    say(ERROR, "", message);
}

/// Says what is odd although the work goes on.
pub fn warning(message: &str) {
    say(WARNING, "warning: ", message);
}

/// Says something in passing, if details are wanted.
pub fn detail(message: &str) {
    if verbose() {
        say("", "", message);
    }
}

fn say(colour: &str, kind: &str, message: &str) {
    let mut err = AutoStream::new(io::stderr().lock(), voice().color.choice());
    let plain = if colour.is_empty() { "" } else { PLAIN };
    let _ = writeln!(err, "{colour}relevo: {kind}{plain}{message}");
}
