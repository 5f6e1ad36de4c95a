//! Horizontal error of patches: how far from the outline of the voids something is shown or hidden wrongly.
//!
//! At full resolution validity is 1 or 0 at samples and linear in triangles; the outline is where it is 1/2. Drawn at a
//! coarser spacing the same holds for coarser triangles, and points between the two outlines are misdrawn. The error is
//! the largest distance of a misdrawn point from the outline at full resolution, as far as it lies within the tile: never
//! smaller than the distance from the whole outline. A square of cells with valid samples only, or void ones only, is
//! drawn as it is; any other holds a part of the outline, so the distance is always finite.
//!
//! Not here: errors of children, and that errors grow with the spacing. The caller takes the maximum with finer ones.

mod above_cell;
mod features;
mod leaf_cell;
mod search;
mod shape;
#[cfg(test)]
mod tests;

use std::cell::Cell as ThreadCell;

use crate::geo::Spacing;
use crate::patch::distance::Nearest;
use crate::sample::VALID;
use crate::simd;
use above_cell::AboveCell;
use features::{BlockReach, CellBits, OutlineMarks, PlaceMarks, Reach, Validity};
use leaf_cell::{Known, LeafCell};
use search::{Drawing, MIXED, Pyramid};
use shape::{Segments, Somewheres};

/// Horizontal errors of a leaf tile, metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LeafOutline {
    /// For each step `k = 0..=p`, the patches row by row, drawn at spacing `2^k`. Step 0 is all 0.
    pub steps: Vec<Vec<f64>>,
    /// For each spacing `s = 2P, 4P, .., n`, the `(n / s)^2` cells of that size row by row.
    pub ahead: Vec<Vec<f64>>,
}

/// Intervals of a tile up to which a thread keeps its buffers from tile to tile.
const KEPT_INTERVALS: usize = 512;

/// Buffers of one thread.
#[derive(Default)]
struct Scratch {
    /// 1 where a sample is valid, `(n + 1)^2`.
    valid: Vec<u8>,
    nearest: [Nearest; 2],
    pyramid: Pyramid,
    known: Known,
    segments: Segments,
    places: Somewheres,
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
pub fn leaf(state: &[u8], n: usize, patch: usize, parity: bool, spacing: Spacing) -> LeafOutline {
    debug_assert!(
        n.is_power_of_two() && patch.is_power_of_two() && patch <= n && state.len() == (n + 1) * (n + 1)
    );
    let (top, p) = (n.ilog2() as usize, patch.ilog2() as usize);
    let zeros = |level: usize| vec![0.0; (n >> level) * (n >> level)];
    let mut errors =
        LeafOutline { steps: (0..=p).map(|_| zeros(p)).collect(), ahead: (p + 1..=top).map(zeros).collect() };
    // Counting has no way out of the loop, so it runs on vectors; most tiles are all valid.
    let valid = state.iter().filter(|&&state| state == VALID).count();
    if valid == state.len() || valid == 0 {
        return errors;
    }
    with_scratch(n, |scratch| leaf_errors(scratch, state, n, parity, usable(spacing), &mut errors));
    errors
}

/// [`leaf`] of a tile with valid and void samples.
fn leaf_errors(
    scratch: &mut Scratch,
    state: &[u8],
    n: usize,
    parity: bool,
    spacing: Spacing,
    errors: &mut LeafOutline,
) {
    let Scratch { valid, nearest: [nearest, _], pyramid, known, segments, .. } = scratch;
    simd::run(Validity { state, valid });
    nearest.start(n);
    simd::run(OutlineMarks { valid, n, nearest });
    nearest.solve(spacing);
    let half = (0.5 * spacing.dx, 0.5 * spacing.dy);
    let (bits, reach) = pyramid.start(n);
    simd::run(CellBits { valid, n, bits });
    simd::run(Reach { nearest, n, half, to: reach });
    pyramid.build();
    known.start(n * n);
    let mut cell = LeafCell { valid, bits: pyramid.bits(), n, nearest, half, segments, known };
    let (top, p) = (n.ilog2() as usize, errors.steps.len() - 1);
    let spacings = errors.steps.iter_mut().zip((0..=p).map(|level| (level, p))).skip(1);
    let spacings = spacings.chain(errors.ahead.iter_mut().zip((p + 1..=top).map(|level| (level, level))));
    for (row_by_row, (level, root)) in spacings {
        let drawing = Drawing { valid, level, flip: parity && level == top };
        let side = n >> root;
        for (i, error) in row_by_row.iter_mut().enumerate() {
            *error = pyramid.farthest(&drawing, root, (i % side, i / side), &mut cell);
        }
    }
}

/// What spacing `patch` adds to the errors of the patches of a tile above the leaves, row by row.
///
/// **To be joined with the errors of spacing `patch / 2` by maximum**: a point that is misdrawn there already is in
/// them, so only points are looked at whose drawing the last halving of the detail has changed.
///
/// `state` holds its own `(n + 1)^2` samples. `block` says of each of the `n x n` closed blocks (one interval of this
/// level) what the full resolution has in it: bit 0 a valid sample, bit 1 a void one. `spacing` is of this level's
/// intervals. `parity` as for [`leaf`]; it matters if there is one patch only. `4 <= patch`.
///
/// A block with both holds a point of the outline, somewhere; so does any path from a valid sample to a void one.
/// Hence the error is too large by about a block's diagonal at most.
pub fn above(state: &[u8], block: &[u8], n: usize, patch: usize, parity: bool, spacing: Spacing) -> Vec<f64> {
    debug_assert!(state.len() == (n + 1) * (n + 1) && block.len() == n * n && patch >= 4);
    let side = n / patch;
    let mut errors = vec![0.0; side * side];
    let any = block.iter().fold(0, |any, bits| any | bits);
    if any & MIXED != MIXED {
        return errors;
    }
    let spacing = usable(spacing);
    with_scratch(n, |scratch| {
        let Scratch { valid, nearest: [void_places, valid_places], pyramid, places, .. } = scratch;
        simd::run(Validity { state, valid });
        for (nearest, kind) in [(&mut *void_places, 0), (&mut *valid_places, 1)] {
            nearest.start(n);
            simd::run(PlaceMarks { valid, block, n, kind, nearest });
            nearest.solve(spacing);
        }
        let half = (0.5 * spacing.dx, 0.5 * spacing.dy);
        let (bits, reach) = pyramid.start(n);
        bits.copy_from_slice(block);
        let (void, nearest_valid) = (&*void_places, &*valid_places);
        simd::run(BlockReach { void, valid: nearest_valid, block, n, half, to: reach });
        pyramid.build();
        let level = patch.ilog2() as usize;
        let drawing = Drawing { valid, level, flip: parity && patch == n };
        let (void, finer) = (void_places, patch / 2);
        let mut cell = AboveCell { samples: valid, block, n, finer, void, valid: valid_places, half, places };
        for (i, error) in errors.iter_mut().enumerate() {
            *error = pyramid.farthest(&drawing, level, (i % side, i / side), &mut cell);
        }
    });
    errors
}

/// The spacing with neither side below a millionth of the other: a bound stays one, and nothing is divided by 0.
fn usable(Spacing { dx, dy }: Spacing) -> Spacing {
    let least = (dx.max(dy) * 1e-6).max(1e-100);
    Spacing { dx: dx.max(least), dy: dy.max(least) }
}
