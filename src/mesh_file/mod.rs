//! Mesh files, read.

use std::path::Path;

use serde_json::Value;

use crate::error::{Error, Result};

/// A triangle mesh in memory; z is up, and triangles are counter-clockwise seen from above.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Places of the vertices.
    pub vertices: Vec<[f64; 3]>,
    /// Numbers of the corners of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// What the file says of itself; null if nothing.
    pub about: Value,
}

/// The axis that is up in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Up {
    /// The second.
    Y,
    /// The third.
    Z,
}

/// Reads a mesh: an ASCII PLY of vertices `x y z` and triangles.
pub fn read(path: &Path, up: Option<Up>) -> Result<Mesh> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::io(path, "read", source))?;
    parse(&text, up == Some(Up::Y)).map_err(|error| error.at(path))
}

fn parse(text: &str, is_y_up: bool) -> Result<Mesh> {
    let wrong = |what: &str| Error::format(what, "an ASCII PLY", "something else");
    let (head, body) = text.split_once("end_header\n").ok_or_else(|| wrong("header"))?;
    let number =
        |name: &str| head.lines().find_map(|line| line.strip_prefix(name)?.trim().parse::<usize>().ok());
    let (vertices, triangles) =
        number("element vertex").zip(number("element face")).ok_or_else(|| wrong("header"))?;
    let about = head.lines().find_map(|line| line.strip_prefix("comment relevo "));
    let about = about.and_then(|about| serde_json::from_str(about).ok()).unwrap_or_default();
    let mut lines = body.lines().map(|line| line.split_whitespace().collect::<Vec<_>>());
    let mut mesh = Mesh { about, ..Mesh::default() };
    for words in lines.by_ref().take(vertices) {
        let numbers: Vec<f64> = words.iter().filter_map(|word| word.parse().ok()).collect();
        let &[x, y, z] = numbers.as_slice() else { return Err(wrong("a vertex")) };
        mesh.vertices.push(if is_y_up { [x, -z, y] } else { [x, y, z] });
    }
    for words in lines.take(triangles) {
        let numbers: Vec<u32> = words.iter().filter_map(|word| word.parse().ok()).collect();
        let &[3, a, b, c] = numbers.as_slice() else { return Err(wrong("a triangle")) };
        mesh.triangles.push([a, b, c]);
    }
    Ok(mesh)
}
