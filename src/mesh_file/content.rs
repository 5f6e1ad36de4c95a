//! What a mesh file to write holds, told before its first vertex.

use super::Up;

/// `x' = matrix * x + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    /// Rows.
    pub matrix: [[f64; 3]; 3],
    /// What is added.
    pub offset: [f64; 3],
}

impl Affine {
    /// The image of a point. Products are added from left to right and the offset last, each
    /// rounded: so that who reads the numbers in a file can get the same bits.
    pub fn apply(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let row = |i: usize| {
            let [a, b, c] = self.matrix[i];
            a * x + b * y + c * z + self.offset[i]
        };
        [row(0), row(1), row(2)]
    }

    /// The determinant of the matrix.
    pub(crate) fn determinant(&self) -> f64 {
        let [[a, b, c], [d, e, f], [g, h, i]] = self.matrix;
        a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    }
}

/// How a file keeps coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Encoding {
    /// As the format has them: 32-bit floats in GLB and STL, 64 bits in PLY, decimals in OBJ.
    Float,
    /// 16-bit integers `q`, a place being `origin + step * q`; GLB alone (`KHR_mesh_quantization`).
    Short {
        /// The place of `q = 0`.
        origin: [f64; 3],
        /// The distance of two neighbours, above 0.
        step: [f64; 3],
    },
}

/// A vertex to write.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Vertex {
    /// In the caller's grid: lattice column, lattice row (runs south), height in metres, all
    /// relative to an origin near it.
    pub place: [f64; 3],
    /// A unit vector (east, north, up), used if [`Content::has_normals`].
    pub normal: [f32; 3],
    /// Used if [`Content::has_errors`].
    pub error: f32,
    /// Used if [`Content::has_errors`].
    pub level: u8,
}

/// A picture over a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// The file.
    pub bytes: Vec<u8>,
    /// `image/jpeg` or `image/png`.
    pub mime: &'static str,
    /// `(u, v) = uv * (x, y, 1)` of a place; the origin is the picture's upper left corner.
    pub uv: [[f64; 3]; 2],
}

impl Picture {
    /// The point of the picture at a place.
    pub(crate) fn at(&self, [x, y, _]: [f64; 3]) -> [f64; 2] {
        self.uv.map(|[a, b, c]| a * x + b * y + c)
    }

    /// The ending of a file of it.
    pub(crate) fn ending(&self) -> &'static str {
        if self.mime == "image/png" { "png" } else { "jpg" }
    }
}

/// What a mesh file to write holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Content {
    /// Vertices that will come.
    pub vertices: u64,
    /// Triangles that will come.
    pub triangles: u64,
    /// Takes places to metres (east, north, up); it can be inverted.
    pub map: Affine,
    /// How coordinates are kept.
    pub encoding: Encoding,
    /// The axis that is up; Y in GLB.
    pub up: Up,
    /// Vertices have normals. STL has none of vertices.
    pub has_normals: bool,
    /// Vertices have errors and levels; PLY alone.
    pub has_errors: bool,
    /// A picture over all; not in STL.
    pub picture: Option<Picture>,
    /// The least and the largest coordinates of the places that will come.
    pub bounds: ([f64; 3], [f64; 3]),
    /// What the file is to say of itself; null if nothing. STL has room for little.
    pub about: serde_json::Value,
    /// The name and version of the program.
    pub generator: String,
}
