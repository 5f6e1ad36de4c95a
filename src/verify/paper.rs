//! Metric `paper`, transcribed from Table 4.1 of the dissertation, for all tiles from the leaves to
//! the root.
//!
//! Drawing at spacing `s` drops every vertex that the coarser lattice lacks. Such a vertex is the
//! middle of an edge `AB` of that lattice: a side of a cell, or at its centre, either diagonal.

use std::collections::HashMap;

use rayon::prelude::*;

use super::full::Full;
use super::ground::Ground;
use crate::container::reader::Reader;
use crate::error_code::code_from_metres;
use crate::sample::{Coding, VALID};
use crate::tile::TileId;

/// Errors of a tile in metres, `[step][patch]`, without quantisation.
#[derive(Clone, Debug)]
pub(super) struct Errors {
    /// Vertical errors.
    pub vertical: Vec<Vec<f64>>,
    /// Horizontal errors.
    pub horizontal: Vec<Vec<f64>>,
}

/// Errors of the tiles of one level, from those of the level below (none for the finest).
pub(super) fn level(
    reader: &Reader,
    full: &Full,
    ids: &[TileId],
    below: &HashMap<TileId, Errors>,
    metres: f64,
) -> HashMap<TileId, Errors> {
    ids.par_iter().map(|&id| (id, Tile { reader, full, id, metres }.errors(below))).collect()
}

/// True if a stored code is that of `metres`, rounded up; writers may have enlarged `metres` a
/// little to cover rounding.
pub(super) fn is_code_of(code: u16, metres: f64) -> bool {
    (code_from_metres(metres * (1.0 - 1e-9))..=code_from_metres(metres * (1.0 + 2.5e-9))).contains(&code)
}

struct Tile<'a> {
    reader: &'a Reader,
    full: &'a Full,
    id: TileId,
    /// Metres of one unit of the heights.
    metres: f64,
}

impl Tile<'_> {
    fn errors(&self, below: &HashMap<TileId, Errors>) -> Errors {
        let header = self.reader.header();
        let (side, last) = (header.patches() as usize, header.steps() as usize - 1);
        let children: Vec<_> = (0..4).filter_map(|q| Some((q, below.get(&self.id.child(q))?))).collect();
        let none = vec![0.0; side * side];
        let mut errors = Errors { vertical: vec![none.clone()], horizontal: vec![none.clone()] };
        if !children.is_empty() {
            errors = Errors { vertical: vec![none.clone(); last], horizontal: vec![none; last] };
            for (quadrant, child) in children {
                inherit(&child.vertical, quadrant, side, &mut errors.vertical);
                inherit(&child.horizontal, quadrant, side, &mut errors.horizontal);
            }
        }
        for step in errors.vertical.len()..=last {
            let (vertical, horizontal) = (0..side * side).map(|patch| self.patch(patch, side, step)).unzip();
            errors.vertical.push(larger(vertical, errors.vertical.last()));
            errors.horizontal.push(larger(horizontal, errors.horizontal.last()));
        }
        errors
    }

    /// Largest errors over the edges of a patch that spacing `2^step` introduces.
    fn patch(&self, index: usize, side: usize, step: usize) -> (f64, f64) {
        let patch = u64::from(self.reader.header().patch());
        let (left, top) = ((index % side) as u64 * patch, (index / side) as u64 * patch);
        let half = 1_u64 << (step - 1);
        let intervals = Ground::of(self.reader).intervals(self.reader.header(), self.id);
        let (mut vertical, mut horizontal) = (0.0_f64, 0.0_f64);
        for y in (0..=patch).step_by(half as usize) {
            for x in (0..=patch).step_by(half as usize) {
                let odd = ((x / half) % 2 == 1, (y / half) % 2 == 1);
                let directions: &[(i64, i64)] = match odd {
                    (false, false) => &[],
                    (true, false) => &[(1, 0)],
                    (false, true) => &[(0, 1)],
                    (true, true) => &[(1, 1), (1, -1)],
                };
                for &direction in directions {
                    let (v, h) = self.edge((left + x, top + y), direction, half, intervals);
                    (vertical, horizontal) = (vertical.max(v), horizontal.max(h));
                }
            }
        }
        (vertical * self.metres, horizontal)
    }

    /// Errors of dropping C at `(x, y)` between A and B, which lie `half` intervals away on either
    /// side.
    fn edge(&self, (x, y): (u64, u64), (dx, dy): (i64, i64), half: u64, intervals: [f64; 2]) -> (f64, f64) {
        let header = self.reader.header();
        let step = i64::from(header.spacing(self.id.level));
        let (left, top) = header.origin(self.id);
        let sample = |away: i64| {
            let column = left as i64 + (x as i64 + away * dx * half as i64) * step;
            let row = top as i64 + (y as i64 + away * dy * half as i64) * step;
            self.full.sample(column as u64, row as u64)
        };
        let [a, c, b] = [sample(-1), sample(0), sample(1)];
        let height = |(code, low, _): (i32, u32, u8)| match header.coding {
            Coding::Integer { .. } => f64::from(code),
            coding => coding.value(code, low),
        };
        let along = |axis: usize, steps: i64| half as f64 * intervals[axis] * steps as f64;
        let hsize = along(0, dx).hypot(along(1, dy));
        let horizontal = match [a, c, b].map(|sample| sample.2 == VALID) {
            [false, false, false] => return (0.0, 0.0),
            [true, true, true] => 0.0,
            [true, false, true] | [false, true, false] => hsize,
            _ => hsize / 2.0,
        };
        ((height(c) - (height(a) + height(b)) / 2.0).abs(), horizontal)
    }
}

/// Takes over the children's errors at step k + 1 as the parent's at step k.
fn inherit(child: &[Vec<f64>], quadrant: u8, side: usize, errors: &mut [Vec<f64>]) {
    let (right, down) = (usize::from(quadrant & 1) * side, usize::from(quadrant >> 1) * side);
    for (errors, child) in errors.iter_mut().zip(child.iter().skip(1)) {
        for (patch, &error) in child.iter().enumerate() {
            let to = &mut errors[(down + patch / side) / 2 * side + (right + patch % side) / 2];
            *to = to.max(error);
        }
    }
}

fn larger(mut errors: Vec<f64>, finer: Option<&Vec<f64>>) -> Vec<f64> {
    for (error, &finer) in errors.iter_mut().zip(finer.into_iter().flatten()) {
        *error = error.max(finer);
    }
    errors
}
