//! A look into one cell of a leaf tile: its misdrawn points, and the pieces of the outline near it.

use super::search::{Bound, Cell, Corners, MIXED};
use super::shape::{Farthest, Fault, Polygon, Segment, Segments, triangles};
use crate::patch::distance::{HalfPoint, Nearest};
use crate::simd;

/// Halvings of a triangle of a leaf cell: its sides shrink to 1/32.
const LEAF_HALVINGS: u32 = 10;

/// Things near cell `at`: the nearest features of the cell and of its eight neighbours, each once.
pub(super) fn around(nearest: &Nearest, n: usize, (x, y): (usize, usize), mut take: impl FnMut(HalfPoint)) {
    let mut seen = [[-1; 2]; 9];
    let mut count = 0;
    for j in y.saturating_sub(1)..=(y + 1).min(n - 1) {
        for i in x.saturating_sub(1)..=(x + 1).min(n - 1) {
            let Some(feature) = nearest.at(i, j) else { return };
            if !seen[..count].contains(&feature) {
                seen[count] = feature;
                count += 1;
                take(feature);
            }
        }
    }
}

/// For each fault and cell, what was found out about the whole cell at another spacing: an upper bound.
#[derive(Debug, Default)]
pub(super) struct Known {
    bounds: Vec<[f64; 2]>,
    /// Cells whose bounds are not infinite.
    set: Vec<usize>,
}

impl Known {
    /// Forgets all, for a tile of `cells`.
    pub(super) fn start(&mut self, cells: usize) {
        for cell in self.set.drain(..) {
            self.bounds[cell] = [f64::INFINITY; 2];
        }
        self.bounds.resize(cells, [f64::INFINITY; 2]);
    }

    fn set(&mut self, cell: usize, fault: Fault, bound: f64) {
        self.set.push(cell);
        self.bounds[cell][fault as usize] = bound;
    }
}

/// A cell of a leaf tile.
pub(super) struct LeafCell<'a> {
    /// 1 for each sample that is valid.
    pub(super) valid: &'a [u8],
    /// What the cells hold.
    pub(super) bits: &'a [u8],
    pub(super) n: usize,
    pub(super) nearest: &'a Nearest,
    pub(super) half: (f64, f64),
    pub(super) segments: &'a mut Segments,
    pub(super) known: &'a mut Known,
}

impl LeafCell<'_> {
    /// Validity at the corners of a cell.
    fn full(&self, x: usize, y: usize) -> [u8; 4] {
        let i = y * (self.n + 1) + x;
        let (north, south) = (&self.valid[i..i + 2], &self.valid[i + self.n + 1..i + self.n + 3]);
        [north[0], north[1], south[0], south[1]]
    }

    /// Collects the pieces of the outline near a cell.
    fn collect(&mut self, at: (usize, usize)) {
        self.segments.clear();
        let (nearest, n) = (self.nearest, self.n);
        for y in at.1.saturating_sub(1)..=(at.1 + 1).min(n - 1) {
            for x in at.0.saturating_sub(1)..=(at.0 + 1).min(n - 1) {
                self.push_segments(at, (x, y));
            }
        }
        // Nine features at most, each of up to four cells.
        let mut seen = [(0, 0); 36];
        let mut count = 0;
        around(nearest, n, at, |[fx, fy]| {
            // A vertex on a side belongs to the cells on both sides of it.
            let cells = |feature: i16| {
                let feature = feature as usize;
                (feature.saturating_sub(1) / 2, (feature / 2).min(n - 1))
            };
            let ((west, east), (north, south)) = (cells(fx), cells(fy));
            for y in north..=south {
                for x in west..=east {
                    let beside = x.abs_diff(at.0) <= 1 && y.abs_diff(at.1) <= 1;
                    if !beside && !seen[..count].contains(&(x, y)) {
                        seen[count] = (x, y);
                        count += 1;
                        self.push_segments(at, (x, y));
                    }
                }
            }
        });
    }

    /// Adds the pieces of the outline in cell `(x, y)`, as seen from the corner of cell `from`.
    fn push_segments(&mut self, from: (usize, usize), (x, y): (usize, usize)) {
        if self.bits[y * self.n + x] != MIXED {
            return;
        }
        let full = self.full(x, y);
        for [a, b, c] in triangles((x + y) % 2 == 0) {
            // The outline runs between the midpoints of the sides that meet at the odd one out.
            let [odd, u, v] = match (full[a] == full[b], full[b] == full[c]) {
                (true, true) => continue,
                (true, false) => [c, a, b],
                (false, true) => [a, b, c],
                (false, false) => [b, a, c],
            };
            let midpoint = |other: usize| {
                let half = |cell: usize, from: usize, corners: usize| {
                    2.0 * (cell as f64 - from as f64) + corners as f64
                };
                (
                    half(x, from.0, odd % 2 + other % 2) * self.half.0,
                    half(y, from.1, odd / 2 + other / 2) * self.half.1,
                )
            };
            self.segments.push(Segment::new(midpoint(u), midpoint(v)));
        }
    }
}

impl Cell for LeafCell<'_> {
    fn look(&mut self, at: (usize, usize), drawn: Corners, bound: &mut Bound) {
        let [nw, ne, sw, se] = self.full(at.0, at.1);
        let full = [f64::from(nw), f64::from(ne), f64::from(sw), f64::from(se)];
        let size = (2.0 * self.half.0, 2.0 * self.half.1);
        let cell = at.1 * self.n + at.0;
        for fault in [Fault::Shown, Fault::Hidden] {
            if bound.settles(self.known.bounds[cell][fault as usize]) {
                continue;
            }
            let [first, second] = triangles((at.0 + at.1).is_multiple_of(2));
            let misdrawn = |triangle| Polygon::misdrawn(triangle, size, full, drawn, fault);
            let parts = [misdrawn(first), misdrawn(second)];
            if parts.iter().all(Option::is_none) {
                continue;
            }
            // The cell's own pieces often say enough.
            self.segments.clear();
            self.push_segments(at, at);
            let own = parts.iter().flatten().map(|part| part.at_most(self.segments)).fold(0.0, f64::max);
            let top = if bound.settles(own) {
                own
            } else {
                self.collect(at);
                let mut part = bound.part();
                let things = &mut *self.segments;
                simd::run(Farthest { polygons: &parts, things, halvings: LEAF_HALVINGS, bound: &mut part });
                bound.join(part)
            };
            if drawn.iter().all(|&value| fault.concerns(value)) {
                self.known.set(cell, fault, top);
            }
        }
    }
}
