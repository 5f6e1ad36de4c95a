//! OBJ: lines of text, with a material file and a picture beside it.

use std::io::Write as _;
use std::path::PathBuf;

use super::part::Part;
use super::text::{ascii, ascii_json};
use super::{Body, Content, Up, Vertex};
use crate::error::Result;
use crate::mesh_file::names;
use crate::output::NewFile;

/// Characters of a coordinate, at most, in the size that is told.
const NUMBER: u64 = 24;

pub(super) struct Obj {
    file: NewFile,
    /// Picture and material.
    beside: Vec<NewFile>,
    part: Part,
    has_normals: bool,
    has_picture: bool,
}

/// The lines before the first vertex.
fn header(content: &Content, material: &str) -> String {
    let up = if content.up == Up::Y { "y" } else { "z" };
    let mut text = format!("# {}\n# {up} is up, metres\n", ascii(&content.generator));
    if !content.about.is_null() {
        text += &["# relevo ", &ascii_json(&content.about), "\n"].concat();
    }
    if content.picture.is_some() {
        text += &["mtllib ", material, "\nusemtl terrain\n"].concat();
    }
    text
}

/// Bytes of the file, estimated from above.
pub(super) fn size(content: &Content) -> u64 {
    let digits = content.vertices.to_string().len() as u64;
    let of = |has: bool, bytes: u64| if has { bytes } else { 0 };
    let (normals, picture) = (content.has_normals, content.picture.is_some());
    let vertex = 2 + 3 * (NUMBER + 1) + of(normals, 3 + 3 * (NUMBER + 1)) + of(picture, 3 + 2 * (NUMBER + 1));
    // A corner is `7`, `7/7`, `7//7` or `7/7/7`.
    let corner = 1 + digits + of(normals, digits + 1) + of(picture, digits + 1) + of(normals && !picture, 1);
    header(content, "").len() as u64 + content.vertices * vertex + content.triangles * (2 + 3 * corner)
}

/// A material that shows a picture.
fn material(picture: &str) -> String {
    format!("newmtl terrain\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {picture}\n")
}

impl Obj {
    pub(super) fn create(path: PathBuf, content: &Content, force: bool) -> Result<Self> {
        let mut beside = Vec::new();
        let name = names::material_name(&path);
        if let Some(there) = &content.picture {
            let picture = names::picture_name(&path, there.ending());
            let files = [(&picture, there.bytes.as_slice()), (&name, material(&picture).as_bytes())]
                .map(|(name, bytes)| (path.with_file_name(name), bytes.to_vec()));
            for (path, bytes) in files {
                let mut file = NewFile::create(path, force)?;
                file.put(&bytes)?;
                beside.push(file);
            }
        }
        let mut part = Part::default();
        part.bytes().extend(header(content, &name).as_bytes());
        let (has_normals, has_picture) = (content.has_normals, content.picture.is_some());
        Ok(Self { file: NewFile::create(path, force)?, beside, part, has_normals, has_picture })
    }
}

impl Body for Obj {
    fn stored(&self, content: &Content, place: [f64; 3]) -> [f64; 3] {
        content.map.apply(place)
    }

    fn vertices(&mut self, content: &Content, vertices: &[Vertex]) -> Result<()> {
        for vertex in vertices {
            let out = self.part.bytes();
            let [x, y, z] = content.up.in_file(content.map.apply(vertex.place));
            // Writing to memory does not fail. The shortest decimals that read back.
            let _ = writeln!(out, "v {x} {y} {z}");
            if let Some(picture) = &content.picture {
                let [u, v] = picture.at(vertex.place);
                // The origin of texture coordinates is the lower left corner here.
                let _ = writeln!(out, "vt {} {}", u as f32, (1.0 - v) as f32);
            }
            if content.has_normals {
                let [x, y, z] = content.up.in_file(vertex.normal.map(f64::from)).map(|v| v as f32);
                let _ = writeln!(out, "vn {x} {y} {z}");
            }
            self.part.check(&mut self.file)?;
        }
        Ok(())
    }

    fn triangles(&mut self, triangles: &[[u32; 3]]) -> Result<()> {
        for triangle in triangles {
            let out = self.part.bytes();
            let [a, b, c] = triangle.map(|index| u64::from(index) + 1);
            let _ = match (self.has_picture, self.has_normals) {
                (false, false) => writeln!(out, "f {a} {b} {c}"),
                (true, false) => writeln!(out, "f {a}/{a} {b}/{b} {c}/{c}"),
                (false, true) => writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}"),
                (true, true) => writeln!(out, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}"),
            };
            self.part.check(&mut self.file)?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>, _: &Content) -> Result<u64> {
        self.part.flush(&mut self.file)?;
        for file in self.beside {
            file.commit()?;
        }
        self.file.commit()?;
        Ok(self.part.position())
    }
}
