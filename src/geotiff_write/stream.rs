//! A tile of a GeoTIFF given in parts, of which only the compressed bytes are held in memory as a
//! whole.

use std::io::{self, Write};

use flate2::write::ZlibEncoder;
use zstd::stream::write::Encoder as ZstdEncoder;

use super::block::{self, BlockGrid, ZSTD_LEVEL};
use super::{Compression, GeotiffWriter};
use crate::error::{Error, Result};
use crate::source::Samples;

/// Destination of a tile's bytes.
enum Sink {
    Plain(Vec<u8>),
    Deflate(ZlibEncoder<Vec<u8>>),
    Zstd(ZstdEncoder<'static, Vec<u8>>),
}

impl Sink {
    fn new(compression: Compression) -> io::Result<Self> {
        Ok(match compression {
            Compression::None => Self::Plain(Vec::new()),
            Compression::Deflate => {
                Self::Deflate(ZlibEncoder::new(Vec::new(), flate2::Compression::default()))
            }
            Compression::Zstd => Self::Zstd(ZstdEncoder::new(Vec::new(), ZSTD_LEVEL)?),
        })
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Plain(out) => out.write_all(bytes),
            Self::Deflate(out) => out.write_all(bytes),
            Self::Zstd(out) => out.write_all(bytes),
        }
    }

    fn finish(self) -> io::Result<Vec<u8>> {
        match self {
            Self::Plain(out) => Ok(out),
            Self::Deflate(out) => out.finish(),
            Self::Zstd(out) => out.finish(),
        }
    }
}

/// A tile that is given row by row from the north-west, with padding where it extends beyond the
/// raster.
pub struct BlockEncoder<'a> {
    writer: &'a GeotiffWriter,
    sink: Sink,
    /// Number of samples so far.
    taken: usize,
    bytes: Vec<u8>,
}

impl GeotiffWriter {
    /// Begins a tile for [`GeotiffWriter::put_block`].
    pub fn begin_block(&self) -> Result<BlockEncoder<'_>> {
        let sink = Sink::new(self.compression).map_err(|source| self.failed(source))?;
        Ok(BlockEncoder { writer: self, sink, taken: 0, bytes: Vec::new() })
    }

    fn failed(&self, source: io::Error) -> Error {
        Error::io(self.output.path(), "compress a block", source)
    }

    fn row_of_block(&self) -> usize {
        self.grid.block_width as usize * usize::from(self.grid.bands)
    }
}

impl BlockEncoder<'_> {
    /// Appends whole rows.
    pub fn put(&mut self, samples: &Samples) -> Result<()> {
        self.repeat(samples, 1)
    }

    /// Appends the same rows `times` times.
    pub fn repeat(&mut self, samples: &Samples, times: usize) -> Result<()> {
        let (writer, row) = (self.writer, self.writer.row_of_block());
        let grid: &BlockGrid = &writer.grid;
        let whole = samples.len().is_multiple_of(row) && samples.sample_type() == grid.sample_type;
        if !grid.tiled || !whole {
            return Err(Error::usage(format!(
                "a tile of this GeoTIFF has rows of {row} samples of its type"
            )));
        }
        self.bytes.clear();
        block::append_le_bytes(samples, 0..samples.len(), &mut self.bytes);
        if writer.compression != Compression::None {
            block::predict(&mut self.bytes, grid);
        }
        self.taken += samples.len() * times;
        let put = (0..times).try_for_each(|_| self.sink.put(&self.bytes));
        put.map_err(|source| writer.failed(source))
    }

    /// The encoded tile.
    pub fn finish(self) -> Result<Vec<u8>> {
        let side = self.writer.row_of_block() * self.writer.grid.block_height as usize;
        if self.taken != side {
            let what = format!("a tile of this GeoTIFF has {side} samples, and was given {}", self.taken);
            return Err(Error::usage(what));
        }
        self.sink.finish().map_err(|source| self.writer.failed(source))
    }
}
