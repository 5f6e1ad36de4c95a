//! The terrain under a part of a mesh, and what triangles and edges of any shape are off it.
//!
//! The surface of full resolution has edges on full lines: `x = i`, `y = j`, `x - y` even and
//! `x + y` even. Along an edge of a mesh the two differ most where it crosses one of these; within
//! a triangle, at samples or on its edges.

/// A vertex: column and row, doubled, and height in numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Point {
    pub x: i32,
    pub y: i32,
    pub height: f64,
}

impl Point {
    /// Column in samples.
    fn column(&self) -> f64 {
        f64::from(self.x) / 2.0
    }

    /// Row in samples.
    fn row(&self) -> f64 {
        f64::from(self.y) / 2.0
    }
}

/// Twice the area of a triangle in doubled coordinates; above 0 if it is counter-clockwise seen
/// from above, rows running south.
pub(super) fn area(a: &Point, b: &Point, c: &Point) -> i64 {
    let cross = |(ux, uy): (i64, i64), (vx, vy): (i64, i64)| uy * vx - ux * vy;
    let from = |p: &Point| (i64::from(p.x) - i64::from(a.x), i64::from(p.y) - i64::from(a.y));
    cross(from(b), from(c))
}

/// Heights of a rectangle of samples.
#[derive(Default)]
pub(super) struct Ground {
    /// First column and row.
    pub corner: (i32, i32),
    /// Columns.
    pub width: usize,
    /// Heights in numbers, row by row. Void samples have their fills.
    pub heights: Vec<f64>,
}

impl Ground {
    /// Height of a sample.
    #[inline]
    fn at(&self, x: i32, y: i32) -> f64 {
        self.heights[(y - self.corner.1) as usize * self.width + (x - self.corner.0) as usize]
    }

    /// What a triangle is off by at most at the samples in it; anything above `cap` if it is more
    /// than that.
    pub fn triangle(&self, corners: [&Point; 3], cap: f64) -> f64 {
        let mut sorted = corners;
        sorted.sort_unstable_by_key(|point| (point.y, point.x));
        let [top, middle, bottom] = sorted;
        let (u, v) = (
            (middle.column() - top.column(), middle.row() - top.row()),
            (bottom.column() - top.column(), bottom.row() - top.row()),
        );
        let (du, dv) = (middle.height - top.height, bottom.height - top.height);
        let size = u.0 * v.1 - u.1 * v.0;
        let (along, down) = ((du * v.1 - dv * u.1) / size, (dv * u.0 - du * v.0) / size);
        let mut most = 0.0_f64;
        for row in div_up(top.y, 2)..=bottom.y.div_euclid(2) {
            let y = 2 * row;
            let long = crossing(top, bottom, y);
            let short = if y < middle.y { crossing(top, middle, y) } else { crossing(middle, bottom, y) };
            // Fractions of doubled columns: numerator and denominator.
            let (left, right) =
                if long.0 * short.1 <= short.0 * long.1 { (long, short) } else { (short, long) };
            let first = (left.0 + 2 * left.1 - 1).div_euclid(2 * left.1) as i32;
            let last = right.0.div_euclid(2 * right.1) as i32;
            if first > last {
                continue;
            }
            let start =
                top.height + along * (f64::from(first) - top.column()) + down * (f64::from(row) - top.row());
            let index = (row - self.corner.1) as usize * self.width + (first - self.corner.0) as usize;
            let samples = &self.heights[index..=index + (last - first) as usize];
            for (step, sample) in samples.iter().enumerate() {
                most = most.max((sample - (start + along * step as f64)).abs());
            }
            if most > cap {
                return most;
            }
        }
        most
    }

    /// What an edge is off by at most; anything above `cap` if it is more than that.
    pub fn edge(&self, p: &Point, q: &Point, cap: f64) -> f64 {
        let (px, py, qx, qy) = (p.column(), p.row(), q.column(), q.row());
        let (dx, dy, dz) = (qx - px, qy - py, q.height - p.height);
        let mut most = 0.0_f64;
        // Columns: the edge crosses sides that run along them.
        for column in between(p.x, q.x, 2) {
            let t = (f64::from(column) - px) / dx;
            let y = py + t * dy;
            let row = self.row_of(y);
            let (above, below) = (self.at(column, row), self.at(column, row + self.more_rows(row)));
            let ground = above + (y - f64::from(row)) * (below - above);
            most = most.max((p.height + t * dz - ground).abs());
        }
        for row in between(p.y, q.y, 2) {
            let t = (f64::from(row) - py) / dy;
            let x = px + t * dx;
            let column = self.column_of(x);
            let (west, east) = (self.at(column, row), self.at(column + self.more_columns(column), row));
            let ground = west + (x - f64::from(column)) * (east - west);
            most = most.max((p.height + t * dz - ground).abs());
        }
        if most > cap {
            return most;
        }
        // Diagonals of cells, which lie on every second line.
        for line in between(p.x - p.y, q.x - q.y, 4) {
            let t = (f64::from(2 * line) - (px - py)) / (dx - dy);
            let (x, y) = (px + t * dx, py + t * dy);
            let (column, row) = (self.column_of(x), self.row_of(y));
            let (a, b) = (
                self.at(column, row),
                self.at(column + self.more_columns(column), row + self.more_rows(row)),
            );
            let ground = a + (x - f64::from(column)) * (b - a);
            most = most.max((p.height + t * dz - ground).abs());
        }
        for line in between(p.x + p.y, q.x + q.y, 4) {
            let t = (f64::from(2 * line) - (px + py)) / (dx + dy);
            let (x, y) = (px + t * dx, py + t * dy);
            let column = self.column_of(x);
            // The diagonal runs from the lower left corner of its cell.
            let row = self.row_of(y);
            let part = x - f64::from(column);
            let (a, b) = if part == 0.0 {
                (self.at(column, 2 * line - column), 0.0)
            } else {
                (self.at(column, row + self.more_rows(row)), self.at(column + self.more_columns(column), row))
            };
            let ground = if part == 0.0 { a } else { a + part * (b - a) };
            most = most.max((p.height + t * dz - ground).abs());
        }
        most
    }

    fn row_of(&self, y: f64) -> i32 {
        (y.floor() as i32).clamp(self.corner.1, self.corner.1 + (self.heights.len() / self.width) as i32 - 1)
    }

    fn column_of(&self, x: f64) -> i32 {
        (x.floor() as i32).clamp(self.corner.0, self.corner.0 + self.width as i32 - 1)
    }

    /// 1 if there is a row after this one.
    fn more_rows(&self, row: i32) -> i32 {
        i32::from(row + 1 < self.corner.1 + (self.heights.len() / self.width) as i32)
    }

    /// 1 if there is a column after this one.
    fn more_columns(&self, column: i32) -> i32 {
        i32::from(column + 1 < self.corner.0 + self.width as i32)
    }
}

/// Where a side crosses a row, in doubled coordinates: numerator and denominator (above 0).
fn crossing(a: &Point, b: &Point, y: i32) -> (i64, i64) {
    let height = i64::from(b.y) - i64::from(a.y);
    if height == 0 {
        return (a.x.into(), 1);
    }
    let step = i64::from(b.x) - i64::from(a.x);
    (i64::from(a.x) * height + step * (i64::from(y) - i64::from(a.y)), height)
}

fn div_up(value: i32, by: i32) -> i32 {
    -(-value).div_euclid(by)
}

/// The multiples of `step` strictly between two values, divided by `step`.
fn between(a: i32, b: i32, step: i32) -> std::ops::Range<i32> {
    let (low, high) = (a.min(b), a.max(b));
    low.div_euclid(step) + 1..div_up(high, step)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SIDE: i32 = 9;

    /// The height of the surface at a place of a lattice 2520 times as fine, in the plainest words.
    fn surface(ground: &Ground, x: f64, y: f64) -> f64 {
        let (column, row) = ((x.floor() as i32).min(SIDE - 1), (y.floor() as i32).min(SIDE - 1));
        let (u, v) = (x - f64::from(column), y - f64::from(row));
        let [nw, ne, sw, se] = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| ground.at(column + i, row + j));
        if (column + row) % 2 == 0 {
            if u >= v { nw + u * (ne - nw) + v * (se - ne) } else { nw + v * (sw - nw) + u * (se - sw) }
        } else if u + v <= 1.0 {
            nw + u * (ne - nw) + v * (sw - nw)
        } else {
            se + (1.0 - u) * (sw - se) + (1.0 - v) * (ne - se)
        }
    }

    proptest! {
        #[test]
        fn an_edge_is_off_as_much_as_at_any_of_its_points(
            heights in prop::collection::vec(-50_i32..50, 100),
            ends in [(0_i32..=2 * SIDE, 0_i32..=2 * SIDE), (0_i32..=2 * SIDE, 0_i32..=2 * SIDE)],
        ) {
            let heights = heights.into_iter().map(f64::from).collect();
            let ground = Ground { corner: (0, 0), width: SIDE as usize + 1, heights };
            let point = |(x, y): (i32, i32)| {
                Point { x, y, height: surface(&ground, f64::from(x) / 2.0, f64::from(y) / 2.0) }
            };
            let (p, q) = (point(ends[0]), point(ends[1]));
            prop_assume!(ends[0] != ends[1]);
            // Steps that hit every crossing of these small slopes or come very near to it.
            let steps = 30_240;
            let mut most = 0.0_f64;
            for step in 0..=steps {
                let t = f64::from(step) / f64::from(steps);
                let (x, y) = (p.column() + t * (q.column() - p.column()), p.row() + t * (q.row() - p.row()));
                most = most.max((p.height + t * (q.height - p.height) - surface(&ground, x, y)).abs());
            }
            let found = ground.edge(&p, &q, f64::INFINITY);
            prop_assert!(found >= most - 1e-9, "{found} {most}");
            prop_assert!(found <= most + 0.5, "{found} {most}");
        }

        #[test]
        fn a_triangle_is_measured_at_its_samples(
            heights in prop::collection::vec(-50_i32..50, 100),
            ends in prop::array::uniform3((0_i32..=2 * SIDE, 0_i32..=2 * SIDE, -50_i32..50)),
        ) {
            let heights = heights.into_iter().map(f64::from).collect();
            let ground = Ground { corner: (0, 0), width: SIDE as usize + 1, heights };
            let [a, b, c] = ends.map(|(x, y, z)| Point { x, y, height: f64::from(z) });
            let whole = area(&a, &b, &c);
            prop_assume!(whole != 0);
            let mut most = 0.0_f64;
            for y in 0..=SIDE {
                for x in 0..=SIDE {
                    let p = Point { x: 2 * x, y: 2 * y, height: 0.0 };
                    let parts = [area(&p, &b, &c), area(&a, &p, &c), area(&a, &b, &p)];
                    if parts.iter().all(|&part| part * whole.signum() >= 0) {
                        let plane: f64 = parts.iter().zip([&a, &b, &c]).map(|(&w, p)| w as f64 * p.height).sum::<f64>() / whole as f64;
                        most = most.max((plane - ground.at(x, y)).abs());
                    }
                }
            }
            let found = ground.triangle([&a, &b, &c], f64::INFINITY);
            prop_assert!((found - most).abs() < 1e-9, "{found} {most}");
        }
    }
}
