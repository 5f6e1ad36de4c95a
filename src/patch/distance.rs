//! Nearest feature of every cell of a tile: an exact Euclidean feature transform with metres of their own per column and row.
//!
//! Features stand on the *half lattice*: point (X, Y), `0 <= X, Y <= 2n`, lies X / 2 columns and Y / 2 rows from the
//! north-west, so (odd, odd) is the centre of a cell and (even, even) a sample. The nearest one is found for the centre
//! of each of the `n x n` cells, in time that does not depend on how many features there are (Meijster; Felzenszwalb
//! and Huttenlocher). A tie, or rounding at a tie, may give either: what it gives is always a feature.

use crate::geo::Spacing;

/// Row of the nearest feature north of a point if there is none.
const NONE_NORTH: i16 = -16_384;
/// Row of the nearest feature south of a point if there is none.
const NONE_SOUTH: i16 = 20_000;
/// Half rows that no feature of a tile is away: above them there is none.
const FAR: i16 = 10_000;

/// A point of the half lattice: column, row.
pub type HalfPoint = [i16; 2];

/// The transform of one tile.
#[derive(Clone, Debug)]
pub struct Nearest {
    n: usize,
    /// `(2n + 1)^2`, non-zero at features.
    mask: Vec<u8>,
    /// For each row of cells and each half column, the half row of the nearest feature of that half column.
    columns: Vec<i16>,
    /// For each cell, the nearest feature.
    cells: Vec<HalfPoint>,
    /// Half columns whose features are nearest somewhere in the row, with the half column from which on they are.
    envelope: Vec<(i16, f64)>,
}

impl Nearest {
    /// A tile of `n` intervals, at most 2 048, without features.
    pub fn new(n: usize) -> Self {
        debug_assert!(n <= 2048, "half rows must stay below FAR");
        let mask = vec![0; (2 * n + 1) * (2 * n + 1)];
        Self { n, mask, columns: Vec::new(), cells: Vec::new(), envelope: Vec::new() }
    }

    /// Marks of half row `row`, one a half column: write non-zero at features.
    pub fn row_mut(&mut self, row: usize) -> &mut [u8] {
        let width = 2 * self.n + 1;
        &mut self.mask[row * width..(row + 1) * width]
    }

    /// Finds the nearest feature of every cell; false if there is no feature at all.
    ///
    /// `spacing` is that of the lattice, finite and positive.
    pub fn solve(&mut self, spacing: Spacing) -> bool {
        self.cells.clear();
        if !self.mask.iter().any(|&mark| mark != 0) {
            return false;
        }
        self.solve_columns();
        self.cells.reserve(self.n * self.n);
        let ratio = (spacing.dy / spacing.dx) * (spacing.dy / spacing.dx);
        for row in 0..self.n {
            self.solve_row(row, ratio);
        }
        true
    }

    /// Nearest feature of cell `(x, y)`; `None` if the tile has none.
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> Option<HalfPoint> {
        self.cells.get(y * self.n + x).copied()
    }

    /// Nearest features of all cells, row by row; empty if the tile has none.
    pub fn cells(&self) -> &[HalfPoint] {
        &self.cells
    }

    /// Along each half column, from every row of cell centres: first what lies north, then what lies south.
    fn solve_columns(&mut self) {
        let width = 2 * self.n + 1;
        self.columns.clear();
        self.columns.resize(self.n * width, 0);
        let mut seen = vec![NONE_NORTH; width];
        for (y, marks) in self.mask.chunks_exact(width).enumerate().take(2 * self.n) {
            note(&mut seen, marks, y as i16);
            if y % 2 == 1 {
                self.columns[y / 2 * width..(y / 2 + 1) * width].copy_from_slice(&seen);
            }
        }
        seen.fill(NONE_SOUTH);
        for (y, marks) in self.mask.chunks_exact(width).enumerate().skip(1).rev() {
            note(&mut seen, marks, y as i16);
            if y % 2 == 1 {
                let here = y as i16;
                let nearest = &mut self.columns[y / 2 * width..(y / 2 + 1) * width];
                for (north, &south) in nearest.iter_mut().zip(&seen) {
                    *north = if south - here < here - *north { south } else { *north };
                }
            }
        }
    }

    /// Along one row of cells: the lower envelope of the parabolas of its half columns. `ratio` is `(dy / dx)^2`.
    fn solve_row(&mut self, row: usize, ratio: f64) {
        let width = 2 * self.n + 1;
        let nearest = &self.columns[row * width..(row + 1) * width];
        let here = 2 * row as i16 + 1;
        let height = |x: i16| {
            let rows = f64::from(nearest[x as usize] - here);
            rows * rows * ratio
        };
        self.envelope.clear();
        for x in (0..width as i16).filter(|&x| (nearest[x as usize] - here).abs() < FAR) {
            let mut from = f64::NEG_INFINITY;
            while let Some(&(before, since)) = self.envelope.last() {
                // Where the parabolas of the half columns `before` and `x` cross.
                from = 0.5 * ((height(x) - height(before)) / f64::from(x - before) + f64::from(x + before));
                if from > since {
                    break;
                }
                self.envelope.pop();
                from = f64::NEG_INFINITY;
            }
            self.envelope.push((x, from));
        }
        let mut rest = self.envelope.as_slice();
        for cell in 0..self.n {
            let centre = (2 * cell + 1) as f64;
            while rest.get(1).is_some_and(|&(_, from)| from <= centre) {
                rest = &rest[1..];
            }
            let x = rest.first().map_or(0, |&(x, _)| x);
            self.cells.push([x, nearest[x as usize]]);
        }
    }
}

/// Sets `seen` to `row` where there is a mark.
fn note(seen: &mut [i16], marks: &[u8], row: i16) {
    for (seen, &mark) in seen.iter_mut().zip(marks) {
        *seen = if mark == 0 { *seen } else { row };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn squared([ax, ay]: HalfPoint, [bx, by]: HalfPoint, spacing: Spacing) -> f64 {
        let (x, y) = (f64::from(ax - bx) * spacing.dx, f64::from(ay - by) * spacing.dy);
        x * x + y * y
    }

    proptest! {
        #[test]
        fn finds_the_nearest(
            log_n in 0_u32..6,
            features in prop::collection::vec((0_u16..1000, 0_u16..1000), 0..40),
            dy in 0.1_f64..10.0,
        ) {
            let n = 1_usize << log_n;
            let spacing = Spacing { dx: 1.0, dy };
            let side = 2 * n as u16 + 1;
            let features: Vec<HalfPoint> =
                features.into_iter().map(|(x, y)| [(x % side) as i16, (y % side) as i16]).collect();
            let mut nearest = Nearest::new(n);
            for &[x, y] in &features {
                nearest.row_mut(y as usize)[x as usize] = 1;
            }
            prop_assert_eq!(nearest.solve(spacing), !features.is_empty());
            prop_assert_eq!(nearest.at(0, 0).is_some(), !features.is_empty());
            for (i, &found) in nearest.cells().iter().enumerate() {
                prop_assert!(features.contains(&found));
                let centre = [2 * (i % n) as i16 + 1, 2 * (i / n) as i16 + 1];
                let best = features.iter().map(|&f| squared(f, centre, spacing)).fold(f64::INFINITY, f64::min);
                prop_assert!(squared(found, centre, spacing) <= best * (1.0 + 1e-9));
            }
        }
    }
}
