//! Windows of one band, assembled from its blocks.
//!
//! Blocks are decoded in parallel, straight into the window; uncompressed ones are read by
//! `direct`. A sweep from north to south keeps exactly those decoded blocks that it will need
//! again, under the rows that consecutive bands share. So no block is decoded twice, and memory is
//! bounded by one band and one row of blocks. Neither the result nor the error depends on the
//! number of threads: the first damaged block in file order is reported.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::decode::{self, Buffers};
use super::direct::{self, READ_BYTES};
use super::file::TiffFile;
use super::layout::{Layout, Stored};
use super::parts::{self, BlockWindow, Number};
use crate::error::{Error, Result};
use crate::source::ReadMemory;

/// Most sweeps, over different columns, that are tracked at a time.
const SWEEPS: usize = 4;

/// Most bytes that the system is asked to prefetch for the next window.
const AHEAD: u64 = 64 << 20;

/// Buffers not in use by a decoding thread, shared by all rasters since a mosaic has hundreds open.
static BUFFERS: Mutex<Vec<Buffers>> = Mutex::new(Vec::new());

/// Buffers of more bytes are freed rather than kept.
const LARGE: usize = 16 << 20;

/// Most bytes read of a packed block that decodes to `decoded` bytes: no encoder needs more than
/// twice as many, and anything behind the end is not needed.
fn most_packed(decoded: u64) -> u64 {
    decoded.saturating_mul(2).saturating_add(1 << 16)
}

/// A decoded block.
type Block = Arc<Vec<u8>>;

/// One band of one image.
pub(super) struct Band {
    pub(super) file: Arc<TiffFile>,
    pub(super) layout: Layout,
    /// Sweeps in progress, the most recent last.
    sweeps: Mutex<Vec<Sweep>>,
    /// Memory of dropped blocks, for reuse.
    free: Mutex<Vec<Vec<u8>>>,
    #[cfg(test)]
    pub(super) decoded: std::sync::atomic::AtomicUsize,
}

/// A sweep: consecutive bands over the same columns, and decoded blocks for the next band.
struct Sweep {
    columns: Range<u32>,
    blocks: BTreeMap<usize, Block>,
    last: Range<u32>,
    /// Most rows that two consecutive bands shared; `None` before the second band.
    overlap: Option<u32>,
}

impl Sweep {
    /// Advances to a band of `rows`; returns the first row whose blocks the next band needs again.
    fn advance(&mut self, rows: &Range<u32>) -> u32 {
        if (self.last.start..=self.last.end).contains(&rows.start) && !self.last.is_empty() {
            let common = self.last.end - rows.start;
            self.overlap = Some(self.overlap.unwrap_or(0).max(common));
        }
        self.last = rows.clone();
        self.overlap.map_or(rows.start, |overlap| rows.end - overlap.clamp(1, rows.len() as u32))
    }
}

impl Band {
    pub(super) fn new(file: Arc<TiffFile>, layout: Layout) -> Self {
        Self {
            file,
            layout,
            sweeps: Mutex::default(),
            free: Mutex::default(),
            #[cfg(test)]
            decoded: std::sync::atomic::AtomicUsize::new(0),
        }
    }

    /// Reads a window, which must lie inside the raster, into `samples`; blocks missing from a
    /// sparse file become `fill`.
    pub(super) fn window<T: Number>(
        &self,
        columns: &Range<u32>,
        rows: &Range<u32>,
        fill: T,
        samples: &mut Vec<T>,
    ) -> Result<()> {
        let layout = &self.layout;
        parts::room(samples, columns, rows)?;
        if samples.is_empty() {
            return Ok(());
        }
        // Sweeps go from north to south, so the system can prefetch the next window.
        let next = rows.end..rows.end.saturating_add(rows.len() as u32).min(layout.height);
        if let Some(Range { start, end }) = layout.span(columns, &next) {
            self.file.will_need(start..end.min(start.saturating_add(AHEAD)));
        }
        if layout.is_direct() && !layout.tiled && layout.bands == 1 && columns.len() == layout.width as usize
        {
            return direct::rows(self, rows, samples, fill);
        }
        let parts = parts::split(layout, columns, rows, samples);
        if layout.is_direct() {
            direct::parts(self, parts, fill)
        } else {
            self.decode_parts(columns, rows, parts, fill)
        }
    }

    /// Memory that reading takes; see [`ReadMemory`].
    pub(super) fn reading(&self) -> ReadMemory {
        let layout = &self.layout;
        let sample = match layout.stored {
            Stored::Bit => 1,
            Stored::Number(kind) => kind.bytes() as u64,
        };
        if layout.is_direct() {
            return ReadMemory { thread: 2 * READ_BYTES as u64, ..ReadMemory::plain(sample) };
        }
        let rows = u64::from(layout.block_height.min(layout.height.max(1)));
        let rows = if layout.tiled { u64::from(layout.block_height) } else { rows };
        let stored = layout.row_bytes().saturating_mul(rows);
        let bits =
            if layout.stored == Stored::Bit { u64::from(layout.block_width).saturating_mul(rows) } else { 0 };
        let block = stored.max(bits);
        let packed = layout.counts.iter().copied().max().unwrap_or(0).min(most_packed(stored));
        let column = (u64::from(layout.across) as f64) * block as f64 / f64::from(layout.width.max(1));
        // If bits are unpacked or bytes reordered in the last block, there is a second buffer
        // beside the first.
        let thread = packed.saturating_add(block).saturating_add(stored.min(bits).max(layout.row_bytes()));
        ReadMemory { sample, column, block, thread }
    }

    /// Drops the kept blocks.
    pub(super) fn release(&self) {
        self.sweeps.lock().unwrap_or_else(PoisonError::into_inner).clear();
        self.free.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// Lends the buffers of one thread to `work`.
    pub(super) fn with_buffers<R>(work: impl FnOnce(&mut Buffers) -> R) -> R {
        let lock = || BUFFERS.lock().unwrap_or_else(PoisonError::into_inner);
        let buffers = lock().pop();
        let mut buffers = buffers.unwrap_or_default();
        let result = work(&mut buffers);
        if buffers.bytes() <= LARGE {
            lock().push(buffers);
        }
        result
    }

    fn decode_parts<T: Number>(
        &self,
        columns: &Range<u32>,
        rows: &Range<u32>,
        parts: Vec<BlockWindow<'_, T>>,
        fill: T,
    ) -> Result<()> {
        let (kept, keep_from) = self.begin(columns, rows);
        let read = |mut part: BlockWindow<'_, T>| {
            let index = part.block;
            if self.layout.counts[index] == 0 {
                part.fill(fill);
                return Ok(None);
            }
            let block_row = index as u64 / u64::from(self.layout.across);
            let keep = (block_row + 1) * u64::from(self.layout.block_height) > u64::from(keep_from);
            if let Some(block) = kept.get(&index) {
                part.copy(&self.layout, block);
                return Ok(keep.then(|| (index, Arc::clone(block))));
            }
            Self::with_buffers(|buffers| {
                self.decode(index, buffers)?;
                part.copy(&self.layout, &buffers.bytes);
                Ok(keep.then(|| (index, Arc::new(std::mem::replace(&mut buffers.bytes, self.memory())))))
            })
        };
        let read: Vec<Result<Option<(usize, Block)>>> = parts.into_par_iter().map(read).collect();
        let blocks = read.into_iter().filter_map(Result::transpose).collect::<Result<_>>();
        drop(kept);
        self.end(columns, blocks?);
        Ok(())
    }

    /// Decodes a block that the file has.
    pub(super) fn decode(&self, index: usize, buffers: &mut Buffers) -> Result<()> {
        let layout = &self.layout;
        let (start, count) = (layout.offsets[index], layout.counts[index]);
        let name = || layout.block_name(index);
        if start.checked_add(count).is_none_or(|end| end > self.file.length()) {
            let there = self.file.length().saturating_sub(start);
            let got = format!("{there} bytes up to its end (it is cut off, or damaged: get it again)");
            return Err(Error::format(name(), format!("{count} bytes of the file"), got));
        }
        let rows = layout.coded_rows((index / layout.across as usize) as u32 % layout.down);
        let most = most_packed(layout.row_bytes() * u64::from(rows));
        decode::resize(&mut buffers.packed, count.min(most) as usize)?;
        self.file.read(&mut buffers.packed, start, &name)?;
        if layout.reversed {
            buffers.packed.iter_mut().for_each(|byte| *byte = byte.reverse_bits());
        }
        #[cfg(test)]
        self.decoded.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        decode::block(layout, buffers, rows, &name)
    }

    /// The blocks kept for a band, and the first row whose blocks are to be kept for the next.
    fn begin(&self, columns: &Range<u32>, rows: &Range<u32>) -> (BTreeMap<usize, Block>, u32) {
        // The lock is not held while threads work: one of them might come back here.
        let mut sweeps = self.sweeps.lock().unwrap_or_else(PoisonError::into_inner);
        let mut sweep = match sweeps.iter().position(|sweep| sweep.columns == *columns) {
            Some(at) => sweeps.remove(at),
            None => Sweep { columns: columns.clone(), blocks: BTreeMap::new(), last: 0..0, overlap: None },
        };
        let keep_from = sweep.advance(rows);
        // Blocks above these rows are not needed again, and one may be as large as the raster.
        sweeps.retain(|sweep| sweep.last.end >= rows.start);
        let kept = sweep.blocks.clone();
        if sweeps.len() == SWEEPS {
            sweeps.remove(0);
        }
        sweeps.push(sweep);
        (kept, keep_from)
    }

    /// Stores the blocks that the next band of a sweep needs, and the memory of the others.
    fn end(&self, columns: &Range<u32>, blocks: BTreeMap<usize, Block>) {
        let mut sweeps = self.sweeps.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(sweep) = sweeps.iter_mut().find(|sweep| sweep.columns == *columns) else { return };
        let old = std::mem::replace(&mut sweep.blocks, blocks);
        drop(sweeps);
        let free = old.into_values().filter_map(Arc::into_inner).collect();
        *self.free.lock().unwrap_or_else(PoisonError::into_inner) = free;
    }

    /// A buffer for a block, reused if possible.
    fn memory(&self) -> Vec<u8> {
        self.free.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }
}
