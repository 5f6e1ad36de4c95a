//! Pictures made of blocks: windows of converted pixels, assembled from cached blocks.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use rayon::prelude::*;

use super::cache::Cache;
use super::convert::{BandSamples, Conversion};
use super::{Memory, Picture, PictureInfo, PictureNote, Pixels, check_opening, stretch};
use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::{FileStamp, Fingerprint};
use crate::texel::Colour;

/// Blocks that are examined to find the range of 16-bit alpha.
const ALPHA_BLOCKS: usize = 64;

/// The size of a raster and of its blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::source) struct Shape {
    pub(in crate::source) width: u32,
    pub(in crate::source) height: u32,
    pub(in crate::source) block_width: u32,
    pub(in crate::source) block_height: u32,
}

/// Samples of some bands of one block, in the order requested.
pub(in crate::source) struct Raw {
    /// Byte buffers, in this machine's byte order.
    pub(in crate::source) bytes: Vec<Vec<u8>>,
    /// For each band: index into `bytes`, index of its first sample, and stride between samples.
    pub(in crate::source) planes: Vec<(usize, usize, usize)>,
}

/// A raster whose blocks can be read as raw samples.
pub(in crate::source) trait Blocks: Send + Sync {
    /// Size of the raster and of its blocks.
    fn shape(&self) -> Shape;
    /// True if the file lacks this block for all these bands: its samples are nodata, or 0.
    fn is_absent(&self, block: usize, bands: &[usize]) -> bool;
    /// Samples of a pixel that must be decoded to get these bands.
    fn samples_read(&self, bands: &[usize]) -> usize {
        bands.len()
    }
    /// Samples of these bands (from 0), in rows of `block_width`. Rows below the raster may be
    /// missing.
    fn read(&self, block: usize, bands: &[usize]) -> Result<Raw>;
    /// All files that are read.
    fn files(&self) -> Vec<PathBuf>;
    /// The current state of these files.
    fn fingerprint(&self) -> Result<Fingerprint> {
        Ok(Fingerprint { files: self.files().iter().map(|path| FileStamp::of(path)).collect::<Result<_>>()? })
    }
    /// An error with the path of the file added.
    fn locate(&self, error: Error) -> Error;
}

/// The parts of a picture.
pub(in crate::source) struct PictureParts {
    pub(in crate::source) blocks: Box<dyn Blocks>,
    pub(in crate::source) conversion: Conversion,
    pub(in crate::source) geo: Geo,
    pub(in crate::source) note: PictureNote,
    /// See [`PictureInfo::has_alpha`].
    pub(in crate::source) has_alpha: bool,
    /// A mask of the same size, 0 where the picture is transparent.
    pub(in crate::source) mask: Option<(Box<dyn Blocks>, Conversion)>,
    /// Sidecars that were read.
    pub(in crate::source) beside: Vec<PathBuf>,
    /// True if a world file gives the place.
    pub(in crate::source) placed_beside: bool,
    /// Oddities of the picture, a sentence each.
    pub(in crate::source) warnings: Vec<String>,
}

/// Blocks and their conversion.
struct Layer {
    blocks: Box<dyn Blocks>,
    conversion: Conversion,
    bands: Vec<usize>,
    cache: Arc<Cache>,
    number: u32,
}

/// A picture made of blocks.
pub(in crate::source) struct BlockPicture {
    info: PictureInfo,
    layer: Layer,
    mask: Option<Layer>,
    beside: Vec<PathBuf>,
}

impl Shape {
    fn across(&self) -> u32 {
        self.width.div_ceil(self.block_width)
    }

    fn blocks(&self) -> usize {
        self.across() as usize * self.height.div_ceil(self.block_height) as usize
    }

    /// Columns and rows of a block, in the raster.
    pub(in crate::source) fn window(&self, block: usize) -> (Range<u32>, Range<u32>) {
        let (column, row) = (block % self.across() as usize, block / self.across() as usize);
        let (left, top) = (column as u32 * self.block_width, row as u32 * self.block_height);
        let right = u64::from(left) + u64::from(self.block_width);
        let bottom = u64::from(top) + u64::from(self.block_height);
        (left..right.min(self.width.into()) as u32, top..bottom.min(self.height.into()) as u32)
    }

    /// The blocks that a non-empty window meets.
    fn touched(&self, columns: &Range<u32>, rows: &Range<u32>) -> impl Iterator<Item = usize> + use<> {
        let across = self.across();
        let x = columns.start / self.block_width..(columns.end - 1) / self.block_width + 1;
        let y = rows.start / self.block_height..(rows.end - 1) / self.block_height + 1;
        y.flat_map(move |y| x.clone().map(move |x| y as usize * across as usize + x as usize))
    }
}

impl Layer {
    fn new(blocks: Box<dyn Blocks>, conversion: Conversion, cache: &Arc<Cache>) -> Self {
        let bands = conversion.bands().collect();
        Self { blocks, conversion, bands, cache: Arc::clone(cache), number: cache.register() }
    }

    /// Memory of its blocks: while one is decoded (stored, decoded and converted), and of all
    /// converted ones.
    fn memory(&self) -> Memory {
        let shape = self.blocks.shape();
        let pixels = u64::from(shape.block_width) * u64::from(shape.block_height);
        let decoded = (self.blocks.samples_read(&self.bands) * self.conversion.kind.bytes()) as u64;
        let converted = self.conversion.channels() as u64 + u64::from(self.conversion.hides());
        Memory {
            reading: pixels.saturating_mul(2 * decoded + converted),
            block: pixels.saturating_mul(converted),
            kept: pixels.saturating_mul(shape.blocks() as u64).saturating_mul(converted),
        }
    }

    /// A converted block, `block_width` pixels wide; rows below the raster are missing.
    fn block(&self, block: usize) -> Result<Arc<Pixels>> {
        self.cache.get((self.number, block), || {
            let shape = self.blocks.shape();
            let count = shape.block_width as usize * shape.window(block).1.len();
            if self.blocks.is_absent(block, &self.bands) {
                return Ok(self.absent(count));
            }
            self.raw(block, |planes, _| self.conversion.pixels(planes, count))
        })
    }

    /// `count` pixels of a block that the file lacks.
    fn absent(&self, count: usize) -> Pixels {
        if self.conversion.hides() {
            let colour = vec![0; count * self.conversion.channels()];
            return Pixels { colour, alpha: Some(vec![0; count]) };
        }
        let bytes = vec![0; count * self.conversion.kind.bytes()];
        let plane = BandSamples { bytes: &bytes, first: 0, stride: 1 };
        self.conversion.pixels(&vec![plane; self.bands.len()], count)
    }

    /// Calls `look` with the samples of a block and their number for each plane.
    fn raw<T>(&self, block: usize, look: impl FnOnce(&[BandSamples<'_>], usize) -> T) -> Result<T> {
        let raw = self.blocks.read(block, &self.bands).map_err(|error| self.blocks.locate(error))?;
        let shape = self.blocks.shape();
        let count = shape.block_width as usize * shape.window(block).1.len();
        let size = self.conversion.kind.bytes();
        let planes: Vec<BandSamples<'_>> = raw
            .planes
            .iter()
            .map(|&(at, first, stride)| {
                let bytes = &raw.bytes[at];
                BandSamples { bytes: &bytes[..bytes.len().min(count * stride * size)], first, stride }
            })
            .collect();
        Ok(look(&planes, count))
    }

    /// Copies the pixels of a window, block by block.
    fn window(&self, columns: &Range<u32>, rows: &Range<u32>) -> Result<Pixels> {
        let (shape, channels) = (self.blocks.shape(), self.conversion.channels());
        let (width, count) = (columns.len(), columns.len() * rows.len());
        let mut pixels = Pixels { colour: vec![0; count * channels], alpha: None };
        if count == 0 {
            return Ok(pixels);
        }
        for number in shape.touched(columns, rows) {
            let block = self.block(number)?;
            let (across, down) = shape.window(number);
            let (x, y) = (across.start.max(columns.start), down.start.max(rows.start));
            let run = (across.end.min(columns.end) - x) as usize;
            if block.alpha.is_some() && pixels.alpha.is_none() {
                pixels.alpha = Some(vec![255; count]);
            }
            for row in y..down.end.min(rows.end) {
                let from =
                    (row - down.start) as usize * shape.block_width as usize + (x - across.start) as usize;
                let to = (row - rows.start) as usize * width + (x - columns.start) as usize;
                pixels.colour[to * channels..][..run * channels]
                    .copy_from_slice(&block.colour[from * channels..][..run * channels]);
                if let (Some(alpha), Some(block)) = (&mut pixels.alpha, &block.alpha) {
                    alpha[to..][..run].copy_from_slice(&block[from..][..run]);
                }
            }
        }
        Ok(pixels)
    }

    /// False if all blocks of a window are missing and therefore transparent.
    fn may_show(&self, columns: &Range<u32>, rows: &Range<u32>) -> bool {
        let shape = self.blocks.shape();
        !self.conversion.hides()
            || shape.touched(columns, rows).any(|block| !self.blocks.is_absent(block, &self.bands))
    }
}

impl BlockPicture {
    pub(super) fn new(parts: PictureParts, cache: &Arc<Cache>) -> Self {
        let shape = parts.blocks.shape();
        let kind = if parts.conversion.channels() == 1 { Colour::Grey } else { Colour::Rgb };
        Self {
            info: PictureInfo {
                width: shape.width,
                height: shape.height,
                kind,
                has_alpha: parts.has_alpha,
                geo: parts.geo,
                note: parts.note,
                warnings: parts.warnings,
            },
            layer: Layer::new(parts.blocks, parts.conversion, cache),
            mask: parts.mask.map(|(blocks, conversion)| Layer::new(blocks, conversion, cache)),
            beside: parts.beside,
        }
    }

    /// Sample type and number of colour bands if they can be stretched; `None` for bits and
    /// palettes.
    pub(in crate::source) fn stretchable(&self) -> Option<(SampleType, usize)> {
        let conversion = &self.layer.conversion;
        (conversion.palette.is_none() && !conversion.is_bit)
            .then_some((conversion.kind, conversion.colours.len()))
    }

    /// Number of blocks.
    pub(in crate::source) fn blocks(&self) -> usize {
        self.layer.blocks.shape().blocks()
    }

    /// Number of pixels.
    pub(in crate::source) fn pixels(&self) -> u64 {
        u64::from(self.info.width) * u64::from(self.info.height)
    }

    /// Values of each colour band at opaque pixels of a block: about `most` of them, or with `None`
    /// the least and the greatest.
    pub(in crate::source) fn values(&self, block: usize, most: Option<usize>) -> Result<Vec<Vec<f64>>> {
        let (layer, shape) = (&self.layer, self.layer.blocks.shape());
        let conversion = &layer.conversion;
        let mut values = vec![Vec::new(); conversion.colours.len()];
        if layer.blocks.is_absent(block, &layer.bands) {
            return Ok(values);
        }
        let (columns, rows) = shape.window(block);
        let mask = self.mask.as_ref().map(|mask| mask.window(&columns, &rows)).transpose()?;
        layer.raw(block, |planes, count| {
            let step = most.map_or(1, |most| (columns.len() * rows.len()).div_ceil(most.max(1)));
            let mut hidden = conversion.hidden(planes, count).unwrap_or_else(|| vec![false; count]);
            if conversion.alpha.is_some() {
                planes[conversion.colours.len()]
                    .each(conversion.kind, |index, value| hidden[index] |= conversion.opacity(value) == 0);
            }
            let width = shape.block_width as usize;
            let shown = |index: usize| {
                let (x, y) = (index % width, index / width);
                let inside = x < columns.len() && !hidden[index];
                inside && mask.as_ref().is_none_or(|mask| mask.colour[y * columns.len() + x] > 0)
            };
            for (values, plane) in values.iter_mut().zip(planes) {
                plane.each(conversion.kind, |index, value| {
                    // Each row starts at another offset, so that every column is sampled.
                    if (index + index / width * 7).is_multiple_of(step) && value.is_finite() && shown(index) {
                        match (most, &mut values[..]) {
                            (None, [least, greatest]) => {
                                (*least, *greatest) = (least.min(value), greatest.max(value));
                            }
                            (None, _) => values.extend([value, value]),
                            _ => values.push(value),
                        }
                    }
                });
            }
        })?;
        Ok(values)
    }

    /// Finds out whether 16-bit alpha uses only the lower 8 bits, as some writers do: if it is
    /// nowhere above 255, then 255 is opaque. Some of the blocks are examined.
    pub(in crate::source) fn settle_alpha(&mut self, limits: &Limits) -> Result<()> {
        let layer = &self.layer;
        if layer.conversion.alpha.is_none() || layer.conversion.kind != SampleType::Uint16 {
            return Ok(());
        }
        check_opening(self, 0, limits)?;
        let (blocks, at) = (self.blocks(), layer.conversion.colours.len());
        let chosen = blocks.min(ALPHA_BLOCKS);
        let greatest = |n: usize| {
            let block = stretch::spread(n, chosen, blocks);
            if layer.blocks.is_absent(block, &layer.bands) {
                return Ok(0.0);
            }
            layer.raw(block, |planes, _| {
                let mut greatest = 0.0_f64;
                planes[at].each(SampleType::Uint16, |_, value| greatest = greatest.max(value));
                greatest
            })
        };
        let all: Vec<f64> = (0..chosen).into_par_iter().map(greatest).collect::<Result<_>>()?;
        if (1.0..=255.0).contains(&all.into_iter().fold(0.0, f64::max)) {
            self.layer.conversion.opaque = 255.0;
        }
        Ok(())
    }

    /// Sets the values that become 0 and 255.
    pub(in crate::source) fn set_stretch(&mut self, ranges: &[(f64, f64)]) {
        self.layer.conversion.ramps = ranges.to_vec();
        self.info.note.stretch = ranges.to_vec();
    }
}

impl Picture for BlockPicture {
    fn info(&self) -> &PictureInfo {
        &self.info
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Pixels> {
        let (width, height) = (self.info.width, self.info.height);
        if columns.start > columns.end || columns.end > width || rows.start > rows.end || rows.end > height {
            let what =
                format!("columns {columns:?}, rows {rows:?}: the picture has {width} x {height} pixels");
            return Err(Error::usage(what));
        }
        let mut pixels = self.layer.window(&columns, &rows)?;
        if let Some(mask) = &self.mask {
            let mask = mask.window(&columns, &rows)?.colour;
            if mask.iter().any(|&a| a < 255) {
                let alpha = pixels.alpha.get_or_insert_with(|| vec![255; mask.len()]);
                alpha.iter_mut().zip(mask).for_each(|(alpha, mask)| *alpha = (*alpha).min(mask));
            }
        }
        Ok(pixels)
    }

    fn may_show(&self, columns: Range<u32>, rows: Range<u32>) -> bool {
        if columns.is_empty() || rows.is_empty() {
            return false;
        }
        self.layer.may_show(&columns, &rows)
    }

    fn memory(&self) -> Memory {
        let (own, mask) = (self.layer.memory(), self.mask.as_ref().map(Layer::memory).unwrap_or_default());
        Memory {
            reading: own.reading.max(mask.reading),
            block: own.block.max(mask.block),
            kept: own.kept.saturating_add(mask.kept),
        }
    }

    fn keep(&self, bytes: u64) {
        self.layer.cache.limit(bytes);
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        let mut all = self.layer.blocks.fingerprint()?;
        if let Some(mask) = &self.mask {
            let beside = mask.blocks.fingerprint()?.files;
            all.files.extend(beside.into_iter().filter(|file| !all.files.contains(file)).collect::<Vec<_>>());
        }
        for path in &self.beside {
            all.files.push(FileStamp::of(path)?);
        }
        Ok(all)
    }

    fn files(&self) -> Vec<PathBuf> {
        let layers = std::iter::once(&self.layer).chain(&self.mask);
        let mut all: Vec<PathBuf> = layers.flat_map(|layer| layer.blocks.files()).collect();
        all.extend(self.beside.iter().cloned());
        all.sort();
        all.dedup();
        all
    }
}
