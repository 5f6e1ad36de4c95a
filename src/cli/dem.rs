//! Which rasters, and how they become one: the arguments that `build` and `verify` share.

use std::path::{Path, PathBuf};

use relevo::Error;
use relevo::limits::Limits;
use relevo::source::{self, OpenOptions, Overlap, Source};

/// The rasters.
#[derive(clap::Args, Clone)]
pub struct Dem {
    /// The DEM, or several that become one: TIFF, .vrt and .hgt files on one grid, in any order (any rasters of GDAL's if built with --features gdal)
    #[arg(value_name = "DEM", required = true)]
    pub dems: Vec<PathBuf>,
}

impl Dem {
    /// The first, which names the others.
    pub fn first(&self) -> &Path {
        self.dems.first().map_or(Path::new(""), PathBuf::as_path)
    }

    /// One of them by name, of many the first and how many more.
    pub fn name(&self) -> String {
        match self.dems.len() {
            0 | 1 => self.first().display().to_string(),
            count => format!("{} and {} more", self.first().display(), count - 1),
        }
    }
}

/// How they are read.
#[derive(clap::Args, Clone, Default)]
#[command(next_help_heading = "Reading the DEM")]
pub struct SourceArgs {
    /// Value that means void, instead of what the files say
    #[arg(long, value_name = "V", allow_hyphen_values = true)]
    pub nodata: Option<f64>,
    /// Which sample counts where files overlap; a void never hides a valid one (within a .vrt it is the last)
    #[arg(long, value_name = "first|last|min|max|mean", default_value = "last", value_parser = overlap, hide_possible_values = true)]
    pub overlap: Overlap,
}

impl SourceArgs {
    /// As the library takes them.
    pub fn options(&self) -> OpenOptions {
        OpenOptions { nodata: self.nodata, overlap: self.overlap }
    }

    /// Opens the rasters as one.
    pub fn open(&self, dems: &[PathBuf]) -> Result<Box<dyn Source>, Error> {
        source::open_all(dems, &self.options(), &Limits::default())
    }
}

fn overlap(word: &str) -> Result<Overlap, String> {
    match word {
        "first" => Ok(Overlap::First),
        "last" => Ok(Overlap::Last),
        "min" => Ok(Overlap::Min),
        "max" => Ok(Overlap::Max),
        "mean" => Ok(Overlap::Mean),
        _ => Err("expected first, last, min, max or mean".to_owned()),
    }
}
