//! Where a file lies on the Earth, for `relevo info`: longitude and latitude of its corners and its
//! middle.

use relevo::container::reader::Reader;
use relevo::crs::projection::Projection;
use relevo::geo::{CrsKind, Geo};
use serde_json::{Value, json};

use crate::cli::table::short;

/// Corners and middle of a raster: name, and longitude and latitude unless the projection is
/// undefined there.
struct Location {
    points: [(&'static str, Option<(f64, f64)>); 5],
    datum: String,
    /// Metres by which the datum may differ from WGS 84.
    within: f64,
}

/// The location, or the reason why it is unknown; `None` for a file without a place on the Earth.
fn location(reader: &Reader) -> Option<Result<Location, String>> {
    let (header, geo) = (reader.header(), reader.geo());
    if geo.transform.is_none() || geo.crs.kind == CrsKind::Engineering {
        return None;
    }
    let projection = match Projection::of(&geo.crs) {
        Ok(projection) => projection,
        Err(error) => return Some(Err(error.to_string())),
    };
    let (east, south) = (f64::from(header.width) - 0.5, f64::from(header.height) - 0.5);
    let at = |column: f64, row: f64| {
        let (x, y) = geo.world_from_sample(column, row);
        projection.to_lonlat(x, y)
    };
    let points = [
        ("north_west", at(-0.5, -0.5)),
        ("north_east", at(east, -0.5)),
        ("south_west", at(-0.5, south)),
        ("south_east", at(east, south)),
        ("middle", at((east - 0.5) / 2.0, (south - 0.5) / 2.0)),
    ];
    let (datum, within) = (projection.datum().to_owned(), projection.within().unwrap_or(0.0));
    Some(Ok(Location { points, datum, within }))
}

/// Metres of a pixel in the middle of the raster, along columns and rows.
fn pixel_metres(reader: &Reader) -> [f64; 2] {
    let header = reader.header();
    let (column, row) = (header.width / 2, header.height / 2);
    let spacing = reader.geo().spacing((column, column), (row, row));
    [spacing.dx, spacing.dy]
}

/// Size of a pixel in units of the coordinate system, along columns and rows, to twelve decimals;
/// in samples if there is no georeference.
fn pixel(geo: &Geo) -> [f64; 2] {
    let [_, a, b, _, d, e] = geo.transform_or_identity();
    [a.hypot(d), b.hypot(e)]
        .map(|side| if (1e-6..1e3).contains(&side) { (side * 1e12).round() / 1e12 } else { side })
}

/// Name and text of each printed line.
pub fn lines(reader: &Reader) -> Vec<(&'static str, String)> {
    let geo = reader.geo();
    let mut lines = Vec::new();
    if geo.transform.is_some() {
        let ([x, y], [dx, dy]) = (pixel(geo), pixel_metres(reader).map(short));
        let unit = match geo.crs.kind {
            CrsKind::Geographic if (geo.crs.unit.to_degrees() - 1.0).abs() < 1e-9 => " degrees",
            _ if geo.crs.unit == 1.0 => " m",
            _ => " units",
        };
        let metres =
            if unit == " m" { String::new() } else { format!(", {dx} x {dy} m in the middle of the raster") };
        lines.push(("pixel", format!("{x} x {y}{unit}{metres}")));
    }
    match location(reader) {
        None => {}
        Some(Err(reason)) => lines.push(("lon, lat", format!("not told: {reason}"))),
        Some(Ok(place)) => {
            let text = |point: Option<(f64, f64)>| {
                point.map_or_else(
                    || "outside of the projection".to_owned(),
                    |(lon, lat)| format!("{lon:.6}, {lat:.6}"),
                )
            };
            let mut name = "lon, lat";
            for (corner, point) in place.points {
                // The corners of a raster in degrees are its bounds.
                if geo.crs.kind == CrsKind::Geographic && corner != "middle" {
                    continue;
                }
                lines.push((name, format!("{:<10} {}", corner.replace('_', "-"), text(point))));
                name = "";
            }
            if place.datum != "World Geodetic System 1984" {
                lines
                    .push(("", format!("on the datum {}, within {} m of WGS 84", place.datum, place.within)));
            }
        }
    }
    lines
}

/// The location as JSON.
pub fn facts(reader: &Reader) -> Value {
    let place = match location(reader) {
        None => Value::Null,
        Some(Err(reason)) => json!({ "refused": reason }),
        Some(Ok(place)) => {
            let points = place
                .points
                .map(|(name, point)| (name.to_owned(), json!(point.map(|(lon, lat)| [lon, lat]))));
            let mut facts: serde_json::Map<String, Value> = points.into_iter().collect();
            facts.insert("datum".to_owned(), json!(place.datum));
            facts.insert("within_m_of_wgs84".to_owned(), json!(place.within));
            Value::Object(facts)
        }
    };
    json!({ "pixel": pixel(reader.geo()), "pixel_m": pixel_metres(reader), "lon_lat": place })
}
