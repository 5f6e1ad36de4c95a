//! GLB: a chunk of JSON and a chunk of bytes.

use serde_json::Value;

use super::accessor::{self, Bin};
use super::nodes::{self, Placed};
use super::{Building, shown};
use crate::error::{Error, Result};

/// Bytes of the mesh for each of the file, at most: nodes may repeat a mesh.
const GROWTH: u64 = 64;
/// Bytes of the mesh that any file may have.
const FREE: u64 = 1 << 16;
/// An extension that accessors take care of.
const KNOWN: &str = "KHR_mesh_quantization";

/// The mesh of a GLB file, with y up.
pub(super) fn read(bytes: &[u8]) -> Result<Building> {
    let (json, bin) = chunks(bytes)?;
    let root: Value = serde_json::from_slice(json)
        .map_err(|error| Error::format("the JSON of the GLB (from byte 20)", "JSON", error))?;
    refuse_extensions(&root)?;
    let mut building = Building::default();
    let most = FREE + GROWTH * bytes.len() as u64;
    for node in nodes::placed(&root)? {
        let path = format!("/meshes/{}/primitives", node.mesh);
        let primitives = root.pointer(&path).and_then(Value::as_array);
        let primitives = primitives.ok_or_else(|| Error::format(&path, "a list of primitives", "none"))?;
        for (i, primitive) in primitives.iter().enumerate() {
            let primitive = Primitive { root: &root, bin, json: primitive, path: format!("{path}/{i}") };
            primitive.add(&node, &mut building, most)?;
        }
    }
    building.check()?;
    building.mesh.about = root.pointer("/asset/extras").cloned().unwrap_or_default();
    Ok(building)
}

/// The chunk of JSON, and that of bytes, which may be missing.
fn chunks(bytes: &[u8]) -> Result<(&[u8], &[u8])> {
    let word = |at: usize| {
        let word = bytes.get(at..at.checked_add(4)?)?;
        Some(u32::from_le_bytes(word.try_into().ok()?))
    };
    if !bytes.starts_with(b"glTF") {
        return Err(Error::format("byte 0", "\"glTF\"", shown(&bytes[..bytes.len().min(4)])));
    }
    if word(4) != Some(2) {
        return Err(Error::format("byte 4", "version 2", format!("{:?}", word(4))));
    }
    if word(8).map(u64::from) != Some(bytes.len() as u64) {
        let said = word(8).map_or("nothing".to_owned(), |length| length.to_string());
        return Err(Error::format("byte 8", format!("the length of the file, {}", bytes.len()), said));
    }
    let (mut json, mut bin, mut at) = (None, &[][..], 12);
    while at < bytes.len() {
        let chunk = word(at).zip(word(at + 4));
        let body = chunk.and_then(|(length, _)| bytes.get(at + 8..)?.get(..length as usize));
        let (Some((length, kind)), Some(body)) = (chunk, body) else {
            return Err(Error::format(format!("byte {at}"), "a chunk that ends in the file", "a longer one"));
        };
        match (kind, json) {
            (0x4e4f_534a, None) => json = Some(body),
            (0x004e_4942, Some(_)) if bin.is_empty() => bin = body,
            _ => {}
        }
        at += 8 + length as usize;
    }
    let json = json.ok_or_else(|| Error::format("byte 12", "a chunk of JSON", "none"))?;
    Ok((json, bin))
}

/// Fails if the file needs an extension that is not known here.
fn refuse_extensions(root: &Value) -> Result<()> {
    let required = root.get("extensionsRequired").and_then(Value::as_array);
    // Of materials and pictures nothing is read.
    let is_shape = |name: &str| {
        name != KNOWN && !name.starts_with("KHR_materials_") && !name.starts_with("KHR_texture_")
    };
    match required.into_iter().flatten().filter_map(Value::as_str).find(|name| is_shape(name)) {
        Some(name) => Err(Error::unsupported(
            format!("the glTF extension {name}"),
            "save the file without compression and without extensions of the shape",
        )),
        None => Ok(()),
    }
}

/// A part of a mesh.
struct Primitive<'a> {
    root: &'a Value,
    bin: Bin<'a>,
    json: &'a Value,
    path: String,
}

impl Primitive<'_> {
    /// Adds it at the place of a node.
    fn add(&self, node: &Placed, building: &mut Building, most: u64) -> Result<()> {
        if self.json.pointer("/extensions/KHR_draco_mesh_compression").is_some() {
            return Err(Error::unsupported("Draco compression", "save the file without compression"));
        }
        let mode = self.json.get("mode").map_or(Some(4), Value::as_u64);
        // Points and lines are no surface.
        if mode.is_some_and(|mode| mode < 4) {
            return Ok(());
        }
        let mode = mode.filter(|mode| *mode <= 6);
        let mode = mode.ok_or_else(|| Error::format(format!("{}/mode", self.path), "0 to 6", "another"))?;
        let number = |path: &str| self.json.pointer(path).map(|value| value.as_u64().unwrap_or(u64::MAX));
        let positions = number("/attributes/POSITION");
        let positions =
            positions.ok_or_else(|| Error::format(&self.path, "an attribute POSITION", "none"))?;
        let positions = accessor::Accessor::of(self.root, self.bin, positions)?;
        let indices = number("/indices");
        let indices =
            indices.map(|indices| accessor::Accessor::of(self.root, self.bin, indices)).transpose()?;
        let corners = indices.as_ref().map_or(positions.count, |indices| indices.count);
        let mesh = &building.mesh;
        let held = mesh.vertices.len() as u64 * 24 + mesh.triangles.len() as u64 * 12;
        let bytes = held.saturating_add(positions.count * 24).saturating_add(corners.saturating_mul(12));
        if bytes > most {
            return Err(Error::limit("size in memory of the meshes of all nodes in bytes", bytes, most));
        }
        let first = building.count();
        for i in 0..positions.count {
            let point = node.map.apply(positions.position(i)?);
            building.vertex(point, || format!("{}, vertex {i}", self.path))?;
        }
        let corner = |i: u64| match &indices {
            None => Ok(i),
            Some(indices) => indices.index(i, positions.count),
        };
        if mode == 4 && !corners.is_multiple_of(3) {
            return Err(Error::format(&self.path, "corners of whole triangles", corners));
        }
        let count = if mode == 4 { corners / 3 } else { corners.saturating_sub(2) };
        for i in 0..count {
            let [a, b, c] = match mode {
                4 => [3 * i, 3 * i + 1, 3 * i + 2],
                5 => [i, i + 1 + i % 2, i + 2 - i % 2],
                _ => [i + 1, i + 2, 0],
            };
            let triangle = [first + corner(a)?, first + corner(b)?, first + corner(c)?];
            // Strips and fans repeat vertices to begin anew.
            if mode != 4
                && (triangle[0] == triangle[1] || triangle[1] == triangle[2] || triangle[0] == triangle[2])
            {
                continue;
            }
            let [a, b, c] = triangle;
            let turned = if node.map.determinant() < 0.0 { [a, c, b] } else { triangle };
            building.polygon(&turned, || self.path.clone())?;
        }
        Ok(())
    }
}
