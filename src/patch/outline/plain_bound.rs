//! The horizontal errors against a plain bound that shares no code with them: a distance transform
//! over the half lattice, plus half a cell's diagonal.

use super::leaf;
use super::tests::{Oracle, Spacing, mask, square, validity};
use crate::sample::VALID;
use proptest::prelude::*;

/// Distances of the centres of all cells, row by row, from the nearest vertex of the outline: the
/// midpoint of a side or diagonal between a valid and a void sample.
fn distances(state: &[u8], n: usize, spacing: Spacing) -> Vec<f64> {
    let side = 2 * n + 1;
    let valid = |x: usize, y: usize| state[y * (n + 1) + x] == VALID;
    let is_vertex = |x: usize, y: usize| {
        let (west, east, north, south) = (x / 2, x.div_ceil(2), y / 2, y.div_ceil(2));
        let is_rising = x % 2 == 1 && y % 2 == 1 && (west + north) % 2 == 1;
        if is_rising {
            valid(east, north) != valid(west, south)
        } else {
            valid(west, north) != valid(east, south)
        }
    };
    // First pass: half rows to the nearest vertex of the same half column.
    let mut down = vec![f64::INFINITY; side * side];
    for x in 0..side {
        let column: Vec<usize> = (0..side).filter(|&y| is_vertex(x, y)).collect();
        for y in 0..side {
            let nearest = column.iter().map(|&vertex| vertex.abs_diff(y)).min();
            down[y * side + x] = nearest.map_or(f64::INFINITY, |rows| rows as f64);
        }
    }
    // Second pass: along the half row of the centre.
    let centre = |i: usize| (2 * (i % n) + 1, 2 * (i / n) + 1);
    let distance = |(x, y): (usize, usize)| {
        let row = &down[y * side..(y + 1) * side];
        let to = |(column, &rows): (usize, &f64)| {
            (0.5 * spacing.dx * column.abs_diff(x) as f64).hypot(0.5 * spacing.dy * rows)
        };
        row.iter().enumerate().map(to).fold(f64::INFINITY, f64::min)
    };
    (0..n * n).map(centre).map(distance).collect()
}

/// A tile that is bounded.
struct Tile<'a> {
    state: &'a [u8],
    n: usize,
    parity: bool,
    spacing: Spacing,
}

impl Tile<'_> {
    /// An upper bound for each square of `group` intervals drawn at spacing `s`: the largest of
    /// `distances`, plus half a diagonal, over the cells that may have a misdrawn point.
    fn bound(&self, distances: &[f64], s: usize, group: usize) -> Vec<f64> {
        let Self { state, n, parity, spacing } = *self;
        let (half_diagonal, squares) = (0.5 * spacing.diagonal(), n / group);
        let mut bounds = vec![0.0_f64; squares * squares];
        for (i, distance) in distances.iter().enumerate() {
            let (x, y) = (i % n, i / n);
            let corners = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
            let is_valid = corners.map(|(x, y)| state[y * (n + 1) + x] == VALID);
            let drawn = corners.map(|(x, y)| validity(state, n, s, parity, x as f64, y as f64));
            let shown_wrongly = is_valid.contains(&false) && drawn.iter().any(|&drawn| drawn > 0.5);
            let hidden_wrongly = is_valid.contains(&true) && drawn.iter().any(|&drawn| drawn < 0.5);
            if shown_wrongly || hidden_wrongly {
                let bound = &mut bounds[y / group * squares + x / group];
                *bound = bound.max(distance + half_diagonal);
            }
        }
        bounds
    }

    /// Checks the errors of the tile against the bound, which they may exceed by `slack`; and the
    /// bound against the truth, if that is given.
    fn check(&self, patch: usize, slack: f64, truth: Option<&Oracle>) {
        let Self { state, n, parity, spacing } = *self;
        let errors = leaf(state, n, patch, parity, &spacing.scale());
        let distances = distances(state, n, spacing);
        let steps = (1..=patch.ilog2()).map(|k| (1 << k, patch));
        let ahead = (patch.ilog2() + 1..=n.ilog2()).map(|k| (1 << k, 1 << k));
        let mut bounds = vec![0.0_f64; (n / patch) * (n / patch)];
        for ((s, group), errors) in steps.chain(ahead).zip(errors.steps[1..].iter().chain(&errors.ahead)) {
            let own = self.bound(&distances, s, group);
            for (bound, farthest) in
                own.iter().zip(truth.map_or(Vec::new(), |t| t.farthest(s, group, parity)))
            {
                assert!(
                    *bound >= farthest * (1.0 - 1e-12),
                    "s {s}: bound {bound}, but a point at {farthest}"
                );
            }
            // An error is no smaller than those of finer steps within.
            let (side, part) = (n / group, bounds.len().isqrt() / (n / group));
            let finer = |i: usize| {
                let (x, y) = (i % side * part, i / side * part);
                let within = (0..part * part).map(|j| (y + j / part) * side * part + x + j % part);
                within.fold(own[i], |most: f64, j| most.max(bounds[j]))
            };
            bounds = (0..own.len()).map(finer).collect();
            for (error, bound) in errors.iter().zip(&bounds) {
                assert!(*error <= bound * slack, "s {s}: error {error}, but at most {bound}");
            }
        }
    }
}

/// The search ends within half a per cent of the largest distance, but where a pattern repeats
/// itself all over a patch: it does not in these masks.
#[test]
fn within_half_a_per_cent_of_the_plain_bound_on_known_masks() {
    for (kind, seed) in (0..12).flat_map(|kind| (0..3).map(move |seed| (kind, seed))) {
        for spacing in [square(30.0, 30.0), square(30.0, 42.0)] {
            let (n, parity) = (32, seed == 1);
            let state = mask(kind, n, seed);
            Tile { state: &state, n, parity, spacing }.check(8, 1.005 + 1e-6, None);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// 15 per cent is the widest slack of the search.
    #[test]
    fn never_above_the_plain_bound(
        kind in 0_usize..12,
        seed: u64,
        log_n in 4_u32..6,
        log_patch in 2_u32..6,
        parity: bool,
        dy in prop::sample::select(vec![0.02, 0.3, 0.7, 1.0, 1.4, 3.0, 50.0]),
    ) {
        let (n, spacing) = (1 << log_n, square(30.0, 30.0 * dy));
        let state = mask(kind, n, seed);
        let truth = Oracle::new(&state, n, spacing, 4);
        Tile { state: &state, n, parity, spacing }.check(1 << log_patch.min(log_n), 1.15, Some(&truth));
    }
}
