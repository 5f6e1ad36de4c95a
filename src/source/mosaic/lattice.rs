//! Places rasters on one lattice: the offset of each in whole samples.

use std::path::Path;

use crate::error::{Error, Result};
use crate::geo::CrsKind;
use crate::limits::Limits;
use crate::source::{Rect, SourceInfo, advice, file_name};

/// Largest distance in pixels of a sample from its place on the lattice. Geotransforms have few
/// digits, so they are less exact at the far end of a raster than at its origin.
const TOLERANCE: f64 = 0.01;

/// Advice for rasters on different grids.
const HINT: &str = "bring one onto the grid of the other first (gdalwarp with -tr and -te, or `crs` in a build with \
                    --features gdal)";

/// The common lattice, and the rectangle of each raster on it.
#[derive(Debug, PartialEq)]
pub(super) struct Lattice {
    pub(super) transform: [f64; 6],
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) rects: Vec<Rect>,
}

/// A raster with its geotransform.
struct Placed<'a> {
    path: &'a Path,
    transform: [f64; 6],
    size: (u32, u32),
}

/// Finds the common lattice of at least one raster.
///
/// The pixel size is that of the north-westernmost raster, and the origin is exactly that of a
/// raster wherever possible, so neither depends on the order.
pub(super) fn of(rasters: &[(&Path, &SourceInfo)], limits: &Limits) -> Result<Lattice> {
    let placed: Vec<Placed> = rasters.iter().map(|(path, info)| placed(path, info)).collect::<Result<_>>()?;
    let Some(first) = placed.first() else { return Err(Error::usage("there is no raster to join")) };
    let rough = |raster: &Placed| pixel_of(&first.transform, &raster.transform, (0.0, 0.0));
    let north_west = |a: &&Placed, b: &&Placed| {
        let key = |raster: &Placed| {
            let (column, row) = rough(raster);
            (row.round(), column.round())
        };
        let ((row_a, column_a), (row_b, column_b)) = (key(a), key(b));
        let bits = || {
            let mut pairs = a.transform.iter().zip(&b.transform).map(|(a, b)| a.total_cmp(b));
            pairs.find(|order| order.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
        };
        row_a.total_cmp(&row_b).then(column_a.total_cmp(&column_b)).then_with(bits)
    };
    let reference = placed.iter().min_by(north_west).unwrap_or(first);
    let origins: Vec<(i64, i64)> =
        placed.iter().map(|raster| offset(reference, raster)).collect::<Result<_>>()?;
    let west = origins.iter().map(|origin| origin.0).min().unwrap_or(0);
    let north = origins.iter().map(|origin| origin.1).min().unwrap_or(0);
    let ends = placed
        .iter()
        .zip(&origins)
        .map(|(raster, origin)| (origin.0 + i64::from(raster.size.0), origin.1 + i64::from(raster.size.1)));
    let (east, south) = ends.fold((west, north), |most, end| (most.0.max(end.0), most.1.max(end.1)));
    let width = side("the width of all rasters together, in columns,", east - west, limits)?;
    let height = side("the height of all rasters together, in rows,", south - north, limits)?;
    let rects = placed.iter().zip(&origins).map(|(raster, origin)| {
        let (column, row) = ((origin.0 - west) as u32, (origin.1 - north) as u32);
        Rect { columns: column..column + raster.size.0, rows: row..row + raster.size.1 }
    });
    let transform = origin(reference, &placed, &origins, (west, north));
    Ok(Lattice { transform, width, height, rects: rects.collect() })
}

/// A warning if rasters in degrees lie at both ends of the globe, with mostly void between them.
pub(super) fn far_apart(lattice: &Lattice, rasters: &[(&Path, &SourceInfo)]) -> Option<String> {
    let (_, first) = rasters.first()?;
    let [west, step, ..] = lattice.transform;
    let degree = 1.0_f64.to_radians() / first.geo.crs.unit;
    let degrees = |columns: u32| f64::from(columns) * step.abs() / degree;
    if first.geo.crs.kind != CrsKind::Geographic || degrees(lattice.width) < 180.0 {
        return None;
    }
    // The widest gap between the columns of all rasters.
    let mut columns: Vec<_> = lattice.rects.iter().map(|rect| rect.columns.clone()).collect();
    columns.sort_by_key(|columns| columns.start);
    let (mut end, mut gap) = (0, 0..0);
    for columns in columns {
        if columns.start > end && columns.start - end > gap.end - gap.start {
            gap = end..columns.start;
        }
        end = end.max(columns.end);
    }
    let name = file_name(rasters.first()?.0);
    let longitude = |column: u32| west / degree + degrees(column);
    (degrees(gap.end - gap.start) > 180.0).then(|| {
        format!(
            "{name} and {} more: nothing but void from longitude {:.0} to {:.0}, {:.0} of the {:.0} degrees of the mosaic; do its \
             files lie on both sides of 180 degrees? Build each side on its own, or {}",
            rasters.len() - 1,
            longitude(gap.start),
            longitude(gap.end),
            degrees(gap.end - gap.start),
            degrees(lattice.width),
            advice::CRS
        )
    })
}

fn placed<'a>(path: &'a Path, info: &SourceInfo) -> Result<Placed<'a>> {
    let name = path.display();
    let Some(transform) = info.geo.transform else {
        return Err(Error::usage(format!(
            "{name}: it is not georeferenced, and so has no place among other files; \
             say where it lies with gdal_edit.py -a_ullr"
        )));
    };
    let determinant = transform[1] * transform[5] - transform[2] * transform[4];
    if !determinant.is_normal() {
        return Err(Error::format("geotransform", "pixels with an area", format!("{transform:?}")).at(path));
    }
    Ok(Placed { path, transform, size: (info.width, info.height) })
}

/// A point of one raster, in pixels, as pixels of another.
fn pixel_of(reference: &[f64; 6], transform: &[f64; 6], (u, v): (f64, f64)) -> (f64, f64) {
    let [x0, a, b, y0, d, e] = *reference;
    let [x1, a1, b1, y1, d1, e1] = *transform;
    let (dx, dy) = ((x1 - x0) + u * a1 + v * b1, (y1 - y0) + u * d1 + v * e1);
    let determinant = a * e - b * d;
    ((e * dx - b * dy) / determinant, (a * dy - d * dx) / determinant)
}

/// Columns and rows from the reference to a raster; fails if any of its corners is not at whole
/// samples.
fn offset(reference: &Placed, raster: &Placed) -> Result<(i64, i64)> {
    let (column, row) = pixel_of(&reference.transform, &raster.transform, (0.0, 0.0));
    // Rasters farther apart exceed the limits anyway.
    let far = f64::from(u32::MAX);
    if !(column.abs() < far && row.abs() < far) {
        return Err(refused(
            reference,
            raster,
            &format!("lies {column:.0} columns and {row:.0} rows away from"),
        ));
    }
    let (whole, (w, h)) =
        ((column.round(), row.round()), (f64::from(raster.size.0), f64::from(raster.size.1)));
    let off = |(u, v): (f64, f64)| {
        let (column, row) = pixel_of(&reference.transform, &raster.transform, (u, v));
        (column - whole.0 - u, row - whole.1 - v)
    };
    let beyond = |(x, y): (f64, f64)| !(x.abs() <= TOLERANCE && y.abs() <= TOLERANCE);
    let (near, corners) = (off((0.0, 0.0)), [(w, 0.0), (0.0, h), (w, h)].map(off));
    if beyond(near) {
        let what = format!("has samples {:.4} columns and {:.4} rows off the grid of", near.0, near.1);
        return Err(refused(reference, raster, &what));
    }
    if let Some(far) = corners.into_iter().find(|&corner| beyond(corner)) {
        let [size, other] = [raster, reference].map(|raster| pixel(&raster.transform));
        let what = format!(
            "has other pixels ({size}, not {other}: {:.4} columns and {:.4} rows off at its end) than",
            far.0, far.1
        );
        return Err(refused(reference, raster, &what));
    }
    Ok((whole.0 as i64, whole.1 as i64))
}

/// Size of a pixel, for people.
fn pixel(&[_, a, b, _, d, e]: &[f64; 6]) -> String {
    if b == 0.0 && d == 0.0 { format!("{a} x {e}") } else { format!("({a}, {d}) x ({b}, {e})") }
}

fn refused(reference: &Placed, raster: &Placed, what: &str) -> Error {
    Error::usage(format!("{}: it {what} {}; {HINT}", raster.path.display(), reference.path.display()))
}

fn side(what: &str, samples: i64, limits: &Limits) -> Result<u32> {
    let samples = samples.unsigned_abs();
    match u32::try_from(samples) {
        Ok(side) if samples <= limits.raster_side => Ok(side),
        _ => Err(Error::limit(what, samples, limits.raster_side)),
    }
}

/// The common geotransform: exactly that of the raster in the north-west corner, else combined from
/// the westernmost and the northernmost one.
fn origin(reference: &Placed, all: &[Placed], origins: &[(i64, i64)], (west, north): (i64, i64)) -> [f64; 6] {
    let [x0, a, b, y0, d, e] = reference.transform;
    // The reference is one of the northernmost rasters.
    let column =
        origins.iter().zip(all).find(|(_, raster)| std::ptr::eq(*raster, reference)).map_or(0, |o| o.0.0);
    if column == west {
        return reference.transform;
    }
    if b != 0.0 || d != 0.0 {
        let step = (west - column) as f64;
        return [x0 + step * a, a, b, y0 + step * d, d, e];
    }
    let westernmost = all.iter().zip(origins).filter(|(_, origin)| origin.0 == west);
    let x = westernmost.map(|(raster, _)| raster.transform[0]).min_by(f64::total_cmp).unwrap_or(x0);
    debug_assert!(origins.iter().all(|origin| origin.1 >= north));
    [x, a, b, y0, d, e]
}
