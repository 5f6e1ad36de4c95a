//! Whole rows of one band, gathered from its blocks.
//!
//! Blocks are decoded in parallel, uncompressed ones are read where they lie. The decoded blocks that a sweep from
//! north to south will want again (those under the rows that consecutive bands share) are kept, and no others, so
//! that no block is decoded twice and memory is bounded by one band and one row of blocks. The result does not
//! depend on the number of threads, nor does the error: the first damaged block in file order is reported.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::decode;
use super::layout::Layout;
use super::mmap::Map;
use crate::error::{Error, Result};

/// A number as it lies in memory.
pub(super) trait Number: Copy + Send + Sync {
    /// Bytes of one.
    const BYTES: usize;
    /// From this machine's byte order, or from the other one.
    fn load(bytes: &[u8], swapped: bool) -> Self;
}

macro_rules! number {
    ($($kind:ty),*) => {$(
        impl Number for $kind {
            const BYTES: usize = size_of::<$kind>();
            #[inline]
            fn load(bytes: &[u8], swapped: bool) -> Self {
                let mut own = [0; size_of::<$kind>()];
                own.copy_from_slice(bytes);
                if swapped {
                    own.reverse();
                }
                <$kind>::from_ne_bytes(own)
            }
        }
    )*};
}
number!(i8, u8, i16, u16, i32, u32, f32, f64);

/// A block ready to be copied from.
#[derive(Clone)]
enum Block {
    /// One band, this machine's byte order, `block_width` samples a row.
    Decoded(Arc<Vec<u8>>),
    /// Starts here in the file.
    Direct(usize),
    /// Not in the file: all samples have the fill value.
    Absent,
}

/// One band of one image.
pub(super) struct Band {
    map: Arc<Map>,
    pub(super) layout: Layout,
    kept: Mutex<Kept>,
    #[cfg(test)]
    pub(super) decoded: std::sync::atomic::AtomicUsize,
}

/// Decoded blocks for the next call.
#[derive(Default)]
struct Kept {
    blocks: BTreeMap<usize, Block>,
    last: Option<Range<u32>>,
    /// Most rows that two consecutive bands had in common; unknown before the second band.
    overlap: Option<u32>,
}

impl Band {
    pub(super) fn new(map: Arc<Map>, layout: Layout) -> Self {
        Self {
            map,
            layout,
            kept: Mutex::default(),
            #[cfg(test)]
            decoded: std::sync::atomic::AtomicUsize::new(0),
        }
    }

    /// Samples of whole rows, which must lie inside the raster; `fill` where a sparse file has no block.
    pub(super) fn rows<T: Number>(&self, rows: Range<u32>, fill: T) -> Result<Vec<T>> {
        if rows.is_empty() {
            return Ok(Vec::new());
        }
        let layout = &self.layout;
        let first_row = rows.start / layout.block_height;
        let blocks = self.blocks(first_row..(rows.end - 1) / layout.block_height + 1)?;
        let width = layout.width as usize;
        let count = width.saturating_mul(rows.len());
        let mut samples = Vec::new();
        samples.try_reserve_exact(count).map_err(|_| {
            Error::usage(format!("not enough memory for {} rows of {width} samples", rows.len()))
        })?;
        samples.resize(count, fill);
        samples.par_chunks_mut(width).zip(rows.clone()).for_each(|(out, y)| {
            let at = (y / layout.block_height - first_row) as usize * layout.across as usize;
            self.copy_row(&blocks[at..at + layout.across as usize], y % layout.block_height, out);
        });
        self.keep(rows, first_row, blocks);
        Ok(samples)
    }

    /// Row `y` of a row of blocks.
    fn copy_row<T: Number>(&self, blocks: &[Block], y: u32, out: &mut [T]) {
        let layout = &self.layout;
        let (columns, y) = (layout.block_width as usize, y as usize);
        for (block, out) in blocks.iter().zip(out.chunks_mut(columns)) {
            match block {
                Block::Absent => {}
                Block::Decoded(bytes) => {
                    let from = y * columns * T::BYTES;
                    copy(&bytes[from..from + out.len() * T::BYTES], 1, false, out);
                }
                Block::Direct(start) => {
                    let bands = layout.bands as usize;
                    let from = start + y * layout.row_bytes() as usize;
                    let bytes = &self.map.bytes()[from..from + ((out.len() - 1) * bands + 1) * T::BYTES];
                    copy(bytes, bands, layout.swapped, out);
                }
            }
        }
    }

    /// All blocks of some rows of blocks.
    fn blocks(&self, block_rows: Range<u32>) -> Result<Vec<Block>> {
        let across = self.layout.across as usize;
        let range = block_rows.start as usize * across..block_rows.end as usize * across;
        // The lock is not held while threads work: one of them might come back here.
        let kept: BTreeMap<usize, Block> = {
            let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
            kept.blocks.range(range.clone()).map(|(&index, block)| (index, block.clone())).collect()
        };
        let blocks: Vec<Result<Block>> = range
            .into_par_iter()
            .map(|index| kept.get(&index).map_or_else(|| self.block(index), |block| Ok(block.clone())))
            .collect();
        blocks.into_iter().collect()
    }

    fn block(&self, index: usize) -> Result<Block> {
        let layout = &self.layout;
        let count = layout.counts[index];
        if count == 0 {
            return Ok(Block::Absent);
        }
        let name = || layout.block_name(index);
        let file = self.map.bytes();
        let start = layout.offsets[index];
        let row = (index / layout.across as usize) as u32;
        let end = start.checked_add(count).filter(|&end| end <= file.len() as u64);
        if layout.is_direct() {
            let needed = layout.row_bytes().saturating_mul(u64::from(layout.raster_rows(row)));
            let there = count.min((file.len() as u64).saturating_sub(start));
            if there < needed {
                return Err(Error::format(name(), format!("{needed} bytes"), format!("{there} bytes")));
            }
            return Ok(Block::Direct(start as usize));
        }
        let Some(end) = end else {
            let there = (file.len() as u64).saturating_sub(start);
            let expected = format!("{count} bytes of the file");
            return Err(Error::format(name(), expected, format!("{there} bytes up to its end")));
        };
        #[cfg(test)]
        self.decoded.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let packed = &file[start as usize..end as usize];
        decode::block(layout, packed, layout.coded_rows(row), &name)
            .map(|bytes| Block::Decoded(Arc::new(bytes)))
    }

    /// Keeps what the next band of a sweep needs.
    fn keep(&self, rows: Range<u32>, first_row: u32, blocks: Vec<Block>) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(last) = &kept.last
            && (last.start..=last.end).contains(&rows.start)
        {
            let common = last.end - rows.start;
            kept.overlap = Some(kept.overlap.unwrap_or(0).max(common));
        }
        let from = match kept.overlap {
            None => rows.start,
            Some(overlap) => rows.end - overlap.clamp(1, rows.len() as u32),
        };
        let skip = (from / self.layout.block_height - first_row) as usize * self.layout.across as usize;
        let base = first_row as usize * self.layout.across as usize;
        kept.blocks =
            (base..).zip(blocks).skip(skip).filter(|(_, block)| matches!(block, Block::Decoded(_))).collect();
        kept.last = Some(rows);
    }
}

/// Every `stride`th number.
#[inline]
fn copy<T: Number>(bytes: &[u8], stride: usize, swapped: bool, out: &mut [T]) {
    if stride == 1 && !swapped {
        for (to, from) in out.iter_mut().zip(bytes.chunks_exact(T::BYTES)) {
            *to = T::load(from, false);
        }
    } else {
        for (to, from) in out.iter_mut().zip(bytes.chunks(T::BYTES * stride)) {
            *to = T::load(&from[..T::BYTES], swapped);
        }
    }
}
