//! Files to sources: by name, by what a file begins with, and many as one.

use std::cell::Cell;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

#[cfg(feature = "gdal")]
use super::gdal;
use super::mosaic::{Mosaic, Piece};
use super::warp::Warp;
use super::{Source, file_name, hgt, stated, tiff, vrt};
use crate::error::{Error, Result};
use crate::limits::Limits;

/// Opens a raster: a GeoTIFF, a GDAL virtual raster or an SRTM tile natively, anything else (and what needs more)
/// through GDAL if that is built in.
pub fn open(path: &Path, limits: &Limits) -> Result<Box<dyn Source>> {
    open_file(path, None, &Nest { limits, depth: 0, files: &Cell::new(0) })
}

/// How deep files stand in one another, and how many have been opened on the way.
#[derive(Clone, Copy)]
pub(super) struct Nest<'a> {
    pub(super) limits: &'a Limits,
    pub(super) depth: u32,
    pub(super) files: &'a Cell<u64>,
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
pub(super) fn piece(path: &Path, nodata: Option<f64>, nest: &Nest) -> Result<Piece> {
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
    /// Metres and name of the vertical unit of every file, instead of what it says itself; see [`super::unit::parse`].
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
