//! Horizontal error of patches: the largest distance from the outline of the voids of a point that
//! is shown or hidden wrongly.
//!
//! At full resolution validity is 1 or 0 at samples and linear in triangles; the outline is where
//! it is 1/2. Drawn at a coarser spacing, validity is linear in coarser triangles, and points
//! between the two outlines are misdrawn. The error is the largest distance of a misdrawn point
//! from the outline at full resolution, as far as it lies within the tile: never smaller than the
//! distance from the whole outline. A square of cells with valid samples only, or void samples
//! only, is drawn rightly; any other holds a part of the outline, so the distance is always finite.
//!
//! Outlines are short, and most of a tile is drawn rightly. So only one number is computed for all
//! samples, in vectors: the distance of the nearest vertex of the outline in the same column
//! (`distance_transform`). The first step comes from a table of patterns (`patterns`). The others
//! are searches by branch and bound (`search`), which keep their upper bounds for the next step
//! (`pyramid`).
//!
//! Distances are lengths in a plane that covers some rows, in which no line between these rows is
//! shorter than on the ground ([`Planes`]). On a geographic raster of large pixels each evaluation
//! has its own plane, for its rows; upper bounds in metres can be compared whatever their planes.
//!
//! The errors of children are not in the result: the caller takes the maximum with them.

mod above_cell;
mod bound;
mod distance_transform;
mod grid;
mod leaf_cell;
mod patterns;
#[cfg(test)]
mod plain_bound;
mod pyramid;
mod search;
mod shape;
#[cfg(test)]
mod tests;
mod validity;

use std::cell::Cell as ThreadCell;

use crate::geo::{Planes, Scale};
use crate::patch::blocks::MIXED;
use crate::simd;
use above_cell::AboveCells;
use distance_transform::DistanceTransform;
use grid::{Grid, is_long};
use leaf_cell::LeafCells;
use patterns::Patterns;
use pyramid::Pyramid;
use search::{Drawing, farthest};
use shape::{Segments, UncertainPoints};
use validity::{AllAlike, CellBits, Validity};

/// Horizontal errors of a leaf tile, metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LeafOutline {
    /// For each step `k = 0..=p`, the patches row by row, drawn at spacing `2^k`. Step 0 is all 0,
    /// and no error is smaller than at a finer step.
    pub steps: Vec<Vec<f64>>,
    /// For each spacing `s = 2P, 4P, .., n`, the `(n / s)^2` cells of that size row by row; no
    /// error is smaller than those inside the cell.
    pub ahead: Vec<Vec<f64>>,
}

/// Most intervals of a tile with which a thread keeps its scratch memory from tile to tile.
const KEPT_INTERVALS: usize = 512;

/// Scratch memory of one thread.
#[derive(Default)]
struct Scratch {
    /// 1 where a sample is valid, `(n + 1)^2`.
    valid: Vec<u8>,
    transforms: [DistanceTransform; 2],
    pyramid: Pyramid,
    patterns: Patterns,
    segments: Segments,
    points: UncertainPoints,
    planes: Planes,
    near: Vec<(usize, usize)>,
}

thread_local! {
    static SCRATCH: ThreadCell<Option<Box<Scratch>>> = const { ThreadCell::new(None) };
}

/// Runs `work` with the scratch memory of this thread.
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
/// `state` holds `(n + 1)^2` samples; `n` and `patch` are powers of two, `2 <= patch <= n <= 2048`,
/// `4 <= n`. `parity` is the parity of tile x + y: it decides the diagonal of the one cell of
/// spacing `n`. A tile without a void, or without a valid sample, costs one pass over its samples.
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
    let Scratch { valid, transforms: [transform, _], pyramid, patterns, segments, planes, near, .. } =
        scratch;
    planes.start(scale, n);
    simd::run(Validity { state, valid });
    transform.of_outline(valid, n);
    simd::run(CellBits { valid, n, bits: pyramid.start(n) });
    pyramid.build();
    let grid = Grid { valid, n };
    patterns.start(planes);
    // In a long cell the nearest piece of the outline is seldom inside the square.
    let first = if planes.is_even() && !is_long(planes.whole()) { 2 } else { 1 };
    if first == 2 {
        drawn_twice_as_wide(grid, pyramid.bits(1), planes, (patterns, segments), &mut errors.steps);
    }
    let mut cells = LeafCells { grid, planes, transform, patterns, segments, near };
    let (top, p) = (n.ilog2() as usize, errors.steps.len() - 1);
    // Squared until all are known: each search starts from the next finer error, since errors grow
    // with the spacing.
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
                let child = |q: usize| finer[(2 * at.1 + q / 2) * 2 * side + 2 * at.0 + q % 2];
                (0..4).map(child).fold(0.0, f64::max)
            };
            let farthest = farthest(pyramid, &drawing, root, at, finer, &mut cells);
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

/// Sets the errors of spacing 2, squared: the first step. `bits` are those of the squares of 2 x 2
/// cells.
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

/// The errors that spacing `patch` adds for the patches of a tile above the leaves, row by row,
/// metres.
///
/// **Take the maximum with the errors of spacing `patch / 2`**: they cover the points that are
/// misdrawn there already. So only points are evaluated whose state differs between the two
/// spacings.
///
/// `state` holds its own `(n + 1)^2` samples. `block` has the bits of each of the `n x n` closed
/// blocks (one interval of this level) at full resolution: bit 0 for a valid sample, bit 1 for a
/// void one. `scale` is of this level's intervals. `parity` is as for [`leaf`]; it is used only if
/// there is one patch. `4 <= patch`.
///
/// A block with both bits holds a point of the outline; so does any path from a valid sample to a
/// void one. Hence the error is too large by at most about a block's diagonal.
pub fn above(state: &[u8], block: &[u8], n: usize, patch: usize, parity: bool, scale: &Scale) -> Vec<f64> {
    debug_assert!(state.len() == (n + 1) * (n + 1) && block.len() == n * n && patch >= 4);
    let side = n / patch;
    let mut errors = vec![0.0; side * side];
    let any = block.iter().fold(0, |any, bits| any | bits);
    if any & MIXED != MIXED {
        return errors;
    }
    with_scratch(n, |scratch| {
        let Scratch { valid, transforms: [void, nearest_valid], pyramid, points, planes, .. } = scratch;
        planes.start(scale, n);
        simd::run(Validity { state, valid });
        let is_mixed: Vec<u8> = block.iter().map(|&bits| u8::from(bits & MIXED == MIXED)).collect();
        void.of_kind(valid, &is_mixed, n, false);
        nearest_valid.of_kind(valid, &is_mixed, n, true);
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
            points,
        };
        for (i, error) in errors.iter_mut().enumerate() {
            *error = metres(farthest(pyramid, &drawing, level, (i % side, i / side), 0.0, &mut cells));
        }
    });
    errors
}
