//! Files to sources: by name, by what a file begins with, and many as one.

use std::cell::Cell;
use std::ffi::{OsStr, OsString};
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::cropped::{self, Bbox};
#[cfg(feature = "gdal")]
use super::gdal;
use super::mosaic::{Mosaic, Piece};
use super::warp::Warp;
use super::{Source, earth, file_name, gzip, hgt, kind, stated, tiff, vrt};
use crate::error::{Error, Result};
use crate::limits::Limits;

/// Opens a raster: a GeoTIFF, a GDAL virtual raster or an SRTM tile natively, also gzipped,
/// anything else (and what is refused here) through GDAL if that is built in.
pub fn open(path: &Path, limits: &Limits) -> Result<Box<dyn Source>> {
    open_file(path, None, &Nest { limits, depth: 0, files: &Cell::new(0), band: None })
}

/// How deep files stand in one another, how many have been opened on the way, and what is wanted of
/// them.
#[derive(Clone, Copy)]
pub(super) struct Nest<'a> {
    pub(super) limits: &'a Limits,
    pub(super) depth: u32,
    pub(super) files: &'a Cell<u64>,
    /// The band that is asked for, from 1; `None`: the first, and nobody has chosen it.
    pub(super) band: Option<u32>,
}

impl Nest<'_> {
    /// One more file.
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

/// Opens a raster; `nodata` is what means void in the files of a VRT, instead of what it says.
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

/// What GDAL makes of a file that is refused here: a limit is one for GDAL too, and a system that
/// refuses a file refuses it to all. If GDAL fails as well both reasons are told, the first one
/// first.
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

/// True if a file is damaged whoever reads it. A packed one that is cut off and a VRT with a number
/// that is none are read by GDAL all the same, as far as they go and as 0; a file that a VRT names
/// has been shown to GDAL already.
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

/// The name under which GDAL is given a file. A VRT that names something on a network is refused.
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

/// The first bytes of a file, of a gzipped one those of its content.
pub(super) fn start(path: &Path) -> Result<Vec<u8>> {
    let mut start = Vec::new();
    let read = gzip::stream(path)?.0.take(kind::LOOK as u64).read_to_end(&mut start);
    read.map_err(|error| gzip::read_error(path, error))?;
    Ok(start)
}

/// The name of a file, without the `.gz` of a gzipped one.
fn unpacked_name(path: &Path) -> PathBuf {
    let name = PathBuf::from(path.file_name().unwrap_or_default());
    let is_packed = name.extension().is_some_and(|word| word.eq_ignore_ascii_case("gz"));
    if is_packed { name.with_extension("") } else { name }
}

/// A file as a part of a mosaic. A VRT stays open (its own files do not), every other file only
/// while it is needed.
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

/// True if a name means something to GDAL although there is no such file: `/vsizip/…`,
/// `NETCDF:"file":variable`.
fn names_no_file(path: &Path) -> bool {
    let text = path.to_string_lossy();
    // One letter and a colon is a drive.
    let driver = text
        .find(':')
        .is_some_and(|at| at > 1 && text[..at].chars().all(|c| c.is_ascii_alphanumeric() || c == '_'));
    !path.exists() && (text.starts_with("/vsi") || driver)
}

/// What to call a container of this raster, without an extension: the file's own name, or of
/// `NETCDF:"file":variable` both.
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

/// How files become one source.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {
    /// Value that means void in every file, instead of what it says itself.
    pub nodata: Option<f64>,
    /// The band that has the heights, from 1, of every file; `None`: the first.
    pub band: Option<u32>,
    /// Which sample counts where files overlap.
    pub overlap: Overlap,
    /// Metres and name of the vertical unit of every file, instead of what it says itself; see
    /// [`super::unit::parse`].
    pub vertical_unit: Option<(f64, String)>,
    /// True if the samples are depths, positive down: heights are their negatives.
    pub depth: bool,
    /// The grid that the files are warped to; `None`: their own.
    pub warp: Option<Warp>,
    /// The part that is wanted; `None`: all of it.
    pub bbox: Option<Bbox>,
}

/// Which of several valid samples of one place counts. A void in one file never hides a valid
/// sample of another.
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
    /// Their mean: the sum in float64, in the order of the files, by their number; of whole numbers
    /// the nearest, of two as near the one away from zero.
    Mean,
}

/// Opens one or more files as one raster; several are joined, see [`Mosaic::of`].
///
/// Of a single file `options.overlap` does not count, and `options.nodata` only within a VRT, which
/// is a mosaic whose files lie on top of one another as it says.
///
/// A place whose numbers overflow is refused, one that the Earth contradicts is warned of.
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

/// What to do where only GDAL can help.
pub(crate) const NEEDS_GDAL: &str = if cfg!(feature = "gdal") {
    "GDAL does not read it either"
} else {
    "install GDAL (Debian: apt-get install libgdal-dev) and relevo with it: cargo install relevo --features gdal"
};
