//! Strips and tiles: the division of rows into blocks, and the encoding of a block.

use std::io::{self, Write};
use std::ops::Range;

use flate2::write::ZlibEncoder;

use super::{Compression, GeotiffSpec, Tag, Value, tags};
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::Samples;

/// Approximate bytes of a strip before compression.
const STRIP_BYTES: u64 = 256 << 10;
/// Zstandard level: 3 is the default; 6 makes terrain a few per cent smaller and is still faster
/// than reading it.
pub(super) const ZSTD_LEVEL: i32 = 6;

/// The division of a raster into blocks. Byte counts cannot overflow, as a block is below
/// [`Limits::block_bytes`].
#[derive(Debug)]
pub(super) struct BlockGrid {
    pub width: u32,
    pub height: u32,
    pub sample_type: SampleType,
    pub bands: u16,
    pub tiled: bool,
    pub block_width: u32,
    pub block_height: u32,
}

impl BlockGrid {
    /// The grid of a spec that is written by rows, checked.
    pub fn new(spec: &GeotiffSpec) -> Result<Self> {
        let grid = Self::of_blocks(spec)?;
        // A batch is at least one row of blocks, which must fit into memory as a block must.
        let band_bytes = grid.row_bytes().saturating_mul(u64::from(grid.block_height));
        let max = Limits::default().block_bytes;
        if band_bytes > max {
            return Err(Error::limit("bytes of a row of blocks", band_bytes, max));
        }
        Ok(grid)
    }

    /// The grid of a spec whose blocks come one by one, checked.
    pub fn of_blocks(spec: &GeotiffSpec) -> Result<Self> {
        let GeotiffSpec { width, height, sample_type, bands, tile, .. } = *spec;
        if width == 0 || height == 0 {
            return Err(Error::usage(format!(
                "a GeoTIFF needs columns and rows, and has {width} x {height}"
            )));
        }
        if tile.is_some_and(|side| side == 0 || !side.is_multiple_of(16)) {
            return Err(Error::usage("the tile size of a GeoTIFF must be a multiple of 16"));
        }
        if bands != 1 && !(bands < 5 && bands > 1 && sample_type == SampleType::Uint8) {
            return Err(Error::usage("a GeoTIFF of several bands has 2 to 4 of bytes"));
        }
        let pixel_bytes = u64::from(bands) * sample_type.bytes() as u64;
        let row_bytes = u64::from(width) * pixel_bytes;
        let (block_width, block_height) = match tile {
            Some(side) => (side, side),
            None => (width, (STRIP_BYTES / row_bytes).clamp(1, u64::from(height)) as u32),
        };
        let tiled = tile.is_some();
        let grid = Self { width, height, sample_type, bands, tiled, block_width, block_height };
        let block_bytes =
            u64::from(block_width).saturating_mul(u64::from(block_height)).saturating_mul(pixel_bytes);
        let max = Limits::default().block_bytes;
        if block_bytes > max {
            return Err(Error::limit("bytes of a block", block_bytes, max));
        }
        Ok(grid)
    }

    /// Bytes of a pixel.
    fn pixel_bytes(&self) -> usize {
        usize::from(self.bands) * self.sample_type.bytes()
    }

    /// Bytes of a row of pixels.
    pub fn row_bytes(&self) -> u64 {
        u64::from(self.width) * self.pixel_bytes() as u64
    }

    /// Blocks in a row of blocks.
    fn across(&self) -> u64 {
        u64::from(self.width.div_ceil(self.block_width))
    }

    /// Number of blocks.
    pub fn count(&self) -> u64 {
        self.blocks_in(self.height)
    }

    /// Number of blocks in `rows` rows that start at the top edge of a block.
    pub fn blocks_in(&self, rows: u32) -> u64 {
        self.across() * u64::from(rows.div_ceil(self.block_height))
    }

    /// Bytes of all blocks before compression, padding included.
    pub fn total_bytes(&self) -> u64 {
        let rows = u64::from(self.height).next_multiple_of(u64::from(self.block_height));
        let columns = u64::from(self.width).next_multiple_of(u64::from(self.block_width));
        columns.saturating_mul(rows).saturating_mul(self.pixel_bytes() as u64)
    }

    /// Tags that describe the samples and the blocks.
    pub fn tags(&self, compression: Compression) -> Vec<Tag> {
        let short = |id, value| Tag::new(id, Value::Shorts(vec![value]));
        let each = |id, value| Tag::new(id, Value::Shorts(vec![value; usize::from(self.bands)]));
        let long = |id, value| Tag::new(id, Value::Long(value));
        let format = match self.sample_type {
            SampleType::Uint8 | SampleType::Uint16 | SampleType::Uint32 => 1,
            SampleType::Int8 | SampleType::Int16 | SampleType::Int32 => 2,
            SampleType::Float32 | SampleType::Float64 => 3,
        };
        let scheme = match compression {
            Compression::None => 1,
            Compression::Deflate => 8,
            Compression::Zstd => 50000,
        };
        let mut tags = vec![
            long(tags::IMAGE_WIDTH, self.width),
            long(tags::IMAGE_LENGTH, self.height),
            each(tags::BITS_PER_SAMPLE, 8 * self.sample_type.bytes() as u16),
            short(tags::COMPRESSION, scheme),
            short(tags::PHOTOMETRIC, if self.bands > 2 { 2 } else { 1 }),
            short(tags::SAMPLES_PER_PIXEL, self.bands),
            short(tags::PLANAR_CONFIGURATION, 1),
            each(tags::SAMPLE_FORMAT, format),
        ];
        if self.bands.is_multiple_of(2) {
            // Alpha, not multiplied with the colours.
            tags.push(short(tags::EXTRA_SAMPLES, 2));
        }
        if compression != Compression::None {
            tags.push(short(tags::PREDICTOR, if self.sample_type.is_float() { 3 } else { 2 }));
        }
        if self.tiled {
            tags.push(long(tags::TILE_WIDTH, self.block_width));
            tags.push(long(tags::TILE_LENGTH, self.block_height));
        } else {
            tags.push(long(tags::ROWS_PER_STRIP, self.block_height));
        }
        tags
    }
}

/// Appends a range of samples as little-endian bytes. The range must be within bounds.
pub(super) fn append_le_bytes(samples: &Samples, range: Range<usize>, bytes: &mut Vec<u8>) {
    match samples {
        Samples::Int8(v) => append(&v[range], bytes, i8::to_le_bytes),
        Samples::Uint8(v) => append(&v[range], bytes, u8::to_le_bytes),
        Samples::Int16(v) => append(&v[range], bytes, i16::to_le_bytes),
        Samples::Uint16(v) => append(&v[range], bytes, u16::to_le_bytes),
        Samples::Int32(v) => append(&v[range], bytes, i32::to_le_bytes),
        Samples::Uint32(v) => append(&v[range], bytes, u32::to_le_bytes),
        Samples::Float32(v) => append(&v[range], bytes, f32::to_le_bytes),
        Samples::Float64(v) => append(&v[range], bytes, f64::to_le_bytes),
    }
}

fn append<T: Copy, const N: usize>(values: &[T], bytes: &mut Vec<u8>, to_le: impl Fn(T) -> [u8; N]) {
    let start = bytes.len();
    bytes.resize(start + N * values.len(), 0);
    let (chunks, _) = bytes[start..].as_chunks_mut::<N>();
    for (chunk, &value) in chunks.iter_mut().zip(values) {
        *chunk = to_le(value);
    }
}

/// Block `index` of a batch of `rows` rows, encoded for the file.
pub(super) fn encode(
    grid: &BlockGrid,
    compression: Compression,
    batch: &[u8],
    rows: u32,
    index: u64,
) -> io::Result<Vec<u8>> {
    pack(grid, compression, gather(grid, batch, rows, index))
}

/// The bytes of a block, predicted and compressed.
fn pack(grid: &BlockGrid, compression: Compression, mut block: Vec<u8>) -> io::Result<Vec<u8>> {
    if compression == Compression::None {
        return Ok(block);
    }
    predict(&mut block, grid);
    match compression {
        Compression::None => Ok(block),
        Compression::Deflate => {
            let mut encoder =
                ZlibEncoder::new(Vec::with_capacity(block.len() / 2), flate2::Compression::default());
            encoder.write_all(&block)?;
            encoder.finish()
        }
        Compression::Zstd => zstd::bulk::compress(&block, ZSTD_LEVEL),
    }
}

/// Samples of a block: the last strip is short, tiles are padded with zeros.
fn gather(grid: &BlockGrid, batch: &[u8], rows: u32, index: u64) -> Vec<u8> {
    let bytes = grid.pixel_bytes();
    let (block_x, block_y) = ((index % grid.across()) as u32, (index / grid.across()) as u32);
    let (left, top) = (block_x * grid.block_width, block_y * grid.block_height);
    let columns = grid.block_width.min(grid.width - left) as usize;
    let rows = grid.block_height.min(rows - top) as usize;
    let block_row = grid.block_width as usize * bytes;
    let block_rows = if grid.tiled { grid.block_height as usize } else { rows };
    let mut block = vec![0; block_row * block_rows];
    let row_bytes = grid.width as usize * bytes;
    for (row, target) in block.chunks_exact_mut(block_row).take(rows).enumerate() {
        let start = (top as usize + row) * row_bytes + left as usize * bytes;
        target[..columns * bytes].copy_from_slice(&batch[start..start + columns * bytes]);
    }
    block
}

/// TIFF predictor 2 (integers) or 3 (floats), row by row in place.
pub(super) fn predict(block: &mut [u8], grid: &BlockGrid) {
    let sample_type = grid.sample_type;
    let row_bytes = grid.block_width as usize * grid.pixel_bytes();
    let mut scratch = Vec::new();
    for row in block.chunks_exact_mut(row_bytes) {
        match (sample_type.is_float(), sample_type.bytes()) {
            (true, 4) => predict_float::<4>(row, &mut scratch),
            (true, _) => predict_float::<8>(row, &mut scratch),
            (false, 1) => difference_of_bytes(row, grid.bands.into()),
            (false, 2) => difference::<2>(row),
            (false, _) => difference::<4>(row),
        }
    }
}

/// Replaces every integer of `N` bytes by its difference to the one before, modulo `2^(8 N)`.
fn difference<const N: usize>(row: &mut [u8]) {
    let mut previous = 0_u32;
    let (samples, _) = row.as_chunks_mut::<N>();
    for sample in samples {
        let mut wide = [0; 4];
        wide[..N].copy_from_slice(sample);
        let value = u32::from_le_bytes(wide);
        sample.copy_from_slice(&value.wrapping_sub(previous).to_le_bytes()[..N]);
        previous = value;
    }
}

/// Replaces every byte by its difference to that of the pixel before, `bands` bytes earlier, modulo
/// 256.
fn difference_of_bytes(row: &mut [u8], bands: usize) {
    for at in (bands..row.len()).rev() {
        row[at] = row[at].wrapping_sub(row[at - bands]);
    }
}

/// Sorts the bytes of floats into planes, the most significant first, then takes differences of
/// bytes.
fn predict_float<const N: usize>(row: &mut [u8], scratch: &mut Vec<u8>) {
    scratch.clear();
    scratch.extend_from_slice(row);
    let (samples, _) = scratch.as_chunks::<N>();
    for (plane, target) in row.chunks_exact_mut(samples.len()).enumerate() {
        for (byte, sample) in target.iter_mut().zip(samples) {
            *byte = sample[N - 1 - plane];
        }
    }
    difference::<1>(row);
}
