//! Writes a mesh as a stream: its vertices, then its triangles.
//!
//! The file is written beside the target and gets its name in [`Writer::finish`], and so do those
//! beside it (a material, a picture): a writer dropped half-way leaves nothing behind. Memory does
//! not grow with the mesh, but for STL, whose triangles repeat the coordinates of their corners:
//! there it holds 12 bytes a vertex.

mod glb;
mod gltf_json;
mod obj;
mod part;
mod ply;
mod stl;
mod text;

use std::path::PathBuf;

use super::{Content, Encoding, Format, Up, Vertex};
use crate::error::{Error, Result};

/// Writes a mesh file; see the module.
///
/// ```
/// use relevo::mesh_file::{Affine, Content, Encoding, Format, Up, Vertex, Writer, read};
///
/// let folder = tempfile::tempdir().unwrap();
/// let path = folder.path().join("a.ply");
/// let matrix = [[30.0, 0.0, 0.0], [0.0, -30.0, 0.0], [0.0, 0.0, 1.0]];
/// let content = Content {
///     vertices: 3,
///     triangles: 1,
///     map: Affine { matrix, offset: [0.0; 3] },
///     encoding: Encoding::Float,
///     up: Up::Z,
///     has_normals: false,
///     has_errors: false,
///     picture: None,
///     bounds: ([0.0; 3], [1.0, 1.0, 7.0]),
///     about: serde_json::Value::Null,
///     generator: "example".to_owned(),
/// };
/// let mut writer = Writer::create(&path, Format::of(&path)?, content, false)?;
/// let vertex = |place| Vertex { place, ..Vertex::default() };
/// assert_eq!(writer.stored([1.0, 1.0, 0.0]), [30.0, -30.0, 0.0]);
/// writer.vertices(&[vertex([0.0, 0.0, 7.0]), vertex([0.0, 1.0, 0.0]), vertex([1.0, 1.0, 0.0])])?;
/// writer.triangles(&[[0, 1, 2]])?;
/// writer.finish()?;
/// assert_eq!(read(&path, None)?.vertices[2], [30.0, -30.0, 0.0]);
/// # Ok::<(), relevo::Error>(())
/// ```
pub struct Writer {
    content: Content,
    body: Box<dyn Body + Send>,
    vertices: u64,
    triangles: u64,
    least: [f64; 3],
    most: [f64; 3],
}

/// The part of a writer that differs from format to format. What comes is checked already.
trait Body {
    /// What a reader gets back for a place: metres, (east, north, up).
    fn stored(&self, content: &Content, place: [f64; 3]) -> [f64; 3];
    /// Writes vertices.
    fn vertices(&mut self, content: &Content, vertices: &[Vertex]) -> Result<()>;
    /// Writes triangles.
    fn triangles(&mut self, triangles: &[[u32; 3]]) -> Result<()>;
    /// Completes the files and gives them their names; returns the bytes of the mesh's own.
    fn finish(self: Box<Self>, content: &Content) -> Result<u64>;
}

/// Bytes that the file of a mesh will have, without those beside it. Of OBJ, whose numbers are
/// text, it is an estimate from above: for coordinates of up to 24 characters.
///
/// # Errors
/// [`Error::Usage`] if the format cannot hold it, and for a content that makes no sense.
pub fn size(format: Format, content: &Content) -> Result<u64> {
    check(format, content)?;
    let bytes = match format {
        Format::Glb => glb::size(content)?,
        Format::Obj => obj::size(content),
        Format::Ply => ply::size(content),
        Format::Stl => stl::size(content),
    };
    if format == Format::Glb && bytes > u64::from(u32::MAX) {
        return Err(too_large(format, format!("{bytes} bytes, and a GLB has less than 4 GiB")));
    }
    Ok(bytes)
}

fn too_large(format: Format, what: String) -> Error {
    let others = if format == Format::Glb { "PLY" } else { "another format" };
    Error::usage(format!(
        "the mesh does not fit a {} file: it has {what}; allow a larger error, take a window, or write {others}",
        format.name()
    ))
}

/// Fails if a format cannot hold a content.
fn check(format: Format, content: &Content) -> Result<()> {
    let usage = |what: &str| Err(Error::usage(format!("{what} in a {} file", format.name())));
    // Indices of PLY are signed.
    let most = if format == Format::Ply { 1 << 31 } else { u64::from(u32::MAX) };
    for (what, count, most) in
        [("vertices", content.vertices, most), ("triangles", content.triangles, u64::from(u32::MAX))]
    {
        if count > most {
            return Err(too_large(format, format!("{count} {what}, and it holds at most {most}")));
        }
    }
    if content.vertices < 3 || content.triangles == 0 {
        return usage("a mesh without triangles cannot be kept");
    }
    let affine = content.map.matrix.iter().flatten().chain(&content.map.offset);
    let determinant = content.map.determinant();
    if !affine.copied().all(f64::is_finite) || !determinant.is_finite() || determinant == 0.0 {
        return Err(Error::usage("the map from places to metres cannot be inverted"));
    }
    if let Encoding::Short { origin, step } = content.encoding {
        if format != Format::Glb {
            return usage("coordinates of 16 bits cannot be kept");
        }
        if !origin.iter().all(|o| o.is_finite()) || !step.iter().all(|s| s.is_finite() && *s > 0.0) {
            return Err(Error::usage("the origin and the step of 16-bit coordinates are no numbers above 0"));
        }
    }
    if format == Format::Glb && content.up != Up::Y {
        return usage("z cannot be up");
    }
    if format != Format::Ply && content.has_errors {
        return usage("errors of vertices cannot be kept");
    }
    if format == Format::Stl && content.picture.is_some() {
        return usage("a picture cannot be kept");
    }
    match &content.picture {
        Some(picture) if !["image/jpeg", "image/png"].contains(&picture.mime) => {
            usage("a picture that is neither JPEG nor PNG cannot be kept")
        }
        Some(picture) if !picture.uv.iter().flatten().all(|v| v.is_finite()) => {
            Err(Error::usage("the place of the picture is not finite"))
        }
        _ => Ok(()),
    }
}

impl Writer {
    /// Begins a file.
    ///
    /// # Errors
    /// As [`size`]; [`Error::Exists`] if a file of the name of one of [`super::files`] is there and
    /// `force` is false.
    pub fn create(path: impl Into<PathBuf>, format: Format, content: Content, force: bool) -> Result<Self> {
        let path = path.into();
        size(format, &content).map_err(|error| error.at(&path))?;
        let body: Box<dyn Body + Send> = match format {
            Format::Glb => Box::new(glb::Glb::create(path, &content, force)?),
            Format::Obj => Box::new(obj::Obj::create(path, &content, force)?),
            Format::Ply => Box::new(ply::Ply::create(path, &content, force)?),
            Format::Stl => Box::new(stl::Stl::create(path, &content, force)?),
        };
        let (least, most) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        Ok(Self { content, body, vertices: 0, triangles: 0, least, most })
    }

    /// What a reader of the file gets back for a place: metres, (east, north, up), after all
    /// rounding. It is not finite where the format cannot hold the place.
    ///
    /// Of GLB it is what the node makes of the kept numbers in 64-bit arithmetic: the products of a
    /// row added in the order of the axes, then the translation.
    pub fn stored(&self, place: [f64; 3]) -> [f64; 3] {
        self.body.stored(&self.content, place)
    }

    /// Writes vertices, which are numbered from 0 as they come.
    ///
    /// # Errors
    /// [`Error::Usage`] for more than announced, and for a place outside the announced bounds or
    /// that the format cannot hold.
    pub fn vertices(&mut self, vertices: &[Vertex]) -> Result<()> {
        self.vertices += vertices.len() as u64;
        if self.vertices > self.content.vertices {
            return Err(Error::usage(format!(
                "{} vertices were announced, and {} came",
                self.content.vertices, self.vertices
            )));
        }
        let (low, high) = self.content.bounds;
        for vertex in vertices {
            for (axis, &value) in vertex.place.iter().enumerate() {
                if !(low[axis]..=high[axis]).contains(&value) {
                    return Err(outside(vertex.place));
                }
                self.least[axis] = self.least[axis].min(value);
                self.most[axis] = self.most[axis].max(value);
            }
            if !self.stored(vertex.place).iter().all(|value| value.is_finite()) {
                return Err(outside(vertex.place));
            }
        }
        self.body.vertices(&self.content, vertices)
    }

    /// Writes triangles, after all vertices.
    ///
    /// # Errors
    /// [`Error::Usage`] for more than announced, before all vertices, and for a vertex that there
    /// is not.
    pub fn triangles(&mut self, triangles: &[[u32; 3]]) -> Result<()> {
        self.triangles += triangles.len() as u64;
        if self.vertices != self.content.vertices || self.triangles > self.content.triangles {
            return Err(self.wrong_counts());
        }
        let is_missing = |index: &&u32| u64::from(**index) >= self.content.vertices;
        if let Some(index) = triangles.iter().flatten().find(is_missing) {
            return Err(Error::usage(format!("vertex {index} of {} in a triangle", self.content.vertices)));
        }
        self.body.triangles(triangles)
    }

    /// Completes the files and gives them their names; returns the bytes of the mesh's own.
    ///
    /// # Errors
    /// [`Error::Usage`] for fewer vertices or triangles than announced, if the announced bounds are
    /// not those of what came, or if a file of the name has appeared meanwhile.
    pub fn finish(self) -> Result<u64> {
        if self.vertices != self.content.vertices || self.triangles != self.content.triangles {
            return Err(self.wrong_counts());
        }
        if (self.least, self.most) != self.content.bounds {
            let (least, most) = self.content.bounds;
            return Err(Error::usage(format!(
                "places of {least:?} to {most:?} were announced, and {:?} to {:?} came",
                self.least, self.most
            )));
        }
        self.body.finish(&self.content)
    }

    fn wrong_counts(&self) -> Error {
        Error::usage(format!(
            "{} vertices and {} triangles after them were announced, and {} and {} came",
            self.content.vertices, self.content.triangles, self.vertices, self.triangles
        ))
    }
}

fn outside(place: [f64; 3]) -> Error {
    Error::usage(format!("a vertex at {place:?} is outside of what was announced or can be kept"))
}
