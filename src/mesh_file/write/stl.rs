//! STL: 80 bytes of text, a count, and triangles of 50 bytes, each with its normal and corners.

use std::path::PathBuf;

use super::part::Part;
use super::text::ascii;
use super::{Body, Content, Vertex};
use crate::error::{Error, Result};
use crate::output::NewFile;

const HEADER: usize = 80;
const TRIANGLE: u64 = 50;

pub(super) struct Stl {
    file: NewFile,
    part: Part,
    /// Coordinates of all vertices as they are in the file.
    points: Vec<[f32; 3]>,
}

/// The text: as many of the plain values that the file has to say as fit. It does not begin with
/// `solid`, which is how a reader knows the STL of text.
fn header(content: &Content) -> [u8; HEADER] {
    let mut text = "relevo".to_owned();
    for (key, value) in content.about.as_object().into_iter().flatten() {
        let value = match value {
            serde_json::Value::String(text) => text.clone(),
            serde_json::Value::Number(_) | serde_json::Value::Bool(_) => value.to_string(),
            _ => continue,
        };
        let more = ascii(&format!(" {key}={value}"));
        if text.len() + more.len() <= HEADER {
            text.push_str(&more);
        }
    }
    let mut bytes = [0; HEADER];
    bytes[..text.len()].copy_from_slice(text.as_bytes());
    bytes
}

/// Bytes of the file.
pub(super) fn size(content: &Content) -> u64 {
    HEADER as u64 + 4 + content.triangles * TRIANGLE
}

/// The unit normal of a triangle; zeros if it has none.
fn normal([a, b, c]: [[f32; 3]; 3]) -> [f32; 3] {
    let to = |p: [f32; 3]| [0, 1, 2].map(|i| f64::from(p[i]) - f64::from(a[i]));
    let (u, v) = (to(b), to(c));
    let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    let length = cross.iter().map(|x| x * x).sum::<f64>().sqrt();
    let is_sound = length > 0.0 && length.is_finite();
    cross.map(|x| if is_sound { (x / length) as f32 } else { 0.0 })
}

impl Stl {
    pub(super) fn create(path: PathBuf, content: &Content, force: bool) -> Result<Self> {
        let mut points = Vec::new();
        let room = points.try_reserve_exact(content.vertices as usize);
        room.map_err(|_| {
            Error::out_of_memory("the vertices of an STL file", content.vertices * 12).at(&path)
        })?;
        let mut part = Part::default();
        part.bytes().extend(header(content));
        part.bytes().extend((content.triangles as u32).to_le_bytes());
        Ok(Self { file: NewFile::create(path, force)?, part, points })
    }
}

/// Coordinates in the file.
fn kept(content: &Content, place: [f64; 3]) -> [f32; 3] {
    content.up.in_file(content.map.apply(place)).map(|value| value as f32)
}

impl Body for Stl {
    fn stored(&self, content: &Content, place: [f64; 3]) -> [f64; 3] {
        content.up.to_z_up(kept(content, place).map(f64::from))
    }

    fn vertices(&mut self, content: &Content, vertices: &[Vertex]) -> Result<()> {
        self.points.extend(vertices.iter().map(|vertex| kept(content, vertex.place)));
        Ok(())
    }

    fn triangles(&mut self, triangles: &[[u32; 3]]) -> Result<()> {
        for triangle in triangles {
            let corners = triangle.map(|index| self.points[index as usize]);
            let bytes = self.part.bytes();
            let numbers = normal(corners).into_iter().chain(corners.into_iter().flatten());
            bytes.extend(numbers.flat_map(f32::to_le_bytes));
            bytes.extend([0, 0]);
            self.part.check(&mut self.file)?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>, _: &Content) -> Result<u64> {
        self.part.flush(&mut self.file)?;
        self.file.commit()?;
        Ok(self.part.position())
    }
}
