//! The quadtree of a tile's cells: what its squares hold, and upper bounds of their points.

use super::bound::UpperBounds;
use crate::simd::{self, Kernel};

/// The quadtree of the cells of a tile: level `j` has squares of `2^j` cells.
#[derive(Debug, Default)]
pub(super) struct Pyramid {
    n: usize,
    levels: Vec<Level>,
    /// The upper bounds of the four children of a square, in the order in which they were first
    /// needed, so that a search finds them near each other. Index 0 means none.
    upper_bounds: Vec<[UpperBounds; 4]>,
}

#[derive(Debug, Default)]
struct Level {
    /// [`HAS_VALID`](crate::patch::blocks::HAS_VALID) and `HAS_VOID` of each square, row by row.
    bits: Vec<u8>,
    /// For each square of the next level, row by row: index of its children in
    /// [`Pyramid::upper_bounds`]. The last level, of one square, has one index for it.
    siblings: Vec<u32>,
}

impl Pyramid {
    /// Starts a pyramid over `n x n` cells, `n` a power of two. Returns their bits, row by row, for
    /// the caller to set before [`Pyramid::build`].
    pub(super) fn start(&mut self, n: usize) -> &mut [u8] {
        self.upper_bounds.clear();
        self.upper_bounds.push([UpperBounds::UNKNOWN; 4]);
        self.n = n;
        self.levels.resize_with(n.ilog2() as usize + 1, Level::default);
        for (level, squares) in self.levels.iter_mut().enumerate() {
            let count = (n >> level) * (n >> level);
            squares.bits.resize(count, 0);
            squares.siblings.clear();
            squares.siblings.resize(count.div_ceil(4), 0);
        }
        &mut self.levels[0].bits
    }

    /// Builds the levels above the cells.
    pub(super) fn build(&mut self) {
        simd::run(Build(self));
    }

    /// Index of the upper bounds of the children, of level `level`, of a square of the level above;
    /// at the last level, of its one square.
    #[inline]
    pub(super) fn siblings(&mut self, level: usize, square: usize) -> usize {
        let number = &mut self.levels[level].siblings[square];
        if *number == 0 {
            // At most (2048 / 2)^2 and what is above them.
            *number = self.upper_bounds.len() as u32;
            self.upper_bounds.push([UpperBounds::UNKNOWN; 4]);
        }
        *number as usize
    }

    /// The upper bounds of square `child` of the children `siblings`.
    #[inline]
    pub(super) fn upper_bounds(&mut self, siblings: usize, child: usize) -> &mut UpperBounds {
        &mut self.upper_bounds[siblings][child]
    }

    /// The upper bounds of the children `siblings`.
    #[inline]
    pub(super) fn all_upper_bounds(&self, siblings: usize) -> &[UpperBounds; 4] {
        &self.upper_bounds[siblings]
    }

    /// Cells on a side of the tile.
    #[inline]
    pub(super) fn side(&self) -> usize {
        self.n
    }

    /// Bits of the squares of a level, row by row.
    pub(super) fn bits(&self, level: usize) -> &[u8] {
        &self.levels[level].bits
    }
}

/// Kernel: [`Pyramid::build`].
struct Build<'a>(&'a mut Pyramid);

impl Kernel for Build<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Pyramid { n, levels, .. } = self.0;
        for level in 1..levels.len() {
            let (finer, coarser) = levels.split_at_mut(level);
            by_four(&finer[level - 1].bits, *n >> (level - 1), &mut coarser[0].bits);
        }
    }
}

/// Joins the bits of each two by two of `side x side` squares.
#[inline(always)]
fn by_four(bits: &[u8], side: usize, joined: &mut [u8]) {
    let half = side / 2;
    for row in 0..half {
        let (north, south) = (&bits[2 * row * side..][..side], &bits[(2 * row + 1) * side..][..side]);
        let (north, south) = (&north.as_chunks::<2>().0[..half], &south.as_chunks::<2>().0[..half]);
        let joined = &mut joined[row * half..][..half];
        for x in 0..half {
            let ([a, b], [c, d]) = (north[x], south[x]);
            joined[x] = a | b | c | d;
        }
    }
}
