//! Mesh edges against the surface: every crossing with its edges and with its outline.

use super::blocks::Block;
use super::found::Found;
use super::ground::Facet;

/// A place with its height: column, row, metres.
type Point = [f64; 3];

/// An edge of the mesh.
pub(super) struct Edge {
    pub from: Point,
    pub to: Point,
}

/// `t` of the way from `a` to `b`, exact at both ends.
#[inline]
pub(super) fn between(a: f64, b: f64, t: f64) -> f64 {
    if t <= 0.5 { a + t * (b - a) } else { b - (1.0 - t) * (b - a) }
}

impl Edge {
    #[inline]
    fn at(&self, t: f64) -> Point {
        let ([x, y, z], [u, v, w]) = (self.from, self.to);
        [between(x, u, t), between(y, v, t), between(z, w, t)]
    }

    /// The part of it, as two `t`, that is at most a sample away from a block.
    fn clipped(&self, block: &Block) -> Option<[f64; 2]> {
        let (mut start, mut end) = (0.0_f64, 1.0_f64);
        for axis in [0, 1] {
            let (a, b) = (self.from[axis], self.to[axis]);
            let (low, high) = (block.first[axis] as f64 - 1.0, block.last[axis] as f64 + 1.0);
            if a == b {
                if a < low || a > high {
                    return None;
                }
                continue;
            }
            let (at_low, at_high) = ((low - a) / (b - a), (high - a) / (b - a));
            start = start.max(at_low.min(at_high));
            end = end.min(at_low.max(at_high));
        }
        (start <= end).then_some([start, end])
    }
}

/// Compares an edge with the surface where they cross in a block. `cuts` is scratch memory.
pub(super) fn compare(edge: &Edge, block: &Block, cuts: &mut Vec<f64>, found: &mut Found) {
    let Some(ends) = edge.clipped(block) else { return };
    let ends = ends.map(|t| edge.at(t));
    cuts.clear();
    along_lines(edge, &ends, 0, block, cuts, found);
    along_lines(edge, &ends, 1, block, cuts, found);
    along_diagonals(edge, &ends, -1, block, cuts, found);
    along_diagonals(edge, &ends, 1, block, cuts, found);
    if block.has_void {
        cuts.extend([0.0, 1.0]);
        cuts.sort_unstable_by(f64::total_cmp);
        for pair in cuts.windows(2) {
            outline(edge, [pair[0], pair[1]], block, found);
        }
    }
}

/// Crossings with `x = i` (axis 0) or `y = j` (axis 1).
fn along_lines(
    edge: &Edge,
    ends: &[Point; 2],
    axis: usize,
    block: &Block,
    cuts: &mut Vec<f64>,
    found: &mut Found,
) {
    let (start, length) = (edge.from[axis], edge.to[axis] - edge.from[axis]);
    if length == 0.0 {
        return;
    }
    let other = 1 - axis;
    let range = block.first[other] as f64..=block.last[other] as f64;
    for line in Block::lines(ends[0][axis], ends[1][axis], [block.first[axis], block.last[axis]]) {
        let t = (line as f64 - start) / length;
        if !(0.0..=1.0).contains(&t) {
            continue;
        }
        if block.has_void {
            cuts.push(t);
        }
        let mut point = edge.at(t);
        point[axis] = line as f64;
        if range.contains(&point[other]) {
            // No coordinate in a block is below 0: a cast is its floor.
            let floor = point[other] as i64;
            let (mut a, mut b) = ([line; 2], [line; 2]);
            (a[other], b[other]) = (floor, floor + 1);
            let height = block.ground.edge(a, b, point[other] - floor as f64);
            found.largest.take((point[2] - height).abs(), [point[0], point[1]]);
        }
    }
}

/// Crossings with `x + sign * y` even.
fn along_diagonals(
    edge: &Edge,
    ends: &[Point; 2],
    sign: i64,
    block: &Block,
    cuts: &mut Vec<f64>,
    found: &mut Found,
) {
    let of = |point: &Point| point[0] + sign as f64 * point[1];
    let (start, length) = (of(&edge.from), of(&edge.to) - of(&edge.from));
    if length == 0.0 {
        return;
    }
    let (first, last) = (block.first, block.last);
    let rows = if sign < 0 { [-last[1], -first[1]] } else { [first[1], last[1]] };
    for line in Block::lines(of(&ends[0]), of(&ends[1]), [first[0] + rows[0], last[0] + rows[1]]) {
        if line % 2 != 0 {
            continue;
        }
        let t = (line as f64 - start) / length;
        if !(0.0..=1.0).contains(&t) {
            continue;
        }
        if block.has_void {
            cuts.push(t);
        }
        let point = edge.at(t);
        if !(first[0] as f64..=last[0] as f64).contains(&point[0]) {
            continue;
        }
        let floor = point[0] as i64;
        let part = point[0] - floor as f64;
        let a = [floor, sign * (line - floor)];
        let b = [a[0] + 1, a[1] - sign];
        let rows = first[1]..=last[1];
        if rows.contains(&a[1]) && (part == 0.0 || rows.contains(&b[1])) {
            let height = block.ground.edge(a, b, part);
            let row = sign as f64 * (line as f64 - point[0]);
            found.largest.take((point[2] - height).abs(), [point[0], row]);
        }
    }
}

/// The crossing with the outline, if there is one in a part of an edge within one triangle of the
/// surface.
fn outline(edge: &Edge, [start, end]: [f64; 2], block: &Block, found: &mut Found) {
    let place = |t: f64| {
        let [x, y, _] = edge.at(t);
        [x, y]
    };
    let middle = place((start + end) / 2.0);
    let Some(cell) = block.cell(middle).filter(|_| start < end) else { return };
    let facet = Facet::new(cell, middle);
    let of = |t: f64| block.ground.both(&facet, place(t)).0 - 0.5;
    let (before, after) = (of(start), of(end));
    if before * after < 0.0 {
        let point = edge.at(start + (end - start) * (before / (before - after)));
        let (_, height) = block.ground.both(&facet, [point[0], point[1]]);
        found.largest.take((point[2] - height).abs(), [point[0], point[1]]);
    }
}
