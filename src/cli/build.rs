//! `relevo build`: makes a container from a DEM and prints a report.

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
use crate::cli::warnings::{print_warnings, refuse, with_options};
use crate::cli::{Failure, Outcome, each, inputs, json, shown, verify, voice};

mod dry;

/// Make a .rlv file from a DEM
#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of the command line")]
pub struct Args {
    #[command(flatten)]
    dem: Dem,
    /// Write this file [default: the name of the (first) DEM with .rlv, in the current folder]
    #[arg(short, long, value_name = "OUT.rlv")]
    output: Option<PathBuf>,
    /// Build one file from every DEM, into this folder; a folder among the DEMs stands for the
    /// rasters directly in it, and --resume skips files that are up to date
    #[arg(long, value_name = "OUTDIR", conflicts_with_all = ["output", "window", "dry_run"])]
    each: Option<PathBuf>,
    /// Make tiles with this many intervals along a side: a power of two, 16 to 1024
    #[arg(long, default_value_t = 256, value_name = "N")]
    tile: u32,
    /// Make patches with this many intervals along a side: a power of two, 4 to 64
    #[arg(long, default_value_t = 32, value_name = "N")]
    patch: u32,
    /// Store this geometric error: `bound` is never below the true deviation, `paper` is the
    /// one-step maximum of the papers
    #[arg(long, default_value = "bound", value_name = "bound|paper", value_parser = ["bound", "paper"])]
    metric: String,
    /// Quantise heights to this many metres, off by at most half of it [default: lossless]
    #[arg(long, value_name = "M")]
    precision: Option<f64>,
    /// Build only the leaf tiles from column X0 and row Y0 up to, not including, X1 and Y1, as a
    /// piece for `relevo merge`
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = window, conflicts_with_all = ["dry_run", "verify", "json", "memory"])]
    window: Option<Rect>,
    /// Print what would be made, and its time, memory and disk space, estimated from some tiles;
    /// write nothing
    #[arg(long)]
    dry_run: bool,
    /// Check the finished file: checksums, structure, invariants, and every sample against the DEM
    #[arg(long, conflicts_with = "json")]
    pub(super) verify: bool,
    /// Use N threads [default: one for each core]
    #[arg(long, short, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Use at most this much memory, such as 256MiB or 2GiB, imagery included; slower if a wide
    /// DEM must be built in strips, one after the other
    #[arg(long, value_name = "SIZE", value_parser = size)]
    memory: Option<u64>,
    /// Replace OUT.rlv, or an unfinished build of it, if it exists
    #[arg(long, short)]
    force: bool,
    /// Continue an unfinished build of OUT.rlv, or begin one
    #[arg(long)]
    resume: bool,
    /// Save the state for --resume after every SECONDS
    #[arg(long, default_value_t = pipeline::CHECKPOINT.as_secs_f64(), value_name = "SECONDS", value_parser = interval)]
    checkpoint: f64,
    /// Treat warnings as errors, before OUT.rlv is there
    #[arg(long)]
    strict: bool,
    /// Choose how progress is shown
    #[arg(long, value_enum, default_value = "auto")]
    pub(super) progress: Mode,
    /// Print the report, or the plan, as JSON
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    pub(super) source: SourceArgs,
    #[command(flatten)]
    pub(super) imagery: Imagery,
}

/// Builds the file, or plans it with `--dry-run`.
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
    let warnings = with_options(&source.info().warnings);
    print_warnings(&warnings);
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
    print_warnings(&with_options(&report.warnings[source.info().warnings.len()..]));
    report.warnings = with_options(&report.warnings);
    print_result(args, (&dem, source.info()), (&report, &output), out)?;
    if args.verify {
        if !voice::quiet() {
            writeln!(out)?;
        }
        return verify::run(&verify::Args::after_build(output, &dem, (&args.source, args.memory)), out);
    }
    Ok(ExitCode::SUCCESS)
}

/// The options of the library that the command line gives.
fn options(args: &Args, dem: &Dem) -> BuildOptions {
    BuildOptions {
        tile: args.tile,
        patch: args.patch,
        metric: if args.metric == "paper" { Metric::Paper } else { Metric::Bound },
        precision_m: args.precision,
        // With several files `--nodata` was applied to each one as it was opened.
        nodata: args.source.nodata.filter(|_| dem.dems.len() == 1 || args.each.is_some()),
        strict: args.strict,
        jobs: args.jobs.map(usize::from),
        force: args.force,
        resume: args.resume,
        memory: args.memory,
        checkpoint: Some(Duration::from_secs_f64(args.checkpoint)),
    }
}

/// Prints the report as text or JSON.
fn print_result(
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

/// The path of the file to make, which is never one that the command line names as an input. The
/// library checks the files that these inputs refer to.
fn output(args: &Args, dem: &Dem) -> Result<PathBuf, Error> {
    let output = match &args.output {
        Some(path) => path.clone(),
        None => output_name(dem.first()),
    };
    check_apart(&output, &named_inputs(args, &dem.dems))?;
    Ok(output)
}

/// All files that the command line names as inputs: lists, DEMs and pictures.
pub(super) fn named_inputs(args: &Args, dems: &[PathBuf]) -> Vec<PathBuf> {
    let lists = inputs::lists(&args.dem.dems);
    lists.into_iter().chain(dems.iter().chain(&args.imagery.files).cloned()).collect()
}

/// Fails unless the name ends in `.rlv`: another suffix would promise another format.
pub fn check_name(output: &Path) -> Result<(), Error> {
    if output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("rlv")) {
        return Ok(());
    }
    let (name, right) = (shown(output), shown(&output.with_extension("rlv")));
    Err(Error::usage(format!("{name}: expected a name that ends in .rlv, such as {right}")))
}

/// The default name of the file made from a DEM.
pub fn output_name(dem: &Path) -> PathBuf {
    let mut name = source::stem(dem);
    name.push(".rlv");
    PathBuf::from(name)
}

/// The failure of a build: an error without a path is given that of the DEM, and the message names
/// the work folder if resuming the build would help.
pub fn failure(error: Error, dem: &Path, output: &Path) -> Failure {
    let error = error.at(dem);
    // These say themselves what to do.
    let is_told = matches!(
        error,
        Error::Usage { .. } | Error::Exists { .. } | Error::Unfinished { .. } | Error::Changed { .. }
    );
    match (resumable(output), error) {
        (Some(folder), error) if !is_told => Failure::Resumable(error, folder),
        (None, Error::Interrupted) => Failure::Relevo(Error::usage("interrupted; no output was written")),
        (_, error) => Failure::Relevo(error),
    }
}

/// Parses `--window X0,Y0,X1,Y1`.
fn window(text: &str) -> Result<Rect, String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x0, y0, x1, y1]) if x0 < x1 && y0 < y1 => Ok(Rect { columns: x0..x1, rows: y0..y1 }),
        _ => Err("expected four whole numbers X0,Y0,X1,Y1 with X0 < X1 and Y0 < Y1".to_owned()),
    }
}

/// Parses `--memory SIZE`: bytes, or a number with a unit.
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

/// Parses `--checkpoint SECONDS`.
fn interval(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..=1e6).contains(&seconds) => Ok(seconds),
        _ => Err("expected seconds, 0 to 1000000".to_owned()),
    }
}

/// One line about a raster: its size, type, format and coordinate system.
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

/// Prints the report of a build as text.
pub fn print(report: &Report, output: &Path, out: &mut dyn Write) -> std::io::Result<()> {
    let header = &report.header;
    // Bits per sample count the samples of the tiles: a sparse raster has far fewer than width x
    // height.
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

/// The report of a build as JSON.
pub fn json(report: &Report, output: &Path) -> serde_json::Value {
    let head = json!({ "file": json::path(output), "status": "built", "bytes": report.file.file_bytes });
    let rest = json!({
        "seconds": report.elapsed.as_secs_f64(), "origins": report.origins,
        "statistics": json::statistics(&report.statistics),
        "imagery": report.imagery.as_ref().map(json::layer), "warnings": report.warnings,
    });
    json::joined([head, json::lattice(&report.header), rest])
}
