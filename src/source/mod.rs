//! Rasters to read from: size, georeference and windows of samples, in any order, bounded memory.
//!
//! A source knows nothing of tiles. It gives samples in their own type, with a validity of their own (GDAL mask),
//! and says which value means void; [`Window::is_void`] joins the two.

mod epsg;
#[cfg(feature = "gdal")]
pub mod gdal;
pub mod geokeys;
pub mod hgt;
mod metadata;
pub mod mosaic;
pub mod picture;
mod stated;
pub mod tiff;
pub mod unit;
mod vrt;
pub mod warp;
mod wkt;

use std::cell::Cell;
use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use serde::{Deserialize, Serialize};

use self::mosaic::{Mosaic, Piece};
use self::warp::Warp;
use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::limits::Limits;
use crate::sample::SampleType;

/// Opens a raster: a GeoTIFF, a GDAL virtual raster or an SRTM tile natively, anything else (and what needs more)
/// through GDAL if that is built in.
pub fn open(path: &Path, limits: &Limits) -> Result<Box<dyn Source>> {
    open_file(path, None, &Nest { limits, depth: 0, files: &Cell::new(0) })
}

/// How deep files stand in one another, and how many have been opened on the way.
#[derive(Clone, Copy)]
pub(crate) struct Nest<'a> {
    limits: &'a Limits,
    depth: u32,
    files: &'a Cell<u64>,
}

impl Nest<'_> {
    /// One more file.
    fn count(&self) -> Result<()> {
        self.files.set(self.files.get() + 1);
        match self.files.get() {
            files if files > self.limits.mosaic_files => {
                Err(Error::limit("the number of files of a mosaic", files, self.limits.mosaic_files))
            }
            _ => Ok(()),
        }
    }
}

/// Opens a raster; `nodata` is what means void in the files of a VRT, instead of what it says.
fn open_file(path: &Path, nodata: Option<f64>, nest: &Nest) -> Result<Box<dyn Source>> {
    if names_no_file(path) {
        #[cfg(feature = "gdal")]
        return Ok(Box::new(gdal::GdalSource::open(path, nest.limits)?));
        #[cfg(not(feature = "gdal"))]
        return Err(Error::unsupported("a name that only GDAL understands", NEEDS_GDAL).at(path));
    }
    match open_native(path, nodata, nest) {
        #[cfg(feature = "gdal")]
        Err(Error::Unsupported { .. }) => Ok(Box::new(gdal::GdalSource::open(path, nest.limits)?)),
        opened => opened,
    }
}

fn open_native(path: &Path, nodata: Option<f64>, nest: &Nest) -> Result<Box<dyn Source>> {
    Ok(match format(path)? {
        Format::Vrt => Box::new(vrt::open(path, nodata, nest)?),
        Format::Hgt => Box::new(hgt::HgtSource::open(path, nest.limits)?),
        Format::Tiff => Box::new(tiff::TiffSource::open(path, nest.limits)?),
    })
}

/// Formats that are read natively.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    Vrt,
    Hgt,
    /// Or something else: its reader says so.
    Tiff,
}

/// Looks at the name of a file and at its first bytes.
fn format(path: &Path) -> Result<Format> {
    if path.is_dir() {
        let what = format!("{}: a folder; give the files in it, as in {0}/*.tif", path.display());
        return Err(Error::usage(what));
    }
    let mut start = Vec::new();
    File::open(path)
        .map_err(|error| Error::io(path, "open", error))?
        .take(LOOK)
        .read_to_end(&mut start)
        .map_err(|error| Error::io(path, "read", error))?;
    if start.starts_with(b"PK\x03\x04") {
        return Err(Error::unsupported("a zip archive", "unpack it and give what is in it").at(path));
    }
    let text = start.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(&start).trim_ascii_start();
    if text.first() == Some(&b'<') && text.windows(11).any(|word| word == b"<VRTDataset") {
        return Ok(Format::Vrt);
    }
    let is_hgt = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("hgt"));
    Ok(if is_hgt { Format::Hgt } else { Format::Tiff })
}

/// A file as a part of a mosaic. A VRT stays open (its own files do not), every other file only while it is needed.
fn piece(path: &Path, nodata: Option<f64>, nest: &Nest) -> Result<Piece> {
    let source = open_file(path, nodata, nest)?;
    if !names_no_file(path) && format(path)? == Format::Vrt {
        return Ok(Piece::held(path.to_owned(), source));
    }
    let (again, limits) = (path.to_owned(), *nest.limits);
    Ok(Piece::lazy(path.to_owned(), source.info().clone(), Box::new(move || open(&again, &limits))))
}

/// Bytes of a file that tell its format: a VRT may have comments in front.
const LOOK: u64 = 1024;

/// True if a name means something to GDAL although there is no such file: `/vsizip/…`, `NETCDF:"file":variable`.
fn names_no_file(path: &Path) -> bool {
    let text = path.to_string_lossy();
    // One letter and a colon is a drive.
    let driver = text
        .find(':')
        .is_some_and(|at| at > 1 && text[..at].chars().all(|c| c.is_ascii_alphanumeric() || c == '_'));
    !path.exists() && (text.starts_with("/vsi") || driver)
}

/// What to call a container of this raster, without an extension: the file's own name, or of `NETCDF:"file":variable`
/// both.
pub fn stem(path: &Path) -> String {
    let name = file_name(path);
    if !names_no_file(path) || !name.contains(['"', ':']) {
        return Path::new(&name)
            .file_stem()
            .map(|stem| stem.to_string_lossy().into_owned())
            .unwrap_or_default();
    }
    let driver = usize::from(path.to_string_lossy().starts_with(&name));
    let mut words = name.split(['"', ':']).filter(|word| !word.is_empty()).skip(driver);
    let file = Path::new(words.next().unwrap_or_default()).file_stem().unwrap_or_default();
    words.fold(file.to_string_lossy().into_owned(), |stem, word| format!("{stem}_{word}"))
}

/// How files become one source.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {
    /// Value that means void in every file, instead of what it says itself.
    pub nodata: Option<f64>,
    /// Which sample counts where files overlap.
    pub overlap: Overlap,
    /// Metres and name of the vertical unit of every file, instead of what it says itself; see [`unit::parse`].
    pub vertical_unit: Option<(f64, String)>,
    /// True if the samples are depths, positive down: heights are their negatives.
    pub depth: bool,
    /// The grid that the files are warped to; `None`: their own.
    pub warp: Option<Warp>,
}

/// Which of several valid samples of one place counts. A void in one file never hides a valid sample of another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Overlap {
    /// That of the first file, in the order in which they were given.
    First,
    /// That of the last one, as in GDAL.
    #[default]
    Last,
    /// The lowest.
    Min,
    /// The highest.
    Max,
    /// Their mean: the sum in float64, in the order of the files, by their number; of whole numbers the nearest, of
    /// two as near the one away from zero.
    Mean,
}

/// Opens one or more files as one raster; several are joined, see [`Mosaic::of`].
///
/// Of a single file `options.overlap` does not count, and `options.nodata` only within a VRT, which is a mosaic whose
/// files lie on top of one another as it says.
pub fn open_all(paths: &[PathBuf], options: &OpenOptions, limits: &Limits) -> Result<Box<dyn Source>> {
    if let Some(warp) = &options.warp {
        return open_warped(paths, warp, options, limits);
    }
    let files = Cell::new(0);
    let nest = Nest { limits, depth: 0, files: &files };
    match paths {
        [] => Err(Error::usage("there is no DEM to read")),
        [path] => {
            let source = open_file(path, options.nodata, &nest)?;
            if source.info().overlap.is_some_and(|own| options.overlap != own) {
                return Err(Error::usage(format!(
                    "{}: a VRT says itself which file lies on top; for --overlap give the files one by one",
                    path.display()
                )));
            }
            Ok(stated::apply(source, options))
        }
        _ => {
            let piece = |path: &PathBuf| {
                nest.count()?;
                let mut piece = piece(path, options.nodata, &nest)?;
                stated::state(&mut piece.info, options);
                Ok(piece)
            };
            let pieces = paths.iter().map(piece).collect::<Result<_>>()?;
            Ok(Box::new(Mosaic::of(pieces, options, limits)?))
        }
    }
}

#[cfg(feature = "gdal")]
fn open_warped(
    paths: &[PathBuf],
    warp: &Warp,
    options: &OpenOptions,
    limits: &Limits,
) -> Result<Box<dyn Source>> {
    gdal::warp::open_all(paths, warp, options, limits)
}

#[cfg(not(feature = "gdal"))]
fn open_warped(paths: &[PathBuf], _: &Warp, _: &OpenOptions, _: &Limits) -> Result<Box<dyn Source>> {
    let path = paths.first().cloned().unwrap_or_default();
    Err(Error::unsupported("warping (--crs, --resolution, --resampling)", NEEDS_GDAL).at(&path))
}

/// What to do where only GDAL can help.
pub(crate) const NEEDS_GDAL: &str = if cfg!(feature = "gdal") {
    "GDAL does not read it either"
} else {
    "install GDAL (Debian: apt-get install libgdal-dev) and relevo with it: cargo install relevo --features gdal"
};

/// A file that samples come from, as recorded in the container.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Part {
    /// Name of the file, without its folder.
    pub name: String,
    /// One line for people: `GeoTIFF, tiles 256 x 256, LZW, predictor 2`.
    pub description: String,
}

/// A rectangle of samples.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rect {
    /// Columns, from the west.
    pub columns: Range<u32>,
    /// Rows, from the north.
    pub rows: Range<u32>,
}

/// What a raster is, known when it is opened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
    /// The files that it is made of, in their order; a mosaic has several.
    pub parts: Vec<Part>,
    /// Where valid samples can be: all else is void, and need not be read. `None`: anywhere.
    pub footprint: Option<Vec<Rect>>,
    /// Which sample counts where parts overlap; `None` for a single file.
    pub overlap: Option<Overlap>,
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
#[cfg(feature = "gdal")]
pub(crate) use with_samples;

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

/// Columns of rows that are `width` wide.
fn crop<T: Copy>(samples: &[T], width: usize, columns: &Range<usize>) -> Vec<T> {
    samples.chunks_exact(width.max(1)).flat_map(|row| &row[columns.clone()]).copied().collect()
}

impl Window {
    /// Some columns of a window that is `width` wide.
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

    /// True if the sample at an index is void: masked out, equal to `nodata`, NaN or infinite.
    pub fn is_void(&self, index: usize, nodata: Option<f64>) -> bool {
        let value = self.samples.value(index);
        let masked = self.mask.as_ref().is_some_and(|mask| mask.get(index).is_none_or(|&valid| valid == 0));
        masked || !value.is_finite() || nodata == Some(value)
    }
}

/// Refuses a window that does not lie in the raster.
fn check_window(info: &SourceInfo, columns: &Range<u32>, rows: &Range<u32>) -> Result<()> {
    if rows.start > rows.end || rows.end > info.height {
        return Err(Error::usage(format!("rows {rows:?} of a raster of {} rows", info.height)));
    }
    if columns.start > columns.end || columns.end > info.width {
        return Err(Error::usage(format!("columns {columns:?} of a raster of {} columns", info.width)));
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
    fn read_rows(&self, rows: Range<u32>) -> Result<Window> {
        self.read_window(0..self.info().width, rows)
    }

    /// Samples of a window, row by row, `columns.len()` each. It must lie inside the raster.
    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window>;

    /// The files as they are on disk now: differs from what it was as soon as one of them has been written to, replaced or removed.
    fn fingerprint(&self) -> Result<Fingerprint>;

    /// Lets go of memory and files that are kept for a next window; a later window only takes longer.
    fn release(&self) {}
}

/// What tells one state of a source from another.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// Every file that samples come from.
    pub files: Vec<FileStamp>,
}

/// State of one file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileStamp {
    /// Name of the file, without its folder.
    pub name: String,
    /// Its length.
    pub bytes: u64,
    /// Time of its last change, nanoseconds since 1970; 0 where the system has none.
    pub modified_ns: u64,
}

/// Name of a file without its folder.
pub fn file_name(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

impl FileStamp {
    /// The stamp of a file.
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
