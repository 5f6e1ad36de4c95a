//! Pictures read by GDAL, behind the feature `gdal`: other formats, and pictures in other
//! coordinate systems.
//!
//! A picture in another coordinate system is warped while it is read, by GDAL's `gdalwarp` into a
//! virtual raster: bilinear, or nearest for palettes, and transparent outside the source. Then it
//! is resampled onto the texel grid like any other. A dataset serves one thread at a time, so reads
//! are serialised; GDAL's messages become part of errors.

use std::ffi::{CStr, CString, c_char};
use std::path::{Path, PathBuf};
use std::ptr;
use std::sync::{Arc, Mutex, Once, PoisonError};

use gdal::Dataset;
use gdal::errors::GdalError;
use gdal::raster::{ColorInterpretation, GdalType, RasterBand};
use gdal::spatial_ref::{AxisMappingStrategy, SpatialRef};
use zerocopy::{Immutable, IntoBytes};

use crate::error::{Error, Result};
use crate::geo::{Crs, Geo};
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::account::{self, Role};
use crate::source::gdal::{describe, files};
use crate::source::picture::blocks::{Blocks, PictureParts, Raw, Shape};
use crate::source::picture::convert::Conversion;
use crate::source::picture::tiff::{choose, nodata, plain};
use crate::source::picture::{PLACE_ADVICE, PictureNote, PictureOptions};
use crate::source::{Fingerprint, file_name, metadata};

/// Side of the blocks that are read at a time; for pictures stored by rows, a block is some whole
/// rows.
const SIDE: usize = 512;
const ROW_BLOCK_BYTES: usize = 1 << 20;

/// An open dataset; a virtual one is dropped before the dataset it refers to.
struct Opened {
    warped: Option<Dataset>,
    source: Dataset,
}

impl Opened {
    fn dataset(&self) -> &Dataset {
        self.warped.as_ref().unwrap_or(&self.source)
    }
}

/// The bands of a dataset, or its mask.
struct GdalBlocks {
    path: PathBuf,
    files: Vec<PathBuf>,
    opened: Arc<Mutex<Opened>>,
    shape: Shape,
    kind: SampleType,
    is_mask: bool,
}

/// Opens a picture in coordinate system `crs`, warping it if necessary.
pub(in crate::source) fn open(
    path: &Path,
    options: &PictureOptions,
    crs: &Crs,
    limits: &Limits,
) -> Result<PictureParts> {
    static QUIET: Once = Once::new();
    QUIET.call_once(|| gdal::config::set_error_handler(|_, _, _| {}));
    let source = Dataset::open(crate::source::open::for_gdal(path, limits)?).map_err(|error| {
        Error::unsupported(format!("GDAL cannot open it ({error})"), "see what gdalinfo says of it")
    })?;
    let mut opened = Opened { warped: None, source };
    let (prj, beside) = beside(&opened.source, path, limits)?.unzip();
    opened.warped = match target(&opened.source, path, crs, beside.as_ref())? {
        Some(target) => Some(warp(&opened.source, &target, beside.as_ref())?),
        None => None,
    };
    let mut parts = parts(opened, path, options, crs, limits)?;
    parts.beside.extend(prj);
    Ok(parts)
}

/// The coordinate system in a `.prj` beside a picture without one, which GDAL ignores for most
/// formats.
fn beside(dataset: &Dataset, path: &Path, limits: &Limits) -> Result<Option<(PathBuf, SpatialRef)>> {
    if dataset.spatial_ref().is_ok() || dataset.gcp_spatial_ref().is_some() {
        return Ok(None);
    }
    describe::prj(path, limits)
}

/// The coordinate system to warp to; `None` if the picture is in it already.
fn target(
    dataset: &Dataset,
    path: &Path,
    crs: &Crs,
    beside: Option<&SpatialRef>,
) -> Result<Option<SpatialRef>> {
    let wrong = |error: GdalError| Error::usage(format!("the coordinate system of the heights: {error}"));
    let target = match crs.epsg {
        Some(code) => Some(SpatialRef::from_epsg(code).map_err(wrong)?),
        None if crate::source::picture::crs::is_unknown(crs) || crs.wkt.is_empty() => None,
        None => Some(SpatialRef::from_wkt(&crs.wkt).map_err(wrong)?),
    };
    let own = dataset.spatial_ref().ok().or_else(|| dataset.gcp_spatial_ref()).or_else(|| beside.cloned());
    match (own, target) {
        (None, None) => Ok(None),
        // A world file names no coordinate system: that of the heights is assumed.
        (None, Some(_)) if account::has_world_file(path) => Ok(None),
        (None, Some(_)) => Err(Error::usage(format!(
            "{}: it has no coordinate system: name it with gdal_edit.py -a_srs, or place it with gdal_translate -a_ullr and -a_srs",
            path.display()
        ))),
        (Some(_), None) => Err(Error::usage(format!(
            "{}: it has a coordinate system, the heights have none",
            path.display()
        ))),
        (Some(mut own), Some(mut target)) => {
            target.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
            own.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
            Ok((own != target || dataset.geo_transform().is_err()).then_some(target))
        }
    }
}

/// A virtual raster of the picture in another coordinate system, with an alpha band.
fn warp(dataset: &Dataset, target: &SpatialRef, own: Option<&SpatialRef>) -> Result<Dataset> {
    let wrong = |error: GdalError| Error::usage(format!("the coordinate system of the heights: {error}"));
    let indexed = dataset.rasterband(1).is_ok_and(|band| band.color_table().is_some());
    let method = if indexed { "near" } else { "bilinear" };
    let target = target.to_wkt().map_err(wrong)?;
    let own = own.map(SpatialRef::to_wkt).transpose().map_err(wrong)?;
    let mut words =
        vec!["-of", "VRT", "-dstalpha", "-wo", "UNIFIED_SRC_NODATA=YES", "-r", method, "-t_srs", &target];
    if let Some(own) = &own {
        words.extend(["-s_srs", own]);
    }
    let words: Vec<CString> = words.iter().map(|word| CString::new(*word).unwrap_or_default()).collect();
    let mut list: Vec<*mut c_char> = words.iter().map(|word| word.as_ptr().cast_mut()).collect();
    list.push(ptr::null_mut());
    let mut sources = [dataset.c_dataset()];
    // SAFETY: the list of words ends with a null and outlives the call that copies them; the
    // options are freed once, after their only use; the dataset is open, and outlives the one made
    // (see `Opened`). GDAL does not write to the words.
    #[expect(unsafe_code, reason = "the bindings have no safe call for it")]
    let warped = unsafe {
        gdal_sys::CPLErrorReset();
        let options = gdal_sys::GDALWarpAppOptionsNew(list.as_mut_ptr(), ptr::null_mut());
        let made = gdal_sys::GDALWarp(
            c"".as_ptr(),
            ptr::null_mut(),
            1,
            sources.as_mut_ptr(),
            options,
            ptr::null_mut(),
        );
        gdal_sys::GDALWarpAppOptionsFree(options);
        made
    };
    if warped.is_null() {
        // SAFETY: GDAL gives a C string that is valid until the next error of this thread; it is
        // copied here.
        #[expect(unsafe_code, reason = "the bindings have no safe call for it")]
        let message =
            unsafe { CStr::from_ptr(gdal_sys::CPLGetLastErrorMsg()).to_string_lossy().into_owned() };
        return Err(Error::usage(format!("GDAL cannot warp it ({message})")));
    }
    // SAFETY: it is an open dataset that nobody else has.
    #[expect(unsafe_code, reason = "the bindings have no safe call for it")]
    Ok(unsafe { Dataset::from_c_dataset(warped) })
}

/// Everything about a picture that is known when it is opened.
fn parts(
    opened: Opened,
    path: &Path,
    options: &PictureOptions,
    crs: &Crs,
    limits: &Limits,
) -> Result<PictureParts> {
    let wrong = |error: GdalError| Error::format("band 1", "a raster band", error);
    let dataset = opened.dataset();
    let first = dataset.rasterband(1).map_err(wrong)?;
    let shape = shape(&first, limits)?;
    let kind = sample_type(&first)?;
    let count = dataset.raster_count();
    // Warping gives every picture an alpha band.
    let has_alpha = roles(&opened.source).contains(&Role::Alpha);
    let palette = palette(&first);
    let (colours, alpha) = choose(&roles(dataset), options.bands.as_deref(), palette.is_some())?;
    let flags = first.mask_flags().map_err(wrong)?;
    let has_mask = !flags.is_all_valid() && !flags.is_nodata() && !flags.is_alpha();
    let nodata = nodata(&colours, |band| {
        let said = dataset.rasterband(band + 1).ok().filter(|_| !has_mask)?.no_data_value();
        said.map(|value| metadata::rounded(value, kind))
    });
    let Ok(transform) = dataset.geo_transform() else {
        return Err(Error::unsupported("a picture that does not say where it lies", PLACE_ADVICE));
    };
    let how = if opened.warped.is_some() { ", warped" } else { "" };
    let note = PictureNote {
        name: file_name(path),
        description: format!("{} through GDAL, {count} bands{how}", opened.source.driver().long_name()),
        bands: colours.iter().map(|&band| band as u32 + 1).collect(),
        stretch: Vec::new(),
    };
    let conversion = Conversion { kind, colours, alpha, palette, nodata, ..plain() };
    let files = files::of(&opened.source, path);
    let opened = Arc::new(Mutex::new(opened));
    let blocks = |is_mask, kind| {
        let (path, files, opened) = (path.to_owned(), files.clone(), Arc::clone(&opened));
        let blocks = GdalBlocks { path, files, opened, shape, kind, is_mask };
        Box::new(blocks) as Box<dyn Blocks>
    };
    let mask =
        has_mask.then(|| (blocks(true, SampleType::Uint8), Conversion { colours: vec![0], ..plain() }));
    let geo = Geo { transform: Some(transform), pixel_is_point: false, crs: crs.clone() };
    Ok(PictureParts {
        blocks: blocks(false, kind),
        conversion,
        geo,
        note,
        has_alpha,
        mask,
        beside: Vec::new(),
        placed_beside: false,
        warnings: Vec::new(),
    })
}

/// The role of each band.
fn roles(dataset: &Dataset) -> Vec<Role> {
    let role = |band: usize| match dataset.rasterband(band + 1).map(|band| band.color_interpretation()) {
        Ok(ColorInterpretation::GrayIndex) => Role::Grey,
        Ok(ColorInterpretation::PaletteIndex) => Role::Palette,
        Ok(ColorInterpretation::RedBand) => Role::Red,
        Ok(ColorInterpretation::GreenBand) => Role::Green,
        Ok(ColorInterpretation::BlueBand) => Role::Blue,
        Ok(ColorInterpretation::AlphaBand) => Role::Alpha,
        Ok(ColorInterpretation::Undefined) | Err(_) => Role::Undefined,
        Ok(_) => Role::Other,
    };
    (0..dataset.raster_count()).map(role).collect()
}

fn shape(band: &RasterBand<'_>, limits: &Limits) -> Result<Shape> {
    let (width, height) = band.size();
    for (what, side) in [("the width of the picture", width), ("the height of the picture", height)] {
        if side as u64 > limits.raster_side {
            return Err(Error::limit(what, side as u64, limits.raster_side));
        }
    }
    let by_rows = band.block_size().0 >= width;
    let (across, down) =
        if by_rows { (width, (ROW_BLOCK_BYTES / width.max(1)).max(1)) } else { (SIDE, SIDE) };
    Ok(Shape {
        width: width as u32,
        height: height as u32,
        block_width: across.clamp(1, width.max(1)) as u32,
        block_height: down.clamp(1, height.max(1)) as u32,
    })
}

fn sample_type(band: &RasterBand<'_>) -> Result<SampleType> {
    let name = band.band_type().name();
    let found = SampleType::ALL.into_iter().find(|kind| kind.gdal_name() == name);
    found.ok_or_else(|| {
        Error::usage(format!("a picture of {name} samples: convert it with gdal_translate -ot Float32"))
    })
}

fn palette(band: &RasterBand<'_>) -> Option<Vec<[u8; 3]>> {
    let table = band.color_table()?;
    let byte = |value: i16| value.clamp(0, 255) as u8;
    let entries = (0..table.entry_count()).map(|index| table.entry_as_rgb(index));
    Some(entries.map(|entry| entry.map_or([0; 3], |e| [byte(e.r), byte(e.g), byte(e.b)])).collect())
}

impl GdalBlocks {
    fn band(&self, dataset: &Dataset, band: usize, block: usize) -> Result<Vec<u8>, GdalError> {
        let band = dataset.rasterband(band + 1)?;
        let band = if self.is_mask { band.open_mask_band()? } else { band };
        match self.kind {
            SampleType::Int8 => self
                .samples::<i16>(&band, block, |samples| samples.iter().map(|&sample| sample as u8).collect()),
            SampleType::Uint8 => self.samples::<u8>(&band, block, <[u8]>::to_vec),
            SampleType::Int16 => self.samples::<i16>(&band, block, bytes),
            SampleType::Uint16 => self.samples::<u16>(&band, block, bytes),
            SampleType::Int32 => self.samples::<i32>(&band, block, bytes),
            SampleType::Uint32 => self.samples::<u32>(&band, block, bytes),
            SampleType::Float32 => self.samples::<f32>(&band, block, bytes),
            SampleType::Float64 => self.samples::<f64>(&band, block, bytes),
        }
    }

    /// Samples of a block, in rows of the block's width.
    fn samples<T: GdalType + Copy + Default>(
        &self,
        band: &RasterBand<'_>,
        block: usize,
        bytes: impl Fn(&[T]) -> Vec<u8>,
    ) -> Result<Vec<u8>, GdalError> {
        let (columns, rows) = self.shape.window(block);
        let size = (columns.len(), rows.len());
        let start = (columns.start as isize, rows.start as isize);
        let samples = band.read_as::<T>(start, size, size, None)?.into_shape_and_vec().1;
        let width = self.shape.block_width as usize;
        if columns.len() == width {
            return Ok(bytes(&samples));
        }
        let mut wide = vec![T::default(); width * rows.len()];
        for (wide, row) in wide.chunks_exact_mut(width).zip(samples.chunks_exact(columns.len())) {
            wide[..row.len()].copy_from_slice(row);
        }
        Ok(bytes(&wide))
    }
}

fn bytes<T: IntoBytes + Immutable>(samples: &[T]) -> Vec<u8> {
    samples.as_bytes().to_vec()
}

impl Blocks for GdalBlocks {
    fn shape(&self) -> Shape {
        self.shape
    }

    fn is_absent(&self, _block: usize, _bands: &[usize]) -> bool {
        false
    }

    fn read(&self, block: usize, bands: &[usize]) -> Result<Raw> {
        let opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        let read = |&band: &usize| self.band(opened.dataset(), band, block);
        let bytes: Result<Vec<_>, GdalError> = bands.iter().map(read).collect();
        let (_, rows) = self.shape.window(block);
        let bytes = bytes.map_err(|error| {
            Error::format(
                format!("rows {} to {}", rows.start, rows.end),
                "pixels",
                format!("GDAL's error: {error}"),
            )
        })?;
        Ok(Raw { bytes, planes: (0..bands.len()).map(|at| (at, 0, 1)).collect() })
    }

    fn files(&self) -> Vec<PathBuf> {
        self.files.clone()
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        files::fingerprint(&self.files)
    }

    fn locate(&self, error: Error) -> Error {
        error.at(&self.path)
    }
}
