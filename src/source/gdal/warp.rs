//! Rasters warped to one grid while they are read, in bounded memory and without temporary files:
//! checks the request and finds the part of the grid of each raster.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use gdal::Metadata;
use gdal::spatial_ref::SpatialRef;

use super::Validity;
use super::blocks::Shared;
use super::describe::{self, describe};
use super::operation::Request;
use super::target::{Horizontal, Lattice, suggested};
use super::warped::Warped;
use super::{dataset, files};
use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::mosaic::Mosaic;
use crate::source::warp::Warp;
use crate::source::{OpenOptions, Part, ReadMemory, Source, SourceInfo, stated};

/// Side of a block in target samples.
const BLOCK: u32 = 128;
/// Approximate largest side, in source samples, of the window that a block is made from.
const SOURCE_SIDE: f64 = 4096.0;

/// Opens rasters as one source on the requested grid.
pub fn open_all(
    paths: &[PathBuf],
    warp: &Warp,
    options: &OpenOptions,
    limits: &Limits,
) -> Result<Box<dyn Source>> {
    let mut parts = open_parts(paths, warp, options, limits)?;
    match parts.len() {
        0 => Err(Error::usage("there is no DEM to read")),
        1 => Ok(parts.remove(0).1),
        _ => Ok(Box::new(Mosaic::join(parts, options, limits)?)),
    }
}

/// The rasters as separate sources, each on its part of the common grid.
fn open_parts(
    paths: &[PathBuf],
    warp: &Warp,
    options: &OpenOptions,
    limits: &Limits,
) -> Result<Vec<(PathBuf, Box<dyn Source>)>> {
    let looked_at: Vec<Original> = paths
        .iter()
        .map(|path| Original::open(path, options, limits).map_err(|error| error.at(path)))
        .collect::<Result<_>>()?;
    let target = match &warp.crs {
        Some(text) => Some(Horizontal::of_user(text)?),
        None => looked_at.first().and_then(|first| first.spatial.as_ref()).map(Horizontal::of),
    };
    // With several rasters the common lattice is found first, as in gdalwarp.
    let alone = warp.resolution.filter(|_| looked_at.len() == 1);
    let plan = |original: &Original| {
        let (from, to) = original.systems(target.as_ref())?;
        let dataset = dataset(&original.path)?;
        suggested(&dataset, from.as_deref(), to.as_deref(), alone, limits)
    };
    let lattices: Vec<Lattice> = looked_at
        .iter()
        .map(|original| plan(original).map_err(|error| error.at(&original.path)))
        .collect::<Result<_>>()?;
    let whole = Lattice::union(&lattices, warp.resolution, limits)?;
    let shared = Arc::new(Shared::default());
    let mut parts = Vec::new();
    for (number, (original, own)) in looked_at.iter().zip(&lattices).enumerate() {
        let (columns, rows) = whole.covered(own.bounds());
        let lattice = whole.part(&columns, &rows);
        let source = warped(original, lattice, target.as_ref(), warp, (number, &shared))
            .map_err(|error| error.at(&original.path))?;
        parts.push((original.path.clone(), stated::apply(Box::new(source), options)));
    }
    Ok(parts)
}

/// A raster before it is warped.
struct Original {
    path: PathBuf,
    files: Vec<PathBuf>,
    info: SourceInfo,
    spatial: Option<SpatialRef>,
    /// True if the coordinate system comes from a `.prj` that GDAL ignores.
    is_beside: bool,
    /// Number of the band of heights, from 1.
    band: i32,
    /// Number of the alpha band; 0 if there is none.
    alpha: i32,
    /// True if the raster is placed in the world, by a geotransform or otherwise.
    placed: bool,
}

impl Original {
    fn open(path: &Path, options: &OpenOptions, limits: &Limits) -> Result<Self> {
        let dataset = dataset(path)?;
        let (mut info, validity) = describe(&dataset, path, options.band, limits)?;
        if options.nodata.is_some() {
            info.nodata = options.nodata;
        }
        let band = options.band.unwrap_or(1) as usize;
        let flags = dataset.rasterband(band).and_then(|band| band.mask_flags());
        let alpha = match validity {
            Validity::Alpha(alpha) => alpha,
            Validity::Mask if flags.is_ok_and(|flags| flags.is_alpha()) => dataset.raster_count(),
            _ => 0,
        };
        let gcps = !dataset.gcps().is_empty();
        let spatial = dataset.spatial_ref().ok().or_else(|| dataset.gcp_spatial_ref());
        let prj = if spatial.is_none() { describe::prj(path, limits)? } else { None };
        let (spatial, is_beside) = (spatial.or_else(|| prj.as_ref().map(|prj| prj.1.clone())), prj.is_some());
        let located = |domain| dataset.metadata_domain(domain).is_some_and(|lines| !lines.is_empty());
        Ok(Self {
            path: path.to_owned(),
            files: files::of(&dataset, path).into_iter().chain(prj.map(|prj| prj.0)).collect(),
            spatial,
            is_beside,
            band: band as i32,
            alpha: alpha as i32,
            placed: info.geo.transform.is_some() || gcps || located("RPC") || located("GEOLOCATION"),
            info,
        })
    }

    /// The coordinate systems to give to the warper. That of the source is given only if it differs
    /// from the dataset's own.
    fn systems(&self, target: Option<&Horizontal>) -> Result<(Option<String>, Option<String>)> {
        if !self.placed {
            return Err(Error::unsupported(
                "it has no geotransform",
                "place it with gdal_translate -a_ullr, or do not warp it",
            ));
        }
        let own = self.spatial.as_ref().map(Horizontal::of);
        match (&own, target) {
            (None, Some(target)) => Err(Error::unsupported(
                format!("it has no coordinate system to warp to {} from", target.crs.name),
                "give it its own with gdal_edit.py -a_srs, or leave `crs` out",
            )),
            (Some(own), None) => Err(Error::unsupported(
                format!("it is in {}, and the first DEM in no coordinate system", own.crs.name),
                "give `crs`, and the first DEM its own with gdal_edit.py -a_srs",
            )),
            (None, None) => Ok((None, None)),
            (Some(own), Some(target)) => {
                check_vertical(own, target)?;
                let tell = own.stripped || self.is_beside;
                Ok((tell.then(|| own.wkt.clone()), Some(target.wkt.clone())))
            }
        }
    }
}

/// Refuses a target with another vertical system than the source: warping does not convert heights.
fn check_vertical(own: &Horizontal, target: &Horizontal) -> Result<()> {
    let (from, to) = (&own.crs, &target.crs);
    let known = !from.vertical_name.is_empty() && !to.vertical_name.is_empty();
    let same = if from.vertical_epsg.is_some() && to.vertical_epsg.is_some() {
        from.vertical_epsg == to.vertical_epsg
    } else {
        from.vertical_name == to.vertical_name
    };
    if known && !same {
        return Err(Error::unsupported(
            format!("its heights are in {}, not in {}", from.vertical_name, to.vertical_name),
            "heights are not moved between vertical systems: give `crs` without its vertical part, or use gdalwarp",
        ));
    }
    Ok(())
}

/// Target samples per source sample along an axis, as `gdalwarp` computes it for a whole raster:
/// rounded to 1 or to the reciprocal of an integer if close to one.
fn ratio(target: u32, source: u32) -> f64 {
    let ratio = f64::from(target) / f64::from(source);
    let reciprocal = (1.0 / ratio).round();
    if ratio < 1.0 && (1.0 / ratio - reciprocal).abs() < 0.05 { 1.0 / reciprocal } else { ratio }
}

/// Sample type and nodata value of the warped raster; no sample may equal that value. These are the
/// source's own, with NaN for floats without a nodata value. Integers without one get the next
/// wider type and its lowest value.
fn target_samples(own: &SourceInfo) -> Result<(SampleType, f64)> {
    use SampleType::{Float32, Float64, Int8, Int16, Int32, Uint8, Uint16, Uint32};
    let void = own.voids().sample(own.sample_type);
    let fits = |low: f64, high: f64| void.filter(|value| (low..=high).contains(value));
    let (low, high) = match own.sample_type {
        Float32 | Float64 => return Ok((own.sample_type, void.unwrap_or(f64::NAN))),
        Int8 => (f64::from(i8::MIN), f64::from(i8::MAX)),
        Uint8 => (0.0, f64::from(u8::MAX)),
        Int16 => (f64::from(i16::MIN), f64::from(i16::MAX)),
        Uint16 => (0.0, f64::from(u16::MAX)),
        Int32 => (f64::from(i32::MIN), f64::from(i32::MAX)),
        Uint32 => (0.0, f64::from(u32::MAX)),
    };
    if own.sample_type == Int8 {
        // GDAL before 3.7 calls int8 bytes and would warp it as such.
        return Err(Error::unsupported(
            "warping of 8-bit signed samples",
            "convert it with gdal_translate -ot Int16",
        ));
    }
    Ok(match (fits(low, high), own.sample_type) {
        (Some(nodata), kind) => (kind, nodata),
        (None, Uint8) => (Int16, f64::from(i16::MIN)),
        (None, Int16 | Uint16) => (Int32, f64::from(i32::MIN)),
        (None, _) => (Float64, f64::NAN),
    })
}

fn warped_info(original: &Original, request: &Request, target: Option<&Horizontal>, side: u32) -> SourceInfo {
    let own = &original.info;
    let mut crs = target.map_or_else(|| own.geo.crs.clone(), |target| target.crs.clone());
    let mut vertical_unit = own.vertical_unit.clone();
    if own.geo.crs.vertical_name.is_empty() {
        // If the file has no vertical system, the one in the user's target system counts.
        let stated = target.and_then(|target| target.vertical_unit.clone());
        if let (true, Some(stated)) = (vertical_unit.1.is_empty(), stated) {
            vertical_unit = stated;
        }
    } else {
        crs.vertical_epsg = own.geo.crs.vertical_epsg;
        crs.vertical_down = own.geo.crs.vertical_down;
        crs.vertical_name.clone_from(&own.geo.crs.vertical_name);
    }
    crs.keys = None;
    let lattice = &request.lattice;
    let part = Part {
        description: format!("{}; {}", own.description, command(request, target)),
        ..own.parts.first().cloned().unwrap_or_default()
    };
    SourceInfo {
        width: lattice.width,
        height: lattice.height,
        sample_type: request.sample_type,
        nodata: Some(request.nodata),
        vertical_unit,
        geo: Geo { transform: Some(lattice.transform()), pixel_is_point: false, crs },
        parts: vec![part],
        description: format!("{}, warped ({})", own.description, request.resampling.name()),
        block_rows: side,
        // The mask is warped with the samples; finished blocks have a cache of their own.
        reading: ReadMemory { sample: request.sample_type.bytes() as u64 + 1, ..own.reading },
        ..own.clone()
    }
}

/// The `gdalwarp` command that makes the same samples.
fn command(request: &Request, target: Option<&Horizontal>) -> String {
    let mut words = vec!["gdalwarp -ovr NONE -et 0".to_owned()];
    match target.map(|target| (target.crs.epsg, &target.wkt)) {
        Some((Some(code), _)) => words.push(format!("-t_srs EPSG:{code}")),
        Some((None, wkt)) => words.push(format!("-t_srs '{wkt}'")),
        None => {}
    }
    let [west, south, east, north] = request.lattice.bounds();
    let (width, height) = (request.lattice.width, request.lattice.height);
    words.push(format!("-te {west} {south} {east} {north} -ts {width} {height}"));
    words.push(format!("-r {}", request.resampling.name()));
    if let Some(nodata) = request.source_nodata {
        words.push(format!("-srcnodata {nodata}"));
    }
    words.push(format!("-ot {} -dstnodata {}", request.sample_type.gdal_name(), request.nodata));
    words.push(format!("-wo XSCALE={} -wo YSCALE={}", request.scale.0, request.scale.1));
    words.join(" ")
}

/// The raster of a part of the grid.
fn warped(
    original: &Original,
    lattice: Lattice,
    target: Option<&Horizontal>,
    warp: &Warp,
    (number, shared): (usize, &Arc<Shared>),
) -> Result<Warped> {
    let (source_srs, target_srs) = original.systems(target)?;
    let own = &original.info;
    let (sample_type, nodata) = target_samples(own)?;
    let scale = (ratio(lattice.width, own.width), ratio(lattice.height, own.height));
    let coarser = (1.0 / scale.0).max(1.0 / scale.1);
    if coarser > SOURCE_SIDE {
        return Err(Error::limit("the ratio of the resolutions", coarser as u64, SOURCE_SIDE as u64));
    }
    let side = ((SOURCE_SIDE / coarser) as u32).clamp(1, BLOCK);
    let request = Request {
        source_srs,
        target_srs,
        lattice,
        resampling: warp.resampling,
        source_nodata: own.voids().sample(own.sample_type).or(own.sample_type.is_float().then_some(f64::NAN)),
        nodata,
        sample_type,
        band: original.band,
        alpha: original.alpha,
        scale,
    };
    let (path, files, shared) = (original.path.clone(), original.files.clone(), Arc::clone(shared));
    let info = warped_info(original, &request, target, side);
    let warped = Warped { path, files, info, request, side, number, shared };
    warped.check()?;
    Ok(warped)
}
