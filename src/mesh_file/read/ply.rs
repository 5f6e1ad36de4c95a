//! PLY, of text or of bytes in either order.

use super::ply_header::{Element, Form, Header, Scalar, Use};
use super::{Building, number, shown};
use crate::error::{Error, Result};

/// The mesh of a PLY file. Elements and properties that are none of ours are passed over.
pub(super) fn read(bytes: &[u8]) -> Result<Building> {
    let header = Header::read(bytes)?;
    let mut building = Building::default();
    let mut values = Values { bytes, at: header.end, form: header.form, line: header.line + 1 };
    for element in &header.elements {
        if element.properties.is_empty() {
            continue;
        }
        for _ in 0..element.count {
            read_one(&mut values, element, &mut building)?;
        }
    }
    building.mesh.about = header.about;
    building.check()?;
    Ok(building)
}

/// Reads one vertex, face or other element.
fn read_one(values: &mut Values, element: &Element, building: &mut Building) -> Result<()> {
    let (mut point, mut corners) = ([0.0; 3], Vec::new());
    let start = values.mark();
    for property in &element.properties {
        let place = values.mark();
        let count = match property.list {
            None => 1,
            Some(scalar) => whole(values.next(scalar)?, || place.name())?,
        };
        // A value takes a byte at least, so that a long list ends with the file.
        for _ in 0..count {
            let place = values.mark();
            let value = values.next(property.scalar)?;
            match property.use_ {
                Use::Axis(axis) => point[axis] = value,
                Use::Corners => corners.push(whole(value, || place.name())?),
                Use::Other => {}
            }
        }
    }
    match element.name.as_str() {
        "vertex" => building.vertex(point, || start.name()),
        "face" => building.polygon(&corners, || start.name()),
        _ => Ok(()),
    }
}

/// A value as a count or an index.
fn whole(value: f64, place: impl Fn() -> String) -> Result<u64> {
    if value >= 0.0 && value.fract() == 0.0 && value <= f64::from(u32::MAX) {
        Ok(value as u64)
    } else {
        Err(Error::format(place(), "a whole number from 0 on", value))
    }
}

/// A place in the file.
#[derive(Clone, Copy)]
enum Mark {
    Line(usize),
    Byte(usize),
}

impl Mark {
    fn name(self) -> String {
        match self {
            Self::Line(line) => super::line(line),
            Self::Byte(byte) => format!("byte {byte}"),
        }
    }
}

/// The values of a file one by one.
struct Values<'a> {
    bytes: &'a [u8],
    at: usize,
    form: Form,
    line: usize,
}

impl Values<'_> {
    fn mark(&self) -> Mark {
        if self.form == Form::Ascii { Mark::Line(self.line) } else { Mark::Byte(self.at) }
    }

    fn next(&mut self, scalar: Scalar) -> Result<f64> {
        if self.form == Form::Ascii {
            return self.word();
        }
        let length = scalar.bytes();
        let Some(bytes) = self.bytes.get(self.at..).and_then(|rest| rest.get(..length)) else {
            let left = self.bytes.len() - self.at;
            return Err(Error::format(self.mark().name(), format!("{length} bytes"), left));
        };
        let mut value = [0; 8];
        value[..length].copy_from_slice(bytes);
        if self.form == Form::Big {
            value[..length].reverse();
        }
        self.at += length;
        let [a, b, c, d, ..] = value;
        Ok(match scalar {
            Scalar::I8 => f64::from(a as i8),
            Scalar::U8 => f64::from(a),
            Scalar::I16 => f64::from(i16::from_le_bytes([a, b])),
            Scalar::U16 => f64::from(u16::from_le_bytes([a, b])),
            Scalar::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Scalar::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Scalar::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Scalar::F64 => f64::from_le_bytes(value),
        })
    }

    fn word(&mut self) -> Result<f64> {
        while let Some(byte) = self.bytes.get(self.at).filter(|byte| byte.is_ascii_whitespace()) {
            self.line += usize::from(*byte == b'\n');
            self.at += 1;
        }
        let rest = &self.bytes[self.at..];
        let word = rest.split(u8::is_ascii_whitespace).next().unwrap_or_default();
        if word.is_empty() {
            return Err(Error::format(super::line(self.line), "a value", shown(word)));
        }
        self.at += word.len();
        number(word, || super::line(self.line))
    }
}
