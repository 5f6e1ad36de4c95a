//! Reads definitions from well-known text: OGC WKT 1 as GDAL writes it, ESRI's, and WKT 2.

use std::borrow::Cow;
use std::f64::consts::PI;

use super::method::{self, Quantity};
use super::text::Node;
use super::{Base, Conversion, Definition, Vertical};
use crate::crs::epsg::{self, DEGREE, FOOT, US_SURVEY_FOOT, table};
use crate::geo::{CrsKind, Ellipsoid};

const GEOGRAPHIC: &[&str] =
    &["GEOGCS", "GEOGCRS", "GEOGRAPHICCRS", "GEODCRS", "GEODETICCRS", "BASEGEOGCRS", "BASEGEODCRS"];
const PROJECTED: &[&str] = &["PROJCS", "PROJCRS", "PROJECTEDCRS"];
const COMPOUND: &[&str] = &["COMPD_CS", "COMPOUNDCRS"];
const BOUND: &[&str] = &["BOUNDCRS"];
const ENGINEERING: &[&str] = &["LOCAL_CS", "ENGCRS", "ENGINEERINGCRS"];
const VERTICAL: &[&str] = &["VERT_CS", "VERTCS", "VERTCRS", "VERTICALCRS"];
const DATUM: &[&str] = &["DATUM", "GEODETICDATUM", "TRF", "ENSEMBLE"];
const ELLIPSOID: &[&str] = &["SPHEROID", "ELLIPSOID"];
const ANGLE: &[&str] = &["UNIT", "ANGLEUNIT"];
const LENGTH: &[&str] = &["UNIT", "LENGTHUNIT"];
/// Keywords of systems that are not supported: without them the text would define another system.
const DERIVED: &[&str] = &["DERIVINGCONVERSION", "FITTED_CS", "GEOCCS"];

/// Reads a text; `None` if it is not a system of a kind that rasters have.
pub(super) fn read(text: &str) -> Option<Definition> {
    // In ESRI's files the vertical system follows the horizontal one.
    system(&Node::parse(text).or_else(|| Node::parse(&format!("COMPD_CS[\"\",{text}]")))?)
}

fn system(node: &Node) -> Option<Definition> {
    if node.find(DERIVED).is_some() {
        return None;
    }
    if node.is(COMPOUND) {
        let mut parts = node.nodes().filter(|part| !is_remark(part));
        let mut definition = system(parts.next()?)?;
        // Two parts, and no third (time) or derived part, which would be lost.
        let mut up = vertical(parts.find(|part| !is_remark(part))?)?;
        if let Some((horizontal, vertical)) = code(node).and_then(table::compound) {
            let known = Definition::of_code(horizontal);
            definition.epsg = definition
                .epsg
                .or_else(|| known.filter(|known| known.same(&definition)).and(Some(horizontal)));
            let named =
                table::vertical(vertical).is_some_and(|row| super::plain(row.name) == super::plain(&up.name));
            up.epsg = up.epsg.or(Some(vertical).filter(|_| named));
        }
        definition.vertical = Some(up);
        return Some(definition);
    }
    if node.is(BOUND) {
        return system(node.find(&["SOURCECRS"])?.nodes().next()?);
    }
    if node.is(ENGINEERING) {
        return Some(engineering(node));
    }
    let definition = if node.is(PROJECTED) {
        projected(node)?
    } else if node.is(GEOGRAPHIC) {
        geographic(node)?
    } else {
        return None;
    };
    Some(definition)
}

fn is_remark(node: &Node) -> bool {
    node.is(&["AUTHORITY", "ID", "USAGE", "SCOPE", "AREA", "BBOX", "REMARK", "EXTENSION"])
}

/// EPSG code of a node itself.
fn code(node: &Node) -> Option<u32> {
    node.nodes()
        .filter(|inner| inner.is(&["AUTHORITY", "ID"]) && inner.name().eq_ignore_ascii_case("EPSG"))
        .find_map(|id| id.text(1)?.trim().parse().ok())
}

/// Adds the code of a node if it agrees with the text; a text without more than a code is the
/// system of the code.
fn with_code(read: Option<Definition>, kind: CrsKind, node: &Node) -> Option<Definition> {
    let Some(number) = code(node) else { return read };
    let known = Definition::of_kind(kind, number);
    match (read, known) {
        (Some(mut read), Some(known)) => {
            if read.same(&known) {
                read.epsg = Some(number);
            }
            Some(read)
        }
        // The code is newer than the table: only the text is known.
        (Some(read), None) => Some(Definition { epsg: Some(number), ..read }),
        (None, known) => known.filter(|_| node.find(GEOGRAPHIC).is_none()),
    }
}

fn geographic(node: &Node) -> Option<Definition> {
    let bare = node.find(DATUM).is_none();
    let read = if bare { None } else { base(node) };
    // Some files of Earth-centred coordinates have the keyword of geodetic ones.
    if node.find(&["CS"]).is_some_and(|cs| cs.name().eq_ignore_ascii_case("Cartesian")) {
        return None;
    }
    let read = read.map(|base| {
        let mut system = Definition::geographic(base);
        let first = node.nodes().filter(|node| node.is(&["AXIS"])).find_map(axis);
        if first.is_some_and(|(_, way)| way == "east") {
            system.axes.swap(0, 1);
        }
        system
    });
    with_code(read, CrsKind::Geographic, node)
}

fn base(node: &Node) -> Option<Base> {
    let datum = node.find(DATUM)?;
    let ellipsoid = datum.find(ELLIPSOID)?;
    let unit = angle_of(node).unwrap_or(DEGREE);
    let meridian = node.find(&["PRIMEM", "PRIMEMERIDIAN"]);
    let longitude = meridian.map_or(Some(0.0), |meridian| {
        let factor = unit_of(meridian, ANGLE).map_or(1.0, |unit| unit / DEGREE);
        Some(meridian.number(1)? * factor)
    })?;
    let base = Base {
        name: node.name().to_owned(),
        epsg: code(node),
        datum: datum.name().trim_end_matches(" ensemble").to_owned(),
        ellipsoid_name: ellipsoid.name().to_owned(),
        ellipsoid: shape(ellipsoid)?,
        meridian: (meridian.map_or("Greenwich", Node::name).to_owned(), longitude),
        unit,
        has_height: node.find(&["CS"]).and_then(|cs| cs.number(1)) == Some(3.0),
    };
    // Use the name in the dataset for a datum that it has.
    let known = super::datum_code(&base.datum).and_then(table::datum).map(Base::on_datum);
    Some(match known.filter(|known| known.same(&base)) {
        Some(known) => Base { datum: known.datum, ellipsoid_name: known.ellipsoid_name, ..base },
        None => base,
    })
}

fn shape(node: &Node) -> Option<Ellipsoid> {
    let metres = unit_of(node, LENGTH).unwrap_or(1.0);
    let (a, inverse_flattening) = (node.number(1)? * metres, node.number(2)?);
    let is_body = a > 0.0 && a.is_finite() && (inverse_flattening == 0.0 || inverse_flattening > 1.0);
    is_body.then_some(Ellipsoid { a, inverse_flattening })
}

fn projected(node: &Node) -> Option<Definition> {
    let read = || {
        let base = base(node.find(GEOGRAPHIC)?)?;
        let unit = length_of(node).unwrap_or(1.0);
        let conversion = match node.find(&["CONVERSION"]) {
            Some(two) => conversion(two, &base, unit, two.find(&["METHOD", "PROJECTION"])?),
            None => conversion(node, &base, unit, node.find(&["PROJECTION"])?),
        }?;
        let mut definition = Definition::projected(base, conversion, unit);
        node.name().clone_into(&mut definition.name);
        let found: Vec<_> = node.nodes().filter(|node| node.is(&["AXIS"])).filter_map(axis).collect();
        // Two axes to the south are those around a pole, whose meridians WKT 1 omits.
        if let Ok(axes) = <[(String, String); 2]>::try_from(found)
            && axes[0].1 != axes[1].1
        {
            definition.axes = axes;
        }
        Some(definition)
    };
    with_code(read(), CrsKind::Projected, node)
}

/// Abbreviation and direction of an axis.
fn axis(node: &Node) -> Option<(String, String)> {
    let name = node.name();
    let short = name.rsplit_once('(').map_or(name, |(_, tail)| tail.trim_end_matches(')'));
    let short = match short.to_ascii_lowercase().as_str() {
        "easting" => "E",
        "northing" => "N",
        _ => short,
    };
    let mut direction = node.text(1)?.to_ascii_lowercase();
    if let Some(meridian) = node.find(&["MERIDIAN"]) {
        let degrees = meridian.number(0)? * unit_of(meridian, ANGLE).map_or(1.0, |unit| unit / DEGREE);
        let side = if degrees < 0.0 { 'W' } else { 'E' };
        let from = if direction == "north" { "North" } else { "South" };
        direction = format!("{from} along {}°{side}", degrees.abs());
    }
    Some((short.to_owned(), direction))
}

/// A projection: WKT 1 has its parts beside the base, WKT 2 in a node of their own.
fn conversion(node: &Node, base: &Base, unit: f64, of: &Node) -> Option<Conversion> {
    let name = of.name();
    let mut parameters: Vec<(Cow<'static, str>, f64)> = Vec::new();
    for parameter in node.nodes().filter(|node| node.is(&["PARAMETER"])) {
        let key = method::key(parameter.name());
        let value = parameter.number(1)?;
        let stated = ["ANGLEUNIT", "LENGTHUNIT", "SCALEUNIT", "UNIT"]
            .iter()
            .find_map(|keyword| unit_of(parameter, &[keyword]));
        let value = match method::quantity(&key) {
            Quantity::Angle => degrees(value, stated.unwrap_or(base.unit)),
            Quantity::Length => value * stated.unwrap_or(unit),
            Quantity::Ratio => value * stated.unwrap_or(1.0),
        };
        if !parameters.iter().any(|known| known.0 == key) {
            parameters.push((key, value));
        }
    }
    let is_pseudo = node
        .find(&["EXTENSION"])
        .and_then(|extension| extension.text(1))
        .is_some_and(|proj| proj.contains("+proj=merc") && proj.contains("+nadgrids=@null"));
    let method = if is_pseudo { method::by_code(1024) } else { method::by_name(name) };
    let named = if node.is(&["CONVERSION"]) { node.name() } else { "unnamed" };
    let method = method.ok_or_else(|| name.to_owned());
    let mut conversion = Conversion { name: named.to_owned(), method, parameters };
    // One name for axes to the south and west and for axes to the east and north: the axes decide,
    // or at ESRI a scale of -1.
    let mirrored = conversion.given("xscale").map(|scale| scale < 0.0);
    let axes = node.nodes().filter(|node| node.is(&["AXIS"])).filter_map(axis);
    let southward = axes.map(|axis| axis.1).any(|way| way == "south" || way == "west");
    if super::plain(name) == "krovak" && !node.is(&["CONVERSION"]) && mirrored.unwrap_or(!southward) {
        conversion.method = method::by_code(1041).ok_or_else(String::new);
    }
    conversion.settle(name);
    Some(conversion)
}

impl Conversion {
    /// [`Self::settle`] for keys, which have one number for several variants of a method.
    pub fn settle_keys(&mut self) {
        let number = self.method.as_ref().map_or(0, |method| method.code);
        self.settle(if number == 9810 { "Polar_Stereographic" } else { "" });
    }

    /// Brings the conversion into one form, whichever names and parameters it came with; `name` is
    /// the method in the text.
    pub(super) fn settle(&mut self, name: &str) {
        let Ok(method) = self.method else { return };
        let by_code = |code| method::by_code(code).ok_or_else(String::new);
        let (lat_1, name) = (self.given("lat_1"), super::plain(name));
        match (method.code, name.as_str()) {
            // With one parallel and a scale, or with two parallels.
            (9802, "lambertconformalconic") if self.given("lat_2").is_none() => {
                self.set("lat_0", lat_1.unwrap_or_else(|| self.value("lat_0")));
                self.method = by_code(9801);
            }
            // WKT 1 has one name for both variants; the parallel distinguishes them.
            (9810, "polarstereographic") if self.value("lat_0").abs() != 90.0 => {
                self.set("lat_1", self.value("lat_0"));
                self.method = by_code(9829);
            }
            (9804, _) if lat_1.is_some_and(|lat_1| lat_1 != 0.0) => {
                self.method = by_code(9805);
            }
            (9812 | 9815, _) if self.given("gamma").is_none() => self.set("gamma", self.value("alpha")),
            _ => {}
        }
        let Ok(method) = self.method else { return };
        match method.code {
            9829 if self.value("lat_1").abs() == 90.0 => {
                self.set("lat_0", self.value("lat_1"));
                self.method = by_code(9810);
            }
            9805 if self.value("lat_1") == 0.0 => self.method = by_code(9804),
            _ => {}
        }
        let Ok(method) = self.method else { return };
        self.parameters.retain(|parameter| method.parameters.iter().any(|known| known.0 == parameter.0));
    }
}

fn vertical(node: &Node) -> Option<Vertical> {
    if node.is(BOUND) {
        return vertical(node.find(&["SOURCECRS"])?.nodes().next()?);
    }
    if !node.is(VERTICAL) {
        return None;
    }
    let axis = node.find(&["AXIS"]);
    // ESRI has a parameter for it.
    let esri_down = node.nodes().any(|node| {
        node.is(&["PARAMETER"]) && super::plain(node.name()) == "direction" && node.number(1) == Some(-1.0)
    });
    let datum = node.find(&["VERT_DATUM", "VDATUM", "VERTICALDATUM", "VRF", "ENSEMBLE", "DATUM"]);
    let unit = node.find(LENGTH).or_else(|| axis?.find(LENGTH));
    let metres = unit.and_then(factor).unwrap_or(1.0);
    Some(Vertical {
        name: node.name().to_owned(),
        datum: datum.map_or("", Node::name).to_owned(),
        epsg: code(node),
        unit: (metres, unit_name(metres).unwrap_or_else(|| unit.map_or("metre", Node::name)).to_owned()),
        down: esri_down
            || axis.and_then(|axis| axis.text(1)).is_some_and(|way| way.eq_ignore_ascii_case("down")),
    })
}

fn unit_name(metres: f64) -> Option<&'static str> {
    [(1.0, "metre"), (FOOT, "foot"), (US_SURVEY_FOOT, "US survey foot")]
        .into_iter()
        .find(|unit| (unit.0 - metres).abs() < 1e-9)
        .map(|unit| unit.1)
}

fn engineering(node: &Node) -> Definition {
    let unit = length_of(node).unwrap_or(1.0);
    let name = Some(node.name()).filter(|name| !name.starts_with("Unknown engineering CRS"));
    Definition { epsg: None, ..Definition::engineering(name.unwrap_or_default().to_owned(), unit) }
}

/// The factor of a unit node; of a well-known unit printed with few digits the exact one.
fn factor(node: &Node) -> Option<f64> {
    let value = node.number(1).filter(|&value| value > 0.0)?;
    let known = [1.0, FOOT, US_SURVEY_FOOT, DEGREE, PI / 200.0];
    Some(known.into_iter().find(|&known| (value - known).abs() <= 1e-9 * known).unwrap_or(value))
}

/// The unit that a node states.
fn unit_of(node: &Node, keywords: &[&str]) -> Option<f64> {
    factor(node.find(keywords)?)
}

/// Radians of the unit of a geographic system: its own, or that of its axes.
fn angle_of(node: &Node) -> Option<f64> {
    unit_of(node, ANGLE)
        .or_else(|| node.nodes().filter(|node| node.is(&["AXIS"])).find_map(|axis| unit_of(axis, ANGLE)))
}

/// Metres of the unit of a plane: its own, or that of its axes.
fn length_of(node: &Node) -> Option<f64> {
    unit_of(node, LENGTH)
        .or_else(|| node.nodes().filter(|node| node.is(&["AXIS"])).find_map(|axis| unit_of(axis, LENGTH)))
}

/// Degrees of a value in a unit of `unit` radians, without rounding if the unit is the degree.
fn degrees(value: f64, unit: f64) -> f64 {
    if unit == epsg::DEGREE { value } else { value * unit / DEGREE }
}
