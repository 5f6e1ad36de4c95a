//! The command line: parses, calls the library, prints.
//!
//! Exit codes: 0 done, 2 could not do it. Figures of a run go to standard output, everything else
//! to standard error.

use std::io::{self, IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use anstream::{AutoStream, ColorChoice};
use clap::{ArgGroup, CommandFactory, FromArgMatches, Parser, ValueEnum};
use relevo_core::select::EdgeRule;
use relevo_core::text::printable;
use relevo_viewer::governor::Target;
use relevo_viewer::gpu::Paint;
use relevo_viewer::headless::{self, Journey, Shot, Summary};
use relevo_viewer::settings::{self, Coordinates, Lod, Settings};
use relevo_viewer::window;

const AFTER: &str = "\
Keys of the window: H or F1 shows them, Tab closes and opens the panel.

A camera path is JSON:
  { \"fov\": 50,
    \"keys\": [ { \"time\": 0, \"eye\": [600, 1500, 9000], \"target\": [600, 600, 1500] },
              { \"time\": 5, \"world\": [-121.7, 46.9, 4000], \"target\": [-121.76, 46.85, 3000] } ] }
  fov     vertical field of view in degrees (50)
  time    seconds, rising
  eye     column, row, height in metres; or world: x, y in the file's coordinate system, height in metres
  target  what is in the middle of the picture, in the same terms
  --exaggeration raises the target with the terrain, and the eye by as much: it stays as far above the target.
  Between keys the camera follows a smooth curve. The window records such a path with R.

Exit codes: 0 done, 2 could not do it.
First steps: relevo build dem.tif -o dem.rlv && relevo-viewer dem.rlv
Without a window: relevo-viewer dem.rlv --shot dem.png
                  relevo-viewer dem.rlv --headless --count 100 --metrics figures.csv";

/// Shows a .rlv terrain at a stated pixel error, in a window or as pictures and figures.
#[derive(Parser)]
#[command(name = "relevo-viewer", version, max_term_width = 110, arg_required_else_help = true, after_help = AFTER)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
#[command(group = ArgGroup::new("mode").args(["headless", "shot"]))]
struct Cli {
    /// The terrain
    #[arg(value_name = "FILE")]
    file: PathBuf,

    /// Pixels by which what is drawn may be off
    #[arg(long, value_name = "PIXELS", default_value = "1.0", value_parser = settings::positive)]
    tolerance: f64,
    /// Factor of heights
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = settings::positive)]
    exaggeration: f64,
    /// How the steps of shared edges are chosen: as both sides need, or as in the papers
    #[arg(long, value_name = "RULE", value_enum, default_value = "shared")]
    edge_rule: Rule,
    /// What chooses the triangles, to compare: tiles and the steps of their patches (hybrid), whole
    /// tiles as chunked LOD does (tiles: with the papers' edge rule), or nothing (full: the leaves)
    #[arg(
        long,
        value_enum,
        default_value = "hybrid",
        value_name = "WHAT",
        requires = "mode",
        help_heading = "Without a window"
    )]
    lod: LodName,
    /// Memory on the graphics card, for heights and imagery together
    #[arg(long, value_name = "BYTES", default_value = "512MiB", value_parser = settings::bytes)]
    gpu_memory: u64,
    /// Memory for decoded tiles, so that one that was dropped comes back at once
    #[arg(long, value_name = "BYTES", default_value = "256MiB", value_parser = settings::bytes)]
    ram_cache: u64,
    /// Window or picture, in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = settings::size)]
    size: (u32, u32),
    /// Frames per second: while the camera moves, the tolerance rises as far as they need
    #[arg(long, value_name = "N", value_parser = settings::positive, conflicts_with = "max_triangles")]
    target_fps: Option<f64>,
    /// Triangles of a frame: while the camera moves, the tolerance rises as far as they need
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    max_triangles: Option<u64>,
    /// Graphics adapter: auto, software, or a part of its name
    #[arg(long, value_name = "NAME", default_value = "auto")]
    adapter: String,
    /// Colours: imagery or tint, tint alone, level of the tile, step of the patch, error in pixels
    #[arg(long, value_name = "COLOURS", value_enum, default_value = "terrain")]
    paint: PaintName,
    /// Draw the edges of triangles
    #[arg(long)]
    wireframe: bool,
    /// Draw the borders of tiles
    #[arg(long)]
    borders: bool,

    /// Draw every frame of a camera path without a window
    #[arg(long, help_heading = "Without a window")]
    headless: bool,
    /// Camera path (JSON); auto, or nothing: a flight over the terrain
    #[arg(
        long,
        value_name = "JSON",
        requires = "headless",
        conflicts_with = "shot",
        help_heading = "Without a window"
    )]
    path: Option<PathBuf>,
    /// Folder for one PNG a frame
    #[arg(
        long,
        value_name = "DIR",
        requires = "headless",
        conflicts_with = "shot",
        help_heading = "Without a window"
    )]
    frames: Option<PathBuf>,
    /// File for one row of figures a frame
    #[arg(
        long,
        value_name = "CSV",
        requires = "headless",
        conflicts_with = "shot",
        help_heading = "Without a window"
    )]
    metrics: Option<PathBuf>,
    /// Frames, evenly along the path
    #[arg(
        long,
        value_name = "N",
        requires = "headless",
        conflicts_with_all = ["fps", "shot"],
        help_heading = "Without a window"
    )]
    #[arg(value_parser = clap::value_parser!(u32).range(1..))]
    count: Option<u32>,
    /// Frames for each second of the path
    #[arg(long, value_name = "N", default_value = "30", value_parser = settings::positive)]
    #[arg(requires = "headless", conflicts_with = "shot", help_heading = "Without a window")]
    fps: f64,
    /// Draw what is loaded at that moment; without it every frame waits for everything
    #[arg(long, requires = "headless", conflicts_with = "shot", help_heading = "Without a window")]
    streaming: bool,
    /// Measure how far every sample in view is off in pixels, from what was really drawn (slow)
    #[arg(long, requires = "headless", conflicts_with = "shot", help_heading = "Without a window")]
    observe: bool,
    /// Write one picture, with everything loaded
    #[arg(long, value_name = "PNG", help_heading = "Without a window")]
    shot: Option<PathBuf>,
    /// Where the camera of the picture stands, above the ground in any case; an overview without it
    #[arg(long, value_name = "X,Y,HEIGHT", allow_hyphen_values = true, value_parser = settings::place)]
    #[arg(requires = "shot", conflicts_with = "headless", help_heading = "Without a window")]
    eye: Option<[f64; 3]>,
    /// What it looks at
    #[arg(long, value_name = "X,Y,HEIGHT", allow_hyphen_values = true, value_parser = settings::place)]
    #[arg(requires = "shot", conflicts_with = "headless", help_heading = "Without a window")]
    target: Option<[f64; 3]>,
    /// What X and Y of --eye and --target are: column and row, the file's coordinate system, or
    /// longitude and latitude in degrees; HEIGHT is in metres
    #[arg(long, value_name = "WHAT", value_enum, default_value = "samples")]
    #[arg(requires = "shot", conflicts_with = "headless", help_heading = "Without a window")]
    coordinates: CoordinatesName,
    /// Replace pictures and figures that are there
    #[arg(long, short, requires = "mode", help_heading = "Without a window")]
    force: bool,

    /// No figures at the end; errors and what was odd stay
    #[arg(long, short, help_heading = "What is said")]
    quiet: bool,
    /// Colours on standard error: auto is on a terminal, unless `NO_COLOR` is set
    #[arg(long, value_name = "WHEN", value_enum, default_value = "auto", help_heading = "What is said")]
    color: Color,
}

#[derive(Clone, Copy, ValueEnum)]
enum CoordinatesName {
    Samples,
    Crs,
    Lonlat,
}

#[derive(Clone, Copy, ValueEnum)]
enum Color {
    Auto,
    Always,
    Never,
}

impl Color {
    fn choice(self) -> ColorChoice {
        match self {
            Self::Auto => ColorChoice::Auto,
            Self::Always => ColorChoice::Always,
            Self::Never => ColorChoice::Never,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
enum Rule {
    Shared,
    Paper,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum LodName {
    Hybrid,
    Tiles,
    Full,
}

#[derive(Clone, Copy, ValueEnum)]
enum PaintName {
    Terrain,
    Tint,
    Level,
    Step,
    Error,
}

impl Cli {
    fn settings(&self) -> Settings {
        let fps = self.target_fps.map(Target::Fps);
        Settings {
            file: self.file.clone(),
            tolerance: self.tolerance,
            exaggeration: self.exaggeration,
            rule: match self.edge_rule {
                Rule::Shared if self.lod != LodName::Tiles => EdgeRule::Shared,
                _ => EdgeRule::Paper,
            },
            lod: match self.lod {
                LodName::Hybrid => Lod::Hybrid,
                LodName::Tiles => Lod::Tiles,
                LodName::Full => Lod::Full,
            },
            gpu_memory: self.gpu_memory,
            ram_cache: self.ram_cache,
            size: self.size,
            target: fps.or(self.max_triangles.map(Target::Triangles)),
            adapter: self.adapter.clone(),
            paint: match self.paint {
                PaintName::Terrain => Paint::Terrain,
                PaintName::Tint => Paint::Tint,
                PaintName::Level => Paint::TileLevel,
                PaintName::Step => Paint::Step,
                PaintName::Error => Paint::Error,
            },
            wireframe: self.wireframe,
            borders: self.borders,
        }
    }

    fn journey(&self) -> Journey {
        Journey {
            path: self.path.clone().filter(|path| path.as_os_str() != "auto"),
            count: self.count,
            fps: self.fps,
            frames: self.frames.clone(),
            metrics: self.metrics.clone(),
            streaming: self.streaming,
            observe: self.observe,
            force: self.force,
        }
    }

    fn shot(&self) -> Shot {
        Shot {
            eye: self.eye,
            target: self.target,
            coordinates: match self.coordinates {
                CoordinatesName::Samples => Coordinates::Samples,
                CoordinatesName::Crs => Coordinates::Crs,
                CoordinatesName::Lonlat => Coordinates::LonLat,
            },
            force: self.force,
        }
    }
}

/// Parses the command line. Errors have the colours that `--color` asks for; without a terminal,
/// text is wrapped at 80 columns.
fn parse() -> Cli {
    let words: Vec<String> = std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
    let asked = |when: &str| {
        let apart = words.windows(2).any(|pair| pair[0] == "--color" && pair[1] == when);
        apart || words.iter().any(|word| *word == format!("--color={when}"))
    };
    let color = match (asked("always"), asked("never")) {
        (true, _) => clap::ColorChoice::Always,
        (_, true) => clap::ColorChoice::Never,
        _ => clap::ColorChoice::Auto,
    };
    let mut command = Cli::command().color(color);
    if !io::stdout().is_terminal() {
        command = command.term_width(80);
    }
    Cli::from_arg_matches(&command.get_matches()).unwrap_or_else(|error| error.exit())
}

/// Parses, runs, and turns the outcome into an exit code.
pub fn main() -> ExitCode {
    let cli = parse();
    let settings = cli.settings();
    let choice = cli.color.choice();
    let say = |colour: &str, line: &str| {
        let mut err = AutoStream::new(io::stderr().lock(), choice);
        let plain = if colour.is_empty() { "" } else { "\x1b[0m" };
        let _ = writeln!(err, "{colour}relevo-viewer: {plain}{}", printable(line));
    };
    let mut report = |line: &str| say("", line);
    let outcome = match (&cli.shot, cli.headless) {
        (Some(output), _) => headless::shot(&settings, cli.shot(), output, &mut report)
            .map(|summary| Some(("picture", summary))),
        (None, true) => {
            headless::journey(&settings, &cli.journey(), &mut report).map(|summary| Some(("path", summary)))
        }
        (None, false) => window::run(&settings, &mut report).map(|()| None),
    };
    match outcome {
        Ok(summary) => {
            if let Some((what, summary)) = summary.filter(|_| !cli.quiet) {
                // A reader that closes the pipe is no error.
                let _ = print(what, &summary);
            }
            ExitCode::SUCCESS
        }
        Err(error) => {
            // Bold red, as clap writes `error:`.
            say("\x1b[1m\x1b[31m", &error.to_string().replace("`force`", "--force"));
            ExitCode::from(2)
        }
    }
}

fn print(what: &str, summary: &Summary) -> io::Result<()> {
    let mut out = io::stdout().lock();
    let frames = f64::from(summary.frames.max(1));
    writeln!(out, "{what}: {} frames on {}", summary.frames, summary.adapter)?;
    writeln!(out, "triangles a frame: {:.0}", summary.triangles as f64 / frames)?;
    writeln!(out, "milliseconds a frame: {:.1}", summary.frame_ms / frames)?;
    writeln!(out, "graphics memory: {:.1} MiB", summary.gpu_bytes as f64 / f64::from(1 << 20))?;
    writeln!(out, "largest promised error: {:.3} pixels", summary.promised)?;
    if let Some(observed) = summary.observed {
        writeln!(out, "largest observed error: {observed:.3} pixels")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn the_arguments_fit_together() {
        super::Cli::command().debug_assert();
    }
}
