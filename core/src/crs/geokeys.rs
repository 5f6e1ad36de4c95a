//! GeoTIFF keys (OGC 19-008) to a coordinate system and a vertical unit, by the rules of GDAL.
//!
//! Keys are used as far as they make sense: a broken set gives an engineering CRS, never an error,
//! because heights do not depend on it. The meaning of codes is in `epsg`, that of the keys of a
//! projection in `geokeys::defined`. Only this module parses a directory of keys.

mod defined;
#[cfg(test)]
mod oracle;

use self::defined::Defined;
pub use self::defined::definition;

use super::{Vertical, epsg};
use crate::geo::{Crs, GeoKeys};

/// Advice for heights whose unit is in doubt; the command line has its own words for it.
pub const UNIT_ADVICE: &str = "state the vertical unit";

const MODEL_TYPE: u16 = 1024;
const RASTER_TYPE: u16 = 1025;
const CITATION: u16 = 1026;
const GEODETIC_CRS: u16 = 2048;
const GEODETIC_CITATION: u16 = 2049;
const GEODETIC_DATUM: u16 = 2050;
const PRIME_MERIDIAN: u16 = 2051;
const GEODETIC_LINEAR_UNIT: u16 = 2052;
const GEODETIC_LINEAR_UNIT_SIZE: u16 = 2053;
const ANGULAR_UNIT: u16 = 2054;
const ANGULAR_UNIT_SIZE: u16 = 2055;
const ELLIPSOID: u16 = 2056;
const SEMI_MAJOR: u16 = 2057;
const SEMI_MINOR: u16 = 2058;
const INVERSE_FLATTENING: u16 = 2059;
const PRIME_MERIDIAN_LONGITUDE: u16 = 2061;
const PROJECTED_CRS: u16 = 3072;
const PROJECTED_CITATION: u16 = 3073;
const PROJECTION: u16 = 3074;
const METHOD: u16 = 3075;
const LINEAR_UNIT: u16 = 3076;
const LINEAR_UNIT_SIZE: u16 = 3077;
const VERTICAL: u16 = 4096;
const VERTICAL_CITATION: u16 = 4097;
const VERTICAL_UNIT: u16 = 4099;

/// The value that means "see the other keys".
const USER_DEFINED: u16 = 32767;
/// Tag with a key's value, if the value is not in the key: the directory, the doubles, or the text.
const SHORTS_TAG: u16 = 34735;
const DOUBLES_TAG: u16 = 34736;
const ASCII_TAG: u16 = 34737;

/// The georeference that keys state.
pub struct Reference {
    /// The coordinate system, with the keys themselves.
    pub crs: Crs,
    /// True if a tie point names the centre of a pixel.
    pub pixel_is_point: bool,
    /// Metres and name of the vertical unit, if there is a vertical part.
    pub vertical_unit: Option<(f64, String)>,
    /// Impossible statements of the keys, and what was used instead.
    pub warnings: Vec<String>,
}

/// Reads a set of keys; an empty one gives an engineering CRS in metres.
pub fn read(mut keys: GeoKeys) -> Reference {
    let mut warnings = Vec::new();
    drop_numbers_that_are_none(&mut keys, &mut warnings);
    let mut crs = match defined::read(&keys) {
        Defined::Whole(definition) => definition.crs(),
        Defined::Part(crs) => *crs,
    };
    let vertical = vertical_code(&keys);
    let known = vertical.and_then(Vertical::of_code);
    crs.vertical_epsg = vertical.or(crs.vertical_epsg);
    crs.vertical_down |= known.as_ref().is_some_and(|known| known.down);
    let named = text(&keys, VERTICAL_CITATION).filter(|name| !name.is_empty()).map(str::to_owned);
    if let Some(name) = named.or_else(|| known.as_ref().map(|known| known.name.clone())) {
        crs.vertical_name = name;
    }
    let vertical_unit = vertical_unit(&keys, known.as_ref(), &mut warnings);
    let pixel_is_point = is_point(&keys);
    crs.keys = (!keys.directory.is_empty()).then_some(keys);
    Reference { crs, pixel_is_point, vertical_unit, warnings }
}

/// True if the keys say PixelIsPoint: tie points then name centres of pixels.
pub fn is_point(keys: &GeoKeys) -> bool {
    short(keys, RASTER_TYPE) == Some(2)
}

/// The valid keys: as many as the header states.
fn entries(keys: &GeoKeys) -> impl Iterator<Item = &[u16; 4]> {
    let split = keys.directory.split_first_chunk::<4>();
    split.into_iter().flat_map(|(header, rest)| rest.as_chunks::<4>().0.iter().take(usize::from(header[3])))
}

/// Location, count and value of a key; of a repeated key the last, as in GDAL.
fn entry(keys: &GeoKeys, key: u16) -> Option<[u16; 3]> {
    let found = entries(keys).filter(|entry| entry[0] == key).last();
    found.map(|&[_, location, count, value]| [location, count, value])
}

fn short(keys: &GeoKeys, key: u16) -> Option<u16> {
    match entry(keys, key)? {
        [0, _, value] => Some(value),
        [SHORTS_TAG, _, index] => keys.directory.get(usize::from(index)).copied(),
        _ => None,
    }
}

fn double(keys: &GeoKeys, key: u16) -> Option<f64> {
    match entry(keys, key)? {
        [DOUBLES_TAG, _, index] => keys.doubles.get(usize::from(index)).copied().filter(|x| x.is_finite()),
        _ => None,
    }
}

fn text(keys: &GeoKeys, key: u16) -> Option<&str> {
    match entry(keys, key)? {
        [ASCII_TAG, count, index] => {
            let start = usize::from(index);
            let end = (start + usize::from(count)).min(keys.ascii.len());
            Some(keys.ascii.get(start..end)?.trim_end_matches(['|', '\0']).trim())
        }
        _ => None,
    }
}

/// An EPSG code; `None` for undefined (0) and user-defined.
fn code(keys: &GeoKeys, key: u16) -> Option<u32> {
    short(keys, key).filter(|&code| code != 0 && code != USER_DEFINED).map(u32::from)
}

fn length(keys: &GeoKeys, unit: u16, size: u16) -> Option<f64> {
    let by_code = code(keys, unit).and_then(|code| epsg::length_unit(code).map(|unit| unit.0));
    by_code.or_else(|| double(keys, size).filter(|&size| size > 0.0))
}

/// EPSG code of the vertical CRS. GeoTIFF 1.0 had its own numbers, of which only two are in use.
fn vertical_code(keys: &GeoKeys) -> Option<u32> {
    match code(keys, VERTICAL)? {
        5102 => Some(5702),
        5103 => Some(5703),
        5001..=5033 | 5101..=5106 => None,
        code => Some(code),
    }
}

/// Removes the vertical part, keys 4096 to 4099.
pub fn drop_vertical(keys: &mut GeoKeys) {
    drop_keys(keys, |entry| (VERTICAL..=VERTICAL_UNIT).contains(&entry[0]));
}

/// Removes keys. Short values that keys point to lie after the keys, and a shorter list would move
/// them; then the keys stay in place as key 0, which means nothing.
fn drop_keys(keys: &mut GeoKeys, gone: impl Fn(&[u16; 4]) -> bool) {
    let Some((header, _)) = keys.directory.split_first_chunk::<4>() else { return };
    let header = *header;
    if entries(keys).any(|entry| entry[1] == SHORTS_TAG) {
        let count = entries(keys).count();
        for entry in keys.directory[4..].as_chunks_mut::<4>().0.iter_mut().take(count) {
            if gone(entry) {
                *entry = [0, 0, 1, 0];
            }
        }
        return;
    }
    let kept: Vec<[u16; 4]> = entries(keys).filter(|entry| !gone(entry)).copied().collect();
    let mut directory = header.to_vec();
    directory[3] = kept.len() as u16;
    directory.extend(kept.iter().flatten());
    keys.directory = directory;
}

/// Removes keys whose number is NaN or infinite: they mean nothing, also to GDAL, and need not be
/// written.
fn drop_numbers_that_are_none(keys: &mut GeoKeys, warnings: &mut Vec<String>) {
    if keys.doubles.iter().all(|value| value.is_finite()) {
        return;
    }
    let bad: Vec<u16> = entries(keys)
        .filter(|entry| {
            let first = usize::from(entry[3]);
            let values = first..(first + usize::from(entry[2].max(1))).min(keys.doubles.len());
            entry[1] == DOUBLES_TAG
                && keys.doubles.get(values).is_some_and(|v| v.iter().any(|x| !x.is_finite()))
        })
        .map(|entry| entry[0])
        .collect();
    drop_keys(keys, |entry| bad.contains(&entry[0]));
    for value in &mut keys.doubles {
        if !value.is_finite() {
            *value = 0.0;
        }
    }
    for key in bad {
        warnings.push(format!("GeoKey {key} is not a finite number: it is left out"));
    }
}

/// The unit of a vertical system by its code, else by the key, as in GDAL.
fn vertical_unit(
    keys: &GeoKeys,
    known: Option<&Vertical>,
    warnings: &mut Vec<String>,
) -> Option<(f64, String)> {
    let by_key = code(keys, VERTICAL_UNIT).and_then(epsg::length_unit);
    let metre = (1.0, "metre".to_owned());
    let Some(system) = code(keys, VERTICAL) else {
        return by_key.map(|(metres, name)| (metres, name.to_owned()));
    };
    let by_code = match system {
        // Heights above an ellipsoid have no vertical system.
        5001..=5033 => None,
        _ => Some(known.map_or(metre.clone(), |known| known.unit.clone())),
    };
    let counts = by_code.clone().unwrap_or(metre).1;
    if let Some((_, key)) = by_key.filter(|key| key.0 != by_code.as_ref().map_or(1.0, |unit| unit.0)) {
        warnings.push(format!(
            "its vertical system (GeoKey 4096: {system}) has heights in {counts}, GeoKey 4099 beside it says {key}: they are taken in \
             {counts}, as GDAL does; if that is wrong, {UNIT_ADVICE}"
        ));
    }
    by_code
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::{CrsKind, Ellipsoid, Geo, WGS84};

    fn keys(entries: &[[u16; 4]], doubles: &[f64], ascii: &str) -> GeoKeys {
        let mut directory = vec![1, 1, 0, entries.len() as u16];
        directory.extend(entries.iter().flatten());
        GeoKeys { directory, doubles: doubles.to_vec(), ascii: ascii.to_owned() }
    }

    #[test]
    fn wgs84_degrees() {
        let reference = read(keys(&[[1024, 0, 1, 2], [1025, 0, 1, 2], [2048, 0, 1, 4326]], &[], ""));
        assert_eq!(reference.crs.kind, CrsKind::Geographic);
        assert_eq!(reference.crs.epsg, Some(4326));
        assert_eq!(reference.crs.name, "WGS 84");
        assert_eq!(reference.crs.ellipsoid, WGS84);
        assert_eq!(reference.crs.unit, epsg::DEGREE);
        assert!(reference.pixel_is_point && reference.crs.wkt.starts_with("GEOGCRS"));
        assert_eq!(reference.vertical_unit, None);
    }

    #[test]
    fn state_plane_with_and_without_its_unit_key() {
        let with = read(keys(&[[1024, 0, 1, 1], [3072, 0, 1, 2263], [3076, 0, 1, 9003]], &[], ""));
        let without = read(keys(&[[1024, 0, 1, 1], [3072, 0, 1, 2263]], &[], ""));
        assert_eq!(with.crs.unit, epsg::US_SURVEY_FOOT);
        assert_eq!(without.crs.unit, epsg::US_SURVEY_FOOT);
        assert!(with.crs.wkt.contains("Lambert Conic Conformal (2SP)") && with.crs.epsg == Some(2263));
        // In metres it is another system than that of the code, as in GDAL.
        let metres = read(keys(&[[1024, 0, 1, 1], [3072, 0, 1, 2263], [3076, 0, 1, 9001]], &[], ""));
        assert_eq!((metres.crs.unit, metres.crs.epsg), (1.0, None));
    }

    #[test]
    fn user_defined_everything() {
        let reference = read(keys(
            &[
                [1024, 0, 1, 2],
                [2048, 0, 1, 32767],
                [2049, 34737, 27, 0],
                [2054, 0, 1, 32767],
                [2055, 34736, 1, 0],
                [2057, 34736, 1, 1],
                [2059, 34736, 1, 2],
                [4096, 0, 1, 6360],
            ],
            &[0.001, 3_396_190.0, 169.894],
            "GCS Name = Mars 2000|Datum = x|",
        ));
        assert_eq!(reference.crs.epsg, None);
        assert_eq!(reference.crs.name, "Mars 2000");
        assert_eq!(reference.crs.unit, 0.001);
        assert_eq!(reference.crs.ellipsoid, Ellipsoid { a: 3_396_190.0, inverse_flattening: 169.894 });
        assert_eq!(reference.vertical_unit, Some((epsg::US_SURVEY_FOOT, "US survey foot".to_owned())));
    }

    #[test]
    fn vertical_part_is_recorded_and_can_be_dropped() {
        let entries = [[1024, 0, 1, 1], [3072, 0, 1, 32611], [4096, 0, 1, 5715], [4097, 34737, 10, 0]];
        let mut reference = read(keys(&entries, &[], "MSL depth|"));
        assert_eq!(reference.crs.vertical_name, "MSL depth");
        assert!(reference.crs.vertical_down && reference.crs.vertical_epsg == Some(5715));
        let keys = reference.crs.keys.as_mut().expect("keys");
        drop_vertical(keys);
        assert_eq!(keys.directory, [1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 32611]);
    }

    #[test]
    fn broken_keys_are_an_engineering_crs() {
        for directory in [
            vec![],
            vec![1],
            vec![1, 1, 0, 9],
            vec![1, 1, 0, 2, 1024, 0, 1],
            vec![1, 1, 0, 1, 1024, 34735, 1, 999],
        ] {
            let reference = read(GeoKeys { directory, ..GeoKeys::default() });
            assert_eq!(reference.crs.kind, CrsKind::Engineering);
            assert!(reference.crs.wkt.starts_with("ENGCRS"));
        }
    }

    #[test]
    fn metres_of_a_degree_and_of_a_foot() {
        let mut geo = Geo { transform: Some([10.0, 0.001, 0.0, 60.0, 0.0, -0.001]), ..Geo::default() };
        geo.crs = read(keys(&[[1024, 0, 1, 2], [2048, 0, 1, 4326]], &[], "")).crs;
        let spacing = geo.spacing((0, 100), (0, 100));
        // At 60 degrees north: 55.8 m and 111.4 m for a thousandth of a degree.
        assert!((spacing.dx - 55.96).abs() < 0.1 && (spacing.dy - 111.41).abs() < 0.05, "{spacing:?}");
        geo.crs = read(keys(&[[1024, 0, 1, 1], [3072, 0, 1, 2263]], &[], "")).crs;
        geo.transform = Some([0.0, 10.0, 0.0, 0.0, 0.0, -10.0]);
        assert!((geo.spacing((0, 1), (0, 1)).dx - 3.048_006).abs() < 1e-5);
    }
}
