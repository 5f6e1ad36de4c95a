//! Tests whether two coordinate systems are the same, by their definitions.

use std::collections::HashMap;
use std::sync::OnceLock;

use super::{Base, Conversion, Definition, method, plain};
use crate::crs::epsg::table;
use crate::geo::{Crs, CrsKind};

/// Largest relative difference of two numbers that count as equal.
const ROUNDING: f64 = 1e-9;
/// Largest relative difference of two flattenings that count as equal: programs write them with six
/// to fifteen digits.
const ROUNDING_OF_FLATTENING: f64 = 1e-8;
/// Largest difference in degrees of two angles that count as equal: a tenth of a millimetre on the
/// ground.
const ANGLE: f64 = 1e-9;
/// Largest difference in metres of two lengths that count as equal.
const LENGTH: f64 = 1e-4;

fn near(a: f64, b: f64, share: f64) -> bool {
    (a - b).abs() <= share * a.abs().max(b.abs())
}

/// True if coordinates of one are coordinates of the other, horizontally. A system of which nothing
/// is known is equal only to systems of its kind.
pub fn are_same(a: &Crs, b: &Crs) -> bool {
    if a.kind != b.kind || !near(a.unit, b.unit, ROUNDING) {
        return false;
    }
    if a.kind == CrsKind::Engineering {
        return plain(&a.name) == plain(&b.name);
    }
    if let (Some(one), Some(other)) = (Definition::of(a), Definition::of(b)) {
        return one.same(&other);
    }
    // Unknown codes, and keys and texts that cannot be parsed, are compared as they are.
    match (a.epsg, b.epsg) {
        (Some(a), Some(b)) => a == b,
        (None, None) => {
            let keys = a.keys.is_some() && a.keys == b.keys;
            keys || !a.wkt.is_empty() && a.wkt == b.wkt
        }
        _ => false,
    }
}

impl Definition {
    /// True if both define the same horizontal coordinates; names, codes and vertical parts are
    /// ignored.
    pub fn same(&self, other: &Self) -> bool {
        let bases = match (&self.base, &other.base) {
            (Some(one), Some(other)) => one.same(other),
            (None, None) => plain(&self.name) == plain(&other.name),
            _ => false,
        };
        let conversions = match (&self.conversion, &other.conversion) {
            (Some(one), Some(other)) => one.same(other),
            (None, None) => true,
            _ => false,
        };
        self.kind == other.kind && near(self.unit, other.unit, ROUNDING) && bases && conversions
    }
}

impl Base {
    /// True if both have the same datum; unit and name are ignored.
    pub fn same(&self, other: &Self) -> bool {
        let (one, two) = (self.ellipsoid, other.ellipsoid);
        let turned = (self.meridian.1 - other.meridian.1).abs();
        near(one.a, two.a, ROUNDING)
            && near(one.inverse_flattening, two.inverse_flattening, ROUNDING_OF_FLATTENING)
            && turned <= 1e-7
            && datums_are_same(&self.datum, &other.datum)
    }
}

/// True if two names of datums mean the same datum, ESRI's names included; a datum without a name
/// is equal only to its kind.
fn datums_are_same(a: &str, b: &str) -> bool {
    match (datum_code(a), datum_code(b)) {
        (Some(one), Some(other)) => one == other,
        (None, None) => {
            let [a, b] = [a, b].map(|name| plain(name.strip_prefix("D_").unwrap_or(name)));
            let is_unknown = |name: &str| {
                name.is_empty()
                    || ["unknown", "notspecified", "unnamed"].iter().any(|word| name.starts_with(word))
            };
            a == b || is_unknown(&a) && is_unknown(&b)
        }
        _ => false,
    }
}

/// EPSG code of a datum by its name, EPSG's or ESRI's, however it is spelt.
pub fn datum_code(name: &str) -> Option<u32> {
    static CODES: OnceLock<HashMap<String, u32>> = OnceLock::new();
    let codes = CODES.get_or_init(|| {
        let mut codes: HashMap<String, u32> = [("wgs84", 6326), ("nad83", 6269), ("nad27", 6267)]
            .map(|(name, code)| (name.to_owned(), code))
            .into();
        let rows = || table::datum_codes().filter_map(|code| Some((code, table::datum(code)?)));
        for (code, row) in rows() {
            codes.entry(plain(row.name)).or_insert(code);
        }
        for (code, row) in rows() {
            // The meridian is stated separately: with another one the datum has the same name at
            // ESRI.
            let head = row.name.strip_suffix(&format!(" ({})", row.meridian.0)).unwrap_or(row.name);
            let code = codes.get(&plain(head)).or(codes.get(&plain(row.name))).copied().unwrap_or(code);
            codes.insert(plain(row.name), code);
            if !row.alias.is_empty() {
                codes.entry(plain(row.alias)).or_insert(code);
            }
        }
        codes
    });
    let name = name.strip_prefix("D_").unwrap_or(name);
    codes.get(&plain(name.trim_end_matches(" ensemble"))).copied()
}

impl Conversion {
    /// True if both have the same method and parameters; names are ignored.
    pub fn same(&self, other: &Self) -> bool {
        let (one, other) = (self.settled(), other.settled());
        let methods = match (&one.method, &other.method) {
            (Ok(one), Ok(other)) => one == other,
            (Err(one), Err(other)) => plain(one) == plain(other),
            _ => false,
        };
        methods
            && one.parameters.iter().chain(&other.parameters).all(|(key, _)| {
                let (a, b) = (one.value(key), other.value(key));
                match method::quantity(key) {
                    // A whole turn is no difference.
                    method::Quantity::Angle => ((a - b + 180.0).rem_euclid(360.0) - 180.0).abs() <= ANGLE,
                    method::Quantity::Length => (a - b).abs() <= LENGTH,
                    method::Quantity::Ratio => near(a, b, ROUNDING),
                }
            })
    }

    /// The conversion in one form for a cone, which either two parallels or one and a scale
    /// describe.
    fn settled(&self) -> Self {
        let mut settled = self.clone();
        let Ok(method) = self.method else { return settled };
        let (lat_1, lat_2) = (self.value("lat_1"), self.value("lat_2"));
        if method.code == 9802 && lat_1 == lat_2 && lat_1 == self.value("lat_0") {
            settled.parameters.retain(|parameter| !["lat_1", "lat_2"].contains(&&*parameter.0));
            settled.method = method::by_code(9801).ok_or_else(String::new);
        }
        // The parallels of a cone may have either order.
        if matches!(method.code, 9802 | 9822) && lat_2 < lat_1 {
            settled.set("lat_1", lat_2);
            settled.set("lat_2", lat_1);
        }
        settled
    }
}
