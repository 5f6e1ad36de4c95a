//! OBJ: lines of text, of which vertices and faces count.

use super::{Building, number, shown};
use crate::error::{Error, Result};

/// The mesh of an OBJ file.
pub(super) fn read(bytes: &[u8]) -> Result<Building> {
    let mut building = Building::default();
    let mut corners = Vec::new();
    let mut lines = bytes.split(|&byte| byte == b'\n').enumerate();
    while let Some((i, first)) = lines.next() {
        let place = || super::line(i + 1);
        let mut joined = Vec::new();
        let mut text = first.trim_ascii_end();
        // A line goes on behind a backslash.
        while let Some(start) = text.strip_suffix(b"\\") {
            joined.extend([start, b" "].concat());
            text = lines.next().map_or(&b""[..], |(_, next)| next.trim_ascii_end());
        }
        joined.extend(text);
        let mut words = joined.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        match words.next() {
            Some(b"v") => {
                let mut point = [0.0; 3];
                for value in &mut point {
                    *value = number(words.next().unwrap_or_default(), place)?;
                }
                // A weight or a colour may follow.
                building.vertex(point, place)?;
            }
            Some(b"f") => {
                corners.clear();
                for word in words.take_while(|word| !word.starts_with(b"#")) {
                    corners.push(corner(word, building.count(), place)?);
                }
                building.polygon(&corners, place)?;
            }
            Some(b"#") if building.mesh.about.is_null() => {
                let about =
                    joined.strip_prefix(b"# relevo ").and_then(|text| serde_json::from_slice(text).ok());
                building.mesh.about = about.unwrap_or_default();
            }
            _ => {}
        }
    }
    building.check()?;
    Ok(building)
}

/// The vertex of a corner `v`, `v/t`, `v//n` or `v/t/n`, counted from 0; negative numbers count
/// back from the last vertex so far.
fn corner(word: &[u8], count: u64, place: impl Fn() -> String) -> Result<u64> {
    let vertex = word.split(|&byte| byte == b'/').next().unwrap_or_default();
    let index = std::str::from_utf8(vertex).ok().and_then(|text| text.parse::<i64>().ok());
    let found = match index {
        Some(index) if index > 0 => Some(index as u64 - 1),
        Some(index) if index < 0 => count.checked_sub(index.unsigned_abs()),
        _ => None,
    };
    found.ok_or_else(|| Error::format(place(), "the number of a vertex", shown(word)))
}
