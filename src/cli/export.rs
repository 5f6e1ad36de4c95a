//! `relevo export`: a level back to GeoTIFF, or as a shaded picture.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use relevo::Error;
use relevo::container::reader::Reader;
use relevo::export::{self, GeotiffOptions};
use relevo::geotiff_write::Compression;
use relevo::hillshade::Style;

use crate::cli::Outcome;

/// A level back to GeoTIFF, or as a shaded picture
#[derive(clap::Args)]
pub struct Args {
    /// The .rlv file
    file: PathBuf,
    /// What to write: a GeoTIFF (.tif) with the samples of the level, or a shaded relief (.png)
    #[arg(short, long, value_name = "OUT.tif|OUT.png")]
    output: PathBuf,
    /// The level: 0 is the root [default: the leaves' level, the source's samples]
    #[arg(short, long, value_name = "N")]
    level: Option<u8>,
    /// Compression of the GeoTIFF
    #[arg(long, default_value = "deflate", value_parser = ["none", "deflate", "zstd"])]
    compress: String,
    /// Picture: light alone, as gdaldem has it, instead of tinted relief
    #[arg(long)]
    grey: bool,
    /// Replace the output if it is there
    #[arg(long, short)]
    force: bool,
}

/// Writes the level; says nothing on stdout.
pub fn run(args: &Args, _out: &mut dyn Write) -> Outcome {
    let reader = Reader::open(&args.file)?;
    let level = args.level.unwrap_or(reader.header().levels);
    let extension = args.output.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    if args.output.exists() && !args.force {
        let output = args.output.display();
        return Err(Error::usage(format!("{output}: exists already; --force replaces it")).into());
    }
    match extension.as_str() {
        "tif" | "tiff" => {
            let compression = match args.compress.as_str() {
                "none" => Compression::None,
                "zstd" => Compression::Zstd,
                _ => Compression::Deflate,
            };
            let options = GeotiffOptions { level, compression, force: args.force };
            export::geotiff(&reader, &args.output, options)?;
        }
        "png" => {
            let style = if args.grey { Style::Grey } else { Style::Relief };
            export::picture(&reader, &args.output, level, style)?;
        }
        _ => {
            let output = args.output.display();
            return Err(Error::usage(format!("{output}: expected a name that ends in .tif or .png")).into());
        }
    }
    Ok(ExitCode::SUCCESS)
}
