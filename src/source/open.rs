//! Opens files as sources, by name and first bytes, and joins several into one.

use std::cell::Cell;
use std::ffi::{OsStr, OsString};
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use wincode::{SchemaRead, SchemaWrite};

use super::cropped::{self, Bbox};
#[cfg(feature = "gdal")]
use super::gdal;
use super::mosaic::{Mosaic, Piece};
use super::warp::Warp;
use super::{Source, earth, file_name, gzip, hgt, kind, stated, tiff, vrt};
use crate::error::{Error, Result};
use crate::limits::Limits;

/// Opens a raster: a GeoTIFF, a GDAL virtual raster or an SRTM tile natively, gzipped or not. Other
/// formats, and files refused here, are opened by GDAL if it is built in.
pub fn open(path: &Path, limits: &Limits) -> Result<Box<dyn Source>> {
    open_file(path, None, &Nest { limits, depth: 0, files: &Cell::new(0), band: None })
}

/// Depth of nested files, number of files opened so far, and options for them.
#[derive(Clone, Copy)]
pub(super) struct Nest<'a> {
    pub(super) limits: &'a Limits,
    pub(super) depth: u32,
    pub(super) files: &'a Cell<u64>,
    /// The chosen band, from 1; `None`: the first, by default.
    pub(super) band: Option<u32>,
}

impl Nest<'_> {
    /// Counts one more opened file.
    pub(super) fn count(&self) -> Result<()> {
        self.files.set(self.files.get() + 1);
        match self.files.get() {
            files if files > self.limits.mosaic_files => {
                Err(Error::limit("the number of files of a mosaic", files, self.limits.mosaic_files))
            }
            _ => Ok(()),
        }
    }
}

/// Opens a raster. Within a VRT, `nodata` replaces the nodata value that it gives for its files.
fn open_file(path: &Path, nodata: Option<f64>, nest: &Nest) -> Result<Box<dyn Source>> {
    if names_no_file(path) {
        #[cfg(feature = "gdal")]
        return Ok(Box::new(gdal::GdalSource::open_band(path, nest.band, nest.limits)?));
        #[cfg(not(feature = "gdal"))]
        return Err(Error::unsupported("a name that only GDAL understands", NEEDS_GDAL).at(path));
    }
    let native = open_native(path, nodata, nest);
    #[cfg(feature = "gdal")]
    let native = native.or_else(|error| {
        let opened = or_by_gdal(path, error, || gdal::GdalSource::open_band(path, nest.band, nest.limits))?;
        Ok(Box::new(opened) as Box<dyn Source>)
    });
    native.map_err(|error: Error| error.at(path))
}

fn open_native(path: &Path, nodata: Option<f64>, nest: &Nest) -> Result<Box<dyn Source>> {
    Ok(match format(path)? {
        Format::Vrt => Box::new(vrt::open(path, nodata, nest)?),
        Format::Hgt => {
            if let Some(band) = nest.band.filter(|&band| band != 1) {
                return Err(tiff::no_band(band.wrapping_sub(1), 1).at(path));
            }
            Box::new(hgt::HgtSource::open(path, nest.limits)?)
        }
        Format::Tiff => Box::new(tiff::TiffSource::open_band(path, nest.band, nest.limits)?),
    })
}

/// Opens by GDAL a file that was refused here as unsupported, or as malformed where GDAL may know
/// better. Limits and failed reads hold for GDAL too. If GDAL fails as well, the error gives both
/// reasons, that of this program first.
#[cfg(feature = "gdal")]
pub(super) fn or_by_gdal<T>(path: &Path, refused: Error, open: impl FnOnce() -> Result<T>) -> Result<T> {
    match &refused {
        Error::Unsupported { .. } => {}
        Error::Format { path: own, place, .. } if !is_damage(path, own, place) => {}
        _ => return Err(refused),
    }
    open().map_err(|theirs| match theirs {
        Error::Usage { .. } | Error::Interrupted => theirs,
        theirs => both(refused, &theirs),
    })
}

/// True if GDAL must not be tried on a malformed file. It would read a gzipped file that is cut off
/// as far as it goes, and a malformed number in a VRT as 0. A file that a VRT names has been tried
/// by GDAL already.
#[cfg(feature = "gdal")]
fn is_damage(path: &Path, named: &Path, place: &str) -> bool {
    let is_named = !named.as_os_str().is_empty() && named != path;
    is_named || place == gzip::PLACE || start(path).is_ok_and(|start| vrt::is_vrt(&start))
}

#[cfg(feature = "gdal")]
fn both(mut refused: Error, theirs: &Error) -> Error {
    let theirs = theirs.reason();
    match &mut refused {
        Error::Format { got, .. } if !theirs.ends_with(got.as_str()) => {
            got.push_str("; and to GDAL: ");
            got.push_str(&theirs);
        }
        // Other advice holds whatever GDAL says.
        Error::Unsupported { hint, .. } if hint.starts_with(NEEDS_GDAL) => *hint = theirs,
        _ => {}
    }
    refused
}

/// The path by which GDAL opens a file. A VRT that names a file on a network is refused.
#[cfg(feature = "gdal")]
pub(super) fn for_gdal(path: &Path, limits: &Limits) -> Result<PathBuf> {
    if !path.is_file() {
        return Ok(path.to_owned());
    }
    if vrt::is_vrt(&start(path)?) {
        vrt::check_remote(path, limits)?;
    }
    if !gzip::stream(path)?.1 {
        return Ok(path.to_owned());
    }
    let mut inside = std::ffi::OsString::from("/vsigzip/");
    inside.push(path);
    Ok(inside.into())
}

/// Formats read natively.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    Vrt,
    Hgt,
    /// A TIFF, or an unknown format, which the TIFF reader refuses by name.
    Tiff,
}

/// The format of a file, by its name and its first bytes.
fn format(path: &Path) -> Result<Format> {
    if path.is_dir() {
        let what = format!("{}: a folder; give the files in it, as in {0}/*.tif", path.display());
        return Err(Error::usage(what));
    }
    let start = start(path)?;
    if start.starts_with(b"PK\x03\x04") {
        return Err(kind::refusal(&start).at(path));
    }
    if vrt::is_vrt(&start) {
        return Ok(Format::Vrt);
    }
    let is_hgt = unpacked_name(path).extension().is_some_and(|word| word.eq_ignore_ascii_case("hgt"));
    Ok(if is_hgt { Format::Hgt } else { Format::Tiff })
}

/// The first bytes of a file, unpacked if it is gzipped.
pub(super) fn start(path: &Path) -> Result<Vec<u8>> {
    let mut start = Vec::new();
    let read = gzip::stream(path)?.0.take(kind::LOOK as u64).read_to_end(&mut start);
    read.map_err(|error| gzip::read_error(path, error))?;
    Ok(start)
}

/// The path of a file without the `.gz` of a gzipped one.
fn unpacked_name(path: &Path) -> PathBuf {
    let name = PathBuf::from(path.file_name().unwrap_or_default());
    let is_packed = name.extension().is_some_and(|word| word.eq_ignore_ascii_case("gz"));
    if is_packed { name.with_extension("") } else { name }
}

/// A file as a piece of a mosaic. A VRT stays open (the files in it do not); any other file is open
/// only while it is read.
pub(super) fn piece(path: &Path, nodata: Option<f64>, nest: &Nest) -> Result<Piece> {
    let source = open_file(path, nodata, nest)?;
    if !names_no_file(path) && format(path)? == Format::Vrt {
        return Ok(Piece::held(path.to_owned(), source));
    }
    let (again, limits, band) = (path.to_owned(), *nest.limits, nest.band);
    Ok(Piece::lazy(
        path.to_owned(),
        source.as_ref(),
        Box::new(move || {
            open_file(&again, None, &Nest { limits: &limits, depth: 0, files: &Cell::new(0), band })
        }),
    ))
}

/// True if GDAL opens a name that is not a file: `/vsizip/…`, `NETCDF:"file":variable`.
fn names_no_file(path: &Path) -> bool {
    let text = path.to_string_lossy();
    // A single letter before a colon is a drive.
    let driver = text
        .find(':')
        .is_some_and(|at| at > 1 && text[..at].chars().all(|c| c.is_ascii_alphanumeric() || c == '_'));
    !path.exists() && (text.starts_with("/vsi") || driver)
}

/// Default name, without extension, of a container made from this raster: the file's own name, and
/// for `NETCDF:"file":variable` both names.
pub fn stem(path: &Path) -> OsString {
    let name = file_name(path);
    if !names_no_file(path) || !name.contains(['"', ':']) {
        return unpacked_name(path).file_stem().map(OsStr::to_owned).unwrap_or_default();
    }
    let driver = usize::from(path.to_string_lossy().starts_with(&name));
    let mut words = name.split(['"', ':']).filter(|word| !word.is_empty()).skip(driver);
    let file = Path::new(words.next().unwrap_or_default()).file_stem().unwrap_or_default();
    words.fold(file.to_owned(), |mut stem, word| {
        stem.push("_");
        stem.push(word);
        stem
    })
}

/// How files are opened and joined into one source.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {
    /// Value that means void in every file, in place of the file's own.
    pub nodata: Option<f64>,
    /// Band of the heights in every file, from 1; `None`: the first.
    pub band: Option<u32>,
    /// The rule for samples where files overlap.
    pub overlap: Overlap,
    /// Metres and name of the vertical unit of every file, in place of the file's own; see
    /// [`super::unit::parse`].
    pub vertical_unit: Option<(f64, String)>,
    /// True if the samples are depths, positive down: heights are their negatives.
    pub depth: bool,
    /// The grid to warp the files to; `None`: no warping.
    pub warp: Option<Warp>,
    /// The part to read; `None`: all.
    pub bbox: Option<Bbox>,
}

/// Which valid sample counts where files overlap. A void in one file never hides a valid sample of
/// another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, SchemaRead, SchemaWrite)]
#[serde(rename_all = "lowercase")]
pub enum Overlap {
    /// The sample of the first file, in the order given.
    First,
    /// The sample of the last file, as in GDAL.
    #[default]
    Last,
    /// The lowest sample.
    Min,
    /// The highest sample.
    Max,
    /// The mean: the sum in float64, in the order of the files, divided by their number. Integers
    /// are rounded to the nearest, halves away from zero.
    Mean,
}

/// Opens one or more files as one raster; several are joined, see [`Mosaic::of`].
///
/// For a single file `options.overlap` has no effect, and `options.nodata` has one only within a
/// VRT, whose files overlap as it says.
///
/// A georeference whose numbers overflow is refused; one that contradicts the Earth gives a
/// warning.
pub fn open_all(paths: &[PathBuf], options: &OpenOptions, limits: &Limits) -> Result<Box<dyn Source>> {
    let source = open_joined(paths, options, limits)?;
    let first = paths.first().map_or(Path::new(""), PathBuf::as_path);
    earth::check(source.info()).map_err(|error| error.at(first))?;
    let name = if paths.len() == 1 { file_name(first) } else { "the DEM".to_owned() };
    let doubts = earth::doubts(source.info()).into_iter().map(|doubt| format!("{name}: {doubt}")).collect();
    let source = stated::warned(source, doubts);
    match &options.bbox {
        Some(bbox) => cropped::apply(source, bbox).map_err(|error| error.at(first)),
        None => Ok(source),
    }
}

fn open_joined(paths: &[PathBuf], options: &OpenOptions, limits: &Limits) -> Result<Box<dyn Source>> {
    if let Some(warp) = &options.warp {
        return open_warped(paths, warp, options, limits);
    }
    let files = Cell::new(0);
    let nest = Nest { limits, depth: 0, files: &files, band: options.band };
    match paths {
        [] => Err(Error::usage("there is no DEM to read")),
        [path] => {
            let source = open_file(path, options.nodata, &nest)?;
            if source.info().overlap.is_some_and(|own| options.overlap != own) {
                return Err(Error::usage(format!(
                    "{}: a VRT says itself which file lies on top; for `overlap` give the files one by one",
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
    Err(Error::unsupported("warping to another grid", NEEDS_GDAL).at(&path))
}

/// Advice where only GDAL can read a file.
pub(crate) const NEEDS_GDAL: &str = if cfg!(feature = "gdal") {
    "GDAL does not read it either"
} else {
    "needs GDAL: install it (Debian: apt-get install libgdal-dev), then cargo install relevo --features gdal"
};
