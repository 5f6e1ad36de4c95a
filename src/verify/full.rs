//! The decoded lattice of full resolution, with fills as the specification defines them (section
//! 2).
//!
//! Fills are computed by brute force, one sample at a time, from valid samples only.

use rayon::prelude::*;

use super::range::Hull;
use super::report::{Check, Place};
use crate::container::layout::Header;
use crate::container::reader::Reader;
use crate::error::Result;
use crate::sample::{Coding, FILLED, Lattice, VALID, VOID};
use crate::tile::TileId;

/// Tiles decoded at a time.
const BATCH: usize = 64;
/// Rows whose voids are filled at a time.
pub(super) const FILL_ROWS: usize = 64;

/// Code, low and state of a sample.
pub(super) type Sample = (i32, u32, u8);

/// Samples of full resolution: those of the raster, and one more column and row if the root square
/// has room, so that every cell with a valid sample is included. All other samples are void.
pub(super) struct Full {
    /// Columns and rows of the raster.
    pub raster: (u64, u64),
    /// Intervals along a side of the root square.
    pub side: u64,
    /// Columns that are kept.
    pub columns: usize,
    /// Rows that are kept.
    pub rows: usize,
    /// The coding that turns codes into values.
    pub coding: Coding,
    code: Vec<i32>,
    low: Vec<u32>,
    state: Vec<u8>,
}

impl Full {
    /// Decodes the tiles of the finest level and fills the voids.
    pub fn decode(reader: &Reader) -> Result<Self> {
        let header = reader.header();
        let side = u64::from(header.tile()) << header.levels;
        let along = |samples: u32| (u64::from(samples).min(side) + 1) as usize;
        let (columns, rows) = (along(header.width), along(header.height));
        let count = columns * rows;
        let mut full = Self {
            raster: (header.width.into(), header.height.into()),
            side,
            columns,
            rows,
            coding: header.coding,
            code: vec![0; count],
            low: if header.coding.has_low() { vec![0; count] } else { Vec::new() },
            state: vec![VOID; count],
        };
        for ids in reader.tiles(header.levels)?.chunks(BATCH) {
            let tiles: Vec<_> = ids.par_iter().map(|&id| reader.read_tile(id)).collect();
            for (id, tile) in ids.iter().zip(tiles) {
                full.place(header.origin(*id), &*tile?);
            }
        }
        full.fill_voids();
        Ok(full)
    }

    fn place(&mut self, (left, top): (u64, u64), lattice: &Lattice) {
        let columns = (lattice.n + 1).min(self.columns - left as usize);
        let rows = (lattice.n + 1).min(self.rows - top as usize);
        for row in 0..rows {
            let from = lattice.at(0, row)..lattice.at(columns, row);
            let to = self.at(left as usize, top as usize + row);
            let to = to..to + columns;
            for ((state, code), at) in
                lattice.state[from.clone()].iter().zip(&lattice.code[from.clone()]).zip(to)
            {
                if *state == VALID {
                    (self.state[at], self.code[at]) = (VALID, *code);
                }
            }
            if !self.low.is_empty() {
                for (i, &low) in lattice.low[from].iter().enumerate() {
                    let at = self.at(left as usize + i, top as usize + row);
                    self.low[at] = low;
                }
            }
        }
    }

    fn fill_voids(&mut self) {
        for first in (0..self.rows).step_by(FILL_ROWS) {
            // Fills depend on valid samples only, so rows filled before have no effect.
            let fills: Vec<_> = (first..self.rows.min(first + FILL_ROWS))
                .into_par_iter()
                .flat_map_iter(|row| (0..self.columns).map(move |column| (column, row)))
                .filter(|&(column, row)| self.state[self.at(column, row)] != VALID)
                .filter_map(|(column, row)| {
                    Some((self.at(column, row), self.fill(column as u64, row as u64)?))
                })
                .collect();
            for (at, (code, low)) in fills {
                (self.code[at], self.state[at]) = (code, FILLED);
                if let Some(to) = self.low.get_mut(at) {
                    *to = low;
                }
            }
        }
    }

    /// Index of a sample.
    #[inline]
    pub fn at(&self, column: usize, row: usize) -> usize {
        row * self.columns + column
    }

    /// True if the sample at an index is valid.
    #[inline]
    pub fn is_valid(&self, at: usize) -> bool {
        self.state[at] == VALID
    }

    /// Code of the sample at an index.
    #[inline]
    pub fn code(&self, at: usize) -> i32 {
        self.code[at]
    }

    /// Value of the sample at an index, in value units.
    #[inline]
    pub fn value(&self, at: usize) -> f64 {
        self.coding.value(self.code[at], self.low.get(at).copied().unwrap_or(0))
    }

    /// Any sample of the root square; void beyond the columns and rows that are kept.
    pub fn sample(&self, column: u64, row: u64) -> Sample {
        if column < self.columns as u64 && row < self.rows as u64 {
            let at = self.at(column as usize, row as usize);
            return (self.code[at], self.low.get(at).copied().unwrap_or(0), self.state[at]);
        }
        self.fill(column, row).map_or((0, 0, VOID), |(code, low)| (code, low, FILLED))
    }

    /// The fill of a void sample: code and low.
    fn fill(&self, column: u64, row: u64) -> Option<(i32, u32)> {
        self.find_fill(column, row).map(|(_, code, low)| (code, low))
    }

    /// The spacing at which a void sample finds valid samples, and its fill.
    fn find_fill(&self, column: u64, row: u64) -> Option<(u64, i32, u32)> {
        // 0 is a multiple of every power of two.
        let birth = (column | row | self.side).trailing_zeros();
        (0..=birth).find_map(|log| {
            let s = 1_i64 << log;
            let mut found = Vec::new();
            for (dx, dy) in [(-s, -s), (0, -s), (s, -s), (-s, 0), (s, 0), (-s, s), (0, s), (s, s)] {
                let (x, y) = (column as i64 + dx, row as i64 + dy);
                if (0..self.raster.0 as i64).contains(&x) && (0..self.raster.1 as i64).contains(&y) {
                    let at = self.at(x as usize, y as usize);
                    if self.state[at] == VALID {
                        found.push((self.code[at], self.low.get(at).copied().unwrap_or(0)));
                    }
                }
            }
            found.sort_unstable();
            found.get(found.len().checked_sub(1)? / 2).map(|&(code, low)| (1 << log, code, low))
        })
    }

    /// Compares every sample of a tile with the one of full resolution. Returns the range of all
    /// heights that its triangles can show: fills from farther away than the tile is wide are left
    /// out, as the tile's height range need not hold them.
    pub fn compare(
        &self,
        header: &Header,
        id: TileId,
        lattice: &Lattice,
        range: (f32, f32),
        check: &mut Check,
    ) -> Hull {
        let mut hull = Hull::EMPTY;
        let spacing = u64::from(header.spacing(id.level));
        let (left, top) = header.origin(id);
        check.looked_at += lattice.state.len() as u64;
        for (at, &state) in lattice.state.iter().enumerate() {
            let (x, y) = ((at % (lattice.n + 1)) as u64, (at / (lattice.n + 1)) as u64);
            let (column, row) = (left + x * spacing, top + y * spacing);
            let expected = self.sample(column, row);
            let place = || Place::tile(id).sample(column, row);
            let got = (lattice.code[at], lattice.low_at(at));
            if (state == VALID) != (expected.2 == VALID) {
                let word = |valid| if valid { "valid" } else { "void" };
                check.fail(place(), word(expected.2 == VALID), word(state == VALID));
            } else if expected.2 != VOID {
                let what = if state == VALID { "sample" } else { "fill" };
                let same = got == (expected.0, expected.1);
                let place = || place().part(what);
                let code = format_args!("code {} at full resolution", expected.0);
                check.demand(same, place, code, format_args!("code {}", got.0));
                let metres = header.metres_of(expected.0, expected.1);
                if state != VALID && !self.is_filled_within(column, row, spacing * lattice.n as u64) {
                    continue;
                }
                hull.take(metres);
                let inside = f64::from(range.0) <= metres && metres <= f64::from(range.1);
                let range = format_args!("{} to {}", range.0, range.1);
                check.demand(inside, place, format_args!("a height range that holds {metres}"), range);
            }
        }
        hull
    }

    /// True if the fill of a void sample comes from a distance of at most `reach`.
    fn is_filled_within(&self, column: u64, row: u64, reach: u64) -> bool {
        // No fill comes from farther away than the spacing at which the sample first appears.
        let birth = (column | row | self.side).trailing_zeros();
        1 << birth <= reach || self.find_fill(column, row).is_some_and(|fill| fill.0 <= reach)
    }
}

#[cfg(test)]
impl std::fmt::Debug for Full {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{:?} in {}:", self.raster, self.side)?;
        for row in 0..self.raster.1 as usize {
            for at in self.at(0, row)..self.at(self.raster.0 as usize, row) {
                let code = format!("{:6}", self.code[at]);
                f.write_str(if self.state[at] == VALID { &code } else { "     ." })?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

#[cfg(test)]
impl Full {
    /// A lattice of integer codes, row by row; `None` is void. `side` is a power of two, at least
    /// the larger size less 1.
    pub fn of_codes(codes: &[Option<i32>], columns: usize, side: u64) -> Self {
        let raster = (columns as u64, (codes.len() / columns) as u64);
        let along = |samples: u64| (samples.min(side) + 1) as usize;
        let count = along(raster.0) * along(raster.1);
        let mut full = Self {
            raster,
            side,
            columns: along(raster.0),
            rows: along(raster.1),
            coding: Coding::Integer { scale: 1.0, offset: 0.0 },
            code: vec![0; count],
            low: Vec::new(),
            state: vec![VOID; count],
        };
        for (i, code) in codes.iter().enumerate() {
            if let Some(code) = code {
                let at = full.at(i % columns, i / columns);
                (full.code[at], full.state[at]) = (*code, VALID);
            }
        }
        full.fill_voids();
        full
    }
}
