//! Files of triangle meshes: GLB, OBJ, PLY and STL, written as a stream and read whole.
//!
//! [`Writer`] takes vertices and triangles that someone else makes, and tells by
//! [`Writer::stored`] what a reader of the file gets back for a vertex. [`read()`] reads files that
//! anyone made. Neither knows of tiles, rasters, or how a mesh comes about.
//!
//! In memory z is up, and a triangle is counter-clockwise seen from above. Files of GLB have y up
//! and counter-clockwise triangles; in the others z is up unless [`Content::up`] says else.

mod content;
mod names;
mod read;
mod write;

use std::path::Path;

use crate::error::{Error, Result};
pub use content::{Affine, Content, Encoding, Picture, Vertex};
pub use names::files;
pub use read::read;
pub use write::{Writer, size};

/// A triangle mesh in memory. z is up; triangles are counter-clockwise seen from above.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Coordinates of the vertices.
    pub vertices: Vec<[f64; 3]>,
    /// Three vertices each, by number.
    pub triangles: Vec<[u32; 3]>,
    /// What the file says of itself: `asset.extras` of a GLB, our comment in others, or null.
    pub about: serde_json::Value,
}

/// A format of mesh files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Binary glTF 2.0.
    Glb,
    /// Wavefront OBJ, with a material file and a picture beside it if it has one.
    Obj,
    /// Polygon file format, binary and little-endian when written.
    Ply,
    /// Stereolithography, binary when written.
    Stl,
}

impl Format {
    /// The format that the ending of a name stands for.
    ///
    /// # Errors
    /// [`Error::Usage`] for any other ending.
    pub fn of(path: &Path) -> Result<Self> {
        let end = path.extension().map(|end| end.to_string_lossy().to_ascii_lowercase());
        match end.as_deref() {
            Some("glb") => Ok(Self::Glb),
            Some("obj") => Ok(Self::Obj),
            Some("ply") => Ok(Self::Ply),
            Some("stl") => Ok(Self::Stl),
            _ => Err(Error::usage(format!(
                "{}: the name of a mesh file ends with .glb, .obj, .ply or .stl",
                path.display()
            ))),
        }
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Glb => "GLB",
            Self::Obj => "OBJ",
            Self::Ply => "PLY",
            Self::Stl => "STL",
        }
    }

    /// The axis that is up in a file that does not say.
    fn up(self) -> Up {
        if self == Self::Glb { Up::Y } else { Up::Z }
    }
}

/// The axis that points up in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Up {
    /// (east, up, south), as in GLB.
    Y,
    /// (east, north, up).
    Z,
}

impl Up {
    /// Coordinates in a file of a point with z up.
    pub(crate) fn in_file(self, [east, north, up]: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Y => [east, up, -north],
            Self::Z => [east, north, up],
        }
    }

    /// A point with z up of coordinates in a file.
    pub(crate) fn to_z_up(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Y => [x, -z, y],
            Self::Z => [x, y, z],
        }
    }
}
