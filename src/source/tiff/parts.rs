//! Divides a window of a raster by the blocks that it meets.

use std::ops::Range;

use zerocopy::{FromBytes, Immutable, IntoBytes};

use super::layout::Layout;
use crate::error::{Error, Result};

/// A number as it lies in memory; any bit pattern is valid.
pub(super) trait Number: Copy + PartialEq + Send + Sync + FromBytes + IntoBytes + Immutable {}

impl<T: Copy + PartialEq + Send + Sync + FromBytes + IntoBytes + Immutable> Number for T {}

/// The part of a window that lies in one block.
pub(super) struct BlockWindow<'a, T> {
    /// Index of the block.
    pub(super) block: usize,
    /// First wanted row of the block.
    pub(super) top: u32,
    /// First wanted column of the block.
    pub(super) left: u32,
    /// Destination rows of the wanted samples.
    pub(super) rows: Vec<&'a mut [T]>,
}

impl<T: Number> BlockWindow<'_, T> {
    /// Copies the samples from a decoded block of one band.
    pub(super) fn copy(&mut self, layout: &Layout, bytes: &[u8]) {
        let row_bytes = layout.block_width as usize * size_of::<T>();
        let from = self.top as usize * row_bytes + self.left as usize * size_of::<T>();
        for (row, bytes) in self.rows.iter_mut().zip(bytes[from..].chunks(row_bytes)) {
            let row = row.as_mut_bytes();
            row.copy_from_slice(&bytes[..row.len()]);
        }
    }

    /// Sets all samples to `value`, for a missing block.
    pub(super) fn fill(&mut self, value: T) {
        self.rows.iter_mut().for_each(|row| row.fill(value));
    }
}

/// Resizes `samples` for a window whose samples will all be overwritten. New memory comes zeroed
/// from the system, so it is not cleared twice.
pub(super) fn room<T: Number>(samples: &mut Vec<T>, columns: &Range<u32>, rows: &Range<u32>) -> Result<()> {
    let count = columns.len().saturating_mul(rows.len());
    if count <= samples.capacity() {
        samples.resize(count, T::new_zeroed());
        return Ok(());
    }
    *samples = Vec::new();
    *samples = T::new_vec_zeroed(count).map_err(|_| {
        let bytes = (count as u64).saturating_mul(size_of::<T>() as u64);
        Error::out_of_memory(format!("{} rows of {} samples", rows.len(), columns.len()), bytes)
    })?;
    Ok(())
}

/// Divides a non-empty window, whose samples are `out`, by blocks, in block order.
pub(super) fn split<'a, T>(
    layout: &Layout,
    columns: &Range<u32>,
    rows: &Range<u32>,
    out: &'a mut [T],
) -> Vec<BlockWindow<'a, T>> {
    let (width, height) = (layout.block_width, layout.block_height);
    let across = columns.start / width..(columns.end - 1) / width + 1;
    let mut parts: Vec<BlockWindow<'a, T>> = Vec::new();
    for (y, mut rest) in rows.clone().zip(out.chunks_exact_mut(columns.len())) {
        if y == rows.start || y % height == 0 {
            parts.extend(across.clone().map(|x| BlockWindow {
                block: (y / height) as usize * layout.across as usize + x as usize,
                top: y % height,
                left: columns.start.saturating_sub(x * width),
                rows: Vec::new(),
            }));
        }
        let first = parts.len() - across.len();
        for (part, x) in parts[first..].iter_mut().zip(across.clone()) {
            let end = u64::from(columns.end).min((u64::from(x) + 1) * u64::from(width)) as u32;
            let (own, others) = rest.split_at_mut((end - x * width - part.left) as usize);
            part.rows.push(own);
            rest = others;
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::super::layout::tests::layout;
    use super::*;

    #[test]
    fn every_sample_of_a_window_belongs_to_the_block_that_it_lies_in() {
        for (columns, rows) in [(0..10, 0..10), (3..7, 2..9), (4..8, 5..6), (9..10, 0..1), (2..3, 0..10)] {
            let mut out = vec![7_u32; 30];
            room(&mut out, &columns, &rows).expect("memory");
            let layout = layout(10, 10, 4, 3);
            let mut blocks = Vec::new();
            for mut part in split(&layout, &columns, &rows, &mut out) {
                blocks.push(part.block);
                let mut bytes = Vec::new();
                for y in 0..3 {
                    bytes.extend((0..4).flat_map(|x| (part.block as u32 * 100 + y * 10 + x).to_ne_bytes()));
                }
                part.copy(&layout, &bytes);
            }
            let mut expected = Vec::new();
            for y in rows {
                expected.extend(columns.clone().map(|x| (y / 3 * 3 + x / 4) * 100 + y % 3 * 10 + x % 4));
            }
            assert_eq!(out, expected);
            assert!(blocks.is_sorted());
        }
    }
}
