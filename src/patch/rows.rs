//! The inner loop of metric `bound`: rows of samples against the two planes of a drawn cell, in additions only.
//!
//! Everything is scaled by the cell size `s`, so that integers stay integers. Lanes are independent, for the sake of the
//! vectoriser; the result does not depend on their number, since a maximum has no order.

use crate::patch::cell::Cell;
use crate::sample::VALID;

/// Numbers that rows are compared in.
pub trait Number: Copy + PartialOrd + Default {
    /// Sum.
    fn plus(self, other: Self) -> Self;
    /// Difference.
    fn minus(self, other: Self) -> Self;
    /// Times `2^bits`.
    fn scaled(self, bits: u32) -> Self;
    /// Absolute value.
    fn magnitude(self) -> Self;

    /// Maximum of two.
    #[inline]
    fn larger(self, other: Self) -> Self {
        if other > self { other } else { self }
    }
}

impl Number for i32 {
    #[inline]
    fn plus(self, other: Self) -> Self {
        self + other
    }
    #[inline]
    fn minus(self, other: Self) -> Self {
        self - other
    }
    #[inline]
    fn scaled(self, bits: u32) -> Self {
        self << bits
    }
    #[inline]
    fn magnitude(self) -> Self {
        self.abs()
    }
}

impl Number for f64 {
    #[inline]
    fn plus(self, other: Self) -> Self {
        self + other
    }
    #[inline]
    fn minus(self, other: Self) -> Self {
        self - other
    }
    #[inline]
    fn scaled(self, bits: u32) -> Self {
        self * f64::from(1_u32 << bits)
    }
    #[inline]
    fn magnitude(self) -> Self {
        self.abs()
    }
}

/// Samples that are looked at together.
const LANES: usize = 8;

/// Multiples of the slopes of a cell, made anew for each.
pub struct Ramps<N> {
    /// `u gx` for u = 0..=s.
    across: Vec<N>,
    /// The bend at the diagonal: `k max(s - j, 0)` (falling) or `k max(j - s, 0)` (rising) for j = 0..=2s.
    bend: Vec<N>,
}

impl<N: Number> Ramps<N> {
    /// Ramps for cells of `s` intervals.
    pub fn new(s: usize) -> Self {
        Self { across: vec![N::default(); s + 1], bend: vec![N::default(); 2 * s + 1] }
    }

    /// Fills in the multiples of `gx` and `k`.
    fn set(&mut self, gx: N, k: N, falling: bool) {
        let count = |to: &mut dyn Iterator<Item = &mut N>, slope: N| {
            let mut sum = N::default();
            for to in to {
                *to = sum;
                sum = sum.plus(slope);
            }
        };
        let s = self.across.len() - 1;
        count(&mut self.across.iter_mut(), gx);
        let (before, after) = self.bend.split_at_mut(s);
        if falling {
            after.fill(N::default());
            count(&mut before.iter_mut().rev(), k);
            for to in before {
                *to = to.plus(k);
            }
        } else {
            before.fill(N::default());
            count(&mut after.iter_mut(), k);
        }
    }
}

/// Largest `s |z - D|` over the samples of a cell; `z` and `state` start at its north-west corner.
///
/// With `MASKED` only valid samples count; all four corners are valid in any case. With corners a, b, c, d (north-west, north-east, south-west,
/// south-east) and `u`, `v` from the north-west,
/// `s D = s a + u (b - a) + v (d - b) + max(v - u, 0) (b + c - a - d)` on both sides of a falling diagonal, and
/// `s D = s a + u (b - a) + v (c - a) + max(u + v - s, 0) (a + d - b - c)` on both sides of a rising one.
pub fn farthest<N: Number, const MASKED: bool>(
    z: &[N],
    state: &[u8],
    stride: usize,
    cell: Cell,
    ramps: &mut Ramps<N>,
) -> N {
    let s = cell.s;
    if s == 2 {
        return smallest_cell::<N, MASKED>(z, state, stride, cell.falling);
    }
    let bits = s.trailing_zeros();
    let (a, b, c, d) = (z[0], z[s], z[s * stride], z[s * stride + s]);
    let (down, bend) = if cell.falling {
        (d.minus(b), b.plus(c).minus(a).minus(d))
    } else {
        (c.minus(a), a.plus(d).minus(b).minus(c))
    };
    ramps.set(b.minus(a), bend, cell.falling);
    let mut base = a.scaled(bits);
    let mut worst = [N::default(); LANES];
    for v in 0..=s {
        let from = if cell.falling { s - v } else { v };
        let run = v * stride..=v * stride + s;
        let state = if MASKED { &state[run.clone()] } else { &[] };
        row::<N, MASKED>(
            &z[run],
            state,
            &ramps.across,
            &ramps.bend[from..=from + s],
            (base, bits),
            &mut worst,
        );
        base = base.plus(down);
    }
    worst.into_iter().fold(N::default(), N::larger)
}

/// One row of a cell: `|2^bits z - base - across - bend|`, lane by lane.
#[inline]
fn row<N: Number, const MASKED: bool>(
    z: &[N],
    state: &[u8],
    across: &[N],
    bend: &[N],
    (base, bits): (N, u32),
    worst: &mut [N; LANES],
) {
    let count = z.len();
    let whole = count - count % LANES;
    let difference = |i: usize| {
        let difference = z[i].scaled(bits).minus(base).minus(across[i]).minus(bend[i]).magnitude();
        if MASKED && state[i] != VALID { N::default() } else { difference }
    };
    for start in (0..whole).step_by(LANES) {
        let (z, across, bend) =
            (&z[start..start + LANES], &across[start..start + LANES], &bend[start..start + LANES]);
        for lane in 0..LANES {
            let difference =
                z[lane].scaled(bits).minus(base).minus(across[lane]).minus(bend[lane]).magnitude();
            let counted = !MASKED || state[start + lane] == VALID;
            worst[lane] = worst[lane].larger(if counted { difference } else { N::default() });
        }
    }
    for i in whole..count {
        worst[0] = worst[0].larger(difference(i));
    }
}

/// A cell of two intervals: only its five dropped vertices can differ.
#[inline]
fn smallest_cell<N: Number, const MASKED: bool>(z: &[N], state: &[u8], stride: usize, falling: bool) -> N {
    let at = |x: usize, y: usize| y * stride + x;
    let off = |c: usize, a: usize, b: usize| {
        let difference = z[c].scaled(1).minus(z[a]).minus(z[b]).magnitude();
        if MASKED && state[c] != VALID { N::default() } else { difference }
    };
    let centre = if falling { off(at(1, 1), at(0, 0), at(2, 2)) } else { off(at(1, 1), at(2, 0), at(0, 2)) };
    off(at(1, 0), at(0, 0), at(2, 0))
        .larger(off(at(0, 1), at(0, 0), at(0, 2)))
        .larger(off(at(2, 1), at(2, 0), at(2, 2)))
        .larger(off(at(1, 2), at(0, 2), at(2, 2)))
        .larger(centre)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::VOID;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rows_of_additions_equal_the_planes(
            bits in 1_u32..6,
            falling: bool,
            seed in proptest::collection::vec((0..1_i32 << 17, 0..5_u8), 33 * 33),
        ) {
            let s = 1_usize << bits;
            let cell = Cell { s, falling };
            let stride = s + 1;
            let z: Vec<i32> = seed[..stride * stride].iter().map(|v| v.0).collect();
            let corners = [0, s, s * stride, s * stride + s];
            let mut state: Vec<u8> = seed[..stride * stride].iter().map(|v| if v.1 == 0 { VOID } else { VALID }).collect();
            for i in corners {
                state[i] = VALID;
            }
            let planes = cell.planes(corners.map(|i| f64::from(z[i])));
            let (mut all, mut valid) = (0.0_f64, 0.0_f64);
            for y in 0..=s {
                for x in 0..=s {
                    let (fx, fy) = (x as f64, y as f64);
                    let drawn = planes[cell.triangle(fx, fy)].value(fx, fy);
                    let off = (f64::from(z[y * stride + x]) - drawn).abs();
                    all = all.max(off);
                    valid = valid.max(if state[y * stride + x] == VALID { off } else { 0.0 });
                }
            }
            let narrow = farthest::<_, false>(&z, &state, stride, cell, &mut Ramps::new(s));
            let masked = farthest::<_, true>(&z, &state, stride, cell, &mut Ramps::new(s));
            let wide: Vec<f64> = z.iter().map(|&v| f64::from(v)).collect();
            let wide_masked = farthest::<_, true>(&wide, &state, stride, cell, &mut Ramps::new(s));
            let wide = farthest::<_, false>(&wide, &state, stride, cell, &mut Ramps::new(s));
            prop_assert_eq!(f64::from(narrow) / s as f64, all);
            prop_assert_eq!(wide / s as f64, all);
            prop_assert_eq!(f64::from(masked) / s as f64, valid);
            prop_assert_eq!(wide_masked / s as f64, valid);
        }
    }
}
