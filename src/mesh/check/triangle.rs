//! One triangle of the mesh against the surface in a block: the samples in it, its vertices and its
//! edges.

use super::blocks::Block;
use super::edge::{self, Edge, between};
use super::found::{Found, Marks};
use super::ground::Facet;

/// A triangle that faces up.
struct Triangle {
    corners: [[f64; 3]; 3],
    /// Its edges that are not along a row, from north to south.
    sides: [Option<Edge>; 3],
    /// First and last row, fractions allowed.
    rows: [f64; 2],
    /// Most columns from one row to the next, along a side.
    steepest: f64,
}

/// A row of a triangle: columns of its ends with their heights.
#[derive(Clone, Copy)]
struct Span {
    from: f64,
    to: f64,
    heights: [f64; 2],
}

impl Triangle {
    fn new(corners: [[f64; 3]; 3]) -> Self {
        let [a, b, c] = corners;
        let sides = [[a, b], [b, c], [c, a]].map(|[p, q]| {
            let (from, to) = if p[1] <= q[1] { (p, q) } else { (q, p) };
            (from[1] < to[1]).then_some(Edge { from, to })
        });
        let rows = [a[1].min(b[1]).min(c[1]), a[1].max(b[1]).max(c[1])];
        let columns = |Edge { from, to }: &Edge| ((to[0] - from[0]) / (to[1] - from[1])).abs();
        let steepest = sides.iter().flatten().map(columns).fold(0.0, f64::max);
        Self { corners, sides, rows, steepest }
    }

    /// Its part in a row that it has.
    fn span(&self, row: f64) -> Span {
        let mut span = Span { from: f64::INFINITY, to: f64::NEG_INFINITY, heights: [0.0; 2] };
        for Edge { from, to } in self.sides.iter().flatten() {
            if from[1] <= row && row <= to[1] {
                let t = (row - from[1]) / (to[1] - from[1]);
                let (x, z) = (between(from[0], to[0], t), between(from[2], to[2], t));
                if x < span.from {
                    (span.from, span.heights[0]) = (x, z);
                }
                if x > span.to {
                    (span.to, span.heights[1]) = (x, z);
                }
            }
        }
        span
    }

    /// True if no sample of a row that it has is near one of its sides, so that what it covers is
    /// inside it.
    fn is_clear(&self, row: f64, span: &Span, near: f64) -> bool {
        let margin = near * (2.0 + self.steepest);
        let is_far = |column: f64| {
            let part = column.abs().fract();
            margin < part && part < 1.0 - margin
        };
        let is_within = self.rows[0] < row - near && row + near < self.rows[1];
        is_within && is_far(span.from) && is_far(span.to)
    }

    /// Columns at most `near` away from it, and those more than `near` inside it, of a row that is
    /// at most `near` away.
    fn margins(&self, row: f64, near: f64) -> [(f64, f64); 2] {
        let [north, south] =
            [row - near, row + near].map(|row| self.span(row.clamp(self.rows[0], self.rows[1])));
        let (mut west, mut east) = (north.from.min(south.from), north.to.max(south.to));
        for corner in self.corners.iter().filter(|corner| (corner[1] - row).abs() <= near) {
            (west, east) = (west.min(corner[0]), east.max(corner[0]));
        }
        if (self.rows[0]..=self.rows[1]).contains(&row) {
            let span = self.span(row);
            (west, east) = (west.min(span.from), east.max(span.to));
        }
        let is_within = self.rows[0] <= row - near && row + near <= self.rows[1];
        let inside = (north.from.max(south.from) + near, north.to.min(south.to) - near);
        [(west - near, east + near), if is_within { inside } else { (1.0, 0.0) }]
    }
}

/// Compares a triangle with the surface in a block, and notes the samples that it covers.
pub(super) fn compare(corners: [[f64; 3]; 3], block: &Block, marks: &mut Marks, found: &mut Found) {
    let (triangle, block) = (Triangle::new(corners), &block.under(&corners));
    let owned = block.owned(1);
    let first = (triangle.rows[0] - block.near).ceil().max(*owned.start() as f64);
    let last = (triangle.rows[1] + block.near).floor().min(*owned.end() as f64);
    if first <= last {
        for row in first as i64..=last as i64 {
            samples(&triangle, row, block, marks, found);
        }
    }
    if block.has_void {
        middles(&triangle, block, found);
    }
    for [x, y, z] in corners {
        if let Some(cell) = block.cell([x, y]) {
            let height = block.ground.height(&Facet::new(cell, [x, y]), [x, y]);
            found.largest.take((z - height).abs(), [x, y]);
        }
    }
    let [a, b, c] = corners;
    let mut cuts = Vec::new();
    for (from, to) in [(a, b), (b, c), (c, a)] {
        edge::compare(&Edge { from, to }, block, &mut cuts, found);
    }
}

/// The columns of a block's samples that lie between two places, both included.
fn columns(block: &Block, (from, to): (f64, f64)) -> (i64, i64) {
    let owned = block.owned(0);
    let (from, to) = (from.ceil().max(*owned.start() as f64), to.floor().min(*owned.end() as f64));
    if from <= to { (from as i64, to as i64) } else { (1, 0) }
}

/// Compares the samples of a row.
fn samples(triangle: &Triangle, row: i64, block: &Block, marks: &mut Marks, found: &mut Found) {
    let y = row as f64;
    let has_row = (triangle.rows[0]..=triangle.rows[1]).contains(&y);
    let span = has_row.then(|| triangle.span(y));
    if let Some(span) = span.filter(|span| triangle.is_clear(y, span, block.near)) {
        let columns = columns(block, (span.from, span.to));
        marks.cover(block, row, columns);
        marks.enter(block, row, columns);
    } else {
        let [near, inside] = triangle.margins(y, block.near);
        marks.cover(block, row, columns(block, near));
        marks.enter(block, row, columns(block, inside));
    }
    let Some(span) = span else { return };
    let columns = columns(block, (span.from, span.to));
    if columns.0 > columns.1 {
        return;
    }
    let (heights, valid) = block.ground.row(row, columns);
    let distances = marks.distances(block, row, columns);
    for (at, (&height, distance)) in heights.iter().zip(distances).enumerate() {
        if valid.is_some_and(|valid| !valid[at]) {
            continue;
        }
        let column = (columns.0 + at as i64) as f64;
        let here = (span.height(column) - height).abs();
        *distance = distance.max(here);
        found.largest.take(here, [column, y]);
    }
}

impl Span {
    /// Height of the triangle in a column of it.
    #[inline]
    fn height(&self, column: f64) -> f64 {
        let width = self.to - self.from;
        let t = if width > 0.0 { (column - self.from) / width } else { 0.0 };
        between(self.heights[0], self.heights[1], t)
    }
}

/// Compares the middles of edges between valid and void samples.
fn middles(triangle: &Triangle, block: &Block, found: &mut Found) {
    // In half rows: those between have the middles of edges down and across cells.
    let first = (2.0 * triangle.rows[0]).ceil().max(2.0 * block.first[1] as f64);
    let last = (2.0 * triangle.rows[1]).floor().min(2.0 * block.last[1] as f64);
    if first > last {
        return;
    }
    for half in first as i64..=last as i64 {
        let y = half as f64 / 2.0;
        let span = triangle.span(y);
        let from = (2.0 * span.from).ceil().max(2.0 * block.first[0] as f64);
        let to = (2.0 * span.to).floor().min(2.0 * block.last[0] as f64);
        if from > to {
            continue;
        }
        for across in from as i64..=to as i64 {
            let (column, row) = (across.div_euclid(2), half.div_euclid(2));
            let (a, b) = match (across.rem_euclid(2), half.rem_euclid(2)) {
                (0, 0) => continue,
                (1, 0) => ([column, row], [column + 1, row]),
                (0, _) => ([column, row], [column, row + 1]),
                _ if (column + row) % 2 == 0 => ([column, row], [column + 1, row + 1]),
                _ => ([column + 1, row], [column, row + 1]),
            };
            if block.ground.differ(a, b) {
                let x = across as f64 / 2.0;
                let height = block.ground.edge(a, b, 0.5);
                found.largest.take((span.height(x) - height).abs(), [x, y]);
            }
        }
    }
}
