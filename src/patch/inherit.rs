//! The errors of one tile: inherited from its children, plus the one step that is its own.

use crate::patch::blocks::Blocks;
use crate::patch::{Errors, TileGeometry, envelope, exact, make_monotone, outline, paper};
use crate::sample::{Coding, Lattice};

/// Errors of a leaf tile by metric `bound`; `unit` is the occupancy of its unit cells.
pub fn leaf_bound(lattice: &Lattice, unit: &[u8], coding: Coding, geometry: &TileGeometry) -> Errors {
    let (vertical, ahead_vertical) = exact::leaf(lattice, coding, unit, geometry);
    let outline = outline::leaf(&lattice.state, geometry.n, geometry.patch, geometry.odd, &geometry.scale);
    Errors { vertical, horizontal: outline.steps, ahead_vertical, ahead_horizontal: outline.ahead }
}

/// Errors of a leaf tile by metric `paper`.
pub fn leaf_paper(lattice: &Lattice, coding: Coding, geometry: &TileGeometry) -> Errors {
    let patches = geometry.patches() * geometry.patches();
    let mut errors = Errors {
        vertical: vec![vec![0.0; patches]],
        horizontal: vec![vec![0.0; patches]],
        ..Errors::default()
    };
    for step in 1..geometry.steps() {
        let (vertical, horizontal) = paper::one_step(lattice, coding, geometry, 1 << step);
        errors.vertical.push(vertical);
        errors.horizontal.push(horizontal);
    }
    make_monotone(&mut errors.vertical);
    make_monotone(&mut errors.horizontal);
    errors
}

/// Errors of a tile above its children by metric `bound`. A missing child does not contribute.
pub fn parent_bound(
    children: [Option<&Errors>; 4],
    lattice: &Lattice,
    blocks: &Blocks,
    coding: Coding,
    geometry: &TileGeometry,
) -> Errors {
    let mut errors = inherited(children, geometry);
    let own = |ahead: &mut Vec<Vec<f64>>, measure: &dyn Fn() -> Vec<f64>| {
        if ahead.is_empty() { measure() } else { ahead.remove(0) }
    };
    let vertical =
        own(&mut errors.ahead_vertical, &|| envelope::coarsest_step(lattice, blocks, coding, geometry));
    let horizontal = own(&mut errors.ahead_horizontal, &|| {
        let (n, patch) = (geometry.n, geometry.patch);
        outline::above(&lattice.state, &blocks.state, n, patch, geometry.odd, &geometry.scale)
    });
    finish(errors, vertical, horizontal)
}

/// Errors of a tile above its children by metric `paper`.
pub fn parent_paper(
    children: [Option<&Errors>; 4],
    lattice: &Lattice,
    coding: Coding,
    geometry: &TileGeometry,
) -> Errors {
    let errors = inherited(children, geometry);
    let (vertical, horizontal) = paper::one_step(lattice, coding, geometry, geometry.patch);
    finish(errors, vertical, horizontal)
}

fn finish(mut errors: Errors, vertical: Vec<f64>, horizontal: Vec<f64>) -> Errors {
    errors.vertical.push(vertical);
    errors.horizontal.push(horizontal);
    make_monotone(&mut errors.vertical);
    make_monotone(&mut errors.horizontal);
    errors
}

/// The errors that a tile takes over from its children: `e(parent, k) = max e(child, k + 1)` for
/// the steps below the last; of those measured ahead, the squares of the children side by side.
fn inherited(children: [Option<&Errors>; 4], geometry: &TileGeometry) -> Errors {
    let patches = geometry.patches();
    let steps = |pick: fn(&Errors) -> &Vec<Vec<f64>>| {
        (1..geometry.steps())
            .map(|k| maximum_of_four(&join(children, patches, |e| pick(e).get(k)), 2 * patches))
            .collect::<Vec<_>>()
    };
    let ahead = |pick: fn(&Errors) -> &Vec<Vec<f64>>| {
        // Leaves may lie at different levels: a size counts only if all children have measured it
        // ahead.
        let count = children.iter().flatten().map(|e| pick(e).len()).min().unwrap_or(0);
        (0..count)
            .map(|j| join(children, geometry.patches() >> (j + 1), |e| pick(e).get(j)))
            .collect::<Vec<_>>()
    };
    // A child's first square ahead has cells of twice its own patch: at the parent they are one
    // patch each.
    Errors {
        vertical: steps(|e| &e.vertical),
        horizontal: steps(|e| &e.horizontal),
        ahead_vertical: ahead(|e| &e.ahead_vertical),
        ahead_horizontal: ahead(|e| &e.ahead_horizontal),
    }
}

/// The squares of `side x side` numbers of four children, side by side; zeros for a missing child.
fn join<'a>(
    children: [Option<&'a Errors>; 4],
    side: usize,
    pick: impl Fn(&'a Errors) -> Option<&'a Vec<f64>>,
) -> Vec<f64> {
    let width = 2 * side;
    let mut out = vec![0.0; width * width];
    for (quadrant, child) in children.iter().enumerate() {
        let Some(square) = child.and_then(&pick) else { continue };
        let (x0, y0) = ((quadrant & 1) * side, (quadrant >> 1) * side);
        for y in 0..side {
            let to = (y0 + y) * width + x0;
            out[to..to + side].copy_from_slice(&square[y * side..(y + 1) * side]);
        }
    }
    out
}

/// The maxima of a square of side `side`, taken two by two.
fn maximum_of_four(square: &[f64], side: usize) -> Vec<f64> {
    let half = side / 2;
    let mut out = Vec::with_capacity(half * half);
    for y in 0..half {
        for x in 0..half {
            let at = 2 * y * side + 2 * x;
            out.push(square[at].max(square[at + 1]).max(square[at + side]).max(square[at + side + 1]));
        }
    }
    out
}
