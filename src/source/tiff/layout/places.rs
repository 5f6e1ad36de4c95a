//! Offsets and lengths of blocks, and estimates where the file does not give a length.

use std::collections::HashSet;

use tiff::tags::Tag;

use super::{Compression, Layout};
use crate::error::{Error, Result};
use crate::source::tiff::directory::{Directory, Reader, place};

impl Layout {
    /// Reads offsets and byte counts of all blocks.
    pub(super) fn read_blocks(&mut self, reader: &mut Reader<'_>, directory: &Directory) -> Result<()> {
        // Some writers store tiles under the tags of strips. Like libtiff, either is accepted; of
        // both, the later.
        let offsets = directory.later(Tag::TileOffsets, Tag::StripOffsets);
        let counts = directory.later(Tag::TileByteCounts, Tag::StripByteCounts);
        let blocks = u64::from(self.across) * u64::from(self.down) * u64::from(self.planes());
        // Blocks of separate bands are stored band by band.
        let skip = if self.all_bands || self.bands > 1 { 0 } else { u64::from(self.band) * blocks };
        let missing = |got: &dyn std::fmt::Display| {
            Error::format(place(offsets), format!("{} blocks", skip + blocks), got)
        };
        let mut starts = reader.integers(directory, offsets)?.ok_or_else(|| missing(&"no such tag"))?;
        if (starts.len() as u64) < skip + blocks {
            return Err(missing(&starts.len()));
        }
        // Never more counts than there are offsets in the file.
        let mut lengths = reader.integers(directory, counts)?.unwrap_or_default();
        lengths.resize(starts.len(), 0);
        self.estimate(&starts, &mut lengths, reader.file_bytes());
        for places in [&mut starts, &mut lengths] {
            places.truncate((skip + blocks) as usize);
            drop(places.drain(..skip as usize));
        }
        (self.offsets, self.counts) = (starts, lengths);
        Ok(())
    }

    /// Estimates the byte count of each block that has an offset but no count; a block missing from
    /// a sparse file has neither.
    ///
    /// An uncompressed block is as long as its samples. Another extends at most to the next block,
    /// and bytes behind its end are ignored when it is decoded.
    fn estimate(&self, offsets: &[u64], counts: &mut [u64], file: u64) {
        let is_plain = self.compression == Compression::None;
        let bytes_of = |index: usize| {
            let row = (index as u64 / u64::from(self.across) % u64::from(self.down)) as u32;
            self.row_bytes().saturating_mul(u64::from(self.coded_rows(row)))
        };
        // As in libtiff, the count of a single strip is ignored if it is too short for the samples.
        if is_plain && !self.tiled && self.down == 1 && offsets[0] != 0 {
            counts[0] = counts[0].max(bytes_of(0));
        }
        let unknown = |index: usize, counts: &[u64]| counts[index] == 0 && offsets[index] != 0;
        if !(0..offsets.len()).any(|index| unknown(index, counts)) {
            return;
        }
        let mut starts = offsets.to_vec();
        starts.sort_unstable();
        let stated: HashSet<u64> =
            (0..offsets.len()).filter(|&index| counts[index] != 0).map(|index| offsets[index]).collect();
        for index in 0..offsets.len() {
            let start = offsets[index];
            // A block that begins where one with a stated length begins is empty.
            if !unknown(index, counts) || stated.contains(&start) {
                continue;
            }
            let next = starts.get(starts.partition_point(|&other| other <= start)).copied().unwrap_or(file);
            // At least one byte: a block that begins behind the end of the file is damaged, not
            // missing.
            let most = next.min(file).saturating_sub(start).max(1);
            counts[index] = if is_plain { bytes_of(index) } else { most };
        }
    }
}
