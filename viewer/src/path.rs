//! Camera paths: read from and written to JSON, and interpolated between their keys.
//!
//! ```json
//! {
//!   "fov": 50,
//!   "keys": [
//!     { "time": 0, "eye": [600, 1500, 9000], "target": [600, 600, 1500] },
//!     { "time": 4, "eye": [600, 900, 3000], "target": [620, 500, 1500] },
//!     { "time": 9, "world": [-121.7, 46.9, 4000], "target": [-121.76, 46.85, 3000] }
//!   ]
//! }
//! ```
//!
//! `fov` is the vertical field of view in degrees (50 if it is not there). A key has its `time` in
//! seconds, later than that of the key before, and either `eye` (column, row, height in metres) or
//! `world` (x and y in the file's coordinate system, height in metres); its `target` is in the same
//! terms. Exaggeration raises the target with the terrain, and the eye by as much. Between keys eye
//! and target follow a smooth curve through all keys; a path of one key is a still picture.

use std::path::Path;

use relevo_core::geo::Geo;
use relevo_core::{Error, Result};
use serde_json::{Map, Value, json};

use crate::camera::{FOV, Pose};

/// A pose at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Time in seconds.
    pub time: f64,
    /// The pose at that time.
    pub pose: Pose,
}

/// A camera path: at least one key, times rising.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPath {
    /// Vertical field of view, degrees.
    pub fov: f64,
    keys: Vec<Key>,
}

impl CameraPath {
    /// Returns a path of these keys. Fails if there is none, or if times do not rise.
    pub fn new(fov: f64, keys: Vec<Key>) -> Result<Self> {
        if keys.is_empty() {
            return Err(Error::usage("keys: a camera path needs at least one"));
        }
        if let Some(at) = keys.windows(2).position(|pair| pair[1].time <= pair[0].time) {
            let (before, after) = (keys[at].time, keys[at + 1].time);
            let what =
                format!("keys[{}].time: {after} is not later than the {before} of the key before", at + 1);
            return Err(Error::usage(what));
        }
        Ok(Self { fov, keys })
    }

    /// Reads a file; errors name the file and the field.
    pub fn read(path: &Path, geo: &Geo) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|error| Error::io(path, "read", error))?;
        Self::parse(&text, geo).map_err(|error| Error::usage(format!("{}: {error}", path.display())))
    }

    /// Parses a JSON text; errors name the field.
    pub fn parse(text: &str, geo: &Geo) -> Result<Self> {
        let json: Value =
            serde_json::from_str(text).map_err(|error| Error::usage(format!("not JSON: {error}")))?;
        let Value::Object(all) = json else { return Err(Error::usage("expected an object with \"keys\"")) };
        check_fields(&all, "", &["fov", "keys"])?;
        let fov = all.get("fov").map_or(Ok(FOV), |fov| number(fov, "fov"))?;
        if !(1.0..=170.0).contains(&fov) {
            return Err(Error::usage(format!("fov: expected 1 to 170 degrees, got {fov}")));
        }
        let keys = all.get("keys").and_then(Value::as_array);
        let keys = keys.ok_or_else(|| Error::usage("keys: expected a list of keys"))?;
        let keys = keys.iter().enumerate().map(|(index, key)| parse_key(key, index, geo));
        Self::new(fov, keys.collect::<Result<_>>()?)
    }

    /// Returns the path as JSON that [`CameraPath::parse`] reads, with eyes and targets on the
    /// lattice.
    pub fn json(&self) -> String {
        let keys = self
            .keys
            .iter()
            .map(|key| json!({ "time": key.time, "eye": key.pose.eye, "target": key.pose.target }));
        let lines: Vec<String> = keys.map(|key| format!("    {key}")).collect();
        format!("{{\n  \"fov\": {},\n  \"keys\": [\n{}\n  ]\n}}\n", self.fov, lines.join(",\n"))
    }

    /// Writes the path to a new file.
    pub fn write(&self, path: &Path) -> Result<()> {
        relevo_core::output::write(path, self.json().as_bytes(), false)
    }

    /// Returns the keys.
    pub fn keys(&self) -> &[Key] {
        &self.keys
    }

    /// Returns the times of the first and the last key.
    pub fn span(&self) -> (f64, f64) {
        let time = |key: Option<&Key>| key.map_or(0.0, |key| key.time);
        (time(self.keys.first()), time(self.keys.last()))
    }

    /// Returns the pose at a time; before the first key that of the first, after the last key that
    /// of the last.
    pub fn at(&self, time: f64) -> Pose {
        let next = self.keys.partition_point(|key| key.time <= time);
        if next == 0 || next == self.keys.len() {
            return self.keys[next.saturating_sub(1).min(self.keys.len() - 1)].pose;
        }
        let (a, b) = (&self.keys[next - 1], &self.keys[next]);
        let before = next.checked_sub(2).map(|index| &self.keys[index]);
        let curve = Curve { a, b, before, after: self.keys.get(next + 1) };
        Pose { eye: curve.at(time, |pose| pose.eye), target: curve.at(time, |pose| pose.target) }
    }
}

/// The part of a path between two keys, with their neighbours.
struct Curve<'a> {
    a: &'a Key,
    b: &'a Key,
    before: Option<&'a Key>,
    after: Option<&'a Key>,
}

impl Curve<'_> {
    /// Returns a point of the cubic Hermite curve. The slope at a key is that of the line between
    /// its neighbours, 0 at the ends of the path.
    fn at(&self, time: f64, of: impl Fn(&Pose) -> [f64; 3]) -> [f64; 3] {
        let length = self.b.time - self.a.time;
        let t = (time - self.a.time) / length;
        let (a, b) = (of(&self.a.pose), of(&self.b.pose));
        let slope = |from: Option<&Key>, to: Option<&Key>| -> [f64; 3] {
            let (Some(from), Some(to)) = (from, to) else { return [0.0; 3] };
            let (p, q) = (of(&from.pose), of(&to.pose));
            std::array::from_fn(|i| (q[i] - p[i]) / (to.time - from.time) * length)
        };
        let (u, v) = (slope(self.before, Some(self.b)), slope(Some(self.a), self.after));
        let (t2, t3) = (t * t, t * t * t);
        std::array::from_fn(|i| {
            let smooth = 3.0 * t2 - 2.0 * t3;
            a[i] + (b[i] - a[i]) * smooth + u[i] * (t3 - 2.0 * t2 + t) + v[i] * (t3 - t2)
        })
    }
}

fn parse_key(key: &Value, index: usize, geo: &Geo) -> Result<Key> {
    let place = format!("keys[{index}]");
    let key = key.as_object().ok_or_else(|| Error::usage(format!("{place}: expected an object")))?;
    check_fields(key, &format!("{place}."), &["time", "eye", "world", "target"])?;
    let field = |name: &str| key.get(name).map(|value| (value, format!("{place}.{name}")));
    let need = |name: &str| field(name).ok_or_else(|| Error::usage(format!("{place}.{name}: it is missing")));
    let (time, named) = need("time")?;
    let time = number(time, &named)?;
    let (target, target_name) = need("target")?;
    let target = triple(target, &target_name)?;
    let pose = match (field("eye"), field("world")) {
        (Some((eye, name)), None) => Pose { eye: triple(eye, &name)?, target },
        (None, Some((eye, name))) => {
            let lattice = |[x, y, height]: [f64; 3], name: &str| {
                let there = geo.sample_from_world(x, y).map(|(column, row)| [column, row, height]);
                there.ok_or_else(|| {
                    Error::usage(format!("{name}: the file has no usable georeference; use eye"))
                })
            };
            Pose { eye: lattice(triple(eye, &name)?, &name)?, target: lattice(target, &target_name)? }
        }
        (None, None) => return Err(Error::usage(format!("{place}.eye: it is missing (or give world)"))),
        (Some(_), Some(_)) => {
            return Err(Error::usage(format!("{place}: eye and world exclude one another")));
        }
    };
    if pose.eye == pose.target {
        return Err(Error::usage(format!("{target_name}: it is where the eye is")));
    }
    Ok(Key { time, pose })
}

/// Fails on a field that is not among `names`, so that a misspelt field is not ignored.
fn check_fields(object: &Map<String, Value>, place: &str, names: &[&str]) -> Result<()> {
    let Some(other) = object.keys().find(|key| !names.contains(&key.as_str())) else { return Ok(()) };
    Err(Error::usage(format!("{place}{other}: no such field; there are {}", names.join(", "))))
}

fn number(value: &Value, name: &str) -> Result<f64> {
    let number = value.as_f64().filter(|number| number.is_finite());
    number.ok_or_else(|| Error::usage(format!("{name}: expected a number, got {value}")))
}

fn triple(value: &Value, name: &str) -> Result<[f64; 3]> {
    let bad = || Error::usage(format!("{name}: expected three numbers, got {value}"));
    let list = value.as_array().filter(|list| list.len() == 3).ok_or_else(bad)?;
    let mut out = [0.0; 3];
    for (index, (out, value)) in out.iter_mut().zip(list).enumerate() {
        *out = number(value, &format!("{name}[{index}]"))?;
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn geo() -> Geo {
        Geo { transform: Some([1000.0, 2.0, 0.0, 5000.0, 0.0, -2.0]), ..Geo::default() }
    }

    #[test]
    fn a_path_goes_through_its_keys_and_comes_back_from_json() {
        let text = r#"{ "fov": 40, "keys": [
            { "time": 1, "eye": [0, 0, 100], "target": [10, 10, 0] },
            { "time": 3, "eye": [10, 0, 50], "target": [20, 10, 0] },
            { "time": 4, "world": [1041, 4959, 20], "target": [1061, 4959, 0] } ] }"#;
        let path = CameraPath::parse(text, &geo()).unwrap();
        assert_eq!((path.span(), path.fov), ((1.0, 4.0), 40.0));
        assert_eq!(path.keys()[2].pose, Pose { eye: [20.0, 20.0, 20.0], target: [30.0, 20.0, 0.0] });
        for key in path.keys() {
            assert_eq!(path.at(key.time), key.pose);
        }
        assert_eq!(path.at(-5.0), path.keys()[0].pose);
        assert_eq!(path.at(9.0), path.keys()[2].pose);
        let (before, after) = (path.at(3.0 - 1e-6).eye, path.at(3.0 + 1e-6).eye);
        assert!((0..3).all(|i| (before[i] - after[i]).abs() < 1e-3), "smooth through a key");
        assert_eq!(CameraPath::parse(&path.json(), &Geo::default()).unwrap(), path);
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("path.json");
        path.write(&file).unwrap();
        assert_eq!(CameraPath::read(&file, &geo()).unwrap(), path);
    }

    #[test]
    fn errors_name_the_field() {
        let key = r#"{ "time": 0, "eye": [0, 0, 9], "target": [1, 1, 1] }"#;
        for (text, says) in [
            ("{", "not JSON"),
            ("[]", "object"),
            (r#"{ "keys": [] }"#, "keys: a camera path needs at least one"),
            (r#"{ "keyes": [] }"#, "keyes: no such field"),
            (r#"{ "fov": 300, "keys": [] }"#, "fov: expected 1 to 170"),
            (r#"{ "keys": [{ "eye": [0, 0, 0], "target": [1, 1, 1] }] }"#, "keys[0].time: it is missing"),
            (r#"{ "keys": [{ "time": 0, "target": [1, 1, 1] }] }"#, "keys[0].eye: it is missing"),
            (
                r#"{ "keys": [{ "time": 0, "eye": [1, 1], "target": [1, 1, 1] }] }"#,
                "keys[0].eye: expected three",
            ),
            (
                r#"{ "keys": [{ "time": 0, "eye": [1, 1, "a"], "target": [1, 1, 1] }] }"#,
                "keys[0].eye[2]: expected",
            ),
            (r#"{ "keys": [{ "time": 0, "eye": [1, 1, 1], "target": [1, 1, 1] }] }"#, "where the eye is"),
            (
                r#"{ "keys": [{ "time": 0, "eye": [1, 1, 1], "look": [1, 1, 1] }] }"#,
                "keys[0].look: no such field",
            ),
            (&format!(r#"{{ "keys": [{key}, {key}] }}"#), "keys[1].time: 0 is not later"),
        ] {
            let error = CameraPath::parse(text, &geo()).unwrap_err().to_string();
            assert!(error.contains(says), "{error:?} does not say {says:?}");
        }
        let missing = CameraPath::read(Path::new("no/such/path.json"), &geo()).unwrap_err().to_string();
        assert!(missing.contains("path.json"), "{missing}");
    }
}
