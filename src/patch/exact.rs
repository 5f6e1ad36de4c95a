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

/// Up to this range no partial sum of `s (z - D)`, `s <= 2^10`, leaves 32 bits: its terms add up to at most 12 s ranges.
const NARROW_RANGE: i64 = 1 << 17;

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
trait Number: Copy + PartialOrd + Default {
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
    /// Times `2^bits`.
    fn scaled(self, bits: u32) -> Self;
    fn magnitude(self) -> Self;

    fn larger(self, other: Self) -> Self {
        if other > self { other } else { self }
    }
}

impl Number for i32 {
    #[inline]
    fn plus(self, other: Self) -> Self {
        self + other
    }
    #[inline]
    fn minus(self, other: Self) -> Self {
        self - other
    }
    #[inline]
    fn scaled(self, bits: u32) -> Self {
        self << bits
    }
    #[inline]
    fn magnitude(self) -> Self {
        self.abs()
    }
}

impl Number for f64 {
    #[inline]
    fn plus(self, other: Self) -> Self {
        self + other
    }
    #[inline]
    fn minus(self, other: Self) -> Self {
        self - other
    }
    #[inline]
    fn scaled(self, bits: u32) -> Self {
        self * f64::from(1_u32 << bits)
    }
    #[inline]
    fn magnitude(self) -> Self {
        self.abs()
    }
}

/// Multiples of two slopes, so that the planes of a cell cost additions only.
struct Ramps<N> {
    /// `u gx` for u = 0..=s.
    across: Vec<N>,
    /// `k max(s - j, 0)` for j = 0..=2s.
    fold: Vec<N>,
}

impl<N: Number> Ramps<N> {
    fn new(s: usize) -> Self {
        Self { across: vec![N::default(); s + 1], fold: vec![N::default(); 2 * s + 1] }
    }

    /// Fills in the multiples of `gx` and `k`.
    fn set(&mut self, gx: N, k: N) {
        let mut sum = N::default();
        for to in &mut self.across {
            *to = sum;
            sum = sum.plus(gx);
        }
        let s = self.across.len() - 1;
        let mut sum = N::default();
        for to in self.fold[..=s].iter_mut().rev() {
            *to = sum;
            sum = sum.plus(k);
        }
    }
}

/// Largest `s |z - D|` over a cell of two intervals without voids: only its five dropped vertices can differ.
#[inline]
fn smallest_cell<N: Number>(z: &[N], stride: usize, falling: bool) -> N {
    let (north, middle, south) = (&z[..3], &z[stride..stride + 3], &z[2 * stride..2 * stride + 3]);
    let off = |c: N, a: N, b: N| c.scaled(1).minus(a).minus(b).magnitude();
    let centre =
        if falling { off(middle[1], north[0], south[2]) } else { off(middle[1], north[2], south[0]) };
    off(north[1], north[0], north[2])
        .larger(off(middle[0], north[0], south[0]))
        .larger(off(middle[2], north[2], south[2]))
        .larger(off(south[1], south[0], south[2]))
        .larger(centre)
}

/// Largest `s |z - D|` over a cell without voids; `z` starts at its north-west corner.
///
/// With corners a, b, c, d (north-west, north-east, south-west, south-east) and `u`, `v` from the north-west,
/// `s D = s a + u (b - a) + v (d - b) + max(v - u, 0) (b + c - a - d)` on both sides of a falling diagonal, and
/// `s D = s a + u (b - a) + v (c - a) + max(u + v - s, 0) (a + d - b - c)` on both sides of a rising one.
fn full_cell<N: Number>(z: &[N], stride: usize, cell: Cell, ramps: &mut Ramps<N>) -> N {
    let s = cell.s;
    if s == 2 {
        return smallest_cell(z, stride, cell.falling);
    }
    let bits = s.trailing_zeros();
    let (a, b, c, d) = (z[0], z[s], z[s * stride], z[s * stride + s]);
    let bend = b.plus(c).minus(a).minus(d);
    let (down, bend) = if cell.falling { (d.minus(b), bend) } else { (c.minus(a), N::default().minus(bend)) };
    ramps.set(b.minus(a), bend);
    let mut base = a.scaled(bits);
    let mut worst = N::default();
    for v in 0..=s {
        let row = &z[v * stride..=v * stride + s];
        if cell.falling {
            // fold[s - v + u] is bend times max(v - u, 0).
            for ((&height, &across), &fold) in row.iter().zip(&ramps.across).zip(&ramps.fold[s - v..]) {
                let difference = height.scaled(bits).minus(base).minus(across).minus(fold);
                worst = worst.larger(difference.magnitude());
            }
        } else {
            // Read from its end, fold[2s - u - v] is bend times max(u + v - s, 0).
            let fold = ramps.fold[s - v..2 * s + 1 - v].iter().rev();
            for ((&height, &across), &fold) in row.iter().zip(&ramps.across).zip(fold) {
                let difference = height.scaled(bits).minus(base).minus(across).minus(fold);
                worst = worst.larger(difference.magnitude());
            }
        }
        base = base.plus(down);
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
        let corners = [self.at(x0, y0), self.at(x0 + s, y0), self.at(x0, y0 + s), self.at(x0 + s, y0 + s)];
        let heights = cell.planes(corners.map(|i| self.heights.get(i)));
        let validity = cell.planes(corners.map(|i| self.validity(i)));
        let mut worst = 0.0_f64;
        for triangle in 0..2 {
            if cell.corners(triangle).iter().all(|&i| self.state[corners[i]] != VALID) {
                continue;
            }
            let planes = (heights[triangle], validity[triangle]);
            worst = self.valid_samples(x0, y0, cell, triangle, planes, worst);
            for y in 0..s {
                for x in cell_columns(cell, triangle, y) {
                    let bits = self.unit[(y0 + y) * self.n + x0 + x];
                    if bits & HAS_VALID != 0 && crossed(planes.1, x, y, bits) {
                        worst = worst.max(self.unit_cell((x0, y0), (x, y), cell, triangle, planes));
                    }
                }
            }
        }
        worst
    }

    /// Valid samples under one drawn triangle, where it is shown.
    fn valid_samples(
        &self,
        x0: usize,
        y0: usize,
        cell: Cell,
        triangle: usize,
        (height, validity): (Plane, Plane),
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
                let (i, j) = (x as f64, y as f64);
                if self.state[index] == VALID && validity.value(i, j) >= 0.5 {
                    worst = worst.max((self.heights.get(index) - height.value(i, j)).abs());
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

/// Columns of the unit cells that have a part in a triangle, in row `y` of the cell.
fn cell_columns(cell: Cell, triangle: usize, y: usize) -> std::ops::Range<usize> {
    let s = cell.s;
    match (cell.falling, triangle) {
        (true, 0) => y..s,
        (true, _) => 0..y + 1,
        (false, 0) => 0..s - y,
        (false, _) => s - 1 - y..s,
    }
}

/// True if an outline may run through a unit cell and something of it is shown: elsewhere its samples say it all.
fn crossed(validity: Plane, x: usize, y: usize, bits: u8) -> bool {
    let (low, high) = validity.range(x as f64, y as f64);
    high >= 0.5 && (low < 0.5 || bits & HAS_VOID != 0)
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
        let mut narrow = Ramps::new(s);
        let mut wide = Ramps::new(s);
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
                            Heights::Narrow(z) => {
                                f64::from(full_cell(&z[from..], n + 1, cell, &mut narrow)) / s as f64
                            }
                            Heights::Wide(z) => full_cell(&z[from..], n + 1, cell, &mut wide) / s as f64,
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
        if s <= geometry.patch {
            steps.push(errors);
        } else {
            ahead.push(errors);
        }
        s *= 2;
    }
    make_monotone(&mut steps);
    (steps, ahead)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rows_of_additions_equal_the_planes(
            bits in 1_u32..6,
            falling: bool,
            seed in proptest::collection::vec(0..(NARROW_RANGE as i32), 33 * 33),
        ) {
            let s = 1_usize << bits;
            let cell = Cell { s, falling };
            let stride = s + 1;
            let z = &seed[..stride * stride];
            let corners = [z[0], z[s], z[s * stride], z[s * stride + s]].map(f64::from);
            let planes = cell.planes(corners);
            let mut worst = 0.0_f64;
            for y in 0..=s {
                for x in 0..=s {
                    let (fx, fy) = (x as f64, y as f64);
                    let drawn = planes[cell.triangle(fx, fy)].value(fx, fy);
                    worst = worst.max((f64::from(z[y * stride + x]) - drawn).abs());
                }
            }
            let narrow = full_cell(z, stride, cell, &mut Ramps::new(s));
            let wide: Vec<f64> = z.iter().map(|&v| f64::from(v)).collect();
            let wide = full_cell(&wide, stride, cell, &mut Ramps::new(s));
            prop_assert_eq!(f64::from(narrow) / s as f64, worst);
            prop_assert_eq!(wide / s as f64, worst);
        }
    }
}
