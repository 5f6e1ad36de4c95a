//! A band of raster rows to leaf tiles with shared borders.

use crate::sample::{Lattice, VALID};
use crate::source::Window;
use crate::tile::code::{Codes, Recipe};

/// Leaf tile in column `x` of a band: `n + 1` columns from `x * n` on, `n + 1` rows from the band's first.
///
/// `band` holds at most `n + 1` rows of `width` samples; what lies right of it or below is void.
/// `None` if the tile has no valid sample, that is, does not exist.
pub fn leaf(band: &Window, width: usize, x: usize, n: usize, recipe: &Recipe) -> Option<Lattice> {
    let first = x * n;
    let columns = (n + 1).min(width.checked_sub(first)?);
    let rows = (band.samples.len() / width).min(n + 1);
    let count = (n + 1) * (n + 1);
    let mut codes = Codes {
        code: Vec::with_capacity(count),
        low: Vec::with_capacity(if recipe.coding.has_low() { count } else { 0 }),
        state: Vec::with_capacity(count),
    };
    for row in 0..rows {
        let from = row * width + first;
        recipe.encode(band, from..from + columns, &mut codes);
        codes.add_void(n + 1 - columns, recipe.coding);
    }
    codes.add_void((n + 1 - rows) * (n + 1), recipe.coding);
    let Codes { code, low, state } = codes;
    state.contains(&VALID).then_some(Lattice { n, code, low, state })
}
