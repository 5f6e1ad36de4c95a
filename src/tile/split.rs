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

/// True if the leaf tile in column `x` of a band has no void sample. The arguments are those of
/// [`leaf`].
pub fn is_valid((band, width): (&Window, usize), x: usize, n: usize, recipe: &Recipe) -> bool {
    let first = x * n;
    let whole = width > first + n && band.samples.len() / width > n;
    whole && (0..=n).all(|row| recipe.is_valid(band, row * width + first..row * width + first + n + 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{Coding, SampleType};
    use crate::source::{Nodata, Samples};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_tile_is_valid_if_no_sample_of_it_is_cut_as_void(
            kind in prop::sample::select(SampleType::ALL.to_vec()),
            nodata in prop::sample::select(vec![None, Some(7.0), Some(0.5), Some(-3.4e38), Some(f64::NAN)]),
            odd in prop::option::of((0..9_usize, 0..14_usize)),
            value in prop::sample::select(vec![7.0, 0.5, f64::NAN, f64::INFINITY, -3.4e38, 3.0]),
            is_masked in any::<bool>(),
            (width, rows) in (6..14_usize, 6..9_usize),
            x in 0..4_usize,
        ) {
            let mut values = vec![1.0; width * rows];
            let mut mask = vec![255; width * rows];
            if let Some(at) = odd.map(|(row, column)| row * width + column).filter(|&at| at < values.len()) {
                values[at] = value;
                mask[at] = u8::from(value != 3.0);
            }
            let samples = match kind {
                SampleType::Int8 => Samples::Int8(values.iter().map(|&v| v as i8).collect()),
                SampleType::Uint8 => Samples::Uint8(values.iter().map(|&v| v as u8).collect()),
                SampleType::Int16 => Samples::Int16(values.iter().map(|&v| v as i16).collect()),
                SampleType::Uint16 => Samples::Uint16(values.iter().map(|&v| v as u16).collect()),
                SampleType::Int32 => Samples::Int32(values.iter().map(|&v| v as i32).collect()),
                SampleType::Uint32 => Samples::Uint32(values.iter().map(|&v| v as u32).collect()),
                SampleType::Float32 => Samples::Float32(values.iter().map(|&v| v as f32).collect()),
                SampleType::Float64 => Samples::Float64(values),
            };
            let coding = match kind {
                SampleType::Float32 => Coding::Float32,
                SampleType::Float64 => Coding::Float64,
                _ => Coding::Integer { scale: 1.0, offset: 0.0 },
            };
            let recipe = Recipe { coding, nodata: Nodata::new(nodata, kind), quantised: false };
            let window = Window { samples, mask: is_masked.then_some(mask) };
            let mut lattice = Lattice::default();
            leaf((&window, width), x, 4, &recipe, &mut lattice);
            let all_valid = lattice.state.iter().all(|&state| state == VALID);
            prop_assert_eq!(is_valid((&window, width), x, 4, &recipe), all_valid);
        }
    }
}
