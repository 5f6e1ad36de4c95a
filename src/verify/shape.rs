//! Integer geometry of drawn surfaces and of the surface of full resolution.
//!
//! Within a cell, coordinates are quarters of a sample interval. Then all corners of shown and
//! hidden parts are integers: outlines, fine and drawn, join midpoints of edges, and where a fine
//! and a drawn one cross within a fine triangle (only at twice its spacing) they halve such pieces
//! once more.

use super::full::Full;

/// Bit of a block that has a valid sample.
pub(super) const HAS_VALID: u8 = 1;
/// Bit of a block that has a void sample.
pub(super) const HAS_VOID: u8 = 2;
/// Both bits: the outline runs through the block.
pub(super) const MIXED: u8 = HAS_VALID | HAS_VOID;

/// A point in quarters of an interval, relative to the north-west corner of a drawn cell.
pub(super) type Point = (i64, i64);

/// A cell drawn as two triangles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    /// Side in quarters of an interval: `4 s`.
    pub side: i64,
    /// True if the diagonal runs from north-west to south-east, false if from north-east to
    /// south-west.
    pub falling: bool,
}

impl Cell {
    /// Cell (column, row) of spacing `s`, counted over the level.
    pub fn new(s: u64, column: u64, row: u64) -> Self {
        Self { side: 4 * s as i64, falling: (column + row).is_multiple_of(2) }
    }

    /// Corners (0 north-west, 1 north-east, 2 south-west, 3 south-east) of a triangle. Triangle 0
    /// holds the north-east corner if falling, else the north-west one.
    pub fn corners(self, triangle: usize) -> [usize; 3] {
        match (self.falling, triangle) {
            (true, 0) => [0, 1, 3],
            (true, _) => [0, 2, 3],
            (false, 0) => [0, 1, 2],
            (false, _) => [1, 2, 3],
        }
    }

    /// The triangle that a point lies in; on the diagonal, either.
    pub fn triangle(self, (x, y): Point) -> usize {
        let first = if self.falling { x >= y } else { x + y <= self.side };
        usize::from(!first)
    }

    /// Weights of the four corners at a point of a triangle; they add up to `side`.
    pub fn weights(self, triangle: usize, (x, y): Point) -> [i64; 4] {
        let q = self.side;
        match (self.falling, triangle) {
            (true, 0) => [q - x, x - y, 0, y],
            (true, _) => [q - y, 0, y - x, x],
            (false, 0) => [q - x - y, x, y, 0],
            (false, _) => [0, q - y, q - x, x + y - q],
        }
    }

    /// Excess of the validity at a point over one half: positive where the surface is shown, 0 on
    /// the outline.
    pub fn shown(self, triangle: usize, valid: [bool; 4], point: Point) -> i64 {
        let weights = self.weights(triangle, point);
        let sum: i64 =
            weights.into_iter().zip(valid).filter(|(_, valid)| *valid).map(|(weight, _)| weight).sum();
        2 * sum - self.side
    }
}

/// Triangle `part` of the unit cell at `(x, y)` of a drawn cell, in coordinates of the drawn cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fine {
    /// The unit cell, with the diagonal that its place in the lattice gives.
    pub cell: Cell,
    /// Index of the triangle in its cell.
    pub part: usize,
    /// North-west corner of the unit cell.
    pub origin: Point,
}

impl Fine {
    /// Corners of the triangle.
    pub fn points(&self) -> [Point; 3] {
        let place = |corner: usize| {
            (self.origin.0 + 4 * (corner & 1) as i64, self.origin.1 + 4 * (corner >> 1) as i64)
        };
        self.cell.corners(self.part).map(place)
    }

    /// The triangle of a larger cell that this one lies in.
    pub fn within(&self, cell: Cell) -> usize {
        let (x, y) = self.points().iter().fold((0, 0), |sum, p| (sum.0 + p.0, sum.1 + p.1));
        Cell { side: 3 * cell.side, ..cell }.triangle((x, y))
    }

    /// [`Cell::shown`] of the fine surface.
    pub fn shown(&self, valid: [bool; 4], point: Point) -> i64 {
        self.cell.shown(self.part, valid, self.own(point))
    }

    /// A point in coordinates of the unit cell.
    pub fn own(&self, point: Point) -> Point {
        (point.0 - self.origin.0, point.1 - self.origin.1)
    }
}

/// A convex polygon.
#[derive(Clone, Copy, Debug)]
pub(super) struct Polygon {
    points: [Point; 8],
    count: usize,
}

impl Polygon {
    /// A triangle.
    pub fn new(triangle: [Point; 3]) -> Self {
        let mut points = [(0, 0); 8];
        points[..3].copy_from_slice(&triangle);
        Self { points, count: 3 }
    }

    /// Corners of the polygon.
    pub fn points(&self) -> &[Point] {
        &self.points[..self.count]
    }

    /// The part of the polygon where a linear function is not negative.
    #[must_use]
    pub fn clip(&self, keep: impl Fn(Point) -> i64) -> Self {
        let mut out = Self { points: [(0, 0); 8], count: 0 };
        for (i, &a) in self.points().iter().enumerate() {
            let b = self.points[(i + 1) % self.count];
            let (ka, kb) = (keep(a), keep(b));
            if ka >= 0 {
                out.push(a);
            }
            if (ka > 0 && kb < 0) || (ka < 0 && kb > 0) {
                let part = |from: i64, to: i64| {
                    debug_assert_eq!((to - from) * ka % (ka - kb), 0, "corners lie on quarters");
                    from + (to - from) * ka / (ka - kb)
                };
                out.push((part(a.0, b.0), part(a.1, b.1)));
            }
        }
        out
    }

    fn push(&mut self, point: Point) {
        if let Some(to) = self.points.get_mut(self.count) {
            *to = point;
            self.count += 1;
        }
    }

    /// Twice the area of the polygon.
    pub fn area(&self) -> i64 {
        let next = |i: usize| self.points[(i + 1) % self.count];
        let cross = |(i, a): (usize, &Point)| a.0 * next(i).1 - next(i).0 * a.1;
        self.points().iter().enumerate().map(cross).sum::<i64>().abs()
    }
}

/// Which blocks of 1, 2, 4 .. unit cells, up to the root square, have valid and void samples. A
/// block includes its border.
pub(super) struct Occupancy {
    /// Columns, rows and bits for each block size.
    sizes: Vec<(usize, usize, Vec<u8>)>,
}

impl Occupancy {
    /// The occupancy of the lattice of full resolution.
    pub fn of(full: &Full) -> Self {
        let (columns, rows) = (full.columns - 1, full.rows - 1);
        let mut bits = Vec::with_capacity(columns * rows);
        for y in 0..rows {
            for x in 0..columns {
                let corners = [full.at(x, y), full.at(x + 1, y), full.at(x, y + 1), full.at(x + 1, y + 1)];
                let bit = |at| if full.is_valid(at) { HAS_VALID } else { HAS_VOID };
                bits.push(corners.into_iter().fold(0, |bits, at| bits | bit(at)));
            }
        }
        let mut occupancy = Self { sizes: vec![(columns, rows, bits)] };
        for log in 1..=full.side.trailing_zeros() {
            occupancy.halve(log);
        }
        occupancy
    }

    fn halve(&mut self, log: u32) {
        let finer = log - 1;
        let Some(&(columns, rows, _)) = self.sizes.last() else { return };
        let (width, height) = (columns.div_ceil(2), rows.div_ceil(2));
        let mut bits = Vec::with_capacity(width * height);
        for y in 0..height as u64 {
            for x in 0..width as u64 {
                let four = [(0, 0), (1, 0), (0, 1), (1, 1)];
                bits.push(four.iter().fold(0, |bits, (i, j)| bits | self.bits(finer, 2 * x + i, 2 * y + j)));
            }
        }
        self.sizes.push((width, height, bits));
    }

    /// Bits of block `(x, y)` of `2^log` unit cells; void beyond the lattice.
    #[inline]
    pub fn bits(&self, log: u32, x: u64, y: u64) -> u8 {
        let Some((columns, rows, bits)) = self.sizes.get(log as usize) else { return HAS_VOID };
        if x < *columns as u64 && y < *rows as u64 {
            bits[y as usize * columns + x as usize]
        } else {
            HAS_VOID
        }
    }

    /// Binary logarithm of the largest block, the root square.
    pub fn top(&self) -> u32 {
        self.sizes.len() as u32 - 1
    }
}

/// A grid of numbers, which are 0 beyond its bounds.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    /// Columns.
    pub columns: usize,
    /// Numbers, row by row.
    pub values: Vec<f64>,
}

impl Grid {
    /// The number in a column and row.
    pub fn get(&self, x: usize, y: usize) -> f64 {
        if x < self.columns { self.values.get(y * self.columns + x).copied().unwrap_or(0.0) } else { 0.0 }
    }

    /// The larger number at each place of two grids of the same size.
    #[must_use]
    pub fn larger(&self, other: &Self) -> Self {
        let values = self.values.iter().zip(&other.values).map(|(a, b)| a.max(*b)).collect();
        Self { columns: self.columns, values }
    }

    /// A grid of half the size with the largest of every 2 x 2 numbers.
    #[must_use]
    pub fn halved(&self) -> Self {
        let rows = self.values.len() / self.columns.max(1);
        let (columns, rows) = (self.columns.div_ceil(2), rows.div_ceil(2));
        let four =
            |x, y| self.get(x, y).max(self.get(x + 1, y)).max(self.get(x, y + 1)).max(self.get(x + 1, y + 1));
        let values = (0..columns * rows).map(|i| four(2 * (i % columns), 2 * (i / columns))).collect();
        Self { columns, values }
    }
}
