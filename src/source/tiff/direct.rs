//! Reads uncompressed samples from the file directly into their destination.
//!
//! Consecutive whole rows of a single band are read in long runs, divided among the threads.
//! Otherwise only the wanted part of each row is read, or several rows at once if nearly all of a
//! row is wanted.

use std::ops::Range;

use rayon::prelude::*;
use zerocopy::IntoBytes;

use super::blocks::Band;
use super::decode::{self, Buffers};
use super::layout::Layout;
use super::parts::{BlockWindow, Number};
use crate::error::{Error, Result};

/// Bytes of one read: many enough to make the call cheap, few enough for fast caches and several
/// threads.
pub(super) const READ_BYTES: usize = 512 << 10;

/// Consecutive rows in the file; `None` where a sparse file lacks them.
struct Run {
    start: Option<u64>,
    rows: Range<u32>,
}

/// Fails unless the file has all rows of a block that lie in the raster.
fn check(band: &Band, block: usize) -> Result<()> {
    let layout = &band.layout;
    let row = (block / layout.across as usize) as u32;
    let needed = layout.row_bytes().saturating_mul(u64::from(layout.raster_rows(row)));
    let there = layout.counts[block].min(band.file.length().saturating_sub(layout.offsets[block]));
    if there < needed {
        let got = format!("{there} bytes (the file is cut off, or damaged: get it again)");
        return Err(Error::format(layout.block_name(block), format!("{needed} bytes"), got));
    }
    Ok(())
}

/// Reads whole rows of strips with a single band.
pub(super) fn rows<T: Number>(band: &Band, rows: &Range<u32>, out: &mut [T], fill: T) -> Result<()> {
    let width = band.layout.width as usize;
    let mut rest = out;
    let mut work = Vec::new();
    for run in runs(band, rows)? {
        let (own, others) = rest.split_at_mut(run.rows.len() * width);
        work.push((run, own));
        rest = others;
    }
    let read = |(run, out): (Run, &mut [T])| match run.start {
        None => {
            out.fill(fill);
            Ok(())
        }
        Some(start) => {
            let strip = (run.rows.start / band.layout.block_height) as usize;
            let bytes = out.as_mut_bytes();
            band.file.read(bytes, start, &|| strips(&band.layout, strip, &run.rows))?;
            if band.layout.swapped {
                decode::swap(bytes, size_of::<T>());
            }
            Ok(())
        }
    };
    let done: Vec<Result<()>> = work.into_par_iter().map(read).collect();
    done.into_iter().collect()
}

/// Names strips by their rows, for messages.
fn strips(layout: &Layout, first: usize, rows: &Range<u32>) -> String {
    format!("rows {} to {} (from {})", rows.start, rows.end - 1, layout.block_name(first))
}

fn runs(band: &Band, rows: &Range<u32>) -> Result<Vec<Run>> {
    let layout = &band.layout;
    let row_bytes = layout.row_bytes();
    let mut runs: Vec<Run> = Vec::new();
    for y in rows.clone() {
        let (strip, inside) = ((y / layout.block_height) as usize, y % layout.block_height);
        let absent = layout.counts[strip] == 0;
        if !absent && (y == rows.start || inside == 0) {
            check(band, strip)?;
        }
        let start = (!absent).then(|| layout.offsets[strip] + u64::from(inside) * row_bytes);
        if let Some(run) = runs.last_mut() {
            let bytes = run.rows.len() as u64 * row_bytes;
            if run.start.map(|start| start + bytes) == start && bytes + row_bytes <= READ_BYTES as u64 {
                run.rows.end += 1;
                continue;
            }
        }
        runs.push(Run { start, rows: y..y + 1 });
    }
    Ok(runs)
}

/// Reads any window, block by block.
pub(super) fn parts<T: Number>(band: &Band, parts: Vec<BlockWindow<'_, T>>, fill: T) -> Result<()> {
    let done: Vec<Result<()>> = parts.into_par_iter().map(|part| self::part(band, part, fill)).collect();
    done.into_iter().collect()
}

fn part<T: Number>(band: &Band, mut part: BlockWindow<'_, T>, fill: T) -> Result<()> {
    let layout = &band.layout;
    if layout.counts[part.block] == 0 {
        part.fill(fill);
        return Ok(());
    }
    check(band, part.block)?;
    let (row_bytes, pixel) = (layout.row_bytes(), layout.bands as usize * size_of::<T>());
    let wanted = part.rows.first().map_or(0, |row| row.len());
    // Rows of one read: several if little between their wanted parts is unwanted.
    let together = if 2 * (wanted * pixel) as u64 > row_bytes { READ_BYTES as u64 / row_bytes } else { 1 };
    let together = usize::try_from(together).unwrap_or(usize::MAX).clamp(1, part.rows.len().max(1));
    let first = layout.offsets[part.block] + u64::from(part.top) * row_bytes;
    let first = first + u64::from(part.left) * pixel as u64 + u64::from(layout.place) * size_of::<T>() as u64;
    let read = |(index, rows): (usize, &mut [&mut [T]])| {
        let start = first + (index * together) as u64 * row_bytes;
        let name = || layout.block_name(part.block);
        match rows {
            [row] if layout.bands == 1 => {
                let bytes = row.as_mut_bytes();
                band.file.read(bytes, start, &name)?;
                if layout.swapped {
                    decode::swap(bytes, size_of::<T>());
                }
                Ok(())
            }
            [row] => row.chunks_mut((READ_BYTES / pixel).max(1)).enumerate().try_for_each(|(at, out)| {
                let start = start + (at * (READ_BYTES / pixel).max(1) * pixel) as u64;
                gather(band, start, &mut [out], &name)
            }),
            rows => gather(band, start, rows, &name),
        }
    };
    let done: Vec<Result<()>> = part.rows.par_chunks_mut(together).enumerate().map(read).collect();
    done.into_iter().collect()
}

/// Reads rows of a block through a buffer.
fn gather<T: Number>(
    band: &Band,
    start: u64,
    rows: &mut [&mut [T]],
    name: &dyn Fn() -> String,
) -> Result<()> {
    let layout = &band.layout;
    let (size, stride) = (size_of::<T>(), layout.bands as usize * size_of::<T>());
    let between = layout.row_bytes() as usize;
    let length = rows.first().map_or(0, |row| (row.len() - 1) * stride + size);
    Band::with_buffers(|Buffers { packed, .. }| {
        decode::resize(packed, (rows.len() - 1) * between + length)?;
        band.file.read(packed, start, name)?;
        for (index, row) in rows.iter_mut().enumerate() {
            let (from, to) = (&packed[index * between..][..length], row.as_mut_bytes());
            if stride == size {
                to.copy_from_slice(from);
            } else {
                for (to, from) in to.chunks_exact_mut(size).zip(from.chunks(stride)) {
                    to.copy_from_slice(&from[..size]);
                }
            }
            if layout.swapped {
                decode::swap(to, size);
            }
        }
        Ok(())
    })
}
