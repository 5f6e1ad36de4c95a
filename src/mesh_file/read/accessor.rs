//! Numbers of a glTF in its binary chunk.

use serde_json::Value;

use crate::error::{Error, Result};

/// The binary chunk.
pub(super) type Bin<'a> = &'a [u8];

const I8: u64 = 5120;
const U8: u64 = 5121;
const I16: u64 = 5122;
const U16: u64 = 5123;
const U32: u64 = 5125;
const F32: u64 = 5126;

/// Elements of one type at equal distances. All of them are in the chunk.
pub(super) struct Accessor<'a> {
    /// From the first element on.
    bytes: &'a [u8],
    stride: usize,
    component: u64,
    is_normalized: bool,
    shape: String,
    pub(super) count: u64,
    path: String,
}

impl<'a> Accessor<'a> {
    /// That of a number.
    pub(super) fn of(root: &Value, bin: Bin<'a>, number: u64) -> Result<Self> {
        let path = format!("/accessors/{number}");
        let json = root.pointer(&path).ok_or_else(|| Error::format(&path, "an accessor", "none"))?;
        if json.get("sparse").is_some() {
            return Err(Error::unsupported("a sparse accessor", "save the file without sparse accessors"));
        }
        let field = |json: &Value, name: &str| match json.get(name) {
            None => Ok(None),
            Some(value) => value
                .as_u64()
                .map(Some)
                .ok_or_else(|| Error::format(format!("{path}: {name}"), "a whole number from 0 on", value)),
        };
        let need = |value: Option<u64>, name: &str| {
            value.ok_or_else(|| Error::format(format!("{path}: {name}"), "a whole number from 0 on", "none"))
        };
        let component = need(field(json, "componentType")?, "componentType")?;
        let count = need(field(json, "count")?, "count")?;
        let shape = json.get("type").and_then(Value::as_str).unwrap_or_default().to_owned();
        let components = match shape.as_str() {
            "SCALAR" => 1,
            "VEC3" => 3,
            _ => return Err(Error::format(format!("{path}: type"), "SCALAR or VEC3", &shape)),
        };
        let size = components * bytes_of(component, &path)?;
        let view_path = format!("/bufferViews/{}", need(field(json, "bufferView")?, "bufferView")?);
        let view = root.pointer(&view_path).ok_or_else(|| Error::format(&view_path, "a view", "none"))?;
        if view.pointer("/extensions/EXT_meshopt_compression").is_some() {
            return Err(Error::unsupported("meshopt compression", "save the file without compression"));
        }
        if field(view, "buffer")? != Some(0) || root.pointer("/buffers/0/uri").is_some() {
            return Err(Error::unsupported("a buffer outside of the GLB", "save one file with all of it"));
        }
        let view_offset = field(view, "byteOffset")?.unwrap_or(0);
        let view_length = need(field(view, "byteLength")?, "byteLength of its view")?;
        let stride = field(view, "byteStride")?.unwrap_or(size);
        let offset = field(json, "byteOffset")?.unwrap_or(0);
        if stride < size || stride > 252.max(size) {
            return Err(Error::format(format!("{view_path}: byteStride"), format!("{size} to 252"), stride));
        }
        let whole = slice(bin, view_offset, view_length).and_then(|view| {
            let bytes = view.get(usize::try_from(offset).ok()?..)?;
            let needed =
                count.checked_sub(1).map_or(Some(0), |last| last.checked_mul(stride)?.checked_add(size))?;
            (needed <= bytes.len() as u64).then_some(bytes)
        });
        let bytes = whole.ok_or_else(|| {
            let expected =
                format!("{count} elements within its view and the {} bytes of the chunk", bin.len());
            Error::format(&path, expected, "more")
        })?;
        let is_normalized = json.get("normalized").and_then(Value::as_bool).unwrap_or(false);
        Ok(Self { bytes, stride: stride as usize, component, is_normalized, shape, count, path })
    }

    /// A component of an element that there is.
    fn component(&self, element: u64, component: usize) -> f64 {
        let byte = |i: usize| self.bytes.get(i).copied().unwrap_or_default();
        let at = |size: usize| element as usize * self.stride + component * size;
        let two = || [byte(at(2)), byte(at(2) + 1)];
        let four = || [0, 1, 2, 3].map(|i| byte(at(4) + i));
        let signed =
            |value: f64, most: f64| if self.is_normalized { (value / most).max(-1.0) } else { value };
        match self.component {
            I8 => signed(f64::from(byte(at(1)) as i8), 127.0),
            U8 => signed(f64::from(byte(at(1))), 255.0),
            I16 => signed(f64::from(i16::from_le_bytes(two())), 32767.0),
            U16 => signed(f64::from(u16::from_le_bytes(two())), 65535.0),
            U32 => f64::from(u32::from_le_bytes(four())),
            _ => f64::from(f32::from_le_bytes(four())),
        }
    }

    /// A position.
    pub(super) fn position(&self, element: u64) -> Result<[f64; 3]> {
        if self.shape != "VEC3" || self.component == U32 {
            return Err(Error::format(&self.path, "positions: VEC3 of floats, bytes or shorts", &self.shape));
        }
        Ok([0, 1, 2].map(|i| self.component(element, i)))
    }

    /// An index below a number of vertices.
    pub(super) fn index(&self, element: u64, vertices: u64) -> Result<u64> {
        if self.shape != "SCALAR" || ![U8, U16, U32].contains(&self.component) || self.is_normalized {
            return Err(Error::format(&self.path, "indices: SCALAR of unsigned integers", &self.shape));
        }
        let index = self.component(element, 0) as u64;
        if index < vertices {
            return Ok(index);
        }
        let place = format!("{}, element {element}", self.path);
        Err(Error::format(place, format!("a vertex below {vertices}"), index))
    }
}

fn slice(bytes: &[u8], offset: u64, length: u64) -> Option<&[u8]> {
    bytes.get(usize::try_from(offset).ok()?..)?.get(..usize::try_from(length).ok()?)
}

fn bytes_of(component: u64, path: &str) -> Result<u64> {
    match component {
        I8 | U8 => Ok(1),
        I16 | U16 => Ok(2),
        U32 | F32 => Ok(4),
        _ => Err(Error::format(format!("{path}: componentType"), "5120 to 5126", component)),
    }
}
