//! Vertical error above the leaves: the extremes of blocks against the drawn planes.
//!
//! Every tile has the minimum and maximum of the full-resolution surface over blocks of one of its
//! intervals. The drawn surface is linear over a block, or linear on both sides of a diagonal of
//! the block, so its extremes are at the block's corners, and the deviation inside is at most the
//! larger of `max - min D` and `max D - min`.

use crate::patch::TileGeometry;
use crate::patch::blocks::{Blocks, extreme_coding};
use crate::patch::cell::Cell;
use crate::sample::{Coding, Lattice, VALID, VOID};

/// Vertical error in metres of every patch drawn as one cell, patches row by row.
///
/// f64 is exact for integer codes (33 bits and a division by a power of two). For floats it rounds
/// by a few units in the last place, which a slack covers.
pub fn coarsest_step(
    lattice: &Lattice,
    blocks: &Blocks,
    coding: Coding,
    geometry: &TileGeometry,
) -> Vec<f64> {
    let patches = geometry.patches();
    let mut errors = Vec::with_capacity(patches * patches);
    let mut rows = Rows::default();
    for row in 0..patches {
        for column in 0..patches {
            let cell = Cell { s: geometry.patch, falling: geometry.falling(geometry.patch, column, row) };
            let error = patch_error(lattice, blocks, coding, cell, (column, row), &mut rows);
            errors.push(error * geometry.metres);
        }
    }
    errors
}

/// Drawn heights and validities along two rows of block corners.
#[derive(Default)]
struct Rows {
    north: Vec<f64>,
    south: Vec<f64>,
    north_valid: Vec<f64>,
    south_valid: Vec<f64>,
}

/// Height of a sample in the numbers that errors are measured in.
fn height(lattice: &Lattice, index: usize, coding: Coding) -> f64 {
    match coding {
        Coding::Integer { .. } => f64::from(lattice.code[index]),
        _ => lattice.value(index, coding),
    }
}

fn patch_error(
    lattice: &Lattice,
    blocks: &Blocks,
    coding: Coding,
    cell: Cell,
    (column, row): (usize, usize),
    rows: &mut Rows,
) -> f64 {
    let s = cell.s;
    let (x0, y0) = (column * s, row * s);
    let corners = [(0, 0), (s, 0), (0, s), (s, s)].map(|(x, y)| lattice.at(x0 + x, y0 + y));
    let valid = corners.map(|i| f64::from(u8::from(lattice.state[i] == VALID)));
    if valid == [0.0; 4] {
        return 0.0;
    }
    // A void corner without a fill is part of no shown triangle; 0 keeps the arithmetic finite.
    let heights = corners.map(|i| if lattice.state[i] == VOID { 0.0 } else { height(lattice, i, coding) });
    let planes = cell.planes(heights);
    let validity = cell.planes(valid);
    let mixed = valid.contains(&0.0);
    let fill = |y: usize, out: &mut Vec<f64>, planes: &[crate::patch::cell::Plane; 2]| {
        out.clear();
        out.extend((0..=s).map(|x| {
            let (x, y) = (x as f64, y as f64);
            planes[cell.triangle(x, y)].value(x, y)
        }));
    };
    let mut worst = 0.0_f64;
    fill(0, &mut rows.north, &planes);
    fill(0, &mut rows.north_valid, &validity);
    for y in 0..s {
        fill(y + 1, &mut rows.south, &planes);
        if mixed {
            fill(y + 1, &mut rows.south_valid, &validity);
        }
        let from = (y0 + y) * blocks.n + x0;
        for x in 0..s {
            let (low, high) = (blocks.min[from + x], blocks.max[from + x]);
            if low > high {
                continue;
            }
            if mixed && hidden(rows, x) {
                continue;
            }
            let d = [rows.north[x], rows.north[x + 1], rows.south[x], rows.south[x + 1]];
            let (d_low, d_high) = (d[0].min(d[1]).min(d[2]).min(d[3]), d[0].max(d[1]).max(d[2]).max(d[3]));
            let (low, high) = extremes(low, high, coding);
            worst = worst.max(high - d_low).max(d_high - low);
        }
        std::mem::swap(&mut rows.north, &mut rows.south);
        if mixed {
            std::mem::swap(&mut rows.north_valid, &mut rows.south_valid);
        }
    }
    let exact = matches!(coding, Coding::Integer { .. });
    if exact || worst == 0.0 {
        return worst;
    }
    worst + heights.iter().fold(worst, |a, h| a.max(h.abs())) * (0.5_f64).powi(49)
}

/// True if no point of block `x` between the two rows of corners is shown.
fn hidden(rows: &Rows, x: usize) -> bool {
    [rows.north_valid[x], rows.north_valid[x + 1], rows.south_valid[x], rows.south_valid[x + 1]]
        .iter()
        .all(|&v| v < 0.5)
}

/// Extremes of a block in the numbers that errors are measured in.
#[inline]
fn extremes(low: i32, high: i32, coding: Coding) -> (f64, f64) {
    match coding {
        Coding::Integer { .. } => (f64::from(low), f64::from(high)),
        _ => (extreme_coding(coding).value(low, 0), extreme_coding(coding).value(high, 0)),
    }
}
