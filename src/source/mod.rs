//! Rasters to read from: size, georeference and windows of samples, in any order, bounded memory.
//!
//! A source knows nothing of tiles. It gives samples in their own type, with a validity of their own (GDAL mask),
//! and says which value means void; [`Window::is_void`] joins the two.

mod epsg;
#[cfg(feature = "gdal")]
pub mod gdal;
pub mod geokeys;
mod metadata;
pub mod tiff;
mod wkt;

use std::ops::Range;
use std::path::Path;

use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::limits::Limits;
use crate::sample::SampleType;

/// Opens a raster: a GeoTIFF natively, anything else (and a TIFF that needs more) through GDAL if that is built in.
pub fn open(path: &Path, limits: &Limits) -> Result<Box<dyn Source>> {
    match tiff::TiffSource::open(path, limits) {
        Ok(source) => Ok(Box::new(source)),
        #[cfg(feature = "gdal")]
        Err(Error::Unsupported { .. }) => Ok(Box::new(gdal::GdalSource::open(path, limits)?)),
        Err(error) => Err(error),
    }
}

/// What a raster is, known when it is opened.
#[derive(Clone, Debug)]
pub struct SourceInfo {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Type of the samples of the elevation band.
    pub sample_type: SampleType,
    /// The value that means void, from GDAL's nodata tag; NaN and infinities are void whatever it is.
    pub nodata: Option<f64>,
    /// GDAL scale: `real = band_offset + band_scale * value`; 1 unless the file says so.
    pub band_scale: f64,
    /// GDAL offset; 0 unless the file says so.
    pub band_offset: f64,
    /// Metres of one vertical unit, and its name as found (`m`, `US survey foot`); 1 and empty if the file is silent.
    pub vertical_unit: (f64, String),
    /// Where the raster lies.
    pub geo: Geo,
    /// One line for people: `GeoTIFF, tiles 256 x 256, LZW, predictor 2`.
    pub description: String,
    /// Height in rows of the blocks that the file is made of (strip or tile height): reading whole ones is cheapest.
    pub block_rows: u32,
}

/// Samples of a window, row by row, in the type of the file.
#[derive(Clone, Debug, PartialEq)]
#[expect(missing_docs, reason = "one variant for each SampleType")]
pub enum Samples {
    Int8(Vec<i8>),
    Uint8(Vec<u8>),
    Int16(Vec<i16>),
    Uint16(Vec<u16>),
    Int32(Vec<i32>),
    Uint32(Vec<u32>),
    Float32(Vec<f32>),
    Float64(Vec<f64>),
}

/// Runs `$body` with the vector of any variant as `$samples`.
macro_rules! with_samples {
    ($window:expr, $samples:ident => $body:expr) => {
        match $window {
            Samples::Int8($samples) => $body,
            Samples::Uint8($samples) => $body,
            Samples::Int16($samples) => $body,
            Samples::Uint16($samples) => $body,
            Samples::Int32($samples) => $body,
            Samples::Uint32($samples) => $body,
            Samples::Float32($samples) => $body,
            Samples::Float64($samples) => $body,
        }
    };
}

impl Samples {
    /// How many there are.
    pub fn len(&self) -> usize {
        with_samples!(self, samples => samples.len())
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Their type.
    pub fn sample_type(&self) -> SampleType {
        match self {
            Self::Int8(_) => SampleType::Int8,
            Self::Uint8(_) => SampleType::Uint8,
            Self::Int16(_) => SampleType::Int16,
            Self::Uint16(_) => SampleType::Uint16,
            Self::Int32(_) => SampleType::Int32,
            Self::Uint32(_) => SampleType::Uint32,
            Self::Float32(_) => SampleType::Float32,
            Self::Float64(_) => SampleType::Float64,
        }
    }

    /// The sample at an index as a float64, which holds every type exactly; NaN beyond the end.
    #[expect(clippy::useless_conversion, reason = "of one of the eight variants only")]
    pub fn value(&self, index: usize) -> f64 {
        with_samples!(self, samples => samples.get(index).map_or(f64::NAN, |&sample| f64::from(sample)))
    }
}

impl Window {
    /// True if the sample at an index is void: masked out, equal to `nodata`, NaN or infinite.
    pub fn is_void(&self, index: usize, nodata: Option<f64>) -> bool {
        let value = self.samples.value(index);
        let masked = self.mask.as_ref().is_some_and(|mask| mask.get(index).is_none_or(|&valid| valid == 0));
        masked || !value.is_finite() || nodata == Some(value)
    }
}

/// Refuses rows that are not in the raster.
fn check_rows(info: &SourceInfo, rows: &Range<u32>) -> Result<()> {
    if rows.start > rows.end || rows.end > info.height {
        return Err(Error::usage(format!("rows {rows:?} of a raster of {} rows", info.height)));
    }
    Ok(())
}

/// A window of a raster.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    /// The samples, `width * height` of them.
    pub samples: Samples,
    /// The file's own mask, non-zero where valid; `None` if the file has none.
    pub mask: Option<Vec<u8>>,
}

/// A raster that windows can be read from, from several threads.
pub trait Source: Send + Sync {
    /// What the raster is.
    fn info(&self) -> &SourceInfo;

    /// Samples of `rows.len()` whole rows, `info().width` each. Rows must lie inside the raster.
    ///
    /// Reading bands from north to south decodes no block of the file twice.
    fn read_rows(&self, rows: Range<u32>) -> Result<Window>;
}
