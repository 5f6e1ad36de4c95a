//! `relevo verify MESH`: holds a mesh against its terrain and prints what was found.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use relevo::container::reader::Reader;
use relevo::mesh::check::{Allowed, Heights, Leaves, Options, Raster, Report, check};
use relevo::mesh_file::{self, Mesh, Up};
use relevo::{Error, Geo, Rect};
use serde_json::json;

use crate::cli::mesh_frame::{self, About, Frame, Placed};
use crate::cli::table::{Table, count, grouped, plural, short, wrapped};
use crate::cli::verify::{Args, Bar};
use crate::cli::warnings::{print_warnings, with_options};
use crate::cli::{Outcome, inputs, json, shown, voice};

/// Options for a mesh.
#[derive(clap::Args, Default)]
#[command(next_help_heading = "Checking a mesh")]
pub struct MeshArgs {
    /// Take coordinates as this: local (metres, as the mesh itself says; if it does not, those of
    /// `relevo mesh` for all of --source, or for --srcwin), crs (of the coordinate system of
    /// --source), pixel (columns and rows of sample centres, rows southward) or pixel-north (rows
    /// counted northward from the last, as hmm writes) [default: local, if the mesh says it]
    #[arg(long, value_name = "local|crs|pixel|pixel-north", value_parser = frame)]
    frame: Option<Frame>,
    /// Take this axis as up [default: as the format has it]
    #[arg(long, value_name = "y|z", value_parser = up)]
    up: Option<Up>,
    /// Divide the heights of the mesh by this exaggeration [default: 1]
    #[arg(long, value_name = "F", value_parser = factor)]
    z_scale: Option<f64>,
    /// Fail if the mesh is off by more, such as 2m [default: what the mesh itself promises]
    #[arg(long, value_name = "METRES", value_parser = metres)]
    max_error: Option<f64>,
    /// Samples that the mesh has to cover: first column and row, columns, rows [default: as the
    /// mesh says, else those under it]
    #[arg(long, value_name = "X,Y,W,H", value_parser = samples)]
    srcwin: Option<Rect>,
}

impl MeshArgs {
    /// The first of the options that was given.
    pub fn given(&self) -> Option<&'static str> {
        let all = [
            (self.frame.is_some(), "--frame"),
            (self.up.is_some(), "--up"),
            (self.z_scale.is_some(), "--z-scale"),
            (self.max_error.is_some(), "--max-error"),
            (self.srcwin.is_some(), "--srcwin"),
        ];
        all.into_iter().find_map(|(given, name)| given.then_some(name))
    }
}

/// True if a file is a mesh by the ending of its name.
pub fn is_mesh(file: &Path) -> bool {
    let ending = file.extension().map(|end| end.to_string_lossy().to_lowercase()).unwrap_or_default();
    ["glb", "obj", "ply", "stl"].contains(&ending.as_str())
}

fn frame(word: &str) -> Result<Frame, String> {
    Frame::named(word).ok_or_else(|| "expected local, crs, pixel or pixel-north".to_owned())
}

pub(super) fn up(word: &str) -> Result<Up, String> {
    match word {
        "y" | "Y" => Ok(Up::Y),
        "z" | "Z" => Ok(Up::Z),
        _ => Err("expected y or z".to_owned()),
    }
}

fn factor(word: &str) -> Result<f64, String> {
    let factor = word.trim().parse().ok().filter(|&factor: &f64| factor > 0.0 && factor.is_finite());
    factor.ok_or_else(|| "expected a number above 0".to_owned())
}

pub(super) fn metres(word: &str) -> Result<f64, String> {
    let word = word.trim();
    let end = word.find(|c: char| c.is_ascii_alphabetic() && !matches!(c, 'e' | 'E')).unwrap_or(word.len());
    let (number, unit) = word.split_at(end);
    let unit = match unit {
        "" | "m" => Some(1.0),
        "cm" => Some(0.01),
        "mm" => Some(0.001),
        "km" => Some(1000.0),
        "ft" => Some(0.3048),
        _ => None,
    };
    let number: Option<f64> = number.trim_end().parse().ok();
    let metres = number.zip(unit).map(|(number, unit)| number * unit);
    let metres = metres.filter(|&metres| metres >= 0.0 && metres.is_finite());
    metres.ok_or_else(|| "expected a length such as 2m, 50cm or 6ft".to_owned())
}

pub(super) fn samples(text: &str) -> Result<Rect, String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    let rect = match numbers.as_deref() {
        Some(&[x, y, width, height]) => mesh_frame::rect([x, y, width, height]),
        _ => None,
    };
    rect.ok_or_else(|| "expected four numbers X,Y,W,H with W and H above 0".to_owned())
}

/// The terrain that a mesh is held against.
enum Truth {
    File(Box<Reader>),
    Raster(Box<dyn relevo::source::Source>),
}

impl Truth {
    fn open(args: &Args) -> Result<Self, Error> {
        let sources = inputs::expand(&args.source)?;
        let is_file = |path: &Path| path.extension().is_some_and(|end| end.eq_ignore_ascii_case("rlv"));
        match sources.as_slice() {
            [] => Err(Error::usage(
                "a mesh is checked against its terrain: give the DEM, or the .rlv file, by --source",
            )),
            [file] if is_file(file) => match args.reading.given() {
                None => Ok(Self::File(Box::new(Reader::open(file)?))),
                Some(option) => {
                    let why = "is for reading a DEM: a .rlv file has all of that in it";
                    Err(Error::usage(format!("{option} {why}")))
                }
            },
            several if several.iter().any(|path| is_file(path)) => {
                Err(Error::usage("a .rlv file must be the only --source"))
            }
            dems => {
                let source = args.reading.open(dems)?;
                print_warnings(&with_options(&source.info().warnings));
                Ok(Self::Raster(source))
            }
        }
    }

    fn geo(&self) -> &Geo {
        match self {
            Self::File(reader) => reader.geo(),
            Self::Raster(source) => &source.info().geo,
        }
    }
}

/// Checks the mesh and prints the report; the exit code is 0 if it is sound and keeps what it
/// promises, else 1.
pub fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let refuse = |option: &str| Error::usage(format!("{option} is for .rlv files, not for a mesh"));
    if args.deep || args.memory.is_some() {
        return Err(refuse(if args.deep { "--deep" } else { "--memory" }).into());
    }
    let truth = Truth::open(args)?;
    let mesh = mesh_file::read(&args.file, args.mesh.up)?;
    let found = match &truth {
        Truth::File(reader) => Checked::of(args, mesh, truth.geo(), &Leaves(reader)),
        Truth::Raster(source) => Checked::of(args, mesh, truth.geo(), &Raster(&**source)),
    }
    .map_err(|error| error.at(&args.file))?;
    if args.json {
        json::print(&json::object("verify MESH", found.json(args, truth.geo())), out)?;
    } else {
        found.print(args, truth.geo(), out)?;
    }
    Ok(if found.is_good() { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// Holds a mesh that `relevo mesh` has just written against the file that it is of.
pub(super) fn after_mesh(
    file: &Path,
    reader: &Reader,
    (window, up): (Rect, Option<Up>),
    progress: &dyn relevo::progress::Progress,
) -> Result<Report, Error> {
    let mesh = mesh_file::read(file, up)?;
    let heights = Leaves(reader);
    let mut about = About::of(&mesh.about)?;
    about.assume_local(reader.geo(), heights.size(), Some(&window));
    let map = mesh_frame::map(Frame::Local, &about, reader.geo(), heights.size(), 1.0)?;
    let Placed { vertices, triangles, near } = mesh_frame::place(mesh, &map, mesh_frame::keeps_f32(file));
    let options = Options { window: Some(window), near, ..Options::default() };
    check(&vertices, &triangles, &heights, &options, progress)
}

/// A report with what it is held to.
struct Checked {
    report: Report,
    frame: Frame,
    promised: Option<f64>,
    allowed: Allowed,
}

impl Checked {
    fn of(args: &Args, mesh: Mesh, geo: &Geo, heights: &dyn Heights) -> Result<Self, Error> {
        let mut about = About::of(&mesh.about)?;
        let options = &args.mesh;
        if options.frame == Some(Frame::Local) {
            about.assume_local(geo, heights.size(), options.srcwin.as_ref());
        }
        let frame = options.frame.or(about.frame).unwrap_or(Frame::Local);
        let z_scale = options.z_scale.unwrap_or(1.0);
        let map = mesh_frame::map(frame, &about, geo, heights.size(), z_scale)?;
        let Placed { vertices, triangles, near } =
            mesh_frame::place(mesh, &map, mesh_frame::keeps_f32(&args.file));
        let window = options.srcwin.clone().or(about.window);
        let options = Options { window, near, ..Options::default() };
        let bar = Bar::new();
        let report = check(&vertices, &triangles, heights, &options, &bar);
        bar.finish();
        // A part of a mesh that is asked for has more of it around.
        let allowed = Allowed { solid: about.is_solid, outside: args.mesh.srcwin.is_some() };
        let promised = args.mesh.max_error.or(about.max_error_m);
        Ok(Self { report: report?, frame, promised, allowed })
    }

    fn keeps(&self) -> bool {
        self.promised.is_none_or(|promised| self.report.keeps(promised))
    }

    fn is_good(&self) -> bool {
        self.report.is_sound(self.allowed) && self.keeps()
    }

    fn json(&self, args: &Args, geo: &Geo) -> serde_json::Value {
        let report = &self.report;
        let (columns, rows) = (&report.window.columns, &report.window.rows);
        let (x, y) = geo.world_from_sample(report.at[0], report.at[1]);
        json!({
            "file": json::path(&args.file), "sources": json::paths(&args.source), "good": self.is_good(),
            "frame": self.frame.name(), "solid": self.allowed.solid,
            "triangles": report.triangles, "vertices": report.vertices,
            "window": [columns.start, rows.start, columns.len(), rows.len()],
            "largest_m": report.largest_m, "at": report.at, "at_crs": geo.transform.map(|_| [x, y]),
            "promised_m": self.promised, "rounding_m": report.rounding_m,
            "largest_at_samples_m": report.largest_at_samples_m, "rmse_m": report.rmse_m,
            "samples": report.samples, "compared_samples": report.compared,
            "uncovered_samples": report.uncovered, "first_uncovered": report.first_uncovered,
            "covered_voids": report.covered_voids, "covered_twice": report.twice,
            "flipped_triangles": report.flipped, "vertical_triangles": report.vertical,
            "degenerate_triangles": report.degenerate, "outside_triangles": report.outside,
            "unused_vertices": report.unused_vertices, "smallest_angle_deg": report.smallest_angle_deg,
        })
    }

    fn print(&self, args: &Args, geo: &Geo, out: &mut dyn Write) -> std::io::Result<()> {
        let report = &self.report;
        let name = shown(&args.file);
        if voice::quiet() && self.is_good() {
            return Ok(());
        }
        self.table().print(out)?;
        let (columns, rows) = (&report.window.columns, &report.window.rows);
        let mut lines = vec![format!(
            "{} and {} over {} x {} samples from column {} and row {}.",
            plural(report.triangles, "triangle", "triangles"),
            plural(report.vertices, "vertex", "vertices"),
            grouped(columns.len() as u64),
            grouped(rows.len() as u64),
            columns.start,
            rows.start
        )];
        lines.extend((report.compared > 0).then(|| {
            let [column, row] = report.at;
            let (x, y) = geo.world_from_sample(column, row);
            let crs = if geo.crs.name.is_empty() { "the coordinate system" } else { &geo.crs.name };
            let there = geo.transform.map(|_| format!(", which is {x}, {y} in {crs}")).unwrap_or_default();
            format!("The distance is largest at column {column}, row {row}{there}.")
        }));
        lines.extend(report.first_uncovered.map(|[column, row]| {
            format!("The first sample that is not covered is at column {column}, row {row}.")
        }));
        lines.extend((report.flipped == report.triangles).then(|| {
            "All triangles face down, so nothing was compared: are their corners in the other order, or is --frame another?".to_owned()
        }));
        for line in lines {
            writeln!(out, "\n{}", wrapped(&line, 0))?;
        }
        let verdict = match (report.is_sound(self.allowed), self.keeps(), self.promised) {
            (true, true, Some(_)) => "good, and keeps what it promises",
            (true, true, None) => "good; nothing is promised of its distance",
            (true, false, _) => "farther from the terrain than it promises",
            (false, true, _) => "not a sound mesh of this terrain",
            (false, false, _) => "not a sound mesh of this terrain, and farther from it than it promises",
        };
        writeln!(out, "\n{name}: {verdict}")
    }

    fn table(&self) -> Table {
        let report = &self.report;
        let mut table = Table::new(&["check", "found", "at most"]).words(0);
        let mut row = |name: &str, found: String, most: &str| {
            table.row(vec![name.to_owned(), found, most.to_owned()]);
        };
        let promised = self.promised.map(distance).unwrap_or_default();
        row("largest distance (m)", distance(report.largest_m), &promised);
        row("largest distance at samples (m)", distance(report.largest_at_samples_m), "");
        row("RMSE at samples (m)", distance(report.rmse_m), "");
        row("samples not covered", count(report.uncovered), "0");
        row("voids covered", count(report.covered_voids), "0");
        row("samples covered twice", count(report.twice), "0");
        let of_sheets = if self.allowed.solid { "" } else { "0" };
        let of_whole = if self.allowed.outside { "" } else { "0" };
        row("triangles facing down", count(report.flipped), of_sheets);
        row("vertical triangles", count(report.vertical), of_sheets);
        row("triangles without area", count(report.degenerate), "0");
        row("triangles reaching out", count(report.outside), of_whole);
        row("vertices without triangle", count(report.unused_vertices), "");
        row("smallest angle (degrees)", short(report.smallest_angle_deg), "");
        table
    }
}

/// A distance in metres: to a tenth of a millimetre, or to three digits if it is small.
fn distance(metres: f64) -> String {
    if !(0.1..1e6).contains(&metres) {
        return short(metres);
    }
    let text = format!("{metres:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
