//! Triangles cut along the sides of the window and along outlines of voids.
//!
//! The points of a cut lie on sides of triangles, so both triangles at a side make the same ones.
//! Along the straight sides of a window the cut leaves the surface inside as it is.

use super::square::HAS_VALID;
use super::terrain::Extent;
use super::vertex::Vertex;

/// A corner of a triangle that is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Corner {
    /// A sample.
    Sample(Vertex),
    /// A point of a cut.
    Cut(Point),
}

/// A point of a cut: its height is a weighted mean of those of up to three samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Point {
    /// Column and row, doubled.
    pub doubled: (u32, u32),
    /// The samples.
    pub of: [Vertex; 3],
    /// Their weights; their sum is 1.
    pub weights: [f64; 3],
}

impl Corner {
    /// Column and row, doubled.
    pub fn doubled(&self) -> (i64, i64) {
        match self {
            Self::Sample(vertex) => (2 * i64::from(vertex.x), 2 * i64::from(vertex.y)),
            Self::Cut(point) => (point.doubled.0.into(), point.doubled.1.into()),
        }
    }
}

/// The point halfway between a valid and a void sample.
fn outline(a: Vertex, b: Vertex) -> Corner {
    let (a, b) = (a.min(b), a.max(b));
    Corner::Cut(Point { doubled: (a.x + b.x, a.y + b.y), of: [a, b, b], weights: [0.5, 0.5, 0.0] })
}

/// The part of a triangle with valid and void corners in which the validity is at least 1/2, as a
/// polygon of three or four corners in the same sense.
pub(super) fn cut_at_outline(corners: [Vertex; 3], kinds: [u8; 3]) -> Vec<Corner> {
    let mut out = Vec::with_capacity(4);
    for i in 0..3 {
        let next = (i + 1) % 3;
        if kinds[i] == HAS_VALID {
            out.push(Corner::Sample(corners[i]));
        }
        if kinds[i] != kinds[next] {
            out.push(outline(corners[i], corners[next]));
        }
    }
    out
}

/// The part of a triangle within the window, as a polygon in the same sense; empty if there is
/// none. Sides of the triangle lie along columns, rows and diagonals.
pub(super) fn cut_at_window(corners: [Vertex; 3], extent: &Extent) -> Vec<Corner> {
    let mut points: Vec<Corner> =
        corners.into_iter().filter(|&corner| extent.contains(corner)).map(Corner::Sample).collect();
    let add = |point: Corner, points: &mut Vec<Corner>| {
        if points.iter().all(|other| other.doubled() != point.doubled()) {
            points.push(point);
        }
    };
    for i in 0..3 {
        let (a, b) = (corners[i].min(corners[(i + 1) % 3]), corners[i].max(corners[(i + 1) % 3]));
        let lines = [
            (true, extent.columns.0),
            (true, extent.columns.1),
            (false, extent.rows.0),
            (false, extent.rows.1),
        ];
        for (is_column, line) in lines {
            let (from, to) = if is_column { (a.x, b.x) } else { (a.y, b.y) };
            if !(from.min(to) < line && line < from.max(to)) {
                continue;
            }
            let part = (i64::from(line) - i64::from(from)) as f64 / (i64::from(to) - i64::from(from)) as f64;
            let between = |from: u32, to: u32| {
                (f64::from(from) + (f64::from(to) - f64::from(from)) * part).round() as u32
            };
            let at = Vertex::new(between(a.x, b.x), between(a.y, b.y));
            if extent.contains(at) {
                let doubled = (2 * at.x, 2 * at.y);
                add(
                    Corner::Cut(Point { doubled, of: [a, b, b], weights: [1.0 - part, part, 0.0] }),
                    &mut points,
                );
            }
        }
    }
    for x in [extent.columns.0, extent.columns.1] {
        for y in [extent.rows.0, extent.rows.1] {
            if let Some(weights) = weights_in(corners, (x, y)) {
                let doubled = (2 * x, 2 * y);
                add(Corner::Cut(Point { doubled, of: corners, weights }), &mut points);
            }
        }
    }
    if points.len() < 3 {
        return Vec::new();
    }
    around(points, sense(corners.map(|corner| Corner::Sample(corner).doubled())))
}

/// Weights of the corners of a triangle at a point inside it; `None` elsewhere.
fn weights_in(corners: [Vertex; 3], (x, y): (u32, u32)) -> Option<[f64; 3]> {
    let p = (2 * i64::from(x), 2 * i64::from(y));
    let [a, b, c] = corners.map(|corner| Corner::Sample(corner).doubled());
    let areas = [area(p, b, c), area(a, p, c), area(a, b, p)];
    let total = area(a, b, c);
    let inside = areas.iter().all(|&part| part != 0 && (part > 0) == (total > 0));
    inside.then(|| areas.map(|part| part as f64 / total as f64))
}

/// Twice the area of a triangle; its sign tells the sense.
pub(super) fn area(a: (i64, i64), b: (i64, i64), c: (i64, i64)) -> i64 {
    (b.0 - a.0) * (c.1 - a.1) - (b.1 - a.1) * (c.0 - a.0)
}

/// The sense of a triangle: the sign of its area.
fn sense([a, b, c]: [(i64, i64); 3]) -> i64 {
    area(a, b, c).signum()
}

/// The corners of a convex polygon in order, in the given sense, from the one that comes first by
/// column and row.
fn around(mut points: Vec<Corner>, sense: i64) -> Vec<Corner> {
    let first = points.iter().enumerate().min_by_key(|(_, point)| point.doubled()).map_or(0, |(at, _)| at);
    let first = points.swap_remove(first);
    let from = first.doubled();
    // All others lie in a half-plane as seen from the first.
    points.sort_by(|a, b| (sense * area(from, b.doubled(), a.doubled())).cmp(&0));
    points.insert(0, first);
    points
}

/// The triangles of a convex polygon, as a fan.
pub(super) fn fan(polygon: &[Corner]) -> impl Iterator<Item = [Corner; 3]> {
    let rest = polygon.get(1..).unwrap_or_default();
    rest.iter().zip(rest.iter().skip(1)).map(|(&b, &c)| [polygon[0], b, c])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::square::HAS_VOID;

    fn whole(polygon: &[Corner]) -> i64 {
        fan(polygon).map(|[a, b, c]| area(a.doubled(), b.doubled(), c.doubled())).sum()
    }

    #[test]
    fn a_cut_keeps_the_part_within_the_window() {
        let at = Vertex::new;
        let extents = [(3, 13, 2, 9), (0, 16, 0, 16), (5, 6, 5, 6), (0, 7, 9, 16), (4, 12, 4, 12)];
        let mut stack = vec![[at(0, 0), at(16, 0), at(16, 16)], [at(16, 16), at(0, 16), at(0, 0)]];
        while let Some([a, apex, b]) = stack.pop() {
            for (west, east, north, south) in extents {
                let extent = Extent { columns: (west, east), rows: (north, south) };
                let corners = [a, apex, b];
                let polygon = cut_at_window(corners, &extent);
                let expected = clipped_area(corners, (west, east, north, south));
                assert_eq!(whole(&polygon).abs(), expected, "{corners:?} {extent:?}");
                for [a, b, c] in fan(&polygon) {
                    let part = area(a.doubled(), b.doubled(), c.doubled());
                    let of = corners.map(|corner| Corner::Sample(corner).doubled());
                    assert_eq!(part.signum(), area(of[0], of[1], of[2]).signum());
                }
            }
            if a.x.abs_diff(b.x).max(a.y.abs_diff(b.y)) >= 2 {
                let middle = a.middle(b);
                stack.push([apex, middle, a]);
                stack.push([b, middle, apex]);
            }
        }
    }

    /// Twice the area, in half intervals, by cutting a polygon of fractions at one line after the
    /// other.
    fn clipped_area(corners: [Vertex; 3], (west, east, north, south): (u32, u32, u32, u32)) -> i64 {
        let mut polygon: Vec<(f64, f64)> =
            corners.iter().map(|v| (2.0 * f64::from(v.x), 2.0 * f64::from(v.y))).collect();
        let planes: [(f64, f64, f64); 4] = [
            (1.0, 0.0, -2.0 * f64::from(west)),
            (-1.0, 0.0, 2.0 * f64::from(east)),
            (0.0, 1.0, -2.0 * f64::from(north)),
            (0.0, -1.0, 2.0 * f64::from(south)),
        ];
        for (a, b, c) in planes {
            let mut next = Vec::new();
            for i in 0..polygon.len() {
                let (p, q) = (polygon[i], polygon[(i + 1) % polygon.len()]);
                let (u, v) = (a * p.0 + b * p.1 + c, a * q.0 + b * q.1 + c);
                if u >= 0.0 {
                    next.push(p);
                }
                if u * v < 0.0 {
                    let t = u / (u - v);
                    next.push((p.0 + t * (q.0 - p.0), p.1 + t * (q.1 - p.1)));
                }
            }
            polygon = next;
        }
        let sum: f64 = (0..polygon.len())
            .map(|i| (polygon[i], polygon[(i + 1) % polygon.len()]))
            .map(|(p, q)| p.0 * q.1 - q.0 * p.1)
            .sum();
        sum.abs().round() as i64
    }

    #[test]
    fn an_outline_runs_through_the_middles_of_sides() {
        let corners = [Vertex::new(0, 0), Vertex::new(2, 0), Vertex::new(2, 2)];
        let whole_area = 16;
        let of = |kinds: [u8; 3]| whole(&cut_at_outline(corners, kinds)).abs();
        assert_eq!(of([HAS_VALID, HAS_VOID, HAS_VOID]), whole_area / 4);
        assert_eq!(of([HAS_VALID, HAS_VALID, HAS_VOID]), whole_area * 3 / 4);
        assert_eq!(of([HAS_VOID, HAS_VALID, HAS_VOID]), whole_area / 4);
    }
}
