//! The nested mesh of a file: the 4-8 mesh (paper 002), which is the restricted quadtree of paper
//! 004, with an exact error for every triangle.
//!
//! It has the vertices whose triangles would be off by more than the tolerance, and those that
//! these need. No triangle of it is off by more: every one waits for a vertex that would split it,
//! and that vertex was found not to be needed. Its triangles are unions of triangles of full
//! resolution, so they are off most at samples, and samples are all that is measured.

use std::collections::HashMap;

use rayon::prelude::*;

use super::cut::{Corner, Point, area, cut_at_outline, cut_at_window, fan};
use super::lookup::Lookup;
use super::marks::{Marks, Numbered, interleave};
use super::needed;
use super::square::{HAS_VALID, HAS_VOID};
use super::terrain::{Extent, Terrain, height_of_number};
use super::triangle;
use super::vertex::Vertex;
use crate::container::Reader;
use crate::error::{Error, Result};
use crate::progress::{Progress, Stage};
use crate::rect::Rect;

/// Triangles and vertices are handed on in pieces of about this many.
const PIECE: usize = 1 << 15;
/// Parts of the lattice, along a side, whose triangles one task makes.
const PARTS: u32 = 32;

/// Three numbers of vertices, counter-clockwise seen from above.
pub type Triangle = [u32; 3];
/// Column, row and height in metres.
pub type Place = [f64; 3];

/// A vertex: column and row, doubled, and the number that is its height.
pub(super) type Doubled = ((u32, u32), f64);

/// The nested mesh of a file, or of a window of it.
pub struct Nested<'a> {
    terrain: Terrain<'a>,
    /// The vertices that split triangles.
    vertices: Numbered,
    /// Those that are corners of triangles that are drawn, if these are fewer.
    drawn: Option<Numbered>,
    /// Points of cuts, in the order of their numbers.
    points: Vec<Point>,
    /// Numbers of the points of cuts.
    point_numbers: HashMap<(u32, u32), u32>,
    /// Triangles that are split further by one task each.
    parts: Vec<[Vertex; 3]>,
    triangle_count: u64,
    has_voids: bool,
}

/// What one task finds.
struct Found {
    triangles: u64,
    drawn: Marks,
    points: Vec<Point>,
}

impl<'a> Nested<'a> {
    /// The mesh of a window (`None`: all of the raster) whose surface is nowhere off by more than
    /// `error_m` metres from the terrain of the file at full resolution, which for a quantised file
    /// counts what its heights were rounded by.
    ///
    /// # Errors
    /// [`Error::Usage`] if the window has no area, the error is less than the file's own, or the
    /// mesh has more vertices than 32 bits can number.
    pub fn new(
        reader: &'a Reader,
        window: Option<&Rect>,
        error_m: f64,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let extent = Extent::of(reader.header(), window)?;
        let terrain = Terrain::new(reader, extent, error_m)?;
        let (marks, kinds) = needed::find(&terrain, progress)?;
        let has_voids = kinds & HAS_VOID != 0;
        let side = terrain.side();
        let vertices = marks.number();
        let parts = parts(&vertices, side, &extent);
        let mut mesh = Self {
            terrain,
            vertices,
            drawn: None,
            points: Vec::new(),
            point_numbers: HashMap::new(),
            parts,
            triangle_count: 0,
            has_voids,
        };
        mesh.count(progress)?;
        if mesh.vertex_count() > u64::from(u32::MAX) {
            return Err(Error::usage(format!(
                "a mesh with an error of {error_m} m has {} vertices, more than 32 bits can number; allow a larger error, or take a window",
                mesh.vertex_count()
            )));
        }
        Ok(mesh)
    }

    /// What its surface is off by at most, in metres: the error that was asked for, or what
    /// rounding takes if that is more.
    pub fn promised_m(&self) -> f64 {
        self.terrain.promised_m
    }

    /// The largest number that a height can be, its sign left out.
    pub(super) fn highest(&self) -> f64 {
        self.terrain.highest
    }

    /// What it is a mesh of.
    pub(super) fn terrain(&self) -> &Terrain<'a> {
        &self.terrain
    }

    /// The file.
    pub fn reader(&self) -> &Reader {
        self.terrain.reader
    }

    /// The part of the raster.
    pub fn window(&self) -> Rect {
        self.terrain.extent.rect()
    }

    /// Vertices of the mesh.
    pub fn vertex_count(&self) -> u64 {
        self.drawn.as_ref().unwrap_or(&self.vertices).len() + self.points.len() as u64
    }

    /// Triangles of the mesh.
    pub fn triangle_count(&self) -> u64 {
        self.triangle_count
    }

    /// True if all samples are drawn and no triangle is cut.
    fn is_plain(&self) -> bool {
        let side = self.terrain.side();
        !self.has_voids && self.terrain.extent == Extent { columns: (0, side), rows: (0, side) }
    }

    /// Counts triangles, and finds the vertices that are drawn and the points of cuts.
    fn count(&mut self, progress: &dyn Progress) -> Result<()> {
        let is_plain = self.is_plain();
        let side = self.terrain.side();
        let total = self.parts.len() as u64;
        let mut drawn = Marks::new(side);
        let mut points: HashMap<(u32, u32), Point> = HashMap::new();
        for (number, parts) in self.parts.chunks(64).enumerate() {
            let found: Vec<Result<Found>> = parts
                .par_iter()
                .map(|&part| {
                    let mut found = Found { triangles: 0, drawn: Marks::new(side), points: Vec::new() };
                    self.draw(part, &mut |corners| {
                        found.triangles += 1;
                        if is_plain {
                            return;
                        }
                        for corner in corners {
                            match corner {
                                Corner::Sample(vertex) => {
                                    found.drawn.add(vertex);
                                }
                                Corner::Cut(point) => found.points.push(point),
                            }
                        }
                    })?;
                    Ok(found)
                })
                .collect();
            for found in found {
                let found = found?;
                self.triangle_count += found.triangles;
                drawn.join(found.drawn);
                points.extend(found.points.into_iter().map(|point| (point.doubled, point)));
            }
            progress.step(Stage::Triangles, (64 * number as u64).min(total), 2 * total)?;
        }
        if is_plain {
            return Ok(());
        }
        let drawn = drawn.number();
        let mut points: Vec<Point> = points.into_values().collect();
        points.sort_unstable_by_key(|point| (interleave(point.doubled.0, point.doubled.1), point.doubled));
        let numbers = points.iter().zip(drawn.len()..);
        self.point_numbers = numbers.map(|(point, number)| (point.doubled, number as u32)).collect();
        (self.points, self.drawn) = (points, Some(drawn));
        Ok(())
    }

    /// Hands on the vertices, in the order of their numbers.
    pub fn each_vertex(&self, out: &mut dyn FnMut(&[Place]) -> Result<()>) -> Result<()> {
        let header = self.terrain.reader.header();
        let mut places = Vec::with_capacity(PIECE);
        self.each_point(&mut |points| {
            places.clear();
            places.extend(points.iter().map(|&((x, y), number)| {
                [f64::from(x) / 2.0, f64::from(y) / 2.0, height_of_number(header, number)]
            }));
            out(&places)
        })
    }

    /// Hands on the vertices, in the order of their numbers, as numbers.
    pub(super) fn each_point(&self, out: &mut dyn FnMut(&[Doubled]) -> Result<()>) -> Result<()> {
        let mut lookup = Lookup::new(&self.terrain);
        let mut piece = Vec::with_capacity(PIECE);
        for vertex in self.drawn.as_ref().unwrap_or(&self.vertices).vertices() {
            let number = lookup.number(vertex, (i64::MAX, i64::MAX))?;
            piece.push(((2 * vertex.x, 2 * vertex.y), number));
            if piece.len() == PIECE {
                out(&piece)?;
                piece.clear();
            }
        }
        for point in &self.points {
            let sum =
                |part: fn(&Vertex) -> u32| point.of.iter().map(|vertex| i64::from(part(vertex))).sum::<i64>();
            // Samples of a triangle lie in one tile: that on the side of its middle.
            let toward = (2 * sum(|vertex| vertex.x) / 3, 2 * sum(|vertex| vertex.y) / 3);
            let mut number = 0.0;
            for (&vertex, weight) in point.of.iter().zip(point.weights) {
                if weight != 0.0 {
                    number += weight * lookup.number(vertex, toward)?;
                }
            }
            piece.push((point.doubled, number));
            if piece.len() == PIECE {
                out(&piece)?;
                piece.clear();
            }
        }
        if piece.is_empty() { Ok(()) } else { out(&piece) }
    }

    /// Hands on the triangles, always in the same order.
    pub fn each_triangle(
        &self,
        out: &mut dyn FnMut(&[Triangle]) -> Result<()>,
        progress: &dyn Progress,
    ) -> Result<()> {
        let total = self.parts.len() as u64;
        for (number, parts) in self.parts.chunks(2 * rayon::current_num_threads()).enumerate() {
            let made: Vec<Result<Vec<Triangle>>> = parts
                .par_iter()
                .map(|&part| {
                    let mut triangles = Vec::new();
                    self.draw(part, &mut |corners| {
                        triangles.push(corners.map(|corner| self.number_of(&corner)));
                    })?;
                    Ok(triangles)
                })
                .collect();
            for triangles in made {
                out(&triangles?)?;
            }
            let done = (number as u64 + 1) * 2 * rayon::current_num_threads() as u64;
            progress.step(Stage::Triangles, total + done.min(total), 2 * total)?;
        }
        Ok(())
    }

    /// The number of a corner of a triangle that is drawn.
    fn number_of(&self, corner: &Corner) -> u32 {
        match corner {
            Corner::Sample(vertex) => {
                let number = self.drawn.as_ref().unwrap_or(&self.vertices).number_of(*vertex);
                number.unwrap_or_default() as u32
            }
            Corner::Cut(point) => self.point_numbers.get(&point.doubled).copied().unwrap_or_default(),
        }
    }

    /// Draws the triangles of the mesh in a triangle.
    fn draw(&self, part: [Vertex; 3], out: &mut dyn FnMut([Corner; 3])) -> Result<()> {
        let extent = &self.terrain.extent;
        let mut lookup = Lookup::new(&self.terrain);
        let mut stack = vec![part];
        while let Some(corners) = stack.pop() {
            if is_outside(corners, extent) {
                continue;
            }
            let [a, apex, b] = corners;
            if let Some(middle) = split(&self.vertices, a, b) {
                stack.push([b, middle, apex]);
                stack.push([apex, middle, a]);
                continue;
            }
            let corners = upward(corners);
            let mut kinds = [HAS_VALID; 3];
            if self.has_voids {
                for (kind, &corner) in kinds.iter_mut().zip(&corners) {
                    *kind = lookup.kind(corner)?;
                }
            }
            if kinds == [HAS_VALID; 3] {
                if corners.iter().all(|&corner| extent.contains(corner)) {
                    out(corners.map(Corner::Sample));
                } else {
                    fan(&cut_at_window(corners, extent)).for_each(&mut *out);
                }
            } else if kinds != [HAS_VOID; 3] {
                fan(&cut_at_outline(corners, kinds)).for_each(&mut *out);
            }
        }
        Ok(())
    }
}

/// The midpoint of a longest side, if it is in the mesh.
fn split(vertices: &Numbered, a: Vertex, b: Vertex) -> Option<Vertex> {
    let far = a.x.abs_diff(b.x).max(a.y.abs_diff(b.y));
    (far >= 2).then(|| a.middle(b)).filter(|&middle| vertices.contains(middle))
}

/// The corners of a triangle counter-clockwise seen from above (rows run south).
fn upward([a, b, c]: [Vertex; 3]) -> [Vertex; 3] {
    let [p, q, r] = [a, b, c].map(|corner| Corner::Sample(corner).doubled());
    if area(p, q, r) > 0 { [a, c, b] } else { [a, b, c] }
}

/// True if a triangle has no area in the window.
fn is_outside(corners: [Vertex; 3], extent: &Extent) -> bool {
    let corners = corners.map(|corner| (i64::from(corner.x), i64::from(corner.y)));
    !extent.meets(&triangle::Triangle { corners, heights: [0.0; 3] })
}

/// The triangles of the lattice that one task draws each, in order.
fn parts(vertices: &Numbered, side: u32, extent: &Extent) -> Vec<[Vertex; 3]> {
    let at = Vertex::new;
    let least = (side / PARTS).max(256);
    let mut stack = vec![[at(side, side), at(0, side), at(0, 0)], [at(0, 0), at(side, 0), at(side, side)]];
    let mut parts = Vec::new();
    while let Some([a, apex, b]) = stack.pop() {
        if is_outside([a, apex, b], extent) {
            continue;
        }
        let far = a.x.abs_diff(b.x).max(a.y.abs_diff(b.y));
        match split(vertices, a, b).filter(|_| far > least) {
            Some(middle) => {
                stack.push([b, middle, apex]);
                stack.push([apex, middle, a]);
            }
            None => parts.push([a, apex, b]),
        }
    }
    parts
}
