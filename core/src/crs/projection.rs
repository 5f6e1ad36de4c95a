//! Converts coordinates of one system to those of another, without a database of shifts between
//! datums.
//!
//! A projection goes to longitude and latitude on its own datum, exactly. From there to WGS 84 is a
//! shift. It is known here only for datums that *are* WGS 84 in the EPSG dataset, within metres
//! that the dataset states ([`Projection::within`]): ETRS89, NAD83, GDA94, JGD2011 and some hundred
//! others. Coordinates on any other datum are refused by its name; they could be off by a hundred
//! metres.

use proj4rs::Proj;
use proj4rs::transform::transform;

use super::epsg::{DEGREE, table};
use super::{Base, Definition};
use crate::error::{Error, Result};
use crate::geo::{Crs, CrsKind};

/// Advice for a system that cannot be placed on the Earth.
const ADVICE: &str = "give coordinates in the system of the file itself, or convert them with gdaltransform";

/// The conversion between the coordinates of a system and longitude and latitude.
pub struct Projection {
    base: Base,
    within: Option<f64>,
    /// Radians or metres of a unit of the coordinates.
    unit: f64,
    /// The plane, and longitude and latitude on its ellipsoid; `None` if the coordinates are
    /// longitude and latitude themselves.
    plane: Option<(Proj, Proj)>,
}

impl Projection {
    /// The projection of a system whose longitudes and latitudes are those of WGS 84 within a few
    /// metres; others are refused by name.
    pub fn of(crs: &Crs) -> Result<Self> {
        let found = Self::on_own_datum(crs)?;
        match found.within() {
            Some(_) => Ok(found),
            None => Err(Error::unsupported(
                format!(
                    "longitude and latitude of {}: how its datum ({}) lies to WGS 84",
                    name(crs),
                    found.base.datum
                ),
                ADVICE,
            )),
        }
    }

    /// The projection of a system to longitudes and latitudes on its own datum.
    pub fn on_own_datum(crs: &Crs) -> Result<Self> {
        let refused =
            |what: String| Error::unsupported(format!("coordinates of {}: {what}", name(crs)), ADVICE);
        if crs.kind == CrsKind::Engineering {
            return Err(refused("where they lie on the Earth is not said".to_owned()));
        }
        let definition = Definition::of(crs).ok_or_else(|| refused("what its parameters are".to_owned()))?;
        let base = definition.base.clone().ok_or_else(|| refused("what its datum is".to_owned()))?;
        let plane = match crs.kind {
            CrsKind::Projected => Some(plane(&definition, &base).ok_or_else(|| {
                let method = definition.conversion.as_ref().map(|conversion| match &conversion.method {
                    Ok(method) => method.name,
                    Err(method) => method,
                });
                refused(format!("the projection {} with these parameters", method.unwrap_or_default()))
            })?),
            _ => None,
        };
        let within = definition.datum_code().and_then(table::datum).and_then(|datum| datum.within);
        Ok(Self { base, within, unit: definition.unit, plane })
    }

    /// Metres within which longitude and latitude are those of WGS 84, if that is known: up to
    /// four.
    pub fn within(&self) -> Option<f64> {
        self.within
    }

    /// Name of the datum.
    pub fn datum(&self) -> &str {
        &self.base.datum
    }

    /// Longitude and latitude in degrees, east of Greenwich; `None` where the projection has none.
    ///
    /// ```
    /// use relevo_core::{Projection, crs};
    ///
    /// let utm = Projection::of(&crs::read("EPSG:32632")?)?;
    /// let (lon, lat) = utm.to_lonlat(500_000.0, 5_000_000.0).unwrap();
    /// assert!((lon - 9.0).abs() < 1e-9 && (lat - 45.153).abs() < 1e-3);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn to_lonlat(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        let Some((plane, degrees)) = &self.plane else {
            let (lon, lat) = (x * self.unit / DEGREE + self.base.meridian.1, y * self.unit / DEGREE);
            return (lon.is_finite() && lat.abs() <= 90.0 + 1e-9).then_some((lon, lat));
        };
        let metres = (x * self.unit, y * self.unit);
        let (lon, lat) = moved(plane, degrees, metres)?;
        // Outside its area the formulas of a projection give arbitrary results: a result that does
        // not convert back is refused.
        let back = moved(degrees, plane, (lon, lat))?;
        let allowed = 0.01 + 1e-9 * metres.0.abs().max(metres.1.abs());
        let returns = (back.0 - metres.0).abs() <= allowed && (back.1 - metres.1).abs() <= allowed;
        returns.then(|| (wrapped(lon.to_degrees() + self.base.meridian.1), lat.to_degrees()))
    }

    /// Inverse of [`Self::to_lonlat`].
    pub fn from_lonlat(&self, lon: f64, lat: f64) -> Option<(f64, f64)> {
        if !lon.is_finite() || !(-90.0..=90.0).contains(&lat) {
            return None;
        }
        let lon = lon - self.base.meridian.1;
        let Some((plane, degrees)) = &self.plane else {
            return Some((lon * DEGREE / self.unit, lat * DEGREE / self.unit));
        };
        let from = (wrapped(lon).to_radians(), lat.to_radians());
        let (x, y) = moved(degrees, plane, from)?;
        Some((x / self.unit, y / self.unit))
    }
}

/// The conversion of coordinates of one system to another.
pub struct Between {
    from: Projection,
    to: Projection,
}

impl Between {
    /// The conversion from one system to another: both on one datum, or both on datums that are WGS
    /// 84 within metres.
    pub fn new(from: &Crs, to: &Crs) -> Result<Self> {
        let (own, other) = (Projection::on_own_datum(from)?, Projection::on_own_datum(to)?);
        if own.base.same(&other.base) {
            return Ok(Self { from: own, to: other });
        }
        Ok(Self { from: Projection::of(from)?, to: Projection::of(to)? })
    }

    /// The coordinates in the other system, if the place has any.
    pub fn convert(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        let (lon, lat) = self.from.to_lonlat(x, y)?;
        self.to.from_lonlat(lon, lat)
    }
}

/// The plane of a projected system, and longitude and latitude on its ellipsoid.
fn plane(definition: &Definition, base: &Base) -> Option<(Proj, Proj)> {
    let conversion = definition.conversion.as_ref()?;
    // The formulas are not made for values outside this range.
    let sane = conversion.parameters.iter().all(|(key, value)| match key.as_ref() {
        key if key.starts_with("lat") => value.abs() <= 90.0,
        "k_0" => (0.01..=100.0).contains(value),
        "x_0" | "y_0" | "h" => value.abs() <= 1e9,
        _ => value.abs() <= 720.0,
    });
    let shape = base.ellipsoid;
    let is_body =
        (1e3..1e9).contains(&shape.a) && (shape.inverse_flattening == 0.0 || shape.inverse_flattening > 2.0);
    let eastward = definition.axes.iter().all(|axis| !matches!(axis.1.as_str(), "west" | "south"));
    let string = super::proj_string(definition).filter(|_| sane && is_body && eastward)?;
    let plane = Proj::from_proj_string(&string).ok()?;
    let b = if shape.inverse_flattening > 0.0 {
        shape.a * (1.0 - 1.0 / shape.inverse_flattening)
    } else {
        shape.a
    };
    let degrees = format!("+proj=longlat +a={} +b={b} +no_defs", shape.a);
    let degrees = Proj::from_proj_string(&degrees).ok()?;
    (plane.has_inverse() && plane.has_forward()).then_some((plane, degrees))
}

/// Converts radians or metres of one system to those of the other.
fn moved(from: &Proj, to: &Proj, (x, y): (f64, f64)) -> Option<(f64, f64)> {
    let mut point = (x, y, 0.0);
    transform(from, to, &mut point).ok()?;
    (point.0.is_finite() && point.1.is_finite()).then_some((point.0, point.1))
}

/// A longitude between -180 and 180 degrees.
fn wrapped(lon: f64) -> f64 {
    if (-180.0..=180.0).contains(&lon) { lon } else { (lon + 180.0).rem_euclid(360.0) - 180.0 }
}

/// The name of a system, for messages.
fn name(crs: &Crs) -> String {
    match (crs.epsg, crs.name.as_str()) {
        (Some(code), "") => format!("EPSG:{code}"),
        (Some(code), name) => format!("EPSG:{code} ({name})"),
        (None, "") => "a raster without a coordinate system".to_owned(),
        (None, name) => format!("the coordinate system {name:?}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    /// Places by PROJ 9.1.1 through GDAL: longitude and latitude on the system's own datum, and
    /// coordinates.
    fn oracle() -> Vec<Value> {
        let path = std::env::var("RELEVO_POINTS_ORACLE").unwrap_or_else(|_| {
            concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/crs/points.json").to_owned()
        });
        serde_json::from_str(&std::fs::read_to_string(path).expect("file")).expect("JSON")
    }

    #[test]
    fn places_are_those_of_proj_or_refused_by_name() {
        let (mut refused, mut wrong, mut checked, mut worst) = (Vec::new(), Vec::new(), 0, 0.0_f64);
        for row in oracle() {
            let code = row["epsg"].as_u64().expect("code") as u32;
            let crs = crate::crs::of_code(CrsKind::Projected, code);
            let projection = match Projection::on_own_datum(&crs) {
                Ok(projection) => projection,
                Err(error) => {
                    refused.push(format!("{error}"));
                    continue;
                }
            };
            for point in row["points"].as_array().expect("points") {
                let [lon, lat, x, y] = [0, 1, 2, 3].map(|i: usize| point[i].as_f64().expect("number"));
                let (there, back) = (projection.from_lonlat(lon, lat), projection.to_lonlat(x, y));
                let (Some(there), Some(back)) = (there, back) else {
                    wrong.push(format!("EPSG:{code} has no place {lon} {lat}: {there:?} {back:?}"));
                    continue;
                };
                let off = (there.0 - x).abs().max((there.1 - y).abs()) * crs.unit;
                let round = ((back.0 - lon + 180.0).rem_euclid(360.0) - 180.0) * lat.to_radians().cos();
                let degrees = round.abs().max((back.1 - lat).abs());
                worst = worst.max(degrees);
                checked += 1;
                if off > 0.002 || degrees > 2e-8 {
                    wrong.push(format!("EPSG:{code} at {lon} {lat}: off by {off} m, {degrees} degrees"));
                }
            }
        }
        assert!(wrong.is_empty(), "{}\nrefused: {}", wrong.join("\n"), refused.join("\n"));
        assert!(
            checked >= 300 && refused.len() * 6 < checked,
            "{checked} checked, refused: {}",
            refused.join("\n")
        );
        println!("{checked} places, worst {worst} degrees; refused: {}", refused.join("\n"));
    }

    #[test]
    fn datums_that_are_not_wgs_84_are_refused_by_name() {
        for (text, datum) in
            [("EPSG:27700", "Ordnance Survey"), ("EPSG:21781", "CH1903"), ("EPSG:4267", "1927")]
        {
            let crs = crate::crs::read(text).expect(text);
            let error = Projection::of(&crs).err().expect("refused").to_string();
            assert!(error.contains(datum), "{error}");
            assert!(Projection::on_own_datum(&crs).is_ok());
        }
        for (text, metres) in
            [("EPSG:32613", 2.0), ("EPSG:3035", 1.0), ("EPSG:26913", 4.0), ("EPSG:7855", 3.0)]
        {
            let found = Projection::of(&crate::crs::read(text).expect(text)).expect(text);
            assert_eq!(found.within(), Some(metres), "{text}");
        }
        assert!(Projection::of(&Crs::default()).is_err());
    }

    #[test]
    fn between_systems_of_one_datum_whatever_it_is() {
        let [grid, own, wgs] =
            ["EPSG:27700", "EPSG:4277", "EPSG:4326"].map(|text| crate::crs::read(text).expect(text));
        let between = Between::new(&own, &grid).expect("one datum");
        let (x, y) = between.convert(-2.0, 49.0).expect("origin");
        assert!((x - 400_000.0).abs() < 1e-3 && (y + 100_000.0).abs() < 1e-3, "{x} {y}");
        assert!(Between::new(&wgs, &grid).is_err() && Between::new(&grid, &wgs).is_err());
    }

    /// Parameters of all methods, and points, from the middle of their ranges to their ends.
    #[test]
    fn no_parameters_and_no_points_panic() {
        let numbers = [-90.0, -89.999, -60.0, -1.0, 0.0, 1e-9, 30.0, 45.0, 60.0, 89.999, 90.0];
        let mut seed = 1_u64;
        let mut next = |count: usize| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 33) as usize % count
        };
        let codes = [
            32613, 2154, 5070, 3035, 3031, 3413, 2056, 3078, 29873, 3857, 3395, 28992, 6933, 4087, 29101,
            3106, 8857,
        ];
        for round in 0..4000 {
            let code = codes[round % codes.len()];
            let mut definition = Definition::of_kind(CrsKind::Projected, code).expect("code");
            let conversion = definition.conversion.as_mut().expect("projected");
            for (key, value) in &mut conversion.parameters {
                match key.as_ref() {
                    "k_0" => *value = [0.01, 0.9996, 1.0, 2.0][next(4)],
                    "x_0" | "y_0" => *value = [0.0, 5e5, -1e9][next(3)],
                    _ => *value = numbers[next(numbers.len())],
                }
            }
            let base = definition.base.clone().expect("base");
            let Some(plane) = plane(&definition, &base) else { continue };
            let projection = Projection { base, within: None, unit: 1.0, plane: Some(plane) };
            for _ in 0..10 {
                let (lon, lat) = (2.0 * numbers[next(numbers.len())], numbers[next(numbers.len())]);
                if let Some((x, y)) = projection.from_lonlat(lon, lat) {
                    let _ = projection.to_lonlat(x, y);
                }
                let far = [0.0, 1.0, -1e6, 1e7, 1e12, 1e300, f64::MIN_POSITIVE];
                let _ = projection.to_lonlat(far[next(7)], far[next(7)]);
            }
        }
    }

    #[test]
    fn what_lies_outside_of_a_projection_is_no_place() {
        let utm = Projection::of(&crate::crs::read("EPSG:32613").expect("code")).expect("UTM");
        assert!(utm.to_lonlat(500_000.0, 4_400_000.0).is_some());
        for (x, y) in [(1e9, 0.0), (5e5, 1e9), (f64::NAN, 0.0), (f64::INFINITY, 1.0)] {
            assert_eq!(utm.to_lonlat(x, y), None);
        }
        let degrees = Projection::of(&crate::crs::read("EPSG:4326").expect("code")).expect("degrees");
        assert_eq!(degrees.to_lonlat(5.0, 91.0), None);
    }
}
