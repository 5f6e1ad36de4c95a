//! The metres of horizontal distances within one tile (`format-spec.md`, section 2): upper bounds,
//! row by row.

use super::{CrsKind, Ellipsoid, Geo, Spacing};
use std::f64::consts::FRAC_PI_2;

/// Factor that covers the rounding of this module, and of the sums made with its results.
const UP: f64 = 1.0 + 1e-9;
/// Largest ratio of the lengths of two parallels of a tile that count as one.
const EVEN: f64 = 1.0 + 1.0 / 128.0;
/// Cosine of the angle between columns and rows above which the plane is not sheared, but widened:
/// there the difference of large numbers would not be exact enough.
const FLAT: f64 = 0.999_99;

/// The lattice laid out in a plane: a column to the east is `(dx, 0)` metres, a row to the south
/// `(skew, dy)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Length of a column's interval.
    pub dx: f64,
    /// How far a row leans along the columns.
    pub skew: f64,
    /// Distance of two neighbouring rows.
    pub dy: f64,
}

impl Plane {
    /// A plane for two vectors in metres. No distance is smaller than between the vectors, so
    /// bounds stay bounds, and neither side is below a millionth of the other, so that no division
    /// is by 0.
    fn of(column: (f64, f64), row: (f64, f64)) -> Self {
        let (u, v) = (column.0.hypot(column.1), row.0.hypot(row.1));
        let least = (u.max(v) * 1e-6).max(1e-100);
        let cos = if u > 0.0 && v > 0.0 { (column.0 * row.0 + column.1 * row.1) / u / v } else { 0.0 };
        let (u, v) = (u.max(least), v.max(least));
        if cos.abs() < 1e-9 || !cos.is_finite() {
            return Self { dx: u * UP, skew: 0.0, dy: v * UP };
        }
        if cos.abs() > FLAT {
            // |iu + jv|^2 <= (1 + |cos|) (|iu|^2 + |jv|^2).
            let up = (1.0 + cos.abs().min(1.0)).sqrt() * UP;
            return Self { dx: u * up, skew: 0.0, dy: v * up };
        }
        Self { dx: u * UP, skew: v * cos * UP, dy: v * (1.0 - cos * cos).sqrt() * UP }
    }

    /// The vector to a point `columns` and `rows` away.
    #[inline(always)]
    pub fn at(self, columns: f64, rows: f64) -> (f64, f64) {
        (columns * self.dx + rows * self.skew, rows * self.dy)
    }

    /// Squared distance of a point `columns` and `rows` away.
    #[inline(always)]
    pub fn squared(self, columns: f64, rows: f64) -> f64 {
        let (x, y) = self.at(columns, rows);
        x * x + y * y
    }

    /// The plane of intervals `factor` times as long.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self { dx: self.dx * factor, skew: self.skew * factor, dy: self.dy * factor }
    }

    /// Length of a row's interval.
    #[inline(always)]
    pub fn row(self) -> f64 {
        // Few rasters are sheared, and this function is called often.
        if self.skew == 0.0 { self.dy } else { self.skew.hypot(self.dy) }
    }
}

/// The vectors of a tile's intervals, from which its planes are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// An interval along a column, in metres or radians, x and y.
    column: (f64, f64),
    /// An interval along a row.
    row: (f64, f64),
    /// If they are in radians: the ellipsoid, and the latitude of the tile's first sample.
    ellipsoid: Option<(Ellipsoid, f64)>,
}

impl From<Spacing> for Scale {
    /// A scale of columns and rows at right angles, with the same lengths everywhere.
    fn from(Spacing { dx, dy }: Spacing) -> Self {
        Self { column: (dx, 0.0), row: (0.0, dy), ellipsoid: None }
    }
}

impl Geo {
    /// The scale of a tile whose first sample is `(column, row)` of the lattice and whose intervals
    /// are `step` samples.
    pub fn scale(&self, (column, row): (u64, u64), step: u64) -> Scale {
        let [_, a, b, _, d, e] = self.transform_or_identity();
        let (unit, (_, y)) = (self.crs.unit, self.world_from_sample(column as f64, row as f64));
        let length = unit * step as f64;
        Scale {
            column: (a * length, d * length),
            row: (b * length, e * length),
            ellipsoid: (self.crs.kind == CrsKind::Geographic).then_some((self.crs.ellipsoid, y * unit)),
        }
    }
}

/// The planes of a tile: one for each range of its rows.
#[derive(Clone, Debug, Default)]
pub struct Planes {
    column: (f64, f64),
    row: (f64, f64),
    /// Most metres of a radian of latitude.
    meridian: f64,
    /// Most metres of a radian of longitude: one for all rows, or one for each interval of rows.
    parallels: Vec<f64>,
    /// The interval where parallels are longest.
    longest: usize,
    /// The plane of all rows.
    whole: Option<Plane>,
}

impl Planes {
    /// Becomes the planes of a tile of `n` intervals.
    pub fn start(&mut self, scale: &Scale, n: usize) {
        (self.column, self.row) = (scale.column, scale.row);
        self.parallels.clear();
        self.longest = 0;
        if let Some((ellipsoid, latitude)) = scale.ellipsoid {
            self.start_parallels(scale, ellipsoid, latitude, n);
        } else {
            self.meridian = 1.0;
            self.parallels.push(1.0);
        }
        self.whole = Some(self.plane(self.parallels[self.longest]));
    }

    /// Sets the parallels of a geographic raster.
    fn start_parallels(&mut self, scale: &Scale, ellipsoid: Ellipsoid, latitude: f64, n: usize) {
        // Latitudes of the columns of a row.
        let (west, east) = (0.0_f64.min(scale.column.1 * n as f64), 0.0_f64.max(scale.column.1 * n as f64));
        let (mut shortest, mut farthest) = (f64::INFINITY, 0.0_f64);
        for row in 0..n {
            let [first, last] = [row, row + 1].map(|row| latitude + row as f64 * scale.row.1);
            let south = (first.min(last) + west).clamp(-FRAC_PI_2, FRAC_PI_2);
            let north = (first.max(last) + east).clamp(-FRAC_PI_2, FRAC_PI_2);
            // A parallel is longest nearest the equator; a meridian's arc is longest nearest a
            // pole.
            let nearest = if south <= 0.0 && north >= 0.0 { 0.0 } else { south.abs().min(north.abs()) };
            farthest = farthest.max(south.abs()).max(north.abs());
            let parallel = ellipsoid.metres_of_radian(nearest).0;
            if parallel > self.parallels.get(self.longest).copied().unwrap_or(0.0) {
                self.longest = row;
            }
            shortest = shortest.min(parallel);
            self.parallels.push(parallel);
        }
        self.meridian = ellipsoid.metres_of_radian(farthest).1;
        let longest = self.parallels[self.longest];
        if longest <= shortest * EVEN {
            self.parallels.clear();
            self.parallels.push(longest);
            self.longest = 0;
        }
    }

    /// True if one plane serves for all rows.
    pub fn is_even(&self) -> bool {
        self.parallels.len() == 1
    }

    /// The plane of all rows.
    pub fn whole(&self) -> Plane {
        self.whole.unwrap_or(Plane { dx: 1.0, skew: 0.0, dy: 1.0 })
    }

    /// The plane of the rows from `first` to `last`: no line between them is longer than in it.
    #[inline]
    pub fn over(&self, first: usize, last: usize) -> Plane {
        if self.is_even() { self.whole() } else { self.over_some(first, last) }
    }

    #[inline(never)]
    fn over_some(&self, first: usize, last: usize) -> Plane {
        let (first, last) = (first.min(self.parallels.len() - 1), last.max(first + 1) - 1);
        let last = last.min(self.parallels.len() - 1);
        // Parallels grow up to the longest and shrink from there.
        let longest = self.longest.clamp(first, last);
        self.plane(self.parallels[longest])
    }

    fn plane(&self, parallel: f64) -> Plane {
        let metres = |(x, y): (f64, f64)| (x * parallel, y * self.meridian);
        Plane::of(metres(self.column), metres(self.row))
    }
}
