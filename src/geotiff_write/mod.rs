//! GeoTIFF writer: heights or a picture, streamed by rows from north to south.
//!
//! Directory and block index stand in front of the blocks; their size is known before the first sample comes, so
//! the file is written once, in order, with the directory filled in last. Memory holds one batch of rows, whatever
//! the height. Blocks of a batch are compressed in parallel; the bytes do not depend on the number of threads.
//!
//! Everything goes to a file beside the target, which [`GeotiffWriter::finish`] renames: a writer dropped half-way
//! leaves nothing behind. Not here: masks, overviews.

mod block;
mod directory;
mod geo_tags;

use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::sample::SampleType;
use crate::source::Samples;
use block::BlockGrid;
use directory::{Tag, Value, tags};

/// How blocks are compressed. Both codecs use a predictor: 2 for integers, 3 for floats.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compression {
    /// Not at all, and without predictor.
    None,
    /// Zlib stream (compression 8), which every TIFF reader knows.
    #[default]
    Deflate,
    /// Zstandard (compression 50000): smaller and faster, for libtiff 4.0.10 and later.
    Zstd,
}

/// What a GeoTIFF is to be; start from [`GeotiffSpec::new`].
#[derive(Clone, Debug)]
pub struct GeotiffSpec<'a> {
    /// Columns, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
    /// Type of the samples.
    pub sample_type: SampleType,
    /// Samples of a pixel, which stand together: 1, or of a picture of bytes 2 (grey, alpha), 3 (red, green, blue) or 4 (and alpha).
    pub bands: u16,
    /// Value that means void (tag `GDAL_NODATA`).
    pub nodata: Option<f64>,
    /// Where the raster lies. Its GeoKeys are written back as they are, or made from the EPSG code.
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
    /// Deflated strips, no nodata value, scale 1, offset 0, no unit; nothing is overwritten.
    pub fn new(width: u32, height: u32, sample_type: SampleType, geo: &'a Geo) -> Self {
        Self {
            width,
            height,
            sample_type,
            bands: 1,
            nodata: None,
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

/// Bytes of pixel data from which offsets take 64 bits: 3.9 GiB, which leaves room for data that will not compress.
const BIGTIFF_FROM: u64 = 3993 << 20;
/// Bytes of samples that are gathered before they are compressed, in parallel and together.
const BATCH_BYTES: u64 = 8 << 20;

/// Writes one GeoTIFF; see the module.
///
/// ```
/// use relevo::geo::Geo;
/// use relevo::geotiff_write::{GeotiffSpec, GeotiffWriter};
/// use relevo::{sample::SampleType, source::Samples};
///
/// let path = std::env::temp_dir().join(format!("relevo-doc-{}.tif", std::process::id()));
/// let geo = Geo { transform: Some([500_000.0, 30.0, 0.0, 5_000_000.0, 0.0, -30.0]), ..Geo::default() };
/// let mut writer = GeotiffWriter::create(&path, &GeotiffSpec::new(2, 2, SampleType::Int16, &geo))?;
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
    /// Little-endian samples of whole rows that no block holds yet.
    pending: Vec<u8>,
    batch_rows: u32,
    rows_taken: u32,
    /// Place and size of each block written so far.
    blocks: Vec<(u64, u64)>,
    /// Where the next block goes.
    position: u64,
    output: Output,
}

impl GeotiffWriter {
    /// Begins a file at `path`.
    ///
    /// # Errors
    /// [`Error::Usage`] if the file exists and `force` is false, or if the spec makes no sense; [`Error::Limit`] if
    /// one block would be larger than [`Limits::block_bytes`](crate::limits::Limits::block_bytes).
    pub fn create(path: impl Into<PathBuf>, spec: &GeotiffSpec) -> Result<Self> {
        let path = path.into();
        let grid = BlockGrid::new(spec).map_err(|error| error.at(&path))?;
        let data_bytes = grid.total_bytes();
        let big = spec.bigtiff.unwrap_or(data_bytes >= BIGTIFF_FROM);
        let mut tags = grid.tags(spec.compression);
        tags.extend(geo_tags::tags(spec));
        let index = directory::zero_index(grid.count());
        let position = directory::encode(&tags, &index, grid.tiled, big).len() as u64;
        let batch_rows = (BATCH_BYTES / grid.row_bytes() / u64::from(grid.block_height)).max(1)
            * u64::from(grid.block_height);
        let batch_rows = batch_rows.min(u64::from(spec.height)) as u32;
        let mut output = Output::create(path, spec.force)?;
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
            position,
            output,
        })
    }

    /// Appends whole rows: a multiple of the width (times the bands), in the type of the spec.
    ///
    /// # Errors
    /// [`Error::Usage`] for samples of another type, for a part of a row, and for more rows than the spec says.
    pub fn write_rows(&mut self, samples: &Samples) -> Result<()> {
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
        let mut taken = 0;
        while taken < rows as usize {
            let pending_rows = (self.pending.len() as u64 / self.grid.row_bytes()) as usize;
            let take = (self.batch_rows as usize - pending_rows).min(rows as usize - taken);
            block::append_le_bytes(samples, taken * width..(taken + take) * width, &mut self.pending);
            taken += take;
            self.rows_taken += take as u32;
            if pending_rows + take == self.batch_rows as usize || self.rows_taken == self.grid.height {
                self.write_batch()?;
            }
        }
        Ok(())
    }

    /// Completes the file under its name and returns its size in bytes.
    ///
    /// # Errors
    /// [`Error::Usage`] if rows are missing or if the target has come into being meanwhile.
    pub fn finish(mut self) -> Result<u64> {
        if self.rows_taken != self.grid.height {
            return Err(Error::usage(format!(
                "the GeoTIFF was to have {} rows, and was given {}",
                self.grid.height, self.rows_taken
            )));
        }
        let front = directory::encode(&self.tags, &self.blocks, self.grid.tiled, self.big);
        self.output.seek(0)?;
        self.output.write(&front)?;
        self.output.commit()?;
        Ok(self.position)
    }

    /// Compresses the pending rows, all at once, and writes the blocks in order.
    fn write_batch(&mut self) -> Result<()> {
        let rows = (self.pending.len() as u64 / self.grid.row_bytes()) as u32;
        let blocks: Vec<Vec<u8>> = (0..self.grid.blocks_in(rows))
            .into_par_iter()
            .map(|index| block::encode(&self.grid, self.compression, &self.pending, rows, index))
            .collect::<std::io::Result<_>>()
            .map_err(|source| Error::io(&self.output.path, "compress a block", source))?;
        self.pending.clear();
        for block in blocks {
            let bytes = block.len() as u64;
            if !self.big && self.position + bytes > u64::from(u32::MAX) {
                return Err(Error::limit(
                    "size of a TIFF without 64-bit offsets",
                    self.position + bytes,
                    1 << 32,
                )
                .at(&self.output.path));
            }
            self.output.write(&block)?;
            self.blocks.push((self.position, bytes));
            self.position += bytes;
        }
        Ok(())
    }
}

/// A file under a temporary name beside its target; removed on drop unless committed.
#[derive(Debug)]
struct Output {
    path: PathBuf,
    temporary: PathBuf,
    file: File,
    force: bool,
    committed: bool,
}

impl Output {
    fn create(path: PathBuf, force: bool) -> Result<Self> {
        refuse_existing(&path, force)?;
        let name = path
            .file_name()
            .ok_or_else(|| Error::usage(format!("{}: this is no file name", path.display())))?
            .to_string_lossy()
            .into_owned();
        for attempt in 0_u32.. {
            let temporary = path.with_file_name(format!(".{name}.{}-{attempt}.part", std::process::id()));
            match OpenOptions::new().write(true).create_new(true).open(&temporary) {
                Ok(file) => return Ok(Self { path, temporary, file, force, committed: false }),
                Err(error) if error.kind() == ErrorKind::AlreadyExists && attempt < 1000 => {}
                Err(error) => return Err(Error::io(path, "create the file", error)),
            }
        }
        Err(Error::usage(format!("{}: no free name for a temporary file beside it", path.display())))
    }

    fn seek(&mut self, position: u64) -> Result<()> {
        let sought = self.file.seek(SeekFrom::Start(position));
        sought.map(drop).map_err(|error| Error::io(&self.path, format!("seek to byte {position}"), error))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        let written = self.file.write_all(bytes);
        written.map_err(|error| Error::io(&self.path, format!("write {} bytes", bytes.len()), error))
    }

    fn commit(&mut self) -> Result<()> {
        self.file.sync_all().map_err(|error| Error::io(&self.path, "write to disk", error))?;
        refuse_existing(&self.path, self.force)?;
        let renamed = fs::rename(&self.temporary, &self.path);
        renamed.map_err(|error| Error::io(&self.path, "give the finished file its name", error))?;
        self.committed = true;
        Ok(())
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if !self.committed {
            // Nothing can be done, nor needs to be said, if it cannot be removed.
            drop(fs::remove_file(&self.temporary));
        }
    }
}

/// An error if there is something at `path` that must not be replaced.
fn refuse_existing(path: &Path, force: bool) -> Result<()> {
    if !force && fs::symlink_metadata(path).is_ok() {
        return Err(Error::usage(format!("{}: exists already; use --force to replace it", path.display())));
    }
    Ok(())
}
