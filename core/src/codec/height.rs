//! The heights chunk of a tile (`format-spec.md`, section 9).
//!
//! It has the residuals of the newborn samples against predictions from the samples known before
//! them. A void sample without a fill keeps its prediction: its residual is 0, which takes hardly
//! any bytes.

use std::ops::Range;

pub use crate::codec::void::Fills;
use crate::codec::walk::{Decoder, Encoder, Places};
use crate::codec::word::Weights;
use crate::codec::{Scratch, bits, decimal, frame, order};
use crate::error::{Error, Result};
use crate::sample::state;
use crate::sample::{Coding, Lattice, VALID, VOID};

/// Bytes before the byte plane.
const HEAD: usize = 12;
/// Flag bit 0: 32-bit arithmetic suffices.
const NARROW: u8 = 1;
/// A tile is narrow if its heights lie closer together than this.
const NARROW_RANGE: i64 = 1 << 22;
/// [`NARROW_RANGE`] of a tile with void samples: centres there may be up to 2.75 times as far from
/// the base. (They lie at most 0.875 times this range below the lowest height or above the highest:
/// predictions take up to 7/16 of the distance to samples of the padding, which lie up to this
/// range outside.)
const NARROW_RANGE_VOID: i64 = 1 << 20;

/// Appends the heights chunk of a tile; appends nothing if its length is 0. `fills` is a hint: if
/// it holds, the bytes are the same and encoding is faster.
///
/// Samples whose state is not [`VOID`] are kept exactly. Unless `root`, the samples with even
/// column and row are the parent's and are not stored.
#[cfg(feature = "write")]
pub fn encode(
    (lattice, fills): (&Lattice, Fills),
    coding: Coding,
    root: bool,
    scratch: &mut Scratch,
    out: &mut Vec<u8>,
) -> Result<()> {
    check_shape(lattice, coding)?;
    let places = Places::new(lattice.n, root, &lattice.state);
    let transform =
        if coding == Coding::Float32 && !is_constant(lattice) { decimal::detect(lattice, root) } else { 0 };
    let codes = match decimal::scale(transform) {
        Some(scale) => {
            scratch.decimals.clear();
            scratch.decimals.extend(lattice.code.iter().map(|&code| decimal::q_from_code(code, scale)));
            &scratch.decimals
        }
        None => &lattice.code,
    };
    let narrow = is_narrow(codes, places);
    scratch.residuals.clear();
    scratch.residuals.reserve(order::newborn_count(lattice.n, root));
    let (residuals, actual, states) = (&mut scratch.residuals, &mut scratch.row, &mut scratch.states);
    let (weights, near) = (Weights::USUAL, &mut scratch.near);
    let mut coder = Encoder { codes, places, fills, residuals, actual, states, near, weights, choose: true };
    scratch.walk.run(narrow, places, &mut coder);
    if root {
        // Each stage has chosen weights for itself, but a chunk has room for one choice.
        coder.residuals.clear();
        coder.choose = false;
        scratch.walk.run(narrow, places, &mut coder);
    }
    let weights = coder.weights;

    if coding.has_low() {
        gather_lows(lattice, root, &mut scratch.bytes);
    } else {
        scratch.bytes.clear();
    }
    let all_zero = scratch.residuals.iter().all(|&g| g == 0) && scratch.bytes.iter().all(|&byte| byte == 0);
    if all_zero && transform == 0 && weights == Weights::USUAL {
        return Ok(());
    }
    let (k, bits) = bits::choose_k(&scratch.residuals, &mut scratch.histogram);
    let start = out.len();
    out.extend_from_slice(&[if narrow { NARROW } else { 0 }, k as u8, transform, weights.byte()]);
    out.extend_from_slice(&[0; 8]);
    scratch.raw.clear();
    bits::write_plane(&scratch.residuals, k, &mut scratch.raw);
    let matches = worth_matching(&scratch.raw, bits);
    frame::compress_plane(&scratch.raw, &order::cuts(lattice.n, root), matches, out)?;
    let plane_length = (out.len() - start - HEAD) as u32;
    bits::write_raw(&scratch.residuals, k, out);
    let lows_start = out.len();
    if coding.has_low() {
        frame::compress(&scratch.bytes, out)?;
    }
    let lows_length = (out.len() - lows_start) as u32;
    out[start + 4..start + 8].copy_from_slice(&plane_length.to_le_bytes());
    out[start + 8..start + HEAD].copy_from_slice(&lows_length.to_le_bytes());
    Ok(())
}

/// Bits of a residual from which matches cost no more than the Huffman codes that they replace.
#[cfg(feature = "write")]
const MANY_BITS: f64 = 4.0;
/// One in so many words of zeros makes a plane one that has runs.
#[cfg(feature = "write")]
const RUNS: usize = 32;

/// Whether matches in a byte plane are worth their search: where it has runs of zeros, or its
/// residuals take many bits. Elsewhere zstd finds chance repetitions of small residuals, and what
/// it stores of a match is longer than their Huffman codes.
///
/// Against searching every plane, files of 16 385 x 16 385 int16 samples become 12.6 % smaller
/// (synthetic, smooth), 0.5 % (real mountains) and 0.05 % (real, with voids); of 18 real rasters
/// one becomes larger, by 0.02 %, lowland with sea becomes 3.9 % smaller. Without the rule for runs
/// files grow by up to 78 %, without that for bits by up to 0.3 %.
#[cfg(feature = "write")]
fn worth_matching(plane: &[u8], bits: f64) -> frame::Matches {
    let words = plane.as_chunks::<32>().0;
    let zeros = words.iter().filter(|word| word.iter().fold(0, |any, byte| any | byte) == 0).count();
    if bits > MANY_BITS || zeros * RUNS > words.len() {
        frame::Matches::Often
    } else {
        frame::Matches::Rarely
    }
}

/// Sets the codes (and lows) of all newborn samples of `lattice` from the heights chunk.
///
/// `lattice.state` must be decoded before; unless `root`, so must the samples with even column and
/// row, which stay as they are. After an error the newborn samples are not defined.
pub fn decode(
    chunk: &[u8],
    lattice: &mut Lattice,
    coding: Coding,
    root: bool,
    scratch: &mut Scratch,
) -> Result<()> {
    let places = Places::new(lattice.n, root, &lattice.state);
    let (rows, has_void) = (0..lattice.n + 1, places.has_void);
    decode_wanted(chunk, lattice, coding, Wanted { root, has_void, rows }, scratch)
}

/// [`decode`] of some rows (not none) of a tile without voids below the root. Only their states
/// and the samples of [`parent_rows`] must be known before; other rows are not defined after.
pub fn decode_rows(
    chunk: &[u8],
    lattice: &mut Lattice,
    coding: Coding,
    rows: Range<usize>,
    scratch: &mut Scratch,
) -> Result<()> {
    decode_wanted(chunk, lattice, coding, Wanted { root: false, has_void: false, rows }, scratch)
}

/// Numbers of the even rows, halved, that [`decode_rows`] needs for some rows of a tile of `n`
/// intervals.
pub fn parent_rows(n: usize, rows: &Range<usize>) -> Range<usize> {
    order::stages(n, false).next().map_or(0..n / 2 + 1, |stage| stage.needed(rows).parents)
}

/// What of a tile is decoded.
struct Wanted {
    root: bool,
    has_void: bool,
    rows: Range<usize>,
}

/// Sets the codes (and lows) of the newborn samples in the rows that are wanted.
fn decode_wanted(
    chunk: &[u8],
    lattice: &mut Lattice,
    coding: Coding,
    Wanted { root, has_void, rows }: Wanted,
    scratch: &mut Scratch,
) -> Result<()> {
    check_shape(lattice, coding)?;
    let n = lattice.n;
    let count = order::newborn_count(n, root);
    let parts = Parts::split(chunk, coding, count)?;
    if let Some(plane) = parts.plane {
        frame::decompress(plane, count..=count * bits::MAX_PLANE_BYTES, "byte plane", &mut scratch.bytes)?;
        bits::read(&scratch.bytes, parts.raw, parts.k, count, &mut scratch.raw, &mut scratch.residuals)?;
    } else {
        scratch.residuals.clear();
        scratch.residuals.resize(count, 0);
    }
    let scale = decimal::scale(parts.transform);
    if let Some(scale) = scale {
        // All other samples are newborn, and set before they are read.
        scratch.decimals.resize(lattice.code.len(), 0);
        for stage in order::stages(n, root).take(usize::from(!root)) {
            for at in stage.needed(&rows).parents.flat_map(|b| stage.parents(b).indices()) {
                scratch.decimals[at] = decimal::q_from_code(lattice.code[at], scale);
            }
        }
    }
    let codes = if scale.is_some() { &mut scratch.decimals } else { &mut lattice.code };
    let places = Places { n, root, state: &lattice.state, has_void, rows: (rows.start, rows.end) };
    let residuals = &scratch.residuals[..];
    let mut coder =
        Decoder { codes, places, residuals, used: 0, states: &mut scratch.states, weights: parts.weights };
    scratch.walk.run(parts.narrow, places, &mut coder);
    if let Some(scale) = scale {
        let width = n + 1;
        for row in order::newborn(n, root).filter(|row| rows.contains(&(row.first / width))) {
            for (code, &q) in row.of_mut(&mut lattice.code).zip(row.of(&scratch.decimals)) {
                *code = decimal::code_from_q(q, scale);
            }
        }
    }
    match parts.lows {
        Some(lows) => {
            frame::decompress(lows, 4 * count..=4 * count, "plane of lows", &mut scratch.bytes)?;
            scatter_lows(&scratch.bytes, lattice, root);
        }
        None if coding.has_low() => {
            order::newborn(n, root).for_each(|row| row.of_mut(&mut lattice.low).for_each(|low| *low = 0));
        }
        None => {}
    }
    Ok(())
}

/// The parts of a heights chunk.
struct Parts<'a> {
    narrow: bool,
    k: u32,
    transform: u8,
    weights: Weights,
    /// `None` if all residuals are 0.
    plane: Option<&'a [u8]>,
    raw: &'a [u8],
    lows: Option<&'a [u8]>,
}

impl<'a> Parts<'a> {
    /// Checks the head and the lengths of a chunk for `count` newborn samples.
    fn split(chunk: &'a [u8], coding: Coding, count: usize) -> Result<Self> {
        if chunk.is_empty() {
            let weights = Weights::USUAL;
            return Ok(Self {
                narrow: false,
                k: 0,
                transform: 0,
                weights,
                plane: None,
                raw: &[],
                lows: None,
            });
        }
        let Some((&[flags, k, transform, weights, a0, a1, a2, a3, b0, b1, b2, b3], body)) =
            chunk.split_first_chunk::<HEAD>()
        else {
            return Err(Error::format("heights chunk", format!("at least {HEAD} bytes"), chunk.len()));
        };
        if flags & !NARROW != 0 {
            return Err(Error::format("heights chunk", "reserved flags of 0", format!("{flags:#04x}")));
        }
        let Some(weights) = Weights::from_byte(weights) else {
            let expected = "weights with a sharpness of 0 to 7 and a skew of -7 to 7";
            return Err(Error::format("heights chunk", expected, format!("{weights:#04x}")));
        };
        if u32::from(k) > bits::MAX_RAW_BITS {
            return Err(Error::format("heights chunk", format!("k of 0 to {}", bits::MAX_RAW_BITS), k));
        }
        if transform != 0 && (coding != Coding::Float32 || decimal::scale(transform).is_none()) {
            return Err(Error::format(
                "heights chunk",
                "a transform of 0 to 12, 0 unless float32",
                transform,
            ));
        }
        let raw_length = bits::raw_length(count, u32::from(k));
        let (a, b) = (u32::from_le_bytes([a0, a1, a2, a3]), u32::from_le_bytes([b0, b1, b2, b3]));
        if u64::from(a) + raw_length as u64 + u64::from(b) != body.len() as u64 {
            let expected = format!("byte plane of {a}, raw bits of {raw_length} and lows of {b} bytes");
            return Err(Error::format("heights chunk", expected, format!("{} bytes", body.len())));
        }
        if (b > 0) != coding.has_low() {
            return Err(Error::format(
                "heights chunk",
                "lows exactly for float64",
                format!("{b} bytes of lows"),
            ));
        }
        let (plane, rest) = body.split_at(a as usize);
        let (raw, lows) = rest.split_at(raw_length);
        let lows = coding.has_low().then_some(lows);
        let narrow = flags & NARROW != 0;
        Ok(Self { narrow, k: u32::from(k), transform, weights, plane: Some(plane), raw, lows })
    }
}

/// Fails unless the planes have the sizes that `n` calls for: others are the caller's mistake.
fn check_shape(lattice: &Lattice, coding: Coding) -> Result<()> {
    let count = (lattice.n + 1) * (lattice.n + 1);
    let lows = if coding.has_low() { count } else { 0 };
    let fits = lattice.code.len() == count && lattice.state.len() == count && lattice.low.len() == lows;
    if fits && lattice.n >= 2 && lattice.n.is_power_of_two() {
        return Ok(());
    }
    Err(Error::usage(format!("a lattice of {} intervals does not have the samples of a tile", lattice.n)))
}

/// True if all samples with a height have the same height.
fn is_constant(lattice: &Lattice) -> bool {
    let mut live = lattice.code.iter().zip(&lattice.state).filter(|(_, state)| **state != VOID);
    live.next().is_none_or(|(first, _)| live.all(|(code, _)| code == first))
}

/// True if 32-bit arithmetic relative to the tile's base gives the right predictions: codes lie
/// close together, and no prediction that enters another one wraps modulo 2^32.
fn is_narrow(codes: &[i32], places: Places<'_>) -> bool {
    let (limit, outside) =
        if places.has_void { (NARROW_RANGE_VOID, NARROW_RANGE_VOID) } else { (NARROW_RANGE, 0) };
    let range = i64::from(i32::MIN)..=i64::from(i32::MAX);
    let narrow = |low: i32, high: i32| {
        let (low, high) = (i64::from(low), i64::from(high));
        high - low < limit && range.contains(&(low - outside)) && range.contains(&(high + outside))
    };
    // Quick test: codes that stand for no height, and 0, are seldom far from the others.
    let (lowest, highest) = state::range(codes).unwrap_or_default();
    if narrow(lowest.min(0), highest.max(0)) {
        return true;
    }
    let Some((low, high)) = state::known_range(codes, places.state) else { return true };
    // The base is one of the heights, or 0; and parents are 0 where none is valid.
    let base_is_height = !places.root || places.state[0] != VOID;
    let has_parent = order::stages(places.n, places.root)
        .take(1)
        .any(|first| (0..=first.m).any(|b| first.parents(b).of(places.state).any(|&state| state == VALID)));
    let (low, high) = if base_is_height && has_parent { (low, high) } else { (low.min(0), high.max(0)) };
    narrow(low, high)
}

/// Sets `out` to the lows of all newborn samples, lowest bytes first; 0 for those without a height.
fn gather_lows(lattice: &Lattice, root: bool, out: &mut Vec<u8>) {
    out.clear();
    for shift in [0, 8, 16, 24] {
        for row in order::newborn(lattice.n, root) {
            let samples = row.of(&lattice.low).zip(row.of(&lattice.state));
            out.extend(samples.map(|(low, &state)| if state == VOID { 0 } else { (low >> shift) as u8 }));
        }
    }
}

/// The inverse of [`gather_lows`].
fn scatter_lows(bytes: &[u8], lattice: &mut Lattice, root: bool) {
    let mut bytes = bytes.iter();
    for shift in [0, 8, 16, 24] {
        for row in order::newborn(lattice.n, root) {
            for (low, &byte) in row.of_mut(&mut lattice.low).zip(&mut bytes) {
                *low = if shift == 0 { u32::from(byte) } else { *low | u32::from(byte) << shift };
            }
        }
    }
}
