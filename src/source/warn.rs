//! The sentences of [`SourceInfo::warnings`](super::SourceInfo::warnings): file, what was found,
//! what can be done about it.
//!
//! What can be done is said in the words of [`advice`], which a program that has an option for it
//! can look for.

use std::path::Path;

use super::file_name;
use crate::sample::SampleType;

/// What can be done, in the words of every warning.
pub mod advice {
    /// State which value means void ([`OpenOptions::nodata`](crate::source::OpenOptions::nodata)).
    pub const NODATA: &str = "state the nodata value";
    /// Choose a band ([`OpenOptions::band`](crate::source::OpenOptions::band)).
    pub const BAND: &str = "choose another band";
    /// State the vertical unit
    /// ([`OpenOptions::vertical_unit`](crate::source::OpenOptions::vertical_unit)).
    pub use crate::crs::geokeys::UNIT_ADVICE as UNIT;
    /// Say that samples are depths ([`OpenOptions::depth`](crate::source::OpenOptions::depth)).
    pub const DEPTH: &str = "state that the samples are depths";
    /// Warp to another coordinate system ([`OpenOptions::warp`](crate::source::OpenOptions::warp)).
    pub const CRS: &str = "warp to a system in which they are near";
}

/// A mask beside a nodata value.
pub(super) fn mask_and_nodata(path: &Path, nodata: f64) -> String {
    let name = file_name(path);
    format!(
        "{name}: there is a mask beside the nodata value {nodata}, and the mask alone counts, as in GDAL; if samples of that \
         value are void too, {}",
        advice::NODATA
    )
}

/// An alpha band beside a nodata value.
pub(super) fn alpha_and_nodata(path: &Path, nodata: f64) -> String {
    let name = file_name(path);
    format!("{name}: there is an alpha band beside the nodata value {nodata}, which alone counts, as in GDAL")
}

/// Of several bands the first was taken, or it looks like something else than heights; `None` if
/// nothing is odd. `colours` says what the samples are by the file's own word: `RGB`, `palette`.
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

/// Warnings of many rasters, of which no more are told than anybody reads.
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
