//! Splits a band of raster rows into leaf tiles with shared borders.

use crate::sample::{Lattice, VALID};
use crate::source::Window;
use crate::tile::code::{Codes, Recipe};

/// Sets `out` to the leaf tile in column `x` of a band: `n + 1` columns from `x * n` on, `n + 1`
/// rows from the band's first. Returns false if the tile has no valid sample, that is, does not
/// exist.
///
/// `band` holds at most `n + 1` rows of `width` samples; samples east or south of it are void.
pub fn leaf((band, width): (&Window, usize), x: usize, n: usize, recipe: &Recipe, out: &mut Lattice) -> bool {
    let first = x * n;
    let columns = (n + 1).min(width.saturating_sub(first));
    let rows = (band.samples.len() / width).min(n + 1);
    let count = (n + 1) * (n + 1);
    let Lattice { code, low, state, .. } = std::mem::take(out);
    let mut codes = Codes { code, low, state };
    codes.restart(count, recipe.coding);
    for row in 0..rows {
        let from = row * width + first;
        recipe.encode(band, from..from + columns, &mut codes);
        codes.add_void(n + 1 - columns, recipe.coding);
    }
    codes.add_void((n + 1 - rows) * (n + 1), recipe.coding);
    let Codes { code, low, state } = codes;
    let exists = state.contains(&VALID);
    *out = Lattice { n, code, low, state };
    exists
}
