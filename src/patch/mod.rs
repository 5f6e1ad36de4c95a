//! Geometric errors: for every patch of a tile and every step, vertical and horizontal, in metres.
//!
//! Errors grow bottom-up in one pass. A tile takes over those of its children ([`inherit`]:
//! `e(parent, k) = max e(child, k + 1)`) and measures only its own coarsest step: from the samples
//! in a leaf tile ([`exact`]), from minimum and maximum over blocks above ([`envelope`]), or one
//! vertex at a time as the papers do ([`paper`]). Horizontal errors are those of the outline of
//! voids ([`outline`]). Nothing here knows files or threads.
//!
//! An exact error is `max |z - D|` over a cell: its heights `z` against the drawn surface `D`
//! (`drawn_surface`). `heights` chooses the numbers that are compared (`number`). Cells of 2 to 8
//! intervals are measured in vectors of cells (`small_cells`), larger ones by branch and bound
//! (`blocked`), those with voids in `cells_with_voids` and `clipped`.
//!
//! Step `k` means spacing `s = 2^k`, step 0 the finest, as in papers 000 and 001.

mod blocked;
pub mod blocks;
pub mod cell;
mod cells_with_voids;
mod clipped;
mod drawn_surface;
pub mod envelope;
pub mod exact;
mod heights;
pub mod inherit;
mod number;
pub mod outline;
pub mod paper;
mod small_cells;

use crate::geo::{Scale, Spacing};

/// The properties of a tile, besides its samples, on which its errors depend.
#[derive(Clone, Copy, Debug)]
pub struct TileGeometry {
    /// Intervals on a side, T.
    pub n: usize,
    /// Intervals on a side of a patch, P.
    pub patch: usize,
    /// True if tile column + row is odd: the diagonal of a cell as large as the tile is then
    /// north-east to south-west.
    pub odd: bool,
    /// Most metres of one interval of the tile within the raster.
    pub spacing: Spacing,
    /// The scale of its horizontal distances.
    pub scale: Scale,
    /// Metres of one unit of the numbers that errors are measured in (codes of integers, values of
    /// floats).
    pub metres: f64,
}

impl TileGeometry {
    /// Number of steps of a patch, p + 1.
    pub fn steps(&self) -> usize {
        self.patch.trailing_zeros() as usize + 1
    }

    /// Patches on a side.
    pub fn patches(&self) -> usize {
        self.n / self.patch
    }

    /// True if cell (column, row) of spacing `s` has its diagonal from north-west to south-east.
    ///
    /// The rule counts cells over the whole level; within the tile parity is the same unless one
    /// cell fills it.
    pub fn falling(&self, s: usize, column: usize, row: usize) -> bool {
        if s == self.n { !self.odd } else { (column + row).is_multiple_of(2) }
    }
}

/// The errors of one tile in metres, not yet rounded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Errors {
    /// Vertical errors, `[step][patch]`, patches row by row.
    pub vertical: Vec<Vec<f64>>,
    /// Horizontal errors, `[step][patch]`.
    pub horizontal: Vec<Vec<f64>>,
    /// Vertical errors of cells of 2P, 4P, .. T leaf intervals, which a leaf measures for the
    /// levels above; for each size the cells of a square, row by row.
    pub ahead_vertical: Vec<Vec<f64>>,
    /// Horizontal errors of the same cells.
    pub ahead_horizontal: Vec<Vec<f64>>,
}

impl Errors {
    /// True if these are the errors of `patches x patches` patches and `steps` steps, and those
    /// measured ahead have sizes that fit.
    pub fn is_of(&self, patches: usize, steps: usize) -> bool {
        let finer = |errors: &Vec<Vec<f64>>| {
            errors.len() == steps && errors.iter().all(|step| step.len() == patches * patches)
        };
        let ahead = |errors: &Vec<Vec<f64>>| {
            let sides = (1..).map(|j| patches.checked_shr(j).unwrap_or(0));
            errors.iter().zip(sides).all(|(square, side)| side > 0 && square.len() == side * side)
        };
        let alike = self.ahead_vertical.len() == self.ahead_horizontal.len();
        finer(&self.vertical)
            && finer(&self.horizontal)
            && alike
            && ahead(&self.ahead_vertical)
            && ahead(&self.ahead_horizontal)
    }
}

/// Raises every error to at least that of the finer step before it.
pub fn make_monotone(steps: &mut [Vec<f64>]) {
    for k in 1..steps.len() {
        let (finer, coarser) = steps.split_at_mut(k);
        for (coarse, &fine) in coarser[0].iter_mut().zip(&finer[k - 1]) {
            *coarse = coarse.max(fine);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_another_shape_are_told_apart() {
        let errors = |steps: usize, patches: usize, ahead: &[usize]| Errors {
            vertical: vec![vec![0.0; patches * patches]; steps],
            horizontal: vec![vec![0.0; patches * patches]; steps],
            ahead_vertical: ahead.iter().map(|side| vec![0.0; side * side]).collect(),
            ahead_horizontal: ahead.iter().map(|side| vec![0.0; side * side]).collect(),
        };
        assert!(
            errors(7, 4, &[]).is_of(4, 7)
                && errors(7, 4, &[2, 1]).is_of(4, 7)
                && errors(7, 1, &[]).is_of(1, 7)
        );
        for wrong in [errors(6, 4, &[]), errors(7, 2, &[]), errors(7, 4, &[2, 2]), errors(7, 4, &[2, 1, 0])] {
            assert!(!wrong.is_of(4, 7));
        }
        let uneven = Errors { ahead_vertical: Vec::new(), ..errors(7, 4, &[2]) };
        assert!(!uneven.is_of(4, 7));
    }
}
