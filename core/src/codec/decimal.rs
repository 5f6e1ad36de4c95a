//! Float32 samples that are decimals or binary fractions, as integers (`format-spec.md`, section
//! 9.3).
//!
//! Many float rasters hold integers, centimetres or quarters of a foot. The integers `q` of
//! `f32(q / s)` compress several times better than the bits of the floats, and give the same bits
//! back.

use crate::codec::order;
use crate::sample::{Lattice, VOID, code_from_f32, f32_from_code};

/// The scales `s` of transforms 1, 2, ...
const SCALES: [f64; 12] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 10.0, 100.0, 1000.0];
/// Transforms in the order of their scales: the first that fits has the smallest numbers.
const BY_SCALE: [u8; 12] = [1, 2, 3, 4, 10, 5, 6, 7, 11, 8, 9, 12];
/// Greatest `|q|`, exclusive: below it steps of `q` are coarser than those of the float, and the
/// transform pays.
const MAX_Q: i32 = 1 << 24;
/// How many samples a transform is tried on before the others.
const PROBES: usize = 24;

/// Scale of a transform; `None` for 0 (none) and unknown ones.
pub fn scale(transform: u8) -> Option<f64> {
    SCALES.get(usize::from(transform).checked_sub(1)?).copied()
}

/// The integer nearest to `s` times the float of a code, clamped to `i32`; 0 for NaN.
#[inline]
pub fn q_from_code(code: i32, scale: f64) -> i32 {
    let scaled = f64::from(f32_from_code(code)) * scale + 0.5;
    let limited = scaled.clamp(f64::from(i32::MIN), f64::from(i32::MAX));
    // Rounds towards zero first: a call of `floor` is slow on a plain x86-64.
    let truncated = limited as i64;
    (truncated - i64::from((truncated as f64) > limited)) as i32
}

/// The code of `f32(q / s)`.
#[inline]
pub fn code_from_q(q: i32, scale: f64) -> i32 {
    code_from_f32((f64::from(q) / scale) as f32)
}

/// The transform with the smallest scale that restores every newborn sample with a height; 0 if
/// there is none.
pub fn detect(lattice: &Lattice, root: bool) -> u8 {
    let stride = order::newborn_count(lattice.n, root) / PROBES + 1;
    let mut probes = Vec::with_capacity(PROBES);
    let mut seen = 0;
    for row in order::newborn(lattice.n, root) {
        // One probe in a row at most: rows are shorter than the stride.
        let place = row.first + seen % row.count * row.step;
        if lattice.state[place] != VOID && seen >= probes.len() * stride {
            probes.push(lattice.code[place]);
        }
        seen += row.count;
    }
    let fits = |transform: &u8| {
        scale(*transform).is_some_and(|scale| {
            probes.iter().all(|&code| is_exact(code, scale))
                && order::newborn(lattice.n, root).all(|row| {
                    let mut samples = row.of(&lattice.code).zip(row.of(&lattice.state));
                    samples.all(|(&code, &state)| state == VOID || is_exact(code, scale))
                })
        })
    };
    BY_SCALE.iter().copied().find(fits).unwrap_or(0)
}

/// True if the transform restores `code` bit for bit, and its integer is small enough.
fn is_exact(code: i32, scale: f64) -> bool {
    let q = q_from_code(code, scale);
    (1 - MAX_Q..MAX_Q).contains(&q) && code_from_q(q, scale) == code
}
