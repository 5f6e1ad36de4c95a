//! Reads mesh files that anyone made.
//!
//! A file is read whole. Every number in it is checked before it is used; memory is at most a
//! multiple of the file's length, whatever it says.

mod accessor;
mod glb;
mod mesh;
mod nodes;
mod obj;
mod ply;
mod ply_header;
mod stl;

use std::path::Path;

use super::{Format, Mesh, Up};
use crate::error::{Error, Result};
use mesh::Building;

/// Bytes of a file, at most.
const MOST: u64 = 1 << 40;

/// The mesh of a file, by the ending of its name. `up` says which axis is up in it; by default Y in
/// a GLB, Z in others.
///
/// Polygons are cut into triangles as a fan around their first corner. Of STL, equal corners are
/// one vertex. Of GLB, all nodes of the default scene are put in place.
///
/// # Errors
/// [`Error::Usage`] for another ending, [`Error::Io`], and [`Error::Format`] or
/// [`Error::Unsupported`] with the place in the file.
pub fn read(path: &Path, up: Option<Up>) -> Result<Mesh> {
    let format = Format::of(path)?;
    let bytes = crate::file::read(path, MOST).map_err(|error| Error::io(path, "read", error))?;
    of_bytes(&bytes, format, up).map_err(|error| error.at(path))
}

/// The mesh of the bytes of a file.
fn of_bytes(bytes: &[u8], format: Format, up: Option<Up>) -> Result<Mesh> {
    let building = match format {
        Format::Glb => glb::read(bytes)?,
        Format::Obj => obj::read(bytes)?,
        Format::Ply => ply::read(bytes)?,
        Format::Stl => stl::read(bytes)?,
    };
    Ok(building.finish(up.unwrap_or(format.up())))
}

/// Where in a text something is.
fn line(number: usize) -> String {
    format!("line {number}")
}

/// A text that a message shows: its start.
fn shown(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(40)]).into_owned();
    if text.is_empty() { "nothing".to_owned() } else { format!("\"{text}\"") }
}

/// The number of a word.
fn number(word: &[u8], place: impl Fn() -> String) -> Result<f64> {
    let value = std::str::from_utf8(word).ok().and_then(|word| word.parse::<f64>().ok());
    value.ok_or_else(|| Error::format(place(), "a number", shown(word)))
}
