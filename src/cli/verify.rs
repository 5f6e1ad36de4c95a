//! `relevo verify`: checks a file and prints the problems found; `verify_mesh` does so for a mesh.

use std::io::{self, IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use indicatif::{ProgressBar, ProgressStyle};
use relevo::Error;
use relevo::container::reader::{Reader, ReaderOptions};
use relevo::progress::{Progress, Stage};
use relevo::source::Source;
use relevo::verify::{Check, Ratios, VerifyOptions, VerifyReport, refused, verify};
use serde_json::json;

use crate::cli::build::size;
use crate::cli::dem::{Dem, SourceArgs};
use crate::cli::table::{Table, count, grouped, plural, short, wrapped};
use crate::cli::verify_mesh::{self, MeshArgs, is_mesh};
use crate::cli::warnings::{print_warnings, with_options};
use crate::cli::{Outcome, inputs, json, shown, stopped, voice};

/// Check a file: checksums, structure, invariants; also against its source, and every error by
/// brute force. Check a mesh against its terrain, between samples too
#[derive(clap::Args)]
pub struct Args {
    /// The .rlv file, or a mesh of anyone (.glb, .obj, .ply, .stl)
    #[arg(value_name = "FILE")]
    pub(super) file: PathBuf,
    /// Compare every sample with the DEM that the file was built from; a mesh, with a DEM or a .rlv
    /// file
    #[arg(long, value_name = "DEM", num_args = 1..)]
    pub(super) source: Vec<PathBuf>,
    /// Recompute every error by brute force, with all samples of the finest level in memory
    #[arg(long)]
    pub(super) deep: bool,
    /// Print up to N problems of each check; all are counted
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub(super) show: usize,
    /// Use at most this much memory, such as 256MiB or 2GiB; slower with fewer rows compared at a
    /// time, and refused at the start if it is not enough
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) memory: Option<u64>,
    /// Print the report as JSON
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    pub(super) reading: SourceArgs,
    #[command(flatten)]
    pub(super) mesh: MeshArgs,
    /// True after a build, which has already printed the warnings.
    #[arg(skip)]
    built: bool,
}

impl Args {
    /// The arguments for checking a file that has just been built.
    pub fn after_build(file: PathBuf, dem: &Dem, (reading, memory): (&SourceArgs, Option<u64>)) -> Self {
        let (source, reading) = (dem.dems.clone(), reading.clone());
        let mesh = MeshArgs::default();
        Self { file, source, reading, mesh, memory, deep: false, show: 10, json: false, built: true }
    }
}

/// Checks the file and prints the report; the exit code is 0 if there is no problem, else 1.
pub fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    if is_mesh(&args.file) {
        return verify_mesh::run(args, out);
    }
    if let Some(option) = args.mesh.given() {
        return Err(Error::usage(format!(
            "{option} is for a mesh (.glb, .obj, .ply, .stl), not for a .rlv file"
        ))
        .into());
    }
    let report = match Reader::open_with(&args.file, ReaderOptions::within(args.memory)) {
        Ok(reader) => check(args, &reader)?,
        Err(error) => refused(error)?,
    };
    if args.json {
        let all = json!({
            "file": json::path(&args.file), "good": report.is_good(), "problems": report.problems(),
            "checks": report.checks, "tightness": report.tightness,
        });
        json::print(&json::object("verify", all), out)?;
    } else {
        print(args, &report, out)?;
    }
    Ok(if report.is_good() { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// The bar on a terminal.
pub(super) struct Bar(Option<ProgressBar>);

impl Bar {
    pub fn new() -> Self {
        let bar = (io::stderr().is_terminal() && !voice::quiet()).then(|| {
            let style = ProgressStyle::with_template("{msg:8} [{bar:40}] {percent:>3} %  {elapsed} elapsed");
            ProgressBar::new(0).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        });
        Self(bar)
    }

    /// Removes it from the terminal.
    pub fn finish(&self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
}

impl Progress for Bar {
    fn report(&self, stage: Stage, done: u64, total: u64) {
        if let Some(bar) = &self.0 {
            bar.set_message(stage.as_str());
            bar.set_length(total);
            bar.set_position(done);
        }
    }

    fn is_cancelled(&self) -> bool {
        stopped()
    }
}

fn check(args: &Args, reader: &Reader) -> relevo::Result<VerifyReport> {
    let dems = inputs::expand(&args.source)?;
    let source = (!dems.is_empty()).then(|| args.reading.open(&dems)).transpose()?;
    if let Some(source) = source.as_ref().filter(|_| !args.built) {
        print_warnings(&with_options(&source.info().warnings));
    }
    let options = VerifyOptions { deep: args.deep, keep: args.show, ..VerifyOptions::default() };
    let bar = Bar::new();
    let report = verify(reader, source.as_deref().map(|source| source as &dyn Source), &options, &bar);
    bar.finish();
    report
}

fn print(args: &Args, report: &VerifyReport, out: &mut dyn Write) -> io::Result<()> {
    if !voice::quiet() {
        let mut table = Table::new(&["check", "looked at", "problems"]).words(0);
        for check in &report.checks {
            let problems = if check.problems == 0 { "none".to_owned() } else { grouped(check.problems) };
            let seen = format!("{} {}", grouped(check.looked_at), check.unit);
            table.row(vec![check.name.to_owned(), seen, problems]);
        }
        table.print(out)?;
    }
    for check in &report.checks {
        print_problems(check, out)?;
    }
    if !report.tightness.is_empty() && !voice::quiet() {
        print_tightness(report, out)?;
    }
    let name = shown(&args.file);
    match report.problems() {
        0 if voice::quiet() => Ok(()),
        0 => writeln!(out, "\n{name}: good"),
        count => writeln!(out, "\n{name}: {}", plural(count, "problem", "problems")),
    }
}

fn print_problems(check: &Check, out: &mut dyn Write) -> io::Result<()> {
    if !check.note.is_empty() {
        writeln!(out, "\n{}", wrapped(&format!("{}: {}", check.name, check.note), 2))?;
    }
    if check.problems == 0 {
        return Ok(());
    }
    writeln!(out, "\n{}:", check.name)?;
    for problem in &check.first {
        writeln!(out, "{}", wrapped(&format!("  {problem}"), 4))?;
    }
    match check.problems - check.first.len() as u64 {
        0 => Ok(()),
        more => writeln!(out, "  and {} more", grouped(more)),
    }
}

fn print_tightness(report: &VerifyReport, out: &mut dyn Write) -> io::Result<()> {
    let title = "Stored error / true error, of patches whose true error is above 1/256 of the largest of their level and step. \
                 1 is exact. Step 0 draws every sample of its level, step 1 every 2nd, step 2 every 4th:";
    writeln!(out, "\n{}", wrapped(title, 0))?;
    let of_both = ["patches", "median", "p99", "max"];
    let heading: Vec<&str> = ["level", "step"].into_iter().chain(of_both).chain(of_both).collect();
    let mut table = Table::new(&heading).groups(&[(4, "vertical"), (4, "horizontal")]);
    let cells = |ratios: Option<Ratios>| match ratios {
        Some(r) => [count(r.patches), ratio(r.median), ratio(r.p99), ratio(r.max)],
        None => ["", "", "", ""].map(str::to_owned),
    };
    for row in &report.tightness {
        let start = [row.level.to_string(), row.step.to_string()];
        table.row(start.into_iter().chain(cells(row.vertical)).chain(cells(row.horizontal)).collect());
    }
    table.print(out)
}

/// A ratio to four digits if it is close to 1.
fn ratio(value: f64) -> String {
    if value < 9.9995 { format!("{value:.3}") } else { short(value) }
}
