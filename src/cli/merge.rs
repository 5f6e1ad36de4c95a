//! `relevo merge`: joins finished windows into one file.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use relevo::pipeline;
use serde_json::json;

use crate::cli::build::size;
use crate::cli::progress::{Mode, Show};
use crate::cli::warnings::{print_warnings, with_options};
use crate::cli::{Outcome, build, json, voice};

/// Join windows made by `relevo build --window`, on one machine or many, into one .rlv file
#[derive(clap::Args)]
pub struct Args {
    /// The windows, which together must cover the raster
    #[arg(required = true, value_name = "PIECE")]
    pieces: Vec<PathBuf>,
    /// Write this file
    #[arg(short, long, value_name = "OUT.rlv")]
    output: PathBuf,
    /// Use N threads [default: one for each core]
    #[arg(long, short, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Use at most this much memory, such as 256MiB or 2GiB; refused at the start if it is not
    /// enough
    #[arg(long, value_name = "SIZE", value_parser = size)]
    memory: Option<u64>,
    /// Replace OUT.rlv if it exists
    #[arg(long, short)]
    force: bool,
    /// Choose how progress is shown
    #[arg(long, value_enum, default_value = "auto")]
    progress: Mode,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

/// Merges the windows and prints the report.
pub fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    build::check_name(&args.output)?;
    let show = Show::new(args.progress);
    let jobs = args.jobs.map(usize::from);
    let report = pipeline::merge_within(args.memory, &args.pieces, &args.output, jobs, args.force, &show);
    show.finish();
    let mut report = report?;
    // Warnings of single windows were printed when these were built; only those about the whole
    // raster are new.
    report.warnings = with_options(&report.warnings);
    print_warnings(&report.warnings);
    if args.json {
        let pieces = json!({ "pieces": json::paths(&args.pieces) });
        json::print(&json::object("merge", json::joined([pieces, build::json(&report, &args.output)])), out)?;
    } else if !voice::quiet() {
        build::print(&report, &args.output, out)?;
    }
    Ok(ExitCode::SUCCESS)
}
