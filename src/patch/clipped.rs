//! Errors of cells with voids, fine triangle by fine triangle: each is clipped to the part that
//! both surfaces show.

use crate::patch::blocked::PlacedCell;
use crate::patch::blocks::{HAS_VALID, HAS_VOID};
use crate::patch::cell::{Cell, Plane, Vertex, shown_difference};
use crate::patch::cells_with_voids::CellsWithVoids;
use crate::patch::number::Number;
use crate::sample::VALID;

impl<N: Number> CellsWithVoids<'_, N> {
    /// Largest `|z - D|` under a drawn triangle where both surfaces are shown; `planes` are those
    /// of its cell.
    pub fn clipped_triangle(&self, place: PlacedCell, triangle: usize, planes: &[[Plane; 2]; 2]) -> f64 {
        let cell = place.cell;
        let corners = self.corners(place);
        if cell.corners(triangle).iter().all(|&i| self.state[corners[i]] != VALID) {
            return 0.0;
        }
        let planes = (planes[0][triangle], planes[1][triangle]);
        let mut worst = self.valid_samples(place, triangle, planes);
        for y in 0..cell.s {
            for x in cell_columns(cell, triangle, y) {
                let bits = self.unit[(place.y + y) * self.n + place.x + x];
                if bits & HAS_VALID != 0 && crossed(planes.1, x, y, bits) {
                    worst = worst.max(self.unit_cell(place, (x, y), triangle, planes));
                }
            }
        }
        worst
    }

    /// Largest `|z - D|` at the valid samples under one drawn triangle, where it is shown.
    fn valid_samples(&self, place: PlacedCell, triangle: usize, (height, validity): (Plane, Plane)) -> f64 {
        let s = place.cell.s;
        let mut worst = 0.0_f64;
        for y in 0..=s {
            let columns = match (place.cell.falling, triangle) {
                (true, 0) => y..=s,
                (true, _) => 0..=y,
                (false, 0) => 0..=s - y,
                (false, _) => s - y..=s,
            };
            for x in columns {
                let index = self.at(place.x + x, place.y + y);
                let (i, j) = (x as f64, y as f64);
                if self.state[index] == VALID && validity.value(i, j) >= 0.5 {
                    worst = worst.max((self.z[index].wide() - height.value(i, j)).abs());
                }
            }
        }
        worst
    }

    /// Largest `|z - D|` of the fine triangles of unit cell `(x, y)` that lie in `triangle`, where
    /// both surfaces are shown.
    fn unit_cell(
        &self,
        place: PlacedCell,
        (x, y): (usize, usize),
        triangle: usize,
        (height, validity): (Plane, Plane),
    ) -> f64 {
        let unit = Cell { s: 1, falling: (place.x + x + place.y + y).is_multiple_of(2) };
        let mut worst = 0.0_f64;
        for part in 0..2 {
            let corners = unit.corners(part).map(|i| (x + (i & 1), y + (i >> 1)));
            let middle = corners.iter().fold((0, 0), |sum, c| (sum.0 + c.0, sum.1 + c.1));
            if place.cell.triangle(middle.0 as f64 / 3.0, middle.1 as f64 / 3.0) != triangle {
                continue;
            }
            let vertices = corners.map(|(i, j)| {
                let index = self.at(place.x + i, place.y + j);
                let (i, j) = (i as f64, j as f64);
                Vertex {
                    fine: self.validity(index),
                    drawn: validity.value(i, j),
                    difference: self.z[index].wide() - height.value(i, j),
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

/// True if an outline may run through a unit cell and a part of the cell is shown. Elsewhere its
/// samples are enough.
fn crossed(validity: Plane, x: usize, y: usize, bits: u8) -> bool {
    let (low, high) = validity.range(x as f64, y as f64);
    high >= 0.5 && (low < 0.5 || bits & HAS_VOID != 0)
}
