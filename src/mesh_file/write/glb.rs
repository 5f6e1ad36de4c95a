//! GLB: one node, mesh, primitive and material; the attributes one after the other.
//!
//! A position is (column, height, row) of its place, which is right-handed as the row runs south:
//! columns and rows stay exact, and the node takes them to metres. A node can turn and scale, but
//! not shear; what shears is done to the places before they are kept.

use std::path::PathBuf;

use super::gltf_json::{self, View};
use super::part::Part;
use super::{Body, Content, Encoding, Up, Vertex};
use crate::error::{Error, Result};
use crate::mesh_file::Affine;
use crate::output::NewFile;

/// Cosine of the angle of two axes that count as square.
const SQUARE: f64 = 1e-9;
/// Ratio of the scales of a node up to which bytes do for normals.
const UNLIKE: f64 = 4.0;

/// How places are kept, and what the node makes of them.
pub(super) struct Frame {
    /// What is done to a place before it is kept: nothing, unless the map shears.
    before: Option<Affine>,
    encoding: Encoding,
    /// From what is kept, (column, height, row), to metres (east, up, south).
    pub(super) node: Affine,
    /// The node mirrors: readers turn triangles around.
    mirrors: bool,
}

impl Frame {
    fn new(content: &Content) -> Result<Self> {
        let mut map = content.map;
        let column = |i: usize| map.matrix.map(|row| row[i]);
        let dot = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let shears = [(0, 1), (0, 2), (1, 2)].iter().any(|&(i, j)| {
            let (a, b) = (column(i), column(j));
            dot(a, b).abs() > SQUARE * (dot(a, a) * dot(b, b)).sqrt()
        });
        let mut before = None;
        if shears {
            if content.encoding != Encoding::Float {
                return Err(Error::usage("a GLB cannot keep 16-bit coordinates of axes that are not square"));
            }
            let [east, north, up] = map.matrix;
            let matrix = [east, north.map(|v| -v), up];
            before = Some(Affine { matrix, offset: [0.0; 3] });
            map.matrix = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]];
        }
        if let Encoding::Short { origin, step } = content.encoding {
            map.offset = map.apply(origin);
            map.matrix = map.matrix.map(|[a, b, c]| [a * step[0], b * step[1], c * step[2]]);
        }
        let turned = map.matrix.map(|[a, b, c]| [a, c, b]);
        // A zero stays one, without a sign.
        let matrix = [turned[0], turned[2], turned[1].map(|v| 0.0 - v)];
        let offset = [map.offset[0], map.offset[2], 0.0 - map.offset[1]];
        let node = Affine { matrix, offset };
        let determinant = node.determinant();
        if determinant == 0.0 || !determinant.is_finite() || !offset.iter().all(|v| v.is_finite()) {
            return Err(Error::usage(
                "the numbers of the map from places to metres are too large or too small",
            ));
        }
        Ok(Self { before, encoding: content.encoding, node, mirrors: determinant < 0.0 })
    }

    /// The numbers that are kept, in the order of the file; not finite if they cannot be.
    fn kept(&self, place: [f64; 3]) -> [f64; 3] {
        let place = self.before.map_or(place, |before| before.apply(place));
        let [column, row, height] = match self.encoding {
            Encoding::Float => place.map(|value| f64::from(value as f32)),
            Encoding::Short { origin, step } => [0, 1, 2].map(|i| {
                let q = ((place[i] - origin[i]) / step[i]).round();
                if (0.0..=65535.0).contains(&q) { q } else { f64::NAN }
            }),
        };
        [column, height, row]
    }

    /// A unit normal in the coordinates that are kept.
    fn normal(&self, normal: [f32; 3]) -> [f64; 3] {
        let [east, north, up] = normal.map(f64::from);
        let unit = |[x, y, z]: [f64; 3]| {
            let [a, b, c] = self.node.matrix;
            let turned = [0, 1, 2].map(|i| a[i] * x + b[i] * y + c[i] * z);
            let length = turned.iter().map(|v| v * v).sum::<f64>().sqrt();
            turned.map(|v| v / length)
        };
        let found = unit([east, up, -north]);
        if found.iter().all(|v| v.is_finite()) { found } else { unit([0.0, 1.0, 0.0]) }
    }
}

/// True if normals are kept as bytes: with 16-bit coordinates, unless the node's scales differ so
/// much that they would be of no use. What a scale of 30 m across and 4 mm upward makes of a byte
/// is either flat or a wall.
pub(super) fn has_byte_normals(content: &Content, node: &Affine) -> bool {
    let scale = |i: usize| node.matrix.iter().map(|row| row[i] * row[i]).sum::<f64>().sqrt();
    let scales = [scale(0), scale(1), scale(2)];
    let (least, most) =
        scales.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), &scale| (a.min(scale), b.max(scale)));
    content.encoding != Encoding::Float && most <= UNLIKE * least
}

/// A unit vector as bytes of 1/127: of the eight beside it the one whose length is nearest to 1, if
/// the nearest vector is too long or too short to count as one.
fn bytes_of([x, y, z]: [f64; 3]) -> [i8; 3] {
    let scaled = [x, y, z].map(|v| v * 127.0);
    let off = |v: [f64; 3]| (v.iter().map(|v| v * v).sum::<f64>().sqrt() - 127.0).abs();
    let mut best = scaled.map(f64::round);
    if off(best) > 0.5 {
        for corner in 0..8 {
            let other = [0, 1, 2].map(|i| scaled[i].floor() + f64::from(corner >> i & 1));
            if off(other) < off(best) && other.iter().all(|v| v.abs() <= 127.0) {
                best = other;
            }
        }
    }
    best.map(|v| v as i8)
}

pub(super) struct Glb {
    file: NewFile,
    frame: Frame,
    layout: Layout,
    positions: Part,
    normals: Part,
    texels: Part,
    indices: Part,
    /// Of what is kept.
    least: [f64; 3],
    most: [f64; 3],
}

/// Where in the file everything is.
struct Layout {
    /// Bytes of the chunk of JSON.
    json: u64,
    /// Of the chunk of bytes: positions, normals, texture coordinates, indices, picture.
    views: Vec<View>,
    /// Bytes of all views with what fills the gaps.
    bytes: u64,
    wide: bool,
}

impl Layout {
    fn new(content: &Content, frame: &Frame) -> Self {
        let short = content.encoding != Encoding::Float;
        let of = |has: bool, float: u64, short_bytes: u64| {
            content.vertices * u64::from(has) * if short { short_bytes } else { float }
        };
        // 65535 is no index of 16 bits.
        let wide = content.vertices > 65535;
        let picture = content.picture.as_ref().map_or(0, |picture| picture.bytes.len() as u64);
        let lengths = [
            of(true, 12, 8),
            of(content.has_normals, 12, if has_byte_normals(content, &frame.node) { 4 } else { 12 }),
            of(content.picture.is_some(), 8, 4),
            content.triangles * if wide { 12 } else { 6 },
            picture,
        ];
        let (mut views, mut bytes) = (Vec::new(), 0_u64);
        for length in lengths {
            views.push(View { offset: bytes, length });
            bytes = (bytes + length).next_multiple_of(4);
        }
        // Least and largest positions are known last: there is room for the longest numbers.
        let longest = [-f64::MIN_POSITIVE; 3];
        let text = gltf_json::text(content, &frame.node, &views, (longest, longest));
        Self { json: (text.len() as u64).next_multiple_of(4), views, bytes, wide }
    }

    /// The byte of the file where a view begins.
    fn start(&self, view: usize) -> u64 {
        28 + self.json + self.views.get(view).map_or(self.bytes, |view| view.offset)
    }
}

/// Bytes of the file.
pub(super) fn size(content: &Content) -> Result<u64> {
    let layout = Layout::new(content, &Frame::new(content)?);
    Ok(layout.start(usize::MAX))
}

impl Glb {
    pub(super) fn create(path: PathBuf, content: &Content, force: bool) -> Result<Self> {
        let frame = Frame::new(content)?;
        let layout = Layout::new(content, &frame);
        let mut file = NewFile::create(path, force)?;
        if let Some(picture) = &content.picture {
            file.seek(layout.start(4))?;
            file.put(&picture.bytes)?;
            let padding = picture.bytes.len().next_multiple_of(4) - picture.bytes.len();
            file.put(&[0; 4][..padding])?;
        }
        let [positions, normals, texels, indices] = [0, 1, 2, 3].map(|view| Part::at(layout.start(view)));
        let (least, most) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        Ok(Self { file, frame, layout, positions, normals, texels, indices, least, most })
    }

    fn position(&mut self, place: [f64; 3]) {
        let kept = self.frame.kept(place);
        for (axis, &value) in kept.iter().enumerate() {
            self.least[axis] = self.least[axis].min(value);
            self.most[axis] = self.most[axis].max(value);
        }
        let bytes = self.positions.bytes();
        if self.frame.encoding == Encoding::Float {
            bytes.extend(kept.iter().flat_map(|value| (*value as f32).to_le_bytes()));
        } else {
            bytes.extend(kept.iter().flat_map(|value| (*value as u16).to_le_bytes()));
            bytes.extend([0; 2]);
        }
    }
}

impl Body for Glb {
    fn stored(&self, _: &Content, place: [f64; 3]) -> [f64; 3] {
        Up::Y.to_z_up(self.frame.node.apply(self.frame.kept(place)))
    }

    fn vertices(&mut self, content: &Content, vertices: &[Vertex]) -> Result<()> {
        let floats = self.frame.encoding == Encoding::Float;
        let byte_normals = has_byte_normals(content, &self.frame.node);
        for vertex in vertices {
            self.position(vertex.place);
            if content.has_normals {
                let normal = self.frame.normal(vertex.normal);
                let bytes = self.normals.bytes();
                if byte_normals {
                    bytes.extend(bytes_of(normal).map(|value| value as u8));
                    bytes.push(0);
                } else {
                    bytes.extend(normal.iter().flat_map(|value| (*value as f32).to_le_bytes()));
                }
            }
            if let Some(picture) = &content.picture {
                let at = picture.at(vertex.place);
                let bytes = self.texels.bytes();
                if floats {
                    bytes.extend(at.iter().flat_map(|value| (*value as f32).to_le_bytes()));
                } else {
                    let short = |value: f64| (value.clamp(0.0, 1.0) * 65535.0).round() as u16;
                    bytes.extend(at.iter().flat_map(|value| short(*value).to_le_bytes()));
                }
            }
            for part in [&mut self.positions, &mut self.normals, &mut self.texels] {
                part.check(&mut self.file)?;
            }
        }
        Ok(())
    }

    fn triangles(&mut self, triangles: &[[u32; 3]]) -> Result<()> {
        for &[a, b, c] in triangles {
            let triangle = if self.frame.mirrors { [a, c, b] } else { [a, b, c] };
            let bytes = self.indices.bytes();
            if self.layout.wide {
                bytes.extend(triangle.iter().flat_map(|index| index.to_le_bytes()));
            } else {
                bytes.extend(triangle.iter().flat_map(|index| (*index as u16).to_le_bytes()));
            }
            self.indices.check(&mut self.file)?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>, content: &Content) -> Result<u64> {
        for part in [&mut self.positions, &mut self.normals, &mut self.texels, &mut self.indices] {
            part.flush(&mut self.file)?;
        }
        if content.picture.is_none() {
            let end = self.indices.position();
            self.file.put(&[0; 4][..(end.next_multiple_of(4) - end) as usize])?;
        }
        let (json, bytes) = (self.layout.json as usize, self.layout.bytes);
        let mut text =
            gltf_json::text(content, &self.frame.node, &self.layout.views, (self.least, self.most));
        text.extend(std::iter::repeat_n(' ', json.saturating_sub(text.len())));
        let total = self.layout.start(usize::MAX);
        let mut front = Vec::new();
        front.extend(b"glTF");
        front.extend([2, total as u32, json as u32].iter().flat_map(|value| value.to_le_bytes()));
        front.extend(b"JSON");
        front.extend(text.as_bytes());
        front.extend((bytes as u32).to_le_bytes());
        front.extend(b"BIN\0");
        self.file.seek(0)?;
        self.file.put(&front)?;
        self.file.commit()?;
        Ok(total)
    }
}
