//! GeoTIFF keys (OGC 19-008) to a coordinate system and a vertical unit.
//!
//! Keys are taken as far as they make sense: a broken set gives an engineering CRS, never an error, because heights do
//! not depend on it. No database is at hand; what a bare EPSG code implies is in `epsg`.

use crate::geo::{Crs, CrsKind, Ellipsoid, GeoKeys};

use super::{epsg, wkt};

const MODEL_TYPE: u16 = 1024;
const RASTER_TYPE: u16 = 1025;
const CITATION: u16 = 1026;
const GEODETIC_CRS: u16 = 2048;
const GEODETIC_CITATION: u16 = 2049;
const GEODETIC_DATUM: u16 = 2050;
const GEODETIC_LINEAR_UNIT: u16 = 2052;
const GEODETIC_LINEAR_UNIT_SIZE: u16 = 2053;
const ANGULAR_UNIT: u16 = 2054;
const ANGULAR_UNIT_SIZE: u16 = 2055;
const ELLIPSOID: u16 = 2056;
const SEMI_MAJOR: u16 = 2057;
const SEMI_MINOR: u16 = 2058;
const INVERSE_FLATTENING: u16 = 2059;
const PROJECTED_CRS: u16 = 3072;
const PROJECTED_CITATION: u16 = 3073;
const LINEAR_UNIT: u16 = 3076;
const LINEAR_UNIT_SIZE: u16 = 3077;
const VERTICAL: u16 = 4096;
const VERTICAL_CITATION: u16 = 4097;
const VERTICAL_UNIT: u16 = 4099;

/// The value that means "see the other keys".
const USER_DEFINED: u16 = 32767;

/// What the keys say.
pub struct Reference {
    /// The coordinate system, with the keys themselves.
    pub crs: Crs,
    /// True if a tie point names the centre of a pixel.
    pub pixel_is_point: bool,
    /// Metres and name of the vertical unit, if there is a vertical part.
    pub vertical_unit: Option<(f64, String)>,
}

/// Reads a set of keys; an empty one gives an engineering CRS in metres.
pub fn read(keys: GeoKeys) -> Reference {
    let kind = kind(&keys);
    let mut crs = Crs { kind, ..Crs::default() };
    match kind {
        CrsKind::Geographic => {
            crs.epsg = code(&keys, GEODETIC_CRS);
            crs.unit = angular_unit(&keys, crs.epsg);
            crs.ellipsoid =
                ellipsoid(&keys).unwrap_or_else(|| epsg::geographic_ellipsoid(crs.epsg.or(datum_crs(&keys))));
        }
        CrsKind::Projected => {
            crs.epsg = code(&keys, PROJECTED_CRS);
            crs.unit = length(&keys, LINEAR_UNIT, LINEAR_UNIT_SIZE)
                .unwrap_or_else(|| crs.epsg.map_or(1.0, epsg::projected_unit));
            crs.ellipsoid = ellipsoid(&keys).unwrap_or_else(|| match (code(&keys, GEODETIC_CRS), crs.epsg) {
                (None, Some(projected)) => epsg::projected_ellipsoid(projected),
                (geographic, _) => epsg::geographic_ellipsoid(geographic),
            });
        }
        CrsKind::Engineering => crs.unit = length(&keys, LINEAR_UNIT, LINEAR_UNIT_SIZE).unwrap_or(1.0),
    }
    crs.vertical_epsg = vertical_code(&keys);
    crs.vertical_down = crs.vertical_epsg.is_some_and(epsg::is_depth);
    text(&keys, VERTICAL_CITATION).unwrap_or_default().clone_into(&mut crs.vertical_name);
    (crs.name, crs.wkt) = match crs.epsg.and_then(|code| wkt::of_epsg(kind, code)) {
        Some(known) => known,
        None if kind == CrsKind::Engineering => (name(&keys, kind), wkt::engineering(crs.unit)),
        None => (name(&keys, kind), String::new()),
    };
    let vertical_unit = vertical_unit(&keys, crs.vertical_epsg);
    let pixel_is_point = short(&keys, RASTER_TYPE) == Some(2);
    crs.keys = (!keys.directory.is_empty()).then_some(keys);
    Reference { crs, pixel_is_point, vertical_unit }
}

fn kind(keys: &GeoKeys) -> CrsKind {
    match short(keys, MODEL_TYPE) {
        Some(1) => CrsKind::Projected,
        Some(2) => CrsKind::Geographic,
        // Geocentric coordinates are no raster's plane.
        Some(3) => CrsKind::Engineering,
        _ if code(keys, PROJECTED_CRS).is_some() => CrsKind::Projected,
        _ if code(keys, GEODETIC_CRS).is_some() => CrsKind::Geographic,
        _ => CrsKind::Engineering,
    }
}

/// Location, count and value of a key.
fn entry(keys: &GeoKeys, key: u16) -> Option<[u16; 3]> {
    let (header, entries) = keys.directory.split_first_chunk::<4>()?;
    let entries = entries.as_chunks::<4>().0.iter().take(usize::from(header[3]));
    entries
        .map(|&[id, location, count, value]| (id, [location, count, value]))
        .find(|entry| entry.0 == key)
        .map(|e| e.1)
}

fn short(keys: &GeoKeys, key: u16) -> Option<u16> {
    match entry(keys, key)? {
        [0, _, value] => Some(value),
        [34735, _, index] => keys.directory.get(usize::from(index)).copied(),
        _ => None,
    }
}

fn double(keys: &GeoKeys, key: u16) -> Option<f64> {
    match entry(keys, key)? {
        [34736, _, index] => keys.doubles.get(usize::from(index)).copied(),
        _ => None,
    }
}

fn text(keys: &GeoKeys, key: u16) -> Option<&str> {
    match entry(keys, key)? {
        [34737, count, index] => {
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
    by_code.or_else(|| double(keys, size).filter(|&size| size > 0.0 && size.is_finite()))
}

fn angular_unit(keys: &GeoKeys, crs: Option<u32>) -> f64 {
    code(keys, ANGULAR_UNIT)
        .and_then(epsg::angular_unit)
        .or_else(|| double(keys, ANGULAR_UNIT_SIZE).filter(|&size| size > 0.0 && size.is_finite()))
        .unwrap_or_else(|| crs.map_or(epsg::DEGREE, epsg::geographic_unit))
}

/// The ellipsoid that the keys spell out or give the code of.
fn ellipsoid(keys: &GeoKeys) -> Option<Ellipsoid> {
    let metres = length(keys, GEODETIC_LINEAR_UNIT, GEODETIC_LINEAR_UNIT_SIZE).unwrap_or(1.0);
    let length =
        |key| double(keys, key).map(|value| value * metres).filter(|&value| value > 0.0 && value.is_finite());
    let Some(a) = length(SEMI_MAJOR) else { return code(keys, ELLIPSOID).and_then(epsg::ellipsoid) };
    let inverse_flattening = match (double(keys, INVERSE_FLATTENING), length(SEMI_MINOR)) {
        (Some(given), _) if given > 1.0 && given.is_finite() => given,
        // A body longer than wide is taken for a sphere.
        (None, Some(b)) if b < a => a / (a - b),
        _ => 0.0,
    };
    Some(Ellipsoid { a, inverse_flattening })
}

/// The geographic CRS of a datum code: EPSG numbered the older ones 2000 apart.
fn datum_crs(keys: &GeoKeys) -> Option<u32> {
    code(keys, GEODETIC_DATUM).filter(|code| (6000..7000).contains(code)).map(|code| code - 2000)
}

/// EPSG code of the vertical CRS. GeoTIFF 1.0 had numbers of its own, of which only two are in use.
fn vertical_code(keys: &GeoKeys) -> Option<u32> {
    match code(keys, VERTICAL)? {
        5102 => Some(5702),
        5103 => Some(5703),
        5001..=5033 | 5101..=5106 => None,
        code => Some(code),
    }
}

/// Takes the vertical part away, keys 4096 to 4099.
pub(crate) fn drop_vertical(keys: &mut GeoKeys) {
    let Some((header, entries)) = keys.directory.split_first_chunk::<4>() else { return };
    let (entries, _) = entries.as_chunks::<4>();
    let mut kept = header.to_vec();
    for entry in entries.iter().take(usize::from(header[3])) {
        if (VERTICAL..=VERTICAL_UNIT).contains(&entry[0]) {
            kept[3] -= 1;
        } else {
            kept.extend(entry);
        }
    }
    // Short values that keys point to lie behind them: a shorter list would move those, so such keys stay as they are.
    if entries.iter().all(|entry| entry[1] != 34735) {
        keys.directory = kept;
    }
}

fn vertical_unit(keys: &GeoKeys, vertical: Option<u32>) -> Option<(f64, String)> {
    let by_key = code(keys, VERTICAL_UNIT).and_then(epsg::length_unit);
    let unit = match (by_key, vertical) {
        (Some(unit), _) => unit,
        (None, Some(code)) => epsg::vertical_unit(code),
        (None, None) => return None,
    };
    Some((unit.0, unit.1.to_owned()))
}

/// A name for people out of the citations, which some programs fill with `PCS Name = ...|Datum = ...|`.
fn name(keys: &GeoKeys, kind: CrsKind) -> String {
    let order = match kind {
        CrsKind::Geographic => [GEODETIC_CITATION, CITATION, PROJECTED_CITATION],
        CrsKind::Projected => [PROJECTED_CITATION, CITATION, GEODETIC_CITATION],
        CrsKind::Engineering => [CITATION, PROJECTED_CITATION, GEODETIC_CITATION],
    };
    let found =
        order.into_iter().filter_map(|key| text(keys, key)).find(|text| !text.is_empty()).unwrap_or_default();
    let named = found.split('|').find_map(|part| part.trim().split_once("CS Name = ").map(|(_, name)| name));
    named.or_else(|| found.split('|').next()).unwrap_or_default().trim().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::{Geo, WGS84};

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
        assert_eq!(with.crs.wkt, "");
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
