//! Where the blocks lie in the file, and what is done where the file does not say how long they
//! are.

use std::collections::HashSet;

use tiff::tags::Tag;

use super::{Compression, Layout};
use crate::error::{Error, Result};
use crate::source::tiff::directory::{Directory, Reader, place};

impl Layout {
    /// Reads offsets and byte counts of all blocks.
    pub(super) fn read_blocks(&mut self, reader: &mut Reader<'_>, directory: &Directory) -> Result<()> {
        // Some writers put those of tiles under the tags of strips. libtiff takes either, of both
        // the later.
        let offsets = directory.later(Tag::TileOffsets, Tag::StripOffsets);
        let counts = directory.later(Tag::TileByteCounts, Tag::StripByteCounts);
        let blocks = u64::from(self.across) * u64::from(self.down) * u64::from(self.planes());
        // Bands that lie apart follow one another.
        let skip = if self.all_bands || self.bands > 1 { 0 } else { u64::from(self.band) * blocks };
        let missing = |got: &dyn std::fmt::Display| {
            Error::format(place(offsets), format!("{} blocks", skip + blocks), got)
        };
        let mut starts = reader.integers(directory, offsets)?.ok_or_else(|| missing(&"no such tag"))?;
        if (starts.len() as u64) < skip + blocks {
            return Err(missing(&starts.len()));
        }
        // Not more than there are offsets, which the file has.
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

    /// Puts a byte count in place of each that is 0 although the block has an offset: a block that
    /// a sparse file does not have has neither.
    ///
    /// Blocks that are not compressed are as long as their samples; others reach to the next one at
    /// most, and what stands behind the end of one is ignored when it is decoded.
    fn estimate(&self, offsets: &[u64], counts: &mut [u64], file: u64) {
        let is_plain = self.compression == Compression::None;
        let bytes_of = |index: usize| {
            let row = (index as u64 / u64::from(self.across) % u64::from(self.down)) as u32;
            self.row_bytes().saturating_mul(u64::from(self.coded_rows(row)))
        };
        // As libtiff: the count of a single strip is not believed if it is too short for the
        // samples.
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
            // Where another block begins as well there is nothing of this one.
            if !unknown(index, counts) || stated.contains(&start) {
                continue;
            }
            let next = starts.get(starts.partition_point(|&other| other <= start)).copied().unwrap_or(file);
            // At least one byte: what begins behind the end of the file is damage, not a block that
            // is not there.
            let most = next.min(file).saturating_sub(start).max(1);
            counts[index] = if is_plain { bytes_of(index) } else { most };
        }
    }
}
