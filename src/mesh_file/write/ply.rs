//! PLY: a header of text, then vertices and triangles in binary.

use std::path::PathBuf;

use super::part::Part;
use super::text::{ascii, ascii_json};
use super::{Body, Content, Up, Vertex};
use crate::error::Result;
use crate::mesh_file::names;
use crate::output::NewFile;

/// Bytes of a triangle: the count 3, and its vertices.
const TRIANGLE: u64 = 13;

pub(super) struct Ply {
    file: NewFile,
    picture: Option<NewFile>,
    part: Part,
}

/// The header; the name is that of the picture.
fn header(content: &Content, picture: &str) -> String {
    let mut lines = vec!["ply".to_owned(), "format binary_little_endian 1.0".to_owned()];
    lines.push(format!("comment {}", ascii(&content.generator)));
    lines.push(format!("comment {} is up", if content.up == Up::Y { "y" } else { "z" }));
    if !content.about.is_null() {
        lines.push(format!("comment relevo {}", ascii_json(&content.about)));
    }
    if content.picture.is_some() {
        lines.push(format!("comment TextureFile {picture}"));
    }
    lines.push(format!("element vertex {}", content.vertices));
    let mut properties = |of: &str, names: &[&str]| {
        lines.extend(names.iter().map(|name| format!("property {of} {name}")));
    };
    properties("double", &["x", "y", "z"]);
    if content.has_normals {
        properties("float", &["nx", "ny", "nz"]);
    }
    if content.has_errors {
        properties("float", &["error"]);
        properties("uchar", &["level"]);
    }
    if content.picture.is_some() {
        properties("float", &["s", "t"]);
    }
    lines.push(format!("element face {}", content.triangles));
    lines.push("property list uchar int vertex_indices".to_owned());
    lines.push("end_header\n".to_owned());
    lines.join("\n")
}

/// Bytes of a vertex.
fn stride(content: &Content) -> u64 {
    let of = |has: bool, bytes: u64| if has { bytes } else { 0 };
    24 + of(content.has_normals, 12) + of(content.has_errors, 5) + of(content.picture.is_some(), 8)
}

/// Bytes of the file; the name of a picture is not known yet, and not counted.
pub(super) fn size(content: &Content) -> u64 {
    let header = header(content, "").len() as u64;
    header + content.vertices * stride(content) + content.triangles * TRIANGLE
}

impl Ply {
    pub(super) fn create(path: PathBuf, content: &Content, force: bool) -> Result<Self> {
        let (mut picture, mut name) = (None, String::new());
        if let Some(there) = &content.picture {
            name = names::picture_name(&path, there.ending());
            let mut file = NewFile::create(path.with_file_name(&name), force)?;
            file.put(&there.bytes)?;
            picture = Some(file);
        }
        let mut part = Part::default();
        part.bytes().extend(header(content, &name).as_bytes());
        Ok(Self { file: NewFile::create(path, force)?, picture, part })
    }
}

impl Body for Ply {
    fn stored(&self, content: &Content, place: [f64; 3]) -> [f64; 3] {
        content.map.apply(place)
    }

    fn vertices(&mut self, content: &Content, vertices: &[Vertex]) -> Result<()> {
        for vertex in vertices {
            let bytes = self.part.bytes();
            let point = content.up.in_file(content.map.apply(vertex.place));
            bytes.extend(point.iter().flat_map(|value| value.to_le_bytes()));
            if content.has_normals {
                let normal = content.up.in_file(vertex.normal.map(f64::from));
                bytes.extend(normal.iter().flat_map(|value| (*value as f32).to_le_bytes()));
            }
            if content.has_errors {
                bytes.extend(vertex.error.to_le_bytes());
                bytes.push(vertex.level);
            }
            if let Some(picture) = &content.picture {
                let [u, v] = picture.at(vertex.place);
                // The origin of texture coordinates is the lower left corner here.
                bytes.extend([u, 1.0 - v].iter().flat_map(|value| (*value as f32).to_le_bytes()));
            }
            self.part.check(&mut self.file)?;
        }
        Ok(())
    }

    fn triangles(&mut self, triangles: &[[u32; 3]]) -> Result<()> {
        for triangle in triangles {
            let bytes = self.part.bytes();
            bytes.push(3);
            bytes.extend(triangle.iter().flat_map(|index| index.to_le_bytes()));
            self.part.check(&mut self.file)?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>, _: &Content) -> Result<u64> {
        self.part.flush(&mut self.file)?;
        if let Some(picture) = self.picture {
            picture.commit()?;
        }
        self.file.commit()?;
        Ok(self.part.position())
    }
}
