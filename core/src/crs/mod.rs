//! Definitions of coordinate systems: datum, projection, parameters, units.
//!
//! A definition comes from a text (WKT of either version, ESRI's, an EPSG code, a PROJ string:
//! [`read`]), from GeoTIFF keys (`geokeys`) or from the EPSG table. Two definitions are compared by
//! their content, never by a name or a code ([`Definition::same`]). Texts are untrusted: they are
//! bounded, and none makes this module panic.

pub mod epsg;
pub mod geokeys;
pub mod method;
mod proj;
pub mod projection;
mod same;
mod text;
mod wkt;
mod write;

use std::borrow::Cow;

pub use self::method::Method;
pub use self::proj::string as proj_string;
pub use self::same::{are_same, datum_code};
use crate::error::{Error, Result};
use crate::geo::{Crs, CrsKind, Ellipsoid};
use epsg::table;

/// The definition of a coordinate system.
#[derive(Clone, Debug, PartialEq)]
pub struct Definition {
    pub kind: CrsKind,
    pub name: String,
    /// EPSG code of the horizontal system itself, not of one of its parts.
    pub epsg: Option<u32>,
    /// The geographic system that it is, or that it is projected from; `None` for engineering
    /// systems.
    pub base: Option<Base>,
    /// The projection; projected systems have one.
    pub conversion: Option<Conversion>,
    /// Radians (geographic) or metres of the unit of the coordinates.
    pub unit: f64,
    /// Abbreviation and direction of the axes as the system has them; rasters nevertheless have
    /// east first.
    pub axes: [(String, String); 2],
    pub vertical: Option<Vertical>,
}

/// A geographic system.
#[derive(Clone, Debug, PartialEq)]
pub struct Base {
    pub name: String,
    pub epsg: Option<u32>,
    pub datum: String,
    pub ellipsoid_name: String,
    pub ellipsoid: Ellipsoid,
    /// Name of the prime meridian, and degrees east of Greenwich.
    pub meridian: (String, f64),
    /// Radians of the unit of its angles.
    pub unit: f64,
    /// True if it includes ellipsoidal heights.
    pub has_height: bool,
}

/// A projection with its parameters by key, in degrees, metres and unity.
#[derive(Clone, Debug, PartialEq)]
pub struct Conversion {
    pub name: String,
    /// The method; `Err` with the name in the text for an unknown one.
    pub method: std::result::Result<&'static Method, String>,
    pub parameters: Vec<(Cow<'static, str>, f64)>,
}

/// A vertical system.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Vertical {
    pub name: String,
    pub datum: String,
    pub epsg: Option<u32>,
    /// Metres and name of its unit.
    pub unit: (f64, String),
    pub down: bool,
}

/// The letters and digits of a name, in lower case: `NAD83 / UTM zone 12N` and `NAD83_UTM_zone_12N`
/// are equal.
pub fn plain(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// Reads a text: WKT of either version or of ESRI's, `EPSG:n`, `EPSG:n+m`, or a PROJ string.
pub fn read(text: &str) -> Result<Crs> {
    let definition = Definition::read(text)?;
    let mut crs = definition.crs();
    let method_is_known = definition.conversion.as_ref().is_none_or(|c| c.method.is_ok());
    if !method_is_known {
        // A system with an unknown method keeps its own text, which other programs may know.
        text.trim().trim_start_matches(PE_STRING).clone_into(&mut crs.wkt);
    }
    Ok(crs)
}

/// The system of an EPSG code; of a code that is not in the table only the kind is known.
pub fn of_code(kind: CrsKind, code: u32) -> Crs {
    Definition::of_kind(kind, code)
        .map_or_else(|| Crs { kind, epsg: Some(code), ..Crs::default() }, |definition| definition.crs())
}

/// The prefix of an ESRI text in a citation of a GeoTIFF.
pub const PE_STRING: &str = "ESRI PE String = ";

impl Definition {
    /// Reads a text, as [`read`] does.
    pub fn read(text: &str) -> Result<Self> {
        let text = text.trim_start_matches('\u{feff}').trim();
        let text = text.strip_prefix(PE_STRING).unwrap_or(text).trim();
        let found = match codes(text) {
            Some((code, vertical)) => {
                let (code, vertical) = match table::compound(code) {
                    Some((horizontal, vertical)) => (horizontal, Some(vertical)),
                    None => (code, vertical),
                };
                Self::of_code(code).and_then(|mut definition| {
                    if let Some(vertical) = vertical {
                        definition.vertical = Some(Vertical::of_code(vertical)?);
                    }
                    Some(definition)
                })
            }
            None if text.starts_with('+') => proj::read(text),
            None => wkt::read(text),
        };
        found.ok_or_else(|| {
            let head: String = text.chars().take(60).collect();
            Error::unsupported(
                format!("the coordinate system {head:?}"),
                "give it as EPSG:n or as OGC WKT of a geographic, projected or engineering system",
            )
        })
    }

    /// The definition of a coordinate system by its text, its code or its keys; `None` if it is not
    /// known.
    pub fn of(crs: &Crs) -> Option<Self> {
        if crs.kind == CrsKind::Engineering {
            return None;
        }
        let by_text = Some(&crs.wkt).filter(|wkt| !wkt.is_empty()).and_then(|wkt| Self::read(wkt).ok());
        let by_code = || crs.epsg.and_then(|code| Self::of_kind(crs.kind, code));
        let by_keys = || crs.keys.as_ref().and_then(geokeys::definition);
        let mut found = by_text.or_else(by_code).or_else(by_keys).filter(|found| found.kind == crs.kind)?;
        // Keys may state another unit than that of the code.
        found.unit = crs.unit;
        Some(found)
    }

    /// A projected or geographic system by its EPSG code.
    pub fn of_code(code: u32) -> Option<Self> {
        Self::of_kind(CrsKind::Projected, code).or_else(|| Self::of_kind(CrsKind::Geographic, code))
    }

    /// A system of a kind by its EPSG code.
    pub fn of_kind(kind: CrsKind, code: u32) -> Option<Self> {
        match kind {
            CrsKind::Geographic => {
                let base = Base::of_code(code)?;
                Some(Self::geographic(base))
            }
            CrsKind::Projected => {
                let row = table::projected(code)?;
                let base = Base::of_code(row.base)?;
                let conversion = Conversion::of_code(row.conversion)?;
                Some(Self {
                    epsg: Some(code),
                    name: row.name,
                    axes: row.axes.map(|(name, direction)| (name.to_owned(), direction.to_owned())),
                    ..Self::projected(base, conversion, epsg::length_unit(row.unit)?.0)
                })
            }
            CrsKind::Engineering => None,
        }
    }

    /// The definition of a geographic system.
    pub fn geographic(base: Base) -> Self {
        Self {
            kind: CrsKind::Geographic,
            name: base.name.clone(),
            epsg: base.epsg,
            unit: base.unit,
            base: Some(base),
            conversion: None,
            axes: axes("Lat", "north", "Lon", "east"),
            vertical: None,
        }
    }

    /// The EPSG code of its datum, if that has the ellipsoid and the meridian of the dataset.
    pub fn datum_code(&self) -> Option<u32> {
        let base = self.base.as_ref()?;
        let code = datum_code(&base.datum)?;
        let known = Base::on_datum(table::datum(code)?);
        known.same(base).then_some(code)
    }

    /// A projected system without name and code; `unit` is metres of its unit.
    pub fn projected(base: Base, conversion: Conversion, unit: f64) -> Self {
        // As in PROJ: around a pole no axis points east.
        let axes = match conversion.pole() {
            Some(true) => axes("E", "South along 90°E", "N", "South along 180°E"),
            Some(false) => axes("E", "North along 90°E", "N", "North along 0°E"),
            None => axes("E", "east", "N", "north"),
        };
        Self {
            kind: CrsKind::Projected,
            name: String::new(),
            epsg: None,
            base: Some(base),
            conversion: Some(conversion),
            unit,
            axes,
            vertical: None,
        }
    }

    /// An engineering system, whose place is unknown.
    pub fn engineering(name: String, unit: f64) -> Self {
        Self {
            kind: CrsKind::Engineering,
            name,
            epsg: None,
            base: None,
            conversion: None,
            unit,
            axes: axes("E", "east", "N", "north"),
            vertical: None,
        }
    }

    /// The system as a raster keeps it, with WKT 2 of the horizontal part (empty if the method is
    /// unknown).
    pub fn crs(&self) -> Crs {
        let vertical = self.vertical.as_ref();
        Crs {
            kind: self.kind,
            epsg: self.epsg,
            name: self.name.clone(),
            wkt: self.wkt().unwrap_or_default(),
            ellipsoid: self.base.as_ref().map_or(crate::geo::WGS84, |base| base.ellipsoid),
            unit: self.unit,
            vertical_epsg: vertical.and_then(|vertical| vertical.epsg),
            vertical_name: vertical.map(|vertical| vertical.name.clone()).unwrap_or_default(),
            vertical_down: vertical.is_some_and(|vertical| vertical.down),
            keys: None,
        }
    }
}

fn axes(x: &str, east: &str, y: &str, north: &str) -> [(String, String); 2] {
    [(x.to_owned(), east.to_owned()), (y.to_owned(), north.to_owned())]
}

impl Base {
    /// A geographic system by its EPSG code.
    pub fn of_code(code: u32) -> Option<Self> {
        let row = table::geographic(code)?;
        Some(Self {
            name: row.name.to_owned(),
            epsg: Some(code),
            unit: epsg::angular_unit(row.unit)?,
            has_height: row.has_height,
            ..Self::on_datum(row.datum)
        })
    }

    /// A geographic system in degrees on a datum, without a name and a code.
    pub fn on_datum(datum: table::Datum) -> Self {
        Self {
            name: String::new(),
            epsg: None,
            datum: datum.name.to_owned(),
            ellipsoid_name: datum.ellipsoid.name.to_owned(),
            ellipsoid: datum.ellipsoid.shape,
            meridian: (datum.meridian.0.to_owned(), datum.meridian.1),
            unit: epsg::DEGREE,
            has_height: false,
        }
    }
}

impl Conversion {
    /// A projection by its EPSG code.
    pub fn of_code(code: u32) -> Option<Self> {
        let row = table::conversion(code)?;
        let parameters =
            row.parameters.iter().map(|&(key, value)| (method::key(method::parameter(key).0), value));
        Some(Self {
            name: row.name.to_owned(),
            method: Ok(method::by_code(row.method)?),
            parameters: parameters.collect(),
        })
    }

    /// The value of a key, or its default.
    pub fn value(&self, key: &str) -> f64 {
        self.given(key).unwrap_or_else(|| method::usual(key))
    }

    /// The value of a key, if it is given.
    pub fn given(&self, key: &str) -> Option<f64> {
        self.parameters.iter().find(|parameter| parameter.0 == key).map(|parameter| parameter.1)
    }

    /// True if it is stereographic or equal-area around the north pole, false if around the south
    /// pole.
    fn pole(&self) -> Option<bool> {
        let latitude = match self.method.as_ref().ok()?.code {
            9810 | 9820 => self.value("lat_0"),
            9829 | 9830 => 90.0_f64.copysign(self.value("lat_1")),
            _ => return None,
        };
        (latitude.abs() == 90.0).then_some(latitude > 0.0)
    }

    /// Sets a value.
    pub fn set(&mut self, key: &'static str, value: f64) {
        self.parameters.retain(|parameter| parameter.0 != key);
        self.parameters.push((Cow::Borrowed(key), value));
    }
}

impl Vertical {
    /// A vertical system by its EPSG code.
    pub fn of_code(code: u32) -> Option<Self> {
        let row = table::vertical(code)?;
        let (metres, unit) = epsg::length_unit(row.unit)?;
        Some(Self {
            name: row.name.to_owned(),
            datum: row.datum.to_owned(),
            epsg: Some(code),
            unit: (metres, unit.to_owned()),
            down: row.down,
        })
    }
}

/// EPSG codes of the horizontal and of the vertical part, if a text is only codes.
fn codes(text: &str) -> Option<(u32, Option<u32>)> {
    let lower = text.to_ascii_lowercase();
    if ["ogc:crs84", "crs:84", "urn:ogc:def:crs:ogc:1.3:crs84", "wgs84"].contains(&lower.as_str()) {
        return Some((4326, None));
    }
    let heads = ["epsg:", "urn:ogc:def:crs:epsg::", "http://www.opengis.net/def/crs/epsg/0/", "+init=epsg:"];
    let code = heads.into_iter().find_map(|head| lower.strip_prefix(head))?;
    let (horizontal, vertical) = match code.split_once('+') {
        Some((horizontal, vertical)) => (horizontal, Some(vertical.trim().parse().ok()?)),
        None => (code, None),
    };
    Some((horizontal.trim().parse().ok()?, vertical))
}
