//! Values as bytes and back, for what a build keeps in its work folder.
//!
//! The bytes are wincode's: every number as it is, little endian, NaN and infinities included;
//! every list behind its length. Decoding takes at most 64 times as much memory for a list as there
//! are bytes, or 64 KiB if that is more, whatever length stands before it.

use wincode::config::{self, Configuration, PREALLOCATION_SIZE_LIMIT_DISABLED};
use wincode::{ReadResult, SchemaRead, SchemaWrite};

use crate::codec::frame;
use crate::error::{Error, Result};

/// wincode with a limit of bytes that a list may take.
type Within<const LIMIT: usize> = Configuration<true, LIMIT>;
type Unlimited = Within<PREALLOCATION_SIZE_LIMIT_DISABLED>;

/// Limits of bytes for a list. An element takes at most four times as much memory as bytes.
const LIMITS: [usize; 5] = [1 << 16, 1 << 20, 1 << 24, 1 << 28, (1 << 31) - 1];
const MEMORY_OF_A_BYTE: usize = 4;

/// A value that can be encoded.
pub trait Encode: SchemaWrite<Unlimited, Src = Self> {}

impl<T: SchemaWrite<Unlimited, Src = T>> Encode for T {}

/// A value that can be decoded within any of [`LIMITS`].
pub trait Decode:
    for<'a> SchemaRead<'a, Within<{ LIMITS[0] }>, Dst = Self>
    + for<'a> SchemaRead<'a, Within<{ LIMITS[1] }>, Dst = Self>
    + for<'a> SchemaRead<'a, Within<{ LIMITS[2] }>, Dst = Self>
    + for<'a> SchemaRead<'a, Within<{ LIMITS[3] }>, Dst = Self>
    + for<'a> SchemaRead<'a, Within<{ LIMITS[4] }>, Dst = Self>
{
}

impl<T> Decode for T where
    T: for<'a> SchemaRead<'a, Within<{ LIMITS[0] }>, Dst = T>
        + for<'a> SchemaRead<'a, Within<{ LIMITS[1] }>, Dst = T>
        + for<'a> SchemaRead<'a, Within<{ LIMITS[2] }>, Dst = T>
        + for<'a> SchemaRead<'a, Within<{ LIMITS[3] }>, Dst = T>
        + for<'a> SchemaRead<'a, Within<{ LIMITS[4] }>, Dst = T>
{
}

/// A value as bytes. They are equal where values are equal bit for bit; a NaN equals itself.
pub fn encode<T: Encode>(value: &T) -> Result<Vec<u8>> {
    config::serialize(value, Unlimited::new())
        .map_err(|error| Error::usage(format!("the state of the build cannot be written: {error}")))
}

/// The inverse of [`encode`]. All bytes must be used. `what` names the value in an error.
pub fn decode<T: Decode>(bytes: &[u8], what: &str) -> Result<T> {
    let needed = bytes.len().saturating_mul(MEMORY_OF_A_BYTE);
    let decoded = match LIMITS.iter().position(|&limit| needed <= limit) {
        Some(0) => within::<{ LIMITS[0] }, T>(bytes),
        Some(1) => within::<{ LIMITS[1] }, T>(bytes),
        Some(2) => within::<{ LIMITS[2] }, T>(bytes),
        Some(3) => within::<{ LIMITS[3] }, T>(bytes),
        _ => within::<{ LIMITS[4] }, T>(bytes),
    };
    decoded.map_err(|error| Error::format(what, "what this program writes", error))
}

fn within<const LIMIT: usize, T>(bytes: &[u8]) -> ReadResult<T>
where
    T: for<'a> SchemaRead<'a, Within<LIMIT>, Dst = T>,
{
    config::deserialize_exact(bytes, Within::<LIMIT>::new())
}

/// A value as one zstd frame.
pub fn pack<T: Encode>(value: &T) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    frame::compress(&encode(value)?, &mut out)?;
    Ok(out)
}

/// The inverse of [`pack`], for a value that belongs to a tile of `n` intervals.
pub fn unpack<T: Decode>(packed: &[u8], n: usize) -> Result<T> {
    let what = "what a tile left for its parent";
    let mut bytes = Vec::new();
    // A summary with 64-bit samples, blocks and errors of patches as small as 4 is below this.
    frame::decompress(packed, 0..=(n + 2) * (n + 2) * 64 + 4096, what, &mut bytes)?;
    decode(&bytes, what)
}

/// Numbers that differ little from one to the next: their differences, byte plane by byte plane,
/// pack well.
pub fn planes(numbers: &[i32]) -> Vec<u8> {
    let before = std::iter::once(&0).chain(numbers);
    let zigzag: Vec<u32> = numbers
        .iter()
        .zip(before)
        .map(|(number, before)| {
            let step = number.wrapping_sub(*before);
            ((step << 1) ^ (step >> 31)) as u32
        })
        .collect();
    [0, 8, 16, 24].iter().flat_map(|shift| zigzag.iter().map(move |number| (number >> shift) as u8)).collect()
}

/// The inverse of [`planes`], of `count` numbers.
pub fn from_planes(bytes: &[u8], count: usize) -> Result<Vec<i32>> {
    if bytes.len() != 4 * count {
        return Err(Error::format(
            "work folder",
            format!("{count} numbers"),
            format!("{} bytes", bytes.len()),
        ));
    }
    let (a, rest) = bytes.split_at(count);
    let (b, rest) = rest.split_at(count);
    let (c, d) = rest.split_at(count);
    let mut before = 0_i32;
    let numbers = a.iter().zip(b).zip(c.iter().zip(d)).map(|((&a, &b), (&c, &d))| {
        let zigzag = u32::from_le_bytes([a, b, c, d]);
        before = before.wrapping_add((zigzag >> 1) as i32 ^ -((zigzag & 1) as i32));
        before
    });
    Ok(numbers.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::Part;

    #[test]
    fn a_length_that_lies_takes_no_memory() {
        // Strings of strings, of which a list is allocated before its elements are read.
        for count in [1_000, 1 << 20, 1 << 40, u64::MAX] {
            let mut bytes = count.to_le_bytes().to_vec();
            bytes.extend([0; 40]);
            let (few, more): (Result<Vec<Part>>, Result<Vec<f64>>) =
                (decode(&bytes, "parts"), decode(&bytes, "numbers"));
            assert!(few.is_err() && more.is_err(), "{count}");
            let refused = few.expect_err("refused").to_string();
            // What would take more than 64 KiB is refused before it is allocated.
            let limited = refused.contains("preallocation limit") || refused.contains("limit");
            assert!(count < 2_000 || limited, "{count}: {refused}");
        }
    }

    #[test]
    fn long_lists_come_back_within_the_limit_of_their_bytes() {
        for count in [0, 1, 300, 4_000, 100_000] {
            let parts = vec![Part::default(); count];
            let bytes = encode(&parts).expect("bytes");
            assert_eq!(decode::<Vec<Part>>(&bytes, "parts").expect("parts"), parts);
            for end in [bytes.len() / 2, bytes.len().saturating_sub(1)] {
                assert!(end == bytes.len() || decode::<Vec<Part>>(&bytes[..end], "parts").is_err());
            }
        }
    }

    #[test]
    fn planes_come_back() {
        let numbers = [0, -1, i32::MAX, i32::MIN, 7, 7];
        assert_eq!(from_planes(&planes(&numbers), numbers.len()).expect("numbers"), numbers);
        assert!(from_planes(&planes(&numbers), 5).is_err());
    }
}
