//! The bounds against brute force: dense points, each with its distance to every piece of the
//! outline that matters.

use super::*;
use crate::geo::Geo;
use crate::sample::{FILLED, VALID, VOID};
use proptest::prelude::*;
use std::path::PathBuf;

/// Validity at `(x, y)` of the surface drawn at spacing `s`, straight from its definition.
pub(super) fn validity(state: &[u8], n: usize, s: usize, parity: bool, x: f64, y: f64) -> f64 {
    let size = s as f64;
    let (i, j) = (((x / size) as usize).min(n / s - 1), ((y / size) as usize).min(n / s - 1));
    let value = |i: usize, j: usize| f64::from(u8::from(state[j * s * (n + 1) + i * s] == VALID));
    let (nw, ne, sw, se) = (value(i, j), value(i + 1, j), value(i, j + 1), value(i + 1, j + 1));
    let (u, v) = (x / size - i as f64, y / size - j as f64);
    let odd = (i + j) % 2 == 1 || s == n && parity;
    match (odd, u + v < 1.0, v < u) {
        (false, _, true) => nw + u * (ne - nw) + v * (se - ne),
        (false, _, false) => nw + u * (se - sw) + v * (sw - nw),
        (true, true, _) => nw + u * (ne - nw) + v * (sw - nw),
        (true, false, _) => se + (1.0 - u) * (sw - se) + (1.0 - v) * (ne - se),
    }
}

/// Pieces of the outline, in intervals: found by sampling the sides of the triangles for 1/2.
fn pieces(state: &[u8], n: usize) -> Vec<[(f64, f64); 2]> {
    let at = |i: usize, j: usize| (i as f64, j as f64, state[j * (n + 1) + i] == VALID);
    let mut found = Vec::new();
    for j in 0..n {
        for i in 0..n {
            let (nw, ne, sw, se) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
            let halves =
                if (i + j) % 2 == 0 { [[nw, ne, se], [nw, sw, se]] } else { [[nw, ne, sw], [ne, sw, se]] };
            for [a, b, c] in halves {
                let crossed: Vec<_> = [(a, b), (b, c), (c, a)]
                    .into_iter()
                    .filter(|(p, q)| p.2 != q.2)
                    .map(|(p, q)| (0.5 * (p.0 + q.0), 0.5 * (p.1 + q.1)))
                    .collect();
                if let [p, q] = crossed[..] {
                    found.push([p, q]);
                }
            }
        }
    }
    found
}

/// Metres of an interval: columns go east, rows south and `skew` east.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spacing {
    pub(super) dx: f64,
    pub(super) skew: f64,
    pub(super) dy: f64,
}

pub(super) const fn square(dx: f64, dy: f64) -> Spacing {
    Spacing { dx, skew: 0.0, dy }
}

impl Spacing {
    pub(super) fn scale(self) -> Scale {
        let transform = Some([0.0, self.dx, self.skew, 0.0, 0.0, self.dy]);
        Geo { transform, ..Geo::default() }.scale((0, 0), 1)
    }

    fn times(self, factor: f64) -> Self {
        Self { dx: self.dx * factor, skew: self.skew * factor, dy: self.dy * factor }
    }

    /// The longer diagonal of a cell.
    pub(super) fn diagonal(self) -> f64 {
        (self.dx + self.skew.abs()).hypot(self.dy)
    }
}

fn distance(x: f64, y: f64, [a, b]: [(f64, f64); 2], spacing: Spacing) -> f64 {
    let scale = |p: (f64, f64)| (p.0 * spacing.dx + p.1 * spacing.skew, p.1 * spacing.dy);
    let (p, a, b) = (scale((x, y)), scale(a), scale(b));
    let (u, v) = (b.0 - a.0, b.1 - a.1);
    let t = (((p.0 - a.0) * u + (p.1 - a.1) * v) / (u * u + v * v)).clamp(0.0, 1.0);
    (p.0 - a.0 - t * u).hypot(p.1 - a.1 - t * v)
}

/// Distances to the outline of a lattice of points, `density` to an interval.
pub(super) struct Oracle<'a> {
    state: &'a [u8],
    n: usize,
    density: usize,
    distances: Vec<f64>,
}

impl<'a> Oracle<'a> {
    pub(super) fn new(state: &'a [u8], n: usize, spacing: Spacing, density: usize) -> Self {
        let side = n * density + 1;
        let mut oracle = Self { state, n, density, distances: vec![f64::INFINITY; side * side] };
        oracle.fill(&pieces(state, n), spacing, (0, 0, n));
        oracle
    }

    /// Fills the square of `size` cells at `(x, y)` from the pieces that may be nearest in it.
    fn fill(&mut self, pieces: &[[(f64, f64); 2]], spacing: Spacing, (x, y, size): (usize, usize, usize)) {
        let half = size as f64 / 2.0;
        let (cx, cy) = (x as f64 + half, y as f64 + half);
        let nearest =
            pieces.iter().map(|&piece| distance(cx, cy, piece, spacing)).fold(f64::INFINITY, f64::min);
        let limit = (nearest + 2.0 * half * spacing.diagonal()) * (1.0 + 1e-9);
        let pieces: Vec<_> =
            pieces.iter().copied().filter(|&piece| distance(cx, cy, piece, spacing) <= limit).collect();
        if size > 1 {
            let half = size / 2;
            for (i, j) in [(0, 0), (half, 0), (0, half), (half, half)] {
                self.fill(&pieces, spacing, (x + i, y + j, half));
            }
            return;
        }
        for j in 0..=self.density {
            for i in 0..=self.density {
                let at = |cell: usize, part: usize| cell as f64 + part as f64 / self.density as f64;
                let (px, py) = (at(x, i), at(y, j));
                let best = pieces
                    .iter()
                    .map(|&piece| distance(px, py, piece, spacing))
                    .fold(f64::INFINITY, f64::min);
                self.distances[(y * self.density + j) * (self.n * self.density + 1) + x * self.density + i] =
                    best;
            }
        }
    }

    /// The farthest misdrawn point met, for each square of `group` intervals, drawn at spacing `s`.
    pub(super) fn farthest(&self, s: usize, group: usize, parity: bool) -> Vec<f64> {
        let (n, side, squares) = (self.n, self.n * self.density + 1, self.n / group);
        let mut errors = vec![0.0_f64; squares * squares];
        for (k, &distance) in self.distances.iter().enumerate() {
            let (x, y) = ((k % side) as f64 / self.density as f64, (k / side) as f64 / self.density as f64);
            let full = validity(self.state, n, 1, false, x, y);
            let drawn = validity(self.state, n, s, parity, x, y);
            // Points of the outlines are limits of misdrawn ones, or at distance 0.
            let limit = full <= 0.5 && drawn >= 0.5 || full >= 0.5 && drawn <= 0.5;
            let misdrawn = (full >= 0.5) != (drawn >= 0.5);
            let touched = |v: f64| {
                let last = (v / group as f64) as usize;
                let first = if v % group as f64 == 0.0 { last.saturating_sub(1) } else { last };
                first..=last.min(squares - 1)
            };
            let (columns, rows) = (touched(x), touched(y));
            // A misdrawn point on a border belongs to both squares, a limit may be one of the
            // other's.
            if misdrawn || limit && columns.start() == columns.end() && rows.start() == rows.end() {
                for row in rows {
                    for column in columns.clone() {
                        let error = &mut errors[row * squares + column];
                        *error = error.max(distance);
                    }
                }
            }
        }
        errors
    }
}

/// Checks both functions on one tile; `density` points to an interval.
fn check(state: &[u8], n: usize, patch: usize, parity: bool, spacing: Spacing, density: usize) {
    let oracle = Oracle::new(state, n, spacing, density);
    let errors = leaf(state, n, patch, parity, &spacing.scale());
    assert_eq!(errors.steps.len(), patch.ilog2() as usize + 1);
    assert!(errors.steps[0].iter().all(|&error| error == 0.0));
    let sizes = (1..=patch.ilog2()).map(|k| (1 << k, patch));
    let ahead = (patch.ilog2() + 1..=n.ilog2()).map(|k| (1 << k, 1 << k));
    let all = errors.steps.iter().skip(1).chain(&errors.ahead);
    for ((s, group), bounds) in sizes.chain(ahead).zip(all) {
        compare(bounds, &oracle.farthest(s, group, parity), &format!("leaf, n {n}, patch {patch}, s {s}"));
    }
    let mut factor = 2;
    while n / factor >= 4 && factor <= 8 {
        let (state, block) = coarser(state, n, factor);
        let n = n / factor;
        for patch in [4, n].into_iter().filter(|&patch| patch <= n) {
            let spacing = spacing.times(factor as f64);
            let bounds = above(&state, &block, n, patch, parity, &spacing.scale());
            let truth = oracle.farthest(patch * factor, patch * factor, parity);
            let finer = oracle.farthest(patch * factor / 2, patch * factor, parity);
            compare(&larger(&bounds, &finer), &truth, &format!("above by {factor}, n {n}, patch {patch}"));
        }
        factor *= 2;
    }
}

fn larger(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a.max(*b)).collect()
}

fn compare(bounds: &[f64], truth: &[f64], what: &str) {
    assert_eq!(bounds.len(), truth.len(), "{what}");
    for (i, (&bound, &truth)) in bounds.iter().zip(truth).enumerate() {
        assert!(bound >= truth * (1.0 - 1e-12), "{what}: square {i} has {bound}, but a point at {truth}");
    }
}

/// The tile as seen `factor` times coarser: its samples, and what its blocks hold.
fn coarser(state: &[u8], n: usize, factor: usize) -> (Vec<u8>, Vec<u8>) {
    let m = n / factor;
    let at = |x: usize, y: usize| state[y * (n + 1) + x];
    let samples = (0..(m + 1) * (m + 1)).map(|i| at(i % (m + 1) * factor, i / (m + 1) * factor)).collect();
    let bits = |bx: usize, by: usize| {
        let inside = (0..(factor + 1) * (factor + 1))
            .map(|i| at(bx * factor + i % (factor + 1), by * factor + i / (factor + 1)));
        inside.fold(0, |bits, state| bits | if state == VALID { 1 } else { 2 })
    };
    (samples, (0..m * m).map(|i| bits(i % m, i / m)).collect())
}

/// Random bits without a dependency.
fn random(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// A mask of a kind, `(n + 1)^2`.
pub(super) fn mask(kind: usize, n: usize, seed: u64) -> Vec<u8> {
    let mut next = random(seed);
    let side = n + 1;
    let density = [0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99][(next() * 7.0) as usize % 7];
    let (cx, cy) = ((next() * side as f64) as usize % side, (next() * side as f64) as usize % side);
    let blobs: Vec<_> =
        (0..6).map(|_| (next() * n as f64, next() * n as f64, next() * n as f64 * 0.3)).collect();
    let thick = 1 + (next() * 3.0) as usize;
    let mut state = Vec::new();
    for i in 0..side * side {
        let (x, y) = (i % side, i / side);
        let inside = match kind {
            0 => next() < density,
            1 => (x + y) % 2 == 0,
            2 => (x, y) != (cx, cy),
            3 => (x, y) == (cx, cy),
            4 => x.abs_diff(y) < thick,
            5 => (x + y).abs_diff(n) < thick,
            6 => blobs.iter().any(|&(bx, by, r)| (x as f64 - bx).hypot(y as f64 - by) < r),
            7 => x % 7 != 3 && y % 5 != 1,
            8 => x < cx,
            9 => (x as f64 * 0.37 + y as f64) % 17.0 < 9.0,
            10 => next() < if x < cx { 0.1 } else { 0.9 },
            _ => (x / 2 + y / 2) % 2 == 0,
        };
        state.push(if inside {
            VALID
        } else if next() < 0.5 {
            FILLED
        } else {
            VOID
        });
    }
    state
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn never_below_brute_force(
        kind in 0_usize..12,
        seed: u64,
        log_n in 4_u32..7,
        log_patch in 2_u32..7,
        parity: bool,
        dy in prop::sample::select(vec![0.02, 0.3, 0.7, 1.0, 1.4, 3.0, 50.0]),
        skew in prop::sample::select(vec![0.0, 0.0, 0.05, 0.5, -0.9, 3.0]),
    ) {
        let n = 1 << log_n;
        let spacing = Spacing { skew: 30.0 * skew, ..square(30.0, 30.0 * dy) };
        let density = if n < 64 { 8 } else { 4 };
        check(&mask(kind, n, seed), n, 1 << log_patch.min(log_n), parity, spacing, density);
    }
}

#[test]
fn never_below_brute_force_in_a_large_tile() {
    for kind in [0, 6, 10] {
        check(&mask(kind, 256, 5), 256, 64, true, square(20.0, 31.0), 4);
    }
}

#[test]
fn known_answers() {
    let tens = square(10.0, 10.0);
    // Columns 0..=5 of 16 are valid: the outline is at 5.5; drawn at 2, 4, 8, 16 it is at 5, 6, 4,
    // 8 (midway).
    let state: Vec<u8> = (0..17 * 17).map(|i| if i % 17 <= 5 { VALID } else { VOID }).collect();
    let errors = leaf(&state, 16, 16, false, &tens.scale());
    let steps: Vec<f64> = errors.steps.iter().map(|step| step[0]).collect();
    for (got, want) in steps.iter().zip([0.0, 5.0, 5.0, 15.0, 25.0]) {
        assert!((got - want).abs() <= 0.006 * want, "{steps:?}");
    }
    assert!(errors.ahead.is_empty());
    // A void sample that disappears: the point farthest from its outline is the sample itself.
    let mut state = vec![VALID; 17 * 17];
    state[3 * 17 + 3] = VOID;
    let errors = leaf(&state, 16, 4, false, &tens.scale());
    assert!((errors.steps[1][0] - 5.0).abs() < 0.03, "{:?}", errors.steps);
    assert_eq!(errors.steps[1][1..], [0.0; 15]);
    // A strip of two void columns, 9 and 10, which disappears at spacing 4: midway between its
    // sides.
    let state: Vec<u8> =
        (0..17 * 17).map(|i| if (9..11).contains(&(i % 17)) { VOID } else { VALID }).collect();
    let errors = leaf(&state, 16, 16, false, &tens.scale());
    for (step, want) in errors.steps.iter().zip([0.0, 5.0, 10.0, 10.0, 10.0]) {
        assert!((step[0] - want).abs() <= 0.006 * want, "{:?}", errors.steps);
    }
    // Columns 3 and 4: at spacing 4 they hide 2 to 6, and no wider spacing has a smaller error.
    let state: Vec<u8> =
        (0..17 * 17).map(|i| if (3..5).contains(&(i % 17)) { VOID } else { VALID }).collect();
    let errors = leaf(&state, 16, 16, false, &tens.scale());
    for (step, want) in errors.steps.iter().zip([0.0, 5.0, 15.0, 15.0, 15.0]) {
        assert!((step[0] - want).abs() <= 0.006 * want, "{:?}", errors.steps);
    }
}

#[test]
fn tiles_without_an_outline_have_no_error() {
    for fill in [VALID, VOID, FILLED] {
        let errors = leaf(&[fill; 33 * 33], 32, 8, true, &square(1.0, 1.0).scale());
        assert!(errors.steps.iter().chain(&errors.ahead).flatten().all(|&error| error == 0.0));
        assert_eq!(errors.steps.iter().map(Vec::len).collect::<Vec<_>>(), [16; 4]);
        assert_eq!(errors.ahead.iter().map(Vec::len).collect::<Vec<_>>(), [4, 1]);
        let bits = if fill == VALID { 1 } else { 2 };
        let errors = above(&[fill; 33 * 33], &[bits; 32 * 32], 32, 8, true, &square(1.0, 1.0).scale());
        assert_eq!(errors, [0.0; 16]);
    }
}

#[test]
fn extreme_spacings_stay_finite() {
    let state = mask(0, 32, 3);
    let (samples, block) = coarser(&state, 32, 2);
    for spacing in [(0.0, 30.0), (30.0, 0.0), (0.0, 0.0), (1e-9, 1e9)] {
        let spacing = square(spacing.0, spacing.1);
        let errors = leaf(&state, 32, 8, false, &spacing.scale());
        assert!(errors.steps.iter().chain(&errors.ahead).flatten().all(|error| error.is_finite()));
        assert!(
            above(&samples, &block, 16, 8, false, &spacing.scale()).iter().all(|error| error.is_finite())
        );
    }
}

/// Columns, rows and states of a raster in ../shared/data; `None`, said aloud, if it is not there.
fn real_mask(name: &str, nodata: f64) -> Option<(usize, usize, Vec<u8>)> {
    use tiff::decoder::{Decoder, DecodingResult};
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(name);
    let Ok(file) = std::fs::File::open(&path) else {
        eprintln!("{} is not there: skipped", path.display());
        return None;
    };
    let mut decoder = Decoder::new(std::io::BufReader::new(file)).unwrap();
    let (width, height) = decoder.dimensions().unwrap();
    let state = |value: f64| if value.is_nan() || value == nodata { VOID } else { VALID };
    let states = match decoder.read_image().unwrap() {
        DecodingResult::F32(values) => values.into_iter().map(|value| state(f64::from(value))).collect(),
        DecodingResult::I16(values) => values.into_iter().map(|value| state(f64::from(value))).collect(),
        _ => panic!("{name}: another sample type"),
    };
    Some((width as usize, height as usize, states))
}

const REAL: [(&str, f64, Spacing); 3] = [
    ("nz_elev_float32_nan.tif", f64::NAN, square(1000.0, 1000.0)),
    ("everest_srtm3_int16_voids.tif", -32768.0, square(81.6, 92.4)),
    ("exploradores_aster_float32_nodata.tif", -9999.0, square(30.0, 30.0)),
];

/// Tile `(x, y)` of `n` intervals of a raster; void outside.
fn tile((width, height, states): &(usize, usize, Vec<u8>), n: usize, x: usize, y: usize) -> Vec<u8> {
    let at = |i: usize| (x * n + i % (n + 1), y * n + i / (n + 1));
    let inside =
        |(x, y): (usize, usize)| if x < *width && y < *height { states[y * width + x] } else { VOID };
    (0..(n + 1) * (n + 1)).map(|i| inside(at(i))).collect()
}

#[test]
fn never_below_brute_force_on_real_masks() {
    for (name, nodata, spacing) in REAL {
        let Some(raster) = real_mask(name, nodata) else { continue };
        for (x, y) in [(0, 0), (2, 3), (4, 1), (5, 5), (7, 2), (3, 8)] {
            let state = tile(&raster, 64, x, y);
            check(&state, 64, 16, (x + y) % 2 == 1, spacing, 4);
        }
    }
}
