//! The target grid of a warp: one lattice for all rasters, as `gdalwarp` would choose it.

use std::ffi::{CString, c_char};
use std::ops::Range;
use std::ptr;

use gdal::Dataset;
use gdal::spatial_ref::SpatialRef;

use super::describe::{self, side, wkt2};
use super::operation::failed;
use crate::error::{Error, Result};
use crate::geo::Crs;
use crate::limits::Limits;

/// A grid with rows to the east and columns to the south.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lattice {
    /// Coordinates of the west and the north edge.
    pub(super) corner: (f64, f64),
    /// Steps to the east and to the south, both positive.
    pub(super) step: (f64, f64),
    pub(super) width: u32,
    pub(super) height: u32,
}

impl Lattice {
    /// The geotransform.
    pub(super) fn transform(&self) -> [f64; 6] {
        [self.corner.0, self.step.0, 0.0, self.corner.1, 0.0, -self.step.1]
    }

    /// West, south, east and north edge.
    pub(super) fn bounds(&self) -> [f64; 4] {
        let [x, y] = [self.corner.0, self.corner.1];
        [x, y - self.step.1 * f64::from(self.height), x + self.step.0 * f64::from(self.width), y]
    }

    /// The lattice of several, as `gdalwarp` makes it: from their westernmost and northernmost
    /// edge, with the finest steps that one of them has, to about their other edges; then with the
    /// given steps over that same extent.
    pub(super) fn union(all: &[Self], step: Option<(f64, f64)>, limits: &Limits) -> Result<Self> {
        if let [only] = all {
            return Ok(*only);
        }
        let nothing = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        let bounds = all
            .iter()
            .map(Self::bounds)
            .fold(nothing, |a, b| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]);
        let finest =
            all.iter().fold((f64::INFINITY, f64::INFINITY), |s, l| (s.0.min(l.step.0), s.1.min(l.step.1)));
        let own = Self::over(bounds, finest, limits)?;
        step.map_or(Ok(own), |step| Self::over(own.bounds(), step, limits))
    }

    fn over([west, south, east, north]: [f64; 4], step: (f64, f64), limits: &Limits) -> Result<Self> {
        let count = |length: f64, step: f64| (length / step + 0.5) as u64;
        Ok(Self {
            corner: (west, north),
            step,
            width: side("the width of the warped raster", count(east - west, step.0), limits)?,
            height: side("the height of the warped raster", count(north - south, step.1), limits)?,
        })
    }

    /// Columns and rows that may hold samples of a raster with these bounds.
    pub(super) fn covered(&self, bounds: [f64; 4]) -> (Range<u32>, Range<u32>) {
        let [west, south, east, north] = bounds;
        // The bounds are those of points of the outline, which may bulge between them.
        let range = |from: f64, to: f64, most: u32| {
            let (from, to) = (from.floor() - 2.0, to.ceil() + 2.0);
            let from = (from.max(0.0) as u32).min(most - 1);
            from..(to.max(0.0) as u32).clamp(from + 1, most)
        };
        let (x, y) = self.corner;
        (
            range((west - x) / self.step.0, (east - x) / self.step.0, self.width),
            range((y - north) / self.step.1, (y - south) / self.step.1, self.height),
        )
    }

    /// A part of the lattice.
    pub(super) fn part(&self, columns: &Range<u32>, rows: &Range<u32>) -> Self {
        let at = |from: f64, step: f64, index: u32| from + step * f64::from(index);
        Self {
            corner: (
                at(self.corner.0, self.step.0, columns.start),
                at(self.corner.1, -self.step.1, rows.start),
            ),
            step: self.step,
            width: columns.len() as u32,
            height: rows.len() as u32,
        }
    }
}

/// A coordinate system without its vertical part. Warping never converts heights to another
/// vertical datum.
pub(super) struct Horizontal {
    /// The text as WKT 2.
    pub(super) wkt: String,
    /// The coordinate system to record, which still names the vertical part.
    pub(super) crs: Crs,
    /// Metres and name of the vertical unit, if there was a vertical part.
    pub(super) vertical_unit: Option<(f64, String)>,
    /// True if a vertical part was removed.
    pub(super) stripped: bool,
}

impl Horizontal {
    /// Parses a system given by the user: `EPSG:…`, WKT, or another form that GDAL reads.
    pub(super) fn of_user(text: &str) -> Result<Self> {
        let spatial = SpatialRef::from_definition(text).map_err(|error| {
            Error::usage(format!(
                "`crs` {text}: GDAL knows no such coordinate system ({error}); give EPSG:32633 or WKT"
            ))
        })?;
        if !spatial.is_projected() && !spatial.is_geographic() {
            return Err(Error::usage(format!(
                "`crs` {text}: expected a projected or a geographic coordinate system"
            )));
        }
        Ok(Self::of(&spatial))
    }

    /// The horizontal part of a dataset's coordinate system.
    pub(super) fn of(spatial: &SpatialRef) -> Self {
        let (mut crs, vertical_unit) = describe::crs(Some(spatial));
        let plane = spatial.clone();
        let stripped = spatial.is_compound();
        if stripped {
            // SAFETY: the copy is ours and valid. Failing would leave the vertical part, which
            // warping does not look at.
            #[expect(unsafe_code, reason = "the bindings have no safe call for it")]
            unsafe {
                gdal_sys::OSRStripVertical(plane.to_c_hsrs());
            }
            crs.name = plane.name().unwrap_or_default();
            crs.wkt = wkt2(&plane);
        }
        Self { wkt: wkt2(&plane), crs, vertical_unit, stripped }
    }
}

/// The target grid that `gdalwarp` would choose for one raster.
pub(super) fn suggested(
    dataset: &Dataset,
    source_srs: Option<&str>,
    target_srs: Option<&str>,
    resolution: Option<(f64, f64)>,
    limits: &Limits,
) -> Result<Lattice> {
    let mut words: Vec<String> = ["-of", "VRT", "-et", "0"].map(str::to_owned).into();
    for (option, value) in [("-s_srs", source_srs), ("-t_srs", target_srs)] {
        words.extend(value.into_iter().flat_map(|value| [option.to_owned(), value.to_owned()]));
    }
    if let Some((x, y)) = resolution {
        words.extend(["-tr".to_owned(), format!("{x:e}"), format!("{y:e}")]);
    }
    let virtual_raster = gdalwarp(dataset, &words)?;
    let (width, height) = virtual_raster.raster_size();
    let [x, dx, _, y, _, dy] = virtual_raster
        .geo_transform()
        .map_err(|error| Error::format("the grid that gdalwarp makes", "a geotransform", error))?;
    if !(dx > 0.0 && dy < 0.0 && [x, y, dx, dy].iter().all(|value| value.is_finite())) {
        return Err(Error::format(
            "the grid that gdalwarp makes",
            "rows east, columns south",
            format!("{dx}, {dy}"),
        ));
    }
    Ok(Lattice {
        corner: (x, y),
        step: (dx, -dy),
        width: side("the width of the warped raster", width as u64, limits)?,
        height: side("the height of the warped raster", height as u64, limits)?,
    })
}

/// Runs GDAL's `gdalwarp` with a virtual raster as output, which computes no samples.
fn gdalwarp(dataset: &Dataset, words: &[String]) -> Result<Dataset> {
    let words: Vec<CString> = words.iter().filter_map(|word| CString::new(word.as_str()).ok()).collect();
    let mut list: Vec<*mut c_char> = words.iter().map(|word| word.as_ptr().cast_mut()).collect();
    list.push(ptr::null_mut());
    let mut source = dataset.c_dataset();
    // SAFETY: the list ends with a null pointer and its strings outlive the call, which copies
    // them; options are freed once; the dataset is open, and what is made of it is dropped before
    // it by the only caller.
    #[expect(unsafe_code, reason = "the bindings have no safe call for it")]
    unsafe {
        gdal_sys::CPLErrorReset();
        let options = gdal_sys::GDALWarpAppOptionsNew(list.as_mut_ptr(), ptr::null_mut());
        if options.is_null() {
            return Err(failed("plan the warp"));
        }
        let made =
            gdal_sys::GDALWarp(c"".as_ptr(), ptr::null_mut(), 1, &raw mut source, options, ptr::null_mut());
        gdal_sys::GDALWarpAppOptionsFree(options);
        if made.is_null() { Err(failed("plan the warp")) } else { Ok(Dataset::from_c_dataset(made)) }
    }
}
