//! The command line: one file a subcommand, each with `Args` and `run`. Data on stdout, talk on
//! stderr.
//!
//! Exit codes: 0 done, 1 the check found a problem, 2 could not do it; a reader that closes the
//! pipe is no error.

mod add;
mod build;
mod dem;
mod each;
mod export;
mod figures;
mod imagery;
mod info;
mod inputs;
mod json;
mod merge;
mod options;
mod origins;
mod place;
mod progress;
mod stats;
mod table;
mod verify;
mod voice;
mod warnings;

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use relevo::Error;
use relevo::text::{Plain, printable};

use self::voice::{Color, VoiceArgs};

/// Turns digital elevation models of any size into one tile-pyramid file (.rlv) with a proven
/// geometric error for every patch at every tessellation level.
#[derive(Parser)]
#[command(name = "relevo", version, arg_required_else_help = true, subcommand_required = true, after_help = AFTER)]
struct Cli {
    #[command(flatten)]
    voice: VoiceArgs,
    #[command(subcommand)]
    command: Command,
}

const AFTER: &str = "\
First steps:
  relevo build dem.tif                       makes dem.rlv
  relevo verify dem.rlv --source dem.tif     holds every sample against the DEM
  relevo stats dem.rlv                       how wrong it is, level by level
  relevo export dem.rlv -o relief.png        a picture of it
  relevo build --each out dems/              every DEM of a folder to a file

relevo COMMAND --help says what a command can do.
Exit codes: 0 done, 1 the check found a problem, 2 could not do it.";

/// Columns of help on a wide terminal.
const WIDEST_HELP: usize = 110;

#[derive(Subcommand)]
enum Command {
    /// Make a .rlv file from a DEM
    Build(Box<build::Args>),
    /// Join pieces made by `build --window` into one file
    Merge(merge::Args),
    /// Put imagery into a file, or other imagery in its place
    Add(add::Args),
    /// What a file is: coordinate system, levels, sections, sizes
    Info(info::Args),
    /// How wrong a file is, by level and tessellation step
    Stats(stats::Args),
    /// Check a file: checksums, structure, invariants; against its source; every error by brute
    /// force
    Verify(verify::Args),
    /// A level or a tile back to GeoTIFF or as a picture, of the heights or of the imagery
    Export(export::Args),
}

/// Why a command did not end well.
pub enum Failure {
    /// The library said so.
    Relevo(Error),
    /// So it did, but a build can go on from what is in this folder.
    Resumable(Error, PathBuf),
    /// Standard output did.
    Stdout(io::Error),
}

impl Failure {
    /// What to tell the user.
    pub fn message(self) -> String {
        match self {
            Self::Relevo(error) => options::named(&error.to_string()),
            Self::Resumable(error, folder) => {
                let error = options::named(&error.to_string());
                format!("{error}; what is done is kept in {}: --resume goes on from there", shown(&folder))
            }
            Self::Stdout(error) => format!("standard output: {error}"),
        }
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Relevo(error)
    }
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        Self::Stdout(error)
    }
}

/// A path as people see it.
pub fn shown(path: &Path) -> String {
    printable(&path.display().to_string()).into_owned()
}

/// A path as JSON has it: what is no Unicode of it is lost.
pub fn named(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// What a subcommand ends in.
pub type Outcome = Result<ExitCode, Failure>;

/// Set by Ctrl-C and SIGTERM; long work asks it between pieces.
static STOP: AtomicBool = AtomicBool::new(false);

/// True once the user asked to stop.
pub fn stopped() -> bool {
    STOP.load(Ordering::Relaxed)
}

/// Parses, runs, and turns the outcome into an exit code.
pub fn main() -> ExitCode {
    let width = table::width().min(WIDEST_HELP);
    let command = Cli::command().color(Color::asked().of_clap()).term_width(width);
    let parsed = Cli::from_arg_matches(&command.get_matches());
    let cli = parsed.unwrap_or_else(|error| error.exit());
    voice::set(cli.voice);
    // A second Ctrl-C ends the program at once.
    let handler = ctrlc::set_handler(|| {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(2);
        }
    });
    if let Err(error) = handler {
        voice::warning(&format!("Ctrl-C will not clean up: {error}"));
    }
    let mut out = Plain(io::BufWriter::new(io::stdout().lock()));
    let outcome = match &cli.command {
        Command::Build(args) => build::run(args, &mut out),
        Command::Merge(args) => merge::run(args, &mut out),
        Command::Add(args) => add::run(args, &mut out),
        Command::Info(args) => info::run(args, &mut out),
        Command::Stats(args) => stats::run(args, &mut out),
        Command::Verify(args) => verify::run(args, &mut out),
        Command::Export(args) => export::run(args, &mut out),
    };
    let outcome = outcome.and_then(|code| out.flush().map(|()| code).map_err(Failure::from));
    let message = match outcome {
        Ok(code) => return code,
        Err(Failure::Stdout(error)) if error.kind() == io::ErrorKind::BrokenPipe => return ExitCode::SUCCESS,
        Err(failure) => failure.message(),
    };
    voice::error(&message);
    ExitCode::from(2)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn the_arguments_of_all_commands_fit_together() {
        super::Cli::command().debug_assert();
    }
}
