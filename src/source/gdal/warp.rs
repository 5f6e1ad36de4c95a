//! Rasters warped to one grid while they are read, block by block, in bounded memory and without a file in between.
//!
//! Every sample is made in the same block of its file's part of the grid, whatever window is read, by whichever
//! thread: reading in other windows, with other memory or on more threads gives the same bits.

use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use gdal::Metadata;
use gdal::spatial_ref::SpatialRef;
use rayon::prelude::*;

use super::describe::describe;
use super::operation::{Operation, Request, filled};
use super::target::{Horizontal, Lattice, suggested};
use super::{dataset, files};
use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::warp::Warp;
use crate::source::{
    Fingerprint, OpenOptions, Part, Samples, Source, SourceInfo, Window, check_window, stated,
};

/// Side of a block in samples of the target.
const BLOCK: u32 = 128;
/// Side of the source's window of a block, at most about that.
const SOURCE_SIDE: f64 = 4096.0;
/// Bytes of blocks kept: two rows of them for all but the widest rasters, as bands of rows share a row of blocks.
const KEPT: usize = 64 << 20;

/// Opens rasters as one, on the grid that is asked for.
pub fn open_all(
    paths: &[PathBuf],
    warp: &Warp,
    options: &OpenOptions,
    limits: &Limits,
) -> Result<Box<dyn Source>> {
    let mut parts = open_parts(paths, warp, options, limits)?.into_iter();
    match (parts.next(), parts.next()) {
        (Some((_, only)), None) => Ok(only),
        (None, _) => Err(Error::usage("there is no DEM to read")),
        _ => Err(Error::unsupported("several DEMs", "build them one by one")),
    }
}

/// The rasters one by one, each on its own part of the common grid.
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
    let plan = |original: &Original| {
        let (from, to) = original.systems(target.as_ref())?;
        let dataset = dataset(&original.path)?;
        suggested(&dataset, from.as_deref(), to.as_deref(), warp.resolution, limits)
    };
    let lattices: Vec<Lattice> = looked_at
        .iter()
        .map(|original| plan(original).map_err(|error| error.at(&original.path)))
        .collect::<Result<_>>()?;
    let whole = Lattice::union(&lattices, warp.resolution, limits)?;
    let mut parts = Vec::new();
    for (original, own) in looked_at.iter().zip(&lattices) {
        let (columns, rows) = whole.covered(own.bounds());
        let lattice = whole.part(&columns, &rows);
        let source = Warped::new(original, lattice, target.as_ref(), warp)
            .map_err(|error| error.at(&original.path))?;
        parts.push((original.path.clone(), stated::apply(Box::new(source), options)));
    }
    Ok(parts)
}

/// A raster as it is, before it is warped.
struct Original {
    path: PathBuf,
    files: Vec<PathBuf>,
    info: SourceInfo,
    spatial: Option<SpatialRef>,
    /// Number of its alpha band; 0 if there is none.
    alpha: i32,
    /// True if it has a place in the world, by a geotransform or otherwise.
    placed: bool,
}

impl Original {
    fn open(path: &Path, options: &OpenOptions, limits: &Limits) -> Result<Self> {
        let dataset = dataset(path)?;
        let (mut info, _) = describe(&dataset, path, limits)?;
        if options.nodata.is_some() {
            info.nodata = options.nodata;
        }
        let alpha =
            dataset.rasterband(1).and_then(|band| band.mask_flags()).is_ok_and(|flags| flags.is_alpha());
        let gcps = !dataset.gcps().is_empty();
        let spatial = dataset.spatial_ref().ok().or_else(|| dataset.gcp_spatial_ref());
        let located = |domain| dataset.metadata_domain(domain).is_some_and(|lines| !lines.is_empty());
        Ok(Self {
            path: path.to_owned(),
            files: files::of(&dataset, path),
            spatial,
            alpha: if alpha { dataset.raster_count() as i32 } else { 0 },
            placed: info.geo.transform.is_some() || gcps || located("RPC") || located("GEOLOCATION"),
            info,
        })
    }

    /// What to tell the warper of the coordinate systems: of the source only if it is not simply the dataset's own.
    fn systems(&self, target: Option<&Horizontal>) -> Result<(Option<String>, Option<String>)> {
        if !self.placed {
            return Err(Error::unsupported(
                "it has no geotransform",
                "place it with gdal_translate -a_ullr, or leave out --crs, --resolution and --resampling",
            ));
        }
        let own = self.spatial.as_ref().map(Horizontal::of);
        match (&own, target) {
            (None, Some(target)) => Err(Error::unsupported(
                format!("it has no coordinate system to warp to {} from", target.crs.name),
                "give it its own with gdal_edit.py -a_srs, or leave out --crs",
            )),
            (Some(own), None) => Err(Error::unsupported(
                format!("it is in {}, and the first DEM in no coordinate system", own.crs.name),
                "give --crs, and the first DEM its own with gdal_edit.py -a_srs",
            )),
            (None, None) => Ok((None, None)),
            (Some(own), Some(target)) => {
                check_vertical(own, target)?;
                Ok((own.stripped.then(|| own.wkt.clone()), Some(target.wkt.clone())))
            }
        }
    }
}

/// Refuses a target in other heights than the source's: warping moves no sample up or down.
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
            "heights are not moved between vertical systems: give --crs without its vertical part, or use gdalwarp",
        ));
    }
    Ok(())
}

/// A raster on another grid than its own.
struct Warped {
    path: PathBuf,
    files: Vec<PathBuf>,
    info: SourceInfo,
    request: Request,
    side: u32,
    /// Operations that no thread is using.
    idle: Mutex<Vec<Operation>>,
    kept: Mutex<Kept>,
}

impl Warped {
    fn new(original: &Original, lattice: Lattice, target: Option<&Horizontal>, warp: &Warp) -> Result<Self> {
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
            source_nodata: own.nodata.or(own.sample_type.is_float().then_some(f64::NAN)),
            nodata,
            sample_type,
            alpha: original.alpha,
            scale,
        };
        let info = warped_info(original, &request, target, side);
        let first = Operation::new(dataset(&original.path)?, &request)?;
        Ok(Self {
            path: original.path.clone(),
            files: original.files.clone(),
            info,
            request,
            side,
            idle: Mutex::new(vec![first]),
            kept: Mutex::default(),
        })
    }

    /// A block by its column and row of blocks, made if it is not kept.
    fn block(&self, id: (u32, u32)) -> Result<Arc<Samples>> {
        if let Some(block) = lock(&self.kept).get(id) {
            return Ok(block);
        }
        let idle = lock(&self.idle).pop();
        let operation = match idle {
            Some(operation) => operation,
            None => Operation::new(dataset(&self.path)?, &self.request)?,
        };
        let (x, y) = (id.0 * self.side, id.1 * self.side);
        let (width, height) = (self.side.min(self.info.width - x), self.side.min(self.info.height - y));
        let block = operation.block([x, y, width, height]);
        lock(&self.idle).push(operation);
        let block = Arc::new(block?);
        lock(&self.kept).put(id, &block);
        Ok(block)
    }
}

impl Source for Warped {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window> {
        check_window(&self.info, &columns, &rows)?;
        let mut samples = filled(self.info.sample_type, columns.len() * rows.len(), 0.0);
        let blocks = |range: &Range<u32>| range.start / self.side..range.end.div_ceil(self.side);
        let ids: Vec<(u32, u32)> = blocks(&rows)
            .flat_map(|y| blocks(&columns).map(move |x| (x, y)))
            .filter(|_| !columns.is_empty() && !rows.is_empty())
            .collect();
        // A few at a time, so that a wide window does not have all of them in memory twice.
        for some in ids.chunks(8 * rayon::current_num_threads().max(1)) {
            let made: Vec<_> = some
                .par_iter()
                .map(|&id| self.block(id))
                .collect::<Result<_>>()
                .map_err(|error| error.at(&self.path))?;
            for (&(x, y), block) in some.iter().zip(&made) {
                let (left, top) = (x * self.side, y * self.side);
                let width = self.side.min(self.info.width - left);
                let height = self.side.min(self.info.height - top);
                let common = |range: &Range<u32>, start: u32, length: u32| {
                    range.start.max(start)..range.end.min(start + length)
                };
                let (across, down) = (common(&columns, left, width), common(&rows, top, height));
                for row in down {
                    let from = (row - top) as usize * width as usize + (across.start - left) as usize;
                    let to =
                        (row - rows.start) as usize * columns.len() + (across.start - columns.start) as usize;
                    copy(block, from, &mut samples, to, across.len());
                }
            }
        }
        Ok(Window { samples, mask: None })
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        files::fingerprint(&self.files)
    }
}

/// Blocks that are kept, the least recently used ones going first.
#[derive(Default)]
struct Kept {
    blocks: HashMap<(u32, u32), (u64, Arc<Samples>)>,
    bytes: usize,
    clock: u64,
}

impl Kept {
    fn get(&mut self, id: (u32, u32)) -> Option<Arc<Samples>> {
        self.clock += 1;
        let entry = self.blocks.get_mut(&id)?;
        entry.0 = self.clock;
        Some(Arc::clone(&entry.1))
    }

    fn put(&mut self, id: (u32, u32), block: &Arc<Samples>) {
        let size = |block: &Samples| block.len() * block.sample_type().bytes();
        self.clock += 1;
        self.bytes += size(block);
        if let Some((_, old)) = self.blocks.insert(id, (self.clock, Arc::clone(block))) {
            self.bytes -= size(&old);
        }
        while self.bytes > KEPT {
            let oldest = self.blocks.iter().min_by_key(|(_, entry)| entry.0).map(|(&id, _)| id);
            let Some((_, block)) = oldest.and_then(|id| self.blocks.remove(&id)) else { break };
            self.bytes -= size(&block);
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Target samples of one of the source, along one axis, as `gdalwarp` takes it from a raster that it warps in one go:
/// 1 where it is about 1, and the reciprocal of a whole number where it is about that.
fn ratio(target: u32, source: u32) -> f64 {
    let ratio = f64::from(target) / f64::from(source);
    let reciprocal = (1.0 / ratio).round();
    if ratio < 1.0 && (1.0 / ratio - reciprocal).abs() < 0.05 { 1.0 / reciprocal } else { ratio }
}

/// Type of the warped samples, and a value that means void and that none of them has: the source's own type and nodata
/// value, NaN for floats without one, and for integers without one the next wider type and its lowest value.
fn target_samples(own: &SourceInfo) -> Result<(SampleType, f64)> {
    use SampleType::{Float32, Float64, Int8, Int16, Int32, Uint8, Uint16, Uint32};
    let fits =
        |low: f64, high: f64| own.nodata.filter(|value| value.fract() == 0.0 && (low..=high).contains(value));
    let (low, high) = match own.sample_type {
        Float32 | Float64 => return Ok((own.sample_type, own.nodata.unwrap_or(f64::NAN))),
        Int8 => (f64::from(i8::MIN), f64::from(i8::MAX)),
        Uint8 => (0.0, f64::from(u8::MAX)),
        Int16 => (f64::from(i16::MIN), f64::from(i16::MAX)),
        Uint16 => (0.0, f64::from(u16::MAX)),
        Int32 => (f64::from(i32::MIN), f64::from(i32::MAX)),
        Uint32 => (0.0, f64::from(u32::MAX)),
    };
    if own.sample_type == Int8 {
        // GDAL before 3.7 calls them bytes and would warp them as such.
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
        // What the file does not say of its heights, the user has said by naming a system with a vertical part.
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
        ..own.clone()
    }
}

/// The call of GDAL's program that makes the same samples.
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

/// Copies some samples of a row; both must be of one type.
fn copy(from: &Samples, start: usize, to: &mut Samples, at: usize, count: usize) {
    macro_rules! rows {
        ($($kind:ident),*) => {
            match (from, to) {
                $((Samples::$kind(from), Samples::$kind(to)) => {
                    to[at..at + count].copy_from_slice(&from[start..start + count]);
                })*
                _ => {}
            }
        };
    }
    rows!(Int8, Uint8, Int16, Uint16, Int32, Uint32, Float32, Float64);
}
