//! The header of a PLY file.

use super::{line, shown};
use crate::error::{Error, Result};

/// How values follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    Ascii,
    Little,
    Big,
}

/// The type of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn of(word: &str) -> Option<Self> {
        Some(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// What a property is to us.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Use {
    /// A coordinate of a vertex, by axis.
    Axis(usize),
    /// The vertices of a face.
    Corners,
    Other,
}

/// One value of an element, or a list of values.
#[derive(Clone, Copy, Debug)]
pub(super) struct Property {
    /// The type of a list's length.
    pub(super) list: Option<Scalar>,
    pub(super) scalar: Scalar,
    pub(super) use_: Use,
}

/// What elements of a name hold.
#[derive(Clone, Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

/// The header.
pub(super) struct Header {
    pub(super) form: Form,
    pub(super) elements: Vec<Element>,
    pub(super) about: serde_json::Value,
    /// Where values begin, and the number of that line.
    pub(super) end: usize,
    pub(super) line: usize,
}

impl Header {
    /// The header of a file.
    pub(super) fn read(bytes: &[u8]) -> Result<Self> {
        let mut header =
            Self { form: Form::Ascii, elements: Vec::new(), about: serde_json::Value::Null, end: 0, line: 0 };
        let mut form = None;
        loop {
            let rest = &bytes[header.end..];
            header.line += 1;
            let number = header.line;
            let place = || line(number);
            let Some(length) = rest.iter().position(|&byte| byte == b'\n') else {
                return Err(Error::format(place(), "a header that ends with end_header", shown(rest)));
            };
            let text = String::from_utf8_lossy(rest[..length].trim_ascii_end()).into_owned();
            header.end += length + 1;
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            match (words.as_slice(), header.line) {
                (["ply"], 1) => {}
                (_, 1) => return Err(Error::format(line(1), "\"ply\"", shown(text.as_bytes()))),
                (["format", name, "1.0"], _) => form = Some(form_of(name, place())?),
                (["comment", "relevo", ..], _) => {
                    let about = text.split_once("relevo ").map(|(_, json)| json);
                    let about = about.and_then(|json| serde_json::from_str(json).ok());
                    header.about = about.unwrap_or_default();
                }
                (["comment" | "obj_info", ..], _) => {}
                (["element", name, count], _) => {
                    let count = count.parse().map_err(|_| Error::format(place(), "a count", count))?;
                    header.elements.push(Element { name: (*name).to_owned(), count, properties: Vec::new() });
                }
                (["property", rest @ ..], _) => {
                    let property = header.elements.last_mut().and_then(|element| {
                        let property = property(&element.name, rest)?;
                        element.properties.push(property);
                        Some(())
                    });
                    property.ok_or_else(|| {
                        Error::format(place(), "a property of an element", shown(text.as_bytes()))
                    })?;
                }
                (["end_header"], _) => break,
                _ => return Err(Error::format(place(), "a line of a header", shown(text.as_bytes()))),
            }
        }
        header.form = form.ok_or_else(|| Error::format("the header", "its format", "none"))?;
        header.check()?;
        Ok(header)
    }

    fn check(&self) -> Result<()> {
        let of = |name: &str, is: fn(&Property) -> bool| {
            let element = self.elements.iter().filter(|element| element.name == name);
            element.map(|element| element.properties.iter().filter(|p| is(p)).count()).collect::<Vec<_>>()
        };
        let axes = of("vertex", |p| p.list.is_none() && p.use_ != Use::Other);
        let lists = of("face", |p| p.list.is_some() && p.use_ != Use::Other);
        if axes != [3] || lists != [1] {
            return Err(Error::format(
                "the header",
                "one element \"vertex\" with x, y and z, and one \"face\" with a list vertex_indices",
                format!("{axes:?} coordinates, {lists:?} lists"),
            ));
        }
        Ok(())
    }
}

fn form_of(name: &str, place: String) -> Result<Form> {
    match name {
        "ascii" => Ok(Form::Ascii),
        "binary_little_endian" => Ok(Form::Little),
        "binary_big_endian" => Ok(Form::Big),
        _ => Err(Error::format(
            place,
            "ascii, binary_little_endian or binary_big_endian",
            shown(name.as_bytes()),
        )),
    }
}

fn property(element: &str, words: &[&str]) -> Option<Property> {
    Some(match *words {
        ["list", count, of, name] => {
            let list = Scalar::of(count).filter(|list| !matches!(list, Scalar::F32 | Scalar::F64))?;
            let is_corners = element == "face" && ["vertex_indices", "vertex_index"].contains(&name);
            let use_ = if is_corners { Use::Corners } else { Use::Other };
            Property { list: Some(list), scalar: Scalar::of(of)?, use_ }
        }
        [of, name] => {
            let axis = ["x", "y", "z"].iter().position(|axis| *axis == name && element == "vertex");
            Property { list: None, scalar: Scalar::of(of)?, use_: axis.map_or(Use::Other, Use::Axis) }
        }
        _ => return None,
    })
}
