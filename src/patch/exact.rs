//! Vertical error of the cells inside a leaf tile, exact: every sample against the drawn planes (`metrics.md` method "exact").
//!
//! Drawn triangles are unions of fine ones (the alternating diagonals nest), so the difference of the surfaces is linear
//! on each fine triangle and largest at a vertex of the part that is shown. Without voids these are the samples;
//! with voids also the points where an outline crosses an edge.

use crate::patch::blocks::{HAS_VALID, HAS_VOID, reduce_state};
use crate::patch::cell::{Cell, Plane, Vertex, shown_difference};
use crate::patch::{TileGeometry, make_monotone};
use crate::sample::{Coding, Lattice, VALID};

/// Heights of a lattice in the numbers that errors are measured in.
pub enum Heights {
    /// Integer codes less the lowest one; their range is small enough for 32-bit arithmetic.
    Narrow(Vec<i32>),
    /// Codes or values.
    Wide(Vec<f64>),
}

/// `s (z - D)` with `s <= 2^10` stays below 2^30 up to this range.
const NARROW_RANGE: i64 = 1 << 19;

impl Heights {
    /// Heights of a tile. Void samples without a fill are whatever they are: no shown triangle has them.
    pub fn new(lattice: &Lattice, coding: Coding) -> Self {
        if let Coding::Integer { .. } = coding {
            let known = || lattice.code.iter().zip(&lattice.state).filter(|(_, s)| **s != 0).map(|(&c, _)| c);
            let low = known().min().unwrap_or(0);
            let high = known().max().unwrap_or(0);
            if i64::from(high) - i64::from(low) < NARROW_RANGE {
                return Self::Narrow(lattice.code.iter().map(|&c| c.clamp(low, high) - low).collect());
            }
            return Self::Wide(lattice.code.iter().map(|&c| f64::from(c)).collect());
        }
        Self::Wide((0..lattice.code.len()).map(|i| lattice.value(i, coding)).collect())
    }

    /// Height at an index.
    #[inline]
    pub fn get(&self, index: usize) -> f64 {
        match self {
            Self::Narrow(z) => f64::from(z[index]),
            Self::Wide(z) => z[index],
        }
    }

    /// What rounding in f64 may have lost: 0 for integers, whose arithmetic is exact.
    pub fn slack(&self, coding: Coding) -> f64 {
        match (self, coding) {
            (_, Coding::Integer { .. }) | (Self::Narrow(_), _) => 0.0,
            (Self::Wide(z), _) => z.iter().fold(0.0, |a: f64, v| a.max(v.abs())) * (0.5_f64).powi(49),
        }
    }
}

/// Numbers that rows are compared in.
trait Number: Copy + PartialOrd {
    const ZERO: Self;
    fn of(v: usize) -> Self;
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
    fn times(self, other: Self) -> Self;
    fn larger(self, other: Self) -> Self;
    fn magnitude(self) -> Self;
}

macro_rules! number {
    ($kind:ty, $zero:expr, $max:path) => {
        impl Number for $kind {
            const ZERO: Self = $zero;
            #[inline]
            fn of(v: usize) -> Self {
                v as Self
            }
            #[inline]
            fn plus(self, other: Self) -> Self {
                self + other
            }
            #[inline]
            fn minus(self, other: Self) -> Self {
                self - other
            }
            #[inline]
            fn times(self, other: Self) -> Self {
                self * other
            }
            #[inline]
            fn larger(self, other: Self) -> Self {
                if other > self { other } else { self }
            }
            #[inline]
            fn magnitude(self) -> Self {
                self.abs()
            }
        }
    };
}
number!(i32, 0, i32::max);
number!(f64, 0.0, f64::max);

/// Largest `|s z - (base + slope x)|` along a run of samples.
#[inline]
fn run<N: Number>(z: &[N], s: N, base: N, slope: N, worst: N) -> N {
    let mut worst = worst;
    for (x, &height) in z.iter().enumerate() {
        let difference = height.times(s).minus(base).minus(slope.times(N::of(x)));
        worst = worst.larger(difference.magnitude());
    }
    worst
}

/// Largest `s |z - D|` over a cell without voids; `z` starts at its north-west corner.
fn full_cell<N: Number>(z: &[N], stride: usize, cell: Cell) -> N {
    let s = cell.s;
    let (a, b, c, d) = (z[0], z[s], z[s * stride], z[s * stride + s]);
    let n = N::of(s);
    let mut worst = N::ZERO;
    for y in 0..=s {
        let row = &z[y * stride..y * stride + s + 1];
        let down = N::of(y);
        if cell.falling {
            // West of the diagonal: through a, c, d. East of it: through a, b, d.
            let west = a.times(n).plus(c.minus(a).times(down));
            worst = run(&row[..=y], n, west, d.minus(c), worst);
            let at_diagonal = a.times(n).plus(d.minus(a).times(down));
            worst = run(&row[y..], n, at_diagonal, b.minus(a), worst);
        } else {
            let west = a.times(n).plus(c.minus(a).times(down));
            worst = run(&row[..=s - y], n, west, b.minus(a), worst);
            let at_diagonal = b.times(n).plus(c.minus(b).times(down));
            worst = run(&row[s - y..], n, at_diagonal, d.minus(c), worst);
        }
    }
    worst
}

/// What mixed cells are measured on.
pub struct Field<'a> {
    /// Heights of the tile.
    pub heights: &'a Heights,
    /// Its states.
    pub state: &'a [u8],
    /// Occupancy of its unit cells.
    pub unit: &'a [u8],
    /// Intervals on a side.
    pub n: usize,
}

impl Field<'_> {
    fn at(&self, x: usize, y: usize) -> usize {
        y * (self.n + 1) + x
    }

    fn validity(&self, index: usize) -> f64 {
        f64::from(u8::from(self.state[index] == VALID))
    }

    /// Largest `|z - D|` where both surfaces are shown, over the cell at `(x0, y0)`, voids and all.
    fn mixed_cell(&self, x0: usize, y0: usize, cell: Cell) -> f64 {
        let s = cell.s;
        let corners =
            [self.at(x0, y0), self.at(x0 + s, y0), self.at(x0, y0 + s), self.at(x0 + s, y0 + s)];
        let heights = cell.planes(corners.map(|i| self.heights.get(i)));
        let validity = cell.planes(corners.map(|i| self.validity(i)));
        let mut worst = 0.0_f64;
        for triangle in 0..2 {
            let valid = cell.corners(triangle).into_iter().filter(|&i| self.state[corners[i]] == VALID).count();
            let clipped = match valid {
                0 => continue,
                3 => {
                    worst = self.valid_samples(x0, y0, cell, triangle, heights[triangle], worst);
                    false
                }
                _ => true,
            };
            for y in 0..s {
                for x in 0..s {
                    let bits = self.unit[(y0 + y) * self.n + x0 + x];
                    // Under a fully valid drawn triangle only the fine outline is left to look at.
                    let look = if clipped { bits & HAS_VALID != 0 } else { bits == HAS_VALID | HAS_VOID };
                    if look {
                        let planes = (heights[triangle], validity[triangle]);
                        worst = worst.max(self.unit_cell((x0, y0), (x, y), cell, triangle, planes));
                    }
                }
            }
        }
        worst
    }

    /// Valid samples under one drawn triangle whose corners are all valid.
    fn valid_samples(
        &self,
        x0: usize,
        y0: usize,
        cell: Cell,
        triangle: usize,
        plane: Plane,
        worst: f64,
    ) -> f64 {
        let s = cell.s;
        let mut worst = worst;
        for y in 0..=s {
            let columns = match (cell.falling, triangle) {
                (true, 0) => y..=s,
                (true, _) => 0..=y,
                (false, 0) => 0..=s - y,
                (false, _) => s - y..=s,
            };
            for x in columns {
                let index = self.at(x0 + x, y0 + y);
                if self.state[index] == VALID {
                    worst = worst.max((self.heights.get(index) - plane.value(x as f64, y as f64)).abs());
                }
            }
        }
        worst
    }

    /// The two fine triangles of unit cell `(x, y)` of the cell at `(x0, y0)`, as far as they lie in `triangle`.
    fn unit_cell(
        &self,
        (x0, y0): (usize, usize),
        (x, y): (usize, usize),
        cell: Cell,
        triangle: usize,
        (height, validity): (Plane, Plane),
    ) -> f64 {
        let unit = Cell { s: 1, falling: (x0 + x + y0 + y).is_multiple_of(2) };
        let mut worst = 0.0_f64;
        for part in 0..2 {
            let corners = unit.corners(part).map(|i| (x + (i & 1), y + (i >> 1)));
            let middle = corners.iter().fold((0, 0), |sum, c| (sum.0 + c.0, sum.1 + c.1));
            if cell.triangle(middle.0 as f64 / 3.0, middle.1 as f64 / 3.0) != triangle {
                continue;
            }
            let vertices = corners.map(|(i, j)| {
                let index = self.at(x0 + i, y0 + j);
                let (i, j) = (i as f64, j as f64);
                Vertex {
                    fine: self.validity(index),
                    drawn: validity.value(i, j),
                    difference: self.heights.get(index) - height.value(i, j),
                }
            });
            worst = worst.max(shown_difference(vertices));
        }
        worst
    }
}

/// Vertical errors in metres of all cells of 1, 2, 4 .. T intervals of a leaf tile: `[step][patch]` up to the patch size,
/// then one square of cells for each larger size.
pub fn leaf(
    lattice: &Lattice,
    coding: Coding,
    unit: &[u8],
    geometry: &TileGeometry,
) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let n = geometry.n;
    let heights = Heights::new(lattice, coding);
    let field = Field { heights: &heights, state: &lattice.state, unit, n };
    let slack = heights.slack(coding);
    let patches = geometry.patches();
    let mut steps = vec![vec![0.0; patches * patches]];
    let mut ahead = Vec::new();
    let mut state = unit.to_vec();
    let mut s = 2;
    while s <= n {
        state = reduce_state(&state, 2 * n / s);
        let cells = n / s;
        let side = if s <= geometry.patch { patches } else { cells };
        let mut errors = vec![0.0_f64; side * side];
        for row in 0..cells {
            for column in 0..cells {
                let cell = Cell { s, falling: geometry.falling(s, column, row) };
                let error = match state[row * cells + column] {
                    HAS_VALID => {
                        let from = field.at(column * s, row * s);
                        match &heights {
                            Heights::Narrow(z) => f64::from(full_cell(&z[from..], n + 1, cell)) / s as f64,
                            Heights::Wide(z) => full_cell(&z[from..], n + 1, cell) / s as f64,
                        }
                    }
                    HAS_VOID => 0.0,
                    _ => field.mixed_cell(column * s, row * s, cell),
                };
                let error = if error > 0.0 { (error + slack) * geometry.metres } else { 0.0 };
                let to = &mut errors[(row * side / cells) * side + column * side / cells];
                *to = to.max(error);
            }
        }
        if s <= geometry.patch { steps.push(errors) } else { ahead.push(errors) }
        s *= 2;
    }
    make_monotone(&mut steps);
    (steps, ahead)
}
