//! GeoTIFF writer for heights or pictures, by rows from north to south.
//!
//! Directory and block index stand before the blocks. Their size is known before the first sample,
//! so the file is written once, in order, and the directory is filled in last. Memory holds one
//! batch of rows, whatever the height. The blocks of a batch are compressed in parallel; the bytes
//! do not depend on the number of threads.
//!
//! The file is written beside the target, and [`GeotiffWriter::finish`] renames it: a writer
//! dropped half-way leaves nothing behind. A mask lies between the blocks and has its directory
//! behind them. Overviews are not supported.

mod block;
mod directory;
mod geo_tags;
mod mask;
mod stream;

use std::path::PathBuf;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::output::NewFile;
use crate::sample::SampleType;
use crate::source::Samples;
use block::BlockGrid;
use directory::{Tag, Value, tags};
use mask::Mask;
pub use stream::BlockEncoder;

/// Compression of blocks. Both codecs use a predictor: 2 for integers, 3 for floats.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compression {
    /// No compression and no predictor.
    None,
    /// Zlib stream (compression 8), which every TIFF reader supports.
    #[default]
    Deflate,
    /// Zstandard (compression 50000): smaller and faster, for libtiff 4.0.10 and later.
    Zstd,
}

/// Properties of a GeoTIFF to write; start from [`GeotiffSpec::new`].
#[derive(Clone, Debug)]
pub struct GeotiffSpec<'a> {
    /// Columns, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
    /// Type of the samples.
    pub sample_type: SampleType,
    /// Interleaved samples of a pixel: 1, or for a picture of bytes 2 (grey, alpha), 3 (red, green,
    /// blue) or 4 (red, green, blue, alpha).
    pub bands: u16,
    /// Value that means void (tag `GDAL_NODATA`).
    pub nodata: Option<f64>,
    /// True if rows come with a mask. The mask alone then defines voids: GDAL ignores `nodata`
    /// beside it.
    pub mask: bool,
    /// Georeference. Its GeoKeys are written unchanged, or made from the EPSG code.
    pub geo: &'a Geo,
    /// GDAL scale: `real = band_offset + band_scale * sample`.
    pub band_scale: f64,
    /// GDAL offset.
    pub band_offset: f64,
    /// Name of the vertical unit; empty if unknown.
    pub unit: &'a str,
    /// Compression of the blocks.
    pub compression: Compression,
    /// Side of square tiles, a multiple of 16; `None` for strips of about 256 KiB.
    pub tile: Option<u32>,
    /// 64-bit offsets or not; `None` decides by size.
    pub bigtiff: Option<bool>,
    /// Replace a file that exists.
    pub force: bool,
}

impl<'a> GeotiffSpec<'a> {
    /// Deflated strips without nodata value, mask or unit, scale 1, offset 0; an existing file is
    /// not replaced.
    pub fn new(width: u32, height: u32, sample_type: SampleType, geo: &'a Geo) -> Self {
        Self {
            width,
            height,
            sample_type,
            bands: 1,
            nodata: None,
            mask: false,
            geo,
            band_scale: 1.0,
            band_offset: 0.0,
            unit: "",
            compression: Compression::default(),
            tile: None,
            bigtiff: None,
            force: false,
        }
    }
}

/// Bytes of pixel data from which on offsets take 64 bits: 3.9 GiB, which leaves room for data that
/// does not compress.
const BIGTIFF_FROM: u64 = 3993 << 20;
/// Bytes of samples in a batch, which is compressed in parallel.
const BATCH_BYTES: u64 = 8 << 20;
/// Bytes for the place of a block, while others are written and while the directory is made.
const INDEX: u64 = 80;

/// Writes one GeoTIFF; see the module.
///
/// ```
/// use relevo::geo::Geo;
/// use relevo::geotiff_write::{GeotiffSpec, GeotiffWriter};
/// use relevo::{sample::SampleType, source::Samples};
///
/// let path = std::env::temp_dir().join(format!("relevo-doc-{}.tif", std::process::id()));
/// let transform = Some([500_000.0, 30.0, 0.0, 5_000_000.0, 0.0, -30.0]);
/// let geo = Geo { transform, ..Geo::default() };
/// let spec = GeotiffSpec::new(2, 2, SampleType::Int16, &geo);
/// let mut writer = GeotiffWriter::create(&path, &spec)?;
/// writer.write_rows(&Samples::Int16(vec![1, 2]))?;
/// writer.write_rows(&Samples::Int16(vec![3, 4]))?;
/// assert_eq!(writer.finish()?, std::fs::metadata(&path).unwrap().len());
/// # std::fs::remove_file(&path).unwrap();
/// # Ok::<(), relevo::Error>(())
/// ```
#[derive(Debug)]
pub struct GeotiffWriter {
    grid: BlockGrid,
    compression: Compression,
    /// All tags but the block index.
    tags: Vec<Tag>,
    big: bool,
    /// Little-endian samples of whole rows that are not in a block yet.
    pending: Vec<u8>,
    batch_rows: u32,
    rows_taken: u32,
    /// Offset and size of each block written so far; in a sparse file, of every block.
    blocks: Vec<(u64, u64)>,
    sparse: bool,
    mask: Option<Mask>,
    /// Offset of the next block.
    position: u64,
    output: NewFile,
}

/// Rows of a batch: whole blocks, of [`BATCH_BYTES`] unless one row of blocks is larger.
fn batch_rows(grid: &BlockGrid) -> u32 {
    let block = u64::from(grid.block_height);
    ((BATCH_BYTES / grid.row_bytes() / block).max(1) * block).min(grid.height.into()) as u32
}

impl GeotiffWriter {
    /// Begins a file at `path`.
    ///
    /// # Errors
    /// [`Error::Usage`] if the file exists and `force` is false, or if the spec makes no sense;
    /// [`Error::Limit`] if one block would be larger than
    /// [`Limits::block_bytes`](crate::limits::Limits::block_bytes).
    pub fn create(path: impl Into<PathBuf>, spec: &GeotiffSpec) -> Result<Self> {
        let path = path.into();
        let grid = BlockGrid::new(spec).map_err(|error| error.at(&path))?;
        Self::begin(path, spec, grid)
    }

    /// Begins a file of tiles, to be written in any order by [`GeotiffWriter::put_block`]. Tiles
    /// that are not written are missing from the file, and void.
    ///
    /// # Errors
    /// As [`GeotiffWriter::create`].
    pub fn create_sparse(path: impl Into<PathBuf>, spec: &GeotiffSpec) -> Result<Self> {
        let path = path.into();
        let grid = BlockGrid::of_blocks(spec).map_err(|error| error.at(&path))?;
        let mut writer = Self::begin(path, spec, grid)?;
        writer.blocks = directory::zero_index(writer.grid.count());
        writer.sparse = true;
        Ok(writer)
    }

    /// Most bytes of memory that writing a file by rows takes, besides the rows passed in: a batch
    /// of rows, raw and compressed, and the place of each block.
    pub fn memory(spec: &GeotiffSpec) -> u64 {
        let Ok(grid) = BlockGrid::of_blocks(spec) else { return 0 };
        let batch = u64::from(batch_rows(&grid)) * grid.row_bytes();
        batch.saturating_mul(5).saturating_add(grid.count().saturating_mul(INDEX))
    }

    fn begin(path: PathBuf, spec: &GeotiffSpec, grid: BlockGrid) -> Result<Self> {
        let mask_bytes = if spec.mask { u64::from(spec.width / 8 + 1) * u64::from(spec.height) } else { 0 };
        let data_bytes = grid.total_bytes().saturating_add(mask_bytes);
        let big = spec.bigtiff.unwrap_or(data_bytes >= BIGTIFF_FROM);
        let mut tags = grid.tags(spec.compression);
        tags.extend(geo_tags::tags(spec));
        let index = directory::zero_index(grid.count());
        let position = directory::encode(&tags, &index, grid.tiled, big, None).len() as u64;
        let batch_rows = batch_rows(&grid);
        let mut output = NewFile::create(path, spec.force)?;
        output.seek(position)?;
        Ok(Self {
            grid,
            compression: spec.compression,
            tags,
            big,
            pending: Vec::new(),
            batch_rows,
            rows_taken: 0,
            blocks: Vec::new(),
            sparse: false,
            mask: spec.mask.then(|| Mask::new((spec.width, spec.height), batch_rows)),
            position,
            output,
        })
    }

    /// Writes whole rows: a multiple of the width (times the bands), in the spec's sample type.
    ///
    /// # Errors [`Error::Usage`] for samples of another type, for part of a row, for more rows than
    /// the spec has, and if the spec has a mask.
    pub fn write_rows(&mut self, samples: &Samples) -> Result<()> {
        self.take(samples, None)
    }

    /// Writes whole rows as [`GeotiffWriter::write_rows`] does, with a mask that is true where a
    /// pixel is valid; the spec must have a mask.
    ///
    /// # Errors As for `write_rows`, and for a mask of another size.
    pub fn write_masked_rows(&mut self, samples: &Samples, valid: &[bool]) -> Result<()> {
        self.take(samples, Some(valid))
    }

    fn take(&mut self, samples: &Samples, valid: Option<&[bool]>) -> Result<()> {
        let (sample_type, count) = (samples.sample_type(), samples.len());
        if sample_type != self.grid.sample_type {
            return Err(Error::usage(format!(
                "the GeoTIFF holds {} samples, and was given {} ones",
                self.grid.sample_type.gdal_name(),
                sample_type.gdal_name()
            )));
        }
        let width = self.grid.width as usize * usize::from(self.grid.bands);
        let rows_left = u64::from(self.grid.height - self.rows_taken);
        let rows = (count / width) as u64;
        if !count.is_multiple_of(width) || rows > rows_left {
            return Err(Error::usage(format!(
                "{count} samples do not fit a GeoTIFF of rows of {width} samples with {rows_left} rows to come"
            )));
        }
        let (across, pixels) = (self.grid.width as usize, count / usize::from(self.grid.bands));
        if valid.map(<[bool]>::len) != self.mask.as_ref().map(|_| pixels) {
            return Err(Error::usage("a GeoTIFF takes a mask with all of its rows, or with none"));
        }
        let mut taken = 0;
        while taken < rows as usize {
            let pending_rows = (self.pending.len() as u64 / self.grid.row_bytes()) as usize;
            let take = (self.batch_rows as usize - pending_rows).min(rows as usize - taken);
            block::append_le_bytes(samples, taken * width..(taken + take) * width, &mut self.pending);
            if let (Some(mask), Some(valid)) = (&mut self.mask, valid) {
                mask.take(&valid[taken * across..(taken + take) * across]);
            }
            taken += take;
            self.rows_taken += take as u32;
            if pending_rows + take == self.batch_rows as usize || self.rows_taken == self.grid.height {
                self.write_batch()?;
            }
        }
        Ok(())
    }

    /// Completes the file, renames it to its final name, and returns its size in bytes.
    ///
    /// # Errors [`Error::Usage`] if rows are missing, or if the target was created in the meantime.
    pub fn finish(mut self) -> Result<u64> {
        if self.rows_taken != self.grid.height && !self.sparse {
            return Err(Error::usage(format!(
                "the GeoTIFF was to have {} rows, and was given {}",
                self.grid.height, self.rows_taken
            )));
        }
        let next = self.finish_mask()?;
        let front = directory::encode(&self.tags, &self.blocks, self.grid.tiled, self.big, next);
        self.output.seek(0)?;
        self.output.put(&front)?;
        self.output.commit()?;
        Ok(self.position)
    }

    /// Writes the directory of the mask behind all blocks; returns its offset.
    fn finish_mask(&mut self) -> Result<Option<u64>> {
        let Some(mask) = &self.mask else { return Ok(None) };
        let place = self.position.next_multiple_of(8);
        let mut bytes = vec![0; (place - self.position) as usize];
        bytes.extend(directory::another(&mask.tags(), &mask.strips, self.big, place));
        self.append(&bytes)?;
        Ok(Some(place))
    }

    /// Compresses the pending rows in parallel, and writes the blocks in order.
    fn write_batch(&mut self) -> Result<()> {
        let rows = (self.pending.len() as u64 / self.grid.row_bytes()) as u32;
        let blocks: Vec<Vec<u8>> = (0..self.grid.blocks_in(rows))
            .into_par_iter()
            .map(|index| block::encode(&self.grid, self.compression, &self.pending, rows, index))
            .collect::<std::io::Result<_>>()
            .map_err(|source| Error::io(self.output.path(), "compress a block", source))?;
        self.pending.clear();
        for block in blocks {
            let place = self.append(&block)?;
            self.blocks.push(place);
        }
        if let Some(mask) = &mut self.mask {
            let strip = mask.strip();
            let strip = strip.map_err(|source| Error::io(self.output.path(), "compress the mask", source))?;
            let place = self.append(&strip)?;
            self.mask.iter_mut().for_each(|mask| mask.strips.push(place));
        }
        Ok(())
    }

    /// Appends the bytes of a block; returns its offset and size.
    fn append(&mut self, block: &[u8]) -> Result<(u64, u64)> {
        let bytes = block.len() as u64;
        if !self.big && self.position + bytes > u64::from(u32::MAX) {
            return Err(Error::limit(
                "size of a TIFF without 64-bit offsets",
                self.position + bytes,
                1 << 32,
            )
            .at(self.output.path()));
        }
        self.output.put(block)?;
        let place = (self.position, bytes);
        self.position += bytes;
        Ok(place)
    }

    /// Writes a tile encoded by [`BlockEncoder::finish`]. Tiles are numbered row by row from the
    /// north-west.
    pub fn put_block(&mut self, number: u64, block: &[u8]) -> Result<()> {
        let count = self.blocks.len();
        let number = usize::try_from(number).unwrap_or(usize::MAX);
        if !self.sparse || self.blocks.get(number).is_none_or(|place| place.1 > 0) {
            return Err(Error::usage(format!(
                "tile {number} of {count} of this GeoTIFF is there, or cannot be"
            )));
        }
        self.blocks[number] = self.append(block)?;
        Ok(())
    }
}
