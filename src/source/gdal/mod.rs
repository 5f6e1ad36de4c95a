//! Rasters read by GDAL, behind the feature `gdal`: other formats, and TIFFs with compressions not
//! read natively.
//!
//! Band 1 holds the heights unless another is chosen. GDAL's mask is used if it holds more than the
//! nodata value, or an alpha band that GDAL does not take for a mask. A GDAL dataset serves one
//! thread at a time, so reads are serialised; GDAL's block cache keeps blocks that bands share.
//! GDAL's messages are not printed but become part of errors.

mod blocks;
pub(super) mod describe;
pub(super) mod files;
mod operation;
pub(super) mod picture;
mod target;
pub mod warp;
mod warped;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, Once, PoisonError};

use gdal::Dataset;
use gdal::errors::GdalError;
use gdal::raster::{GdalType, RasterBand};

use super::{Fingerprint, Origin, Samples, Source, SourceInfo, Window, check_window};
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::sample::SampleType;

/// A raster opened by GDAL.
pub struct GdalSource {
    path: PathBuf,
    files: Vec<PathBuf>,
    info: SourceInfo,
    dataset: Mutex<Dataset>,
    /// Number of the band, from 1.
    band: usize,
    validity: Validity,
}

/// How valid samples are marked, besides the nodata value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Validity {
    /// Not at all.
    All,
    /// GDAL's mask of the band.
    Mask,
    /// An alpha band, from 1: a sample is valid where it is not 0.
    Alpha(usize),
}

impl GdalSource {
    /// Opens a raster and checks its size and type.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self> {
        Self::open_band(path, None, limits)
    }

    /// Opens a raster as [`GdalSource::open`] does, with the heights in band `chosen`, from 1.
    pub fn open_band(path: &Path, chosen: Option<u32>, limits: &Limits) -> Result<Self> {
        let dataset = dataset(path)?;
        let (info, validity) =
            describe::describe(&dataset, path, chosen, limits).map_err(|error| error.at(path))?;
        let (mut files, band) = (files::of(&dataset, path), chosen.unwrap_or(1) as usize);
        if let Some(Origin::Prj(name)) = &info.origins.crs {
            files.push(path.with_file_name(name));
        }
        Ok(Self { path: path.to_owned(), files, info, dataset: Mutex::new(dataset), band, validity })
    }

    fn window(&self, columns: &Range<u32>, rows: &Range<u32>) -> Result<Window, GdalError> {
        let dataset = self.dataset.lock().unwrap_or_else(PoisonError::into_inner);
        let band = dataset.rasterband(self.band)?;
        let samples = match self.info.sample_type {
            // GDAL before 3.7 has no int8 and gives it as a kind of byte; later versions convert it
            // to int16 exactly.
            SampleType::Int8 if band.band_type().name() == "Byte" => {
                Samples::Int8(read::<u8>(&band, columns, rows)?.into_iter().map(u8::cast_signed).collect())
            }
            SampleType::Int8 => {
                Samples::Int8(read::<i16>(&band, columns, rows)?.into_iter().map(|s| s as i8).collect())
            }
            SampleType::Uint8 => Samples::Uint8(read(&band, columns, rows)?),
            SampleType::Int16 => Samples::Int16(read(&band, columns, rows)?),
            SampleType::Uint16 => Samples::Uint16(read(&band, columns, rows)?),
            SampleType::Int32 => Samples::Int32(read(&band, columns, rows)?),
            SampleType::Uint32 => Samples::Uint32(read(&band, columns, rows)?),
            SampleType::Float32 => Samples::Float32(read(&band, columns, rows)?),
            SampleType::Float64 => Samples::Float64(read(&band, columns, rows)?),
        };
        let mask = match self.validity {
            Validity::All => None,
            Validity::Mask => Some(read(&band.open_mask_band()?, columns, rows)?),
            Validity::Alpha(alpha) => {
                let alpha = read::<f64>(&dataset.rasterband(alpha)?, columns, rows)?;
                // NaN as alpha does not make a sample valid.
                Some(alpha.into_iter().map(|alpha| u8::from(alpha.abs() > 0.0)).collect())
            }
        };
        Ok(Window { samples, mask })
    }
}

impl Source for GdalSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window> {
        check_window(&self.info, &columns, &rows)?;
        self.window(&columns, &rows).map_err(|error| {
            let place = format!("rows {} to {}", rows.start, rows.end);
            Error::format(place, "samples", format!("GDAL's error: {error}")).at(&self.path)
        })
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        files::fingerprint(&self.files)
    }

    fn files(&self) -> Vec<PathBuf> {
        self.files.clone()
    }
}

/// Opens a dataset read-only and unshared.
fn dataset(path: &Path) -> Result<Dataset> {
    static READY: Once = Once::new();
    READY.call_once(|| {
        gdal::config::set_error_handler(|_, _, _| {});
        // GDAL's own default is 5 % of all memory.
        if std::env::var_os("GDAL_CACHEMAX").is_none() {
            // SAFETY: sets a number, before this program reads anything through GDAL.
            #[expect(unsafe_code, reason = "the bindings have no safe call for it")]
            unsafe {
                gdal_sys::GDALSetCacheMax64(BLOCK_CACHE);
            }
        }
    });
    let name = super::open::for_gdal(path, &Limits::default()).map_err(|error| error.at(path))?;
    Dataset::open(name).map_err(|error| {
        let what = match error {
            GdalError::NullPointer { msg, .. } if msg.is_empty() => "GDAL does not know it".to_owned(),
            GdalError::NullPointer { msg, .. } => format!("GDAL cannot open it ({msg})"),
            error => format!("GDAL cannot open it ({error})"),
        };
        Error::unsupported(what, "see what gdalinfo says of it").at(path)
    })
}

/// Bytes of GDAL's block cache for all rasters together, unless `GDAL_CACHEMAX` is set.
const BLOCK_CACHE: i64 = 64 << 20;

fn read<T: GdalType + Copy>(
    band: &RasterBand<'_>,
    columns: &Range<u32>,
    rows: &Range<u32>,
) -> Result<Vec<T>, GdalError> {
    let size = (columns.len(), rows.len());
    if rows.is_empty() || columns.is_empty() {
        return Ok(Vec::new());
    }
    let start = (columns.start as isize, rows.start as isize);
    Ok(band.read_as::<T>(start, size, size, None)?.into_shape_and_vec().1)
}
