//! Vertical error of the cells inside a leaf tile, exact: every sample against the drawn planes.
//!
//! Drawn triangles are unions of fine ones (the alternating diagonals nest), so the difference of the surfaces is linear
//! on each fine triangle and largest at a vertex of the part that is shown. Without voids these are the samples;
//! with voids also the points where an outline crosses an edge.

use crate::patch::blocks::{HAS_VALID, HAS_VOID, reduce_state};
use crate::patch::cell::{Cell, Plane, Vertex, shown_difference};
use crate::patch::rows::{Ramps, farthest};
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

/// Ramps for either kind of heights.
struct AllRamps {
    narrow: Ramps<i32>,
    wide: Ramps<f64>,
}

/// What cells are measured on.
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

    /// True if all four corners of a cell are valid.
    fn has_corners(&self, x0: usize, y0: usize, s: usize) -> bool {
        let corners = [self.at(x0, y0), self.at(x0 + s, y0), self.at(x0, y0 + s), self.at(x0 + s, y0 + s)];
        corners.iter().all(|&i| self.state[i] == VALID)
    }

    fn validity(&self, index: usize) -> f64 {
        f64::from(u8::from(self.state[index] == VALID))
    }

    /// Largest `|z - D|` over the cell at `(x0, y0)` if its corners are valid: at its valid samples, and where an outline
    /// crosses a unit cell.
    fn holed_cell(&self, x0: usize, y0: usize, cell: Cell, ramps: &mut AllRamps) -> f64 {
        let s = cell.s;
        let corners = [self.at(x0, y0), self.at(x0 + s, y0), self.at(x0, y0 + s), self.at(x0 + s, y0 + s)];
        let planes = cell.planes(corners.map(|i| self.heights.get(i)));
        let shown = Plane::constant(1.0);
        let mut worst = self.samples::<true>(x0, y0, cell, ramps);
        for y in 0..s {
            let from = (y0 + y) * self.n + x0;
            let row = &self.unit[from..from + s];
            // Most rows of most cells have no outline, and this is a fast way to see it.
            if !row.contains(&(HAS_VALID | HAS_VOID)) {
                continue;
            }
            for (x, _) in row.iter().enumerate().filter(|(_, bits)| **bits == HAS_VALID | HAS_VOID) {
                for (triangle, &plane) in planes.iter().enumerate() {
                    worst = worst.max(self.unit_cell((x0, y0), (x, y), cell, triangle, (plane, shown)));
                }
            }
        }
        worst
    }

    /// Largest `|z - D|` at the samples (`MASKED`: the valid ones) of the cell at `(x0, y0)`, whose corners are valid.
    fn samples<const MASKED: bool>(&self, x0: usize, y0: usize, cell: Cell, ramps: &mut AllRamps) -> f64 {
        let from = self.at(x0, y0);
        let (state, stride) = (&self.state[from..], self.n + 1);
        let worst = match self.heights {
            Heights::Narrow(z) => {
                f64::from(farthest::<i32, MASKED>(&z[from..], state, stride, cell, &mut ramps.narrow))
            }
            Heights::Wide(z) => farthest::<f64, MASKED>(&z[from..], state, stride, cell, &mut ramps.wide),
        };
        worst / cell.s as f64
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
        let mut ramps = AllRamps { narrow: Ramps::new(s), wide: Ramps::new(s) };
        state = reduce_state(&state, 2 * n / s);
        let cells = n / s;
        let side = if s <= geometry.patch { patches } else { cells };
        let mut errors = vec![0.0_f64; side * side];
        for row in 0..cells {
            for column in 0..cells {
                let cell = Cell { s, falling: geometry.falling(s, column, row) };
                let error = match state[row * cells + column] {
                    HAS_VALID => field.samples::<false>(column * s, row * s, cell, &mut ramps),
                    HAS_VOID => 0.0,
                    _ if field.has_corners(column * s, row * s, s) => {
                        field.holed_cell(column * s, row * s, cell, &mut ramps)
                    }
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
