//! OGC WKT 2 (2019) of a definition.

use std::fmt::Write;

use super::{Base, Conversion, Definition, method};
use crate::crs::epsg::{self, DEGREE};
use crate::geo::CrsKind;

const DEGREES: &str = "ANGLEUNIT[\"degree\",0.0174532925199433]";

impl Definition {
    /// The text of the horizontal part; `None` if its projection has no name in WKT 2 that is known
    /// here.
    pub fn wkt(&self) -> Option<String> {
        match self.kind {
            CrsKind::Geographic => geographic(self),
            CrsKind::Projected => projected(self),
            CrsKind::Engineering => Some(engineering(self)),
        }
    }
}

/// The text in quotes, with quotes doubled.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

fn id(code: Option<u32>) -> String {
    code.map_or_else(String::new, |code| format!(",ID[\"EPSG\",{code}]"))
}

fn length_unit(metres: f64) -> String {
    let name = epsg::length_name(metres).unwrap_or("unknown");
    format!("LENGTHUNIT[\"{name}\",{metres}]")
}

fn angle_unit(radians: f64) -> String {
    if radians == DEGREE {
        return DEGREES.to_owned();
    }
    let name = if (radians / DEGREE - 0.9).abs() < 1e-12 {
        "grad"
    } else if radians == 1.0 {
        "radian"
    } else {
        "unknown"
    };
    format!("ANGLEUNIT[\"{name}\",{radians}]")
}

/// Datum, ellipsoid and prime meridian.
fn datum(base: &Base) -> String {
    let (shape, (meridian, longitude)) = (base.ellipsoid, &base.meridian);
    format!(
        "DATUM[{},ELLIPSOID[{},{},{},LENGTHUNIT[\"metre\",1]]],PRIMEM[{},{longitude},{DEGREES}]",
        quoted(&base.datum),
        quoted(&base.ellipsoid_name),
        shape.a,
        shape.inverse_flattening,
        quoted(meridian),
    )
}

fn geographic(definition: &Definition) -> Option<String> {
    let base = definition.base.as_ref()?;
    let unit = angle_unit(definition.unit);
    let (count, height) = if base.has_height {
        (3, ",AXIS[\"ellipsoidal height (h)\",up,ORDER[3],LENGTHUNIT[\"metre\",1]]")
    } else {
        (2, "")
    };
    let mut axes = ["geodetic latitude (Lat)\",north", "geodetic longitude (Lon)\",east"];
    if definition.axes[0].1 == "east" {
        axes.swap(0, 1);
    }
    let [first, second] = axes;
    Some(format!(
        "GEOGCRS[{},{},CS[ellipsoidal,{count}],AXIS[\"{first},ORDER[1],{unit}],\
         AXIS[\"{second},ORDER[2],{unit}]{height}{}]",
        quoted(&definition.name),
        datum(base),
        id(definition.epsg)
    ))
}

fn projected(definition: &Definition) -> Option<String> {
    let base = definition.base.as_ref()?;
    let conversion = conversion(definition.conversion.as_ref()?)?;
    let unit = length_unit(definition.unit);
    let angle = if base.unit == DEGREE { String::new() } else { format!(",{}", angle_unit(base.unit)) };
    let mut axes = String::new();
    for (number, (name, direction)) in definition.axes.iter().enumerate() {
        let (way, meridian) = direction_of(direction);
        let _ = write!(
            axes,
            ",AXIS[{},{way}{meridian},ORDER[{}],{unit}]",
            quoted(&format!("({name})")),
            number + 1
        );
    }
    Some(format!(
        "PROJCRS[{},BASEGEOGCRS[{},{}{angle}{}],{conversion},CS[Cartesian,2]{axes}{}]",
        quoted(&definition.name),
        quoted(&base.name),
        datum(base),
        id(base.epsg),
        id(definition.epsg)
    ))
}

/// `North along 90°E` is a direction with a meridian.
fn direction_of(direction: &str) -> (String, String) {
    let Some((way, along)) = direction.split_once(" along ") else {
        return (direction.to_ascii_lowercase(), String::new());
    };
    let west = along.ends_with('W');
    let degrees = along.trim_end_matches(['E', 'W', '°']);
    let sign = if west && degrees != "180" { "-" } else { "" };
    (way.to_ascii_lowercase(), format!(",MERIDIAN[{sign}{degrees},{DEGREES}]"))
}

fn conversion(conversion: &Conversion) -> Option<String> {
    let method = conversion.method.as_ref().ok()?;
    let method_id = id(Some(method.code).filter(|&code| code != 0));
    let mut text = format!("CONVERSION[{},METHOD[\"{}\"{method_id}]", quoted(&conversion.name), method.name);
    for &(key, code) in method.parameters {
        let (name, quantity) = method::parameter(code);
        let unit = match quantity {
            method::Quantity::Angle => DEGREES,
            method::Quantity::Length => "LENGTHUNIT[\"metre\",1]",
            method::Quantity::Ratio => "SCALEUNIT[\"unity\",1]",
        };
        let id = id(Some(code).filter(|&code| code != 0));
        let _ = write!(text, ",PARAMETER[\"{name}\",{},{unit}{id}]", conversion.value(key));
    }
    Some(text + "]")
}

fn engineering(definition: &Definition) -> String {
    let name = if definition.name.is_empty() { "Unknown engineering CRS" } else { &definition.name };
    let unit = length_unit(definition.unit);
    format!(
        "ENGCRS[{},EDATUM[\"Unknown engineering datum\"],CS[Cartesian,2],\
         AXIS[\"(E)\",east,ORDER[1],{unit}],AXIS[\"(N)\",north,ORDER[2],{unit}]]",
        quoted(name)
    )
}
