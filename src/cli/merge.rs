//! `relevo merge`: finished windows to one file.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use relevo::pipeline;
use serde_json::json;

use crate::cli::build::size;
use crate::cli::progress::{Mode, Show};
use crate::cli::warnings::{say, told};
use crate::cli::{Outcome, build, json, voice};

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
    /// Keep within this much memory (256MiB, 2GiB); refuse before the work if it takes more
    #[arg(long, value_name = "SIZE", value_parser = size)]
    memory: Option<u64>,
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
    build::check_name(&args.output)?;
    let show = Show::new(args.progress);
    let jobs = args.jobs.map(usize::from);
    let report = pipeline::merge_within(args.memory, &args.pieces, &args.output, jobs, args.force, &show);
    show.finish();
    let mut report = report?;
    // The windows were built with their warnings told: what is new are those of the values of all.
    report.warnings = told(&report.warnings);
    say(&report.warnings);
    if args.json {
        let pieces = json!({ "pieces": json::paths(&args.pieces) });
        json::print(&json::object("merge", json::joined([pieces, build::json(&report, &args.output)])), out)?;
    } else if !voice::quiet() {
        build::print(&report, &args.output, out)?;
    }
    Ok(ExitCode::SUCCESS)
}
