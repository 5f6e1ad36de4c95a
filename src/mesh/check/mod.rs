//! An exact check of any triangle mesh against the terrain, by code that shares nothing with the
//! builders.
//!
//! The truth is the surface of full resolution (section 2 of the specification). Where a triangle
//! of the mesh lies over a shown triangle of it, the difference of the two heights is linear, so it
//! is largest at a corner of what the two have in common. The corners are
//!
//! - valid samples within the mesh triangle, and vertices of the mesh;
//! - crossings of mesh edges with the edges of the surface, which lie on four families of lines:
//!   `x = i`, `y = j`, `x - y` even, `x + y` even;
//! - beside voids, the middles of edges between a valid and a void sample, through which the
//!   outline runs, and crossings of mesh edges with the outline.
//!
//! All of them are looked at. Nothing is compared where there is no mesh, or no terrain.
//!
//! **Rounding.** Places and heights are f64. A corner is looked at in a place that is off by a few
//! roundings of its coordinates, and its heights by a few roundings of theirs: with `s` the largest
//! coordinate in samples and `h` the largest height, each result is off by at most
//! `2^-50 (1 + s) h` ([`Report::rounding_m`]), some 1e-11 of `h` at 16 385 samples. Inside of
//! triangles that are narrower than a thousandth of a sample it may be more, but not on their
//! edges, which are that near to any place inside.

mod blocks;
mod edge;
mod found;
mod ground;
mod heights;
mod report;
mod shape;
#[cfg(test)]
mod tests;
mod triangle;

pub use heights::{Heights, Leaves, Raster};
pub use report::{Allowed, Options, Report};

use rayon::prelude::*;

use self::blocks::{Block, Grid};
use self::found::{Found, Marks};
use self::ground::Ground;
use self::shape::{Kind, Shapes};
use crate::error::{Error, Result};
use crate::progress::{Progress, Stage};
use crate::rect::Rect;

/// Columns of samples that are read at a time, about.
const SLAB: u32 = 16_384;

/// Compares a mesh with the terrain. Vertices are column, row and height in metres; a triangle
/// faces up if its corners are counter-clockwise seen from above, rows counting southward.
///
/// Meshes with coordinates that are no numbers or too large, or with corners that are not there,
/// are refused. The result is the same, bit for bit, on any number of threads.
pub fn check(
    vertices: &[[f64; 3]],
    triangles: &[[u32; 3]],
    heights: &dyn Heights,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Report> {
    let shapes = Shapes::of(vertices, triangles)?;
    let window = window(&shapes, heights, options)?;
    let grid = Grid::new(window.clone(), options.block, options.near);
    let mesh = Mesh { vertices, triangles, kinds: &shapes.kinds };
    let lists = grid.lists(&mesh)?;
    let slabs = grid.slabs(SLAB);
    let mut found = Found::default();
    let mut next = slabs.first().map(|slab| Ground::read(heights, slab)).transpose()?;
    for (done, slab) in slabs.iter().enumerate() {
        progress.step(Stage::Source, done as u64, slabs.len() as u64)?;
        let Some(ground) = next.take() else { break };
        let (here, read) = rayon::join(
            || compare(&mesh, &grid, slab, &ground, &lists),
            || slabs.get(done + 1).map(|slab| Ground::read(heights, slab)).transpose(),
        );
        found = found.and(here);
        next = read?;
    }
    progress.step(Stage::Source, slabs.len() as u64, slabs.len() as u64)?;
    Ok(report::report(&shapes, &found, &window, heights.size(), (vertices.len(), options.near)))
}

/// A mesh, and what each of its triangles is.
struct Mesh<'a> {
    vertices: &'a [[f64; 3]],
    triangles: &'a [[u32; 3]],
    kinds: &'a [Kind],
}

impl Mesh<'_> {
    /// The corners of a triangle. Shapes have been made of all: their corners exist.
    fn corners(&self, triangle: usize) -> [[f64; 3]; 3] {
        self.triangles[triangle].map(|vertex| self.vertices[vertex as usize])
    }
}

/// What the blocks of a slab find.
fn compare(mesh: &Mesh, grid: &Grid, slab: &blocks::Slab, ground: &Ground, lists: &blocks::Lists) -> Found {
    let of_block = |marks: &mut Marks, number: usize| {
        let block = Block::new(grid, number, ground);
        marks.clear(&block);
        let mut found = Found::default();
        for &triangle in lists.of(number) {
            triangle::compare(mesh.corners(triangle as usize), &block, marks, &mut found);
        }
        marks.count(&block, &mut found);
        found
    };
    let blocks = slab.blocks.clone().into_par_iter();
    blocks.map_init(Marks::default, of_block).reduce(Found::default, Found::and)
}

/// The samples to be covered: those that are asked for, else those under the mesh.
fn window(shapes: &Shapes, heights: &dyn Heights, options: &Options) -> Result<Rect> {
    let [width, height] = heights.size();
    if let Some(window) = &options.window {
        if window.is_empty() || window.columns.end > width || window.rows.end > height {
            return Err(Error::usage(format!(
                "the window {window} (west, north, east, south) does not lie within the raster of {width} x {height} samples"
            )));
        }
        return Ok(window.clone());
    }
    // Outlines run half a sample from the next valid one; beyond that a side belongs to the next.
    let side = |axis: usize, size: u32| {
        let first = (shapes.least[axis] - 0.501).ceil().max(0.0);
        let end = (shapes.most[axis] + 0.501).floor().min(f64::from(size) - 1.0) + 1.0;
        (first < end).then_some(first as u32..end as u32)
    };
    let (columns, rows) = (side(0, width), side(1, height));
    columns.zip(rows).map(|(columns, rows)| Rect { columns, rows }).ok_or_else(|| {
        let ([west, north], [east, south]) = (shapes.least, shapes.most);
        Error::usage(format!(
            "the mesh does not lie over the raster of {width} x {height} samples: it has columns {west} to {east} and rows {north} to \
             {south}; is it in another frame?"
        ))
    })
}
