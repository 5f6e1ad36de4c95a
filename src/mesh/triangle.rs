//! A right isosceles triangle of the lattice: its plane, and the samples in it.

/// A triangle whose sides lie along columns, rows and diagonals of the lattice.
///
/// Coordinates are absolute, or those of a tile: both count intervals.
#[derive(Clone, Copy, Debug)]
pub(super) struct Triangle {
    /// Its corners, the right angle last.
    pub corners: [(i64, i64); 3],
    /// Heights of the corners.
    pub heights: [f64; 3],
}

/// Rows of a triangle between which its sides are straight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    /// First and last row.
    pub rows: (i64, i64),
    /// First column of the first row, and its change from row to row.
    pub left: (i64, i64),
    /// Last column of the first row, and its change from row to row.
    pub right: (i64, i64),
}

/// A plane over the lattice.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    at: (i64, i64),
    height: f64,
    /// Change from column to column, and from row to row.
    gradient: (f64, f64),
}

impl Plane {
    /// Its height.
    #[inline]
    pub fn height(&self, x: i64, y: i64) -> f64 {
        self.height + self.gradient.0 * (x - self.at.0) as f64 + self.gradient.1 * (y - self.at.1) as f64
    }

    /// Its change from column to column.
    pub fn along(&self) -> f64 {
        self.gradient.0
    }
}

impl Triangle {
    /// Its plane. Differences of whole numbers below 2^31 are divided by a power of two, so nothing
    /// is rounded.
    pub fn plane(&self) -> Plane {
        let [(ax, ay), (bx, by), (cx, cy)] = self.corners;
        let [za, zb, zc] = self.heights;
        // Seen from the right angle the two legs are at right angles and of one length.
        let ((ux, uy), (vx, vy)) = ((ax - cx, ay - cy), (bx - cx, by - cy));
        let square = (ux * ux + uy * uy) as f64;
        let (du, dv) = (za - zc, zb - zc);
        let gradient =
            ((du * ux as f64 + dv * vx as f64) / square, (du * uy as f64 + dv * vy as f64) / square);
        Plane { at: (cx, cy), height: zc, gradient }
    }

    /// Its one or two parts.
    pub fn parts(&self) -> impl Iterator<Item = Part> {
        let mut corners = self.corners;
        corners.sort_unstable_by_key(|&(x, y)| (y, x));
        let [top, middle, bottom] = corners;
        let upper = (middle.1 > top.1).then(|| part(top, top, middle, bottom, (top.1, middle.1)));
        let lower = (bottom.1 > middle.1).then(|| {
            let start = if middle.1 == top.1 { top } else { along(top, bottom, middle.1) };
            part(start, middle, bottom, bottom, (middle.1, bottom.1))
        });
        upper.into_iter().chain(lower)
    }

    /// True if it has an area in common with a rectangle, given by its first and last column and
    /// its first and last row.
    pub fn overlaps(&self, (west, east): (i64, i64), (north, south): (i64, i64)) -> bool {
        let meets = |axis: fn((i64, i64)) -> i64, (low, high): (i64, i64)| {
            let values = self.corners.map(axis);
            values.iter().any(|&value| value > low) && values.iter().any(|&value| value < high)
        };
        // The sides of both lie along these axes.
        meets(|(x, _)| x, (west, east))
            && meets(|(_, y)| y, (north, south))
            && meets(|(x, y)| x + y, (west + north, east + south))
            && meets(|(x, y)| x - y, (west - south, east - north))
    }
}

/// The point of a side in a row.
fn along(from: (i64, i64), to: (i64, i64), row: i64) -> (i64, i64) {
    (from.0 + (to.0 - from.0) / (to.1 - from.1).max(1) * (row - from.1), row)
}

/// The part between two sides: one from `p` to `a`, one from `q` to `b`.
fn part(p: (i64, i64), q: (i64, i64), a: (i64, i64), b: (i64, i64), rows: (i64, i64)) -> Part {
    let step = |from: (i64, i64), to: (i64, i64)| (to.0 - from.0) / (to.1 - from.1).max(1);
    let (first, second) = ((p.0, step(p, a)), (q.0, step(q, b)));
    let height = rows.1 - rows.0;
    let is_ordered = first.0 + first.1 * height + first.0 <= second.0 + second.1 * height + second.0;
    let (left, right) = if is_ordered { (first, second) } else { (second, first) };
    Part { rows, left, right }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sign(p: (i64, i64), a: (i64, i64), b: (i64, i64)) -> i64 {
        ((b.0 - a.0) * (p.1 - a.1) - (b.1 - a.1) * (p.0 - a.0)).signum()
    }

    /// Every triangle that a mesh of this size can have.
    fn all() -> Vec<Triangle> {
        let mut stack = vec![[(0, 0), (16, 16), (16, 0)], [(0, 0), (16, 16), (0, 16)]];
        let mut out = Vec::new();
        while let Some(corners) = stack.pop() {
            let [a, b, c] = corners;
            let heights = corners.map(|(x, y): (i64, i64)| (x * x - 3 * y) as f64);
            out.push(Triangle { corners, heights });
            if (a.0 - b.0).abs().max((a.1 - b.1).abs()) >= 2 {
                let middle = ((a.0 + b.0) / 2, (a.1 + b.1) / 2);
                stack.extend([[a, c, middle], [b, c, middle]]);
            }
        }
        out
    }

    #[test]
    fn parts_have_the_samples_of_the_triangle() {
        for triangle in all() {
            let mut found = std::collections::BTreeSet::new();
            for part in triangle.parts() {
                for row in part.rows.0..=part.rows.1 {
                    let step = row - part.rows.0;
                    let columns = part.left.0 + part.left.1 * step..=part.right.0 + part.right.1 * step;
                    found.extend(columns.map(|x| (x, row)));
                }
            }
            let [a, b, c] = triangle.corners;
            for y in -1..=17 {
                for x in -1..=17 {
                    let signs = [sign((x, y), a, b), sign((x, y), b, c), sign((x, y), c, a)];
                    let inside = !(signs.contains(&1) && signs.contains(&-1));
                    assert_eq!(found.contains(&(x, y)), inside, "{:?} {x} {y}", triangle.corners);
                }
            }
            let plane = triangle.plane();
            for ((x, y), height) in triangle.corners.into_iter().zip(triangle.heights) {
                assert_eq!(plane.height(x, y), height);
            }
        }
    }

    #[test]
    fn overlap_is_an_area() {
        for triangle in all() {
            for (side, left, top) in [(4, 4, 8), (8, 0, 8), (1, 3, 3), (16, 0, 0)] {
                // Samples of a lattice 12 times as fine, off its lines, in both.
                let inside = |x: i64, y: i64| {
                    let [a, b, c] = triangle.corners.map(|(x, y)| (12 * x, 12 * y));
                    let signs = [sign((x, y), a, b), sign((x, y), b, c), sign((x, y), c, a)];
                    signs.iter().all(|&s| s > 0) || signs.iter().all(|&s| s < 0)
                };
                let points = (12 * top..12 * (top + side))
                    .flat_map(|y| (12 * left..12 * (left + side)).map(move |x| (x, y)));
                let common = points.filter(|&(x, y)| {
                    x % 12 == 5 && y % 12 == 2
                        || x % 12 == 2 && y % 12 == 5
                        || x % 12 == 7 && y % 12 == 11
                        || x % 12 == 10 && y % 12 == 7
                });
                let any = common.into_iter().any(|(x, y)| inside(x, y));
                assert_eq!(
                    triangle.overlaps((left, left + side), (top, top + side)),
                    any,
                    "{:?} {side} {left} {top}",
                    triangle.corners
                );
            }
        }
    }
}
