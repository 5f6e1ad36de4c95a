//! Checks that rasters share horizontal and vertical coordinates.

use std::path::Path;

use crate::crs;
use crate::error::{Error, Result};
use crate::geo::{Crs, CrsKind};
use crate::source::SourceInfo;

/// Relative difference at which two numbers in files count as equal.
const ROUNDING: f64 = 1e-9;

/// Refuses two rasters unless their coordinate systems are known to be the same.
pub(crate) fn same_crs(a: (&Path, &SourceInfo), b: (&Path, &SourceInfo)) -> Result<()> {
    let (one, other) = (&a.1.geo.crs, &b.1.geo.crs);
    let vertical = one.vertical_epsg.zip(other.vertical_epsg);
    if crs::are_same(one, other) && vertical.is_none_or(|(one, other)| one == other) {
        return Ok(());
    }
    Err(Error::usage(format!(
        "{}: its coordinate system is {}, that of {} is {}; give `crs` to bring both into one (in a build with \
         --features gdal), or gdal_edit.py -a_srs if a file is wrong about itself",
        b.0.display(),
        crs_name(other),
        a.0.display(),
        crs_name(one)
    )))
}

/// Refuses two rasters with different vertical units.
pub(crate) fn same_unit(a: (&Path, &SourceInfo), b: (&Path, &SourceInfo)) -> Result<()> {
    let (one, other) = (&a.1.vertical_unit, &b.1.vertical_unit);
    if near(one.0, other.0) {
        return Ok(());
    }
    let unit = |unit: &(f64, String)| match unit.1.as_str() {
        "" => "metres (it says nothing of them)".to_owned(),
        name => format!("{name} ({} m)", unit.0),
    };
    Err(Error::usage(format!(
        "{}: its heights are in {}, those of {} in {}; give `vertical_unit` if all are in one unit, or convert one",
        b.0.display(),
        unit(other),
        a.0.display(),
        unit(one)
    )))
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() <= ROUNDING * a.abs().max(b.abs())
}

/// Name of a coordinate system for messages.
pub(crate) fn crs_name(crs: &Crs) -> String {
    match (crs.epsg, crs.vertical_epsg, crs.name.as_str()) {
        (Some(code), Some(vertical), _) => format!("EPSG:{code}+{vertical}"),
        (Some(code), None, _) => format!("EPSG:{code}"),
        (None, _, "") if crs.kind == CrsKind::Engineering => "not given".to_owned(),
        (None, _, "") => "user-defined".to_owned(),
        (None, _, name) => format!("\u{201c}{name}\u{201d}"),
    }
}
