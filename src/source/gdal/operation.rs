//! A safe wrapper of GDAL's warper: warps one band of one source into blocks of a target grid.
//!
//! The transformation is exact for every sample (`gdalwarp -et 0`). The ratio of the two
//! resolutions, which sets the kernel widths, is that of the whole raster (`-wo XSCALE`), not of
//! the block, so a sample does not depend on the block it is made in.

use std::ffi::{CStr, CString, c_int, c_void};
use std::ptr;

use gdal::Dataset;
use gdal::raster::GdalType;
use gdal_sys::GDALResampleAlg as Alg;

use super::target::Lattice;
use crate::error::{Error, Result};
use crate::sample::SampleType;
use crate::source::Samples;
use crate::source::warp::Resampling;

/// The parameters of a warp.
#[derive(Clone, Debug)]
pub(super) struct Request {
    /// Coordinate system of the source, if not the dataset's own.
    pub(super) source_srs: Option<String>,
    /// Coordinate system of the target as WKT; `None`: that of the source.
    pub(super) target_srs: Option<String>,
    /// The target grid.
    pub(super) lattice: Lattice,
    pub(super) resampling: Resampling,
    /// The nodata value of the source.
    pub(super) source_nodata: Option<f64>,
    /// The nodata value of the target.
    pub(super) nodata: f64,
    /// Sample type of the target.
    pub(super) sample_type: SampleType,
    /// Number of the source's band, from 1.
    pub(super) band: c_int,
    /// Number of the source's alpha band; 0 if there is none.
    pub(super) alpha: c_int,
    /// Target samples per source sample along each axis.
    pub(super) scale: (f64, f64),
}

/// A prepared warp of one dataset, for one thread at a time.
pub(super) struct Operation {
    handle: gdal_sys::GDALWarpOperationH,
    transformer: *mut c_void,
    request: Request,
    // The two handles above refer to the dataset.
    dataset: Dataset,
}

// SAFETY: the handles belong to this value alone and are used by whoever owns it, one thread after
// the other, which GDAL allows for datasets, transformers and operations alike.
#[expect(unsafe_code, reason = "the handles of GDAL are plain pointers")]
unsafe impl Send for Operation {}

impl Operation {
    /// Prepares the warp of a dataset.
    pub(super) fn new(dataset: Dataset, request: &Request) -> Result<Self> {
        let transformer = transformer(&dataset, request)?;
        let mut operation = Self { handle: ptr::null_mut(), transformer, request: request.clone(), dataset };
        operation.create()?;
        Ok(operation)
    }

    #[expect(unsafe_code, reason = "the bindings have no safe call for it")]
    fn create(&mut self) -> Result<()> {
        let request = &self.request;
        // SAFETY: GDAL makes the options and frees them; arrays in them come from its own
        // allocator, which ends the program if there is no memory, and have one entry for the one
        // band. The operation keeps a copy of the options, and refers to the dataset and the
        // transformer, which live as long as it (see `drop`).
        unsafe {
            let options = gdal_sys::GDALCreateWarpOptions();
            let o = &mut *options;
            o.hSrcDS = self.dataset.c_dataset();
            o.eResampleAlg = algorithm(request.resampling);
            o.eWorkingDataType = gdal_type(request.sample_type);
            o.nBandCount = 1;
            o.panSrcBands = allocated(request.band);
            o.panDstBands = allocated(1);
            o.nSrcAlphaBand = request.alpha;
            if let Some(nodata) = request.source_nodata {
                o.padfSrcNoDataReal = allocated(nodata);
            }
            o.padfDstNoDataReal = allocated(request.nodata);
            o.pfnTransformer = Some(gdal_sys::GDALGenImgProjTransform);
            o.pTransformerArg = self.transformer;
            let (x, y) = request.scale;
            for (key, value) in [
                (c"XSCALE", format!("{x:e}")),
                (c"YSCALE", format!("{y:e}")),
                // The edges of a block may be curved and reach slightly beyond the 21 points of
                // each that GDAL samples.
                (c"SOURCE_EXTRA", "4".to_owned()),
                (c"SAMPLE_GRID", "YES".to_owned()),
            ] {
                let value = CString::new(value).unwrap_or_default();
                o.papszWarpOptions =
                    gdal_sys::CSLSetNameValue(o.papszWarpOptions, key.as_ptr(), value.as_ptr());
            }
            gdal_sys::CPLErrorReset();
            self.handle = gdal_sys::GDALCreateWarpOperation(options);
            gdal_sys::GDALDestroyWarpOptions(options);
        }
        if self.handle.is_null() { Err(failed("set up the warp")) } else { Ok(()) }
    }

    /// Samples of a block `[column, row, width, height]` of the target grid, which must lie inside
    /// it.
    pub(super) fn block(&self, [column, row, width, height]: [u32; 4]) -> Result<Samples> {
        let kind = self.request.sample_type;
        // The warper writes only where the source has samples.
        let mut samples = filled(kind, width as usize * height as usize, self.request.nodata);
        let data: *mut c_void = crate::source::with_samples!(&mut samples, all => all.as_mut_ptr().cast());
        let [x, y, w, h] = [column, row, width, height].map(|value| value as c_int);
        // SAFETY: the buffer has width times height samples of the type that is named.
        #[expect(unsafe_code, reason = "the bindings have no safe call for it")]
        let code = unsafe {
            gdal_sys::CPLErrorReset();
            gdal_sys::GDALWarpRegionToBuffer(self.handle, x, y, w, h, data, gdal_type(kind), 0, 0, 0, 0)
        };
        if code == gdal_sys::CPLErr::CE_None { Ok(samples) } else { Err(failed("warp a block")) }
    }
}

impl Drop for Operation {
    fn drop(&mut self) {
        // SAFETY: both were made by GDAL, are null or valid, and are not used again; the dataset
        // goes after them.
        #[expect(unsafe_code, reason = "the bindings have no safe call for it")]
        unsafe {
            if !self.handle.is_null() {
                gdal_sys::GDALDestroyWarpOperation(self.handle);
            }
            gdal_sys::GDALDestroyGenImgProjTransformer(self.transformer);
        }
    }
}

/// The transformer between samples of the target grid and samples of the source, without
/// approximation.
fn transformer(dataset: &Dataset, request: &Request) -> Result<*mut c_void> {
    let mut options = gdal::cpl::CslStringList::new();
    for (key, value) in [("SRC_SRS", &request.source_srs), ("DST_SRS", &request.target_srs)] {
        if let Some(value) = value {
            options.set_name_value(key, value).map_err(|error| Error::usage(error.to_string()))?;
        }
    }
    let transform = request.lattice.transform();
    // SAFETY: the dataset is open; the options are a list of strings, copied by GDAL; the
    // geotransform has six numbers.
    #[expect(unsafe_code, reason = "the bindings have no safe call for it")]
    let transformer = unsafe {
        gdal_sys::CPLErrorReset();
        let made = gdal_sys::GDALCreateGenImgProjTransformer2(
            dataset.c_dataset(),
            ptr::null_mut(),
            options.as_ptr(),
        );
        if !made.is_null() {
            gdal_sys::GDALSetGenImgProjTransformerDstGeoTransform(made, transform.as_ptr());
        }
        made
    };
    if transformer.is_null() { Err(failed("transform its coordinates")) } else { Ok(transformer) }
}

/// Copies a value into memory of GDAL's allocator.
///
/// # Safety The caller must have GDAL free the memory.
#[expect(unsafe_code, reason = "GDAL frees it")]
unsafe fn allocated<T>(value: T) -> *mut T {
    // SAFETY: CPLMalloc gives memory for any type, or ends the program.
    unsafe {
        let place: *mut T = gdal_sys::CPLMalloc(size_of::<T>()).cast();
        place.write(value);
        place
    }
}

/// The error of a failed call, with GDAL's message.
pub(super) fn failed(what: &str) -> Error {
    // SAFETY: GDAL gives a C string that is valid until the next error of this thread; it is copied
    // here.
    #[expect(unsafe_code, reason = "the bindings have no safe call for it")]
    let message = unsafe { CStr::from_ptr(gdal_sys::CPLGetLastErrorMsg()).to_string_lossy().into_owned() };
    let message = if message.is_empty() { "it does not say why".to_owned() } else { message };
    Error::unsupported(format!("GDAL cannot {what} ({message})"), "see what gdalwarp says of it")
}

/// `count` samples of one value.
pub(super) fn filled(kind: SampleType, count: usize, value: f64) -> Samples {
    match kind {
        SampleType::Int8 => Samples::Int8(vec![value as i8; count]),
        SampleType::Uint8 => Samples::Uint8(vec![value as u8; count]),
        SampleType::Int16 => Samples::Int16(vec![value as i16; count]),
        SampleType::Uint16 => Samples::Uint16(vec![value as u16; count]),
        SampleType::Int32 => Samples::Int32(vec![value as i32; count]),
        SampleType::Uint32 => Samples::Uint32(vec![value as u32; count]),
        SampleType::Float32 => Samples::Float32(vec![value as f32; count]),
        SampleType::Float64 => Samples::Float64(vec![value; count]),
    }
}

/// GDAL's number of a sample type. Not every version of GDAL has int8; it is widened by the caller.
fn gdal_type(kind: SampleType) -> gdal_sys::GDALDataType::Type {
    match kind {
        SampleType::Uint8 | SampleType::Int8 => u8::gdal_ordinal(),
        SampleType::Int16 => i16::gdal_ordinal(),
        SampleType::Uint16 => u16::gdal_ordinal(),
        SampleType::Int32 => i32::gdal_ordinal(),
        SampleType::Uint32 => u32::gdal_ordinal(),
        SampleType::Float32 => f32::gdal_ordinal(),
        SampleType::Float64 => f64::gdal_ordinal(),
    }
}

fn algorithm(resampling: Resampling) -> Alg::Type {
    match resampling {
        Resampling::Near => Alg::GRA_NearestNeighbour,
        Resampling::Bilinear => Alg::GRA_Bilinear,
        Resampling::Cubic => Alg::GRA_Cubic,
        Resampling::CubicSpline => Alg::GRA_CubicSpline,
        Resampling::Lanczos => Alg::GRA_Lanczos,
        Resampling::Average => Alg::GRA_Average,
    }
}
