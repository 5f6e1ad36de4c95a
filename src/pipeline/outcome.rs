//! Checks that a file can be read before it gets its name.
//!
//! What is wrong with an input is reported before the build ([`check_input`]), or as soon as the
//! heights are known ([`check_heights`]). [`inspect`] finds everything else: it reads the finished
//! file as any reader would.

use std::path::Path;

use crate::container::metadata::Statistics;
use crate::container::reader::Reader;
use crate::error::{Error, Result};
use crate::source::SourceInfo;

/// Fails if a number that a source states about itself cannot be stored in a file. The error names
/// the quantity.
pub fn check_input(info: &SourceInfo) -> Result<()> {
    let number = |what: &str, expected: &str, is: bool, got: f64| {
        if is { Ok(()) } else { Err(Error::format(what, expected, got)) }
    };
    let (scale, offset, unit) = (info.band_scale, info.band_offset, info.vertical_unit.0);
    number("band scale", "a finite number, not 0", scale.is_finite() && scale != 0.0, scale)?;
    number("band offset", "a finite number", offset.is_finite(), offset)?;
    number("metres of the vertical unit", "a finite number above 0", unit.is_finite() && unit > 0.0, unit)?;
    let metres = scale * unit;
    number("band scale in metres", "a finite number, not 0", metres.is_finite() && metres != 0.0, metres)?;
    let crs = &info.geo.crs;
    number(
        "unit of the coordinates",
        "a finite number above 0",
        crs.unit.is_finite() && crs.unit > 0.0,
        crs.unit,
    )?;
    let (a, inverse) = (crs.ellipsoid.a, crs.ellipsoid.inverse_flattening);
    number("semi-major axis of the ellipsoid", "a finite number above 0", a.is_finite() && a > 0.0, a)?;
    let is = inverse.is_finite() && inverse >= 0.0;
    number("inverse flattening of the ellipsoid", "a finite number, at least 0", is, inverse)?;
    for &key in crs.keys.iter().flat_map(|keys| &keys.doubles) {
        number("GeoTIFF keys, double parameters", "finite numbers", key.is_finite(), key)?;
    }
    let Some(transform) = info.geo.transform else { return Ok(()) };
    if let Some(&term) = transform.iter().find(|term| !term.is_finite()) {
        return Err(Error::format("geotransform", "finite numbers", term));
    }
    let bounds = info.geo.bounds(info.width, info.height);
    if bounds.iter().all(|edge| edge.is_finite()) {
        return Ok(());
    }
    let expected = format!("finite edges of {} x {} pixels", info.width, info.height);
    Err(Error::format("geotransform", expected, format!("{bounds:?} of {transform:?}")))
}

/// Fails if a height in metres is not finite.
pub fn check_heights(info: &SourceInfo, statistics: &Statistics) -> Result<()> {
    let heights = statistics.levels.iter().flat_map(|level| level.min_m.into_iter().chain(level.max_m));
    match heights.into_iter().find(|metres| !metres.is_finite()) {
        None => Ok(()),
        Some(metres) => {
            let (scale, offset, unit) = (info.band_scale, info.band_offset, info.vertical_unit.0);
            let got = format!(
                "{metres}, by a band scale of {scale}, a band offset of {offset} and a unit of {unit} m"
            );
            Err(Error::format("heights", "finite metres", got))
        }
    }
}

/// Fails if there are warnings and they are to be errors.
pub fn check_warnings(warnings: &[String], strict: bool) -> Result<()> {
    match warnings {
        [first, rest @ ..] if strict => {
            let more = if rest.is_empty() { String::new() } else { format!(" (and {} more)", rest.len()) };
            Err(Error::usage(format!("{first}{more}; nothing is built, as warnings are to be errors")))
        }
        _ => Ok(()),
    }
}

/// Opens a finished file and reads all of it that is not a tile: header, metadata, every page of
/// the index, statistics.
pub fn inspect(path: &Path) -> Result<()> {
    let read = || {
        let reader = Reader::open(path)?;
        reader.walk(&mut |_| Ok(()))?;
        reader.statistics()?;
        reader.imagery().map_or(Ok(()), |layer| layer.walk(&mut |_| Ok(())))
    };
    read().map_err(|error| match error {
        Error::Io { .. } | Error::Interrupted => error,
        other => {
            let what = "the finished file cannot be read, and was not given its name; please report this with the input";
            Error::usage(format!("{what}: {other}"))
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::{Geo, GeoKeys};
    use crate::sample::SampleType;

    fn info() -> SourceInfo {
        SourceInfo {
            width: 32,
            height: 32,
            sample_type: SampleType::Int16,
            nodata: None,
            band_scale: 1.0,
            band_offset: 0.0,
            vertical_unit: (1.0, String::new()),
            geo: Geo { transform: Some([5e5, 10.0, 0.0, 5e6, 0.0, -10.0]), ..Geo::default() },
            description: String::new(),
            parts: Vec::new(),
            footprint: None,
            overlap: None,
            block_rows: 32,
            reading: crate::source::ReadMemory::default(),
            warnings: Vec::new(),
            origins: crate::source::Origins::default(),
        }
    }

    #[test]
    fn a_file_that_cannot_be_read_is_not_good() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), b"no container").unwrap();
        let refusal = inspect(file.path()).unwrap_err().to_string();
        assert!(refusal.contains("was not given its name"), "{refusal}");
    }

    type Edit = fn(&mut SourceInfo);

    #[test]
    fn numbers_that_no_file_can_hold_are_named() {
        assert!(check_input(&info()).is_ok());
        let edits: [(&str, Edit); 13] = [
            ("band scale", |i| i.band_scale = f64::NAN),
            ("band scale", |i| i.band_scale = 0.0),
            ("band offset", |i| i.band_offset = f64::INFINITY),
            ("vertical unit", |i| i.vertical_unit.0 = 0.0),
            ("scale in metres", |i| (i.band_scale, i.vertical_unit.0) = (1e308, 1000.0)),
            ("coordinates", |i| i.geo.crs.unit = f64::NAN),
            ("semi-major", |i| i.geo.crs.ellipsoid.a = f64::INFINITY),
            ("flattening", |i| i.geo.crs.ellipsoid.inverse_flattening = -1.0),
            ("GeoTIFF keys", |i| {
                let doubles = vec![1.0, f64::NAN];
                i.geo.crs.keys = Some(GeoKeys { doubles, ..GeoKeys::default() });
            }),
            ("geotransform", |i| i.geo.transform = Some([0.0, f64::NAN, 0.0, 0.0, 0.0, 1.0])),
            ("geotransform", |i| i.geo.transform = Some([0.0, 1e308, 0.0, 0.0, 0.0, -1.0])),
            ("geotransform", |i| i.geo.transform = Some([0.0, 1.0, 0.0, f64::NEG_INFINITY, 0.0, -1.0])),
            ("geotransform", |i| i.geo.transform = Some([0.0, 1.0, 0.0, 0.0, 0.0, -1e307])),
        ];
        for (name, edit) in edits {
            let mut info = info();
            edit(&mut info);
            let refusal = check_input(&info).unwrap_err().to_string();
            assert!(refusal.contains(name), "{name}: {refusal}");
        }
    }
}
