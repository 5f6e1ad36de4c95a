//! `relevo export`: writes a level or a tile, of the heights or of the imagery, as a GeoTIFF or a
//! PNG.

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

/// Write a level or a tile, of the heights or of the imagery, as a GeoTIFF or a PNG
#[derive(clap::Args)]
pub struct Args {
    /// The .rlv file
    #[arg(value_name = "FILE.rlv")]
    file: PathBuf,
    /// Write this file: a GeoTIFF (.tif) of samples or texels, or a PNG (.png) of texels, of a
    /// level's shaded relief, or of a tile's heights in 16-bit greys (0 is void; the printed line
    /// says what the others mean)
    #[arg(short, long, value_name = "OUT.tif|OUT.png")]
    output: PathBuf,
    /// Export the imagery, not the heights
    #[arg(long)]
    imagery: bool,
    /// Export this level; 0 is the root [default: the finest]
    #[arg(short, long, value_name = "N", conflicts_with = "tile")]
    level: Option<u8>,
    /// Export one tile: level, column and row
    #[arg(short, long, value_name = "L/X/Y", value_parser = tile)]
    tile: Option<TileId>,
    /// Export only the part that this box touches, in coordinates of the file; a box across the
    /// antimeridian has W above E
    #[arg(long, value_name = "W,S,E,N", allow_hyphen_values = true, value_parser = bounds, conflicts_with = "tile")]
    bbox: Option<[f64; 4]>,
    /// Give --bbox in this coordinate system, such as EPSG:4326 for longitude and latitude
    /// [default: that of the file]
    #[arg(long, value_name = "EPSG:N|WKT", requires = "bbox")]
    bbox_crs: Option<String>,
    /// Compress the GeoTIFF by this method
    #[arg(long, default_value = "deflate", value_parser = ["none", "deflate", "zstd"])]
    compress: String,
    /// Draw the relief in grey, as gdaldem hillshade does, without a tint
    #[arg(long)]
    grey: bool,
    /// Use at most this much memory, such as 256MiB or 2GiB; slower with fewer rows or blocks at a
    /// time, and refused at the start if it is not enough
    #[arg(long, value_name = "SIZE", value_parser = size)]
    memory: Option<u64>,
    /// Replace the output if it exists
    #[arg(long, short)]
    force: bool,
}

/// Parses `--tile L/X/Y`.
fn tile(text: &str) -> Result<TileId, String> {
    let numbers: Option<Vec<u32>> = text.split('/').map(|word| word.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[level, x, y]) if level <= 30 => Ok(TileId::new(level as u8, x, y)),
        _ => Err("expected three whole numbers LEVEL/X/Y".to_owned()),
    }
}

/// Exports, and prints the meaning of the greys for a PNG of a tile of heights.
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

/// Writes a PNG.
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
