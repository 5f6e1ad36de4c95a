//! True vertical deviations by brute force: every fine triangle against the triangle drawn over it.
//!
//! Drawn triangles are unions of fine ones, so the difference of the two surfaces is linear on each
//! fine triangle, and largest at a corner of the part shown on both. Integer codes are compared
//! without rounding.

use std::ops::{Add, Sub};

use rayon::prelude::*;

use super::full::Full;
use super::shape::{Cell, Fine, Grid, HAS_VALID, HAS_VOID, Occupancy, Polygon};
use crate::sample::Coding;

/// A number type in which heights are compared.
trait Number: Copy + PartialOrd + Add<Output = Self> + Sub<Output = Self> + Default {
    fn times(self, factor: i64) -> Self;
    fn magnitude(self) -> f64;
}

impl Number for i64 {
    fn times(self, factor: i64) -> Self {
        self * factor
    }
    fn magnitude(self) -> f64 {
        self.unsigned_abs() as f64
    }
}

impl Number for i128 {
    fn times(self, factor: i64) -> Self {
        self * Self::from(factor)
    }
    fn magnitude(self) -> f64 {
        self.unsigned_abs() as f64
    }
}

impl Number for f64 {
    fn times(self, factor: i64) -> Self {
        self * factor as Self
    }
    fn magnitude(self) -> f64 {
        self.abs()
    }
}

/// The surfaces to compare.
pub(super) struct Surfaces<'a> {
    full: &'a Full,
    occupancy: &'a Occupancy,
    /// Power of two that float heights are multiplied by, so that nothing overflows.
    shrink: f64,
}

impl<'a> Surfaces<'a> {
    /// The surfaces of a lattice.
    pub fn new(full: &'a Full, occupancy: &'a Occupancy) -> Self {
        let count = if full.coding.has_low() { full.columns * full.rows } else { 0 };
        let largest = (0..count).map(|at| full.value(at).abs()).filter(|v| v.is_finite()).fold(0.0, f64::max);
        Self { full, occupancy, shrink: if largest > 1e200 { 0.5_f64.powi(100) } else { 1.0 } }
    }

    /// Largest deviations of cells of spacing `2^q`, in codes of integers or values of floats: one
    /// number for each square of `2^group` intervals, `group >= q`. For floats it is rounded down
    /// by more than the rounding error.
    pub fn deviations(&self, q: u32, group: u32) -> Grid {
        let along = |samples: u64| (((samples - 1) >> group) + 1).min(self.full.side >> group) as usize;
        let (columns, rows) = (along(self.full.raster.0), along(self.full.raster.1));
        let values = (0..columns * rows)
            .into_par_iter()
            .map(|i| {
                let (x, y) = ((i % columns) as u64, (i / columns) as u64);
                let across = 1_u64 << (group - q);
                let cells =
                    (0..across).flat_map(|j| (0..across).map(move |i| (x * across + i, y * across + j)));
                cells.map(|(column, row)| self.cell(q, column, row)).fold(0.0, f64::max)
            })
            .collect();
        Grid { columns, values }
    }

    /// Deviation over one cell.
    fn cell(&self, q: u32, column: u64, row: u64) -> f64 {
        let bits = self.occupancy.bits(q, column, row);
        if bits & HAS_VALID == 0 {
            return 0.0;
        }
        let drawn = DrawnCell::new(self.full, q, column, row);
        if let Coding::Integer { .. } = self.full.coding {
            let code = |at| i64::from(self.full.code(at));
            return if bits & HAS_VOID == 0 {
                drawn.whole(self.full, drawn.codes.map(i64::from), code)
            } else {
                drawn.mixed(self, drawn.codes.map(i128::from), |at| i128::from(code(at)))
            };
        }
        let corners = drawn.values.map(|value| value * self.shrink);
        let value = |at| self.full.value(at) * self.shrink;
        let deviation = if bits & HAS_VOID == 0 {
            drawn.whole(self.full, corners, value)
        } else {
            drawn.mixed(self, corners, value)
        };
        let largest = corners.iter().fold(deviation, |most, z| most.max(z.abs()));
        (deviation - largest * 0.5_f64.powi(48)).max(0.0) / self.shrink
    }
}

/// A cell as drawn.
struct DrawnCell {
    /// Spacing.
    s: i64,
    cell: Cell,
    /// Column of its north-west corner.
    left: u64,
    top: u64,
    codes: [i32; 4],
    values: [f64; 4],
    valid: [bool; 4],
}

impl DrawnCell {
    fn new(full: &Full, q: u32, column: u64, row: u64) -> Self {
        let s = 1_u64 << q;
        let (left, top) = (column * s, row * s);
        let samples = [(0, 0), (s, 0), (0, s), (s, s)].map(|(x, y)| full.sample(left + x, top + y));
        Self {
            s: s as i64,
            cell: Cell::new(s, column, row),
            left,
            top,
            codes: samples.map(|sample| sample.0),
            values: samples.map(|(code, low, _)| full.coding.value(code, low)),
            valid: samples.map(|sample| sample.2 == crate::sample::VALID),
        }
    }

    /// Deviation if every sample is valid: then it is largest at a sample.
    fn whole<N: Number>(&self, full: &Full, corners: [N; 4], z: impl Fn(usize) -> N) -> f64 {
        let (s, [a, b, c, d]) = (self.s, corners);
        let mut worst = 0.0_f64;
        for y in 0..=s {
            // The drawn height times s is base + slope x along a row, on the west and on the east
            // of the diagonal.
            let west = a.times(s - y) + c.times(y);
            let (split, slopes, east) = if self.cell.falling {
                (y, [d - c, b - a], a.times(s) - b.times(y) + d.times(y))
            } else {
                (s - y, [b - a, d - c], b.times(s - y) + c.times(s) - d.times(s - y))
            };
            let start = full.at(self.left as usize, self.top as usize + y as usize);
            for (base, slope, columns) in [(west, slopes[0], 0..=split), (east, slopes[1], split..=s)] {
                let mut most = N::default();
                let mut least = N::default();
                for x in columns {
                    let difference = z(start + x as usize).times(s) - base - slope.times(x);
                    if difference > most {
                        most = difference;
                    }
                    if difference < least {
                        least = difference;
                    }
                }
                worst = worst.max(most.magnitude()).max(least.magnitude());
            }
        }
        worst / s as f64
    }

    /// Deviation where both surfaces are shown, if there are voids.
    fn mixed<N: Number>(&self, surfaces: &Surfaces, corners: [N; 4], z: impl Fn(usize) -> N) -> f64 {
        let full = surfaces.full;
        let inside = |start: u64, count: usize| (count as u64 - 1).saturating_sub(start).min(self.s as u64);
        let mut worst = 0.0_f64;
        for y in 0..inside(self.top, full.rows) {
            for x in 0..inside(self.left, full.columns) {
                let (column, row) = (self.left + x, self.top + y);
                if surfaces.occupancy.bits(0, column, row) & HAS_VALID == 0 {
                    continue;
                }
                let at = full.at(column as usize, row as usize);
                let at = [at, at + 1, at + full.columns, at + full.columns + 1];
                let heights = at.map(&z);
                let valid = at.map(|at| full.is_valid(at));
                let cell = Cell::new(1, column, row);
                for part in 0..2 {
                    let fine = Fine { cell, part, origin: (4 * x as i64, 4 * y as i64) };
                    worst = worst.max(self.triangle(&fine, valid, heights, corners));
                }
            }
        }
        worst / self.cell.side as f64
    }

    /// Deviation, times `4 s`, over the part of a fine triangle that both surfaces show.
    fn triangle<N: Number>(&self, fine: &Fine, valid: [bool; 4], heights: [N; 4], corners: [N; 4]) -> f64 {
        let count =
            |cell: Cell, part, valid: [bool; 4]| cell.corners(part).iter().filter(|&&i| valid[i]).count();
        let under = fine.within(self.cell);
        let counts = (count(fine.cell, fine.part, valid), count(self.cell, under, self.valid));
        if counts.0 == 0 || counts.1 == 0 {
            return 0.0;
        }
        let mut polygon = Polygon::new(fine.points());
        if counts.0 < 3 {
            polygon = polygon.clip(|point| fine.shown(valid, point));
        }
        if counts.1 < 3 {
            polygon = polygon.clip(|point| self.cell.shown(under, self.valid, point));
        }
        let mut worst = 0.0_f64;
        for &point in polygon.points() {
            let sum = |weights: [i64; 4], heights: [N; 4]| {
                weights.into_iter().zip(heights).fold(N::default(), |sum, (weight, z)| sum + z.times(weight))
            };
            let full = sum(fine.cell.weights(fine.part, fine.own(point)), heights);
            let drawn = sum(self.cell.weights(under, point), corners);
            worst = worst.max((full.times(self.s) - drawn).magnitude());
        }
        worst
    }
}
