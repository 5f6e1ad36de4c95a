//! Rasters to read from: size, georeference and windows of samples, in any order, bounded memory.
//!
//! A source knows nothing of tiles. It gives samples in their own type, with a validity of their own (GDAL mask),
//! and says which value means void; [`Window::is_void`] joins the two.

use crate::error::Result;
use crate::geo::Geo;
use crate::sample::SampleType;

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
    fn read_rows(&self, rows: std::ops::Range<u32>) -> Result<Window>;
}
