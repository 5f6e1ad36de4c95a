//! A look into one cell of a leaf tile: its misdrawn points, and the pieces of the outline near it.

use super::marks::{HalfPoint, Marks};
use super::patterns::Patterns;
use super::search::{Bound, Ceilings, Cells, Corners, MIXED};
use super::shape::{Farthest, Fault, Polygon, Segment, Segments, triangles};
use crate::simd;

/// Halvings of a triangle of a leaf cell: its sides shrink to 1/32.
pub(super) const LEAF_HALVINGS: u32 = 10;

/// The marks nearest to the corners and to the centre of cell `(x, y)`, each once. Half an interval is `half` long.
pub(super) fn around(
    marks: &Marks,
    half: (f64, f64),
    (x, y): (usize, usize),
    mut take: impl FnMut(HalfPoint),
) {
    let mut seen = [[-1; 2]; 5];
    for (count, (i, j)) in [(1, 1), (0, 0), (2, 0), (0, 2), (2, 2)].into_iter().enumerate() {
        let Some(mark) = marks.nearest([2 * x + i, 2 * y + j], half) else { return };
        if !seen.contains(&mark) {
            seen[count] = mark;
            take(mark);
        }
    }
}

/// Squared distance from a mark to the farthest corner of square `(x, y)` of `2^level` cells, whose centre is nearer to
/// the mark than to the others. The mark may be anywhere within `extent` half intervals of its place.
pub(super) fn farthest_corner(
    [mark_x, mark_y]: HalfPoint,
    level: usize,
    (x, y): (usize, usize),
    half: (f64, f64),
    extent: i32,
) -> f64 {
    let away = |mark: i16, place: usize| {
        let centre = (2 * place as i32 + 1) << level;
        f64::from((i32::from(mark) - centre).abs() + (1 << level) + extent)
    };
    let (across, down) = (away(mark_x, x) * half.0, away(mark_y, y) * half.1);
    across * across + down * down
}

/// True if not all corners are alike.
fn is_mixed(full: [u8; 4]) -> bool {
    full != [0; 4] && full != [1; 4]
}

/// A lattice of samples at full resolution, and its outline.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid<'a> {
    /// 1 for each of `(n + 1)^2` samples that is valid.
    pub(super) valid: &'a [u8],
    pub(super) n: usize,
    /// Metres of half an interval, across and down.
    pub(super) half: (f64, f64),
}

impl Grid<'_> {
    /// Validity at the corners of a cell.
    pub(super) fn full(self, x: usize, y: usize) -> [u8; 4] {
        let i = y * (self.n + 1) + x;
        let (north, south) = (&self.valid[i..i + 2], &self.valid[i + self.n + 1..i + self.n + 3]);
        [north[0], north[1], south[0], south[1]]
    }

    /// The parts of the two triangles of a cell that are misdrawn by a fault, where validity as drawn is `drawn` at its corners.
    pub(super) fn misdrawn(
        self,
        (x, y): (usize, usize),
        drawn: Corners,
        fault: Fault,
    ) -> [Option<Polygon>; 2] {
        let full = self.full(x, y).map(f64::from);
        let size = (2.0 * self.half.0, 2.0 * self.half.1);
        triangles((x + y).is_multiple_of(2))
            .map(|triangle| Polygon::misdrawn(triangle, size, full, drawn, fault))
    }

    /// Adds the pieces of the outline in cell `(x, y)`, as seen from the corner of cell `from`.
    pub(super) fn push_segments(self, segments: &mut Segments, from: (usize, usize), (x, y): (usize, usize)) {
        let full = self.full(x, y);
        if !is_mixed(full) {
            return;
        }
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
            segments.push(Segment::new(midpoint(u), midpoint(v)));
        }
    }
}

/// Cells of a leaf tile.
pub(super) struct LeafCells<'a> {
    pub(super) grid: Grid<'a>,
    /// Vertices of the outline.
    pub(super) marks: &'a Marks,
    pub(super) patterns: &'a mut Patterns,
    pub(super) segments: &'a mut Segments,
}

impl LeafCells<'_> {
    /// Collects the pieces of the outline near a cell.
    fn collect(&mut self, at: (usize, usize)) {
        self.segments.clear();
        let n = self.grid.n;
        for y in at.1.saturating_sub(1)..=(at.1 + 1).min(n - 1) {
            for x in at.0.saturating_sub(1)..=(at.0 + 1).min(n - 1) {
                self.grid.push_segments(self.segments, at, (x, y));
            }
        }
        // The outline within a cell and beside it is near enough to all of it.
        if is_mixed(self.grid.full(at.0, at.1)) {
            return;
        }
        // Five marks at most, each of up to four cells.
        let mut seen = [(0, 0); 20];
        let mut count = 0;
        around(self.marks, self.grid.half, at, |[fx, fy]| {
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
                        self.grid.push_segments(self.segments, at, (x, y));
                    }
                }
            }
        });
    }
}

impl Cells for LeafCells<'_> {
    fn reach(&mut self, level: usize, at: (usize, usize), bits: u8) -> [f64; 2] {
        if bits == MIXED {
            // The outline is within.
            return match level {
                0 => self.patterns.cell(self.grid, at, self.segments),
                1 => self.patterns.square(self.grid, at, self.segments),
                _ => {
                    let size = (2 << level) as f64;
                    let (across, down) = (size * self.grid.half.0, size * self.grid.half.1);
                    [across * across + down * down; 2]
                }
            };
        }
        let centre = [(2 * at.0 + 1) << level, (2 * at.1 + 1) << level];
        let mark = self.marks.nearest(centre, self.grid.half);
        [mark.map_or(0.0, |mark| farthest_corner(mark, level, at, self.grid.half, 0)); 2]
    }

    fn look(
        &mut self,
        at: (usize, usize),
        drawn: Corners,
        faults: [bool; 2],
        ceilings: &mut Ceilings,
        bound: &mut Bound,
    ) {
        for fault in [Fault::Shown, Fault::Hidden] {
            if !faults[fault as usize] || bound.settles(ceilings.of(fault as usize)) {
                continue;
            }
            let parts = self.grid.misdrawn(at, drawn, fault);
            if parts.iter().all(Option::is_none) {
                continue;
            }
            self.collect(at);
            let mut part = bound.part();
            let things = &mut *self.segments;
            simd::run(Farthest { polygons: &parts, things, halvings: LEAF_HALVINGS, bound: &mut part });
            let top = bound.join(part);
            if drawn.iter().all(|&value| fault.concerns(value)) {
                ceilings.lower(fault as usize, top);
            }
        }
    }
}
