//! GeoTIFF, read natively: strips and tiles, classic and BigTIFF, either byte order, and the
//! compressions common for DEMs.
//!
//! Band 1 of the first image holds the heights unless another is chosen. An internal mask, a `.msk`
//! file beside (as GDAL writes it) or an alpha band gives validity; overviews and other bands are
//! ignored. The file is read by position (see `file`); a window reads only the blocks or bytes that
//! it needs, and every number in the file is checked before use. Samples and properties are those
//! that GDAL gives, including sidecars (see `account`).

mod blocks;
mod decode;
mod direct;
mod directory;
mod file;
mod georeference;
pub(in crate::source) mod jpeg;
mod layout;
mod parts;
pub(in crate::source) mod raster;
mod validity;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tiff::tags::Tag;

use self::blocks::Band;
use self::directory::{Directory, Reader};
use self::file::TiffFile;
pub(super) use self::layout::no_band;
use self::layout::{Layout, Purpose, Stored};
use super::account::{Account, Origin, Role};
use super::{
    FileStamp, Fingerprint, Part, ReadMemory, Samples, Source, SourceInfo, Window, file_name, metadata, warn,
};
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::sample::SampleType;

/// Bit of `NewSubfileType`: a reduced version of another image.
const REDUCED: u64 = 1;
/// Bit of `NewSubfileType`: a transparency mask.
const MASK: u64 = 4;

/// A GeoTIFF as a source.
pub struct TiffSource {
    info: SourceInfo,
    heights: Band,
    /// Sample value of blocks that a sparse file lacks.
    fill: f64,
    mask: Option<Validity>,
    /// Sidecars that were read.
    beside: Vec<PathBuf>,
    /// A window that was taken back, for reuse of its memory.
    spare: Mutex<Option<Window>>,
}

/// A mask or alpha band: samples are valid where it is not 0.
struct Validity {
    band: Band,
    kind: SampleType,
}

impl TiffSource {
    /// Opens a file, reads its directories and checks them.
    ///
    /// A file that does not begin as a TIFF is [`Error::Unsupported`], and so is a TIFF with a
    /// feature that this reader lacks.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self> {
        Self::open_band(path, None, limits)
    }

    /// Opens a file as [`TiffSource::open`] does, with the heights in `band`, from 1.
    pub fn open_band(path: &Path, band: Option<u32>, limits: &Limits) -> Result<Self> {
        Self::open_inner(path, band, limits).map_err(|error| error.at(path))
    }

    fn open_inner(path: &Path, chosen: Option<u32>, limits: &Limits) -> Result<Self> {
        // Band 0 wraps around and is refused like a band beyond the last.
        let band = chosen.unwrap_or(1).wrapping_sub(1);
        let file = Arc::new(TiffFile::open(path, limits)?);
        let mut reader = Reader::new(&file, limits)?;
        let directories = reader.directories()?;
        let image = directories.first().ok_or_else(|| Error::format("TIFF header", "an image", "none"))?;
        let layout = Layout::read(&mut reader, image, limits, Purpose::Band(band))?;
        let Stored::Number(kind) = layout.stored else {
            return Err(Error::unsupported("1-bit samples", "convert it with gdal_translate -ot Byte"));
        };
        let (mut info, account) = describe(&mut reader, image, &layout, kind, (&file, limits))?;
        let fill = info.nodata.unwrap_or(0.0);
        let of = (&layout, band);
        let mask = match validity::internal_mask(&mut reader, &directories, of, limits)? {
            Some(mask) => Some(Band::new(Arc::clone(&file), mask)),
            None => validity::external_mask(path, of, limits)?,
        };
        if let (Some(_), Some(nodata)) = (&mask, info.nodata) {
            info.warnings.push(warn::mask_and_nodata(path, nodata));
            (info.nodata, info.origins.nodata) = (None, None);
        }
        let alpha = validity::alpha((&mut reader, image), of, &account, limits)?;
        if chosen.is_none() {
            let colours = colours(&mut reader, image, &account)?;
            let bands = layout.band_count - u32::from(alpha.is_some());
            info.warnings.extend(warn::odd_band(path, bands, kind, colours));
        }
        // Next to an alpha band, a nodata value outside the sample type does not count. GDAL
        // compares the value of the tag after rounding it to float32, also an infinite one.
        let is_float_tag = kind == SampleType::Float32 && matches!(info.origins.nodata, Some(Origin::Tag(_)));
        let nodata = info.nodata.filter(|_| is_float_tag || info.voids().is_of(kind));
        let mask = match (mask, alpha, nodata) {
            (None, Some(alpha), None) => Some(Band::new(Arc::clone(&file), alpha)),
            (None, Some(_), Some(nodata)) => {
                info.warnings.push(warn::alpha_and_nodata(path, nodata));
                None
            }
            (mask, ..) => mask,
        };
        let mask = mask.map(|band| {
            let kind = if let Stored::Number(kind) = band.layout.stored { kind } else { SampleType::Uint8 };
            Validity { band, kind }
        });
        info.origins.mask = mask.as_ref().map(|mask| match mask.band.file.path() {
            own if own == path => Origin::Inside,
            other => Origin::MaskFile(file_name(other)),
        });
        let (heights, beside) = (Band::new(file, layout), account.files);
        info.reading =
            mask.iter().fold(heights.reading(), |all, mask: &Validity| all.and(mask.band.reading()));
        Ok(Self { info, heights, fill, mask, beside, spare: Mutex::default() })
    }

    fn spare(&self) -> MutexGuard<'_, Option<Window>> {
        self.spare.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Source for TiffSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window> {
        super::check_window(&self.info, &columns, &rows)?;
        let spare = self.spare().take().filter(|spare| spare.samples.sample_type() == self.info.sample_type);
        let mut window =
            spare.unwrap_or_else(|| Window { samples: Samples::none(self.info.sample_type), mask: None });
        let heights = samples(&self.heights, self.fill, (&columns, &rows), &mut window.samples);
        heights.map_err(|error| error.at(self.heights.file.path()))?;
        match &self.mask {
            None => window.mask = None,
            Some(mask) => {
                let out = window.mask.get_or_insert_default();
                let read = mask.window(&columns, &rows, out);
                read.map_err(|error| error.at(mask.band.file.path()))?;
            }
        }
        Ok(window)
    }

    fn take_back(&self, window: Window) {
        *self.spare() = Some(window);
    }

    fn release(&self) {
        *self.spare() = None;
        for band in std::iter::once(&self.heights).chain(self.mask.iter().map(|mask| &mask.band)) {
            band.release();
        }
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        Ok(Fingerprint { files: self.files().iter().map(|path| FileStamp::of(path)).collect::<Result<_>>()? })
    }

    fn files(&self) -> Vec<PathBuf> {
        let heights = self.heights.file.path();
        let mask = self.mask.iter().map(|mask| mask.band.file.path()).filter(|path| *path != heights);
        let beside = self.beside.iter().map(PathBuf::as_path);
        std::iter::once(heights).chain(mask).chain(beside).map(Path::to_owned).collect()
    }
}

/// What the samples of an image are, if not heights.
fn colours(reader: &mut Reader<'_>, image: &Directory, account: &Account) -> Result<Option<&'static str>> {
    match account.role(1) {
        Some(Role::Red | Role::Green | Role::Blue) => return Ok(Some("RGB")),
        Some(Role::Palette) => return Ok(Some("palette")),
        Some(Role::Grey) => return Ok(None),
        _ => {}
    }
    Ok(match reader.integer(image, Tag::PhotometricInterpretation)? {
        Some(2 | 6) => Some("RGB"),
        Some(3) => Some("palette"),
        _ => None,
    })
}

impl Validity {
    /// Reads a window into `out`: non-zero where a sample is valid.
    fn window(&self, columns: &Range<u32>, rows: &Range<u32>, out: &mut Vec<u8>) -> Result<()> {
        if self.kind == SampleType::Uint8 {
            return self.band.window(columns, rows, 0, out);
        }
        let mut alpha = Samples::none(self.kind);
        samples(&self.band, 0.0, (columns, rows), &mut alpha)?;
        out.clear();
        // NaN as alpha does not make a sample valid.
        out.extend((0..alpha.len()).map(|index| u8::from(alpha.value(index).abs() > 0.0)));
        Ok(())
    }
}

/// Reads the samples of a window into `out`, which is of the band's type.
fn samples(
    band: &Band,
    fill: f64,
    (columns, rows): (&Range<u32>, &Range<u32>),
    out: &mut Samples,
) -> Result<()> {
    let whole = fill.round();
    match out {
        Samples::Int8(out) => band.window(columns, rows, whole as i8, out),
        Samples::Uint8(out) => band.window(columns, rows, whole as u8, out),
        Samples::Int16(out) => band.window(columns, rows, whole as i16, out),
        Samples::Uint16(out) => band.window(columns, rows, whole as u16, out),
        Samples::Int32(out) => band.window(columns, rows, whole as i32, out),
        Samples::Uint32(out) => band.window(columns, rows, whole as u32, out),
        Samples::Float32(out) => band.window(columns, rows, fill as f32, out),
        Samples::Float64(out) => band.window(columns, rows, fill, out),
    }
}

/// The properties of the raster.
fn describe(
    reader: &mut Reader<'_>,
    image: &Directory,
    layout: &Layout,
    kind: SampleType,
    (file, limits): (&TiffFile, &Limits),
) -> Result<(SourceInfo, Account)> {
    let path = file.path();
    let account = Account::gathered(path, georeference::read(reader, image)?, limits)?;
    let band = account.band(layout.band + 1)?;
    metadata::check_scale(band.scale, band.offset)?;
    let name = if reader.big { "GeoTIFF (big)" } else { "GeoTIFF" };
    // Rows of an uncompressed strip can be read one by one.
    let block_rows =
        if layout.is_direct() && !layout.tiled { 1 } else { layout.block_height.min(layout.height) };
    let packed = if file.is_gzipped() { ", gzipped" } else { "" };
    let description = format!("{name}, {}{packed}", layout.describe());
    let info = SourceInfo {
        width: layout.width,
        height: layout.height,
        sample_type: kind,
        nodata: band.nodata.map(|value| metadata::rounded(value, kind)),
        band_scale: band.scale,
        band_offset: band.offset,
        vertical_unit: band.unit,
        geo: account.geo.clone(),
        parts: vec![Part { name: file_name(path), description: description.clone() }],
        footprint: None,
        overlap: None,
        description,
        block_rows,
        reading: ReadMemory::default(),
        warnings: account.warnings.clone(),
        origins: band.origins,
    };
    Ok((info, account))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering;

    use tiff::encoder::{Compression, DeflateLevel, TiffEncoder, colortype};

    use super::*;

    fn strips(path: &Path, width: u32, height: u32, rows: u32) -> Vec<i16> {
        let samples: Vec<i16> =
            (0..width * height).map(|index| (index * 7919 % 30011) as i16 - 9000).collect();
        let file = std::fs::File::create(path).expect("file");
        let mut encoder = TiffEncoder::new(file)
            .expect("header")
            .with_compression(Compression::Deflate(DeflateLevel::Fast));
        let mut image = encoder.new_image::<colortype::GrayI16>(width, height).expect("image");
        image.rows_per_strip(rows).expect("strips");
        image.write_data(&samples).expect("samples");
        samples
    }

    #[test]
    fn a_sweep_decodes_no_block_twice() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("strips.tif");
        for strip in [1, 7, 40, 100] {
            let samples = strips(&path, 31, 100, strip);
            for (band, overlap) in [(10, 0), (10, 1), (11, 3), (33, 1), (100, 1), (1, 0)] {
                let source = TiffSource::open(&path, &Limits::default()).expect("open");
                let mut start = 0;
                loop {
                    let end = (start + band).min(100);
                    let Samples::Int16(got) = source.read_rows(start..end).expect("rows").samples else {
                        panic!()
                    };
                    assert_eq!(got, samples[start as usize * 31..end as usize * 31]);
                    if end == 100 {
                        break;
                    }
                    start = end - overlap;
                }
                let decoded = source.heights.decoded.load(Ordering::Relaxed);
                assert_eq!(decoded, 100_usize.div_ceil(strip as usize), "strips of {strip}, bands of {band}");
            }
        }
    }

    #[test]
    fn sweeps_over_different_columns_keep_their_blocks_apart() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("strips.tif");
        let samples = strips(&path, 31, 100, 7);
        let source = TiffSource::open(&path, &Limits::default()).expect("open");
        for start in (0..100).step_by(10) {
            for columns in [0..4, 4..20, 19..31] {
                let rows = start..(start + 11).min(100);
                let window = source.read_window(columns.clone(), rows.clone()).expect("window");
                let Samples::Int16(got) = window.samples else { panic!() };
                let expected = rows.flat_map(|y| {
                    samples[y as usize * 31..][..31][columns.start as usize..columns.end as usize].to_vec()
                });
                assert!(got.into_iter().eq(expected), "{columns:?} from row {start}");
            }
        }
        // Each of the three has decoded each of the 15 strips once.
        assert_eq!(source.heights.decoded.load(Ordering::Relaxed), 3 * 15);
    }

    #[test]
    fn rows_outside_are_refused() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("strips.tif");
        strips(&path, 3, 4, 2);
        let source = TiffSource::open(&path, &Limits::default()).expect("open");
        assert!(matches!(source.read_rows(3..5), Err(Error::Usage { .. })));
        assert_eq!(source.read_rows(2..2).expect("nothing").samples.len(), 0);
    }
}
