//! Horizontal error of patches: how far from the outline of the voids something is shown or hidden wrongly.
//!
//! At full resolution validity is 1 or 0 at samples and linear in triangles; the outline is where it is 1/2. Drawn at a
//! coarser spacing the same holds for coarser triangles, and points between the two outlines are misdrawn. The error is
//! the largest distance of a misdrawn point from the outline at full resolution, as far as it lies within the tile: never
//! smaller than the distance from the whole outline. A square of cells with valid samples only, or void ones only, is
//! drawn as it is; any other holds a part of the outline, so the distance is always finite.
//!
//! Outlines are short beside a tile, and most of a tile is drawn as it should be. So little is worked out for all samples: how far
//! the nearest vertex of the outline is in their own column, in vectors (`marks`). The first step comes from a table of patterns
//! (`patterns`); the others are searches that look closely only at what may be farthest (`search`), and remember what they have
//! found for the next step.
//!
//! Distances are lengths in a plane in which no line between the rows that it passes is shorter than on the ground ([`Planes`]). On a
//! geographic raster of large pixels every look has a plane of its own, for the rows of what it looks at: all that is compared are upper
//! bounds in metres, wherever they come from.
//!
//! Not here: errors of children. The caller takes the maximum with them.

mod above_cell;
mod features;
mod leaf_cell;
mod marks;
mod patterns;
mod search;
mod shape;
#[cfg(test)]
mod tests;

use std::cell::Cell as ThreadCell;

use crate::geo::{Planes, Scale};
use crate::simd;
use above_cell::AboveCells;
use features::{AllAlike, CellBits, Validity};
use leaf_cell::{Grid, LeafCells, is_long};
use marks::Marks;
use patterns::Patterns;
use search::{Drawing, MIXED, Pyramid};
use shape::{Segments, Somewheres};

/// Horizontal errors of a leaf tile, metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LeafOutline {
    /// For each step `k = 0..=p`, the patches row by row, drawn at spacing `2^k`. Step 0 is all 0, and no step is smaller
    /// than a finer one.
    pub steps: Vec<Vec<f64>>,
    /// For each spacing `s = 2P, 4P, .., n`, the `(n / s)^2` cells of that size row by row; no smaller than what is in them.
    pub ahead: Vec<Vec<f64>>,
}

/// Intervals of a tile up to which a thread keeps its buffers from tile to tile.
const KEPT_INTERVALS: usize = 512;

/// Buffers of one thread.
#[derive(Default)]
struct Scratch {
    /// 1 where a sample is valid, `(n + 1)^2`.
    valid: Vec<u8>,
    marks: [Marks; 2],
    pyramid: Pyramid,
    patterns: Patterns,
    segments: Segments,
    places: Somewheres,
    planes: Planes,
    near: Vec<(usize, usize)>,
}

thread_local! {
    static SCRATCH: ThreadCell<Option<Box<Scratch>>> = const { ThreadCell::new(None) };
}

/// Does something with the buffers of this thread.
fn with_scratch<T>(n: usize, work: impl FnOnce(&mut Scratch) -> T) -> T {
    let mut scratch = SCRATCH.take().unwrap_or_default();
    let result = work(&mut scratch);
    if n <= KEPT_INTERVALS {
        SCRATCH.set(Some(scratch));
    }
    result
}

/// Errors of a tile whose samples are the full resolution.
///
/// `state` holds `(n + 1)^2` samples; `n` and `patch` are powers of two, `2 <= patch <= n <= 2048`, `4 <= n`. `parity`
/// is the parity of tile x + y: it decides the diagonal of the one cell of spacing `n`. A tile without a void or
/// without a valid sample costs one look at its samples.
pub fn leaf(state: &[u8], n: usize, patch: usize, parity: bool, scale: &Scale) -> LeafOutline {
    debug_assert!(
        n.is_power_of_two() && patch.is_power_of_two() && patch <= n && state.len() == (n + 1) * (n + 1)
    );
    let (top, p) = (n.ilog2() as usize, patch.ilog2() as usize);
    let zeros = |level: usize| vec![0.0; (n >> level) * (n >> level)];
    let mut errors =
        LeafOutline { steps: (0..=p).map(|_| zeros(p)).collect(), ahead: (p + 1..=top).map(zeros).collect() };
    if simd::run(AllAlike { state }) {
        return errors;
    }
    with_scratch(n, |scratch| leaf_errors(scratch, state, n, parity, scale, &mut errors));
    errors
}

/// [`leaf`] of a tile with valid and void samples.
fn leaf_errors(
    scratch: &mut Scratch,
    state: &[u8],
    n: usize,
    parity: bool,
    scale: &Scale,
    errors: &mut LeafOutline,
) {
    let Scratch { valid, marks: [marks, _], pyramid, patterns, segments, planes, near, .. } = scratch;
    planes.start(scale, n);
    simd::run(Validity { state, valid });
    marks.outline(valid, n);
    simd::run(CellBits { valid, n, bits: pyramid.start(n) });
    pyramid.build();
    let grid = Grid { valid, n };
    patterns.start(planes);
    // In a long cell the nearest piece of the outline is seldom the one within the square.
    let first = if planes.is_even() && !is_long(planes.whole()) { 2 } else { 1 };
    if first == 2 {
        drawn_twice_as_wide(grid, pyramid.bits(1), planes, (patterns, segments), &mut errors.steps);
    }
    let mut cells = LeafCells { grid, planes, marks, patterns, segments, near };
    let (top, p) = (n.ilog2() as usize, errors.steps.len() - 1);
    // Squared until all are there: each starts from the next finer one, since errors grow with the spacing.
    for level in first..=top {
        let root = level.max(p);
        let drawing = Drawing { valid, level, flip: parity && level == top };
        let side = n >> root;
        for square in 0..side * side {
            let at = (square % side, square / side);
            let finer = if level <= p {
                errors.steps[level - 1][square]
            } else {
                let finer = if level == p + 1 { &errors.steps[p] } else { &errors.ahead[level - p - 2] };
                let quarter = |q: usize| finer[(2 * at.1 + q / 2) * 2 * side + 2 * at.0 + q % 2];
                (0..4).map(quarter).fold(0.0, f64::max)
            };
            let farthest = pyramid.farthest(&drawing, root, at, finer, &mut cells);
            if level <= p {
                errors.steps[level][square] = farthest;
            } else {
                errors.ahead[level - p - 1][square] = farthest;
            }
        }
    }
    for squared in errors.steps.iter_mut().chain(&mut errors.ahead).flatten() {
        *squared = metres(*squared);
    }
}

/// Errors of spacing 2, squared: the first step, of squares of 2 x 2 cells that hold `bits`.
fn drawn_twice_as_wide(
    grid: Grid,
    bits: &[u8],
    planes: &Planes,
    (patterns, segments): (&mut Patterns, &mut Segments),
    steps: &mut [Vec<f64>],
) {
    let (side, p) = (grid.n / 2, steps.len() - 1);
    for (y, row) in bits.chunks_exact(side).enumerate() {
        let errors = &mut steps[1][(y >> (p - 1)) * (side >> (p - 1))..];
        for (first, some) in (0..).step_by(16).zip(row.chunks(16)) {
            // Few squares are mixed.
            if !some.contains(&MIXED) {
                continue;
            }
            for x in (first..).zip(some).filter_map(|(x, &bits)| (bits == MIXED).then_some(x)) {
                let error = &mut errors[x >> (p - 1)];
                *error = error.max(patterns.drawn(grid, (x, y), planes.over(2 * y, 2 * y + 2), segments));
            }
        }
    }
}

/// The root of a squared distance, rounded up.
fn metres(squared: f64) -> f64 {
    squared.sqrt() * (1.0 + 1e-9)
}

/// What spacing `patch` adds to the errors of the patches of a tile above the leaves, row by row.
///
/// **To be joined with the errors of spacing `patch / 2` by maximum**: a point that is misdrawn there already is in
/// them, so only points are looked at whose drawing the last halving of the detail has changed.
///
/// `state` holds its own `(n + 1)^2` samples. `block` says of each of the `n x n` closed blocks (one interval of this
/// level) what the full resolution has in it: bit 0 a valid sample, bit 1 a void one. `scale` is of this level's
/// intervals. `parity` as for [`leaf`]; it matters if there is one patch only. `4 <= patch`.
///
/// A block with both holds a point of the outline, somewhere; so does any path from a valid sample to a void one.
/// Hence the error is too large by about a block's diagonal at most.
pub fn above(state: &[u8], block: &[u8], n: usize, patch: usize, parity: bool, scale: &Scale) -> Vec<f64> {
    debug_assert!(state.len() == (n + 1) * (n + 1) && block.len() == n * n && patch >= 4);
    let side = n / patch;
    let mut errors = vec![0.0; side * side];
    let any = block.iter().fold(0, |any, bits| any | bits);
    if any & MIXED != MIXED {
        return errors;
    }
    with_scratch(n, |scratch| {
        let Scratch { valid, marks: [void, nearest_valid], pyramid, places, planes, .. } = scratch;
        planes.start(scale, n);
        simd::run(Validity { state, valid });
        let is_mixed: Vec<u8> = block.iter().map(|&bits| u8::from(bits & MIXED == MIXED)).collect();
        void.places(valid, &is_mixed, n, false);
        nearest_valid.places(valid, &is_mixed, n, true);
        pyramid.start(n).copy_from_slice(block);
        pyramid.build();
        let level = patch.ilog2() as usize;
        let drawing = Drawing { valid, level, flip: parity && patch == n };
        let mut cells = AboveCells {
            samples: valid,
            block,
            n,
            finer: patch / 2,
            void,
            valid: nearest_valid,
            planes,
            places,
        };
        for (i, error) in errors.iter_mut().enumerate() {
            *error = metres(pyramid.farthest(&drawing, level, (i % side, i / side), 0.0, &mut cells));
        }
    });
    errors
}
