//! Messages on standard error: errors, warnings and details, how many of them, and in which
//! colours.

use std::io::{self, Write};
use std::sync::OnceLock;

use anstream::{AutoStream, ColorChoice};

/// Bold red, as clap prints `error:`.
const ERROR: &str = "\x1b[1m\x1b[31m";
/// Bold yellow.
const WARNING: &str = "\x1b[1m\x1b[33m";
/// Back to plain text.
const PLAIN: &str = "\x1b[0m";

/// Options of every command.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
#[command(next_help_heading = "Messages")]
pub struct VoiceArgs {
    /// Print no progress and no report; errors, warnings and requested data (JSON, tables) remain
    #[arg(long, short, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Print more: durations of all stages, all sources, all sections
    #[arg(long, short, global = true)]
    verbose: bool,
    /// Choose when messages on standard error are coloured; auto: on a terminal, unless `NO_COLOR`
    /// is set
    #[arg(long, global = true, value_name = "WHEN", value_enum, default_value = "auto")]
    color: Color,
}

/// When messages are coloured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Color {
    /// On a terminal
    #[default]
    Auto,
    /// Always
    Always,
    /// Never
    Never,
}

impl Color {
    /// The colour option as found in the raw arguments, for errors in parsing them.
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

    /// The same choice for clap.
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

/// The options, set once when the command line has been parsed.
static VOICE: OnceLock<VoiceArgs> = OnceLock::new();

/// Sets the options for all messages.
pub fn set(args: VoiceArgs) {
    // Only the first call has an effect, and there is only one.
    let _ = VOICE.set(args);
}

fn voice() -> VoiceArgs {
    VOICE.get().copied().unwrap_or_else(|| VoiceArgs { color: Color::asked(), ..VoiceArgs::default() })
}

/// True if neither progress nor reports are printed.
pub fn quiet() -> bool {
    voice().quiet
}

/// True if details are printed.
pub fn verbose() -> bool {
    voice().verbose
}

/// Prints an error. If standard error is closed the message is lost.
pub fn error(message: &str) {
    print(ERROR, "", message);
}

/// Prints a warning.
pub fn warning(message: &str) {
    print(WARNING, "warning: ", message);
}

/// Prints a detail if `--verbose` is set.
pub fn detail(message: &str) {
    if verbose() {
        print("", "", message);
    }
}

fn print(colour: &str, kind: &str, message: &str) {
    let mut err = AutoStream::new(io::stderr().lock(), voice().color.choice());
    let plain = if colour.is_empty() { "" } else { PLAIN };
    let _ = writeln!(err, "{colour}relevo: {kind}{plain}{message}");
}
