//! What GDAL says of a raster: size, type, georeference, units.

use std::ffi::{CStr, c_char};
use std::path::Path;

use gdal::errors::GdalError;
use gdal::raster::RasterBand;
use gdal::spatial_ref::SpatialRef;
use gdal::{Dataset, Metadata};

use crate::error::{Error, Result};
use crate::geo::{Crs, CrsKind, Ellipsoid, Geo};
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::{Part, SourceInfo, epsg, file_name, metadata, unit, wkt};

/// Everything known at once, and whether the mask is to be read.
pub(super) fn describe(dataset: &Dataset, path: &Path, limits: &Limits) -> Result<(SourceInfo, bool)> {
    let wrong = |error: GdalError| Error::format("band 1", "a raster band", error);
    let band = dataset.rasterband(1).map_err(|error| {
        let names = dataset.metadata_domain("SUBDATASETS").unwrap_or_default();
        match names.iter().find_map(|line| line.split_once("_NAME=")) {
            Some((_, name)) => {
                Error::unsupported("several rasters in one file", format!("name one of them: {name}"))
            }
            None => wrong(error),
        }
    })?;
    let (width, height) = band.size();
    let sample_type = sample_type(&band)?;
    let flags = band.mask_flags().map_err(wrong)?;
    let (crs, vertical) = crs(dataset.spatial_ref().ok().as_ref());
    let transform = dataset.geo_transform().ok();
    let pixel_is_point = dataset.metadata_item("AREA_OR_POINT", "").is_some_and(|word| word == "Point");
    let unit = band.unit();
    let description = format!("{} through GDAL", dataset.driver().long_name());
    let info = SourceInfo {
        width: side("the width of the raster", width as u64, limits)?,
        height: side("the height of the raster", height as u64, limits)?,
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

/// Width or height of a raster, checked.
pub(super) fn side(what: &str, value: u64, limits: &Limits) -> Result<u32> {
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
pub(super) fn crs(spatial: Option<&SpatialRef>) -> (Crs, Option<(f64, String)>) {
    let Some(spatial) = spatial else {
        return (Crs { wkt: wkt::engineering(1.0), ..Crs::default() }, None);
    };
    let attribute = |path: &str, child| spatial.get_attr_value(path, child).ok().flatten();
    let code = |node| epsg_code(spatial, node);
    let (kind, step, epsg) = if spatial.is_projected() {
        (CrsKind::Projected, spatial.linear_units(), code(c"PROJCS"))
    } else if spatial.is_geographic() {
        (CrsKind::Geographic, spatial.angular_units(), code(c"GEOGCS"))
    } else {
        (CrsKind::Engineering, spatial.linear_units(), None)
    };
    let vertical_unit = attribute("VERT_CS|UNIT", 0).zip(attribute("VERT_CS|UNIT", 1));
    let vertical_unit = vertical_unit.and_then(|(name, metres)| {
        let written = metadata::number(&metres)?;
        // WKT has 15 digits.
        let exact = unit::metres_of(&name).filter(|exact| (exact / written - 1.0).abs() < 1e-9);
        Some((exact.unwrap_or(written), name))
    });
    let crs = Crs {
        kind,
        epsg,
        name: spatial.name().unwrap_or_default(),
        wkt: wkt2(spatial),
        ellipsoid: ellipsoid(spatial).unwrap_or_else(|| epsg::geographic_ellipsoid(epsg)),
        unit: if step > 0.0 && step.is_finite() { step } else { 1.0 },
        vertical_epsg: code(c"VERT_CS"),
        vertical_name: attribute("VERT_CS", 0).unwrap_or_default(),
        vertical_down: attribute("VERT_CS|AXIS", 1).is_some_and(|word| word.eq_ignore_ascii_case("down")),
        keys: None,
    };
    (crs, vertical_unit)
}

/// EPSG code of a part of a coordinate system itself, not of what that is made of (a user's own projection has none,
/// its datum has one).
fn epsg_code(spatial: &SpatialRef, node: &CStr) -> Option<u32> {
    // SAFETY: the system is valid, the node a C string; what comes back is null or a C string that lives as long as
    // the system is not changed, and is copied here.
    #[expect(unsafe_code, reason = "the bindings ask for the whole system only")]
    let (name, code) = unsafe {
        let text = |text: *const c_char| {
            (!text.is_null()).then(|| CStr::from_ptr(text).to_string_lossy().into_owned())
        };
        let system = spatial.to_c_hsrs();
        let name = text(gdal_sys::OSRGetAuthorityName(system, node.as_ptr()))?;
        (name, text(gdal_sys::OSRGetAuthorityCode(system, node.as_ptr()))?)
    };
    name.eq_ignore_ascii_case("EPSG").then(|| code.parse().ok()).flatten()
}

fn ellipsoid(spatial: &SpatialRef) -> Option<Ellipsoid> {
    let (a, b) = (spatial.semi_major().ok()?, spatial.semi_minor().ok()?);
    let inverse_flattening = if b < a { a / (a - b) } else { 0.0 };
    (a > 0.0 && b > 0.0).then_some(Ellipsoid { a, inverse_flattening })
}

/// WKT 2, which the bindings give only by way of an option of the thread.
pub(super) fn wkt2(spatial: &SpatialRef) -> String {
    let option = "OSR_WKT_FORMAT";
    if gdal::config::set_thread_local_config_option(option, "WKT2_2019").is_err() {
        return String::new();
    }
    let text = spatial.to_wkt().unwrap_or_default();
    // Failing to clear it would only mean WKT 2 for others on this thread.
    let _ = gdal::config::clear_thread_local_config_option(option);
    text
}
