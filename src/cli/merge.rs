//! `relevo merge`: finished windows to one file.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use relevo::pipeline;

use crate::cli::progress::{Mode, Show};
use crate::cli::{Outcome, build};

/// Join windows that `relevo build --window` has made, on one machine or many, into one .rlv file
#[derive(clap::Args)]
pub struct Args {
    /// The pieces, which must cover the raster
    #[arg(required = true, value_name = "PIECE")]
    pieces: Vec<PathBuf>,
    /// The file to make
    #[arg(short, long, value_name = "OUT.rlv")]
    output: PathBuf,
    /// Threads [default: one for each core]
    #[arg(long, short, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Replace OUT.rlv if it is there
    #[arg(long, short)]
    force: bool,
    /// How to show progress
    #[arg(long, value_enum, default_value = "auto")]
    progress: Mode,
    /// The report as JSON
    #[arg(long)]
    json: bool,
}

/// Merges.
pub fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let show = Show::new(args.progress);
    let report = pipeline::merge(&args.pieces, &args.output, args.jobs.map(usize::from), args.force, &show);
    show.finish();
    let report = report?;
    if args.json {
        serde_json::to_writer_pretty(&mut *out, &build::json(&report, &args.output))
            .map_err(std::io::Error::from)?;
        writeln!(out)?;
    } else {
        build::print(&report, &args.output, out)?;
    }
    Ok(ExitCode::SUCCESS)
}
