//! Checks of a georeference against the size and shape of the Earth.
//!
//! Only blatant contradictions are reported: each is more often a mistake in the file than a real
//! place. A warning says what was found, where, and what can be done; a georeference that cannot be
//! computed with is refused.

use super::SourceInfo;
use crate::crs::Definition;
use crate::error::{Error, Result};
use crate::geo::{CrsKind, Geo};

/// Radii in metres of a body that is taken for the Earth: to about a hundredth.
const EARTH: std::ops::Range<f64> = 6.3e6..6.45e6;
/// Largest pixel side in metres that a raster of the Earth can need.
const LARGEST_PIXEL: f64 = 200_000.0;
/// Degrees beyond which a longitude is wrong even in a raster that begins elsewhere than at -180.
const FARTHEST_LONGITUDE: f64 = 540.0;
/// Largest plausible coordinate of a projection of the Earth, in metres: half its circumference,
/// and as much again for a false origin.
const FARTHEST: f64 = 4.1e7;
/// Metres from the middle of a zone of 6 degrees beyond which transverse Mercator was not meant.
const FARTHEST_IN_ZONE: f64 = 3.0e6;

/// Advice for an impossible georeference.
const ADVICE: &str = "state it anew with gdal_edit.py (-a_srs, -a_ullr) if that is wrong";

/// Refuses a georeference whose derived numbers overflow: they could neither be written nor read
/// back.
pub(super) fn check(info: &SourceInfo) -> Result<()> {
    let geo = &info.geo;
    let Some(transform) = geo.transform else { return Ok(()) };
    let spacing = geo.spacing((0, info.width.saturating_sub(1)), (0, info.height.saturating_sub(1)));
    let bounds = geo.bounds(info.width, info.height);
    let size = [bounds[2] - bounds[0], bounds[3] - bounds[1], spacing.dx, spacing.dy];
    let finite = transform.iter().chain(&bounds).chain(&size).all(|value| value.is_finite());
    // Errors are computed from squares of metres.
    if finite && size.iter().all(|value| value.abs() < 1e100) {
        return Ok(());
    }
    Err(Error::format(
        "the place of the raster (its geotransform)",
        "bounds and pixels that are finite numbers (give it a place with gdal_edit.py -a_ullr)",
        format!("{transform:?}"),
    ))
}

/// Warnings about the georeference of a raster.
pub(super) fn doubts(info: &SourceInfo) -> Vec<String> {
    let geo = &info.geo;
    let body = geo.crs.ellipsoid.a;
    if geo.transform.is_none() || geo.crs.kind == CrsKind::Engineering || !EARTH.contains(&body) {
        return Vec::new();
    }
    let bounds = geo.bounds(info.width, info.height);
    let mut found = match geo.crs.kind {
        CrsKind::Geographic => degrees(geo, bounds),
        _ => metres(geo, bounds),
    };
    let middle = (info.height / 2, info.height / 2);
    let spacing = geo.spacing((info.width / 2, info.width / 2), middle);
    let pixel = spacing.dx.max(spacing.dy);
    if found.is_empty() && pixel > LARGEST_PIXEL {
        found.push(format!("a pixel is {:.0} km wide on the ground: {ADVICE}", pixel / 1000.0));
    }
    found
}

/// Warnings about longitudes and latitudes. A pixel reaches over a pole by half of its height if
/// its sample stands on the pole.
fn degrees(geo: &Geo, [west, south, east, north]: [f64; 4]) -> Vec<String> {
    let unit = geo.crs.unit.to_degrees();
    let [_, a, b, _, d, e] = geo.transform_or_identity();
    let half = 0.5 * (d.abs() + e.abs()) * unit + 1e-6;
    let [west, south, east, north] = [west, south, east, north].map(|value| value * unit);
    if west.abs().max(east.abs()) > 1000.0 && south.abs().max(north.abs()) > 1000.0 {
        return vec![format!(
            "its coordinates are called longitudes and latitudes ({}) and reach from {west} to {east} and from {south} to \
             {north}: they look like metres; {ADVICE}",
            name(geo)
        )];
    }
    let mut found = Vec::new();
    if north > 90.0 + half || south < -90.0 - half {
        let latitude = if north > 90.0 + half { north } else { south };
        found.push(format!("its latitudes reach {latitude}, beyond the pole: {ADVICE}"));
    }
    if west < -FARTHEST_LONGITUDE || east > FARTHEST_LONGITUDE {
        found.push(format!("its longitudes reach from {west} to {east}: {ADVICE}"));
    } else if east - west > 360.0 + (a.abs() + b.abs()) * unit + 1e-6 {
        found.push(format!("it is {} degrees wide, more than once around the Earth: {ADVICE}", east - west));
    }
    found
}

/// Warnings about coordinates in a plane.
fn metres(geo: &Geo, bounds: [f64; 4]) -> Vec<String> {
    let [west, south, east, north] = bounds.map(|value| value * geo.crs.unit);
    let farthest = [west, south, east, north].into_iter().fold(0.0, |most: f64, value| most.max(value.abs()));
    if farthest > FARTHEST {
        return vec![format!(
            "its coordinates ({}) reach {farthest:.0} m, farther than the Earth is around: {ADVICE}",
            name(geo)
        )];
    }
    let [pixel_x, pixel_y] = {
        let [_, a, b, _, d, e] = geo.transform_or_identity();
        [a.hypot(d), b.hypot(e)].map(|side| side * geo.crs.unit)
    };
    if west >= -360.0 && east <= 360.0 && south >= -90.0 && north <= 90.0 && pixel_x.max(pixel_y) < 1.0 {
        return vec![format!(
            "its coordinates are called metres ({}) and reach from {west} to {east} and from {south} to {north}: they look like \
             degrees; {ADVICE}",
            name(geo)
        )];
    }
    let definition = Definition::of(&geo.crs);
    let conversion = definition.as_ref().and_then(|definition| definition.conversion.as_ref());
    let Some(conversion) = conversion.filter(|c| c.method.as_ref().is_ok_and(|method| method.code == 9807))
    else {
        return Vec::new();
    };
    let origin = conversion.value("x_0");
    let off = (west - origin).abs().max((east - origin).abs());
    if off <= FARTHEST_IN_ZONE {
        return Vec::new();
    }
    vec![format!(
        "it reaches {:.0} km from the middle meridian of its zone ({}): {ADVICE}",
        off / 1000.0,
        name(geo)
    )]
}

fn name(geo: &Geo) -> String {
    match geo.crs.epsg {
        Some(code) => format!("EPSG:{code}"),
        None => geo.crs.name.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crs;
    use crate::sample::SampleType;

    fn info(crs: &str, transform: [f64; 6], size: (u32, u32)) -> SourceInfo {
        let geo = Geo { transform: Some(transform), pixel_is_point: false, crs: crs::read(crs).expect(crs) };
        SourceInfo {
            width: size.0,
            height: size.1,
            sample_type: SampleType::Int16,
            nodata: None,
            band_scale: 1.0,
            band_offset: 0.0,
            vertical_unit: (1.0, "m".to_owned()),
            geo,
            description: String::new(),
            parts: Vec::new(),
            footprint: None,
            overlap: None,
            block_rows: 1,
            reading: crate::source::ReadMemory::default(),
            warnings: Vec::new(),
            origins: crate::source::Origins::default(),
        }
    }

    #[test]
    fn what_contradicts_the_earth_is_told() {
        let cases = [
            ("EPSG:4326", [-180.0, 1.0, 0.0, 90.0, 0.0, -1.0], (360, 180), ""),
            ("EPSG:4326", [-180.5, 1.0, 0.0, 90.5, 0.0, -1.0], (361, 181), ""),
            ("EPSG:4326", [0.0, 1.0, 0.0, 95.0, 0.0, -1.0], (10, 10), "latitudes reach 95"),
            ("EPSG:4326", [0.0, 0.1, 0.0, 80.0, 0.0, -0.1], (6000, 10), "longitudes reach"),
            ("EPSG:4326", [-180.0, 0.1, 0.0, 80.0, 0.0, -0.1], (4000, 10), "more than once around"),
            ("EPSG:4326", [5e5, 30.0, 0.0, 4.4e6, 0.0, -30.0], (10, 10), "look like metres"),
            ("EPSG:4326", [-180.0, 60.0, 0.0, 90.0, 0.0, -60.0], (6, 3), "km wide"),
            ("EPSG:32613", [5e5, 10.0, 0.0, 4.4e6, 0.0, -10.0], (70, 50), ""),
            ("EPSG:32613", [5e7, 10.0, 0.0, 4.4e6, 0.0, -10.0], (70, 50), "farther than the Earth"),
            ("EPSG:32613", [-105.0, 0.001, 0.0, 40.0, 0.0, -0.001], (70, 50), "look like degrees"),
            ("EPSG:32613", [1e7, 10.0, 0.0, 4.4e6, 0.0, -10.0], (70, 50), "from the middle meridian"),
            ("EPSG:3857", [-2.004e7, 1e5, 0.0, 2.004e7, 0.0, -1e5], (400, 400), ""),
            ("EPSG:31467", [3.5e6, 10.0, 0.0, 5.5e6, 0.0, -10.0], (70, 50), ""),
            ("+proj=longlat +R=1737400", [0.0, 1.0, 0.0, 95.0, 0.0, -1.0], (10, 10), ""),
        ];
        for (crs, transform, size, wanted) in cases {
            let found = doubts(&info(crs, transform, size));
            let same = if wanted.is_empty() {
                found.is_empty()
            } else {
                found.len() == 1 && found[0].contains(wanted)
            };
            assert!(same, "{crs} {transform:?}: {found:?}");
            assert!(check(&info(crs, transform, size)).is_ok());
        }
    }

    #[test]
    fn numbers_that_overflow_are_refused() {
        for scale in [1e308, 1e200, 1e120] {
            assert!(check(&info("EPSG:32613", [0.0, scale, 0.0, 0.0, 0.0, -scale], (50, 50))).is_err());
        }
    }
}
