//! `relevo add`: puts an imagery layer into a finished file.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use relevo::Error;
use relevo::pipeline::imagery::{self, AddReport, LayerOptions, LayerReport};
use serde_json::json;

use crate::cli::build::size;
use crate::cli::imagery::Imagery;
use crate::cli::progress::{Mode, Show};
use crate::cli::table::{Table, bytes, count, plural, seconds, short, wrapped};
use crate::cli::{Outcome, json, shown, voice};

/// Put imagery into a .rlv file, in place of any that it has; the heights stay as they are
#[derive(clap::Args)]
pub struct Args {
    /// The .rlv file; it is replaced once the new one is complete
    #[arg(value_name = "FILE.rlv")]
    file: PathBuf,
    /// Use N threads [default: one for each core]
    #[arg(long, short, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Use at most this much memory, such as 256MiB or 2GiB; slower if blocks of pictures must be
    /// decoded again
    #[arg(long, value_name = "SIZE", value_parser = size)]
    memory: Option<u64>,
    /// Treat warnings as errors; the file then stays as it is
    #[arg(long)]
    strict: bool,
    /// Choose how progress is shown
    #[arg(long, value_enum, default_value = "auto")]
    progress: Mode,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    imagery: Imagery,
}

/// Adds the layer and prints the report.
pub fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    if args.imagery.files.is_empty() {
        return Err(Error::usage("which pictures? name them: --imagery FILE...").into());
    }
    let show = Show::new(args.progress);
    let pictures = |crs: &relevo::geo::Crs| args.imagery.open(crs, args.memory, args.strict);
    let report = imagery::add(
        &args.file,
        &pictures,
        &layer_options(&args.imagery)?,
        args.jobs.map(usize::from),
        args.memory,
        &show,
    );
    show.finish();
    let report = report.map_err(|error| match error {
        Error::Interrupted => Error::usage(format!("interrupted; {} is as it was", shown(&args.file))),
        other => other,
    })?;
    if args.json {
        let all = json!({
            "file": json::path(&args.file), "bytes": report.file_bytes, "imagery": json::layer(&report.layer),
            "seconds": report.elapsed.as_secs_f64(),
        });
        json::print(&json::object("add", all), out)?;
    } else if !voice::quiet() {
        print(args, &report, out)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The options of the library for storing the layer.
pub fn layer_options(imagery: &Imagery) -> Result<LayerOptions, Error> {
    Ok(LayerOptions {
        codec: imagery.codec.parse()?,
        quality: imagery.quality,
        tile: imagery.tile,
        resolution: imagery.resolution,
    })
}

fn print(args: &Args, report: &AddReport, out: &mut dyn Write) -> std::io::Result<()> {
    print_layer(&report.layer, out)?;
    let (size, time) = (bytes(report.file_bytes), seconds(report.elapsed.as_secs_f64()));
    writeln!(out, "{}", wrapped(&format!("{}: {size} in all, made in {time}", shown(&args.file)), 2))
}

/// Prints the report of a new layer.
pub fn print_layer(layer: &LayerReport, out: &mut dyn Write) -> std::io::Result<()> {
    let header = &layer.header;
    let tiles = plural(header.tiles, "tile", "tiles");
    let head =
        format!("imagery: {}, {tiles} of {} texels, {}", bytes(layer.bytes), header.tile, header.codec);
    writeln!(out, "{}", wrapped(&head, 2))?;
    for picture in &layer.pyramid.pictures {
        let (note, level) = (&picture.note, picture.level);
        let how = rule(&note.bands, &note.stretch);
        let line = format!("  {}: level {level}; {}{how}", note.name, note.description);
        writeln!(out, "{}", wrapped(&line, 4))?;
        if let Some(other) = better_tile(header.tile, picture.pixels_per_texel) {
            let (x, y) = picture.pixels_per_texel;
            let (x, y) = (short(x), short(y));
            let line = format!(
                "    a texel is {x} x {y} pixels; --imagery-tile {other} would make them as large as each other"
            );
            writeln!(out, "{}", wrapped(&line, 6))?;
        }
    }
    let mut table = Table::new(&["level", "tiles", "size"]);
    for (level, &(tiles, size)) in layer.levels.iter().enumerate() {
        table.row(vec![level.to_string(), count(tiles), bytes(size)]);
    }
    table.print(out)
}

/// The tile size at which a texel is as large as a pixel; `None` if texels of tiles of `tile`
/// already are, within a twentieth.
fn better_tile(tile: u32, (x, y): (f64, f64)) -> Option<u32> {
    let pixels = (x * y).sqrt();
    let better = (f64::from(tile) * pixels / 4.0).round() * 4.0;
    let differs = (pixels - 1.0).abs() > 0.05 && (64.0..=4096.0).contains(&better);
    (differs && better != f64::from(tile)).then_some(better as u32)
}

/// The end of a line that names the bands used as colours and the values they were stretched
/// from; empty if samples were taken unchanged.
pub fn rule(bands: &[u32], stretch: &[(f64, f64)]) -> String {
    let taken_as_they_are = bands == [1] || bands == [1, 2, 3];
    let bands: Vec<String> = bands.iter().map(ToString::to_string).collect();
    let ramps: Vec<String> =
        stretch.iter().map(|(low, high)| format!("{} to {}", short(*low), short(*high))).collect();
    let bands = (!taken_as_they_are).then(|| format!("; bands {}", bands.join(", ")));
    let stretch = (!ramps.is_empty()).then(|| format!("; stretched from {}", ramps.join(", ")));
    bands.into_iter().chain(stretch).collect()
}
