//! The sentences of [`SourceInfo::warnings`](super::SourceInfo::warnings): file, finding, advice.
//!
//! Advice is worded as in [`advice`], so that a program with an option for it can find and replace
//! it.

use std::path::Path;

use super::file_name;
use crate::sample::SampleType;

/// The advice in warnings.
pub mod advice {
    /// State the nodata value ([`OpenOptions::nodata`](crate::source::OpenOptions::nodata)).
    pub const NODATA: &str = "state the nodata value";
    /// Choose a band ([`OpenOptions::band`](crate::source::OpenOptions::band)).
    pub const BAND: &str = "choose another band";
    /// State the vertical unit
    /// ([`OpenOptions::vertical_unit`](crate::source::OpenOptions::vertical_unit)).
    pub use crate::crs::geokeys::UNIT_ADVICE as UNIT;
    /// State that samples are depths ([`OpenOptions::depth`](crate::source::OpenOptions::depth)).
    pub const DEPTH: &str = "state that the samples are depths";
    /// Warp to another coordinate system ([`OpenOptions::warp`](crate::source::OpenOptions::warp)).
    pub const CRS: &str = "warp to a system in which they are near";
}

/// Warning about a mask beside a nodata value.
pub(super) fn mask_and_nodata(path: &Path, nodata: f64) -> String {
    let name = file_name(path);
    format!(
        "{name}: there is a mask beside the nodata value {nodata}, and the mask alone counts, as in GDAL; if samples of that \
         value are void too, {}",
        advice::NODATA
    )
}

/// Warning about an alpha band beside a nodata value.
pub(super) fn alpha_and_nodata(path: &Path, nodata: f64) -> String {
    let name = file_name(path);
    format!("{name}: there is an alpha band beside the nodata value {nodata}, which alone counts, as in GDAL")
}

/// Warning that the first of several bands was read, or that the band does not look like heights;
/// `None` if neither applies. `colours` is the file's own word for the samples: `RGB`, `palette`.
pub(super) fn odd_band(path: &Path, bands: u32, kind: SampleType, colours: Option<&str>) -> Option<String> {
    let looks = match (kind, colours) {
        (_, Some("palette")) => ", palette: looks like a raster of classes",
        (_, Some("RGB")) => ", RGB: looks like a picture",
        (SampleType::Uint8, _) if bands >= 3 => ": looks like a picture",
        _ if bands == 1 => return None,
        _ => "",
    };
    let (name, kind) = (file_name(path), kind.gdal_name());
    Some(if bands == 1 {
        format!("{name}: its band is taken as heights ({kind}{looks})")
    } else {
        let which = advice::BAND;
        format!("{name}: band 1 of {bands} is taken as heights ({kind}{looks}); if that is wrong, {which}")
    })
}

/// The warnings of many rasters, shortened to a readable number.
pub(super) fn joined<'a>(all: impl Iterator<Item = &'a [String]>) -> Vec<String> {
    const MOST: usize = 20;
    let mut some = Vec::new();
    let mut more = 0_u64;
    for warning in all.flatten() {
        if some.contains(warning) {
            continue;
        }
        if some.len() < MOST { some.push(warning.clone()) } else { more += 1 }
    }
    if more > 0 {
        some.push(format!("and {more} more warnings of this kind, of other files"));
    }
    some
}
