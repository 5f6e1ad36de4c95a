//! `relevo mesh`: a triangle mesh of a file or of DEMs, with an error that it keeps.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use relevo::container::reader::Reader;
use relevo::mesh::check::Report as Found;
use relevo::mesh::{self, MeshOptions, MeshReport, Method, Target};
use relevo::mesh_file::Up;
use relevo::output::Inputs;
use relevo::source::cropped::Bbox;
use relevo::{Build, BuildOptions, Error, Rect};
use serde_json::json;

use crate::cli::build::size;
use crate::cli::dem::SourceArgs;
use crate::cli::progress::{Mode, Show};
use crate::cli::table::{self, bytes, grouped, plural, short, wrapped};
use crate::cli::verify_mesh::{after_mesh, metres, samples, up};
use crate::cli::warnings::{print_warnings, with_options};
use crate::cli::{Outcome, inputs, json, shown, voice};

/// Write a triangle mesh whose surface is nowhere off by more than you allow
#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "flags of a command line")]
pub struct Args {
    /// The .rlv file; or the DEM, or several on one grid to be joined
    #[arg(value_name = "FILE|DEM", required = true)]
    inputs: Vec<PathBuf>,
    /// Write this file; its ending says the format: .glb, .obj, .ply or .stl
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Most metres between the mesh and the terrain, anywhere, such as 2m
    #[arg(long, value_name = "METRES", value_parser = metres, required_unless_present = "triangles")]
    max_error: Option<f64>,
    /// Most triangles; the mesh has the least error that so many can keep
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..), conflicts_with = "max_error")]
    triangles: Option<u64>,
    /// Find triangles of any shape (tin), which are few, or right triangles (nested), which take
    /// less time and memory
    #[arg(long, value_enum, default_value = "tin")]
    method: Kind,
    /// Least angle of triangles of any shape, in degrees; 0 makes fewer and thinner ones
    #[arg(long, value_name = "DEGREES", default_value_t = mesh::LEAST_ANGLE, value_parser = angle)]
    min_angle: f64,
    /// Mesh only these samples: first column and row, columns, rows
    #[arg(long, value_name = "X,Y,W,H", value_parser = samples, conflicts_with = "bbox")]
    srcwin: Option<Rect>,
    /// Write coordinates in metres from the middle of the window (local), or those of the
    /// coordinate system (crs)
    #[arg(long, value_enum, default_value = "local")]
    frame: Frame,
    /// Take this axis as up [default: y in .glb, z in others]
    #[arg(long, value_name = "y|z", value_parser = up)]
    up: Option<Up>,
    /// Keep coordinates in 16 bits (.glb): columns and rows stay exact, and heights if whole steps
    /// fit
    #[arg(long)]
    quantize: bool,
    /// Leave out the check of the written file, which reads all of the terrain and holds the mesh
    /// in memory
    #[arg(long)]
    no_check: bool,
    /// Use N threads [default: one for each core]
    #[arg(long, short, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Use at most this much memory, such as 512MiB or 4GiB, for triangles of any shape and for the
    /// check: else they are refused, and it is left out [default: all of the machine's]
    #[arg(long, value_name = "SIZE", value_parser = size)]
    memory: Option<u64>,
    /// Replace the output if it exists
    #[arg(long, short)]
    force: bool,
    /// Choose how progress is shown
    #[arg(long, value_enum, default_value = "auto")]
    progress: Mode,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    reading: SourceArgs,
}

/// How triangles are found.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Kind {
    Tin,
    Nested,
}

fn angle(word: &str) -> Result<f64, String> {
    let angle = word.trim().parse().ok().filter(|angle| (0.0..=30.0).contains(angle));
    angle.ok_or_else(|| "expected degrees, 0 to 30".to_owned())
}

/// The coordinates of a mesh.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Frame {
    Local,
    Crs,
}

/// Makes the mesh, and prints what it is.
pub fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let start = Instant::now();
    let files = inputs::expand(&args.inputs)?;
    let named: Vec<PathBuf> = inputs::lists(&args.inputs).into_iter().chain(files.iter().cloned()).collect();
    Inputs::new(&named).check(&args.output)?;
    let folder = args.output.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
        return Err(Error::usage(format!("{}: there is no such folder to write to", shown(folder))).into());
    }
    if args.output.exists() && !args.force {
        let output = shown(&args.output);
        return Err(Error::usage(format!("{output}: exists already; --force replaces it")).into());
    }
    let show = Show::new(args.progress);
    let made = with_threads(args.jobs, || make(args, &files, &show));
    show.finish();
    let (report, found) = made??;
    let seconds = start.elapsed().as_secs_f64();
    if args.json {
        json::print(&json::object("mesh", describe(args, &report, found.as_ref(), seconds)), out)?;
    } else if !voice::quiet() {
        print(args, &report, found.as_ref(), seconds, out)?;
    }
    let keeps = found.is_none_or(|found| found.keeps(report.promised_m));
    Ok(if keeps { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// Runs work on as many threads as asked for.
fn with_threads<R: Send>(jobs: Option<u16>, work: impl FnOnce() -> R + Send) -> Result<R, Error> {
    let Some(jobs) = jobs else { return Ok(work()) };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs.into()).build();
    Ok(pool.map_err(|error| Error::usage(format!("cannot start {jobs} threads: {error}")))?.install(work))
}

/// Bytes that the check takes for each triangle (42 were measured of a GLB), and besides.
const CHECK_PER_TRIANGLE: u64 = 80;
const CHECK_BESIDES: u64 = 256 << 20;

/// Bytes of memory that the machine has.
#[cfg(target_os = "linux")]
fn machine_memory() -> u64 {
    let info = rustix::system::sysinfo();
    u64::from(info.mem_unit).saturating_mul(info.totalram as u64)
}

/// Other systems are not asked.
#[cfg(not(target_os = "linux"))]
fn machine_memory() -> u64 {
    u64::MAX
}

/// What has been made, and what the check of it has found.
type Made = (MeshReport, Option<Found>);

/// Makes the mesh of a .rlv file, or of one that is built for it and goes again.
fn make(args: &Args, files: &[PathBuf], show: &Show) -> Result<Made, Error> {
    let is_built = |path: &Path| path.extension().is_some_and(|end| end.eq_ignore_ascii_case("rlv"));
    if let [file] = files
        && is_built(file)
    {
        let only_box = SourceArgs { bbox: None, bbox_crs: None, ..args.reading.clone() };
        if let Some(option) = only_box.given() {
            return Err(Error::usage(format!(
                "{option} is for reading a DEM: a .rlv file has all of that in it"
            )));
        }
        return of_file(args, file, args.reading.bbox, show);
    }
    if files.iter().any(|file| is_built(file)) {
        return Err(Error::usage("a .rlv file must be the only input"));
    }
    let source = args.reading.open(files)?;
    print_warnings(&with_options(&source.info().warnings));
    let folder =
        args.output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let place = tempfile::Builder::new().prefix(".relevo-mesh-").tempdir_in(folder);
    let place = place.map_err(|error| Error::io(folder, "make a temporary folder in", error))?;
    let built = place.path().join("terrain.rlv");
    let options = BuildOptions { jobs: args.jobs.map(usize::from), ..BuildOptions::default() };
    let report = Build::new(&*source).options(options).progress(show).run(&built)?;
    // What the samples look like is known only now.
    show.aside(|| print_warnings(&with_options(&report.warnings[source.info().warnings.len()..])));
    of_file(args, &built, None, show)
}

/// Makes the mesh of a .rlv file.
fn of_file(args: &Args, file: &Path, bbox: Option<[f64; 4]>, show: &Show) -> Result<Made, Error> {
    let reader = Reader::open(file)?;
    let size = (reader.header().width, reader.header().height);
    let window = match bbox {
        Some(bounds) => {
            let bbox = Bbox { bounds, crs: args.reading.bbox_crs.clone() };
            Some(bbox.window(reader.geo(), size)?)
        }
        None => args.srcwin.clone(),
    };
    let frame = match args.frame {
        Frame::Local => mesh::Frame::Local,
        Frame::Crs => mesh::Frame::Crs,
    };
    let method = match args.method {
        Kind::Tin => Method::Free(args.min_angle),
        Kind::Nested => Method::Nested,
    };
    let memory = Some(args.memory.unwrap_or_else(machine_memory));
    // One of them is there: the parser sees to it.
    let target = match (args.triangles, args.max_error) {
        (Some(most), _) => Target::Triangles(most),
        (None, error) => Target::Error(error.unwrap_or_default()),
    };
    let options = MeshOptions {
        window,
        target,
        method,
        frame,
        up: args.up,
        quantise: args.quantize,
        memory,
        force: args.force,
    };
    let report = mesh::save(&reader, &args.output, &options, show)?;
    let needed = report.triangles.saturating_mul(CHECK_PER_TRIANGLE).saturating_add(CHECK_BESIDES);
    if args.no_check || memory.is_some_and(|memory| needed > memory) {
        return Ok((report, None));
    }
    let found = after_mesh(&args.output, &reader, (report.window.clone(), args.up), show)?;
    Ok((report, Some(found)))
}

fn describe(args: &Args, report: &MeshReport, found: Option<&Found>, seconds: f64) -> serde_json::Value {
    let Rect { columns, rows } = &report.window;
    json!({
        "sources": json::paths(&args.inputs), "file": json::path(&args.output), "bytes": report.bytes,
        "window": [columns.start, rows.start, columns.len(), rows.len()],
        "triangles": report.triangles, "vertices": report.vertices,
        "promised_m": report.promised_m, "found_m": found.map(|found| found.largest_m),
        "found_at": found.map(|found| found.at), "found_rmse_m": found.map(|found| found.rmse_m),
        "seconds": seconds,
    })
}

fn print(
    args: &Args,
    report: &MeshReport,
    found: Option<&Found>,
    seconds: f64,
    out: &mut dyn Write,
) -> std::io::Result<()> {
    let (wide, high) = (report.window.columns.len() as u64, report.window.rows.len() as u64);
    let all = 2 * (wide - 1) * (high - 1);
    let line = format!(
        "{}: {} and {} for {} x {} samples, {} % of the triangles between them; {} in {}.",
        shown(&args.output),
        plural(report.triangles, "triangle", "triangles"),
        plural(report.vertices, "vertex", "vertices"),
        grouped(wide),
        grouped(high),
        short(100.0 * report.triangles as f64 / all as f64),
        bytes(report.bytes),
        table::seconds(seconds)
    );
    writeln!(out, "{}", wrapped(&line, 0))?;
    let promise = format!("Promised: nowhere off by more than {} m.", short(report.promised_m));
    let line = match found {
        Some(found) => format!(
            "{promise} Found in the file, by other code: {} m at column {}, row {}; RMSE {} m.",
            short(found.largest_m),
            short(found.at[0]),
            short(found.at[1]),
            short(found.rmse_m)
        ),
        None => format!("{promise} The file has not been checked; `relevo verify` does it."),
    };
    writeln!(out, "{}", wrapped(&line, 0))
}
