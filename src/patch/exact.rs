//! Vertical error of the cells inside a leaf tile, exact: every sample against the drawn planes.
//!
//! Drawn triangles are unions of fine ones (the alternating diagonals nest), so the difference of
//! the surfaces is linear on each fine triangle and largest at a vertex of the part that is shown.
//! Without voids these are the samples (`small_cells`, `blocked`); with voids also the points where
//! an outline crosses an edge (`cells_with_voids`).

use crate::patch::blocked::{Blocked, PlacedCell};
use crate::patch::blocks::{HAS_VALID, HAS_VOID, MIXED, reduce_state};
use crate::patch::cell::Cell;
use crate::patch::cells_with_voids::CellsWithVoids;
use crate::patch::drawn_surface::SIDE;
use crate::patch::heights::Heights;
use crate::patch::number::Number;
use crate::patch::small_cells::{MeasureSmallCells, STRIDE, SmallCells};
use crate::patch::{TileGeometry, make_monotone};
use crate::sample::state;
use crate::sample::{Coding, Lattice};
use crate::simd;

/// Vertical errors in metres of all cells of 1, 2, 4 .. T intervals of a leaf tile of at least 16
/// intervals: `[step][patch]` up to the patch size, then one square of cells for each larger size.
pub fn leaf(
    lattice: &Lattice,
    coding: Coding,
    unit: &[u8],
    geometry: &TileGeometry,
) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let heights = Heights::new(lattice, coding);
    let slack = heights.slack(coding);
    let (state, n) = (&lattice.state, geometry.n);
    let mut steps = match &heights {
        Heights::Short(z) => {
            let small = simd::run(MeasureSmallCells::<_, _, _, 16> { z, n, lane: |z| z as i16 });
            sizes(Tile::new(z, state, unit, slack, geometry), small)
        }
        Heights::Narrow(z) => {
            let small = simd::run(MeasureSmallCells::<_, _, _, 8> { z, n, lane: |z| z });
            sizes(Tile::new(z, state, unit, slack, geometry), small)
        }
        Heights::Wide(z) | Heights::Small(z) => {
            let small = simd::run(MeasureSmallCells::<_, _, _, 8> { z, n, lane: |z| z });
            sizes(Tile::new(z, state, unit, slack, geometry), small)
        }
    };
    let metres = geometry.metres * heights.unit();
    for (bits, errors) in steps.iter_mut().enumerate() {
        // Sums of a larger size have more terms.
        let slack = slack * f64::from(1_u32 << bits);
        for error in errors {
            *error = if *error > 0.0 { (*error + slack) * metres } else { 0.0 };
        }
    }
    let ahead = steps.split_off(geometry.steps());
    make_monotone(&mut steps);
    (steps, ahead)
}

/// A leaf tile that is measured.
struct Tile<'a, N> {
    z: &'a [N],
    state: &'a [u8],
    /// More than the rounding of a height difference; 0 if sums are exact.
    margin: f64,
    geometry: &'a TileGeometry,
    /// Its cells with voids; `None` if there are no voids.
    voids: Option<CellsWithVoids<'a, N>>,
}

impl<'a, N: Number> Tile<'a, N> {
    fn new(z: &'a [N], state: &'a [u8], unit: &'a [u8], slack: f64, geometry: &'a TileGeometry) -> Self {
        let n = geometry.n;
        let full = unit.iter().fold(HAS_VALID, |all, bits| all | bits) == HAS_VALID;
        let margin = slack * n as f64;
        let voids = (!full).then_some(CellsWithVoids { z, unit, n, margin, state });
        Self { z, state, margin, geometry, voids }
    }

    fn place(&self, s: usize, column: usize, row: usize) -> PlacedCell {
        let cell = Cell { s, falling: self.geometry.falling(s, column, row) };
        PlacedCell { cell, x: column * s, y: row * s }
    }
}

/// Errors of one size: the largest of the cells in each square of a grid.
struct Grid {
    errors: Vec<f64>,
    /// Squares on a side.
    side: usize,
    /// Bits of the number of cells on a side of a square.
    bits: u32,
}

impl Grid {
    fn new(s: usize, geometry: &TileGeometry) -> Self {
        let cells = geometry.n / s;
        let side = cells.min(geometry.patches());
        Self { errors: vec![0.0; side * side], side, bits: (cells / side).trailing_zeros() }
    }

    fn of(&mut self, column: usize, row: usize) -> &mut f64 {
        &mut self.errors[(row >> self.bits) * self.side + (column >> self.bits)]
    }
}

/// Errors for every size, in the numbers of the heights.
fn sizes<N: Number, M: Number>(tile: Tile<'_, N>, mut small: SmallCells<M>) -> Vec<Vec<f64>> {
    let geometry = tile.geometry;
    let n = geometry.n;
    // Occupancy of the cells of each size, if there are voids.
    let mut states: Vec<Vec<u8>> = Vec::new();
    if let Some(voids) = &tile.voids {
        states.push(voids.unit.to_vec());
        for bits in 0..n.trailing_zeros() {
            states.push(reduce_state(&states[bits as usize], n >> bits));
        }
    }
    let state = |s: usize| states.get(s.trailing_zeros() as usize).map_or(&[][..], Vec::as_slice);
    let lattice = (tile.z, tile.state, n);
    let mut blocked = Blocked::new(
        lattice,
        4.0 * tile.margin,
        small.row_by_row(SIDE, |e| N::narrow(e.wide())),
        state(SIDE),
    );
    let mut errors = vec![vec![0.0; geometry.patches() * geometry.patches()]];
    for s in (1..=n.trailing_zeros()).map(|bits| 1 << bits) {
        let mut grid = Grid::new(s, geometry);
        if s < STRIDE {
            small_cells(&tile, &mut small, &mut blocked, s, state(s), &mut grid);
        } else {
            large_cells(&tile, &mut blocked, s, state(s), &mut grid);
        }
        errors.push(grid.errors);
    }
    errors
}

/// Raises `grid` to the errors of the cells of a small size, which `small` has as if all samples
/// were valid.
fn small_cells<N: Number, M: Number>(
    tile: &Tile<'_, N>,
    small: &mut SmallCells<M>,
    blocked: &mut Blocked<N>,
    s: usize,
    state: &[u8],
    grid: &mut Grid,
) {
    let cells = tile.geometry.n / s;
    let scale = 1.0 / s as f64;
    // Cells with voids are measured apart; the error as if all samples were valid bounds theirs.
    let mut apart = Vec::new();
    for (row, state) in state.chunks_exact(cells).enumerate() {
        state::each_other_place(state, HAS_VALID, |column| {
            let bound = std::mem::replace(small.of(s, column, row), M::ZERO);
            if state[column] == MIXED {
                apart.push((column, row, bound.wide() * scale));
            }
        });
    }
    if tile.geometry.patch < STRIDE {
        for (row, column) in (0..cells * cells).map(|i| (i / cells, i % cells)) {
            let to = grid.of(column, row);
            *to = to.max(small.of(s, column, row).wide() * scale);
        }
    } else {
        let (mut columns, squares) = (Vec::new(), 1 << grid.bits);
        for row in (0..cells).step_by(squares) {
            small.group_maxima(s, row..row + squares, &mut columns);
            for (lane, worst) in columns.iter().enumerate().take(tile.geometry.n / STRIDE) {
                let to = grid.of(lane * STRIDE / s, row);
                *to = to.max(worst.wide() * scale);
            }
        }
    }
    let Some(voids) = &tile.voids else { return };
    for (column, row, bound) in apart {
        let to = grid.of(column, row);
        *to = voids.error(blocked, tile.place(s, column, row), bound, *to);
    }
}

/// Raises `grid` to the errors of the cells of a large size, measured one by one.
fn large_cells<N: Number>(
    tile: &Tile<'_, N>,
    blocked: &mut Blocked<N>,
    s: usize,
    state: &[u8],
    grid: &mut Grid,
) {
    let cells = tile.geometry.n / s;
    for (row, column) in (0..cells * cells).map(|at| (at / cells, at % cells)) {
        let place = tile.place(s, column, row);
        let to = grid.of(column, row);
        match (&tile.voids, state.get(row * cells + column)) {
            (_, Some(&HAS_VOID)) => {}
            (Some(voids), Some(&MIXED)) => *to = voids.error(blocked, place, f64::INFINITY, *to),
            _ => *to = to.max(blocked.error_full(place, *to)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::Spacing;
    use crate::patch::blocks::Blocks;
    use crate::patch::cell::{Vertex, shown_difference};
    use crate::sample::{FILLED, VALID, VOID, code_from_f32};
    use proptest::prelude::*;

    /// A tile of rough terrain with round voids and single void samples.
    fn tile(n: usize, seed: u64, holes: u64, mut height: impl FnMut(u64) -> i32) -> Lattice {
        let mut state = seed | 1;
        let mut random = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            state >> 33
        };
        let discs: Vec<[u64; 3]> = (0..holes)
            .map(|_| [random() % (n as u64 + 1), random() % (n as u64 + 1), random() % 60])
            .collect();
        let mut lattice = Lattice::new(n, Coding::Integer { scale: 1.0, offset: 0.0 });
        for index in 0..lattice.code.len() {
            let (x, y) = ((index % (n + 1)) as u64, (index / (n + 1)) as u64);
            let within = |d: &[u64; 3]| d[0].abs_diff(x).pow(2) + d[1].abs_diff(y).pow(2) < d[2];
            let void = discs.iter().any(within) || holes > 0 && random() % 64 == 0;
            lattice.state[index] = if void { FILLED } else { VALID };
            lattice.code[index] = height(random());
        }
        let filled: Vec<bool> = (0..lattice.state.len()).map(|index| is_settled(&lattice, index)).collect();
        for (state, _) in
            lattice.state.iter_mut().zip(filled).filter(|(state, filled)| **state == FILLED && !filled)
        {
            *state = VOID;
        }
        lattice
    }

    /// True if a sample has a valid one around it, at a spacing that it belongs to.
    fn is_settled(lattice: &Lattice, index: usize) -> bool {
        let n = lattice.n;
        let (x, y) = (index % (n + 1), index / (n + 1));
        let spacings = (0..=n.trailing_zeros()).map(|bits| 1 << bits);
        spacings.filter(|&s| x.is_multiple_of(s) && y.is_multiple_of(s)).any(|s| {
            let around = (0..9).map(|i| (x + i % 3 * s, y + i / 3 * s));
            let inside = |&(x, y): &(usize, usize)| (s..=n + s).contains(&x) && (s..=n + s).contains(&y);
            around.filter(inside).any(|(x, y)| lattice.state[lattice.at(x - s, y - s)] == VALID)
        })
    }

    /// The largest difference of every square of a size: all fine triangles, clipped.
    fn clipped(lattice: &Lattice, coding: Coding, geometry: &TileGeometry, s: usize) -> Vec<f64> {
        let mut grid = Grid::new(s, geometry);
        let cells = geometry.n / s;
        let height = |i: usize| match coding {
            Coding::Integer { .. } => f64::from(lattice.code[i]),
            _ => lattice.value(i, coding),
        };
        let validity = |i: usize| f64::from(u8::from(lattice.state[i] == VALID));
        for (column, row) in (0..cells * cells).map(|i| (i % cells, i / cells)) {
            let cell = Cell { s, falling: geometry.falling(s, column, row) };
            let (x0, y0) = (column * s, row * s);
            let corners = [(0, 0), (s, 0), (0, s), (s, s)].map(|(x, y)| lattice.at(x0 + x, y0 + y));
            let (heights, shown) = (cell.planes(corners.map(height)), cell.planes(corners.map(validity)));
            let to = grid.of(column, row);
            for (x, y) in (0..s * s).map(|i| (i % s, i / s)) {
                let unit = Cell { s: 1, falling: (x0 + x + y0 + y).is_multiple_of(2) };
                for part in 0..2 {
                    let points = unit.corners(part).map(|i| (x + (i & 1), y + (i >> 1)));
                    let middle = points.iter().fold((0.0, 0.0), |m, p| (m.0 + p.0 as f64, m.1 + p.1 as f64));
                    let triangle = cell.triangle(middle.0 / 3.0, middle.1 / 3.0);
                    let vertices = points.map(|(i, j)| {
                        let (at, i, j) = (lattice.at(x0 + i, y0 + j), i as f64, j as f64);
                        Vertex {
                            fine: validity(at),
                            drawn: shown[triangle].value(i, j),
                            difference: height(at) - heights[triangle].value(i, j),
                        }
                    });
                    *to = to.max(shown_difference(vertices));
                }
            }
        }
        grid.errors
    }

    /// Errors of all sizes by both ways.
    fn both(lattice: &Lattice, coding: Coding, patch: usize, odd: bool) -> [Vec<Vec<f64>>; 2] {
        let n = lattice.n;
        let spacing = Spacing { dx: 30.0, dy: 20.0 };
        let geometry = TileGeometry { n, patch, odd, spacing, scale: spacing.into(), metres: 1.0 };
        let (unit, _) = Blocks::of_leaf(lattice, coding, &geometry);
        let (mut errors, ahead) = leaf(lattice, coding, &unit, &geometry);
        errors.extend(ahead);
        let sizes = (1..=n.trailing_zeros()).map(|bits| clipped(lattice, coding, &geometry, 1 << bits));
        let patches = geometry.patches() * geometry.patches();
        let mut expected: Vec<_> = std::iter::once(vec![0.0; patches]).chain(sizes).collect();
        make_monotone(&mut expected[..geometry.steps()]);
        [errors, expected]
    }

    const METRES: Coding = Coding::Integer { scale: 1.0, offset: 0.0 };

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        #[test]
        fn integers_equal_all_triangles_clipped(
            bits in 4_u32..7,
            patch in 2_u32..7,
            odd: bool,
            seed: u64,
            holes in prop_oneof![Just(0_u64), 1..8_u64, 40..80_u64],
            // Bits of the range: up to 16 codes stay 32 bits wide; the rest has another kind of
            // sums.
            (range, low) in prop_oneof![Just((10, 0)), Just((16, 1 << 20)), Just((20, -(1 << 19))), Just((30, -5))],
        ) {
            let n = 1 << bits;
            let lattice = tile(n, seed, holes, |random| low + (random % (1 << range)) as i32);
            let [errors, expected] = both(&lattice, METRES, 1 << patch.min(bits), odd);
            prop_assert_eq!(errors, expected);
        }

        #[test]
        fn floats_are_at_most_rounding_above_all_triangles_clipped(
            bits in 4_u32..7,
            patch in 2_u32..7,
            odd: bool,
            seed: u64,
            holes in prop_oneof![Just(0_u64), 1..8_u64, 40..80_u64],
        ) {
            let n = 1 << bits;
            let lattice = tile(n, seed, holes, |random| code_from_f32(random as f32 / 777.0 - 5e5));
            let [errors, expected] = both(&lattice, Coding::Float32, 1 << patch.min(bits), odd);
            for (error, expected) in errors.iter().flatten().zip(expected.iter().flatten()) {
                prop_assert!(error >= expected && *error <= expected + 1e-6, "{} {}", error, expected);
            }
        }
    }
}
