//! The error table of a tile (`format-spec.md`, section 10).

use crate::codec::{bits, frame};
use crate::error::{Error, Result};
use crate::error_code::MAX_CODE;

/// Geometric errors of the patches of one tile, as codes of [`crate::error_code`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ErrorTable {
    /// Patches on a side of the tile.
    pub patches: usize,
    /// Steps of a patch: `p + 1`.
    pub steps: usize,
    /// Which patches have a valid sample; row by row from the north-west, `patches^2`.
    pub drawable: Vec<bool>,
    /// Vertical errors by step, patch row, patch column: `steps * patches^2`, never smaller at a
    /// later step.
    pub vertical: Vec<u16>,
    /// Horizontal errors, in the same order.
    pub horizontal: Vec<u16>,
}

impl ErrorTable {
    /// Index of a step of the patch in column `x`, row `y`.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// let errors = reader.read_errors(TileId::ROOT)?;
    /// // The last patch of the last step is the last value of a table.
    /// assert_eq!(errors.at(2, 3, 3), errors.vertical.len() - 1);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    #[inline]
    pub fn at(&self, step: usize, x: usize, y: usize) -> usize {
        (step * self.patches + y) * self.patches + x
    }
}

/// Appends the errors chunk of a table.
#[cfg(feature = "write")]
pub fn encode(table: &ErrorTable, out: &mut Vec<u8>) -> Result<()> {
    let count = table.patches * table.patches;
    let sizes = [table.vertical.len(), table.horizontal.len()];
    if count == 0 || table.drawable.len() != count || sizes != [count * table.steps; 2] {
        return Err(Error::usage("an error table's planes do not have the size of its patches and steps"));
    }
    let mut bytes = Vec::with_capacity(content_length(count, table.steps));
    bits::pack(&table.drawable.iter().map(|&bit| u8::from(bit)).collect::<Vec<_>>(), &mut bytes);
    for plane in [&table.vertical, &table.horizontal] {
        let increases = increases(plane, count)?;
        bytes.extend(increases.iter().map(|&increase| increase as u8));
        bytes.extend(increases.iter().map(|&increase| (increase >> 8) as u8));
    }
    frame::compress(&bytes, out)
}

/// The table of an errors chunk, of `patches` patches on a side and `steps` steps.
pub fn decode(chunk: &[u8], patches: usize, steps: usize) -> Result<ErrorTable> {
    let count = patches * patches;
    let length = content_length(count, steps);
    let mut bytes = Vec::new();
    frame::decompress(chunk, length..=length, "errors chunk", &mut bytes)?;
    let (drawable, planes) = bytes.split_at(count.div_ceil(8));
    let mut flags = Vec::new();
    bits::unpack(drawable, count, &mut flags)?;
    let mut sums = planes.chunks_exact((2 * count * steps).max(1)).map(|plane| sums(plane, count));
    let mut next = || sums.next().unwrap_or_else(|| Ok(Vec::new()));
    let (vertical, horizontal) = (next()?, next()?);
    Ok(ErrorTable {
        patches,
        steps,
        drawable: flags.iter().map(|&bit| bit == 1).collect(),
        vertical,
        horizontal,
    })
}

/// Bytes of a table before compression.
fn content_length(count: usize, steps: usize) -> usize {
    count.div_ceil(8) + 4 * count * steps
}

/// The errors of step 0, then the increase of each step over the one before.
fn increases(plane: &[u16], count: usize) -> Result<Vec<u16>> {
    let before = std::iter::repeat_n(&0, count).chain(plane);
    let increases = plane.iter().zip(before).map(|(code, before)| code.checked_sub(*before));
    increases
        .collect::<Option<_>>()
        .filter(|_| plane.iter().all(|&code| code <= MAX_CODE))
        .ok_or_else(|| Error::usage("an error table's errors shrink at a coarser step, or exceed infinity"))
}

/// The errors of the low bytes and then the high bytes of all increases: the inverse of
/// [`increases`].
fn sums(bytes: &[u8], count: usize) -> Result<Vec<u16>> {
    let (low, high) = bytes.split_at(bytes.len() / 2);
    let mut codes: Vec<u16> =
        low.iter().zip(high).map(|(&low, &high)| u16::from_le_bytes([low, high])).collect();
    for at in 0..codes.len() {
        let before = if at < count { 0 } else { codes[at - count] };
        let sum = u32::from(before) + u32::from(codes[at]);
        if sum > u32::from(MAX_CODE) {
            return Err(Error::format(
                "errors chunk",
                format!("errors up to {MAX_CODE:#06x}"),
                format!("{sum:#06x}"),
            ));
        }
        codes[at] = sum as u16;
    }
    Ok(codes)
}
