//! A TIFF with all its bands, read block by block for pictures: raw samples and their meaning.

use std::path::Path;
use std::sync::Arc;

use tiff::tags::Tag;

use super::blocks::Band;
use super::directory::Reader;
use super::file::TiffFile;
use super::georeference;
use super::layout::{Compression, Layout, Purpose, Stored};
use super::validity::{external_mask, internal_mask};
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::account::Account;

/// One image of a TIFF, or its mask.
pub(in crate::source) struct Raster {
    band: Band,
}

/// The meaning of the samples of an image.
pub(in crate::source) struct Meaning {
    /// Photometric interpretation (tag 262).
    pub(in crate::source) photometric: u64,
    /// Meaning of each band after the colours (tag 338); 1 and 2 are alpha, with and without
    /// colours multiplied by it.
    pub(in crate::source) extra: Vec<u64>,
    /// Palette (tag 320): all reds, then all greens, then all blues.
    pub(in crate::source) palette: Option<Vec<u64>>,
    /// Georeference, and properties of the bands.
    pub(in crate::source) account: Account,
    /// A description such as `GeoTIFF, tiles 256 x 256, JPEG, 3 bands`.
    pub(in crate::source) description: String,
}

impl Raster {
    /// Opens a file: its first image, the meaning of its samples, and its mask if there is one.
    pub(in crate::source) fn open(path: &Path, limits: &Limits) -> Result<(Self, Meaning, Option<Self>)> {
        let file = Arc::new(TiffFile::open(path, limits)?);
        let mut reader = Reader::new(&file, limits)?;
        let directories = reader.directories()?;
        let image = directories.first().ok_or_else(|| Error::format("TIFF header", "an image", "none"))?;
        let layout = Layout::read(&mut reader, image, limits, Purpose::Picture)?;
        if layout.stored == Stored::Bit && layout.band_count > 1 {
            return Err(Error::unsupported(
                "several bands of 1 bit",
                "convert it with gdal_translate -ot Byte",
            ));
        }
        let name = if reader.big { "GeoTIFF (big)" } else { "GeoTIFF" };
        let packed = if file.is_gzipped() { ", gzipped" } else { "" };
        let meaning = Meaning {
            photometric: reader.integer(image, Tag::PhotometricInterpretation)?.unwrap_or(1),
            extra: reader.integers(image, Tag::ExtraSamples)?.unwrap_or_default(),
            palette: reader.integers(image, Tag::ColorMap)?,
            account: Account::gathered(path, georeference::read(&mut reader, image)?, limits)?,
            description: format!("{name}, {}{packed}", layout.describe()),
        };
        let mask = match internal_mask(&mut reader, &directories, (&layout, 0), limits)? {
            Some(mask) => Some(Band::new(Arc::clone(&file), mask)),
            None => external_mask(path, (&layout, 0), limits)?,
        };
        Ok((Self { band: Band::new(file, layout) }, meaning, mask.map(|band| Self { band })))
    }

    /// Columns and rows.
    pub(in crate::source) fn size(&self) -> (u32, u32) {
        (self.band.layout.width, self.band.layout.height)
    }

    /// Columns and rows of a block.
    pub(in crate::source) fn block_size(&self) -> (u32, u32) {
        (self.band.layout.block_width, self.band.layout.block_height)
    }

    /// Sets of blocks: one, or one for each band.
    pub(in crate::source) fn planes(&self) -> u32 {
        self.band.layout.planes()
    }

    /// Number of bands of the file.
    pub(in crate::source) fn band_count(&self) -> u32 {
        self.band.layout.band_count
    }

    /// Number of bands interleaved in a block.
    pub(in crate::source) fn block_bands(&self) -> usize {
        // A mask keeps one band only.
        if self.band.layout.all_bands { self.band.layout.bands as usize } else { 1 }
    }

    /// True if the blocks are JPEG pictures.
    pub(in crate::source) fn is_jpeg(&self) -> bool {
        self.band.layout.compression == Compression::Jpeg
    }

    /// Sample type; `None` for bits, which are decoded to bytes 0 and 1.
    pub(in crate::source) fn stored(&self) -> Option<SampleType> {
        match self.band.layout.stored {
            Stored::Bit => None,
            Stored::Number(kind) => Some(kind),
        }
    }

    /// True if a sparse file lacks this block.
    pub(in crate::source) fn is_absent(&self, block: usize, plane: u32) -> bool {
        self.band.layout.counts[self.index(block, plane)] == 0
    }

    fn index(&self, block: usize, plane: u32) -> usize {
        let layout = &self.band.layout;
        plane as usize * layout.across as usize * layout.down as usize + block
    }

    /// The samples of a block that the file has, in this machine's byte order, row by row, bands
    /// interleaved unless stored separately. Rows below the raster may be missing.
    pub(in crate::source) fn decode(&self, block: usize, plane: u32) -> Result<Vec<u8>> {
        Band::with_buffers(|buffers| {
            self.band.decode(self.index(block, plane), buffers)?;
            Ok(std::mem::take(&mut buffers.bytes))
        })
    }

    /// Path of the file.
    pub(in crate::source) fn path(&self) -> &Path {
        self.band.file.path()
    }
}
