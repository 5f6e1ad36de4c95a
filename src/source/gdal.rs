//! Any raster that GDAL opens, behind the feature `gdal`: other formats, and TIFFs with compressions not read natively.
//!
//! Band 1 is the elevation. GDAL's mask comes along where it says more than the nodata value does. A GDAL dataset
//! serves one thread at a time, so reads are serialised; GDAL's own block cache keeps what bands share. GDAL's
//! messages are not printed: they come back in the errors.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, Once, PoisonError};

use gdal::errors::GdalError;
use gdal::raster::{GdalType, RasterBand};
use gdal::spatial_ref::SpatialRef;
use gdal::{Dataset, Metadata};

use super::{
    FileStamp, Fingerprint, Part, Samples, Source, SourceInfo, Window, check_window, epsg, file_name,
    metadata, wkt,
};
use crate::error::{Error, Result};
use crate::geo::{Crs, CrsKind, Ellipsoid, Geo};
use crate::limits::Limits;
use crate::sample::SampleType;

/// A raster opened by GDAL.
pub struct GdalSource {
    path: PathBuf,
    info: SourceInfo,
    dataset: Mutex<Dataset>,
    has_mask: bool,
}

impl GdalSource {
    /// Opens a raster and checks its size and type.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self> {
        static QUIET: Once = Once::new();
        QUIET.call_once(|| gdal::config::set_error_handler(|_, _, _| {}));
        let dataset = Dataset::open(path).map_err(|error| {
            let what = format!("GDAL cannot open it ({error})");
            Error::unsupported(what, "see what gdalinfo says of it").at(path)
        })?;
        let (info, has_mask) = describe(&dataset, path, limits).map_err(|error| error.at(path))?;
        Ok(Self { path: path.to_owned(), info, dataset: Mutex::new(dataset), has_mask })
    }

    fn window(&self, columns: &Range<u32>, rows: &Range<u32>) -> Result<Window, GdalError> {
        let dataset = self.dataset.lock().unwrap_or_else(PoisonError::into_inner);
        let band = dataset.rasterband(1)?;
        let samples = match self.info.sample_type {
            // GDAL before 3.7 has no int8 and calls it a kind of byte; later ones convert to int16 exactly.
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
        let mask = self.has_mask.then(|| read(&band.open_mask_band()?, columns, rows)).transpose()?;
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
        Ok(Fingerprint { files: vec![FileStamp::of(&self.path)?] })
    }
}

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

/// Everything known at once, and whether the mask is to be read.
fn describe(dataset: &Dataset, path: &Path, limits: &Limits) -> Result<(SourceInfo, bool)> {
    let wrong = |error: GdalError| Error::format("band 1", "a raster band", error);
    let band = dataset.rasterband(1).map_err(wrong)?;
    let (width, height) = band.size();
    let sample_type = sample_type(&band)?;
    let flags = band.mask_flags().map_err(wrong)?;
    let (crs, vertical) = crs(dataset.spatial_ref().ok().as_ref());
    let transform = dataset.geo_transform().ok();
    let pixel_is_point = dataset.metadata_item("AREA_OR_POINT", "").is_some_and(|word| word == "Point");
    let unit = band.unit();
    let description = format!("{} through GDAL", dataset.driver().long_name());
    let info = SourceInfo {
        width: side("the width of the raster", width, limits)?,
        height: side("the height of the raster", height, limits)?,
        sample_type,
        nodata: band.no_data_value().map(|value| metadata::rounded(value, sample_type)),
        band_scale: band.scale().unwrap_or(1.0),
        band_offset: band.offset().unwrap_or(0.0),
        vertical_unit: metadata::vertical_unit(Some(&unit), vertical),
        geo: Geo { transform, pixel_is_point, crs },
        parts: vec![Part { name: file_name(path), description: description.clone() }],
        footprint: None,
        overlap: None,
        description,
        block_rows: u32::try_from(band.block_size().1.clamp(1, height.max(1))).unwrap_or(1),
    };
    Ok((info, !flags.is_all_valid() && !flags.is_nodata()))
}

fn side(what: &str, value: usize, limits: &Limits) -> Result<u32> {
    let value = value as u64;
    match u32::try_from(value) {
        Ok(0) => Err(Error::format(what, "at least 1", 0)),
        Ok(side) if value <= limits.raster_side => Ok(side),
        _ => Err(Error::limit(what, value, limits.raster_side)),
    }
}

fn sample_type(band: &RasterBand<'_>) -> Result<SampleType> {
    let name = band.band_type().name();
    let signed = band.metadata_item("PIXELTYPE", "IMAGE_STRUCTURE").is_some_and(|word| word == "SIGNEDBYTE");
    if name == "Byte" && signed {
        return Ok(SampleType::Int8);
    }
    let found = SampleType::ALL.into_iter().find(|kind| kind.gdal_name() == name);
    found.ok_or_else(|| {
        // The bindings have no name for the complex types.
        let what = if name == "Unknown" { "complex samples".to_owned() } else { format!("{name} samples") };
        Error::unsupported(what, "convert it with gdal_translate -ot Float32 (or Int32, Float64)")
    })
}

/// The coordinate system, and metres and name of the vertical unit if it has a vertical part.
fn crs(spatial: Option<&SpatialRef>) -> (Crs, Option<(f64, String)>) {
    let Some(spatial) = spatial else {
        return (Crs { wkt: wkt::engineering(1.0), ..Crs::default() }, None);
    };
    let attribute = |path: &str, child| spatial.get_attr_value(path, child).ok().flatten();
    let code = |node: &str| {
        let authority = format!("{node}|AUTHORITY");
        attribute(&authority, 0).filter(|name| name.eq_ignore_ascii_case("EPSG"))?;
        attribute(&authority, 1)?.parse::<u32>().ok()
    };
    let (kind, unit, epsg) = if spatial.is_projected() {
        (CrsKind::Projected, spatial.linear_units(), code("PROJCS"))
    } else if spatial.is_geographic() {
        (CrsKind::Geographic, spatial.angular_units(), code("GEOGCS"))
    } else {
        (CrsKind::Engineering, spatial.linear_units(), None)
    };
    let vertical_unit = attribute("VERT_CS|UNIT", 0).zip(attribute("VERT_CS|UNIT", 1));
    let vertical_unit = vertical_unit.and_then(|(name, metres)| Some((metadata::number(&metres)?, name)));
    let crs = Crs {
        kind,
        epsg,
        name: spatial.name().unwrap_or_default(),
        wkt: wkt2(spatial),
        ellipsoid: ellipsoid(spatial).unwrap_or_else(|| epsg::geographic_ellipsoid(epsg)),
        unit: if unit > 0.0 && unit.is_finite() { unit } else { 1.0 },
        vertical_epsg: code("VERT_CS"),
        keys: None,
    };
    (crs, vertical_unit)
}

fn ellipsoid(spatial: &SpatialRef) -> Option<Ellipsoid> {
    let (a, b) = (spatial.semi_major().ok()?, spatial.semi_minor().ok()?);
    let inverse_flattening = if b < a { a / (a - b) } else { 0.0 };
    (a > 0.0 && b > 0.0).then_some(Ellipsoid { a, inverse_flattening })
}

/// WKT 2, which the bindings give only by way of an option of the thread.
fn wkt2(spatial: &SpatialRef) -> String {
    let option = "OSR_WKT_FORMAT";
    if gdal::config::set_thread_local_config_option(option, "WKT2_2019").is_err() {
        return String::new();
    }
    let text = spatial.to_wkt().unwrap_or_default();
    // Failing to clear it would only mean WKT 2 for others on this thread.
    let _ = gdal::config::clear_thread_local_config_option(option);
    text
}
