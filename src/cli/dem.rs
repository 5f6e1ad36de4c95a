//! Arguments that `build` and `verify` share: the rasters, and how they are read and joined.

use std::path::{Path, PathBuf};

use crate::cli::shown;
use relevo::Error;
use relevo::limits::Limits;
use relevo::source::cropped::Bbox;
use relevo::source::warp::{Resampling, Warp};
use relevo::source::{self, OpenOptions, Overlap, Source, unit};

/// The rasters to read.
#[derive(clap::Args, Clone)]
pub struct Dem {
    /// The DEM, or several on one grid to be joined, in any order: TIFF, .vrt or .hgt, also gzipped
    /// (with GDAL built in, any raster that it reads); @LIST names a file with one DEM a line, @-
    /// reads such a list from standard input
    #[arg(value_name = "DEM", required = true)]
    pub dems: Vec<PathBuf>,
}

impl Dem {
    /// The first raster, after which the output is named.
    pub fn first(&self) -> &Path {
        self.dems.first().map_or(Path::new(""), PathBuf::as_path)
    }

    /// The name of the first raster, and the number of the others.
    pub fn name(&self) -> String {
        match self.dems.len() {
            0 | 1 => shown(self.first()),
            count => format!("{} and {} more", shown(self.first()), count - 1),
        }
    }
}

/// Options for reading the rasters.
#[derive(clap::Args, Clone, Default)]
#[command(next_help_heading = "Reading the DEM")]
pub struct SourceArgs {
    /// Treat this value as void, in place of the nodata value of the file
    #[arg(long, value_name = "V", allow_hyphen_values = true)]
    pub nodata: Option<f64>,
    /// Read the heights from this band, counted from 1 [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub band: Option<u32>,
    /// Choose the sample where files overlap; a void never hides a valid sample (within a .vrt the
    /// last file counts)
    #[arg(long, value_name = "first|last|min|max|mean", default_value = "last", value_parser = overlap, hide_possible_values = true)]
    pub overlap: Overlap,
    /// Take heights in this vertical unit, in place of that of the file: m, ft, us-ft, another unit
    /// that GDAL names, or its length in metres
    #[arg(long, value_name = "m|ft|us-ft|METRES", value_parser = vertical_unit)]
    pub vertical_unit: Option<(f64, String)>,
    /// Take samples as depths, positive down: heights are their negatives
    #[arg(long)]
    pub depth: bool,
    /// Warp to this coordinate system, by GDAL [default with --resolution or --resampling: that of
    /// the first file]
    #[arg(long, value_name = "EPSG:N|WKT")]
    pub crs: Option<String>,
    /// Warp to this sample spacing, in units of the coordinate system [default with --crs or
    /// --resampling: what gdalwarp chooses]
    #[arg(long, value_name = "X[,Y]", value_parser = resolution)]
    pub resolution: Option<(f64, f64)>,
    /// Resample by this method when warping: near, bilinear, cubic, cubicspline, lanczos or average
    /// [default: bilinear]
    #[arg(long, value_name = "METHOD", value_parser = resampling)]
    pub resampling: Option<Resampling>,
    /// Read only the part that this box touches, in coordinates of the DEM; a box across the
    /// antimeridian has W above E
    #[arg(long, value_name = "W,S,E,N", allow_hyphen_values = true, value_parser = bounds)]
    pub bbox: Option<[f64; 4]>,
    /// Give --bbox in this coordinate system, such as EPSG:4326 for longitude and latitude
    /// [default: that of the DEM]
    #[arg(long, value_name = "EPSG:N|WKT", requires = "bbox")]
    pub bbox_crs: Option<String>,
}

impl SourceArgs {
    /// The options of the library for opening the rasters.
    pub fn options(&self) -> OpenOptions {
        let warped = self.crs.is_some() || self.resolution.is_some() || self.resampling.is_some();
        OpenOptions {
            nodata: self.nodata,
            band: self.band,
            overlap: self.overlap,
            vertical_unit: self.vertical_unit.clone(),
            depth: self.depth,
            warp: warped.then(|| Warp {
                crs: self.crs.clone(),
                resolution: self.resolution,
                resampling: self.resampling.unwrap_or_default(),
            }),
            bbox: self.bbox.map(|bounds| Bbox { bounds, crs: self.bbox_crs.clone() }),
        }
    }

    /// The first of the options that was given.
    pub fn given(&self) -> Option<&'static str> {
        let all = [
            (self.nodata.is_some(), "--nodata"),
            (self.band.is_some(), "--band"),
            (self.overlap != Overlap::default(), "--overlap"),
            (self.vertical_unit.is_some(), "--vertical-unit"),
            (self.depth, "--depth"),
            (self.crs.is_some(), "--crs"),
            (self.resolution.is_some(), "--resolution"),
            (self.resampling.is_some(), "--resampling"),
            (self.bbox.is_some(), "--bbox"),
        ];
        all.into_iter().find_map(|(given, name)| given.then_some(name))
    }

    /// Opens the rasters as one source.
    pub fn open(&self, dems: &[PathBuf]) -> Result<Box<dyn Source>, Error> {
        source::open_all(dems, &self.options(), &Limits::default())
    }
}

/// Parses `--bbox W,S,E,N`.
pub(super) fn bounds(text: &str) -> Result<[f64; 4], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[west, south, east, north])
            if [west, south, east, north].iter().all(|x| x.is_finite()) && west != east && south < north =>
        {
            Ok([west, south, east, north])
        }
        _ => Err("expected four numbers W,S,E,N (west, south, east, north) with S below N".to_owned()),
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

fn vertical_unit(word: &str) -> Result<(f64, String), String> {
    unit::parse(word).ok_or_else(|| "expected m, ft, us-ft, another unit of length, or its metres".to_owned())
}

fn resampling(word: &str) -> Result<Resampling, String> {
    let found = Resampling::ALL.into_iter().find(|method| method.name() == word);
    found.ok_or_else(|| "expected near, bilinear, cubic, cubicspline, lanczos or average".to_owned())
}

fn resolution(text: &str) -> Result<(f64, f64), String> {
    let step = |word: &str| word.trim().parse().ok().filter(|&step: &f64| step > 0.0 && step.is_finite());
    let (x, y) = text.split_once(',').unwrap_or((text, text));
    step(x).zip(step(y)).ok_or_else(|| "expected one or two numbers above 0: X or X,Y".to_owned())
}
