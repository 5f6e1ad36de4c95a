//! Properties of a raster as GDAL gives them: size, type, georeference, units.

use std::ffi::{CStr, c_char};
use std::path::{Path, PathBuf};

use gdal::errors::GdalError;
use gdal::raster::{ColorInterpretation, RasterBand};
use gdal::spatial_ref::SpatialRef;
use gdal::{Dataset, Metadata};

use super::Validity;
use crate::crs::{self, epsg};
use crate::error::{Error, Result};
use crate::geo::{Crs, CrsKind, Ellipsoid, Geo};
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::tiff::no_band;
use crate::source::{
    Origin, Origins, Part, ReadMemory, SourceInfo, account, file_name, metadata, unit, warn,
};

/// All properties, and the kind of validity. `chosen` is the band, from 1, if the user chose one.
pub(super) fn describe(
    dataset: &Dataset,
    path: &Path,
    chosen: Option<u32>,
    limits: &Limits,
) -> Result<(SourceInfo, Validity)> {
    let number = chosen.unwrap_or(1);
    let wrong = |error: GdalError| Error::format(format!("band {number}"), "a raster band", error);
    let count = u32::try_from(dataset.raster_count()).unwrap_or(u32::MAX);
    let band = band_of(dataset, number, &wrong)?;
    let (width, height) = band.size();
    let sample_type = sample_type(&band)?;
    let mut nodata = band.no_data_value().map(|value| metadata::rounded(value, sample_type));
    let mut warnings = Vec::new();
    let alpha = alpha(dataset, number);
    if chosen.is_none() {
        let colours = colours(&band);
        warnings.extend(warn::odd_band(path, count - u32::from(alpha.is_some()), sample_type, colours));
    }
    let validity = validity(&band, alpha, nodata).map_err(wrong)?;
    if let (Validity::Mask, Some(value)) = (validity, nodata) {
        // As in GDAL, a mask overrides the nodata value.
        warnings.push(warn::mask_and_nodata(path, value));
        nodata = None;
    }
    let transform = dataset.geo_transform().ok();
    let (spatial, prj) = spatial(dataset, path, transform.is_some(), limits)?;
    let (crs, vertical) = crs(spatial.as_ref());
    let pixel_is_point = dataset.metadata_item("AREA_OR_POINT", "").is_some_and(|word| word == "Point");
    let (band_scale, band_offset) = (band.scale().unwrap_or(1.0), band.offset().unwrap_or(0.0));
    metadata::check_scale(band_scale, band_offset)?;
    let unit = band.unit();
    let description = format!("{} through GDAL", dataset.driver().long_name());
    let origins = origins(&band, (transform.is_some(), spatial.is_some(), nodata.is_some()), prj, &validity);
    let has_unit = !unit.is_empty() || vertical.is_some();
    let origins = Origins { unit: has_unit.then_some(Origin::Driver), ..origins };
    let info = SourceInfo {
        width: side("the width of the raster", width as u64, limits)?,
        height: side("the height of the raster", height as u64, limits)?,
        sample_type,
        nodata,
        band_scale,
        band_offset,
        vertical_unit: metadata::vertical_unit(Some(&unit), vertical),
        geo: Geo { transform, pixel_is_point, crs },
        parts: vec![Part { name: file_name(path), description: description.clone() }],
        footprint: None,
        overlap: None,
        description,
        block_rows: u32::try_from(band.block_size().1.clamp(1, height.max(1))).unwrap_or(1),
        reading: reading(band.block_size(), width, sample_type),
        warnings,
        origins,
    };
    Ok((info, validity))
}

/// The role of a band, if it is not heights.
fn colours(band: &RasterBand<'_>) -> Option<&'static str> {
    match band.color_interpretation() {
        ColorInterpretation::PaletteIndex => Some("palette"),
        ColorInterpretation::RedBand | ColorInterpretation::GreenBand | ColorInterpretation::BlueBand => {
            Some("RGB")
        }
        _ => None,
    }
}

/// Origins of all properties but the unit; the flags say which of place, coordinate system and
/// nodata there are.
fn origins(
    band: &RasterBand<'_>,
    (place, crs, nodata): (bool, bool, bool),
    prj: Option<Origin>,
    validity: &Validity,
) -> Origins {
    let driver = |is_there: bool| is_there.then_some(Origin::Driver);
    Origins {
        place: driver(place),
        crs: prj.or_else(|| driver(crs)),
        nodata: driver(nodata),
        unit: None,
        scale: driver(band.scale().is_some_and(|scale| scale != 1.0)),
        offset: driver(band.offset().is_some_and(|offset| offset != 0.0)),
        mask: driver(!matches!(validity, Validity::All)),
    }
}

/// The coordinate system of a dataset. A dataset with a place but no coordinate system takes that
/// of the `.prj` beside it; then the path of the `.prj` is returned too.
fn spatial(
    dataset: &Dataset,
    path: &Path,
    has_place: bool,
    limits: &Limits,
) -> Result<(Option<SpatialRef>, Option<Origin>)> {
    let own = dataset.spatial_ref().ok();
    if own.is_some() || !has_place {
        return Ok((own, None));
    }
    Ok(match prj(path, limits)? {
        Some((path, read)) => (Some(read), Some(Origin::Prj(file_name(&path)))),
        None => (None, None),
    })
}

/// The coordinate system in a `.prj` beside a raster, which GDAL ignores for most formats.
pub(in crate::source) fn prj(raster: &Path, limits: &Limits) -> Result<Option<(PathBuf, SpatialRef)>> {
    let Some((path, text)) = account::prj_text(raster, limits)? else { return Ok(None) };
    let read = SpatialRef::from_esri(&text).or_else(|_| SpatialRef::from_wkt(&text));
    let wrong = |error: GdalError| Error::format("projection file", "a coordinate system", error).at(&path);
    Ok(Some((path.clone(), read.map_err(wrong)?)))
}

/// The band with a number, which must be one of the dataset.
fn band_of<'a>(
    dataset: &'a Dataset,
    number: u32,
    wrong: &dyn Fn(GdalError) -> Error,
) -> Result<RasterBand<'a>> {
    let count = u32::try_from(dataset.raster_count()).unwrap_or(u32::MAX);
    if count > 0 && !(1..=count).contains(&number) {
        return Err(no_band(number.wrapping_sub(1), count));
    }
    dataset.rasterband(number as usize).map_err(|error| {
        let names = dataset.metadata_domain("SUBDATASETS").unwrap_or_default();
        match names.iter().find_map(|line| line.split_once("_NAME=")) {
            Some((_, name)) => {
                Error::unsupported("several rasters in one file", format!("name one of them: {name}"))
            }
            None => wrong(error),
        }
    })
}

/// The first alpha band, from 1, unless it is the band itself.
fn alpha(dataset: &Dataset, number: u32) -> Option<usize> {
    let is_alpha = |&band: &usize| {
        let band = dataset.rasterband(band);
        band.is_ok_and(|band| band.color_interpretation() == ColorInterpretation::AlphaBand)
    };
    (1..=dataset.raster_count()).find(is_alpha).filter(|&alpha| alpha != number as usize)
}

fn validity(band: &RasterBand<'_>, alpha: Option<usize>, nodata: Option<f64>) -> Result<Validity, GdalError> {
    let flags = band.mask_flags()?;
    Ok(match alpha {
        _ if flags.is_nodata() => Validity::All,
        _ if !flags.is_all_valid() => Validity::Mask,
        Some(alpha) if nodata.is_none() => Validity::Alpha(alpha),
        _ => Validity::All,
    })
}

/// Memory that GDAL takes to decode a block and a mask. Its block cache is bounded separately.
fn reading(block: (usize, usize), width: usize, sample_type: SampleType) -> ReadMemory {
    let bytes = (block.0 as u64).saturating_mul(block.1 as u64).saturating_mul(sample_type.bytes() as u64);
    let across = width.div_ceil(block.0.max(1)) as f64;
    ReadMemory {
        sample: sample_type.bytes() as u64 + 1,
        column: across * bytes as f64 / width.max(1) as f64,
        block: bytes,
        thread: bytes.saturating_mul(2),
    }
}

/// Width or height of a raster, checked against the limits.
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
        // The bindings have no names for complex types.
        let what = if name == "Unknown" { "complex samples".to_owned() } else { format!("{name} samples") };
        Error::unsupported(what, "convert it with gdal_translate -ot Float32 (or Int32, Float64)")
    })
}

/// The coordinate system, and metres and name of the vertical unit if it has a vertical part.
pub(super) fn crs(spatial: Option<&SpatialRef>) -> (Crs, Option<(f64, String)>) {
    let Some(spatial) = spatial else {
        return (crs::Definition::engineering(String::new(), 1.0).crs(), None);
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
        // WKT gives only 15 digits.
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

/// EPSG code of a node of a coordinate system itself, not of its parts: a user's own projection has
/// no code although its datum has one.
fn epsg_code(spatial: &SpatialRef, node: &CStr) -> Option<u32> {
    // SAFETY: the system is valid, the node a C string; what comes back is null or a C string that
    // lives as long as the system is not changed, and is copied here.
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

/// The text as WKT 2, which the bindings give only through an option of the thread.
pub(super) fn wkt2(spatial: &SpatialRef) -> String {
    let option = "OSR_WKT_FORMAT";
    if gdal::config::set_thread_local_config_option(option, "WKT2_2019").is_err() {
        return String::new();
    }
    let text = spatial.to_wkt().unwrap_or_default();
    // If this fails, other exports of this thread would be WKT 2 as well.
    let _ = gdal::config::clear_thread_local_config_option(option);
    text
}
