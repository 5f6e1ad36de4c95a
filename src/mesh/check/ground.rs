//! The surface of full resolution in a part of the terrain: heights along its edges and in its
//! triangles, and where it is shown.

use super::blocks::Slab;
use super::heights::Heights;
use crate::error::{Error, Result};

/// Least validity that is shown. The little below a half is for rounding at the outline, where a
/// height may be taken from either side.
const SHOWN: f64 = 0.5 - 1e-12;

/// Column and row of a sample.
pub(super) type Sample = [i64; 2];

/// The samples of a slab and one more around it, as far as there are any.
pub(super) struct Ground {
    first: Sample,
    width: usize,
    /// Heights of valid samples and of void ones beside them; NaN for other void samples.
    height: Vec<f64>,
    /// True at valid samples; empty if all are.
    valid: Vec<bool>,
}

impl Ground {
    /// Reads the samples of a slab.
    pub fn read(heights: &dyn Heights, slab: &Slab) -> Result<Self> {
        let [width, height] = heights.size();
        let around = |range: &std::ops::Range<u32>, size: u32| {
            range.start.saturating_sub(1)..(range.end.saturating_add(1)).min(size)
        };
        let (columns, rows) = (around(&slab.samples.columns, width), around(&slab.samples.rows, height));
        let (first, width, count) = ([columns.start.into(), rows.start.into()], columns.len(), rows.len());
        let mut height = heights.window(columns, rows)?;
        if width.checked_mul(count) != Some(height.len()) {
            return Err(Error::internal("a window of heights has another size"));
        }
        let mut valid = Vec::new();
        if height.iter().any(|height| !height.is_finite()) {
            valid = height.iter().map(|height| height.is_finite()).collect();
            fill(&mut height, &valid, width, heights.falls());
        }
        Ok(Self { first, width, height, valid })
    }

    #[inline]
    fn at(&self, [column, row]: Sample) -> usize {
        (row - self.first[1]) as usize * self.width + (column - self.first[0]) as usize
    }

    /// Height of a sample; NaN if it is void.
    pub fn sample(&self, column: i64, row: i64) -> f64 {
        let at = self.at([column, row]);
        if self.is_valid(at) { self.value(at) } else { f64::NAN }
    }

    /// Heights of samples of a row, with those of void ones beside valid ones; and which are valid,
    /// if not all are.
    pub fn row(&self, row: i64, (from, to): (i64, i64)) -> (&[f64], Option<&[bool]>) {
        let (first, end) = (self.at([from, row]), self.at([to, row]) + 1);
        (&self.height[first..end], self.valid.get(first..end))
    }

    #[inline]
    fn is_valid(&self, at: usize) -> bool {
        self.valid.is_empty() || self.valid.get(at).is_some_and(|&valid| valid)
    }

    #[inline]
    fn value(&self, at: usize) -> f64 {
        self.height.get(at).copied().unwrap_or(f64::NAN)
    }

    /// True if one of two samples is valid and the other void.
    pub fn differ(&self, a: Sample, b: Sample) -> bool {
        self.is_valid(self.at(a)) != self.is_valid(self.at(b))
    }

    /// True if some sample of a rectangle, its sides included, is void.
    pub fn has_void(&self, [first, last]: [Sample; 2]) -> bool {
        !self.valid.is_empty()
            && (first[1]..=last[1])
                .any(|row| self.row(row, (first[0], last[0])).1.is_some_and(|row| row.contains(&false)))
    }

    /// Height between two samples that an edge joins, `t` of the way from the first to the second;
    /// NaN where the edge is hidden.
    #[inline]
    pub fn edge(&self, a: Sample, b: Sample, t: f64) -> f64 {
        let a = self.at(a);
        if t == 0.0 {
            return if self.is_valid(a) { self.value(a) } else { f64::NAN };
        }
        let b = self.at(b);
        let height = self.value(a) + t * (self.value(b) - self.value(a));
        if self.valid.is_empty() {
            return height;
        }
        let validity = match (self.is_valid(a), self.is_valid(b)) {
            (true, true) => 1.0,
            (true, false) => 1.0 - t,
            (false, true) => t,
            (false, false) => 0.0,
        };
        if validity >= SHOWN { height } else { f64::NAN }
    }

    /// Height at a place; NaN where the surface is hidden. The triangle is that of the cell in
    /// which another place lies.
    pub fn height(&self, facet: &Facet, place: [f64; 2]) -> f64 {
        let (validity, height) = self.both(facet, place);
        if validity >= SHOWN { height } else { f64::NAN }
    }

    /// Validity and height of the plane of a triangle at a place.
    pub fn both(&self, facet: &Facet, place: [f64; 2]) -> (f64, f64) {
        let (mut validity, mut height) = (0.0, 0.0);
        for (sample, weight) in facet.weights(place) {
            // A corner without weight may have no height.
            if weight != 0.0 {
                let at = self.at(sample);
                validity += if self.is_valid(at) { weight } else { 0.0 };
                height += weight * self.value(at);
            }
        }
        (validity, height)
    }
}

/// Gives void samples beside valid ones the lower median of these (the upper one if heights fall
/// while numbers rise).
fn fill(height: &mut [f64], valid: &[bool], width: usize, falls: bool) {
    let rows = height.len() / width.max(1);
    let mut fills = Vec::new();
    for at in (0..height.len()).filter(|&at| !valid[at]) {
        let (column, row) = (at % width, at / width);
        let mut near: Vec<f64> = Vec::with_capacity(8);
        for y in row.saturating_sub(1)..(row + 2).min(rows) {
            for x in column.saturating_sub(1)..(column + 2).min(width) {
                near.extend(valid[y * width + x].then(|| height[y * width + x]));
            }
        }
        near.sort_unstable_by(f64::total_cmp);
        let middle = if falls { near.len() / 2 } else { near.len().saturating_sub(1) / 2 };
        fills.push((at, near.get(middle).copied().unwrap_or(f64::NAN)));
    }
    for (at, value) in fills {
        height[at] = value;
    }
}

/// A triangle of the surface.
pub(super) struct Facet {
    /// North-west corner of its cell.
    cell: Sample,
    /// True if the cell is cut from north-west to south-east.
    is_falling: bool,
    /// True for the triangle to the north of the cut.
    is_north: bool,
}

impl Facet {
    /// The triangle of a cell in which a place lies.
    pub fn new(cell: Sample, place: [f64; 2]) -> Self {
        let (x, y) = (place[0] - cell[0] as f64, place[1] - cell[1] as f64);
        let is_falling = (cell[0] + cell[1]) % 2 == 0;
        Self { cell, is_falling, is_north: if is_falling { x >= y } else { x + y <= 1.0 } }
    }

    /// Its corners, each with its weight at a place.
    fn weights(&self, place: [f64; 2]) -> [(Sample, f64); 3] {
        let [column, row] = self.cell;
        let (x, y) = (place[0] - column as f64, place[1] - row as f64);
        let (north_west, north_east) = ([column, row], [column + 1, row]);
        let (south_west, south_east) = ([column, row + 1], [column + 1, row + 1]);
        match (self.is_falling, self.is_north) {
            (true, true) => [(north_west, 1.0 - x), (north_east, x - y), (south_east, y)],
            (true, false) => [(north_west, 1.0 - y), (south_west, y - x), (south_east, x)],
            (false, true) => [(north_west, 1.0 - x - y), (north_east, x), (south_west, y)],
            (false, false) => [(north_east, 1.0 - y), (south_west, 1.0 - x), (south_east, x + y - 1.0)],
        }
    }
}
