//! What each triangle of a mesh is, before any terrain: up, down, upright or nothing.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::rect::Rect;

/// Largest size of a coordinate: a column or row of any raster is far below.
const LARGEST: f64 = 1e12;
/// A triangle that is no wider, in samples, has no area seen from above.
const NARROW: f64 = 1e-9;

/// What a triangle is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// It faces up.
    Up,
    /// It faces down.
    Flipped,
    /// It has no area seen from above.
    Vertical,
    /// It has no area.
    Degenerate,
}

/// What all triangles are.
pub(super) struct Shapes<'a> {
    pub kinds: Vec<Kind>,
    pub flipped: u64,
    pub vertical: u64,
    pub degenerate: u64,
    /// Vertices that no triangle has.
    pub unused: u64,
    /// Least column and row of a vertex that a triangle has.
    pub least: [f64; 2],
    /// Largest column and row.
    pub most: [f64; 2],
    /// Largest size of a height.
    pub tallest: f64,
    pub smallest_angle_deg: f64,
    vertices: &'a [[f64; 3]],
    triangles: &'a [[u32; 3]],
}

impl<'a> Shapes<'a> {
    /// Looks at all triangles. Fails if a vertex is out of bounds, or a corner is not there.
    pub fn of(vertices: &'a [[f64; 3]], triangles: &'a [[u32; 3]]) -> Result<Self> {
        let is_wrong = |vertex: &[f64; 3]| !vertex.iter().all(|v| v.abs() <= LARGEST);
        if let Some(vertex) = vertices.par_iter().position_first(is_wrong) {
            let [x, y, z] = vertices[vertex];
            let expected = format!("column, row and height of at most {LARGEST:e}");
            return Err(Error::format(
                format!("vertex {vertex} of the mesh"),
                expected,
                format!("{x}, {y}, {z}"),
            ));
        }
        let is_wrong = |triangle: &[u32; 3]| triangle.iter().any(|&vertex| vertex as usize >= vertices.len());
        if let Some(triangle) = triangles.par_iter().position_first(is_wrong) {
            let place = format!("triangle {triangle} of the mesh");
            let [a, b, c] = triangles[triangle];
            return Err(Error::format(
                place,
                format!("corners below {}", vertices.len()),
                format!("{a}, {b}, {c}"),
            ));
        }
        if triangles.is_empty() {
            return Err(Error::format("the mesh", "triangles", "none"));
        }
        if u32::try_from(triangles.len()).is_err() {
            return Err(Error::limit("the number of triangles", triangles.len() as u64, u32::MAX.into()));
        }
        let of = |triangle: &[u32; 3]| kind(triangle.map(|vertex| vertices[vertex as usize]));
        let (kinds, angles): (Vec<Kind>, Vec<f32>) = triangles.par_iter().map(of).unzip();
        let count = |kind: Kind| kinds.par_iter().filter(|&&of| of == kind).count() as u64;
        let (flipped, vertical, degenerate) =
            (count(Kind::Flipped), count(Kind::Vertical), count(Kind::Degenerate));
        let mut is_used = vec![false; vertices.len()];
        triangles.iter().flatten().for_each(|&vertex| is_used[vertex as usize] = true);
        let used = || vertices.iter().zip(&is_used).filter(|(_, used)| **used).map(|(vertex, _)| vertex);
        let of_axis = |axis: usize| {
            let ends = (f64::INFINITY, f64::NEG_INFINITY);
            used().fold(ends, |(least, most), vertex| (least.min(vertex[axis]), most.max(vertex[axis])))
        };
        let [x, y, z] = [0, 1, 2].map(of_axis);
        Ok(Self {
            flipped,
            vertical,
            degenerate,
            unused: is_used.iter().filter(|used| !**used).count() as u64,
            least: [x.0, y.0],
            most: [x.1, y.1],
            tallest: z.0.abs().max(z.1.abs()),
            smallest_angle_deg: f64::from(angles.into_iter().fold(180.0, f32::min)),
            kinds,
            vertices,
            triangles,
        })
    }

    /// Triangles that reach more than `near` out of a window.
    pub fn outside(&self, window: &Rect, near: f64) -> u64 {
        let within = |range: &std::ops::Range<u32>, v: f64| {
            (f64::from(range.start) - near..=f64::from(range.end) - 1.0 + near).contains(&v)
        };
        let is_outside = |triangle: &&[u32; 3]| {
            let mut corners = triangle.iter().map(|&vertex| self.vertices[vertex as usize]);
            !corners.all(|[x, y, _]| within(&window.columns, x) && within(&window.rows, y))
        };
        self.triangles.par_iter().filter(is_outside).count() as u64
    }
}

/// What a triangle is, and its smallest angle in degrees seen from above, 180 unless it faces up.
fn kind(corners: [[f64; 3]; 3]) -> (Kind, f32) {
    let [a, b, c] = corners;
    let minus = |p: [f64; 3], q: [f64; 3]| [0, 1, 2].map(|axis| p[axis] - q[axis]);
    let (u, v, w) = (minus(b, a), minus(c, a), minus(c, b));
    let flat = |p: [f64; 3]| p[0].hypot(p[1]);
    let cross = u[0] * v[1] - u[1] * v[0];
    let longest = flat(u).max(flat(v)).max(flat(w));
    if cross.abs() > NARROW * longest {
        // Rows run south: what is counter-clockwise on a map is clockwise in columns and rows.
        let is_up = cross < 0.0;
        return if is_up { (Kind::Up, smallest_angle([u, v, w], cross)) } else { (Kind::Flipped, 180.0) };
    }
    let (across, down) = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2]);
    let long = |p: [f64; 3]| flat(p).hypot(p[2]);
    let is_upright = across.hypot(down) > NARROW * long(u).max(long(v)).max(long(w));
    (if is_upright { Kind::Vertical } else { Kind::Degenerate }, 180.0)
}

/// The angle opposite to the shortest side, in degrees.
fn smallest_angle([u, v, w]: [[f64; 3]; 3], cross: f64) -> f32 {
    let dot = |p: [f64; 3], q: [f64; 3]| p[0] * q[0] + p[1] * q[1];
    // Sides from a to b and to c, and from b to c.
    let angles = [dot(u, v), -dot(u, w), dot(v, w)].map(|cos| cross.abs().atan2(cos));
    angles.into_iter().fold(f64::INFINITY, f64::min).to_degrees() as f32
}
