//! Metric `paper`: one-step errors of the dropped vertices (dissertation 000, sections 3.1 and 4.1;
//! paper 001, equation 5 and table 1).
//!
//! Going from spacing s/2 to s drops the vertices that are not on the coarser lattice. Each was the
//! midpoint C of an edge AB: horizontal, vertical, or, for the centre of a cell, both diagonals.
//! `Ev = |z_C - (z_A + z_B) / 2|`; `Eh` from the void table. The maximum over a patch is its error;
//! it is not a bound of the deviation.

use crate::patch::TileGeometry;
use crate::sample::{Coding, Lattice, VALID};

/// One-step errors in metres of every patch for spacing `s`, patches row by row: vertical,
/// horizontal.
pub fn one_step(
    lattice: &Lattice,
    coding: Coding,
    geometry: &TileGeometry,
    s: usize,
) -> (Vec<f64>, Vec<f64>) {
    let patches = geometry.patches();
    let mut vertical = vec![0.0_f64; patches * patches];
    let mut horizontal = vec![0.0_f64; patches * patches];
    for row in 0..patches {
        for column in 0..patches {
            let (mut ev, mut eh) = (0.0_f64, 0.0_f64);
            let (x0, y0) = (column * geometry.patch, row * geometry.patch);
            dropped(geometry.patch, s, |c, a, b| {
                let at = |(x, y): (usize, usize)| lattice.at(x0 + x, y0 + y);
                let (v, h) = edge_error(lattice, coding, geometry, [at(a), at(c), at(b)], (a, b));
                ev = ev.max(v);
                eh = eh.max(h);
            });
            vertical[row * patches + column] = ev * geometry.metres;
            horizontal[row * patches + column] = eh;
        }
    }
    (vertical, horizontal)
}

/// Calls `edge(C, A, B)` for every vertex dropped between spacings s/2 and s in a patch, border
/// included.
fn dropped(patch: usize, s: usize, mut edge: impl FnMut((usize, usize), (usize, usize), (usize, usize))) {
    let h = s / 2;
    for y in (0..=patch).step_by(h) {
        for x in (0..=patch).step_by(h) {
            match (x % s != 0, y % s != 0) {
                (false, false) => {}
                (true, false) => edge((x, y), (x - h, y), (x + h, y)),
                (false, true) => edge((x, y), (x, y - h), (x, y + h)),
                (true, true) => {
                    edge((x, y), (x - h, y - h), (x + h, y + h));
                    edge((x, y), (x + h, y - h), (x - h, y + h));
                }
            }
        }
    }
}

/// The errors of dropping C between A and B: vertical in the unit of heights, horizontal in metres.
fn edge_error(
    lattice: &Lattice,
    coding: Coding,
    geometry: &TileGeometry,
    [a, c, b]: [usize; 3],
    (from, to): ((usize, usize), (usize, usize)),
) -> (f64, f64) {
    let valid = [a, c, b].map(|i| lattice.state[i] == VALID);
    if valid == [false; 3] {
        return (0.0, 0.0);
    }
    let height = |i: usize| match coding {
        Coding::Integer { .. } => f64::from(lattice.code[i]),
        _ => lattice.value(i, coding),
    };
    let vertical = (height(c) - 0.5 * (height(a) + height(b))).abs();
    let across = to.0.abs_diff(from.0) as f64 * geometry.spacing.dx;
    let down = to.1.abs_diff(from.1) as f64 * geometry.spacing.dy;
    // `hsize` of the papers: metres from A to C.
    let hsize = 0.5 * across.hypot(down);
    let horizontal = match valid {
        [true, true, true] | [false, false, false] => 0.0,
        [true, false, true] | [false, true, false] => hsize,
        _ => 0.5 * hsize,
    };
    (vertical, horizontal)
}
