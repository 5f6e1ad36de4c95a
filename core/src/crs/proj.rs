//! Reads definitions from PROJ strings, and writes PROJ strings.

use std::borrow::Cow;
use std::fmt::Write;

use super::method;
use super::{Base, Conversion, Definition};
use crate::crs::epsg::{DEGREE, FOOT, US_SURVEY_FOOT, table};
use crate::geo::{CrsKind, Ellipsoid};

/// The words of a string: `+key=value`, or `+flag`.
struct Words<'a>(Vec<(&'a str, &'a str)>);

impl<'a> Words<'a> {
    fn get(&self, key: &str) -> Option<&'a str> {
        self.0.iter().find(|word| word.0 == key).map(|word| word.1)
    }

    /// A number; NaN if the value is not a number.
    fn number(&self, key: &str) -> Option<f64> {
        self.get(key)
            .map(|text| text.parse().ok().filter(|value: &f64| value.is_finite()).unwrap_or(f64::NAN))
    }

    /// A number, or `usual` if it is missing; `None` if the value is not a number.
    fn value(&self, key: &str, usual: f64) -> Option<f64> {
        Some(self.number(key).unwrap_or(usual)).filter(|value| !value.is_nan())
    }
}

/// Words that change the meaning of the coordinates, and are not supported.
const NOT_READ: &[&str] = &["init", "geoc", "over", "rf_a", "R_V", "R_lat_a", "sweep", "o_proj"];

/// Reads `+proj=..`; `None` if a part of it is not understood.
pub(super) fn read(text: &str) -> Option<Definition> {
    let words = Words(
        text.split_ascii_whitespace()
            .map(|word| word.trim_start_matches('+'))
            .map(|word| word.split_once('=').unwrap_or((word, "")))
            .take(64)
            .collect(),
    );
    if NOT_READ.iter().any(|key| words.get(key).is_some())
        || words.get("axis").is_some_and(|axis| axis != "enu")
    {
        return None;
    }
    let base = base(&words)?;
    let proj = words.get("proj")?;
    if ["longlat", "latlong", "lonlat", "latlon"].contains(&proj) {
        return Some(Definition::geographic(base));
    }
    let conversion = conversion(&words, proj)?;
    // Web Mercator: the formulas of a sphere on the longitudes and latitudes of WGS 84.
    let is_pseudo = conversion.method.as_ref().is_ok_and(|method| method.code == 1024);
    let base = if is_pseudo { Base::of_code(4326)? } else { base };
    let mut definition = Definition::projected(base, conversion, unit(&words)?);
    "unknown".clone_into(&mut definition.name);
    Some(definition)
}

fn unit(words: &Words) -> Option<f64> {
    if let Some(metres) = words.number("to_meter") {
        return Some(metres).filter(|&metres| metres > 0.0);
    }
    match words.get("units") {
        None | Some("m") => Some(1.0),
        Some("ft") => Some(FOOT),
        Some("us-ft") => Some(US_SURVEY_FOOT),
        Some("km") => Some(1000.0),
        Some(_) => None,
    }
}

fn base(words: &Words) -> Option<Base> {
    let unknown = |name: &str, shape| Base {
        name: "unknown".to_owned(),
        epsg: None,
        datum: "unknown".to_owned(),
        ellipsoid_name: name.to_owned(),
        ellipsoid: shape,
        meridian: ("Greenwich".to_owned(), 0.0),
        unit: DEGREE,
        has_height: false,
    };
    let meridian = words.value("pm", 0.0)?;
    // A shift of datum does not change the coordinates, but a shifted WGS 84 is another datum.
    let datum = match (words.get("datum"), words.get("ellps")) {
        (Some("WGS84"), _) => Some(6326),
        (Some("NAD83"), _) => Some(6269),
        (Some("NAD27"), _) => Some(6267),
        (Some(_), _) => return None,
        _ => None,
    };
    let mut base = if let Some(code) = datum {
        Base { name: "unknown".to_owned(), ..Base::on_datum(table::datum(code)?) }
    } else {
        let (name, shape) = shape(words)?;
        unknown(name, shape)
    };
    if meridian != 0.0 {
        base.meridian = ("unknown".to_owned(), meridian);
    }
    Some(base)
}

/// The ellipsoid: by name or by its axes.
fn shape(words: &Words) -> Option<(&'static str, Ellipsoid)> {
    let by_code = |code| table::ellipsoid(code).map(|found| (found.name, found.shape));
    if let Some(radius) = words.number("R") {
        return Some((
            "unknown",
            Ellipsoid { a: Some(radius).filter(|&a| a > 0.0)?, inverse_flattening: 0.0 },
        ));
    }
    if let Some(a) = words.number("a") {
        let a = Some(a).filter(|&a| a > 0.0)?;
        let inverse_flattening = match (words.number("b"), words.number("rf"), words.number("f")) {
            (Some(b), ..) if b == a => 0.0,
            (Some(b), ..) if b > 0.0 && b < a => a / (a - b),
            (None, Some(rf), _) if rf > 1.0 => rf,
            (None, None, Some(0.0) | None) => 0.0,
            (None, None, Some(f)) if f > 0.0 && f < 1.0 => 1.0 / f,
            _ => return None,
        };
        return Some(("unknown", Ellipsoid { a, inverse_flattening }));
    }
    match words.get("ellps") {
        Some("GRS80") => by_code(7019),
        Some("bessel") => by_code(7004),
        Some("intl") => by_code(7022),
        Some("clrk66") => by_code(7008),
        Some("clrk80") => {
            Some(("Clarke 1880 mod.", Ellipsoid { a: 6_378_249.145, inverse_flattening: 293.4663 }))
        }
        Some("airy") => by_code(7001),
        Some("krass") => by_code(7024),
        Some("WGS72") => by_code(7043),
        Some("sphere") => Some(("unknown", Ellipsoid { a: 6_370_997.0, inverse_flattening: 0.0 })),
        None | Some("WGS84") => by_code(7030),
        Some(_) => None,
    }
}

fn conversion(words: &Words, proj: &str) -> Option<Conversion> {
    let named = |method, parameters: Vec<(&'static str, f64)>| Conversion {
        name: "unknown".to_owned(),
        method: Ok(method),
        parameters: parameters.into_iter().map(|(key, value)| (Cow::Borrowed(key), value)).collect(),
    };
    let value = |key: &str| words.value(key, method::usual(key));
    if proj == "utm" {
        let zone = words.number("zone").filter(|zone| (1.0..=60.0).contains(zone) && zone.fract() == 0.0)?;
        let north = if words.get("south").is_some() { 10_000_000.0 } else { 0.0 };
        let lon_0 = zone * 6.0 - 183.0;
        let parameters =
            vec![("lat_0", 0.0), ("lon_0", lon_0), ("k_0", 0.9996), ("x_0", 500_000.0), ("y_0", north)];
        return Some(named(method::by_code(9807)?, parameters));
    }
    let scale = words.value(if words.get("k_0").is_some() { "k_0" } else { "k" }, 1.0)?;
    let is_pseudo = proj == "merc" && words.get("nadgrids") == Some("@null");
    let method = match proj {
        "merc" if is_pseudo => method::by_code(1024),
        "merc" if words.get("lat_ts").is_some() && value("lat_ts")? != 0.0 => method::by_code(9805),
        "lcc" if words.get("lat_2").is_some() => method::by_code(9802),
        "lcc" => method::by_code(9801),
        "stere" if value("lat_0")?.abs() == 90.0 && words.get("lat_ts").is_some() => method::by_code(9829),
        "stere" if value("lat_0")?.abs() == 90.0 => method::by_code(9810),
        "stere" => method::by_name("Stereographic"),
        "aeqd" => method::by_code(9832),
        "laea" if is_sphere(words)? => method::by_code(1027),
        "eqc" if is_sphere(words)? => method::by_code(1029),
        "cea" if is_sphere(words)? => method::by_code(9834),
        // Their strings have more words than their parameters.
        "omerc" if words.get("no_uoff").is_some() || words.get("no_off").is_some() => method::by_code(9812),
        "omerc" if words.get("lonc").is_some() => method::by_code(9815),
        "somerc" => method::by_code(9815),
        "omerc" | "krovak" | "labrd" | "bonne" => None,
        // These have the formulas of a sphere; for other methods a sphere in place of the ellipsoid
        // is another system.
        "vandg" | "mill" => method::by_proj(proj),
        _ if words.get("R_A").is_some() => None,
        "ortho" if is_sphere(words)? => method::by_code(9840),
        other => method::by_proj(other),
    }?;
    let mut parameters = Vec::new();
    for &(key, _) in method.parameters {
        let found = match key {
            "k_0" => scale,
            // With one parallel, which is that of the origin if no other is given.
            "lat_0" if method.code == 9801 && words.get("lat_1").is_some() => value("lat_1")?,
            "lat_1" if words.get("lat_ts").is_some() => value("lat_ts")?,
            "lon_0" if proj == "omerc" => value("lonc")?,
            "alpha" | "gamma" if proj == "somerc" => 90.0,
            "gamma" if words.get("gamma").is_none() => value("alpha")?,
            key => value(key)?,
        };
        parameters.push((key, found));
    }
    let mut conversion = named(method, parameters);
    conversion.settle("");
    Some(conversion)
}

fn is_sphere(words: &Words) -> Option<bool> {
    Some(words.get("datum").is_none() && shape(words)?.1.inverse_flattening == 0.0)
}

/// The PROJ string of a projected system on its own ellipsoid, in metres, longitudes from its own
/// meridian: it converts longitude and latitude to coordinates, without any shift of datum. `None`
/// if its method needs more.
pub fn string(definition: &Definition) -> Option<String> {
    let (base, conversion) = (definition.base.as_ref()?, definition.conversion.as_ref()?);
    let method = *conversion.method.as_ref().ok()?;
    if definition.kind != CrsKind::Projected || method.proj.is_empty() {
        return None;
    }
    let value = |key: &str| conversion.value(key);
    let mut text = format!("+proj={}", proj_name(method, conversion));
    let mut add = |key: &str, value: f64| {
        let _ = write!(text, " +{key}={value}");
    };
    match method.code {
        // Their latitude of origin is the equator.
        1024 | 9804 => {}
        9829 => {
            add("lat_0", 90.0_f64.copysign(value("lat_1")));
            add("lat_ts", value("lat_1"));
        }
        9801 => {
            add("lat_0", value("lat_0"));
            add("lat_1", value("lat_0"));
        }
        9805 | 9835 | 1028 => {
            add("lat_ts", value("lat_1"));
            if method.code == 1028 {
                add("lat_0", value("lat_0"));
            }
        }
        9812 | 9815 if proj_name(method, conversion) == "somerc" => add("lat_0", value("lat_0")),
        9812 | 9815 => {
            add("lat_0", value("lat_0"));
            add("lonc", value("lon_0"));
            add("alpha", value("alpha"));
            add("gamma", value("gamma"));
        }
        _ => {
            for &(key, _) in method.parameters.iter().filter(|p| p.0.starts_with("lat_")) {
                add(key, value(key));
            }
        }
    }
    if !(matches!(method.code, 9812 | 9815) && proj_name(method, conversion) == "omerc") {
        add("lon_0", value("lon_0"));
    }
    if conversion.given("k_0").is_some() {
        add("k_0", value("k_0"));
    }
    add("x_0", value("x_0"));
    add("y_0", value("y_0"));
    let shape = base.ellipsoid;
    if method.code == 1024 || shape.inverse_flattening == 0.0 {
        // Web Mercator uses a sphere with any datum.
        let _ = write!(text, " +a={0} +b={0}", shape.a);
    } else {
        let b = shape.a * (1.0 - 1.0 / shape.inverse_flattening);
        let _ = write!(text, " +a={} +b={b}", shape.a);
    }
    if method.code == 9812 {
        text += " +no_uoff";
    }
    Some(text + " +units=m +no_defs")
}

fn proj_name(method: &method::Method, conversion: &Conversion) -> &'static str {
    let swiss = conversion.value("alpha") == 90.0 && conversion.value("gamma") == 90.0;
    match method.code {
        1024 => "merc",
        // The Swiss grid: its cylinder touches along the parallel.
        9815 if swiss => "somerc",
        _ => method.proj,
    }
}
