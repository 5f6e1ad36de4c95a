//! One cell of a spacing as drawn: its two triangles, their planes, and the part of a fine triangle
//! that both surfaces show.
//!
//! ```text
//! falling         rising          a falling cell of spacing 2s and its four cells of spacing s:
//!
//! a-------b       a-------b       +-------+       +---+---+
//! | \   0 |       | 0   / |       | \     |       | \ | / |
//! |   \   |       |   /   |       |   \   |       +---+---+
//! | 1   \ |       | /   1 |       |     \ |       | / | \ |
//! c-------d       c-------d       +-------+       +---+---+
//! ```
//!
//! a, b, c and d are corners 0 to 3, and 0 and 1 the triangles. Cells are falling where column +
//! row is even, so the diagonals alternate, and every drawn triangle is a union of finer ones.

/// A linear function over a cell: `at + dx * x + dy * y`, `x`, `y` in fine intervals from the
/// cell's north-west corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    at: f64,
    dx: f64,
    dy: f64,
}

impl Plane {
    /// Value at `(x, y)`.
    #[inline]
    pub fn value(&self, x: f64, y: f64) -> f64 {
        self.at + self.dx * x + self.dy * y
    }

    /// Least and greatest value over the unit square from `(x, y)` on.
    #[inline]
    pub fn range(&self, x: f64, y: f64) -> (f64, f64) {
        let value = self.value(x, y);
        (value + self.dx.min(0.0) + self.dy.min(0.0), value + self.dx.max(0.0) + self.dy.max(0.0))
    }
}

/// A cell of `s` fine intervals, drawn as two triangles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Intervals on a side.
    pub s: usize,
    /// True if the diagonal runs from north-west to south-east, false if from north-east to
    /// south-west.
    pub falling: bool,
}

impl Cell {
    /// The planes of the two triangles through the corner values (north-west, north-east,
    /// south-west, south-east): first the one that holds the north-east corner (falling) or the
    /// north-west one (rising).
    ///
    /// The scale is a power of two, and multiplying by it is exact.
    pub fn planes(self, [a, b, c, d]: [f64; 4]) -> [Plane; 2] {
        let scale = 1.0 / self.s as f64;
        if self.falling {
            [
                Plane { at: a, dx: (b - a) * scale, dy: (d - b) * scale },
                Plane { at: a, dx: (d - c) * scale, dy: (c - a) * scale },
            ]
        } else {
            [
                Plane { at: a, dx: (b - a) * scale, dy: (c - a) * scale },
                Plane { at: b + c - d, dx: (d - c) * scale, dy: (d - b) * scale },
            ]
        }
    }

    /// Index of the triangle that holds a point.
    #[inline]
    pub fn triangle(self, x: f64, y: f64) -> usize {
        let first = if self.falling { x >= y } else { x + y <= self.s as f64 };
        usize::from(!first)
    }

    /// Indices of the three corners of triangle 0 or 1.
    pub fn corners(self, triangle: usize) -> [usize; 3] {
        match (self.falling, triangle) {
            (true, 0) => [0, 1, 3],
            (true, _) => [0, 2, 3],
            (false, 0) => [0, 1, 2],
            (false, _) => [1, 2, 3],
        }
    }
}

/// A vertex of a fine triangle: its validity on both surfaces, and the difference of their heights.
#[derive(Clone, Copy, Debug, Default)]
pub struct Vertex {
    /// Validity at full resolution.
    pub fine: f64,
    /// Validity as drawn.
    pub drawn: f64,
    /// Height difference.
    pub difference: f64,
}

/// Largest absolute difference over the part of a triangle where both surfaces are shown (validity
/// at least 1/2); 0 if there is no such part. All three attributes are linear, so it lies at a
/// corner of the clipped polygon.
pub fn shown_difference(triangle: [Vertex; 3]) -> f64 {
    let mut polygon = [Vertex::default(); 8];
    polygon[..3].copy_from_slice(&triangle);
    let (polygon, count) = clip(&polygon, 3, |v| v.fine - 0.5);
    let (polygon, count) = clip(&polygon, count, |v| v.drawn - 0.5);
    polygon[..count].iter().fold(0.0, |worst: f64, v| worst.max(v.difference.abs()))
}

/// The part of a convex polygon where `keep` is not negative.
fn clip(polygon: &[Vertex; 8], count: usize, keep: impl Fn(&Vertex) -> f64) -> ([Vertex; 8], usize) {
    let mut out = [Vertex::default(); 8];
    let mut kept = 0;
    for i in 0..count {
        let (a, b) = (&polygon[i], &polygon[(i + 1) % count]);
        let (ka, kb) = (keep(a), keep(b));
        if ka >= 0.0 {
            out[kept] = *a;
            kept += 1;
        }
        if (ka < 0.0) != (kb < 0.0) && ka != 0.0 && kb != 0.0 {
            let t = ka / (ka - kb);
            let mix = |x: f64, y: f64| x + t * (y - x);
            out[kept] = Vertex {
                fine: mix(a.fine, b.fine),
                drawn: mix(a.drawn, b.drawn),
                difference: mix(a.difference, b.difference),
            };
            kept += 1;
        }
    }
    (out, kept)
}
