//! What blocks find, which adds up to the same in any order.

use super::blocks::Block;

/// The largest distance and where it is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Largest {
    /// Metres; 0 before anything was found.
    pub metres: f64,
    /// Row, then column.
    place: [f64; 2],
}

impl Default for Largest {
    fn default() -> Self {
        Self { metres: 0.0, place: [f64::INFINITY; 2] }
    }
}

impl Largest {
    /// Takes a distance in a place (column, row). One that is no number does not count.
    #[inline]
    pub fn take(&mut self, metres: f64, [column, row]: [f64; 2]) {
        if metres >= self.metres && (metres > self.metres || [row, column] < self.place) {
            *self = Self { metres, place: [row, column] };
        }
    }

    /// Column and row; zeros if nothing was taken.
    pub fn place(&self) -> [f64; 2] {
        let [row, column] = self.place;
        if row.is_finite() { [column, row] } else { [0.0; 2] }
    }
}

/// What some blocks found.
#[derive(Clone, Debug, Default)]
pub(super) struct Found {
    pub largest: Largest,
    pub largest_at_samples: f64,
    /// Largest size of a height of the terrain.
    pub tallest: f64,
    /// Squares of the distances at samples, in units of 2^-52 m².
    squares: u128,
    pub compared: u64,
    pub samples: u64,
    pub uncovered: u64,
    /// Row and column.
    pub first_uncovered: Option<[u32; 2]>,
    pub covered_voids: u64,
    pub twice: u64,
}

/// Units of a sum of squares in a square metre.
const UNITS: f64 = (1_u64 << 52) as f64;

impl Found {
    /// What both found.
    pub fn and(mut self, other: Self) -> Self {
        let Largest { metres, place: [row, column] } = other.largest;
        self.largest.take(metres, [column, row]);
        self.largest_at_samples = self.largest_at_samples.max(other.largest_at_samples);
        self.tallest = self.tallest.max(other.tallest);
        self.squares = self.squares.saturating_add(other.squares);
        self.compared += other.compared;
        self.samples += other.samples;
        self.uncovered += other.uncovered;
        let both = [self.first_uncovered, other.first_uncovered];
        self.first_uncovered = both.into_iter().flatten().min();
        self.covered_voids += other.covered_voids;
        self.twice += other.twice;
        self
    }

    /// Mean of the squares of the distances at samples, in square metres.
    pub fn mean_square(&self) -> f64 {
        self.squares as f64 / UNITS / self.compared as f64
    }
}

/// Set on a sample that a triangle covers, its sides included.
const COVERED: u8 = 1;
/// Set on a sample inside one triangle.
const ONCE: u8 = 2;
/// Set on a sample inside several triangles.
const TWICE: u8 = 4;

/// Notes on each sample of a block.
#[derive(Default)]
pub(super) struct Marks {
    width: usize,
    notes: Vec<u8>,
    /// Largest distance at each sample; below 0 where nothing was compared.
    distance: Vec<f64>,
}

impl Marks {
    /// Removes all notes, for another block.
    pub fn clear(&mut self, block: &Block) {
        self.width = block.owned(0).count();
        let count = self.width * block.owned(1).count();
        self.notes.clear();
        self.notes.resize(count, 0);
        self.distance.clear();
        self.distance.resize(count, -1.0);
    }

    fn at(&self, block: &Block, column: i64, row: i64) -> usize {
        (row - block.first[1]) as usize * self.width + (column - block.first[0]) as usize
    }

    /// Notes that the samples of a row from one column to another, both included, are covered.
    pub fn cover(&mut self, block: &Block, row: i64, (from, to): (i64, i64)) {
        if from <= to {
            let first = self.at(block, from, row);
            self.notes[first..=first + (to - from) as usize].iter_mut().for_each(|mark| *mark |= COVERED);
        }
    }

    /// Notes that such samples lie inside a triangle.
    pub fn enter(&mut self, block: &Block, row: i64, (from, to): (i64, i64)) {
        if from <= to {
            let first = self.at(block, from, row);
            for mark in &mut self.notes[first..=first + (to - from) as usize] {
                *mark |= if *mark & ONCE == 0 { ONCE } else { TWICE };
            }
        }
    }

    /// The distances of such samples, to be raised.
    pub fn distances(&mut self, block: &Block, row: i64, (from, to): (i64, i64)) -> &mut [f64] {
        let first = self.at(block, from, row);
        &mut self.distance[first..=first + (to - from) as usize]
    }

    /// Counts what the notes say of the samples of a block.
    pub fn count(&self, block: &Block, found: &mut Found) {
        let mut all = self.notes.iter().zip(&self.distance);
        for row in block.owned(1) {
            for (column, (&mark, &distance)) in block.owned(0).zip(&mut all) {
                let height = block.ground.sample(column, row);
                let covered = mark & COVERED != 0;
                found.twice += u64::from(mark & TWICE != 0);
                if height.is_nan() {
                    found.covered_voids += u64::from(covered);
                    continue;
                }
                found.samples += 1;
                found.tallest = found.tallest.max(height.abs());
                if !covered {
                    found.uncovered += 1;
                    let here = [row as u32, column as u32];
                    found.first_uncovered = Some(found.first_uncovered.map_or(here, |first| first.min(here)));
                }
                if distance >= 0.0 {
                    found.compared += 1;
                    found.largest_at_samples = found.largest_at_samples.max(distance);
                    found.squares = found.squares.saturating_add((distance * distance * UNITS) as u128);
                }
            }
        }
    }
}
