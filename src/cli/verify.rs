//! `relevo verify`: what is wrong with a file, if anything.

use std::io::{self, IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use indicatif::{ProgressBar, ProgressStyle};
use relevo::container::reader::Reader;
use relevo::source::Source;
use relevo::verify::{Check, Progress, Ratios, VerifyOptions, VerifyReport, refused, verify};
use serde_json::json;

use crate::cli::dem::{Dem, SourceArgs};
use crate::cli::table::{Table, grouped, short};
use crate::cli::{Outcome, inputs, stopped};

/// Check a file: checksums, structure, invariants; against its source; every error by brute force
#[derive(clap::Args)]
pub struct Args {
    /// The .rlv file
    pub(super) file: PathBuf,
    /// The DEM it was built from: compare every sample
    #[arg(long, value_name = "DEM", num_args = 1..)]
    pub(super) source: Vec<PathBuf>,
    /// Recompute every error by brute force, at full resolution in memory
    #[arg(long)]
    pub(super) deep: bool,
    /// Problems to show of each check; all are counted
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub(super) show: usize,
    /// As JSON
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    pub(super) reading: SourceArgs,
}

impl Args {
    /// The check of a file that has just been built.
    pub fn after_build(file: PathBuf, dem: &Dem, reading: &SourceArgs) -> Self {
        let (source, reading) = (dem.dems.clone(), reading.clone());
        Self { file, source, reading, deep: false, show: 10, json: false }
    }
}

/// Checks, and says what was found: exit code 0 if all is good, 1 if not.
pub fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let report = match Reader::open(&args.file) {
        Ok(reader) => check(args, &reader)?,
        Err(error) => refused(error)?,
    };
    if args.json {
        let all = json!({
            "file": args.file, "good": report.is_good(), "problems": report.problems(),
            "checks": report.checks, "tightness": report.tightness,
        });
        serde_json::to_writer_pretty(&mut *out, &all).map_err(io::Error::from)?;
        writeln!(out)?;
    } else {
        print(args, &report, out)?;
    }
    Ok(if report.is_good() { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

fn check(args: &Args, reader: &Reader) -> relevo::Result<VerifyReport> {
    let dems = inputs::expand(&args.source)?;
    let source = (!dems.is_empty()).then(|| args.reading.open(&dems)).transpose()?;
    let options = VerifyOptions { deep: args.deep, keep: args.show, ..VerifyOptions::default() };
    let bar = io::stderr().is_terminal().then(|| {
        let style = ProgressStyle::with_template("{msg:8} [{bar:40}] {percent:>3} %  {elapsed} elapsed");
        ProgressBar::new(0).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
    });
    let mut watch = |progress: Progress| {
        if let Some(bar) = &bar {
            bar.set_message(progress.stage);
            bar.set_length(progress.total);
            bar.set_position(progress.done);
        }
        !stopped()
    };
    let report = verify(reader, source.as_deref().map(|source| source as &dyn Source), &options, &mut watch);
    if let Some(bar) = &bar {
        bar.finish_and_clear();
    }
    report
}

fn print(args: &Args, report: &VerifyReport, out: &mut dyn Write) -> io::Result<()> {
    let mut table = Table::new(&["check", "looked at", "", "problems"]);
    for check in &report.checks {
        let problems = if check.problems == 0 { "-".to_owned() } else { grouped(check.problems) };
        table.row(vec![check.name.to_owned(), grouped(check.looked_at), check.unit.to_owned(), problems]);
    }
    table.print(out)?;
    for check in &report.checks {
        print_problems(check, out)?;
    }
    if !report.tightness.is_empty() {
        print_tightness(report, out)?;
    }
    let name = args.file.display();
    match report.problems() {
        0 => writeln!(out, "\n{name}: good"),
        1 => writeln!(out, "\n{name}: 1 problem"),
        count => writeln!(out, "\n{name}: {} problems", grouped(count)),
    }
}

fn print_problems(check: &Check, out: &mut dyn Write) -> io::Result<()> {
    if !check.note.is_empty() {
        writeln!(out, "\n{}: {}", check.name, check.note)?;
    }
    if check.problems == 0 {
        return Ok(());
    }
    writeln!(out, "\n{}:", check.name)?;
    for problem in &check.first {
        writeln!(out, "  {problem}")?;
    }
    match check.problems - check.first.len() as u64 {
        0 => Ok(()),
        more => writeln!(out, "  and {} more", grouped(more)),
    }
}

fn print_tightness(report: &VerifyReport, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "\nStored error / true error (patches whose true error is above 1/256 of the largest)")?;
    let mut table = Table::new(&[
        "level",
        "step",
        "vertical: patches",
        "median",
        "p99",
        "max",
        "horizontal: patches",
        "median",
        "p99",
        "max",
    ]);
    let cells = |ratios: Option<Ratios>| match ratios {
        Some(r) => [grouped(r.patches), ratio(r.median), ratio(r.p99), ratio(r.max)],
        None => ["", "", "", ""].map(str::to_owned),
    };
    for row in &report.tightness {
        let start = [row.level.to_string(), row.step.to_string()];
        table.row(start.into_iter().chain(cells(row.vertical)).chain(cells(row.horizontal)).collect());
    }
    table.print(out)
}

/// Four digits where it is close to 1.
fn ratio(value: f64) -> String {
    if value < 9.9995 { format!("{value:.3}") } else { short(value) }
}
