//! What to check, and what was found.

use super::found::Found;
use super::shape::Shapes;
use crate::rect::Rect;

/// What to check of a mesh, and how.
#[derive(Clone, Debug)]
pub struct Options {
    /// Samples that have to be covered; nothing is compared beyond them. `None`: those under the
    /// bounding box of the mesh.
    pub window: Option<Rect>,
    /// A sample counts as covered if it is at most so many columns and rows away from a triangle
    /// (1e-6).
    pub near: f64,
    /// Side in samples of the blocks that are checked at a time (256). The result does not depend
    /// on it.
    pub block: u32,
}

impl Default for Options {
    fn default() -> Self {
        Self { window: None, near: 1e-6, block: 256 }
    }
}

/// What a sound mesh may have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Allowed {
    /// Triangles that face down or are upright, as the floor and the walls of a solid do.
    pub solid: bool,
    /// Triangles that reach out of the window, as those of a mesh of which a part is checked do.
    pub outside: bool,
}

/// What is true of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Triangles of the mesh.
    pub triangles: u64,
    /// Vertices of the mesh.
    pub vertices: u64,
    /// The samples to be covered.
    pub window: Rect,
    /// Largest vertical distance of mesh and terrain, between samples too, in metres.
    pub largest_m: f64,
    /// Column and row where that is; the northernmost place, then the westernmost, if there are
    /// several. `[0, 0]` if nothing was compared.
    pub at: [f64; 2],
    /// Largest vertical distance at a sample, in metres.
    pub largest_at_samples_m: f64,
    /// Root of the mean square of the vertical distances at valid samples, in metres.
    pub rmse_m: f64,
    /// What rounding can have done to a distance at most, in metres.
    pub rounding_m: f64,
    /// Valid samples in the window.
    pub samples: u64,
    /// Samples that the mesh was compared at.
    pub compared: u64,
    /// Valid samples without a triangle.
    pub uncovered: u64,
    /// Column and row of the first of them, row by row from the north.
    pub first_uncovered: Option<[u32; 2]>,
    /// Void samples with a triangle.
    pub covered_voids: u64,
    /// Samples inside more than one triangle, their sides left out.
    pub twice: u64,
    /// Triangles that face down. They are not compared.
    pub flipped: u64,
    /// Triangles without area seen from above, but not in space. They are not compared.
    pub vertical: u64,
    /// Triangles without area. They are not compared.
    pub degenerate: u64,
    /// Vertices that no triangle has.
    pub unused_vertices: u64,
    /// Triangles that reach out of the window.
    pub outside: u64,
    /// Smallest angle of the triangles that face up, in columns and rows; 180 if there are none.
    pub smallest_angle_deg: f64,
}

impl Report {
    /// True if the mesh covers each valid sample of the window once, and no void, and all its
    /// triangles have an area, face up and lie in the window, but for what is allowed.
    pub fn is_sound(&self, allowed: Allowed) -> bool {
        let of_all = self.uncovered + self.covered_voids + self.twice + self.degenerate;
        let of_sheets = if allowed.solid { 0 } else { self.flipped + self.vertical };
        let of_whole = if allowed.outside { 0 } else { self.outside };
        of_all + of_sheets + of_whole == 0 && self.compared > 0
    }

    /// True if no distance is above what was promised, but for rounding.
    pub fn keeps(&self, promised_m: f64) -> bool {
        self.largest_m <= promised_m + self.rounding_m
    }
}

/// The report of a mesh with so many vertices, whose window lies in a raster of a size.
pub(super) fn report(
    shapes: &Shapes,
    found: &Found,
    window: &Rect,
    size: [u32; 2],
    (vertices, near): (usize, f64),
) -> Report {
    let side = shapes
        .least
        .iter()
        .chain(&shapes.most)
        .fold(f64::from(size[0].max(size[1])), |side, v| side.max(v.abs()));
    let tallest = shapes.tallest.max(found.tallest);
    let mean = if found.compared == 0 { 0.0 } else { found.mean_square() };
    Report {
        triangles: shapes.kinds.len() as u64,
        vertices: vertices as u64,
        window: window.clone(),
        largest_m: found.largest.metres,
        at: found.largest.place(),
        largest_at_samples_m: found.largest_at_samples,
        rmse_m: mean.sqrt(),
        rounding_m: (1.0 + side) * tallest / f64::from(1_u32 << 25).powi(2),
        samples: found.samples,
        compared: found.compared,
        uncovered: found.uncovered,
        first_uncovered: found.first_uncovered.map(|[row, column]| [column, row]),
        covered_voids: found.covered_voids,
        twice: found.twice,
        flipped: shapes.flipped,
        vertical: shapes.vertical,
        degenerate: shapes.degenerate,
        unused_vertices: shapes.unused,
        outside: shapes.outside(window, near),
        smallest_angle_deg: shapes.smallest_angle_deg,
    }
}
