//! The order of newborn samples: the rows of C, H and V, stage by stage (`format-spec.md`, section
//! 7).
//!
//! A stage refines a lattice of `m` intervals to one of `2 m`. Here `m` is 2:
//!
//! ```text
//! P  H  P  H  P     P  the parents, (m + 1)^2, known before
//! V  C  V  C  V     C  first: the centres of the old cells, m rows of m
//! P  H  P  H  P     H  then: the middles of their northern and southern sides, m + 1 rows of m
//! V  C  V  C  V     V  last: the middles of their western and eastern sides, m rows of m + 1
//! P  H  P  H  P
//! ```
//!
//! A tile below the root has one stage, whose parents are samples of its parent tile. The root has
//! all stages, from its four corners on.

use std::ops::Range;

use crate::simd::{self, Kernel};

/// A row of evenly spaced samples of a lattice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Row {
    /// Index of the first sample.
    pub first: usize,
    /// Difference between the indices of two neighbours.
    pub step: usize,
    /// How many samples it has.
    pub count: usize,
}

impl Row {
    /// Indices of the row's samples.
    pub fn indices(self) -> impl Iterator<Item = usize> {
        (0..self.count).map(move |a| self.first + a * self.step)
    }

    /// The row's samples of `plane`, a plane of the lattice.
    pub fn of<T>(self, plane: &[T]) -> impl Iterator<Item = &T> {
        plane[self.first..].iter().step_by(self.step).take(self.count)
    }

    /// The row's samples of `plane`, to be changed.
    pub fn of_mut<T>(self, plane: &mut [T]) -> impl Iterator<Item = &mut T> {
        plane[self.first..].iter_mut().step_by(self.step).take(self.count)
    }

    /// One more than the index of the last sample.
    pub fn end(self) -> usize {
        self.first + (self.count - 1) * self.step + 1
    }

    /// Appends the row's samples of `plane`. For rows of every second sample it is faster than
    /// [`Row::of`].
    pub fn gather(self, plane: &[i32], out: &mut Vec<i32>) {
        if self.step == 2 {
            let (pairs, last) = plane[self.first..self.end()].as_chunks::<2>();
            out.extend(pairs.iter().map(|pair| pair[0]));
            out.extend_from_slice(last);
        } else {
            out.extend(self.of(plane));
        }
    }

    /// [`Row::gather`] of states: bytes need a kernel of their own to be fast.
    pub fn gather_states(self, state: &[u8], out: &mut Vec<u8>) {
        if self.step == 2 {
            let (pairs, last) = state[self.first..self.end()].as_chunks::<2>();
            let start = out.len();
            out.resize(start + pairs.len(), 0);
            simd::run(Firsts { pairs, out: &mut out[start..] });
            out.extend(last.first());
        } else {
            out.extend(self.of(state));
        }
    }

    /// Sets the row's samples of `plane` to `samples`; as fast as [`Row::gather`].
    pub fn scatter<T: Copy>(self, samples: &[T], plane: &mut [T]) {
        if self.step == 2 {
            let mut pairs = plane[self.first..self.end()].chunks_exact_mut(2);
            for (pair, &sample) in (&mut pairs).zip(samples) {
                pair[0] = sample;
            }
            if let ([place], Some(&last)) = (pairs.into_remainder(), samples.last()) {
                *place = last;
            }
        } else {
            self.of_mut(plane).zip(samples).for_each(|(place, &sample)| *place = sample);
        }
    }
}

/// Kernel: the first of each pair.
struct Firsts<'a> {
    pairs: &'a [[u8; 2]],
    out: &'a mut [u8],
}

impl Kernel for Firsts<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let (pairs, out) = (&self.pairs[..self.out.len()], self.out);
        for i in 0..out.len() {
            out[i] = pairs[i][0];
        }
    }
}

/// A refinement of a lattice of `m` intervals to one of `2 m`. Both are samples of a lattice of `n`
/// intervals, the whole lattice.
#[derive(Clone, Copy, Debug)]
pub struct Stage {
    /// Intervals on a side before the refinement.
    pub m: usize,
    /// Intervals on a side of the whole lattice.
    n: usize,
    /// Intervals of the whole lattice between samples after the refinement.
    half: usize,
}

impl Stage {
    /// Row `b` of `m + 1` of the parents.
    pub fn parents(self, b: usize) -> Row {
        self.row(0, 2 * b, self.m + 1)
    }

    /// Row `b` of `m` of C, the centres.
    pub fn centres(self, b: usize) -> Row {
        self.row(1, 2 * b + 1, self.m)
    }

    /// Row `b` of `m + 1` of H, the newborn samples on even rows.
    pub fn horizontals(self, b: usize) -> Row {
        self.row(1, 2 * b, self.m)
    }

    /// Row `b` of `m` of V, the newborn samples on even columns.
    pub fn verticals(self, b: usize) -> Row {
        self.row(0, 2 * b + 1, self.m + 1)
    }

    /// How many newborn samples the stage has.
    pub fn newborn_count(self) -> usize {
        self.m * self.m + 2 * self.m * (self.m + 1)
    }

    /// Intervals on a side of the whole lattice.
    pub fn intervals(self) -> usize {
        self.n
    }

    /// Intervals of the whole lattice between samples after the refinement.
    pub fn half(self) -> usize {
        self.half
    }

    /// Indices of the eight samples of the refined lattice around the one in column `x`, row `y` of
    /// the whole lattice. For a place outside the lattice it is the index of the sample itself.
    pub fn around(self, (x, y): (usize, usize)) -> [usize; 8] {
        let (width, half) = (self.n + 1, self.half);
        let at = y * width + x;
        let west = if x >= half { half } else { 0 };
        let east = if x + half <= self.n { half } else { 0 };
        let north = if y >= half { half * width } else { 0 };
        let south = if y + half <= self.n { half * width } else { 0 };
        let corner = |row: usize, column: usize, place: usize| if row > 0 && column > 0 { place } else { at };
        [
            corner(north, west, at - north - west),
            at - north,
            corner(north, east, at - north + east),
            at - west,
            at + east,
            corner(south, west, at + south - west),
            at + south,
            corner(south, east, at + south + east),
        ]
    }

    /// Every second sample from column `x`, row `y` of the refined lattice on.
    fn row(self, x: usize, y: usize, count: usize) -> Row {
        Row { first: (y * (self.n + 1) + x) * self.half, step: 2 * self.half, count }
    }

    /// What has to be known and predicted for the samples of `rows` of the refined lattice (not
    /// empty).
    pub fn needed(self, rows: &Range<usize>) -> Needed {
        let m = self.m;
        let horizontals = rows.start.div_ceil(2)..rows.end.div_ceil(2);
        let verticals = rows.start / 2..rows.end / 2;
        // V between two rows of parents is predicted from the centres beside it and in the rows
        // above and below; C from two rows of parents to each side. What lies outside the lattice
        // continues its last two rows, which are among these.
        let centres = verticals.start.saturating_sub(1)..(verticals.end + 1).min(m);
        let parents = centres.start.saturating_sub(1)..(centres.end + 2).min(m + 1);
        Needed { parents, centres, horizontals, verticals }
    }

    /// The rows of the stage's newborn samples, in order.
    pub fn newborn(self) -> impl Iterator<Item = Row> {
        let centres = (0..self.m).map(move |b| self.centres(b));
        let horizontals = (0..=self.m).map(move |b| self.horizontals(b));
        let verticals = (0..self.m).map(move |b| self.verticals(b));
        centres.chain(horizontals).chain(verticals)
    }
}

/// Numbers of the rows of a [`Stage`] that some rows of its lattice need.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Needed {
    /// Rows of the parents.
    pub parents: Range<usize>,
    /// Rows of C.
    pub centres: Range<usize>,
    /// Rows of H.
    pub horizontals: Range<usize>,
    /// Rows of V.
    pub verticals: Range<usize>,
}

/// The stages of a tile of `n` intervals (a power of two, at least 2): all for the root, the last
/// one for others.
pub fn stages(n: usize, root: bool) -> impl Iterator<Item = Stage> {
    let last = n.trailing_zeros().max(1) - 1;
    let first = if root { 0 } else { last };
    (first..=last).map(move |t| Stage { m: 1 << t, n, half: n >> (t + 1) })
}

/// The corners of the root, coded before its stages; none for other tiles.
pub fn corners(n: usize, root: bool) -> impl Iterator<Item = Row> {
    [0, n * (n + 1)].into_iter().map(move |first| Row { first, step: n, count: 2 }).filter(move |_| root)
}

/// The rows of all newborn samples of a tile, in order.
pub fn newborn(n: usize, root: bool) -> impl Iterator<Item = Row> {
    corners(n, root).chain(stages(n, root).flat_map(Stage::newborn))
}

/// How many newborn samples a tile has.
pub fn newborn_count(n: usize, root: bool) -> usize {
    if root { (n + 1) * (n + 1) } else { (n + 1) * (n + 1) - (n / 2 + 1) * (n / 2 + 1) }
}

/// Places in the order of newborn samples where the last stage changes from one plane to the next:
/// after C, after H and after V.
pub fn cuts(n: usize, root: bool) -> [usize; 3] {
    let (end, edges) = (newborn_count(n, root), n / 2 * (n / 2 + 1));
    [end - 2 * edges, end - edges, end]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_newborn_sample_comes_once() {
        for n in [2, 4, 16, 64] {
            for root in [false, true] {
                let mut seen = vec![0; (n + 1) * (n + 1)];
                for row in newborn(n, root) {
                    row.of_mut(&mut seen).for_each(|count| *count += 1);
                }
                assert_eq!(seen.iter().sum::<usize>(), newborn_count(n, root));
                for (index, &count) in seen.iter().enumerate() {
                    let even = index % (n + 1) % 2 == 0 && index / (n + 1) % 2 == 0;
                    assert_eq!(count, usize::from(root || !even), "sample {index} of {n}");
                }
            }
        }
    }

    #[test]
    fn the_first_rows_are_those_of_the_specification() {
        let rows: Vec<_> = newborn(4, true).take(7).collect();
        let row = |first, step, count| Row { first, step, count };
        // Corners, then C, H, V of the 2 x 2 lattice of corners: centre (2, 2), then (2, 0), (2,
        // 4), (0, 2), (4, 2).
        assert_eq!(rows[..2], [row(0, 4, 2), row(20, 4, 2)]);
        assert_eq!(rows[2..6], [row(12, 4, 1), row(2, 4, 1), row(22, 4, 1), row(10, 4, 2)]);
        // First centre of the last stage.
        assert_eq!(rows[6], row(6, 2, 2));
    }
}
