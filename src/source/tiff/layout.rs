//! Layout of one band of one image in a TIFF file: the grid of blocks, their encoding, offsets and
//! byte counts.
//!
//! Everything is checked here against [`Limits`] and for consistency, so later steps can rely on
//! it. Features that this reader lacks are refused by name. No sample is read here.

mod places;
mod tags;

use std::ops::Range;

use tiff::tags::Tag;

use self::tags::{block_side, compression, jpeg, predictor, rows_per_strip, side, stored};
use super::directory::{Directory, Reader, place};
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::sample::SampleType;

/// Most bytes of an uncompressed strip of a picture, unless one row has more.
const SHORT_STRIP: u64 = 512 << 10;

/// Most strips made by cutting: the offsets of a damaged file would otherwise fill the memory.
const MOST_STRIPS: u32 = 1 << 22;

/// Compression of the blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Lzw,
    Deflate,
    PackBits,
    Zstd,
    /// Pictures only.
    Jpeg,
}

/// What an image is read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// One band, from 0: heights or a mask.
    Band(u32),
    /// All bands.
    Picture,
}

/// How samples were turned into differences before packing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Predictor {
    None,
    /// Differences of whole samples.
    Horizontal,
    /// Differences of bytes, sorted by significance.
    FloatingPoint,
}

/// Type of the samples in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stored {
    /// One bit of a mask.
    Bit,
    /// A type that heights can have.
    Number(SampleType),
}

/// Geometry and encoding of one band.
#[derive(Debug)]
#[expect(clippy::struct_excessive_bools, reason = "each is a tag of its own")]
pub(super) struct Layout {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) block_width: u32,
    pub(super) block_height: u32,
    /// Number of blocks in a row of blocks.
    pub(super) across: u32,
    /// Number of rows of blocks.
    pub(super) down: u32,
    pub(super) tiled: bool,
    pub(super) stored: Stored,
    /// Interleaved bands in a block.
    pub(super) bands: u32,
    /// Index of this band among them, from 0.
    pub(super) place: u32,
    /// Index of this band in the file, from 0.
    pub(super) band: u32,
    /// True if a decoded block keeps all its bands, not only this one.
    pub(super) all_bands: bool,
    /// Number of bands of the file.
    pub(super) band_count: u32,
    pub(super) compression: Compression,
    pub(super) predictor: Predictor,
    /// True if the byte order of numbers must be swapped.
    pub(super) swapped: bool,
    /// True if the bits of each byte are stored lowest first.
    pub(super) reversed: bool,
    /// Tables shared by all JPEG blocks (tag 347), and whether the blocks are YCbCr.
    pub(super) jpeg: (Vec<u8>, bool),
    /// Offsets of the blocks, row by row; if the bands of a picture are stored separately, band by
    /// band.
    pub(super) offsets: Vec<u64>,
    /// Bytes of the blocks in the file; 0 for a missing block.
    pub(super) counts: Vec<u64>,
}

impl Stored {
    pub(super) fn bits(self) -> u64 {
        match self {
            Self::Bit => 1,
            Self::Number(kind) => 8 * kind.bytes() as u64,
        }
    }
}

impl Layout {
    /// Reads the layout of one band or of all.
    pub(super) fn read(
        reader: &mut Reader<'_>,
        directory: &Directory,
        limits: &Limits,
        purpose: Purpose,
    ) -> Result<Self> {
        let width = side(reader, directory, Tag::ImageWidth, limits)?;
        let height = side(reader, directory, Tag::ImageLength, limits)?;
        let compression = compression(reader, directory, purpose)?;
        let stored = stored(reader, directory)?;
        let predictor = predictor(reader, directory, compression, stored)?;
        let samples = samples_per_pixel(reader, directory)?;
        let band = if let Purpose::Band(band) = purpose { band } else { 0 };
        if band >= samples {
            return Err(no_band(band, samples));
        }
        let planar = match reader.integer(directory, Tag::PlanarConfiguration)?.unwrap_or(1) {
            1 => false,
            2 => true,
            other => return Err(Error::format(place(Tag::PlanarConfiguration), "1 or 2", other)),
        };
        let tiled = directory.contains(Tag::TileWidth) || directory.contains(Tag::TileLength);
        let (block_width, block_height) = if tiled {
            (block_side(reader, directory, Tag::TileWidth)?, block_side(reader, directory, Tag::TileLength)?)
        } else {
            (width, rows_per_strip(reader, directory, height)?)
        };
        let mut layout = Self {
            width,
            height,
            block_width,
            block_height,
            across: width.div_ceil(block_width),
            down: height.div_ceil(block_height),
            tiled,
            stored,
            bands: if planar { 1 } else { samples },
            place: if planar { 0 } else { band },
            band,
            all_bands: purpose == Purpose::Picture,
            band_count: samples,
            compression,
            predictor,
            swapped: reader.swapped,
            // JPEG has one bit order only.
            reversed: compression != Compression::Jpeg
                && reader.integer(directory, Tag::FillOrder)? == Some(2),
            jpeg: if compression == Compression::Jpeg {
                jpeg(reader, directory)?
            } else {
                (Vec::new(), false)
            },
            offsets: Vec::new(),
            counts: Vec::new(),
        };
        layout.read_blocks(reader, directory)?;
        if purpose == Purpose::Picture {
            layout.shorten();
        }
        layout.check_size(limits)?;
        Ok(layout)
    }

    /// Sets of blocks: one, or one for each band that is stored separately.
    pub(super) fn planes(&self) -> u32 {
        if self.all_bands { self.band_count / self.bands } else { 1 }
    }

    /// Cuts uncompressed strips into short ones, so that a picture stored as one strip need not be
    /// read as a whole.
    fn shorten(&mut self) {
        let most = (SHORT_STRIP / self.row_bytes().max(1)).max(1);
        if self.tiled || !self.is_direct() || u64::from(self.block_height) <= most {
            return;
        }
        let whole = self.block_height;
        // A single strip can be cut anywhere; several must all be cut in the same way.
        let parts = (2..=whole).filter(|&parts| self.down == 1 || whole.is_multiple_of(parts));
        let mut heights = parts.map(|parts| whole.div_ceil(parts));
        let Some(short) = heights.find(|&height| u64::from(height) <= most) else { return };
        let (down, bytes) = (self.height.div_ceil(short), self.row_bytes());
        if down > MOST_STRIPS {
            return;
        }
        let mut offsets = Vec::new();
        let mut counts = Vec::new();
        for plane in 0..self.planes() {
            for row in (0..down).map(|strip| strip * short) {
                let old = (plane * self.down + row / whole) as usize;
                let skip = bytes * u64::from(row % whole);
                let rows = bytes * u64::from(short.min(self.height - row).min(whole - row % whole));
                offsets.push(self.offsets[old].saturating_add(skip));
                counts.push(rows.min(self.counts[old].saturating_sub(skip)));
            }
        }
        (self.block_height, self.down) = (short, down);
        (self.offsets, self.counts) = (offsets, counts);
    }

    /// Bytes of one row of a block.
    pub(super) fn row_bytes(&self) -> u64 {
        (u64::from(self.block_width) * u64::from(self.bands) * self.stored.bits()).div_ceil(8)
    }

    /// Coded rows of the blocks in a row of blocks: a tile is always full, the last strip is not.
    pub(super) fn coded_rows(&self, block_row: u32) -> u32 {
        if self.tiled { self.block_height } else { self.raster_rows(block_row) }
    }

    /// Rows of the raster in a row of blocks.
    pub(super) fn raster_rows(&self, block_row: u32) -> u32 {
        self.block_height.min(self.height - block_row * self.block_height)
    }

    /// True if samples can be read from the file without decoding.
    pub(super) fn is_direct(&self) -> bool {
        self.compression == Compression::None && self.stored != Stored::Bit && !self.reversed
    }

    /// The byte range of the blocks of a window, if little else lies in it; `None` for an empty
    /// window.
    pub(super) fn span(&self, columns: &Range<u32>, rows: &Range<u32>) -> Option<Range<u64>> {
        // Of an uncompressed row only the wanted part need be read.
        let by_row = self.is_direct() && !self.tiled;
        if columns.is_empty() || rows.is_empty() || by_row && 2 * columns.len() < self.width as usize {
            return None;
        }
        let along = |range: &Range<u32>, size: u32| range.start / size..(range.end - 1) / size + 1;
        let (across, down) = (along(columns, self.block_width), along(rows, self.block_height));
        let (mut bytes, mut least, mut end) = (0_u64, u64::MAX, 0);
        for y in down {
            for x in across.clone() {
                let block = y as usize * self.across as usize + x as usize;
                let (start, count) = (*self.offsets.get(block)?, *self.counts.get(block)?);
                if count > 0 {
                    (least, end) = (least.min(start), end.max(start.saturating_add(count)));
                    bytes = bytes.saturating_add(count);
                }
            }
        }
        (least < end && end - least <= bytes.saturating_mul(2)).then_some(least..end)
    }

    /// Name of a block, for messages.
    pub(super) fn block_name(&self, index: usize) -> String {
        let kind = if self.tiled { "tile" } else { "strip" };
        format!("{kind} {index} at offset {}", self.offsets.get(index).copied().unwrap_or(0))
    }

    /// A description such as `tiles 256 x 256, LZW, predictor 2`.
    pub(super) fn describe(&self) -> String {
        let blocks = match (self.tiled, self.block_height) {
            (true, _) => format!("tiles {} x {}", self.block_width, self.block_height),
            (false, 1) => "strips of 1 row".to_owned(),
            (false, rows) => format!("strips of {rows} rows"),
        };
        let packed = match self.compression {
            Compression::None => "uncompressed",
            Compression::Lzw => "LZW",
            Compression::Deflate => "Deflate",
            Compression::PackBits => "PackBits",
            Compression::Zstd => "ZSTD",
            Compression::Jpeg => "JPEG",
        };
        let predictor = match self.predictor {
            Predictor::None => "",
            Predictor::Horizontal => ", predictor 2",
            Predictor::FloatingPoint => ", predictor 3",
        };
        let band = match self.band_count {
            1 => String::new(),
            count if self.all_bands => format!(", {count} bands"),
            count => format!(", band {} of {count}", self.band + 1),
        };
        format!("{blocks}, {packed}{predictor}{band}")
    }

    /// Checks that a block that is decoded as a whole fits the limits; other blocks are copied in
    /// parts.
    fn check_size(&self, limits: &Limits) -> Result<()> {
        let bytes = u128::from(self.row_bytes()) * u128::from(self.block_height);
        let max = if self.is_direct() && !self.all_bands {
            u128::from(u64::MAX)
        } else {
            u128::from(limits.block_bytes)
        };
        if bytes > max {
            let what = if self.tiled {
                "the size of a decoded tile in bytes"
            } else {
                "the size of a decoded strip in bytes"
            };
            return Err(Error::limit(what, u64::try_from(bytes).unwrap_or(u64::MAX), max as u64));
        }
        Ok(())
    }
}

/// Number of bands.
fn samples_per_pixel(reader: &mut Reader<'_>, directory: &Directory) -> Result<u32> {
    let samples = reader.integer(directory, Tag::SamplesPerPixel)?.unwrap_or(1);
    let known = u16::try_from(samples).ok().filter(|&samples| samples > 0).map(u32::from);
    known.ok_or_else(|| Error::format(place(Tag::SamplesPerPixel), "1 to 65535", samples))
}

/// The error for a band, from 0, that the file does not have.
pub(in crate::source) fn no_band(band: u32, bands: u32) -> Error {
    let has =
        if bands == 1 { "band 1, the only one".to_owned() } else { format!("one of bands 1 to {bands}") };
    Error::format("bands", has, format!("a request for band {}", band.wrapping_add(1)))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A layout of uint32 tiles without offsets.
    pub(in crate::source::tiff) fn layout(
        width: u32,
        height: u32,
        block_width: u32,
        block_height: u32,
    ) -> Layout {
        Layout {
            width,
            height,
            block_width,
            block_height,
            across: width.div_ceil(block_width),
            down: height.div_ceil(block_height),
            tiled: true,
            stored: Stored::Number(SampleType::Uint32),
            bands: 1,
            place: 0,
            band: 0,
            all_bands: false,
            band_count: 1,
            compression: Compression::None,
            predictor: Predictor::None,
            swapped: false,
            reversed: false,
            jpeg: (Vec::new(), false),
            offsets: Vec::new(),
            counts: Vec::new(),
        }
    }

    #[test]
    fn what_a_window_needs_lies_together_or_is_not_asked_for() {
        // Consecutive tiles of 16 x 16 uint32; the second is missing.
        let mut tiles = layout(64, 40, 16, 16);
        (tiles.offsets, tiles.counts) = ((0..12).map(|i| 100 + 1024 * i).collect(), vec![1024; 12]);
        (tiles.offsets[1], tiles.counts[1]) = (0, 0);
        assert_eq!(tiles.span(&(0..64), &(0..16)), Some(100..100 + 4 * 1024));
        assert_eq!(tiles.span(&(0..64), &(15..33)), Some(100..100 + 12 * 1024));
        assert_eq!(tiles.span(&(20..40), &(16..20)), Some(100 + 5 * 1024..100 + 7 * 1024));
        // One column of tiles: the bytes between them are three times as many.
        assert_eq!(tiles.span(&(0..16), &(0..40)), None);
        assert_eq!(tiles.span(&(16..32), &(0..16)), None);
        assert_eq!((tiles.span(&(0..0), &(0..16)), tiles.span(&(0..16), &(16..16))), (None, None));
        // Damaged offsets: one far away, one that overflows.
        tiles.offsets[2] = 1 << 50;
        assert_eq!(tiles.span(&(0..64), &(0..16)), None);
        (tiles.offsets[2], tiles.counts[2]) = (u64::MAX - 1, u64::MAX);
        assert_eq!(tiles.span(&(0..64), &(0..16)), Some(100..u64::MAX));
        let mut strips = Layout { tiled: false, ..layout(64, 40, 64, 10) };
        (strips.offsets, strips.counts) = ((0..4).map(|i| 8 + 2560 * i).collect(), vec![2560; 4]);
        assert_eq!(strips.span(&(0..64), &(9..11)), Some(8..8 + 2 * 2560));
        assert_eq!(strips.span(&(0..20), &(9..11)), None);
        strips.compression = Compression::Deflate;
        assert_eq!(strips.span(&(0..20), &(9..11)), Some(8..8 + 2 * 2560));
        strips.offsets.truncate(1);
        assert_eq!(strips.span(&(0..64), &(9..11)), None);
    }
}
