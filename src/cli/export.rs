//! `relevo export`: a level or a tile back to GeoTIFF or as a picture, of the heights or of the
//! imagery.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use relevo::container::reader::{Reader, ReaderOptions};
use relevo::export::{self, GeotiffOptions};
use relevo::geotiff_write::Compression;
use relevo::hillshade::Style;
use relevo::source::cropped::Bbox;
use relevo::{Error, TileId};

use crate::cli::build::size;
use crate::cli::dem::bounds;
use crate::cli::table::wrapped;
use crate::cli::{Failure, Outcome, shown};

/// A level or a tile back to GeoTIFF or as a picture, of the heights or of the imagery
#[derive(clap::Args)]
pub struct Args {
    /// The .rlv file
    #[arg(value_name = "FILE.rlv")]
    file: PathBuf,
    /// What to write: a GeoTIFF (.tif) with the samples or the texels, or a picture (.png): a
    /// shaded relief of a level, 16-bit greys of a tile of heights (0 is void; the last line says
    /// what the others are), or texels
    #[arg(short, long, value_name = "OUT.tif|OUT.png")]
    output: PathBuf,
    /// Of the imagery, not of the heights
    #[arg(long)]
    imagery: bool,
    /// The level: 0 is the root [default: the finest]
    #[arg(short, long, value_name = "N", conflicts_with = "tile")]
    level: Option<u8>,
    /// One tile: level, column and row
    #[arg(short, long, value_name = "L/X/Y", value_parser = tile)]
    tile: Option<TileId>,
    /// The part that this box touches, in coordinates of the file; over the antimeridian W is above
    /// E
    #[arg(long, value_name = "W,S,E,N", allow_hyphen_values = true, value_parser = bounds, conflicts_with = "tile")]
    bbox: Option<[f64; 4]>,
    /// The coordinates of --bbox, such as EPSG:4326 for longitude and latitude [default: those of
    /// the file]
    #[arg(long, value_name = "EPSG:N|WKT", requires = "bbox")]
    bbox_crs: Option<String>,
    /// Compression of the GeoTIFF
    #[arg(long, default_value = "deflate", value_parser = ["none", "deflate", "zstd"])]
    compress: String,
    /// Shaded relief: light alone, as gdaldem has it, instead of tinted
    #[arg(long)]
    grey: bool,
    /// Keep within this much memory (256MiB, 2GiB), with fewer rows or blocks at a time; slower
    /// then. Refuse before the work if it takes more
    #[arg(long, value_name = "SIZE", value_parser = size)]
    memory: Option<u64>,
    /// Replace the output if it is there
    #[arg(long, short)]
    force: bool,
}

/// `--tile L/X/Y`.
fn tile(text: &str) -> Result<TileId, String> {
    let numbers: Option<Vec<u32>> = text.split('/').map(|word| word.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[level, x, y]) if level <= 30 => Ok(TileId::new(level as u8, x, y)),
        _ => Err("expected three whole numbers LEVEL/X/Y".to_owned()),
    }
}

/// Writes it; on stdout stands at most what the greys of a tile of heights mean.
pub fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let reader = Reader::open_with(&args.file, ReaderOptions::within(args.memory))?;
    let finest = match reader.imagery() {
        Some(layer) if args.imagery => layer.header().leaf,
        _ => reader.header().levels,
    };
    let level = args.level.unwrap_or(finest);
    let extension = args.output.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    if args.output.exists() && !args.force {
        let output = shown(&args.output);
        return Err(Error::usage(format!("{output}: exists already; --force replaces it")).into());
    }
    let bbox = args.bbox.map(|bounds| Bbox { bounds, crs: args.bbox_crs.clone() });
    let output = &args.output;
    match extension.as_str() {
        "tif" | "tiff" => {
            let compression = match args.compress.as_str() {
                "none" => Compression::None,
                "zstd" => Compression::Zstd,
                _ => Compression::Deflate,
            };
            let options = GeotiffOptions { level, compression, force: args.force };
            match (args.tile, args.imagery) {
                (None, false) => match &bbox {
                    Some(bbox) => export::part_geotiff(&reader, output, bbox, options)?,
                    None => export::geotiff(&reader, output, options)?,
                },
                (None, true) => match &bbox {
                    Some(bbox) => export::imagery_part(&reader, output, bbox, level, Some(options))?,
                    None => export::imagery_geotiff(&reader, output, options)?,
                },
                (Some(id), false) => export::tile_geotiff(&reader, output, id, options)?,
                (Some(id), true) => export::imagery_tile(&reader, output, id, Some(options))?,
            };
        }
        "png" => picture(&reader, args, bbox.as_ref(), level, out)?,
        _ => {
            let output = shown(output);
            return Err(Error::usage(format!("{output}: expected a name that ends in .tif or .png")).into());
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Writes a picture.
fn picture(
    reader: &Reader,
    args: &Args,
    bbox: Option<&Bbox>,
    level: u8,
    out: &mut dyn Write,
) -> Result<(), Failure> {
    let output = &args.output;
    match (args.tile, args.imagery) {
        (None, false) => {
            let style = if args.grey { Style::Grey } else { Style::Relief };
            match bbox {
                Some(bbox) => export::part_picture(reader, output, bbox, level, style)?,
                None => export::picture(reader, output, level, style)?,
            };
        }
        (None, true) => {
            match bbox {
                Some(bbox) => export::imagery_part(reader, output, bbox, level, None)?,
                None => export::imagery_picture(reader, output, level)?,
            };
        }
        (Some(id), true) => {
            export::imagery_tile(reader, output, id, None)?;
        }
        (Some(id), false) => {
            let scale = export::tile_picture(reader, output, id)?;
            let how = if scale.exact { "exactly" } else { "rounded" };
            let (offset, step) = (scale.offset_m, scale.step_m);
            let line = format!("height in metres = {offset} + {step} * (grey - 1), {how}; grey 0 is void");
            writeln!(out, "{}", wrapped(&line, 2))?;
        }
    }
    Ok(())
}
