//! Errors of the half-step triangles, which the 4-8 mesh draws at border cells and no uniform step
//! does.
//!
//! A border cell of spacing `s = 2^k` beside a finer edge is cut by both diagonals at its centre
//! `M`. A *border triangle* is the triangle `A B M` over one of its sides `A B`, with `N` in the
//! middle of that side:
//!
//! ```text
//! A-----N-----B     the finer edge: A B M is cut again at N, into two triangles of step k - 1
//! | \   |   / |
//! |   \ | /   |
//! |     M     |     the other three triangles at M are half a step
//! |   /   \   |
//! | /       \ |
//! C-----------D
//! ```
//!
//! The table of the file bounds steps `k` and `k - 1`, and says nothing of half a step. Let `H` be
//! the surface of half a step, `U(j)` that of step `j`, and `e(j)` its error. `H` and all `U(j)`,
//! `j <= k`, are unions of triangles of step 0.
//!
//! **Vertical.** Wherever some `U(j)` is shown, `|truth - H| <= e(j) + |U(j) - H|`, and the last
//! term is largest at a vertex of step `j`. For `j = k` that is `M` against the diagonal of the
//! cell, for `j = k - 1` it is `N` against the middle of `A B`, for `j = 0` it is every sample.
//! Without voids each of these is a bound, and the least of them counts. With voids the surface
//! `U(j)` must be shown wherever `H` is: its validity must be no less at its vertices. In a leaf
//! `U(0)` is the truth, so that one always serves. If none does, only the range of heights of the
//! tile is left. That needs `N` void between unlike ends, and `M` valid at a diagonal that is not.
//!
//! **Horizontal.** Where some `U(j)` is in the same state as `H`, shown or hidden, a misdrawn point
//! is misdrawn at step `j` too. Otherwise the truth and all `U(j)` are in the other state at a
//! point `x`. `H` is a weighted mean of its corners, so one of them has its state, and a corner is
//! a sample: the outline runs between `x` and the nearest such corner. Let `s` be 1, the larger of
//! the two spacings for both. One corner of the state: `x` lies in the half-size triangle there, at
//! most 1/2 away. Three: at most the circumradius, 1/2. `A` and `M`: 1/2, in the middle of `A B`.
//! `A` and `B`: the trapezoid below half the height, farthest halfway between,
//! `sqrt(1/4 + 1/16) < 0.56`: [`MAX_MISDRAW`].

/// Largest distance, in spacings, from the outline of a point that only a half-step triangle
/// misdraws.
pub(super) const MAX_MISDRAW: f64 = 0.56;

/// Most steps of a patch.
pub(super) const STEPS: usize = 7;

/// A tile whose border cells are measured.
pub(super) struct BorderCells<'a> {
    /// Intervals on a side of the tile.
    pub n: usize,
    /// Heights in metres, finite.
    pub heights: &'a [f32],
    /// 1 where a sample is valid.
    pub valid: &'a [u8],
    /// True if no tile is below.
    pub leaf: bool,
    /// True if tile column + row is odd.
    pub odd: bool,
    /// Lowest and greatest height of the full resolution, metres.
    pub range: (f64, f64),
    /// For leaves with voids: 1 where a sample or one of the eight around it is valid; else empty.
    pub near: Vec<u8>,
}

/// A patch of the tile.
pub(super) struct Patch<'a> {
    /// Index of its north-west sample.
    pub start: usize,
    /// Intervals on a side.
    pub side: usize,
    /// True if one of its samples is void.
    pub mixed: bool,
    /// Vertical errors of the uniform steps, metres, monotone.
    pub errors: &'a [f64],
}

/// The errors of one step of a patch, half-step triangles included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Covered {
    /// Vertical error, metres.
    pub vertical: f64,
    /// True if a half-step triangle may draw an outline of its own.
    pub outline: bool,
}

/// A border triangle: `u` runs along its side of the cell, 0 to `s`, and `v` from there to the
/// centre, 0 to `s / 2`.
#[derive(Clone, Copy)]
struct BorderTriangle {
    origin: usize,
    along: isize,
    inward: isize,
    s: usize,
}

impl BorderTriangle {
    fn at(&self, u: usize, v: usize) -> usize {
        self.origin.wrapping_add_signed(u as isize * self.along + v as isize * self.inward)
    }

    /// The samples of step `step` in the triangle: `u`, `v` and index.
    fn samples(self, step: usize) -> impl Iterator<Item = (usize, usize, usize)> {
        let row = move |v| (v..=self.s - v).step_by(step).map(move |u| (u, v, self.at(u, v)));
        (0..=self.s / 2).step_by(step).flat_map(row)
    }
}

/// Validity dilated by one sample.
pub(super) fn near(valid: &[u8], n: usize) -> Vec<u8> {
    let row = n + 1;
    let mut across = valid.to_vec();
    for (to, from) in across.chunks_exact_mut(row).zip(valid.chunks_exact(row)) {
        to[1..].iter_mut().zip(from).for_each(|(to, from)| *to |= from);
        to[..n].iter_mut().zip(&from[1..]).for_each(|(to, from)| *to |= from);
    }
    let mut out = across.clone();
    out[row..].iter_mut().zip(&across).for_each(|(to, from)| *to |= from);
    out.iter_mut().zip(&across[row..]).for_each(|(to, from)| *to |= from);
    out
}

impl BorderCells<'_> {
    fn z(&self, at: usize) -> f64 {
        f64::from(self.heights[at])
    }

    fn is_valid(&self, at: usize) -> bool {
        self.valid[at] != 0
    }

    /// The errors of step `k >= 1` of a patch; the vertical one is at least `known`.
    pub fn step(&self, patch: &Patch, k: usize, known: f64) -> Covered {
        let s = 1 << k;
        let last = patch.side / s - 1;
        let mut covered = Covered { vertical: known, outline: false };
        for row in 0..=last {
            let inner = row > 0 && row < last;
            for column in (0..=last).step_by(if inner { last } else { 1 }) {
                let corner = patch.start + row * s * (self.n + 1) + column * s;
                self.cell(patch, k, corner, &mut covered, |turn| {
                    let at_corner = (column == 0 || column == last) && (row == 0 || row == last);
                    at_corner || ![row == 0, column == last, row == last, column == 0][turn]
                });
            }
        }
        covered
    }

    /// Measures the triangles of a cell that are drawn at half a step.
    fn cell(&self, patch: &Patch, k: usize, a: usize, covered: &mut Covered, drawn: impl Fn(usize) -> bool) {
        let (s, row) = (1 << k, self.n + 1);
        let (b, c, d, m) = (a + s, a + s * row, a + s * row + s, a + s / 2 * row + s / 2);
        let falling = if s == self.n { !self.odd } else { (a % row / s + a / row / s).is_multiple_of(2) };
        let diagonal = if falling { [a, d] } else { [b, c] };
        let off = (self.z(m) - 0.5 * (self.z(diagonal[0]) + self.z(diagonal[1]))).abs();
        let ends = if patch.mixed { diagonal.map(|at| self.is_valid(at)) } else { [true; 2] };
        let (across, down) = (1, row as isize);
        let triangles = [(a, across, down), (b, down, -across), (c, across, -down), (a, down, across)];
        for (turn, (origin, along, inward)) in triangles.into_iter().enumerate() {
            if drawn(turn) {
                self.triangle(patch, k, BorderTriangle { origin, along, inward, s }, (ends, off), covered);
            }
        }
    }

    /// Measures one triangle. `ends` are the validities of the ends of the cell's diagonal, `off`
    /// is the height difference of the centre and the middle of the diagonal.
    fn triangle(
        &self,
        patch: &Patch,
        k: usize,
        triangle: BorderTriangle,
        (ends, off): ([bool; 2], f64),
        covered: &mut Covered,
    ) {
        let e = patch.errors;
        let [a, b, m, n] = [(0, 0), (triangle.s, 0), (triangle.s / 2, triangle.s / 2), (triangle.s / 2, 0)]
            .map(|(u, v)| triangle.at(u, v));
        // True for steps k and k - 1 if their surface is shown wherever this one is.
        let mut shown = [true; 2];
        if patch.mixed {
            let [va, vb, vm, vn] = [a, b, m, n].map(|at| self.is_valid(at));
            if !va && !vb && !vm {
                return;
            }
            shown = [!vm || ends == [true; 2], vn || !va && !vb];
            let hidden = [vm || ends == [false; 2], !vn || va && vb];
            covered.outline |= shown == [false; 2] || hidden == [false; 2];
        }
        let middle = 0.5 * (self.z(a) + self.z(b));
        let mut bound = f64::INFINITY;
        for (is, error) in [(shown[0], e[k] + off), (shown[1], e[k - 1] + (self.z(n) - middle).abs())] {
            bound = if is { bound.min(error) } else { bound };
        }
        let plane = Plane {
            base: self.z(a),
            along: (self.z(b) - self.z(a)) / triangle.s as f64,
            inward: (self.z(m) - middle) * 2.0 / triangle.s as f64,
        };
        for j in (0..k).rev().skip(1) {
            if bound <= covered.vertical {
                return;
            }
            if !patch.mixed || triangle.samples(1 << j).all(|(_, _, at)| self.is_valid(at)) {
                bound = bound.min(e[j] + self.farthest(triangle, 1 << j, plane));
            }
        }
        if bound <= covered.vertical {
            return;
        }
        if patch.mixed && self.leaf {
            bound = bound.min(e[0] + self.farthest_near(triangle, plane));
        } else if bound.is_infinite() {
            let heights = [a, b, m].map(|at| self.z(at));
            let (low, high) = heights
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &z| (low.min(z), high.max(z)));
            bound = e[0] + (self.range.1 - low).max(high - self.range.0);
        }
        // The factor covers the rounding of f64; differences of f32 are mostly exact.
        covered.vertical = covered.vertical.max(bound * (1.0 + 1e-12));
    }

    /// Largest height difference between the samples of step `step` and the plane of the triangle.
    fn farthest(&self, triangle: BorderTriangle, step: usize, plane: Plane) -> f64 {
        let mut worst = [0.0_f64; 4];
        for v in (0..=triangle.s / 2).step_by(step) {
            let (start, end) = (v, triangle.s - v);
            if step == 1 && triangle.along == 1 {
                let row = &self.heights[triangle.at(start, v)..=triangle.at(end, v)];
                let base = plane.at(start, v);
                for (i, four) in row.chunks(4).enumerate() {
                    for (lane, &z) in four.iter().enumerate() {
                        let off = (f64::from(z) - (base + plane.along * (4 * i + lane) as f64)).abs();
                        worst[lane] = if off > worst[lane] { off } else { worst[lane] };
                    }
                }
                continue;
            }
            for u in (start..=end).step_by(step) {
                let off = (self.z(triangle.at(u, v)) - plane.at(u, v)).abs();
                worst[0] = if off > worst[0] { off } else { worst[0] };
            }
        }
        worst.into_iter().fold(0.0, f64::max)
    }

    /// [`Self::farthest`] of all samples that a shown triangle of step 0 can have.
    fn farthest_near(&self, triangle: BorderTriangle, plane: Plane) -> f64 {
        let counts = triangle.samples(1).filter(|&(_, _, at)| self.near[at] != 0);
        counts.map(|(u, v, at)| (self.z(at) - plane.at(u, v)).abs()).fold(0.0, f64::max)
    }
}

/// The plane of heights over a border triangle.
#[derive(Clone, Copy)]
struct Plane {
    base: f64,
    along: f64,
    inward: f64,
}

impl Plane {
    fn at(self, u: usize, v: usize) -> f64 {
        self.base + self.along * u as f64 + self.inward * v as f64
    }
}
