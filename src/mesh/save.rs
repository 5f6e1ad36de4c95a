//! A mesh of a file, written as GLB, OBJ, PLY or STL: in metres, and with what it promises.

use std::path::Path;

use serde_json::{Value, json};

use super::budget::error_for;
use super::made::{Made, Method, Wish};
use super::placing::Placing;
use super::terrain::Extent;
use crate::container::Reader;
use crate::error::{Error, Result};
use crate::mesh_file::{Content, Format, Up, Vertex, Writer};
use crate::progress::{Progress, Stage};
use crate::rect::Rect;

/// Least angle of free triangles in degrees, unless another is asked for.
pub const LEAST_ANGLE: f64 = 5.0;

/// The coordinates of a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Frame {
    /// Metres east, north and up; the origin is the sample in the middle of the window, at height
    /// 0. A column and a row have the metres that they have there.
    #[default]
    Local,
    /// The coordinates of the file's coordinate system, and heights in metres.
    Crs,
}

impl Frame {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Local => "local",
            Self::Crs => "crs",
        }
    }
}

/// How exact a mesh is to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// Its surface is off by at most so many metres, anywhere.
    Error(f64),
    /// It has at most so many triangles, and the least error for them.
    Triangles(u64),
}

/// What to make a mesh of, and how.
#[derive(Clone, Debug)]
pub struct MeshOptions {
    /// The part of the raster; `None` for all of it.
    pub window: Option<Rect>,
    /// How exact it is to be.
    pub target: Target,
    /// How its triangles are found.
    pub method: Method,
    /// Coordinates.
    pub frame: Frame,
    /// The axis that is up; `None` for what is usual in the format.
    pub up: Option<Up>,
    /// Keep coordinates in 16 bits (GLB): columns and rows stay exact.
    pub quantise: bool,
    /// Bytes of memory that free triangles keep within, or are refused; `None`: no limit.
    pub memory: Option<u64>,
    /// Replace a file of the name.
    pub force: bool,
}

impl MeshOptions {
    /// The mesh of a whole file, off by at most `error_m` metres.
    pub fn new(error_m: f64) -> Self {
        let target = Target::Error(error_m);
        Self {
            window: None,
            target,
            method: Method::Free(LEAST_ANGLE),
            frame: Frame::Local,
            up: None,
            quantise: false,
            memory: None,
            force: false,
        }
    }
}

/// What a mesh that has been written is.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshReport {
    /// Its part of the raster.
    pub window: Rect,
    /// Triangles.
    pub triangles: u64,
    /// Vertices.
    pub vertices: u64,
    /// What the surface in the file is off by at most, in metres.
    pub promised_m: f64,
    /// Bytes of the file.
    pub bytes: u64,
}

/// Makes a mesh of a file and writes it; the ending of the name says the format.
///
/// # Errors
/// [`Error::Usage`] for options that do not fit the file or the format, and if the format cannot
/// hold the mesh or keep its promise.
pub fn save(
    reader: &Reader,
    output: &Path,
    options: &MeshOptions,
    progress: &dyn Progress,
) -> Result<MeshReport> {
    let format = Format::of(output)?;
    if format == Format::Glb && options.up == Some(Up::Z) {
        return Err(Error::usage("y is up in a GLB file, always"));
    }
    let window = Extent::of(reader.header(), options.window.as_ref())?.rect();
    let placing = Placing::new(reader, &window, options, format)?;
    let wish = Wish { reader, window: &window, method: options.method, memory: options.memory };
    // What the coordinates of the file are rounded by is taken from the tolerance. It is measured,
    // for whole numbers often need no rounding, and what rounded columns and rows do depends on
    // slopes.
    let mut rounding = placing.rounding_m;
    let found = match options.target {
        Target::Error(_) => None,
        Target::Triangles(most) => Some(error_for(wish, most, progress)?),
    };
    for _ in 0..4 {
        let kept = match (options.target, found) {
            (Target::Error(error), _) => error - rounding,
            (Target::Triangles(_), found) => found.unwrap_or_default(),
        };
        if kept < 0.0 {
            return Err(too_coarse(output, rounding));
        }
        let mesh = Made::new(wish, kept, progress)?;
        if mesh.triangle_count() == 0 {
            return Err(Error::usage(format!(
                "{}: there is no valid sample in the window, so there is no mesh",
                reader.path().display()
            )));
        }
        let promised = mesh.promised_m() + rounding;
        let Some(measured) = write(&mesh, output, (format, &placing), options, promised, rounding, progress)?
        else {
            return Ok(MeshReport {
                window: window.clone(),
                triangles: mesh.triangle_count(),
                vertices: mesh.vertex_count(),
                promised_m: promised,
                bytes: std::fs::metadata(output).map_err(|error| Error::io(output, "read", error))?.len(),
            });
        };
        rounding = 1.25 * measured;
    }
    Err(too_coarse(output, rounding))
}

fn too_coarse(output: &Path, rounding: f64) -> Error {
    Error::usage(format!(
        "{}: its numbers round the surface by up to {rounding} m, so it cannot promise less; \
         allow a larger error, take a window, or write PLY",
        output.display()
    ))
}

/// Writes a mesh. If its coordinates are rounded by more than `rounding`, nothing is written, and
/// that is returned.
fn write(
    mesh: &Made<'_>,
    output: &Path,
    (format, placing): (Format, &Placing),
    options: &MeshOptions,
    promised_m: f64,
    rounding: f64,
    progress: &dyn Progress,
) -> Result<Option<f64>> {
    let content = content(mesh, placing, (format, options), promised_m)?;
    let mut writer = Writer::create(output, format, content, options.force)?;
    let total = mesh.vertex_count();
    let mut done = 0;
    // STL rounds columns and rows, too: then what that does to each triangle is measured.
    let mut places: Vec<[f64; 3]> = Vec::new();
    let mut buffer = Vec::new();
    let mut worst = 0.0_f64;
    mesh.each_vertex(&mut |piece| {
        buffer.clear();
        buffer.extend(piece.iter().map(|&place| Vertex { place: placing.place(place), ..Vertex::default() }));
        if format == Format::Stl {
            places.extend(buffer.iter().map(|vertex| vertex.place));
        }
        for vertex in &buffer {
            // Columns and rows are exact but in STL.
            let exact = placing.map.apply(vertex.place);
            worst = worst.max((writer.stored(vertex.place)[2] - exact[2]).abs());
        }
        writer.vertices(&buffer)?;
        done += piece.len() as u64;
        progress.step(Stage::Write, done, total)
    })?;
    if worst > rounding {
        return Ok(Some(worst));
    }
    let mut turned = Vec::new();
    mesh.each_triangle(
        &mut |triangles| {
            if format == Format::Stl {
                for triangle in triangles {
                    worst = worst.max(tilt(&writer, placing, triangle.map(|at| places[at as usize])));
                }
            }
            if placing.turns {
                turned.clear();
                turned.extend(triangles.iter().map(|&[a, b, c]| [a, c, b]));
                return writer.triangles(&turned);
            }
            writer.triangles(triangles)
        },
        progress,
    )?;
    if worst > rounding {
        return Ok(Some(worst));
    }
    writer.finish()?;
    Ok(None)
}

/// What the file will hold.
fn content(
    mesh: &Made<'_>,
    placing: &Placing,
    (format, options): (Format, &MeshOptions),
    promised_m: f64,
) -> Result<Content> {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    mesh.each_vertex(&mut |places| {
        for place in places {
            let place = placing.place(*place);
            for axis in 0..3 {
                low[axis] = low[axis].min(place[axis]);
                high[axis] = high[axis].max(place[axis]);
            }
        }
        Ok(())
    })?;
    Ok(Content {
        vertices: mesh.vertex_count(),
        triangles: mesh.triangle_count(),
        map: placing.map,
        encoding: placing.encoding,
        up: options.up.unwrap_or(if format == Format::Glb { Up::Y } else { Up::Z }),
        has_normals: false,
        has_errors: false,
        picture: None,
        bounds: (low, high),
        about: about(mesh, placing, options, promised_m),
        generator: format!("relevo {}", env!("CARGO_PKG_VERSION")),
    })
}

/// Metres by which rounding its corners moves the plane of a triangle, at most: what a rounded
/// corner is off the plane of the others.
fn tilt(writer: &Writer, placing: &Placing, corners: [[f64; 3]; 3]) -> f64 {
    let exact = corners.map(|place| placing.map.apply(place));
    let [a, b, c] = exact;
    let (u, v) = ([b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]]);
    let area = u[0] * v[1] - u[1] * v[0];
    let slope = [(u[2] * v[1] - u[1] * v[2]) / area, (u[0] * v[2] - u[2] * v[0]) / area];
    let off = |(place, exact): ([f64; 3], [f64; 3])| {
        let stored = writer.stored(place);
        let sideways = slope[0] * (stored[0] - exact[0]) + slope[1] * (stored[1] - exact[1]);
        (stored[2] - exact[2] - sideways).abs()
    };
    corners.into_iter().zip(exact).map(off).fold(0.0, f64::max)
}

/// What a mesh file says of itself.
fn about(mesh: &Made<'_>, placing: &Placing, options: &MeshOptions, promised_m: f64) -> Value {
    let reader = mesh.reader();
    let Rect { columns, rows } = mesh.window();
    let (x, y) = reader.geo().world_from_sample(placing.origin.0, placing.origin.1);
    let crs = &reader.geo().crs;
    json!({ "relevo": {
        "frame": options.frame.name(),
        "to_frame": { "matrix": placing.whole.matrix, "offset": placing.whole.offset },
        "window": [columns.start, rows.start, columns.len(), rows.len()],
        "max_error_m": promised_m,
        "solid": false,
        "origin": { "column": placing.origin.0, "row": placing.origin.1, "x": x, "y": y },
        "crs": { "name": crs.name, "epsg": crs.epsg },
    } })
}
