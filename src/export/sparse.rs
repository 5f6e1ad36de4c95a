//! Exports a level as a GeoTIFF of large blocks without those that have no valid sample: its size
//! follows the number of tiles, however large the raster is.

use std::collections::BTreeSet;
use std::ops::Range;

use rayon::prelude::*;

use super::{Void, samples};
use crate::container::reader::Reader;
use crate::error::{Error, Result};
use crate::geotiff_write::{BlockEncoder, GeotiffWriter};
use crate::sample::VALID;
use crate::tile::TileId;

/// Number of blocks above which larger ones are used.
const ENOUGH: u64 = 1 << 20;
/// Most blocks of a file: each takes 16 bytes of it, present or not.
const MOST: u64 = 1 << 22;
/// Most bytes of a block.
const BLOCK_BYTES: u64 = 128 << 20;
/// Bytes for each sample of the rows of a block in work: values, samples, and their bytes.
const WHILE_MADE: u64 = 16 + 8 + 8;
/// Bytes that a codec takes while it compresses.
const CODEC: u64 = 12 << 20;

/// Bytes for each block of a file, present or not: its place while others are written, then in the
/// directory.
const EACH: u64 = 80;
/// Bytes for each block in the list of those that have samples.
const WANTED: u64 = 64;

/// How a level is cut into blocks.
pub(super) struct Blocks {
    level: u8,
    /// Samples that a tile owns along a side.
    tile: u64,
    /// The last column and row of tiles.
    last: u64,
    /// Samples along a side of a block: a power of two of tiles.
    side: u64,
    columns: u64,
    rows: u64,
    sample_bytes: u64,
}

impl Blocks {
    /// The blocks of a level with this many columns and rows, and `sample_bytes` a sample.
    ///
    /// # Errors
    /// [`Error::Limit`] if there would be too many.
    pub(super) fn new(level: u8, tile: u32, (columns, rows): (u32, u32), sample_bytes: u64) -> Result<Self> {
        let [tile, columns, rows] = [tile, columns, rows].map(u64::from);
        let count = |side: u64| columns.div_ceil(side) * rows.div_ceil(side);
        let mut side = tile;
        while count(side) > ENOUGH && 4 * side * side * sample_bytes <= BLOCK_BYTES {
            side *= 2;
        }
        if count(side) > MOST {
            let what = format!(
                "blocks of {side} x {side} samples of a GeoTIFF of {columns} x {rows} (choose a coarser `level`, or a `tile`)"
            );
            return Err(Error::limit(format!("the number of {what}"), count(side), MOST));
        }
        Ok(Self { level, tile, last: (1 << level) - 1, side, columns, rows, sample_bytes })
    }

    /// Bytes for a block while it is made, in a level of `tiles` tiles: a row of its tiles, and all
    /// of its compressed data.
    pub(super) fn bytes(&self, tiles: u64) -> u64 {
        let block = self.side * self.side;
        let there = tiles.saturating_mul((self.tile + 1) * (self.tile + 1)).min(block);
        // A growing vector may have twice the capacity. Void rows compress to a thousandth.
        let packed = 2 * (there + block / 500) * self.sample_bytes;
        self.tile * self.side * WHILE_MADE + packed + CODEC
    }

    /// Bytes for the places of all blocks, and for the list of those that `tiles` tiles have
    /// samples in.
    pub(super) fn fixed(&self, tiles: u64) -> u64 {
        let blocks = self.columns.div_ceil(self.side) * self.rows.div_ceil(self.side);
        blocks * EACH + blocks.min(tiles.saturating_mul(4)) * WANTED
    }

    /// Side of a block in samples.
    pub(super) fn side(&self) -> u32 {
        self.side as u32
    }

    /// Column and row of the blocks in which tiles of the level have samples, sorted.
    fn wanted(&self, reader: &Reader) -> Result<Vec<(u64, u64)>> {
        let mut wanted = BTreeSet::new();
        for id in reader.tiles(self.level)? {
            let [x, y] = [(id.x, self.columns), (id.y, self.rows)].map(|(place, samples)| {
                let own = self.owned(place.into(), samples);
                own.start / self.side..own.end.saturating_sub(1) / self.side + 1
            });
            wanted.extend(y.flat_map(|y| x.clone().map(move |x| (y, x))));
        }
        Ok(wanted.into_iter().collect())
    }

    /// Samples along an axis that a tile owns: its first ones, and for the last tile its border
    /// too.
    fn owned(&self, place: u64, samples: u64) -> Range<u64> {
        let end = if place == self.last { samples } else { samples.min((place + 1) * self.tile) };
        (place * self.tile).min(end)..end
    }

    /// Tiles along an axis that own samples of a range.
    fn tiles(&self, own: &Range<u64>) -> Range<u64> {
        (own.start / self.tile).min(self.last)..((own.end - 1) / self.tile).min(self.last) + 1
    }

    /// Samples of a block along an axis.
    fn samples_of(&self, block: u64, samples: u64) -> Range<u64> {
        block * self.side..((block + 1) * self.side).min(samples)
    }

    /// Reads some rows of a column of blocks into `values`, each row as long as a block; leaves it
    /// empty if no sample is valid.
    fn read(&self, reader: &Reader, rows: &Range<u64>, x: u64, values: &mut Vec<Option<f64>>) -> Result<()> {
        values.clear();
        let (side, coding) = (self.side as usize, reader.header().coding);
        let columns = self.samples_of(x, self.columns);
        for ty in self.tiles(rows) {
            for tx in self.tiles(&columns) {
                let id = TileId::new(self.level, tx as u32, ty as u32);
                if reader.entry(id)?.is_none() {
                    continue;
                }
                let lattice = reader.read_tile(id)?;
                let (south, east) = (self.owned(ty, self.rows), self.owned(tx, self.columns));
                let inside =
                    |own: &Range<u64>, all: &Range<u64>| own.start.max(all.start)..own.end.min(all.end);
                for row in inside(&south, rows) {
                    for column in inside(&east, &columns) {
                        let at = lattice.at((column - east.start) as usize, (row - south.start) as usize);
                        if lattice.state[at] != VALID {
                            continue;
                        }
                        if values.is_empty() {
                            values.resize(side * (rows.end - rows.start) as usize, None);
                        }
                        let place = (row - rows.start) as usize * side + (column - columns.start) as usize;
                        values[place] = Some(lattice.value(at, coding));
                    }
                }
            }
        }
        Ok(())
    }

    /// Encodes a block for the file, one row of tiles at a time; `None` if no sample is valid.
    fn encode(
        &self,
        reader: &Reader,
        writer: &GeotiffWriter,
        (y, x): (u64, u64),
        void: Void,
    ) -> Result<Option<Vec<u8>>> {
        let kind = reader.header().source_type;
        let nothing = samples(&vec![None; self.side as usize], kind, void);
        let rows = self.samples_of(y, self.rows);
        let (mut encoder, mut values, mut skipped) = (None, Vec::new(), 0);
        for start in rows.clone().step_by(self.tile as usize) {
            let band = start..rows.end.min(start + self.tile);
            self.read(reader, &band, x, &mut values)?;
            if values.is_empty() {
                skipped += (band.end - band.start) as usize;
                continue;
            }
            let encoder: &mut BlockEncoder = match &mut encoder {
                Some(encoder) => encoder,
                none => none.insert(writer.begin_block()?),
            };
            encoder.repeat(&nothing, std::mem::take(&mut skipped))?;
            encoder.put(&samples(&values, kind, void))?;
        }
        let Some(mut encoder) = encoder else { return Ok(None) };
        // Rows below the raster are padding.
        skipped += (self.side - (rows.end - rows.start)) as usize;
        encoder.repeat(&nothing, skipped)?;
        encoder.finish().map(Some)
    }

    /// Writes all blocks, within `at_once` bytes at a time or those of one block.
    pub(super) fn write(
        &self,
        reader: &Reader,
        writer: &mut GeotiffWriter,
        void: Void,
        at_once: u64,
    ) -> Result<()> {
        let across = self.columns.div_ceil(self.side);
        let wanted = self.wanted(reader)?;
        let together = (at_once / self.bytes(reader.header().tile_count)).max(1);
        for blocks in wanted.chunks(usize::try_from(together).unwrap_or(usize::MAX)) {
            let make = |&place: &(u64, u64)| self.encode(reader, writer, place, void);
            let made: Vec<Result<Option<Vec<u8>>>> = blocks.par_iter().map(make).collect();
            for ((y, x), block) in blocks.iter().zip(made) {
                if let Some(block) = block? {
                    writer.put_block(y * across + x, &block)?;
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::limits::Limits;
    use crate::pipeline::{self, BuildOptions, Silent};
    use crate::source;

    #[test]
    fn blocks_of_any_size_hold_what_rows_do() {
        let folder = tempfile::tempdir().expect("folder");
        let output = folder.path().join("a.rlv");
        let dem = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem/rmnp_dem_uint16.tif");
        let source = source::open(&dem, &Limits::default()).expect("fixture");
        let options = BuildOptions { tile: 16, patch: 4, ..BuildOptions::default() };
        pipeline::build(&*source, &output, &options, &Silent).expect("build");
        let reader = Reader::open(&output).expect("open");
        for level in 0..=reader.header().levels {
            let (columns, rows) = reader.header().level_size(level);
            let (mut expected, mut whole) = (Vec::new(), None);
            let (rect, _) = super::super::all_of(reader.header(), level);
            for most in [16, 5] {
                expected.clear();
                super::super::each_band(&reader, (level, most), &rect, &mut |values| {
                    expected.extend_from_slice(values);
                    Ok(())
                })
                .expect("rows");
                assert_eq!(expected.len(), columns as usize * rows as usize);
                whole.get_or_insert_with(|| expected.clone());
            }
            assert!(Some(&expected) == whole.as_ref(), "bands of 5 rows");
            for shift in 0..5 {
                let mut blocks = Blocks::new(level, 16, (columns, rows), 2).expect("blocks");
                blocks.side <<= shift;
                let side = blocks.side as usize;
                let mut got = vec![None; expected.len()];
                for (y, x) in blocks.wanted(&reader).expect("index") {
                    let (mut values, own) = (Vec::new(), blocks.samples_of(y, rows.into()));
                    blocks.read(&reader, &own, x, &mut values).expect("read");
                    for (at, value) in values.into_iter().enumerate().filter(|(_, value)| value.is_some()) {
                        let (row, column) = (y as usize * side + at / side, x as usize * side + at % side);
                        assert!(column < columns as usize && row < rows as usize);
                        got[row * columns as usize + column] = value;
                    }
                }
                assert!(got == expected, "level {level}, blocks of {side}");
            }
        }
    }

    #[test]
    fn too_many_blocks_are_refused_before() {
        let blocks = |columns, rows, bytes| Blocks::new(16, 256, (columns, rows), bytes);
        assert_eq!(blocks(1 << 18, 1 << 18, 2).map(|blocks| blocks.side()).expect("fits"), 256);
        assert_eq!(blocks(1 << 24, 1 << 24, 2).map(|blocks| blocks.side()).expect("fits"), 8192);
        let message = blocks(1 << 26, 1 << 26, 2).err().expect("too many").to_string();
        assert!(message.contains("`level`") && message.contains("67108864"), "{message}");
    }
}
