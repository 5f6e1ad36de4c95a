//! Blocks of samples, the triangles over each, and the slabs in which they are read.

use std::ops::{Range, RangeInclusive};

use super::Mesh;
use super::ground::{Ground, Sample};
use super::shape::Kind;
use crate::error::{Error, Result};
use crate::rect::Rect;

/// Entries in the lists of triangles beyond four for each triangle, at most: enough for some
/// hundreds of triangles that lie over all blocks of a large raster.
const MORE_ENTRIES: u64 = 1 << 24;

/// A window in blocks of so many intervals.
pub(super) struct Grid {
    window: Rect,
    block: u32,
    /// Blocks, across and down.
    count: [usize; 2],
    near: f64,
}

/// Blocks of one row of them, and their samples.
pub(super) struct Slab {
    /// Numbers of the blocks.
    pub blocks: Range<usize>,
    /// Samples, those on the far sides included.
    pub samples: Rect,
}

/// The triangles of each block.
pub(super) struct Lists {
    /// Where the list of each block begins, and the end of the last.
    first: Vec<usize>,
    triangles: Vec<u32>,
}

impl Lists {
    /// The triangles of a block.
    pub fn of(&self, block: usize) -> &[u32] {
        &self.triangles[self.first[block]..self.first[block + 1]]
    }
}

impl Grid {
    pub fn new(window: Rect, block: u32, near: f64) -> Self {
        let block = block.max(1);
        let count =
            |range: &Range<u32>| (range.end - range.start).saturating_sub(1).div_ceil(block).max(1) as usize;
        let count = [count(&window.columns), count(&window.rows)];
        Self { window, block, count, near }
    }

    fn range(&self, axis: usize) -> &Range<u32> {
        if axis == 0 { &self.window.columns } else { &self.window.rows }
    }

    /// The blocks with samples that are at most `near` away from a triangle, across and down.
    fn under(&self, corners: &[[f64; 3]; 3]) -> [Range<usize>; 2] {
        [0, 1].map(|axis| {
            let of = corners.map(|corner| corner[axis]);
            let least = of.into_iter().fold(f64::INFINITY, f64::min) - self.near;
            let most = of.into_iter().fold(f64::NEG_INFINITY, f64::max) + self.near;
            let range = self.range(axis);
            if most < f64::from(range.start) || least > f64::from(range.end - 1) {
                return 0..0;
            }
            // Casts stop at the ends.
            let block = |v: f64| {
                (((v - f64::from(range.start)) / f64::from(self.block)).floor() as usize)
                    .min(self.count[axis] - 1)
            };
            block(least)..block(most) + 1
        })
    }

    /// Puts each triangle that faces up into the lists of the blocks that it lies over.
    pub fn lists(&self, mesh: &Mesh) -> Result<Lists> {
        let blocks = self.count[0] * self.count[1];
        let up = |triangle: &usize| mesh.kinds[*triangle] == Kind::Up;
        let all = || {
            (0..mesh.triangles.len())
                .filter(up)
                .map(|triangle| (triangle, self.under(&mesh.corners(triangle))))
        };
        let mut first = vec![0_usize; blocks + 1];
        let (mut entries, most) = (0_u64, 4 * mesh.triangles.len() as u64 + MORE_ENTRIES);
        for (_, [across, down]) in all() {
            entries += across.len() as u64 * down.len() as u64;
            if entries > most {
                let what = "the number of pieces of triangles, block by block,";
                return Err(Error::limit(what, entries, most));
            }
            for y in down {
                across.clone().for_each(|x| first[y * self.count[0] + x + 1] += 1);
            }
        }
        for block in 0..blocks {
            first[block + 1] += first[block];
        }
        let mut next = first.clone();
        let mut triangles = vec![0_u32; first[blocks]];
        for (triangle, [across, down]) in all() {
            for y in down {
                for x in across.clone() {
                    let place = &mut next[y * self.count[0] + x];
                    triangles[*place] = triangle as u32;
                    *place += 1;
                }
            }
        }
        Ok(Lists { first, triangles })
    }

    /// First and last sample of a block along an axis; neighbours share them.
    fn side(&self, axis: usize, number: usize) -> [u32; 2] {
        let range = self.range(axis);
        let first = u64::from(range.start) + number as u64 * u64::from(self.block);
        [first as u32, (first + u64::from(self.block)).min(u64::from(range.end) - 1) as u32]
    }

    /// All blocks, in slabs of about `columns` columns, row by row.
    pub fn slabs(&self, columns: u32) -> Vec<Slab> {
        let wide = (columns / self.block).max(1) as usize;
        let mut slabs = Vec::new();
        for y in 0..self.count[1] {
            for x in (0..self.count[0]).step_by(wide) {
                let end = (x + wide).min(self.count[0]);
                let [west, north] = [self.side(0, x)[0], self.side(1, y)[0]];
                let [east, south] = [self.side(0, end - 1)[1], self.side(1, y)[1]];
                let samples = Rect { columns: west..east + 1, rows: north..south + 1 };
                slabs.push(Slab { blocks: y * self.count[0] + x..y * self.count[0] + end, samples });
            }
        }
        slabs
    }
}

/// A block, its sides included, and the surface there.
#[derive(Clone, Copy)]
pub(super) struct Block<'a> {
    /// North-west sample.
    pub first: Sample,
    /// South-east sample.
    pub last: Sample,
    /// South-east sample of the window.
    end: Sample,
    /// True if some of its samples are void, of those under the triangle in question.
    pub has_void: bool,
    pub near: f64,
    pub ground: &'a Ground,
}

impl<'a> Block<'a> {
    pub fn new(grid: &Grid, number: usize, ground: &'a Ground) -> Self {
        let place = [number % grid.count[0], number / grid.count[0]];
        let sides = [0, 1].map(|axis| grid.side(axis, place[axis]).map(i64::from));
        let [first, last] = [0, 1].map(|end| sides.map(|side| side[end]));
        let end = [0, 1].map(|axis| i64::from(grid.range(axis).end) - 1);
        Self { first, last, end, has_void: ground.has_void([first, last]), near: grid.near, ground }
    }

    /// The same block, which has voids if there are any in the cells under a triangle.
    pub fn under(&self, corners: &[[f64; 3]; 3]) -> Self {
        if !self.has_void {
            return *self;
        }
        let (mut first, mut last) = (self.first, self.last);
        for axis in [0, 1] {
            let of = corners.map(|corner| corner[axis]);
            // Casts stop at the ends.
            first[axis] = first[axis].max(of.into_iter().fold(f64::INFINITY, f64::min).floor() as i64);
            last[axis] = last[axis].min(of.into_iter().fold(f64::NEG_INFINITY, f64::max).ceil() as i64);
        }
        let has_void = first[0] <= last[0] && self.ground.has_void([first, last]);
        Self { has_void, ..*self }
    }

    /// Columns or rows of the samples that belong to no other block.
    pub fn owned(&self, axis: usize) -> RangeInclusive<i64> {
        let last = self.last[axis];
        self.first[axis]..=if last == self.end[axis] { last } else { last - 1 }
    }

    /// The cell of a place, if it is of this block. Each place in the window has one, whatever the
    /// blocks.
    pub fn cell(&self, place: [f64; 2]) -> Option<Sample> {
        let mut cell = [0; 2];
        for axis in [0, 1] {
            let v = place[axis];
            // Outside of it there is nothing to cast.
            if !(self.first[axis] as f64..=self.last[axis] as f64).contains(&v) {
                return None;
            }
            let floor = v.floor() as i64;
            cell[axis] = if floor == self.end[axis] { floor - 1 } else { floor };
            if cell[axis] < self.first[axis] || cell[axis] >= self.last[axis] {
                return None;
            }
        }
        Some(cell)
    }

    /// The whole numbers from `from` to `to`, or from one below to one above them, that are in a
    /// range.
    pub fn lines(from: f64, to: f64, [first, last]: [i64; 2]) -> Range<i64> {
        let start = (from.min(to).ceil() - 1.0).max(first as f64);
        let end = (from.max(to).floor() + 1.0).min(last as f64);
        if start <= end { start as i64..end as i64 + 1 } else { 0..0 }
    }
}
