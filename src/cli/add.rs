//! `relevo add`: an imagery layer into a file that is there.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use relevo::Error;
use relevo::pipeline::imagery::{self, AddReport, LayerOptions};
use serde_json::json;

use crate::cli::Outcome;
use crate::cli::imagery::Imagery;
use crate::cli::progress::{Mode, Show};
use crate::cli::table::{Table, bytes, grouped, seconds};

/// Put imagery into a .rlv file, or other imagery in its place; the heights stay as they are
#[derive(clap::Args)]
pub struct Args {
    /// The .rlv file. Until all is done it stays as it is
    file: PathBuf,
    #[command(flatten)]
    imagery: Imagery,
    /// Threads [default: one for each core]
    #[arg(long, short, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// How to show progress
    #[arg(long, value_enum, default_value = "auto")]
    progress: Mode,
    /// The report as JSON
    #[arg(long)]
    json: bool,
}

/// Adds, and says what was made.
pub fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    if args.imagery.files.is_empty() {
        return Err(Error::usage("which pictures? name them: --imagery FILE...").into());
    }
    let show = Show::new(args.progress);
    let pictures = |crs: &relevo::geo::Crs| args.imagery.open(crs);
    let jobs = args.jobs.map(usize::from);
    let report = imagery::add(&args.file, &pictures, &layer_options(&args.imagery)?, jobs, &show);
    show.finish();
    let report = report?;
    if args.json {
        let json = json(args, &report);
        serde_json::to_writer_pretty(&mut *out, &json).map_err(std::io::Error::from)?;
        writeln!(out)?;
    } else {
        print(args, &report, out)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// How the layer is stored.
pub fn layer_options(imagery: &Imagery) -> Result<LayerOptions, Error> {
    Ok(LayerOptions {
        codec: imagery.codec.parse()?,
        quality: imagery.quality,
        tile: imagery.tile,
        resolution: imagery.resolution,
    })
}

fn print(args: &Args, report: &AddReport, out: &mut dyn Write) -> std::io::Result<()> {
    let size = bytes(report.bytes);
    writeln!(out, "{}: {size} of imagery, {} in all", args.file.display(), bytes(report.file_bytes))?;
    for picture in &report.pyramid.pictures {
        let (note, level) = (&picture.note, picture.level);
        writeln!(out, "  {}: level {level}; {}", note.name, note.description)?;
    }
    let mut table = Table::new(&["level", "tiles", "bytes"]);
    for (level, &(tiles, size)) in report.levels.iter().enumerate() {
        table.row(vec![level.to_string(), grouped(tiles), bytes(size)]);
    }
    table.print(out)?;
    let (codec, count) = (report.header.codec, report.header.tiles);
    let tiles = if count == 1 { "1 tile".to_owned() } else { grouped(count) + " tiles" };
    writeln!(out, "{tiles}, {codec}, in {}", seconds(report.elapsed.as_secs_f64()))
}

fn json(args: &Args, report: &AddReport) -> serde_json::Value {
    let levels: Vec<_> =
        report.levels.iter().map(|(tiles, bytes)| json!({"tiles": tiles, "bytes": bytes})).collect();
    json!({
        "file": args.file, "bytes": report.file_bytes, "imagery_bytes": report.bytes, "codec": report.header.codec.as_str(),
        "tile": report.header.tile, "tiles": report.header.tiles, "alpha": report.header.alpha, "levels": levels,
        "pictures": report.pyramid.pictures.len(), "seconds": report.elapsed.as_secs_f64(),
    })
}
