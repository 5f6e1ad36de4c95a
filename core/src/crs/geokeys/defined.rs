//! The horizontal system that keys define.

use std::borrow::Cow;

use super::{
    ANGULAR_UNIT, ANGULAR_UNIT_SIZE, CITATION, ELLIPSOID, GEODETIC_CITATION, GEODETIC_CRS, GEODETIC_DATUM,
    GEODETIC_LINEAR_UNIT, GEODETIC_LINEAR_UNIT_SIZE, INVERSE_FLATTENING, LINEAR_UNIT, LINEAR_UNIT_SIZE,
    METHOD, MODEL_TYPE, PRIME_MERIDIAN, PRIME_MERIDIAN_LONGITUDE, PROJECTED_CITATION, PROJECTED_CRS,
    PROJECTION, SEMI_MAJOR, SEMI_MINOR, USER_DEFINED, code, double, epsg, length, short, text,
};
use crate::crs::epsg::table;
use crate::crs::{Base, Conversion, Definition, PE_STRING, method};
use crate::geo::{Crs, CrsKind, Ellipsoid, GeoKeys};

/// A system, as far as keys define it.
pub(super) enum Defined {
    Whole(Box<Definition>),
    /// Kind, unit and name, but no known datum or projection.
    Part(Box<Crs>),
}

/// The definition that keys have, if any.
pub fn definition(keys: &GeoKeys) -> Option<Definition> {
    match read(keys) {
        Defined::Whole(definition) if definition.kind != CrsKind::Engineering => Some(*definition),
        _ => None,
    }
}

pub(super) fn read(keys: &GeoKeys) -> Defined {
    let projected_code = code(keys, PROJECTED_CRS);
    match short(keys, MODEL_TYPE) {
        Some(1) => projected(keys, projected_code),
        Some(2) => geographic(keys),
        // Geocentric coordinates are not the plane of a raster.
        Some(3) => engineering(keys),
        Some(USER_DEFINED) | None if projected_code.is_some() => projected(keys, projected_code),
        None if code(keys, GEODETIC_CRS).is_some() && esri(keys).is_none() => geographic(keys),
        // A model that GeoTIFF does not define: a text or unknown, whatever the other keys are.
        _ => esri(keys).unwrap_or_else(|| engineering(keys)),
    }
}

fn whole(definition: Definition) -> Defined {
    Defined::Whole(Box::new(definition))
}

/// The ESRI text that GDAL also writes where keys are not enough.
fn esri(keys: &GeoKeys) -> Option<Defined> {
    let text = [PROJECTED_CITATION, CITATION, GEODETIC_CITATION]
        .into_iter()
        .find_map(|key| text(keys, key)?.strip_prefix(PE_STRING))?;
    match Definition::read(text) {
        Ok(definition) if definition.conversion.as_ref().is_none_or(|c| c.method.is_ok()) => {
            Some(whole(definition))
        }
        Ok(definition) => {
            let mut crs = definition.crs();
            text.clone_into(&mut crs.wkt);
            Some(Defined::Part(Box::new(crs)))
        }
        Err(_) => None,
    }
}

fn engineering(keys: &GeoKeys) -> Defined {
    let unit = length(keys, LINEAR_UNIT, LINEAR_UNIT_SIZE).unwrap_or(1.0);
    whole(Definition::engineering(name(keys, [CITATION, PROJECTED_CITATION, GEODETIC_CITATION]), unit))
}

fn geographic(keys: &GeoKeys) -> Defined {
    let code = code(keys, GEODETIC_CRS);
    // Some files have the code of a projected system in the model of geographic ones: its datum is
    // meant.
    let of_projected = || table::projected(super::code(keys, PROJECTED_CRS)?).map(|row| row.base);
    if let Some(base) = code.or_else(of_projected).and_then(Base::of_code) {
        return whole(in_unit(keys, Definition::geographic(base)));
    }
    if let Some(base) = base(keys) {
        return whole(Definition { epsg: code, ..Definition::geographic(base) });
    }
    Defined::Part(Box::new(Crs {
        kind: CrsKind::Geographic,
        epsg: code,
        name: name(keys, [GEODETIC_CITATION, CITATION, PROJECTED_CITATION]),
        unit: angular_unit(keys).unwrap_or(epsg::DEGREE),
        ellipsoid: epsg::geographic_ellipsoid(None),
        ..Crs::default()
    }))
}

/// The code has the unit, except codes in grads in files that state degrees: GDAL reads those in
/// degrees.
fn in_unit(keys: &GeoKeys, mut definition: Definition) -> Definition {
    if code(keys, ANGULAR_UNIT).is_some_and(|unit| matches!(unit, 9102 | 9122)) {
        definition.unit = epsg::DEGREE;
    }
    definition
}

fn angular_unit(keys: &GeoKeys) -> Option<f64> {
    let by_code = code(keys, ANGULAR_UNIT).and_then(epsg::angular_unit);
    by_code.or_else(|| double(keys, ANGULAR_UNIT_SIZE).filter(|&size| size > 0.0))
}

/// The geographic system: by its code, or by datum, ellipsoid and meridian.
fn base(keys: &GeoKeys) -> Option<Base> {
    if let Some(base) = code(keys, GEODETIC_CRS).and_then(Base::of_code) {
        return Some(base);
    }
    let citation = text(keys, GEODETIC_CITATION).unwrap_or_default();
    let by_code = code(keys, GEODETIC_DATUM).and_then(table::datum);
    let is_named = by_code.is_some();
    let mut base = if let Some(datum) = by_code {
        Base { name: datum.name.to_owned(), ..Base::on_datum(datum) }
    } else {
        let (ellipsoid_name, ellipsoid) = ellipsoid(keys)?;
        Base {
            name: "unknown".to_owned(),
            epsg: None,
            datum: part(citation, "Datum").unwrap_or("unknown").to_owned(),
            ellipsoid_name: part(citation, "Ellipsoid").unwrap_or(ellipsoid_name).to_owned(),
            ellipsoid,
            meridian: ("Greenwich".to_owned(), 0.0),
            unit: epsg::DEGREE,
            has_height: false,
        }
    };
    if let Some(name) =
        part(citation, "GCS Name").or_else(|| citation.split('|').next().filter(|n| !n.is_empty()))
    {
        name.clone_into(&mut base.name);
    }
    // A datum has its ellipsoid; keys with other axes define another datum.
    if let Some((_, shape)) = ellipsoid(keys)
        && is_named
        && !(near(shape.a, base.ellipsoid.a)
            && near(shape.inverse_flattening, base.ellipsoid.inverse_flattening))
    {
        base.ellipsoid = shape;
        (base.datum, base.ellipsoid_name) = ("unknown".to_owned(), "unknown".to_owned());
    }
    base.unit = angular_unit(keys).unwrap_or(epsg::DEGREE);
    let by_number = || Some(("unknown", double(keys, PRIME_MERIDIAN_LONGITUDE)? * base.unit / epsg::DEGREE));
    if let Some((name, longitude)) = code(keys, PRIME_MERIDIAN).and_then(table::meridian).or_else(by_number)
        && (longitude != 0.0 || !is_named)
    {
        let name = if longitude == 0.0 { "Greenwich" } else { name };
        base.meridian = (name.to_owned(), longitude);
    }
    Some(base)
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-7 * a.abs().max(b.abs())
}

/// The ellipsoid by its axes or its code.
fn ellipsoid(keys: &GeoKeys) -> Option<(&'static str, Ellipsoid)> {
    let metres = length(keys, GEODETIC_LINEAR_UNIT, GEODETIC_LINEAR_UNIT_SIZE).unwrap_or(1.0);
    let length =
        |key| double(keys, key).map(|value| value * metres).filter(|value| (1.0..1e12).contains(value));
    let by_code = || code(keys, ELLIPSOID).and_then(table::ellipsoid).map(|found| (found.name, found.shape));
    let Some(a) = length(SEMI_MAJOR) else { return by_code() };
    let inverse_flattening = match (double(keys, INVERSE_FLATTENING), length(SEMI_MINOR)) {
        (Some(given), _) if given > 1.0 => given,
        // A prolate ellipsoid is taken for a sphere.
        (None, Some(b)) if b < a => a / (a - b),
        _ => 0.0,
    };
    Some(("unknown", Ellipsoid { a, inverse_flattening }))
}

fn projected(keys: &GeoKeys, code: Option<u32>) -> Defined {
    let unit = length(keys, LINEAR_UNIT, LINEAR_UNIT_SIZE);
    if let Some(mut definition) = code.and_then(|code| Definition::of_kind(CrsKind::Projected, code)) {
        // With another unit it is another system than that of the code, as in GDAL.
        if unit.is_some_and(|unit| !near(unit, definition.unit)) {
            definition.epsg = None;
            definition.unit = unit.unwrap_or(definition.unit);
        }
        return whole(definition);
    }
    if let Some(base) = code.and_then(Base::of_code) {
        return whole(Definition::geographic(base));
    }
    let base = base(keys);
    let name = name(keys, [CITATION, PROJECTED_CITATION, GEODETIC_CITATION]);
    let unit = unit.unwrap_or(1.0);
    if let (Some(base), None) = (&base, code)
        && let Some(conversion) = conversion(keys, base, unit)
    {
        return whole(Definition { name, ..Definition::projected(base.clone(), conversion, unit) });
    }
    if code.is_none()
        && let Some(esri) = esri(keys)
    {
        return esri;
    }
    Defined::Part(Box::new(Crs {
        kind: CrsKind::Projected,
        epsg: code,
        name,
        unit,
        ellipsoid: base.map_or_else(|| epsg::geographic_ellipsoid(None), |base| base.ellipsoid),
        ..Crs::default()
    }))
}

/// The keys that may hold each parameter, in the order of GDAL.
const PARAMETERS: &[(&str, &[u16])] = &[
    ("lat_0", &[3081, 3085, 3089]),
    ("lon_0", &[3080, 3084, 3088]),
    ("lat_1", &[3078]),
    ("lat_2", &[3079]),
    ("k_0", &[3092, 3093]),
    ("alpha", &[3094]),
    ("gamma", &[3096]),
    ("x_0", &[3082, 3086, 3090]),
    ("y_0", &[3083, 3087, 3091]),
];
/// The keys for a cone, whose false origin goes first.
const OF_CONE: &[(&str, &[u16])] = &[
    ("lat_0", &[3085, 3081, 3089]),
    ("lon_0", &[3084, 3080, 3088]),
    ("x_0", &[3086, 3082, 3090]),
    ("y_0", &[3087, 3083, 3091]),
];
/// The keys for a polar method, whose straight meridian goes first.
const OF_POLE: &[(&str, &[u16])] = &[("lon_0", &[3095, 3080, 3084, 3088])];

/// The projection: by its code, or by method and parameters.
fn conversion(keys: &GeoKeys, base: &Base, unit: f64) -> Option<Conversion> {
    if let Some(known) = code(keys, PROJECTION).and_then(Conversion::of_code) {
        return Some(known);
    }
    let number = short(keys, METHOD)?;
    let method = method_of(number)?;
    let mut parameters = Vec::new();
    for &(key, usual) in PARAMETERS {
        let special = match number {
            8 => OF_CONE,
            15 => OF_POLE,
            _ => &[],
        };
        let order = special.iter().find(|row| row.0 == key).map_or(usual, |row| row.1);
        let Some(value) = order.iter().find_map(|&id| double(keys, id)) else { continue };
        let value = match key {
            "x_0" | "y_0" => value * unit,
            "k_0" => value,
            _ if base.unit == epsg::DEGREE => value,
            _ => value * base.unit / epsg::DEGREE,
        };
        parameters.push((Cow::Borrowed(key), value));
    }
    let mut conversion = Conversion { name: "unnamed".to_owned(), method: Ok(method), parameters };
    if conversion.value("k_0") == 0.0 {
        conversion.set("k_0", 1.0);
    }
    // If the key of the rectified grid is missing, GDAL uses a right angle.
    if matches!(method.code, 9812 | 9815) && conversion.value("gamma") == 0.0 {
        conversion.set("gamma", 90.0);
    }
    conversion.settle_keys();
    Some(conversion)
}

/// Methods by the numbers of GeoTIFF's key `ProjMethodGeoKey`, which newer files have as EPSG
/// codes.
fn method_of(number: u16) -> Option<&'static method::Method> {
    let code = match number {
        1 => 9807,
        3 => 9812,
        7 => 9804,
        8 => 9802,
        9 => 9801,
        10 => 9820,
        11 => 9822,
        12 => 9832,
        15 => 9810,
        16 => 9809,
        17 => 1028,
        18 => 9806,
        21 => 9840,
        22 => 9818,
        26 => 9811,
        27 => 9808,
        28 => 9835,
        29 => 9815,
        13 => return method::by_name("Equidistant Conic"),
        14 => return method::by_name("Stereographic"),
        19 => return method::by_name("Gnomonic"),
        20 => return method::by_name("Miller Cylindrical"),
        23 => return method::by_name("Robinson"),
        24 => return method::by_name("Sinusoidal"),
        25 => return method::by_name("Van Der Grinten"),
        1024.. => u32::from(number),
        _ => return None,
    };
    method::by_code(code)
}

/// A part of a citation of the form `PCS Name = ..|Datum = ..|`.
fn part<'a>(citation: &'a str, word: &str) -> Option<&'a str> {
    citation
        .split('|')
        .find_map(|part| part.trim().strip_prefix(word)?.trim_start().strip_prefix('='))
        .map(str::trim)
}

/// A name for people out of the citations, which some programs fill with
/// `PCS Name = ...|Datum = ...|`.
fn name(keys: &GeoKeys, order: [u16; 3]) -> String {
    let found =
        order.into_iter().filter_map(|key| text(keys, key)).find(|text| !text.is_empty()).unwrap_or_default();
    let named = part(found, "PCS Name").or_else(|| part(found, "GCS Name"));
    named.or_else(|| found.split('|').next()).unwrap_or_default().trim().to_owned()
}
