//! The command line: one file for each subcommand, with `Args` and `run`. Data goes to stdout,
//! messages to stderr.
//!
//! Exit codes: 0 done, 1 the check found a problem, 2 could not do it. A closed pipe on stdout is
//! not an error.

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
mod mesh;
mod mesh_frame;
mod options;
mod origins;
mod place;
mod progress;
mod stats;
mod table;
mod verify;
mod verify_mesh;
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

/// Widest column of help text on a wide terminal.
const WIDEST_HELP: usize = 110;

#[derive(Subcommand)]
enum Command {
    /// Make a .rlv file from a DEM
    Build(Box<build::Args>),
    /// Join windows made by `relevo build --window` into one file
    Merge(merge::Args),
    /// Write a triangle mesh (GLB, OBJ, PLY, STL) whose surface is nowhere off by more than you
    /// allow
    Mesh(Box<mesh::Args>),
    /// Put imagery into a .rlv file, in place of any that it has
    Add(add::Args),
    /// Print what a file is: coordinate system, heights, levels, sections, sizes
    Info(info::Args),
    /// Print the errors of a file by level and tessellation step
    Stats(stats::Args),
    /// Check a file: checksums, structure, invariants; also against its source, and every error by
    /// brute force. Check a mesh against its terrain
    Verify(verify::Args),
    /// Write a level or a tile, of the heights or of the imagery, as a GeoTIFF or a PNG
    Export(export::Args),
}

/// The reason why a command failed.
pub enum Failure {
    /// An error of the library.
    Relevo(Error),
    /// An error of the library, with the work folder from which a build can be resumed.
    Resumable(Error, PathBuf),
    /// An error in writing to standard output.
    Stdout(io::Error),
}

impl Failure {
    /// The message for the user.
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

/// A path as text for people.
pub fn shown(path: &Path) -> String {
    printable(&path.display().to_string()).into_owned()
}

/// A path as JSON text; characters that are not Unicode are replaced.
pub fn named(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// The result of a subcommand.
pub type Outcome = Result<ExitCode, Failure>;

/// True after Ctrl-C or SIGTERM; long tasks check it between steps.
static STOP: AtomicBool = AtomicBool::new(false);

/// True if the user has asked the program to stop.
pub fn stopped() -> bool {
    STOP.load(Ordering::Relaxed)
}

/// Parses the command line, runs the command, and returns its exit code.
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
        Command::Mesh(args) => mesh::run(args, &mut out),
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
