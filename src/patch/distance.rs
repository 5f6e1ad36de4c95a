//! Nearest feature of every cell of a tile: an exact Euclidean feature transform with metres of their own per column and row.
//!
//! Features stand on the *half lattice*: point (X, Y), `0 <= X, Y <= 2n`, lies X / 2 columns and Y / 2 rows from the
//! north-west, so (odd, odd) is the centre of a cell and (even, even) a sample. The nearest one is found for the centre
//! of each of the `n x n` cells, in time that does not depend on how many features there are (Meijster; Felzenszwalb
//! and Huttenlocher). A tie, or rounding at a tie, may give either: what it gives is always a feature.
//!
//! Most half columns are nowhere the nearest in a row, for two near them are nearer everywhere. Those are found by
//! integers, many at a time, before the envelope of the others is made one by one.

use crate::geo::Spacing;
use crate::simd::{self, Kernel};

/// Row of the nearest feature north of a point if there is none.
const NONE_NORTH: i16 = -16_384;
/// Row of the nearest feature south of a point if there is none.
const NONE_SOUTH: i16 = 20_000;
/// Half rows that no feature of a tile is away: above them there is none.
const FAR: i16 = 10_000;
/// Squared half rows of a half column without a feature.
const NOWHERE: i32 = 1 << 28;
/// A half column is compared with the two that are so far to its west and east.
const REACHES: [usize; 3] = [1, 2, 4];
/// The farthest of them.
const MARGIN: usize = 4;

/// From so many half columns on, the envelope of the row before is too fine to be of use.
const MOST_CHORDS: usize = 96;
/// Squared half columns by which a point must be above a chord: more than rounding may do.
const CHORD_MARGIN: f64 = 0.01;

/// A point of the half lattice: column, row.
pub type HalfPoint = [i16; 2];

/// The transform of one tile.
#[derive(Clone, Debug, Default)]
pub struct Nearest {
    n: usize,
    /// `(2n + 1)^2`, 1 at features.
    mask: Vec<u8>,
    /// For each row of cells and each half column, the half row of the nearest feature of that half column.
    columns: Vec<i16>,
    /// For each cell, the half column of the nearest feature.
    near_x: Vec<i16>,
    /// For each cell, its half row.
    near_y: Vec<i16>,
    buffers: Buffers,
}

/// Room to work in.
#[derive(Clone, Debug, Default)]
struct Buffers {
    /// For each half column, the last feature met.
    seen: Vec<i16>,
    /// Squared half rows to the nearest feature of each half column, between [`MARGIN`]s.
    squared: Vec<i32>,
    /// 1 for each half column that may be nearest somewhere, in whole groups of eight.
    keep: Vec<u8>,
    /// Half columns whose features are nearest somewhere in the last row, from west to east.
    envelope: Vec<Parabola>,
    /// How many they are; 0 before the first row.
    count: usize,
}

/// Squared distance from the points of a row of cells to the feature of one half column.
#[derive(Clone, Copy, Debug, Default)]
struct Parabola {
    /// Half column.
    x: i32,
    /// Half column from which on it is the lowest.
    from: f64,
    /// Its least value.
    height: f64,
}

impl Nearest {
    /// Starts a tile of `n` intervals, at most 2 048. Its marks are not defined: write all rows.
    pub fn start(&mut self, n: usize) {
        debug_assert!(n <= 2048, "half rows must stay below FAR");
        self.n = n;
        self.mask.resize((2 * n + 1) * (2 * n + 1), 0);
        self.near_x.clear();
        self.near_y.clear();
    }

    /// Marks of half row `row`, one a half column: write 1 at features, 0 elsewhere.
    #[inline(always)]
    pub fn row_mut(&mut self, row: usize) -> &mut [u8] {
        let width = 2 * self.n + 1;
        &mut self.mask[row * width..(row + 1) * width]
    }

    /// Finds the nearest feature of every cell; false if there is no feature at all.
    ///
    /// `spacing` is that of the lattice, finite and positive.
    pub fn solve(&mut self, spacing: Spacing) -> bool {
        let ratio = (spacing.dy / spacing.dx) * (spacing.dy / spacing.dx);
        simd::run(Solve { nearest: self, ratio })
    }

    /// Nearest feature of cell `(x, y)`; `None` if the tile has none.
    #[inline(always)]
    pub fn at(&self, x: usize, y: usize) -> Option<HalfPoint> {
        let cell = y * self.n + x;
        Some([*self.near_x.get(cell)?, *self.near_y.get(cell)?])
    }

    /// Half columns and half rows of the nearest features of row `row` of the cells; `None` if the tile has none.
    #[inline(always)]
    pub fn row(&self, row: usize) -> Option<(&[i16], &[i16])> {
        let cells = row * self.n..(row + 1) * self.n;
        Some((self.near_x.get(cells.clone())?, self.near_y.get(cells)?))
    }

    /// Along each half column, from every row of cell centres: first what lies north, then what lies south. Gives the
    /// half columns between which all features are.
    #[inline(always)]
    fn solve_columns(&mut self) -> (usize, usize) {
        let (n, width) = (self.n, 2 * self.n + 1);
        // All of it is overwritten.
        self.columns.resize(n * width, 0);
        let seen = &mut self.buffers.seen;
        seen.clear();
        seen.resize(width, NONE_NORTH);
        for row in 0..n {
            for y in [2 * row, 2 * row + 1] {
                note(seen, &self.mask[y * width..(y + 1) * width], y as i16);
            }
            self.columns[row * width..(row + 1) * width].copy_from_slice(seen);
        }
        seen.fill(NONE_SOUTH);
        for row in (0..n).rev() {
            for y in [2 * row + 2, 2 * row + 1] {
                note(seen, &self.mask[y * width..(y + 1) * width], y as i16);
            }
            join(&mut self.columns[row * width..(row + 1) * width], seen, 2 * row as i16 + 1);
        }
        // A half column with a feature has a nearest one in every row.
        let first_row = &self.columns[..width.min(self.columns.len())];
        let has_feature = |nearest: &i16| (nearest - 1).abs() < FAR;
        let first = first_row.iter().position(has_feature).unwrap_or(width);
        (first, first_row.iter().rposition(has_feature).map_or(first, |last| last + 1))
    }

    /// Along one row of cells: the lower envelope of the parabolas of the half columns `first..end`.
    #[inline(always)]
    fn solve_row(
        &mut self,
        row: usize,
        (first, end): (usize, usize),
        limits: [i32; REACHES.len()],
        ratio: f64,
    ) {
        let (n, width) = (self.n, 2 * self.n + 1);
        let nearest = &self.columns[row * width..(row + 1) * width];
        let buffers = &mut self.buffers;
        buffers.measure(&nearest[first..end], 2 * row as i16 + 1);
        if limits[0] < i32::MAX && (2..MOST_CHORDS).contains(&buffers.count) {
            buffers.prune_by_chords(first, ratio);
        } else {
            buffers.prune(end - first, limits);
        }
        let count = buffers.wrap(first, ratio);
        let (xs, ys) = (&mut self.near_x[row * n..(row + 1) * n], &mut self.near_y[row * n..(row + 1) * n]);
        let mut cell = 0;
        let envelope = &buffers.envelope[..count];
        for i in 0..envelope.len() {
            let stop = if i + 1 < envelope.len() { first_cell(envelope[i + 1].from, n).max(cell) } else { n };
            let x = envelope[i].x;
            let y = nearest[x as usize];
            // Not `fill`: a call of it costs more than most of these runs.
            let (run_x, run_y) = (&mut xs[cell..stop], &mut ys[cell..stop]);
            for i in 0..run_x.len() {
                run_x[i] = x as i16;
                run_y[i] = y;
            }
            cell = stop;
        }
    }
}

impl Buffers {
    /// Squared half rows from half row `here` to what is nearest in each half column.
    #[inline(always)]
    fn measure(&mut self, nearest: &[i16], here: i16) {
        self.squared.clear();
        self.squared.resize(nearest.len() + 2 * MARGIN, NOWHERE);
        let squared = &mut self.squared[MARGIN..MARGIN + nearest.len()];
        for x in 0..nearest.len() {
            let rows = i32::from(nearest[x]) - i32::from(here);
            squared[x] = if rows.abs() < i32::from(FAR) { rows * rows } else { NOWHERE };
        }
    }

    /// Finds the half columns, of `count`, that may be nearest somewhere. Half column X is not if one as far to its west
    /// as another to its east are nearer everywhere, one or the other: if twice its square exceeds the sum of theirs by
    /// a limit.
    #[inline(always)]
    fn prune(&mut self, count: usize, limits: [i32; REACHES.len()]) {
        self.keep.clear();
        self.keep.resize(count.next_multiple_of(8), 0);
        let all = &self.squared[..count + 2 * MARGIN];
        let here = &all[MARGIN..MARGIN + count];
        let (west, east) = (&all[MARGIN - REACHES[0]..][..count], &all[MARGIN + REACHES[0]..][..count]);
        let (wwest, eeast) = (&all[MARGIN - REACHES[1]..][..count], &all[MARGIN + REACHES[1]..][..count]);
        let (far_w, far_e) = (&all[MARGIN - REACHES[2]..][..count], &all[MARGIN + REACHES[2]..][..count]);
        let keep = &mut self.keep[..count];
        for i in 0..count {
            let twice = 2 * here[i];
            let kept = u8::from(twice - west[i] - east[i] < limits[0])
                & u8::from(twice - wwest[i] - eeast[i] < limits[1])
                & u8::from(twice - far_w[i] - far_e[i] < limits[2]);
            keep[i] = kept & u8::from(here[i] != NOWHERE);
        }
    }

    /// The same by the envelope of the row before: it differs little. A half column is nowhere the nearest if it is
    /// higher than the two of that envelope to its west and east where those two cross; and it is if its point (X, X^2 +
    /// height) is above the chord of theirs.
    #[inline(always)]
    fn prune_by_chords(&mut self, first: usize, ratio: f64) {
        let chords = &self.envelope[..self.count];
        for i in 1..chords.len() {
            let (a, b) = (chords[i - 1].x as usize - first, chords[i].x as usize - first);
            let squared = &self.squared[MARGIN + a..][..=b - a];
            let keep = &mut self.keep[a..][..=b - a];
            // Half columns from the western one on.
            let point = |x: usize| (x * x) as f64 + f64::from(squared[x]) * ratio;
            let (west, slope) = (point(0), (point(b - a) - point(0)) / (b - a) as f64);
            for x in 0..=b - a {
                let below = point(x) <= west + slope * x as f64 + CHORD_MARGIN;
                keep[x] = u8::from(below) & u8::from(squared[x] != NOWHERE);
            }
        }
    }

    /// Makes the envelope of the half columns that are kept, of which the first is half column `first`; gives how many
    /// there are.
    #[inline(always)]
    fn wrap(&mut self, first: usize, ratio: f64) -> usize {
        self.envelope.resize(self.keep.len(), Parabola::default());
        let (envelope, mut count) = (&mut self.envelope[..], 0);
        for (group, keep) in (0..).zip(self.keep.as_chunks::<8>().0) {
            let mut bits = u64::from_le_bytes(*keep);
            while bits != 0 {
                let i = 8 * group + bits.trailing_zeros() as usize / 8;
                bits &= bits - 1;
                let height = f64::from(self.squared[i + MARGIN]) * ratio;
                count = push(envelope, count, (first + i) as i32, height);
            }
        }
        self.count = count;
        count
    }
}

/// Adds a half column to the envelope, of which `count` are there; gives how many there are then.
#[inline(always)]
fn push(envelope: &mut [Parabola], mut count: usize, x: i32, height: f64) -> usize {
    let mut from = f64::NEG_INFINITY;
    while count > 0 {
        let before = envelope[count - 1];
        // Where the two parabolas cross.
        let cross = 0.5 * ((height - before.height) / f64::from(x - before.x) + f64::from(x + before.x));
        if cross > before.from {
            from = cross;
            break;
        }
        count -= 1;
    }
    envelope[count] = Parabola { x, from, height };
    count + 1
}

/// The first of `n` cells whose centre is not west of half column `from`.
#[inline(always)]
fn first_cell(from: f64, n: usize) -> usize {
    // Rounded up. The centre of cell c is half column 2 c + 1.
    let whole = from as i32;
    let column = whole.saturating_add(i32::from(from > f64::from(whole)));
    (column.max(0) as usize / 2).min(n)
}

/// By how much twice the square of a half column must exceed the sum of two others' for the column to be out of the
/// question: twice the square of their distance in units of squared half rows, and a little for what rounding may do.
fn limits(ratio: f64) -> [i32; REACHES.len()] {
    REACHES.map(|reach| {
        // Beyond that, rounding may do more.
        if (1e-3..=1e3).contains(&ratio) {
            ((2 * reach * reach) as f64 / ratio + 0.1 / ratio) as i32 + 1
        } else {
            i32::MAX
        }
    })
}

/// The transform, as a kernel; gives what [`Nearest::solve`] gives.
struct Solve<'a> {
    nearest: &'a mut Nearest,
    ratio: f64,
}

impl Kernel for Solve<'_> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let Self { nearest, ratio } = self;
        let between = nearest.solve_columns();
        if between.0 >= between.1 {
            return false;
        }
        let n = nearest.n;
        nearest.near_x.resize(n * n, 0);
        nearest.near_y.resize(n * n, 0);
        let limits = limits(ratio);
        nearest.buffers.count = 0;
        for row in 0..n {
            nearest.solve_row(row, between, limits, ratio);
        }
        true
    }
}

/// Sets `seen` to `row` where there is a mark.
#[inline(always)]
fn note(seen: &mut [i16], marks: &[u8], row: i16) {
    let marks = &marks[..seen.len()];
    for x in 0..seen.len() {
        // Masks, not a choice: a choice would become a jump for every sample.
        let mask = -i16::from(marks[x]);
        seen[x] = seen[x] & !mask | row & mask;
    }
}

/// Replaces the nearest row to the north by the one to the south where that is nearer to row `here`.
#[inline(always)]
fn join(north: &mut [i16], south: &[i16], here: i16) {
    let south = &south[..north.len()];
    for x in 0..north.len() {
        let mask = -i16::from(south[x] - here < here - north[x]);
        north[x] = north[x] & !mask | south[x] & mask;
    }
}

#[cfg(test)]
mod tests;
