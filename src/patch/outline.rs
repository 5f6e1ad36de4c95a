//! Horizontal error of patches: how far from the outline of the voids something is shown or hidden wrongly.
//!
//! At full resolution validity is 1 or 0 at samples and linear in triangles; the outline is where it is 1/2. Drawn at a
//! coarser spacing the same holds for coarser triangles, and points between the two outlines are misdrawn. The error is
//! the largest distance of a misdrawn point from the outline at full resolution, as far as it lies within the tile: never
//! smaller than the distance from the whole outline. A square of cells with valid samples only, or void ones only, is
//! drawn as it is; any other holds a part of the outline, so the distance is always finite.
//!
//! Not here: errors of children, and that errors grow with the spacing. The caller takes the maximum with finer ones.

mod search;
mod shape;
#[cfg(test)]
mod tests;

use crate::geo::Spacing;
use crate::patch::distance::{HalfPoint, Nearest};
use crate::sample::VALID;
use search::{Bound, Cell, Corners, Drawing, HAS_VALID, HAS_VOID, MIXED, Pyramid};
use shape::{Fault, Polygon, Segment, Somewhere, triangles};

/// Halvings of a triangle of a leaf cell: its sides shrink to 1/32.
const LEAF_HALVINGS: u32 = 10;
/// Halvings of a triangle of a block: what the block hides is larger.
const ABOVE_HALVINGS: u32 = 2;

/// Horizontal errors of a leaf tile, metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LeafOutline {
    /// For each step `k = 0..=p`, the patches row by row, drawn at spacing `2^k`. Step 0 is all 0.
    pub steps: Vec<Vec<f64>>,
    /// For each spacing `s = 2P, 4P, .., n`, the `(n / s)^2` cells of that size row by row.
    pub ahead: Vec<Vec<f64>>,
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
    let is_valid = |state: &u8| *state == VALID;
    if state.iter().all(is_valid) || !state.iter().any(is_valid) {
        return errors;
    }
    let spacing = usable(spacing);
    let mut nearest = Nearest::new(n);
    mark_outline(&mut nearest, state, n);
    nearest.solve(spacing);
    let half = (0.5 * spacing.dx, 0.5 * spacing.dy);
    let reach = (0..n * n).map(|i| {
        let corner = i / n * (n + 1) + i % n;
        let samples = [state[corner], state[corner + 1], state[corner + n + 1], state[corner + n + 2]];
        (cell_bits(samples), reach(&nearest, (i % n, i / n), half, false))
    });
    let pyramid = Pyramid::new(n, reach);
    let known = [vec![f64::INFINITY; n * n], vec![f64::INFINITY; n * n]];
    let mut cell =
        LeafCell { state, n, nearest: &nearest, half, segments: Vec::new(), cells: Vec::new(), known };
    let spacings = errors.steps.iter_mut().zip((0..=p).map(|level| (level, p))).skip(1);
    let spacings = spacings.chain(errors.ahead.iter_mut().zip((p + 1..=top).map(|level| (level, level))));
    for (row_by_row, (level, root)) in spacings {
        let drawing = Drawing { state, level, flip: parity && level == top };
        let side = n >> root;
        for (i, error) in row_by_row.iter_mut().enumerate() {
            *error = pyramid.farthest(&drawing, root, (i % side, i / side), &mut cell);
        }
    }
    errors
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
    let [void, valid] = [false, true].map(|valid| {
        let mut nearest = Nearest::new(n);
        mark_places(&mut nearest, state, block, n, valid);
        nearest.solve(spacing);
        nearest
    });
    let half = (0.5 * spacing.dx, 0.5 * spacing.dy);
    let reach = block.iter().enumerate().map(|(i, &bits)| {
        let at = (i % n, i / n);
        let from_valid = if bits & HAS_VALID == 0 { 0.0 } else { reach(&void, at, half, true) };
        let from_void = if bits & HAS_VOID == 0 { 0.0 } else { reach(&valid, at, half, true) };
        (bits, from_valid.max(from_void))
    });
    let pyramid = Pyramid::new(n, reach);
    let level = patch.ilog2() as usize;
    let drawing = Drawing { state, level, flip: parity && patch == n };
    let mut cell =
        AboveCell { state, block, n, finer: patch / 2, void: &void, valid: &valid, half, places: Vec::new() };
    for (i, error) in errors.iter_mut().enumerate() {
        *error = pyramid.farthest(&drawing, level, (i % side, i / side), &mut cell);
    }
    errors
}

/// The spacing with neither side below a millionth of the other: a bound stays one, and nothing is divided by 0.
fn usable(Spacing { dx, dy }: Spacing) -> Spacing {
    let least = (dx.max(dy) * 1e-6).max(1e-100);
    Spacing { dx: dx.max(least), dy: dy.max(least) }
}

/// What the closed square of these samples holds.
fn cell_bits(samples: [u8; 4]) -> u8 {
    samples.iter().fold(0, |bits, &state| bits | if state == VALID { HAS_VALID } else { HAS_VOID })
}

/// Squared distance within which every point of a cell has the nearest feature of the cell's centre; 0 if there is none.
/// With `blocks`, a feature at the centre of a cell stands for a point somewhere in that cell.
fn reach(nearest: &Nearest, (x, y): (usize, usize), half: (f64, f64), blocks: bool) -> f64 {
    let Some([fx, fy]) = nearest.at(x, y) else { return 0.0 };
    let extent = if blocks && is_block([fx, fy]) { 2 } else { 1 };
    let away = |feature: i16, centre: usize| f64::from((feature - centre as i16).abs() + extent);
    let (across, down) = (away(fx, 2 * x + 1) * half.0, away(fy, 2 * y + 1) * half.1);
    across * across + down * down
}

/// True if a feature of a tile above the leaves stands for a block, not for a sample.
fn is_block([x, y]: HalfPoint) -> bool {
    x % 2 == 1 && y % 2 == 1
}

/// Marks the vertices of the outline: midpoints of the sides and diagonals that join a valid and a void sample.
fn mark_outline(nearest: &mut Nearest, state: &[u8], n: usize) {
    let rows: Vec<&[u8]> = state.chunks_exact(n + 1).collect();
    let differ = |a: u8, b: u8| u8::from((a == VALID) != (b == VALID));
    for (y, row) in rows.iter().enumerate() {
        let marks = nearest.row_mut(2 * y);
        for (x, pair) in row.windows(2).enumerate() {
            marks[2 * x + 1] = differ(pair[0], pair[1]);
        }
    }
    for (y, pair) in rows.windows(2).enumerate() {
        let (north, south) = (pair[0], pair[1]);
        let marks = nearest.row_mut(2 * y + 1);
        for x in 0..=n {
            marks[2 * x] = differ(north[x], south[x]);
        }
        for x in 0..n {
            let falling = (x + y) % 2 == 0;
            marks[2 * x + 1] =
                if falling { differ(north[x], south[x + 1]) } else { differ(north[x + 1], south[x]) };
        }
    }
}

/// Things near cell `at`: the nearest features of the cell and of its eight neighbours, each once.
fn around(nearest: &Nearest, n: usize, (x, y): (usize, usize), mut take: impl FnMut(HalfPoint)) {
    let mut seen = [[-1; 2]; 9];
    let mut count = 0;
    for j in y.saturating_sub(1)..=(y + 1).min(n - 1) {
        for i in x.saturating_sub(1)..=(x + 1).min(n - 1) {
            let Some(feature) = nearest.at(i, j) else { return };
            if !seen[..count].contains(&feature) {
                seen[count] = feature;
                count += 1;
                take(feature);
            }
        }
    }
}

/// A cell of a leaf tile.
struct LeafCell<'a> {
    state: &'a [u8],
    n: usize,
    nearest: &'a Nearest,
    half: (f64, f64),
    segments: Vec<Segment>,
    /// Cells whose pieces are collected.
    cells: Vec<(usize, usize)>,
    /// For each fault and cell, what was found out about the whole cell at another spacing: an upper bound.
    known: [Vec<f64>; 2],
}

impl LeafCell<'_> {
    /// Validity at the corners of a cell.
    fn full(&self, x: usize, y: usize) -> Corners {
        let i = y * (self.n + 1) + x;
        [i, i + 1, i + self.n + 1, i + self.n + 2].map(|i| f64::from(u8::from(self.state[i] == VALID)))
    }

    /// Collects the pieces of the outline near a cell.
    fn collect(&mut self, at: (usize, usize)) {
        self.segments.clear();
        self.cells.clear();
        let (nearest, n) = (self.nearest, self.n);
        for y in at.1.saturating_sub(1)..=(at.1 + 1).min(n - 1) {
            for x in at.0.saturating_sub(1)..=(at.0 + 1).min(n - 1) {
                self.cells.push((x, y));
                self.push_segments(at, (x, y));
            }
        }
        around(nearest, n, at, |[fx, fy]| {
            // A vertex on a side belongs to the cells on both sides of it.
            let cells = |feature: i16| {
                let feature = feature as usize;
                (feature.saturating_sub(1) / 2, (feature / 2).min(n - 1))
            };
            let ((west, east), (north, south)) = (cells(fx), cells(fy));
            for y in north..=south {
                for x in west..=east {
                    if !self.cells.contains(&(x, y)) {
                        self.cells.push((x, y));
                        self.push_segments(at, (x, y));
                    }
                }
            }
        });
    }

    /// Adds the pieces of the outline in cell `(x, y)`, as seen from the corner of cell `from`.
    fn push_segments(&mut self, from: (usize, usize), (x, y): (usize, usize)) {
        let full = self.full(x, y);
        for [a, b, c] in triangles((x + y) % 2 == 0) {
            // The outline runs between the midpoints of the sides that meet at the odd one out.
            let [odd, u, v] = match (full[a] == full[b], full[b] == full[c]) {
                (true, true) => continue,
                (true, false) => [c, a, b],
                (false, true) => [a, b, c],
                (false, false) => [b, a, c],
            };
            let midpoint = |other: usize| {
                let half = |cell: usize, from: usize, corners: usize| {
                    2.0 * (cell as f64 - from as f64) + corners as f64
                };
                (
                    half(x, from.0, odd % 2 + other % 2) * self.half.0,
                    half(y, from.1, odd / 2 + other / 2) * self.half.1,
                )
            };
            self.segments.push(Segment::new(midpoint(u), midpoint(v)));
        }
    }
}

impl Cell for LeafCell<'_> {
    fn look(&mut self, at: (usize, usize), drawn: Corners, bound: &mut Bound) {
        let full = self.full(at.0, at.1);
        let size = (2.0 * self.half.0, 2.0 * self.half.1);
        let known = at.1 * self.n + at.0;
        for fault in [Fault::Shown, Fault::Hidden] {
            if bound.settles(self.known[fault as usize][known]) {
                continue;
            }
            let parts = triangles((at.0 + at.1).is_multiple_of(2))
                .map(|triangle| Polygon::misdrawn(triangle, size, full, drawn, fault));
            if parts.iter().all(Option::is_none) {
                continue;
            }
            // The cell's own pieces often say enough.
            self.segments.clear();
            self.push_segments(at, at);
            let own = parts.iter().flatten().map(|part| part.at_most(&self.segments)).fold(0.0, f64::max);
            let top = if bound.settles(own) {
                own
            } else {
                self.collect(at);
                let mut part = bound.part();
                for polygon in parts.iter().flatten() {
                    polygon.farthest(&mut self.segments, LEAF_HALVINGS, &mut part);
                }
                bound.join(part)
            };
            if drawn.iter().all(|&value| fault.concerns(value)) {
                self.known[fault as usize][known] = top;
            }
        }
    }
}

/// Marks the samples of one kind, and the centres of the blocks that hold some of that kind inside only.
fn mark_places(nearest: &mut Nearest, state: &[u8], block: &[u8], n: usize, valid: bool) {
    let rows: Vec<&[u8]> = state.chunks_exact(n + 1).collect();
    let is_kind = |state: u8| (state == VALID) == valid;
    for (y, row) in rows.iter().enumerate() {
        for (mark, &state) in nearest.row_mut(2 * y).iter_mut().step_by(2).zip(*row) {
            *mark = u8::from(is_kind(state));
        }
    }
    for ((y, pair), blocks) in rows.windows(2).enumerate().zip(block.chunks_exact(n)) {
        let (north, south) = (pair[0], pair[1]);
        let marks = nearest.row_mut(2 * y + 1);
        for (x, &bits) in blocks.iter().enumerate() {
            let corners = [north[x], north[x + 1], south[x], south[x + 1]];
            marks[2 * x + 1] = u8::from(bits & MIXED == MIXED && !corners.into_iter().any(is_kind));
        }
    }
}

/// A block of a tile above the leaves.
struct AboveCell<'a> {
    state: &'a [u8],
    block: &'a [u8],
    n: usize,
    /// The next finer spacing.
    finer: usize,
    /// What is known to hold something void: a valid point is no farther from the outline.
    void: &'a Nearest,
    /// What is known to hold something valid.
    valid: &'a Nearest,
    half: (f64, f64),
    places: Vec<Somewhere>,
}

impl AboveCell<'_> {
    /// Validity at sample `(x, y)`, drawn at the next finer spacing.
    fn drawn_finer(&self, (x, y): (usize, usize)) -> f64 {
        let s = self.finer;
        let (i, j) = ((x / s).min(self.n / s - 1), (y / s).min(self.n / s - 1));
        let at = |i: usize, j: usize| f64::from(u8::from(self.state[j * s * (self.n + 1) + i * s] == VALID));
        let (nw, ne, sw, se) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
        let (u, v) = ((x - i * s) as f64 / s as f64, (y - j * s) as f64 / s as f64);
        match ((i + j) % 2 == 0, u > v, u + v < 1.0) {
            (true, true, _) => nw + u * (ne - nw) + v * (se - ne),
            (true, false, _) => nw + u * (se - sw) + v * (sw - nw),
            (false, _, true) => nw + u * (ne - nw) + v * (sw - nw),
            (false, _, false) => se + (1.0 - u) * (sw - se) + (1.0 - v) * (ne - se),
        }
    }

    /// Collects what is near a block, of the kind that its misdrawn points are not.
    fn collect(&mut self, (x, y): (usize, usize), fault: Fault) {
        self.places.clear();
        let nearest = if fault == Fault::Shown { self.valid } else { self.void };
        let half = self.half;
        around(nearest, self.n, (x, y), |[fx, fy]| {
            let away = |feature: i16, cell: usize, half: f64| (f64::from(feature) - 2.0 * cell as f64) * half;
            self.places.push(Somewhere {
                centre: (away(fx, x, half.0), away(fy, y, half.1)),
                half: if is_block([fx, fy]) { half } else { (0.0, 0.0) },
            });
        });
    }
}

impl Cell for AboveCell<'_> {
    fn look(&mut self, (x, y): (usize, usize), drawn: Corners, bound: &mut Bound) {
        let bits = self.block[y * self.n + x];
        let size = (2.0 * self.half.0, 2.0 * self.half.1);
        let finer = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|sample| self.drawn_finer(sample));
        for (fault, bit) in [(Fault::Shown, HAS_VOID), (Fault::Hidden, HAS_VALID)] {
            if bits & bit == 0 {
                continue;
            }
            let parts = triangles((x + y) % 2 == 0)
                .map(|triangle| Polygon::misdrawn(triangle, size, finer, drawn, fault));
            if parts.iter().any(Option::is_some) {
                self.collect((x, y), fault);
            }
            for polygon in parts.iter().flatten() {
                polygon.farthest(&mut self.places, ABOVE_HALVINGS, bound);
            }
        }
    }
}
