//! Residuals as a byte plane with escapes and raw low bits (`format-spec.md`, section 9.1); rows of
//! single bits.

use crate::error::{Error, Result};
use crate::simd::{self, Kernel};

/// Most low bits a residual may store raw.
pub const MAX_RAW_BITS: u32 = 24;
/// Most bytes of a byte plane for one residual: 255 and five of LEB128.
pub const MAX_PLANE_BYTES: usize = 6;
/// Zero bytes after the raw bits in memory, so that whole words can be read there.
const SLACK: usize = 8;
/// Bins of the histogram that `k` is chosen by.
const BINS: usize = 4096;

/// The residual as an unsigned number: 0, -1, 1, -2, ... become 0, 1, 2, 3, ...
#[inline(always)]
pub fn zigzag(residual: i32) -> u32 {
    ((residual << 1) ^ (residual >> 31)) as u32
}

/// Inverse of [`zigzag`].
#[inline(always)]
pub fn unzigzag(zigzag: u32) -> i32 {
    (zigzag >> 1) as i32 ^ -((zigzag & 1) as i32)
}

/// Bytes that the raw bits of `count` residuals take.
pub fn raw_length(count: usize, k: u32) -> usize {
    (count * k as usize).div_ceil(8)
}

/// Kernel: the high bits of residuals as bytes, at most 255.
struct HighBytes<'a> {
    residuals: &'a [u32],
    k: u32,
    bytes: &'a mut [u8],
}

impl Kernel for HighBytes<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { residuals, k, bytes } = self;
        let bytes = &mut bytes[..residuals.len()];
        for i in 0..residuals.len() {
            bytes[i] = (residuals[i] >> k).min(255) as u8;
        }
    }
}

/// Appends the byte plane of `residuals` (zigzag), escapes included.
pub fn write_plane(residuals: &[u32], k: u32, out: &mut Vec<u8>) {
    let start = out.len();
    out.resize(start + residuals.len(), 0);
    simd::run(HighBytes { residuals, k, bytes: &mut out[start..] });
    // Escapes are rare: look for them a block at a time.
    for (block, residuals) in residuals.chunks(64).enumerate() {
        let bytes = &out[start + 64 * block..][..residuals.len()];
        if bytes.iter().fold(0, |most, &byte| byte.max(most)) == 255 {
            residuals.iter().filter(|g| **g >> k >= 255).for_each(|g| write_leb128((g >> k) - 255, out));
        }
    }
}

/// Appends the `k` low bits of every residual.
pub fn write_raw(residuals: &[u32], k: u32, out: &mut Vec<u8>) {
    if k == 0 {
        return;
    }
    let (mut pending, mut bits) = (0_u64, 0);
    for &g in residuals {
        pending |= u64::from(g & ((1 << k) - 1)) << bits;
        bits += k;
        if bits >= 32 {
            out.extend_from_slice(&(pending as u32).to_le_bytes());
            pending >>= 32;
            bits -= 32;
        }
    }
    out.extend_from_slice(&pending.to_le_bytes()[..bits.div_ceil(8) as usize]);
}

/// Sets `out` to `count` residuals (zigzag): the inverse of [`write_plane`] and [`write_raw`].
/// `padded` is scratch memory.
pub fn read(
    plane: &[u8],
    raw: &[u8],
    k: u32,
    count: usize,
    padded: &mut Vec<u8>,
    out: &mut Vec<u32>,
) -> Result<()> {
    let Some((bytes, mut escapes)) = plane.split_at_checked(count) else {
        return Err(Error::format("byte plane", format!("at least {count} bytes"), plane.len()));
    };
    out.clear();
    out.extend(bytes.iter().map(|&byte| u32::from(byte)));
    // Escapes are rare: look for them a block at a time.
    for (bytes, block) in bytes.chunks(64).zip(out.chunks_mut(64)) {
        if !bytes.contains(&255) {
            continue;
        }
        for u in block.iter_mut().filter(|u| **u == 255) {
            let more = read_leb128(&mut escapes)?;
            *u = more.checked_add(255).filter(|&u| u <= u32::MAX >> k).ok_or_else(|| {
                Error::format("byte plane", "a residual below 2^32", format!("escape {more} at k {k}"))
            })?;
        }
    }
    if !escapes.is_empty() {
        return Err(Error::format(
            "byte plane",
            "its end after the last escape",
            format!("{} bytes more", escapes.len()),
        ));
    }
    if k > 0 {
        read_raw(raw, k, padded, out)?;
    }
    Ok(())
}

/// Appends `k` raw bits to each of the numbers in `out`.
fn read_raw(raw: &[u8], k: u32, padded: &mut Vec<u8>, out: &mut [u32]) -> Result<()> {
    let used = out.len() * k as usize;
    if let (Some(last), 1..) = (raw.last(), used % 8)
        && last >> (used % 8) != 0
    {
        return Err(Error::format("raw bits", "unused bits of 0", format!("last byte {last:#04x}")));
    }
    padded.clear();
    padded.extend_from_slice(raw);
    padded.resize(raw.len() + SLACK, 0);
    let mask = (1 << k) - 1;
    let mut bit = 0;
    for u in out {
        let Some(word) = padded.get(bit / 8..bit / 8 + 4) else { break };
        let word = u32::from_le_bytes([word[0], word[1], word[2], word[3]]);
        *u = (*u << k) | (word >> (bit % 8)) & mask;
        bit += k as usize;
    }
    Ok(())
}

/// Appends an unsigned LEB128 number.
fn write_leb128(mut number: u32, out: &mut Vec<u8>) {
    while number >= 0x80 {
        out.push(number as u8 | 0x80);
        number >>= 7;
    }
    out.push(number as u8);
}

/// Takes an unsigned LEB128 number of at most five bytes, below 2^32, off the front of `bytes`.
fn read_leb128(bytes: &mut &[u8]) -> Result<u32> {
    let mut number = 0_u64;
    for shift in [0, 7, 14, 21, 28] {
        let Some((&byte, rest)) = bytes.split_first() else {
            return Err(Error::format("byte plane", "an escape", "its end"));
        };
        *bytes = rest;
        number |= u64::from(byte & 0x7F) << shift;
        if byte < 0x80 {
            return u32::try_from(number)
                .map_err(|_| Error::format("byte plane", "an escape below 2^32", number));
        }
    }
    Err(Error::format("byte plane", "an escape of at most five bytes", "a longer one"))
}

/// The `k` with which the residuals (zigzag) take the fewest bytes, estimated by entropy, and the
/// bits that each of them takes then. Bits are 0 where all residuals are below 128: `k` is 0 then.
pub fn choose_k(residuals: &[u32], histogram: &mut Vec<u32>) -> (u32, f64) {
    let all = residuals.iter().fold(0, |all, g| all | g);
    if all < 128 {
        return (0, 0.0);
    }
    // Every fourth residual is enough for the shape of the histogram.
    let step = if residuals.len() > 4096 { 4 } else { 1 };
    let sample = || (0..residuals.len()).step_by(step).map(|at| residuals[at]);
    let taken = residuals.len().div_ceil(step) as u32;
    let coarse = if all < BINS as u32 { 0 } else { coarsest(sample(), taken) };
    histogram.clear();
    histogram.resize(BINS, 0);
    let (mut escape_bits, bins) = (0.0, &mut histogram[..]);
    sample().for_each(|g| match bins.get_mut((g >> coarse) as usize) {
        Some(bin) => *bin += 1,
        None => escape_bits += 8.0 + f64::from(32 - g.leading_zeros() - coarse) - 8.0,
    });
    // Most residuals are small: look only at the bins up to the last one used.
    let mut used = histogram.iter().rposition(|&count| count > 0).map_or(0, |last| last + 1);
    let mut best = (f64::INFINITY, 0);
    for k in coarse..=MAX_RAW_BITS.min(coarse + 6) {
        let bits = plane_bits(&histogram[..used.max(255)], f64::from(taken))
            + f64::from(taken) * f64::from(k)
            + escape_bits;
        // The raw bits are exact and the estimate of the others is a little low, so more raw bits
        // must gain something.
        if bits < 0.995 * best.0 {
            best = (bits, k);
        }
        let half = used.div_ceil(2);
        for bin in 0..half {
            histogram[bin] = histogram[2 * bin] + histogram[2 * bin + 1];
        }
        histogram[half..used].fill(0);
        used = half;
    }
    (best.1, best.0 / f64::from(taken))
}

/// The fewest low bits to drop so that at most one in 64 of the `taken` residuals falls beyond the
/// last bin.
fn coarsest(sample: impl Iterator<Item = u32>, taken: u32) -> u32 {
    let mut lengths = [0_u32; 33];
    sample.for_each(|g| lengths[(32 - g.leading_zeros()) as usize] += 1);
    let mut beyond = 0;
    let widest = lengths.iter().rposition(|&count| {
        beyond += count;
        beyond > taken / 64
    });
    (widest.unwrap_or(0) as u32).saturating_sub(BINS.ilog2())
}

/// Estimated bits of a byte plane: the entropy of its bytes, and its escapes.
fn plane_bits(histogram: &[u32], taken: f64) -> f64 {
    let (direct, escaped) = histogram.split_at(255);
    let inside: u32 = direct.iter().sum();
    let outside = taken - f64::from(inside);
    let cost = |count: f64| if count > 0.0 { count * (taken / count).log2() } else { 0.0 };
    let mut bits = cost(outside);
    for &count in direct {
        bits += cost(f64::from(count));
    }
    for (u, &count) in escaped.iter().enumerate().filter(|(_, count)| **count > 0) {
        bits += f64::from(count) * if u < 128 { 8.0 } else { 16.0 };
    }
    bits.max(taken)
}

/// Appends rows of 0 and 1 as bits, the lowest first.
pub fn pack(bits: &[u8], out: &mut Vec<u8>) {
    let (eights, rest) = bits.as_chunks::<8>();
    // Each bit of the factor moves one of the eight to its place in the highest byte.
    let byte = |bits| (u64::from_le_bytes(bits).wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8;
    out.extend(eights.iter().map(|&bits| byte(bits)));
    if !rest.is_empty() {
        out.push(rest.iter().rev().fold(0, |byte, &bit| byte << 1 | bit));
    }
}

/// Sets `out` to `count` bits: the inverse of [`pack`]. Fails if `bytes` has another length, or
/// unused bits are set.
pub fn unpack(bytes: &[u8], count: usize, out: &mut Vec<u8>) -> Result<()> {
    if bytes.len() != count.div_ceil(8) {
        return Err(Error::format("mask", format!("{} bytes", count.div_ceil(8)), bytes.len()));
    }
    if let (Some(last), 1..) = (bytes.last(), count % 8)
        && last >> (count % 8) != 0
    {
        return Err(Error::format("mask", "unused bits of 0", format!("last byte {last:#04x}")));
    }
    out.clear();
    for &byte in bytes {
        out.extend_from_slice(&std::array::from_fn::<u8, 8, _>(|bit| byte >> bit & 1));
    }
    out.truncate(count);
    Ok(())
}
