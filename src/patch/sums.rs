//! A drawn surface of a cell as sums: no multiplication for a sample, and integers stay integers.

use crate::patch::number::Number;
use crate::patch::rows::Drawn;

/// Intervals on a side of a square.
pub const SIDE: usize = 8;
/// Rows of samples of a square.
pub const ROWS: usize = SIDE + 1;

/// Numbers of eight columns.
pub type Lanes<N> = [N; SIDE];

/// Sums of a drawn surface: its value at column `u` of row `v`, times `s`, is that of the row, of the column, and of the bend.
pub struct Sums<N> {
    /// Intervals of the cell.
    pub s: usize,
    falling: bool,
    /// Binary logarithm of `s`.
    pub bits: u32,
    /// By row.
    pub base: Vec<N>,
    /// By column.
    pub across: Vec<N>,
    /// The bend by the distance from the diagonal, which moves along with the rows.
    pub bend: Vec<N>,
}

impl<N: Number> Sums<N> {
    /// Room for the cells of a tile of `n` intervals.
    pub fn new(n: usize) -> Self {
        let zeros = |count: usize| vec![N::ZERO; count];
        Self {
            s: n,
            falling: false,
            bits: 0,
            base: zeros(n + 1),
            across: zeros(n + 1),
            bend: zeros(2 * n + 1),
        }
    }

    /// Sets up the sums of a surface, added up one after the other.
    #[inline(always)]
    pub fn set(&mut self, drawn: &Drawn<N>) {
        let s = drawn.cell.s;
        (self.s, self.falling, self.bits) = (s, drawn.cell.falling, drawn.bits);
        progress(self.base[..=s].iter_mut(), drawn.start, drawn.down);
        progress(self.across[..=s].iter_mut(), N::ZERO, drawn.across);
        let (west, east) = self.bend[..=2 * s].split_at_mut(s);
        if self.falling {
            east.fill(N::ZERO);
            progress(west.iter_mut().rev(), N::ZERO.plus(drawn.bend), drawn.bend);
        } else {
            west.fill(N::ZERO);
            progress(east.iter_mut(), N::ZERO, drawn.bend);
        }
    }

    /// Where the bend of a sample is.
    #[inline(always)]
    pub fn bend_at(&self, u: usize, v: usize) -> usize {
        u + if self.falling { self.s - v } else { v }
    }

    /// The value of the surface, times `s`.
    #[inline(always)]
    pub fn value(&self, u: usize, v: usize) -> N {
        self.base[v].plus(self.across[u]).plus(self.bend[self.bend_at(u, v)])
    }

    /// What eight columns from `u` on, of nine rows from `v` on, need of the sums.
    #[inline(always)]
    pub fn window(&self, u: usize, v: usize) -> Window<N> {
        let mut window = Window {
            falling: self.falling,
            bits: self.bits,
            base: [N::ZERO; ROWS],
            across: [N::ZERO; SIDE],
            bend: [N::ZERO; 2 * SIDE],
        };
        let first = self.bend_at(u, if self.falling { v + SIDE } else { v });
        window.base.copy_from_slice(&self.base[v..v + ROWS]);
        window.across.copy_from_slice(&self.across[u..u + SIDE]);
        window.bend.copy_from_slice(&self.bend[first..first + 2 * SIDE]);
        window
    }
}

/// Sets numbers that grow by a step.
#[inline(always)]
fn progress<'a, N: Number + 'a>(numbers: impl Iterator<Item = &'a mut N>, first: N, step: N) {
    let mut next = first;
    for number in numbers {
        *number = next;
        next = next.plus(step);
    }
}

/// Sums of a square.
pub struct Window<N> {
    falling: bool,
    bits: u32,
    base: [N; ROWS],
    across: Lanes<N>,
    bend: [N; 2 * SIDE],
}

impl<N: Number> Window<N> {
    /// The bend along row `r`.
    #[inline(always)]
    fn bend(&self, r: usize) -> &[N] {
        let first = if self.falling { SIDE - r } else { r };
        &self.bend[first..first + SIDE]
    }

    /// `s (z - D)` along row `r`.
    #[inline(always)]
    pub fn differences(&self, z: &[N], r: usize) -> Lanes<N> {
        let (z, bend) = (&z[..SIDE], self.bend(r));
        let mut out = [N::ZERO; SIDE];
        for lane in 0..SIDE {
            let difference = z[lane].scaled(self.bits).minus(self.base[r]);
            out[lane] = difference.minus(self.across[lane]).minus(bend[lane]);
        }
        out
    }

    /// `s D` along row `r`.
    #[inline(always)]
    pub fn values(&self, r: usize) -> Lanes<N> {
        let bend = self.bend(r);
        let mut out = [N::ZERO; SIDE];
        for lane in 0..SIDE {
            out[lane] = self.base[r].plus(self.across[lane]).plus(bend[lane]);
        }
        out
    }
}
