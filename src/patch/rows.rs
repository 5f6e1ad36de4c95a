//! The inner loops of metric `bound` for cells of 16 intervals and more: rows of samples against the two planes of a drawn cell, in
//! additions only.
//!
//! Everything is scaled by the cell size `s`, so that integers stay integers. A cell is cut into strips of a few columns whose state
//! stays in registers while its rows go by. Lanes are independent; the result does not depend on their number, since a
//! maximum has no order. The smallest cells have lanes of another kind ([`comb`](crate::patch::comb)).

use crate::patch::cell::Cell;
use crate::patch::number::Number;
use crate::sample::VALID;
use crate::simd::Kernel;

/// Columns of the strips of a cell with voids.
pub const LANES: usize = 8;

/// The drawn surface of a cell, times `s`.
///
/// With corners a, b, c, d (north-west, north-east, south-west, south-east) and `u`, `v` from the north-west,
/// `s D = s a + u (b - a) + v (d - b) + max(v - u, 0) (b + c - a - d)` on both sides of a falling diagonal, and
/// `s D = s a + u (b - a) + v (c - a) + max(u + v - s, 0) (a + d - b - c)` on both sides of a rising one.
#[derive(Clone, Copy)]
pub struct Drawn<N> {
    cell: Cell,
    bits: u32,
    start: N,
    across: N,
    down: N,
    bend: N,
}

impl<N: Number> Drawn<N> {
    /// The surface through four corners.
    #[inline(always)]
    pub fn new(cell: Cell, [a, b, c, d]: [N; 4]) -> Self {
        let bits = cell.s.trailing_zeros();
        let (down, bend) = if cell.falling {
            (d.minus(b), b.plus(c).minus(a).minus(d))
        } else {
            (c.minus(a), a.plus(d).minus(b).minus(c))
        };
        Self { cell, bits, start: a.scaled(bits), across: b.minus(a), down, bend }
    }

    /// Rows beyond the diagonal at column `u` of row 0.
    #[inline(always)]
    fn beyond(&self, u: usize) -> i32 {
        if self.cell.falling { -(u as i32) } else { u as i32 - self.cell.s as i32 }
    }
}

/// A strip of the drawn surface, row after row.
struct Strip<N, const L: usize> {
    base: N,
    across: [N; L],
    bend: [N; L],
    /// Rows beyond the diagonal, the bend's factor where it is not negative.
    beyond: [N; L],
}

impl<N: Number, const L: usize> Strip<N, L> {
    /// Columns `first..first + L` of row 0; `across` is the rise of column `first`, and of the column after the strip on return.
    #[inline(always)]
    fn new(drawn: &Drawn<N>, first: usize, across: &mut N) -> Self {
        let mut strip =
            Self { base: drawn.start, across: [N::ZERO; L], bend: [N::ZERO; L], beyond: [N::ZERO; L] };
        for lane in 0..L {
            strip.across[lane] = *across;
            *across = across.plus(drawn.across);
            strip.beyond[lane] = N::whole(drawn.beyond(first + lane));
        }
        strip
    }

    /// `s (z - D)` of a lane.
    #[inline(always)]
    fn difference(&self, lane: usize, scaled: N) -> N {
        scaled.minus(self.base).minus(self.across[lane]).minus(self.bend[lane])
    }

    /// `s D` of a lane.
    #[inline(always)]
    fn value(&self, lane: usize) -> N {
        self.base.plus(self.across[lane]).plus(self.bend[lane])
    }

    /// Goes one row south.
    #[inline(always)]
    fn step(&mut self, drawn: &Drawn<N>) {
        for lane in 0..L {
            let bend = if self.beyond[lane] >= N::ZERO { drawn.bend } else { N::ZERO };
            self.bend[lane] = self.bend[lane].plus(bend);
            self.beyond[lane] = self.beyond[lane].plus(N::whole(1));
        }
        self.base = self.base.plus(drawn.down);
    }
}

/// Largest `s |z - D|` in the columns of a strip; `z` starts at the cell's north-west corner.
#[inline(always)]
fn strip<N: Number, const L: usize>(
    z: &[N],
    stride: usize,
    drawn: &Drawn<N>,
    first: usize,
    across: &mut N,
) -> [N; L] {
    let mut strip = Strip::<N, L>::new(drawn, first, across);
    let mut worst = [N::ZERO; L];
    let mut from = first;
    for _ in 0..=drawn.cell.s {
        let Some(run) = z.get(from..from + L) else { break };
        for lane in 0..L {
            let difference = strip.difference(lane, run[lane].scaled(drawn.bits));
            worst[lane] = worst[lane].larger(difference.magnitude());
        }
        strip.step(drawn);
        from += stride;
    }
    worst
}

/// Largest `s |z - D|` in the last column of a cell, `across` above the first.
#[inline(always)]
fn last_column<N: Number>(z: &[N], stride: usize, drawn: &Drawn<N>, across: N) -> N {
    let (mut worst, mut base, mut bend) = (N::ZERO, drawn.start, N::ZERO);
    let slope = if drawn.cell.falling { N::ZERO } else { drawn.bend };
    for z in z.iter().skip(drawn.cell.s).step_by(stride).take(drawn.cell.s + 1) {
        let difference = z.scaled(drawn.bits).minus(base).minus(across).minus(bend);
        worst = worst.larger(difference.magnitude());
        base = base.plus(drawn.down);
        bend = bend.plus(slope);
    }
    worst
}

/// Largest `s |z - D|` of every cell of whole strips of `L` columns that counts; 0 for the others. Cells row by row.
pub struct Cells<'a, N, const L: usize> {
    /// Heights, `(n + 1)^2`.
    pub z: &'a [N],
    /// Intervals on a side.
    pub n: usize,
    /// Intervals of a cell.
    pub s: usize,
    /// True if cell 0 has a falling diagonal.
    pub falling: bool,
    /// True if sums are exact, so that the border of two cells is the same seen from either.
    pub exact: bool,
    /// Which cells count.
    pub counts: &'a dyn Fn(usize) -> bool,
}

impl<N: Number, const L: usize> Kernel for Cells<'_, N, L> {
    type Output = Vec<N>;

    #[inline(always)]
    fn run(self) -> Vec<N> {
        let (s, stride) = (self.s, self.n + 1);
        let cells = self.n / s;
        let mut worst = vec![N::ZERO; cells * cells];
        for row in 0..cells {
            // The western border of the cell to the east.
            let mut border = None;
            for column in (0..cells).rev() {
                let at = row * cells + column;
                if !(self.counts)(at) {
                    border = None;
                    continue;
                }
                let cell = Cell { s, falling: self.falling == (column + row).is_multiple_of(2) };
                let z = &self.z[row * s * stride + column * s..];
                let drawn = Drawn::new(cell, [z[0], z[s], z[s * stride], z[s * stride + s]]);
                let mut across = N::ZERO;
                let mut lanes = strip::<N, L>(z, stride, &drawn, 0, &mut across);
                let west = lanes[0];
                for first in (L..s).step_by(L) {
                    let more = strip::<N, L>(z, stride, &drawn, first, &mut across);
                    for (lane, more) in lanes.iter_mut().zip(more) {
                        *lane = lane.larger(more);
                    }
                }
                let east = match border {
                    Some(border) if self.exact => border,
                    _ => last_column(z, stride, &drawn, across),
                };
                worst[at] = lanes.into_iter().fold(east, N::larger);
                border = Some(west);
            }
        }
        worst
    }
}

/// A void sample that shares no unit cell with a valid one.
pub const FAR: u8 = 0;
/// A void sample that shares a unit cell with a valid one.
pub const NEAR: u8 = 1;

/// Largest `s |z - D|` over the valid samples and over the void ones next to them, of a cell of `s >= 8` intervals with voids.
///
/// With `MIXED` only samples count where the drawn validity is at least 1/2; otherwise it is 1 everywhere.
pub struct HoledCell<'a, N, const MIXED: bool> {
    /// Heights from the north-west corner on.
    pub z: &'a [N],
    /// [`VALID`], [`NEAR`] or [`FAR`], from there on.
    pub class: &'a [u8],
    /// Samples in a row.
    pub stride: usize,
    /// The cell.
    pub cell: Cell,
}

impl<N: Number, const MIXED: bool> HoledCell<'_, N, MIXED> {
    /// Corners of one kind.
    #[inline(always)]
    fn corners<T>(&self, of: impl Fn(usize) -> T) -> [T; 4] {
        let s = self.cell.s;
        [0, s, s * self.stride, s * self.stride + s].map(of)
    }

    #[inline(always)]
    fn strip(
        &self,
        first: usize,
        (drawn, across): (&Drawn<N>, &mut N),
        (shown, shown_across): (&Drawn<N>, &mut N),
        worst: &mut [[N; LANES]; 2],
    ) {
        let mut heights = Strip::<N, LANES>::new(drawn, first, across);
        let mut validity = Strip::<N, LANES>::new(shown, first, shown_across);
        let half = N::whole((self.cell.s / 2) as i32);
        let [mut valid, mut near] = *worst;
        let mut from = first;
        for _ in 0..=self.cell.s {
            let (Some(z), Some(class)) = (self.z.get(from..from + LANES), self.class.get(from..from + LANES))
            else {
                break;
            };
            for lane in 0..LANES {
                let difference = heights.difference(lane, z[lane].scaled(drawn.bits)).magnitude();
                let drawn = !MIXED || validity.value(lane) >= half;
                let counted = if drawn { difference } else { N::ZERO };
                valid[lane] = valid[lane].larger(if class[lane] > NEAR { counted } else { N::ZERO });
                near[lane] = near[lane].larger(if class[lane] == NEAR { counted } else { N::ZERO });
            }
            heights.step(drawn);
            if MIXED {
                validity.step(shown);
            }
            from += self.stride;
        }
        *worst = [valid, near];
    }

    /// The last column of the cell.
    #[inline(always)]
    fn last_column(&self, drawn: &Drawn<N>, across: N, shown: &Drawn<N>, worst: &mut [N; 2]) {
        let s = self.cell.s;
        let (mut base, mut bend) = (drawn.start, N::ZERO);
        let half = N::whole((s / 2) as i32);
        let mut validity = shown.start.plus(shown.across.scaled(shown.bits));
        let slope = |of: &Drawn<N>| if self.cell.falling { N::ZERO } else { of.bend };
        for v in 0..=s {
            let at = v * self.stride + s;
            let difference = self.z[at].scaled(drawn.bits).minus(base).minus(across).minus(bend).magnitude();
            let class = self.class[at];
            if class != FAR && (!MIXED || validity >= half) {
                let to = &mut worst[usize::from(class == NEAR)];
                *to = to.larger(difference);
            }
            base = base.plus(drawn.down);
            bend = bend.plus(slope(drawn));
            validity = validity.plus(shown.down).plus(slope(shown));
        }
    }
}

impl<N: Number, const MIXED: bool> Kernel for HoledCell<'_, N, MIXED> {
    /// Over the valid samples; over the void ones next to them.
    type Output = [N; 2];

    #[inline(always)]
    fn run(self) -> [N; 2] {
        let drawn = Drawn::new(self.cell, self.corners(|i| self.z[i]));
        let shown = Drawn::new(self.cell, self.corners(|i| N::whole(i32::from(self.class[i] > NEAR))));
        let (mut across, mut shown_across) = (N::ZERO, N::ZERO);
        let mut lanes = [[N::ZERO; LANES]; 2];
        for first in (0..self.cell.s).step_by(LANES) {
            self.strip(first, (&drawn, &mut across), (&shown, &mut shown_across), &mut lanes);
        }
        let mut worst = lanes.map(|lanes| lanes.into_iter().fold(N::ZERO, N::larger));
        self.last_column(&drawn, across, &shown, &mut worst);
        worst
    }
}

/// Largest `s |z - D|` over the valid samples of a cell of `s <= 8` intervals whose corners are valid: the same sums, one by one.
pub fn narrow_cell<N: Number>(z: &[N], class: &[u8], stride: usize, cell: Cell) -> N {
    let s = cell.s;
    let at = |x: usize, y: usize| y * stride + x;
    let mut worst = N::ZERO;
    let mut count = |index: usize, difference: N| {
        if class[index] == VALID {
            worst = worst.larger(difference.magnitude());
        }
    };
    if s == 2 {
        let [a, b] = if cell.falling { [at(0, 0), at(2, 2)] } else { [at(2, 0), at(0, 2)] };
        for (c, a, b) in [
            (at(1, 0), at(0, 0), at(2, 0)),
            (at(0, 1), at(0, 0), at(0, 2)),
            (at(2, 1), at(2, 0), at(2, 2)),
            (at(1, 2), at(0, 2), at(2, 2)),
            (at(1, 1), a, b),
        ] {
            count(c, z[c].scaled(1).minus(z[a]).minus(z[b]));
        }
        return worst;
    }
    let drawn = Drawn::new(cell, [z[0], z[s], z[at(0, s)], z[at(s, s)]]);
    let mut bend = [N::ZERO; 9];
    for m in 0..s {
        bend[m + 1] = bend[m].plus(drawn.bend);
    }
    let mut base = drawn.start;
    for v in 0..=s {
        let mut across = N::ZERO;
        for u in 0..=s {
            let beyond = if cell.falling { v.saturating_sub(u) } else { (u + v).saturating_sub(s) };
            let index = at(u, v);
            count(index, z[index].scaled(drawn.bits).minus(base).minus(across).minus(bend[beyond]));
            across = across.plus(drawn.across);
        }
        base = base.plus(drawn.down);
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patch::comb::{Comb, SmallCells};
    use crate::sample::VOID;
    use crate::simd;
    use proptest::prelude::*;

    proptest! {
        /// Floats are rounded: all ways must add in the same order to find the same bits.
        #[test]
        fn strips_and_combs_find_the_bits_of_the_plain_sums(
            seed in proptest::collection::vec((-1e4_f64..1e4, 0..5_u8), 17 * 17),
        ) {
            let n = 16;
            let z: Vec<f64> = seed.iter().map(|v| v.0).collect();
            let valid = vec![VALID; z.len()];
            let mut small = simd::run(Comb { z: &z, n });
            for s in SmallCells::<f64>::SIZES {
                for (column, row) in (0..n / s * (n / s)).map(|i| (i % (n / s), i / (n / s))) {
                    let cell = Cell { s, falling: (column + row).is_multiple_of(2) };
                    let from = row * s * (n + 1) + column * s;
                    let plain = narrow_cell(&z[from..], &valid[from..], n + 1, cell);
                    prop_assert_eq!(*small.of(s, column, row), plain);
                }
            }
            let strips = simd::run(Cells::<_, 8> { z: &z, n, s: 8, falling: true, exact: false, counts: &|_| true });
            for (at, strips) in strips.into_iter().enumerate() {
                prop_assert_eq!(strips, *small.of(8, at % 2, at / 2));
            }
            let mut class: Vec<u8> = seed.iter().map(|v| if v.1 == 0 { VOID } else { VALID }).collect();
            for corner in [0, 8, 17 * 8, 17 * 8 + 8] {
                class[corner] = VALID;
            }
            let cell = Cell { s: 8, falling: true };
            let [worst, near] = simd::run(HoledCell::<_, false> { z: &z, class: &class, stride: n + 1, cell });
            prop_assert_eq!(worst, narrow_cell(&z, &class, n + 1, cell));
            prop_assert_eq!(near, 0.0);
        }
    }
}
