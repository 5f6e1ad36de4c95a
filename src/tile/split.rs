//! A band of raster rows to leaf tiles with shared borders.

use crate::sample::{Coding, Lattice, VALID};
use crate::tile::code::CodeRows;

/// Leaf tile in column `x` of a band: `n + 1` columns from `x * n` on, `n + 1` rows from the band's first.
///
/// `band` holds at most `n + 1` rows of `width` samples; what lies right of it or below is void.
/// `None` if the tile has no valid sample, that is, does not exist.
pub fn leaf(band: &CodeRows, width: usize, x: usize, n: usize, coding: Coding) -> Option<Lattice> {
    let first = x * n;
    let columns = (n + 1).min(width.checked_sub(first)?);
    let rows = (band.state.len() / width).min(n + 1);
    let span = |row: usize| row * width + first..row * width + first + columns;
    if !(0..rows).any(|row| band.state[span(row)].contains(&VALID)) {
        return None;
    }
    let mut lattice = Lattice::new(n, coding);
    for row in 0..rows {
        let to = row * (n + 1)..row * (n + 1) + columns;
        lattice.code[to.clone()].copy_from_slice(&band.code[span(row)]);
        lattice.state[to.clone()].copy_from_slice(&band.state[span(row)]);
        if coding.has_low() {
            lattice.low[to].copy_from_slice(&band.low[span(row)]);
        }
    }
    Some(lattice)
}
