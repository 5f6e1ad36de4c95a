//! STL, of bytes or of text. The size tells: the header of many binary ones begins with `solid`.

use std::collections::HashMap;

use super::{Building, number, shown};
use crate::error::{Error, Result};

const START: usize = 84;
const TRIANGLE: usize = 50;

/// The mesh of an STL file.
pub(super) fn read(bytes: &[u8]) -> Result<Building> {
    let count = bytes.get(80..START).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes);
    let expected = count.map(|count| START as u64 + u64::from(count) * TRIANGLE as u64);
    let mut corners = Corners::default();
    if expected == Some(bytes.len() as u64) {
        for (i, triangle) in bytes[START..].chunks_exact(TRIANGLE).enumerate() {
            corners.binary(triangle, START + i * TRIANGLE)?;
        }
        return Ok(corners.building);
    }
    if !bytes.trim_ascii_start().starts_with(b"solid") {
        let expected = expected.map_or("at least 84 bytes".to_owned(), |expected| {
            format!(
                "{expected} bytes for {} triangles, or a text that begins with \"solid\"",
                count.unwrap_or(0)
            )
        });
        return Err(Error::format("the size of the file", expected, format!("{} bytes", bytes.len())));
    }
    corners.text(bytes)?;
    Ok(corners.building)
}

/// Equal corners are one vertex.
#[derive(Default)]
struct Corners {
    building: Building,
    numbers: HashMap<[u64; 3], u64>,
}

impl Corners {
    fn corner(&mut self, point: [f64; 3], place: impl Fn() -> String) -> Result<u64> {
        let bits = point.map(f64::to_bits);
        if let Some(&number) = self.numbers.get(&bits) {
            return Ok(number);
        }
        self.building.vertex(point, place)?;
        let number = self.building.count() - 1;
        self.numbers.insert(bits, number);
        Ok(number)
    }

    fn binary(&mut self, triangle: &[u8], offset: usize) -> Result<()> {
        let mut corners = [0; 3];
        for (i, (corner, bytes)) in corners.iter_mut().zip(triangle[12..48].chunks_exact(12)).enumerate() {
            let value = |k: usize| f64::from(f32::from_le_bytes([0, 1, 2, 3].map(|j| bytes[4 * k + j])));
            let place = || format!("byte {}", offset + 12 + 12 * i);
            *corner = self.corner([value(0), value(1), value(2)], place)?;
        }
        self.building.polygon(&corners, || format!("byte {offset}"))
    }

    /// Words count, not lines: `outer loop`, `vertex x y z` three times, `endloop`. Names of solids
    /// are passed over.
    fn text(&mut self, bytes: &[u8]) -> Result<()> {
        let mut corners: Option<Vec<u64>> = None;
        let mut ended = false;
        for (number_of_line, text) in bytes.split(|&byte| byte == b'\n').enumerate() {
            let place = || super::line(number_of_line + 1);
            let mut words = text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
            while let Some(word) = words.next() {
                match word.to_ascii_lowercase().as_slice() {
                    // The rest of the line is a name.
                    b"solid" => {
                        ended = false;
                        break;
                    }
                    b"endsolid" => {
                        ended = true;
                        break;
                    }
                    b"outer" => corners = Some(Vec::new()),
                    b"vertex" => {
                        let mut point = [0.0; 3];
                        for value in &mut point {
                            *value = number(words.next().unwrap_or_default(), place)?;
                        }
                        let corner = self.corner(point, place)?;
                        let loop_ = corners.as_mut();
                        loop_.ok_or_else(|| Error::format(place(), "outer loop", "vertex"))?.push(corner);
                    }
                    b"endloop" => {
                        let corners = corners.take().unwrap_or_default();
                        self.building.polygon(&corners, place)?;
                    }
                    b"facet" | b"normal" | b"loop" | b"endfacet" => {}
                    other if other.iter().all(|byte| b"0123456789+-.einfa".contains(byte)) => {}
                    other => return Err(Error::format(place(), "a word of STL", shown(other))),
                }
            }
        }
        if ended { Ok(()) } else { Err(Error::format("the end of the file", "endsolid", "nothing")) }
    }
}
