//! Rasters as sources: their size and georeference, and windows of samples in any order, within
//! bounded memory.
//!
//! A source knows nothing of tiles. It gives samples in their own type, with a validity mask if it
//! has one, and the nodata value; [`Window::is_void`] combines the two.

pub mod account;
// Its test needs no GDAL.
#[cfg(any(test, feature = "gdal"))]
mod archive;
pub mod cropped;
mod earth;
#[cfg(feature = "gdal")]
pub mod gdal;
mod gzip;
pub mod hgt;
mod kind;
mod markup;
mod metadata;
pub mod mosaic;
mod nodata;
mod open;
pub mod picture;
mod stated;
pub mod tiff;
pub mod unit;
mod vrt;
mod warn;
pub mod warp;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use serde::{Deserialize, Serialize};
use wincode::{SchemaRead, SchemaWrite};

pub use self::account::{Origin, Origins};
pub use self::nodata::Nodata;
pub use self::open::{OpenOptions, Overlap, open, open_all, stem};
pub use self::warn::advice;

use crate::error::{Error, Result};
use crate::geo::Geo;
pub use crate::rect::Rect;
use crate::sample::SampleType;

/// A file that samples come from, as recorded in the container.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, SchemaRead, SchemaWrite)]
pub struct Part {
    /// Name of the file, without its folder.
    pub name: String,
    /// One line for people: `GeoTIFF, tiles 256 x 256, LZW, predictor 2`.
    pub description: String,
}

/// The properties of a raster, known when it is opened.
#[derive(Clone, Debug, PartialEq, SchemaRead, SchemaWrite)]
pub struct SourceInfo {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Type of the samples of the elevation band.
    pub sample_type: SampleType,
    /// The value that means void; see [`Nodata`] for the samples equal to it. NaN and infinities
    /// are always void.
    pub nodata: Option<f64>,
    /// GDAL scale: `real = band_offset + band_scale * value`; 1 unless the file says so.
    pub band_scale: f64,
    /// GDAL offset; 0 unless the file says so.
    pub band_offset: f64,
    /// Metres and name of the vertical unit as found (`m`, `US survey foot`); 1 and an empty name
    /// if the file does not say.
    pub vertical_unit: (f64, String),
    /// Georeference of the raster.
    pub geo: Geo,
    /// One line for people: `GeoTIFF, tiles 256 x 256, LZW, predictor 2`.
    pub description: String,
    /// The files that the raster is made of, in order; a mosaic has several.
    pub parts: Vec<Part>,
    /// Rectangles that hold all valid samples: everything else is void and need not be read.
    /// `None`: anywhere.
    pub footprint: Option<Vec<Rect>>,
    /// The rule for samples where files overlap; `None` for a single file.
    pub overlap: Option<Overlap>,
    /// Rows of a block of the file (a strip or a row of tiles): reading whole ones is cheapest.
    pub block_rows: u32,
    /// Memory that reading the raster takes.
    pub reading: ReadMemory,
    /// Oddities of the raster and decisions about it, a sentence each: what was found, and what can
    /// be done.
    pub warnings: Vec<String>,
    /// Where place, coordinate system, nodata, unit, scale, offset and mask were found.
    pub origins: Origins,
}

impl SourceInfo {
    /// The samples that the nodata value makes void.
    pub fn voids(&self) -> Nodata {
        Nodata::new(self.nodata, self.sample_type)
    }
}

/// Most bytes of memory that reading a raster takes. Whole blocks are decoded, even for a small
/// window.
#[derive(Clone, Copy, Debug, Default, PartialEq, SchemaRead, SchemaWrite)]
pub struct ReadMemory {
    /// Bytes for each sample of a window while it is read, including the window itself.
    pub sample: u64,
    /// Bytes of a row of decoded blocks, for each column of the raster: a sweep keeps such rows.
    pub column: f64,
    /// Bytes of the largest decoded block.
    pub block: u64,
    /// Bytes that each decoding thread takes.
    pub thread: u64,
}

impl ReadMemory {
    /// Memory of a raster without blocks, whose samples take `sample` bytes.
    pub fn plain(sample: u64) -> Self {
        Self { sample, ..Self::default() }
    }

    /// Memory of two bands that are read together.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            sample: self.sample.saturating_add(other.sample),
            column: self.column + other.column,
            block: self.block.saturating_add(other.block),
            thread: self.thread.max(other.thread),
        }
    }

    /// Memory of reading `part` of the `whole` columns: blocks, which are decoded whole, extend
    /// beyond both sides, and above and below if they lie in `several_rows`.
    #[must_use]
    pub fn of_part(self, (whole, part): (u32, u32), several_rows: bool) -> Self {
        let (whole, part) = (f64::from(whole.max(1)), f64::from(part.max(1)));
        let row = (self.column * part + 2.0 * self.block as f64).min(self.column * whole);
        let rows = if several_rows { 2.0 } else { 1.0 };
        Self { column: rows * row / part, ..self }
    }

    /// Memory of either of two rasters, whichever takes more.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            sample: self.sample.max(other.sample),
            column: self.column.max(other.column),
            block: self.block.max(other.block),
            thread: self.thread.max(other.thread),
        }
    }

    /// Bytes of the blocks that a sweep keeps or decodes, on `threads` threads. The sweep reads
    /// bands of `band` rows over `columns` columns in `runs` runs; blocks extend beyond both ends
    /// of a run.
    pub fn blocks(
        self,
        (columns, runs): (u64, u64),
        (band, block_rows): (u64, u32),
        (width, height): (u32, u32),
        threads: u64,
    ) -> u64 {
        let block_rows = u64::from(block_rows.max(1));
        let all = u64::from(height).div_ceil(block_rows);
        // Rows of blocks in memory: the first band keeps all of its own. From then on one row is
        // kept, one replaces it, and the memory of one waits for use.
        let rows = (band.saturating_sub(2) / block_rows + 2).max(3).min(all);
        let of = |columns: u64| (columns as f64 * self.column).ceil() as u64;
        let row = of(columns).saturating_add((2 * runs).saturating_mul(self.block)).min(of(width.into()));
        // There are no more blocks to decode at a time than in the raster, and where all are kept
        // the decoded block is one of those counted.
        let blocks = row.checked_div(self.block).map(|blocks| (blocks + 1).saturating_mul(rows));
        let threads = threads.min(blocks.unwrap_or(u64::MAX));
        let thread = if rows == all { self.thread.saturating_sub(self.block) } else { self.thread };
        row.saturating_mul(rows).saturating_add(thread.saturating_mul(threads))
    }
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
#[cfg(feature = "gdal")]
pub(crate) use with_samples;

impl Samples {
    /// Number of samples.
    pub fn len(&self) -> usize {
        with_samples!(self, samples => samples.len())
    }

    /// True if there are no samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Type of the samples.
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

    /// An empty list of samples of a type.
    pub fn none(sample_type: SampleType) -> Self {
        match sample_type {
            SampleType::Int8 => Self::Int8(Vec::new()),
            SampleType::Uint8 => Self::Uint8(Vec::new()),
            SampleType::Int16 => Self::Int16(Vec::new()),
            SampleType::Uint16 => Self::Uint16(Vec::new()),
            SampleType::Int32 => Self::Int32(Vec::new()),
            SampleType::Uint32 => Self::Uint32(Vec::new()),
            SampleType::Float32 => Self::Float32(Vec::new()),
            SampleType::Float64 => Self::Float64(Vec::new()),
        }
    }

    /// The sample at an index as a float64, which holds every type exactly; NaN beyond the end.
    #[expect(clippy::useless_conversion, reason = "of one of the eight variants only")]
    pub fn value(&self, index: usize) -> f64 {
        with_samples!(self, samples => samples.get(index).map_or(f64::NAN, |&sample| f64::from(sample)))
    }
}

/// The samples in `columns` of rows that are `width` wide.
fn crop<T: Copy>(samples: &[T], width: usize, columns: &Range<usize>) -> Vec<T> {
    samples.chunks_exact(width.max(1)).flat_map(|row| &row[columns.clone()]).copied().collect()
}

impl Window {
    /// The samples in `columns` of a window that is `width` wide.
    #[must_use]
    pub fn cropped(self, width: u32, columns: &Range<u32>) -> Self {
        if *columns == (0..width) {
            return self;
        }
        let (width, columns) = (width as usize, columns.start as usize..columns.end as usize);
        let samples = match &self.samples {
            Samples::Int8(v) => Samples::Int8(crop(v, width, &columns)),
            Samples::Uint8(v) => Samples::Uint8(crop(v, width, &columns)),
            Samples::Int16(v) => Samples::Int16(crop(v, width, &columns)),
            Samples::Uint16(v) => Samples::Uint16(crop(v, width, &columns)),
            Samples::Int32(v) => Samples::Int32(crop(v, width, &columns)),
            Samples::Uint32(v) => Samples::Uint32(crop(v, width, &columns)),
            Samples::Float32(v) => Samples::Float32(crop(v, width, &columns)),
            Samples::Float64(v) => Samples::Float64(crop(v, width, &columns)),
        };
        Self { samples, mask: self.mask.map(|mask| crop(&mask, width, &columns)) }
    }

    /// True if the sample at an index is void: masked out, equal to the nodata value, NaN or
    /// infinite.
    pub fn is_void(&self, index: usize, nodata: Nodata) -> bool {
        let value = self.samples.value(index);
        let masked = self.mask.as_ref().is_some_and(|mask| mask.get(index).is_none_or(|&valid| valid == 0));
        masked || !value.is_finite() || nodata.is(value)
    }
}

/// Refuses a window that does not lie inside the raster.
fn check_window(info: &SourceInfo, columns: &Range<u32>, rows: &Range<u32>) -> Result<()> {
    if rows.start > rows.end || rows.end > info.height {
        return Err(Error::usage(format!("rows {rows:?} of a raster of {} rows", info.height)));
    }
    if columns.start > columns.end || columns.end > info.width {
        return Err(Error::usage(format!("columns {columns:?} of a raster of {} columns", info.width)));
    }
    Ok(())
}

/// The samples of a rectangle of a raster.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    /// The samples, `width * height` of them.
    pub samples: Samples,
    /// Mask of the file, non-zero where a sample is valid; `None` if the file has none.
    pub mask: Option<Vec<u8>>,
}

/// A raster that several threads can read windows from.
pub trait Source: Send + Sync {
    /// Properties of the raster.
    fn info(&self) -> &SourceInfo;

    /// Samples of whole rows, `info().width` each. The rows must lie inside the raster.
    ///
    /// Reading bands from north to south decodes no block of the file twice.
    fn read_rows(&self, rows: Range<u32>) -> Result<Window> {
        self.read_window(0..self.info().width, rows)
    }

    /// Samples of a window, row by row. The window must lie inside the raster.
    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window>;

    /// The current state of the files on disk: it changes when one of them is written to, replaced
    /// or removed.
    fn fingerprint(&self) -> Result<Fingerprint>;

    /// All files that are read: the raster, its mask, sidecars, the files of a VRT and of a mosaic.
    /// Empty for a raster in memory.
    fn files(&self) -> Vec<PathBuf> {
        Vec::new()
    }

    /// Takes back a window that is no longer needed, so that its memory serves the next one.
    fn take_back(&self, window: Window) {
        drop(window);
    }

    /// Frees memory and closes files kept for the next window, which then takes longer.
    fn release(&self) {}
}

/// The state of all files of a source, to tell whether it has changed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, SchemaRead, SchemaWrite)]
pub struct Fingerprint {
    /// All files that samples come from.
    pub files: Vec<FileStamp>,
}

/// The state of one file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, SchemaRead, SchemaWrite)]
pub struct FileStamp {
    /// Name of the file, without its folder.
    pub name: String,
    /// Length in bytes.
    pub bytes: u64,
    /// Time of the last change, in nanoseconds since 1970; 0 if the system has none.
    pub modified_ns: u64,
}

/// Name of a file without its folder.
pub fn file_name(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

impl FileStamp {
    /// The stamp of a file on disk.
    pub fn of(path: &Path) -> Result<Self> {
        let metadata = std::fs::metadata(path).map_err(|source| Error::io(path, "look at it", source))?;
        let modified = metadata.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        Ok(Self {
            name: file_name(path),
            bytes: metadata.len(),
            modified_ns: modified.map_or(0, |age| age.as_nanos() as u64),
        })
    }
}
