//! GeoTIFF, natively: strips and tiles, classic and big, either byte order, the compressions that DEMs come in.
//!
//! Band 1 of the first image is the elevation. An internal mask (or a `.msk` file beside, as GDAL writes it) comes
//! along; overviews, further bands and alpha are passed over. The file is read by position (see `file`), of a window only
//! the blocks or bytes that it needs, and every number in the file is checked before it is used. Samples and
//! georeference are what GDAL reads; a few things GDAL looks up outside the file (`.aux.xml`, world files) are not.

mod blocks;
mod decode;
mod direct;
mod directory;
mod file;
mod georeference;
mod jpeg;
mod layout;
mod parts;
pub(in crate::source) mod raster;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tiff::Directory;
use tiff::tags::Tag;

use self::blocks::Band;
use self::directory::{GDAL_METADATA, Reader};
use self::file::TiffFile;
use self::layout::{Layout, Purpose, Stored};
use super::{FileStamp, Fingerprint, Part, Samples, Source, SourceInfo, Window, file_name, metadata};
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::sample::SampleType;

/// Bit of `NewSubfileType`: a smaller version of another image.
const REDUCED: u64 = 1;
/// Bit of `NewSubfileType`: a transparency mask.
const MASK: u64 = 4;

/// A GeoTIFF that windows can be read from.
pub struct TiffSource {
    info: SourceInfo,
    heights: Band,
    mask: Option<Band>,
    /// Memory of a window that has been taken back.
    spare: Mutex<Option<Window>>,
}

impl TiffSource {
    /// Opens a file, reads its directories and checks them.
    ///
    /// A file that does not start like a TIFF is [`Error::Unsupported`], as is a TIFF that needs what is missing here.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self> {
        Self::open_inner(path, limits).map_err(|error| error.at(path))
    }

    fn open_inner(path: &Path, limits: &Limits) -> Result<Self> {
        let file = Arc::new(TiffFile::open(path)?);
        let mut reader = Reader::new(file.cursor(), file.length(), limits)?;
        let directories = reader.directories()?;
        let image = directories.first().ok_or_else(|| Error::format("TIFF header", "an image", "none"))?;
        let layout = Layout::read(&mut reader, image, limits, Purpose::FirstBand)?;
        let Stored::Number(kind) = layout.stored else {
            return Err(Error::unsupported("1-bit samples", "convert it with gdal_translate -ot Byte"));
        };
        let info = describe(&mut reader, image, &layout, kind, path)?;
        let mask = match internal_mask(&mut reader, &directories, &layout, limits)? {
            Some(mask) => Some(Band::new(Arc::clone(&file), mask)),
            None => external_mask(path, &layout, limits)?,
        };
        drop(reader);
        Ok(Self { info, heights: Band::new(file, layout), mask, spare: Mutex::default() })
    }

    /// Writes the samples of a window over `out`, which are of the file's type.
    fn samples(&self, columns: &Range<u32>, rows: &Range<u32>, out: &mut Samples) -> Result<()> {
        let fill = self.info.nodata.unwrap_or(0.0);
        let (band, whole) = (&self.heights, fill.round());
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
        let heights = self.samples(&columns, &rows, &mut window.samples);
        heights.map_err(|error| error.at(self.heights.file.path()))?;
        match &self.mask {
            None => window.mask = None,
            Some(mask) => {
                let out = window.mask.get_or_insert_default();
                mask.window(&columns, &rows, 0_u8, out).map_err(|error| error.at(mask.file.path()))?;
            }
        }
        Ok(window)
    }

    fn take_back(&self, window: Window) {
        *self.spare() = Some(window);
    }

    fn release(&self) {
        *self.spare() = None;
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        let heights = self.heights.file.path();
        let beside = self.mask.iter().map(|mask| mask.file.path()).filter(|path| *path != heights);
        Ok(Fingerprint {
            files: std::iter::once(heights).chain(beside).map(FileStamp::of).collect::<Result<_>>()?,
        })
    }
}

fn describe(
    reader: &mut Reader<'_>,
    image: &Directory,
    layout: &Layout,
    kind: SampleType,
    path: &Path,
) -> Result<SourceInfo> {
    let nodata = reader.text(image, Tag::GdalNodata)?.and_then(|text| metadata::nodata(&text, kind));
    let items = reader.text(image, GDAL_METADATA)?.map(|xml| metadata::items(&xml)).unwrap_or_default();
    let place = georeference::read(reader, image)?;
    let (scale, offset) = match (items.scale, items.offset, place.scale_offset) {
        (None, None, Some(both)) => both,
        (scale, offset, _) => (scale.unwrap_or(1.0), offset.unwrap_or(0.0)),
    };
    let name = if reader.big { "GeoTIFF (big)" } else { "GeoTIFF" };
    // Rows of an uncompressed strip can be read one by one.
    let block_rows =
        if layout.is_direct() && !layout.tiled { 1 } else { layout.block_height.min(layout.height) };
    let description = format!("{name}, {}", layout.describe());
    Ok(SourceInfo {
        width: layout.width,
        height: layout.height,
        sample_type: kind,
        nodata,
        band_scale: scale,
        band_offset: offset,
        vertical_unit: metadata::vertical_unit(items.unit.as_deref(), place.vertical_unit),
        geo: place.geo,
        parts: vec![Part { name: file_name(path), description: description.clone() }],
        footprint: None,
        overlap: None,
        description,
        block_rows,
    })
}

/// The first mask of full size among the directories.
fn internal_mask(
    reader: &mut Reader<'_>,
    directories: &[Directory],
    of: &Layout,
    limits: &Limits,
) -> Result<Option<Layout>> {
    for directory in directories.iter().skip(1) {
        let kind = reader.integer(directory, Tag::NewSubfileType)?.unwrap_or(0);
        if kind & MASK == 0 || kind & REDUCED != 0 {
            continue;
        }
        let mask = Layout::read(reader, directory, limits, Purpose::FirstBand)?;
        if (mask.width, mask.height) == (of.width, of.height) {
            return check_mask(mask).map(Some);
        }
    }
    Ok(None)
}

fn check_mask(mask: Layout) -> Result<Layout> {
    match mask.stored {
        Stored::Bit | Stored::Number(SampleType::Uint8) => Ok(mask),
        Stored::Number(kind) => Err(Error::unsupported(
            format!("a mask of {} samples", kind.gdal_name()),
            "write it with 1 or 8 bits",
        )),
    }
}

/// `dem.tif.msk`, where GDAL puts a mask unless told to put it inside.
fn external_mask(path: &Path, of: &Layout, limits: &Limits) -> Result<Option<Band>> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".msk");
    let beside = PathBuf::from(beside);
    if !beside.is_file() {
        return Ok(None);
    }
    let read = || {
        let file = Arc::new(TiffFile::open(&beside)?);
        let mut reader = Reader::new(file.cursor(), file.length(), limits)?;
        let directories = reader.directories()?;
        let image = directories.first().ok_or_else(|| Error::format("TIFF header", "an image", "none"))?;
        let mask = check_mask(Layout::read(&mut reader, image, limits, Purpose::FirstBand)?)?;
        if (mask.width, mask.height) != (of.width, of.height) {
            let expected = format!("a mask of {} x {}", of.width, of.height);
            return Err(Error::format("size", expected, format!("{} x {}", mask.width, mask.height)));
        }
        drop(reader);
        Ok(Some(Band::new(file, mask)))
    };
    read().map_err(|error: Error| error.at(&beside))
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
