//! Measures vertices against the surface drawn over them, a block at a time.

use std::ops::Range;

use super::drawn::{Sheet, Tile, Window};
use super::leaves::{Leaf, Walk, heights};
use super::outline::Outline;
use super::{Observed, PatchError};
use crate::container::Reader;
use crate::error::Result;
use crate::select::pattern::Meshes;
use crate::select::view::{Box3, Frame, View};
use crate::tile::TileId;

/// Vertices on a side of a block.
const SIDE: i64 = 32;

/// A vertex that is misdrawn and was measured.
#[derive(Clone, Copy)]
struct Known {
    vertex: [i64; 2],
    metres: f64,
}

/// The content of a block.
struct Content {
    low: f64,
    high: f64,
    /// Largest difference of heights in metres.
    off: f64,
    vertices: u64,
    misdrawn: u64,
}

/// The measurement of one tile of the selection.
pub(super) struct Work<'a> {
    tile: Tile,
    outline: Outline<'a>,
    meshes: &'a Meshes,
    frame: &'a Frame,
    view: &'a View,
    sheet: Sheet,
    truth: Vec<f64>,
    observed: Observed,
    /// The largest error of each patch; below 0 if none of its vertices is in the view.
    largest: Vec<f64>,
    /// The last misdrawn vertex measured, and the last ones by column modulo [`SIDE`]: their
    /// distances bound those of their neighbours.
    known: [Option<Known>; SIDE as usize + 1],
}

/// One leaf under one patch.
struct Place {
    patch: usize,
    /// First sample of the leaf.
    origin: [i64; 2],
    /// Samples from one vertex to the next.
    spacing: i64,
    /// Vertices in a row of the leaf.
    row: usize,
}

impl<'a> Work<'a> {
    pub fn new(
        outline: Outline<'a>,
        tile: Tile,
        meshes: &'a Meshes,
        frame: &'a Frame,
        view: &'a View,
    ) -> Self {
        let n = (tile.m * tile.patch) as usize;
        let largest = vec![-1.0; tile.patches.len()];
        let (sheet, truth, observed) = (Sheet::new(n), Vec::new(), Observed::default());
        Self {
            tile,
            outline,
            meshes,
            frame,
            view,
            sheet,
            truth,
            observed,
            largest,
            known: [None; SIDE as usize + 1],
        }
    }

    /// Measures all leaves under the tile.
    pub fn run(&mut self, reader: &Reader) -> Result<()> {
        let header = reader.header();
        let entry = self.tile.entry;
        let range = (f64::from(entry.min_m), f64::from(entry.max_m));
        let walk = Walk { reader, frame: self.frame, view: self.view, range };
        let (left, top) = header.origin(entry.id);
        let within = |id: TileId| {
            let (x, y) = header.origin(id);
            let spacing = i64::from(header.spacing(id.level));
            ([(x - left) as i64 / spacing, (y - top) as i64 / spacing], self.tile.spacing as i64 / spacing)
        };
        let mut leaves = Vec::new();
        let is_drawn = |id: TileId| {
            let (origin, intervals) = within(id);
            self.tile.meets(self.meshes, intervals, origin, i64::from(header.tile()))
        };
        walk.visit(&entry, &is_drawn, &mut |leaf| {
            leaves.push((leaf, within(leaf.id)));
            Ok(())
        })?;
        for (leaf, (origin, intervals)) in leaves {
            self.leaf(reader, leaf, origin, intervals)?;
        }
        Ok(())
    }

    /// The result for tile `tile` of the selection.
    pub fn finish(self, tile: u32) -> Observed {
        let patches = self.largest.iter().enumerate().filter(|(_, pixels)| **pixels >= 0.0);
        let patches =
            patches.map(|(patch, &pixels)| PatchError { tile, patch: patch as u32, pixels }).collect();
        Observed { patches, ..self.observed }
    }

    fn leaf(&mut self, reader: &Reader, leaf: Leaf, origin: [i64; 2], intervals: i64) -> Result<()> {
        let header = reader.header();
        let n = i64::from(header.tile());
        heights(reader, header, leaf, &mut self.truth)?;
        let (left, top) = header.origin(leaf.id);
        let first = [left as i64, top as i64];
        let spacing = i64::from(header.spacing(leaf.id.level));
        let side = i64::from(self.tile.patch) * intervals;
        let end = n * intervals;
        // Vertices between patches, and between leaves, belong to the one to the east or south.
        let along = |patch: i64, origin: i64| {
            let (from, to) = ((patch * side).max(origin), ((patch + 1) * side).min(origin + n));
            from - origin..to - origin + i64::from(to == end)
        };
        for patch in 0..self.tile.patches.len() {
            let (px, py) = ((patch % self.tile.m as usize) as i64, (patch / self.tile.m as usize) as i64);
            let window = Window { x: along(px, origin[0]), y: along(py, origin[1]) };
            if window.x.is_empty() || window.y.is_empty() {
                continue;
            }
            self.sheet.draw(&self.tile, patch as u32, self.meshes, intervals, origin, &window);
            let place = Place { patch, origin: first, spacing, row: n as usize + 1 };
            for block in self.nearest_first(&place, &window) {
                self.block(&place, &block)?;
            }
        }
        Ok(())
    }

    /// The blocks of a window, the nearest first: near the eye errors are largest, so that many of
    /// the other blocks can be skipped.
    fn nearest_first(&self, place: &Place, window: &Window) -> Vec<Window> {
        let mut all: Vec<Window> = blocks(&window.y)
            .flat_map(|y| blocks(&window.x).map(move |x| Window { x, y: y.clone() }))
            .collect();
        let away = |window: &Window| {
            let middle = |range: &Range<i64>, axis: usize| {
                place.origin[axis] as f64 + 0.5 * ((range.start + range.end) * place.spacing) as f64
            };
            let [x, y, _] = self.frame.position(middle(&window.x, 0), middle(&window.y, 1), 0.0);
            (x - self.view.eye[0]).hypot(y - self.view.eye[1])
        };
        all.sort_by(|a, b| away(a).total_cmp(&away(b)));
        all
    }

    fn block(&mut self, place: &Place, window: &Window) -> Result<()> {
        let content = self.content(place, window);
        if content.vertices == 0 {
            return Ok(());
        }
        let along = |range: &Range<i64>, axis: usize| {
            let sample = |v: i64| (place.origin[axis] + v * place.spacing) as f64;
            (sample(range.start), sample(range.end - 1))
        };
        let (x, y) = (along(&window.x, 0), along(&window.y, 1));
        let a = self.frame.position(x.0, y.1, content.low);
        let b = self.frame.position(x.1, y.0, content.high);
        let space = Box3 { low: a, high: b };
        if !self.view.sees(&space) {
            return Ok(());
        }
        let inside = space.corners().iter().all(|&corner| self.in_picture(corner).is_some());
        let mut enough = 0.0;
        if inside {
            self.observed.vertices += content.vertices;
            self.observed.misdrawn_vertices += content.misdrawn;
            let largest = &mut self.largest[place.patch];
            *largest = largest.max(0.0);
            // A smaller difference moves a pixel in proportion or less.
            let bound =
                self.view.projected(&space, content.off * self.frame.exaggeration, 0.0) * (1.0 + 1e-9);
            if bound > *largest {
                enough = if bound.is_finite() { content.off * (*largest / bound) } else { 0.0 };
            } else if content.misdrawn == 0 {
                return Ok(());
            } else {
                enough = f64::INFINITY;
            }
        }
        for y in window.y.clone() {
            for x in window.x.clone() {
                let truth = self.truth[y as usize * place.row + x as usize];
                let drawn = self.sheet.row(y, x..x + 1)[0];
                let vertex = [place.origin[0] + x * place.spacing, place.origin[1] + y * place.spacing];
                match (truth.is_nan(), drawn.is_nan()) {
                    (true, true) => {}
                    (false, false) if inside && (truth - drawn).abs() <= enough => {}
                    (false, false) => {
                        self.off(place.patch, vertex, truth, drawn, inside);
                    }
                    (void, _) => {
                        self.misdrawn(place.patch, vertex, if void { drawn } else { truth }, inside)?;
                    }
                }
            }
        }
        Ok(())
    }

    fn content(&self, place: &Place, window: &Window) -> Content {
        let mut content =
            Content { low: f64::INFINITY, high: f64::NEG_INFINITY, off: 0.0, vertices: 0, misdrawn: 0 };
        for y in window.y.clone() {
            let start = y as usize * place.row;
            let truth = &self.truth[start + window.x.start as usize..start + window.x.end as usize];
            for (&truth, &drawn) in truth.iter().zip(self.sheet.row(y, window.x.clone())) {
                let off = (truth - drawn).abs();
                // Comparisons with NaN are false.
                content.off = if off > content.off { off } else { content.off };
                let z = if truth.is_nan() { drawn } else { truth };
                content.low = if z < content.low { z } else { content.low };
                content.high = if z > content.high { z } else { content.high };
                content.vertices += u64::from(!z.is_nan());
                content.misdrawn += u64::from(off.is_nan() && !z.is_nan());
            }
        }
        content
    }

    /// Relative position of a point if it is in the view.
    fn in_picture(&self, point: [f64; 3]) -> Option<[f64; 3]> {
        let [x, y, z] = self.view.relative(point);
        let inside = z >= self.view.near && x.abs() <= self.view.tan_x * z && y.abs() <= self.view.tan_y * z;
        inside.then_some([x, y, z])
    }

    /// Counts a vertex of a block that is partly in the view.
    fn count(&mut self, patch: usize, misdrawn: bool) {
        self.observed.vertices += 1;
        self.observed.misdrawn_vertices += u64::from(misdrawn);
        self.largest[patch] = self.largest[patch].max(0.0);
    }

    fn keep(&mut self, patch: usize, vertex: [i64; 2], (pixels, metres): (f64, f64), misdrawn: bool) {
        self.largest[patch] = self.largest[patch].max(pixels);
        if pixels > self.observed.pixels {
            let (column, row) = (vertex[0] as u64, vertex[1] as u64);
            self.observed =
                Observed { pixels, column, row, metres, misdrawn, ..std::mem::take(&mut self.observed) };
        }
    }

    /// Measures a vertex that is drawn at another height.
    fn off(&mut self, patch: usize, vertex: [i64; 2], truth: f64, drawn: f64, counted: bool) {
        let place = |z| self.frame.position(vertex[0] as f64, vertex[1] as f64, z);
        let Some(from) = self.in_picture(place(truth)) else { return };
        let to = self.view.relative(place(drawn));
        if !counted {
            self.count(patch, false);
        }
        let metres = (truth - drawn).abs() * self.frame.exaggeration;
        self.keep(patch, vertex, (self.pixels(from, to), metres), false);
    }

    /// Measures a misdrawn vertex: void and drawn, or valid and not drawn.
    fn misdrawn(&mut self, patch: usize, vertex: [i64; 2], z: f64, counted: bool) -> Result<()> {
        let [column, row] = vertex.map(|v| v as f64);
        let Some(from) = self.in_picture(self.frame.position(column, row, z)) else { return Ok(()) };
        if !counted {
            self.count(patch, true);
        }
        let column_of = vertex[0].rem_euclid(SIDE) as usize;
        let (mut least, mut most) = (0.0_f64, f64::INFINITY);
        for known in [self.known[column_of], self.known[SIDE as usize]].into_iter().flatten() {
            let [x, y] = [0, 1].map(|i| (vertex[i] - known.vertex[i]) as f64);
            let apart = (x * self.frame.dx).hypot(y * self.frame.dy);
            (least, most) = (least.max(known.metres - apart), most.min(known.metres + apart));
        }
        if self.most_pixels(from, most) <= self.largest[patch] {
            return Ok(());
        }
        let nearest = self.outline.nearest(vertex, least)?;
        let known = Some(Known { vertex, metres: nearest.metres });
        (self.known[column_of], self.known[SIDE as usize]) = (known, known);
        let show = |[column, row]: [f64; 2]| self.view.relative(self.frame.position(column, row, z));
        let none = if nearest.points.is_empty() { f64::INFINITY } else { 0.0 };
        let pixels = nearest.points.iter().map(|&point| self.pixels(from, show(point))).fold(none, f64::max);
        self.keep(patch, vertex, (pixels, nearest.metres), true);
        Ok(())
    }

    /// Pixels between two points; infinite if one is behind the eye.
    fn pixels(&self, a: [f64; 3], b: [f64; 3]) -> f64 {
        if a[2] <= 0.0 || b[2] <= 0.0 {
            return f64::INFINITY;
        }
        self.view.lambda() * (a[0] / a[2] - b[0] / b[2]).hypot(a[1] / a[2] - b[1] / b[2])
    }

    /// Most pixels by which a point moves on the screen if it moves by `metres`.
    fn most_pixels(&self, [x, y, z]: [f64; 3], metres: f64) -> f64 {
        let left = z - metres;
        if left <= 0.0 {
            return f64::INFINITY;
        }
        self.view.lambda() * metres * (1.0 + (x * x + y * y) / (z * z)).sqrt() / left * (1.0 + 1e-9)
    }
}

/// Cuts a range into pieces.
fn blocks(range: &Range<i64>) -> impl Iterator<Item = Range<i64>> + use<> {
    let (start, end) = (range.start, range.end);
    (start..end).step_by(SIDE as usize).map(move |from| from..(from + SIDE).min(end))
}
