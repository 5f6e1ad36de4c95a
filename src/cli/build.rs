//! `relevo build`: a DEM to a container, with a report of what was made.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use relevo::Rect;
use relevo::container::layout::Metric;
use relevo::output::check_apart;
use relevo::pipeline::imagery::Imagery as Layer;
use relevo::pipeline::{self, BuildOptions, Report};
use relevo::source::{self, SourceInfo};
use relevo::work_folder::resumable;
use relevo::{Build, Error};
use serde_json::json;

use crate::cli::add::{layer_options, print_layer};
use crate::cli::dem::{Dem, SourceArgs};
use crate::cli::imagery::Imagery;
use crate::cli::origins;
use crate::cli::progress::{Mode, Show};
use crate::cli::table::{bytes, plural, seconds, short, wrapped};
use crate::cli::warnings::{refuse, say, told};
use crate::cli::{Failure, Outcome, each, inputs, json, shown, verify, voice};

mod dry;

/// Make a .rlv file from a DEM
#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of the command line")]
pub struct Args {
    #[command(flatten)]
    dem: Dem,
    /// The file to make [default: the (first) DEM's name with .rlv, in the current folder]
    #[arg(short, long, value_name = "OUT.rlv")]
    output: Option<PathBuf>,
    /// Every DEM to a file of its own in this folder; of a folder, all rasters in it (not in
    /// folders within); --resume passes over what is done and unchanged
    #[arg(long, value_name = "OUTDIR", conflicts_with_all = ["output", "window", "dry_run"])]
    each: Option<PathBuf>,
    /// Intervals of a tile: a power of two, 16 to 1024
    #[arg(long, default_value_t = 256, value_name = "N")]
    tile: u32,
    /// Intervals of a patch: a power of two, 4 to 64
    #[arg(long, default_value_t = 32, value_name = "N")]
    patch: u32,
    /// Geometric error: `bound` is never below the true deviation, `paper` is the one-step maximum
    /// of the papers
    #[arg(long, default_value = "bound", value_name = "bound|paper", value_parser = ["bound", "paper"])]
    metric: String,
    /// Quantise heights to this many metres (off by at most half of it); lossless without
    #[arg(long, value_name = "M")]
    precision: Option<f64>,
    /// Threads that work at the same time [default: one for each core]
    #[arg(long, short, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Replace OUT.rlv if it is there, and an unfinished build of it
    #[arg(long, short)]
    force: bool,
    /// Go on with an unfinished build of OUT.rlv; begin one if there is none
    #[arg(long)]
    resume: bool,
    /// Seconds between two checkpoints, from which --resume goes on
    #[arg(long, default_value_t = pipeline::CHECKPOINT.as_secs_f64(), value_name = "SECONDS", value_parser = interval)]
    checkpoint: f64,
    /// Keep within this much memory (256MiB, 2GiB), imagery included, by building strips one after
    /// the other if the DEM is wide; slower then
    #[arg(long, value_name = "SIZE", value_parser = size)]
    memory: Option<u64>,
    /// Build these tiles of the leaf level only, from column X0 and row Y0 up to X1 and Y1: OUT is
    /// then a piece for `relevo merge`
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = window, conflicts_with_all = ["dry_run", "verify", "json", "memory"])]
    window: Option<Rect>,
    /// Make an error of what is warned of, before OUT.rlv is there
    #[arg(long)]
    strict: bool,
    /// Say what would be made, and what time, memory and disk it takes; some tiles are tried for
    /// it, nothing is written
    #[arg(long)]
    dry_run: bool,
    /// Then check the file: checksums, structure, invariants, and every sample against the DEM
    #[arg(long, conflicts_with = "json")]
    pub(super) verify: bool,
    /// How to show progress
    #[arg(long, value_enum, default_value = "auto")]
    pub(super) progress: Mode,
    /// The report (or the plan) as JSON
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    pub(super) source: SourceArgs,
    #[command(flatten)]
    pub(super) imagery: Imagery,
}

/// Builds, or plans.
pub fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let dem = Dem { dems: inputs::expand(&args.dem.dems)? };
    let options = options(args, &dem);
    if (args.each.is_some() || args.window.is_some()) && !args.imagery.files.is_empty() {
        let what = "--imagery goes with one whole file: put it into others by `relevo add`";
        return Err(Error::usage(what).into());
    }
    if let Some(folder) = &args.each {
        return each::run(args, &dem.dems, folder, &options, out);
    }
    let output = output(args, &dem)?;
    if args.window.is_none() {
        check_name(&output)?;
    }
    let source = args.source.open(&dem.dems)?;
    let warnings = told(&source.info().warnings);
    say(&warnings);
    refuse(&warnings, args.strict)?;
    let plan = pipeline::plan(source.info(), &options)?;
    let pictures = args.imagery.open(&source.info().geo.crs, args.memory, args.strict)?;
    let layer = Layer { pictures: &pictures, options: layer_options(&args.imagery)? };
    let layer = Some(&layer).filter(|layer| !layer.pictures.is_empty());
    if args.dry_run {
        return dry::run((args, &dem), (&*source, layer), (&plan, &options), &output, out);
    }
    let show = Show::new(args.progress);
    if let Some(window) = &args.window {
        let done = Build::new(&*source).options(options).progress(&show).run_window(&output, window);
        show.finish();
        done.map_err(|error| failure(error, dem.first(), &output))?;
        if !voice::quiet() {
            let line = format!("{}: tiles {window}, to be joined by `relevo merge`", shown(&output));
            writeln!(out, "{}", wrapped(&line, 2))?;
        }
        return Ok(ExitCode::SUCCESS);
    }
    let build = Build::new(&*source).options(options).imagery(&pictures, layer_options(&args.imagery)?);
    let report = build.progress(&show).run(&output);
    show.finish();
    let mut report = report.map_err(|error| failure(error, dem.first(), &output))?;
    say(&told(&report.warnings[source.info().warnings.len()..]));
    report.warnings = told(&report.warnings);
    tell(args, (&dem, source.info()), (&report, &output), out)?;
    if args.verify {
        if !voice::quiet() {
            writeln!(out)?;
        }
        return verify::run(&verify::Args::after_build(output, &dem, (&args.source, args.memory)), out);
    }
    Ok(ExitCode::SUCCESS)
}

/// What the command line asks for.
fn options(args: &Args, dem: &Dem) -> BuildOptions {
    BuildOptions {
        tile: args.tile,
        patch: args.patch,
        metric: if args.metric == "paper" { Metric::Paper } else { Metric::Bound },
        precision_m: args.precision,
        // Of several files it has been applied to each as it was opened.
        nodata: args.source.nodata.filter(|_| dem.dems.len() == 1 || args.each.is_some()),
        strict: args.strict,
        jobs: args.jobs.map(usize::from),
        force: args.force,
        resume: args.resume,
        memory: args.memory,
        checkpoint: Some(Duration::from_secs_f64(args.checkpoint)),
    }
}

/// Says what was made, as it was asked for.
fn tell(
    args: &Args,
    (dem, info): (&Dem, &SourceInfo),
    (report, output): (&Report, &Path),
    out: &mut dyn Write,
) -> std::io::Result<()> {
    if args.json {
        let sources = json!({ "sources": json::paths(&dem.dems) });
        return json::print(&json::object("build", json::joined([sources, json(report, output)])), out);
    }
    if voice::quiet() {
        return Ok(());
    }
    writeln!(out, "{}", source_line(dem, info))?;
    print(report, output, out)?;
    report.imagery.as_ref().map_or(Ok(()), |layer| print_layer(layer, out))
}

/// Where to write: never over what is named on the command line. What that reads in its turn the
/// library knows.
fn output(args: &Args, dem: &Dem) -> Result<PathBuf, Error> {
    let output = match &args.output {
        Some(path) => path.clone(),
        None => output_name(dem.first()),
    };
    check_apart(&output, &named_inputs(args, &dem.dems))?;
    Ok(output)
}

/// Everything that the command line names to be read.
pub(super) fn named_inputs(args: &Args, dems: &[PathBuf]) -> Vec<PathBuf> {
    let lists = inputs::lists(&args.dem.dems);
    lists.into_iter().chain(dems.iter().chain(&args.imagery.files).cloned()).collect()
}

/// Fails unless a file of this name is what is made: another suffix would promise another format.
pub fn check_name(output: &Path) -> Result<(), Error> {
    if output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("rlv")) {
        return Ok(());
    }
    let (name, right) = (shown(output), shown(&output.with_extension("rlv")));
    Err(Error::usage(format!("{name}: expected a name that ends in .rlv, such as {right}")))
}

/// Name of the file that is made of a DEM unless told otherwise.
pub fn output_name(dem: &Path) -> PathBuf {
    let mut name = source::stem(dem);
    name.push(".rlv");
    PathBuf::from(name)
}

/// Errors without a path came from the raster. Where a state was left, the message says so.
pub fn failure(error: Error, dem: &Path, output: &Path) -> Failure {
    let error = error.at(dem);
    match resumable(output) {
        Some(folder) if !matches!(error, Error::Usage { .. }) => Failure::Resumable(error, folder),
        _ => Failure::Relevo(error),
    }
}

/// `--window X0,Y0,X1,Y1`.
fn window(text: &str) -> Result<Rect, String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x0, y0, x1, y1]) if x0 < x1 && y0 < y1 => Ok(Rect { columns: x0..x1, rows: y0..y1 }),
        _ => Err("expected four whole numbers X0,Y0,X1,Y1 with X0 < X1 and Y0 < Y1".to_owned()),
    }
}

/// `--memory SIZE`: bytes, or a number with a unit.
pub(super) fn size(text: &str) -> Result<u64, String> {
    let split = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let shift = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 0,
        "k" | "kb" | "kib" => 10,
        "m" | "mb" | "mib" => 20,
        "g" | "gb" | "gib" => 30,
        _ => return Err("expected a size such as 256MiB or 2GiB".to_owned()),
    };
    match number.parse::<f64>() {
        Ok(number) if number > 0.0 && number < 1e15 => Ok((number * f64::from(1_u32 << shift)) as u64),
        _ => Err("expected a size such as 256MiB or 2GiB".to_owned()),
    }
}

/// `--checkpoint SECONDS`.
fn interval(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..=1e6).contains(&seconds) => Ok(seconds),
        _ => Err("expected seconds, 0 to 1000000".to_owned()),
    }
}

/// What a raster is, in a line.
pub fn source_line(dem: &Dem, info: &SourceInfo) -> String {
    let crs = &info.geo.crs;
    let place = match (crs.epsg, crs.name.is_empty(), info.geo.transform) {
        (Some(code), _, _) => format!("EPSG:{code}"),
        (None, false, _) => crs.name.clone(),
        (None, true, Some(_)) => "no coordinate system".to_owned(),
        (None, true, None) => "not georeferenced".to_owned(),
    };
    let kind = info.sample_type.gdal_name();
    let (width, height) = (info.width, info.height);
    wrapped(&format!("{}: {width} x {height} {kind}, {place}; {}", dem.name(), info.description), 2)
}

/// Says what was made.
pub fn print(report: &Report, output: &Path, out: &mut dyn Write) -> std::io::Result<()> {
    let header = &report.header;
    // A sparse raster is as large as its tiles.
    let leaves = report.statistics.levels.last().map_or(0, |level| level.tiles) as f64;
    let side = f64::from(header.tile());
    let samples = (f64::from(header.width) * f64::from(header.height)).min(leaves * side * side);
    let length = report.file.file_bytes - report.file.imagery_bytes;
    let with = if report.imagery.is_some() {
        format!("{} with its imagery; the heights: ", bytes(report.file.file_bytes))
    } else {
        String::new()
    };
    let line = format!(
        "{}: {with}{}, {} bits a sample, {} of the raw samples",
        shown(output),
        bytes(length),
        short(length as f64 * 8.0 / samples),
        percent(length as f64 / (samples * header.source_type.bytes() as f64)),
    );
    writeln!(out, "{}", wrapped(&line, 2))?;
    if let Some(origins) = origins::line(&report.origins) {
        writeln!(out, "{}", wrapped(&format!("  found in {origins}"), 2))?;
    }
    writeln!(out)?;
    crate::cli::stats::levels_table(&report.statistics, header, out)?;
    let time = report.elapsed.as_secs_f64();
    let kept = if header.quantisation_error > 0.0 {
        format!(
            "heights off by at most {} m",
            short(header.quantisation_error * header.band_scale.abs() * header.unit_metres)
        )
    } else {
        "lossless".to_owned()
    };
    let rate = short(samples / time / 1e6);
    let tiles = plural(header.tile_count, "tile", "tiles");
    let line = format!("{tiles} in {}, {rate} million samples a second; {kept}", seconds(time));
    writeln!(out, "\n{}", wrapped(&line, 2))
}

fn percent(share: f64) -> String {
    format!("{} %", short(100.0 * share))
}

/// The same for machines.
pub fn json(report: &Report, output: &Path) -> serde_json::Value {
    let head = json!({ "file": json::path(output), "status": "built", "bytes": report.file.file_bytes });
    let rest = json!({
        "seconds": report.elapsed.as_secs_f64(), "origins": report.origins,
        "statistics": json::statistics(&report.statistics),
        "imagery": report.imagery.as_ref().map(json::layer), "warnings": report.warnings,
    });
    json::joined([head, json::lattice(&report.header), rest])
}
