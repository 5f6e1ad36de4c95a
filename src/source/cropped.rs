//! A part of a raster as a source of its own: the samples whose pixels a box touches. Only these
//! are read.

use std::ops::Range;
use std::path::PathBuf;

use super::{Fingerprint, Rect, Source, SourceInfo, Window};
use crate::crs;
use crate::crs::projection::Between;
use crate::error::{Error, Result};
use crate::geo::{Crs, CrsKind, Geo};

/// Points along each side of a box when it is converted to another system, in which its sides may
/// be curved.
const POINTS: u32 = 64;
/// A pixel is not touched if the box covers less than this share of it: that is rounding.
const TOUCH: f64 = 1e-6;

/// A box in world coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Bbox {
    /// West, south, east and north.
    pub bounds: [f64; 4],
    /// Coordinate system of these numbers, as `EPSG:n` or WKT; `None`: that of the raster.
    pub crs: Option<String>,
}

impl Bbox {
    /// The pixels of a raster of `width x height` that the box touches.
    pub fn window(&self, geo: &Geo, (width, height): (u32, u32)) -> Result<Rect> {
        let [west, south, east, north] = self.in_system_of(geo, (width, height))?;
        let raster = geo.bounds(width, height);
        let outside = || {
            let text = |[west, south, east, north]: [f64; 4]| {
                format!("west {west}, south {south}, east {east}, north {north}")
            };
            Error::usage(format!(
                "the box ({}) lies outside of the raster ({}), in coordinates of the raster",
                text([west, south, east, north]),
                text(raster)
            ))
        };
        let corners = [(west, south), (west, north), (east, south), (east, north)];
        let mut span = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
        for (x, y) in corners {
            let (column, row) = geo.sample_from_world(x, y).ok_or_else(|| {
                Error::usage("a box needs a raster with a place on the ground, and this one has none")
            })?;
            // Pixel 0 begins half a pixel before sample 0.
            let (column, row) = (column + 0.5, row + 0.5);
            span = [span[0].min(column), span[1].max(column), span[2].min(row), span[3].max(row)];
        }
        let touched = |from: f64, to: f64, side: u32| {
            let (from, to) = ((from + TOUCH).floor().max(0.0), (to - TOUCH).ceil().min(f64::from(side)));
            (from < to).then_some(from as u32..to as u32)
        };
        let columns = touched(span[0], span[1], width).ok_or_else(outside)?;
        let rows = touched(span[2], span[3], height).ok_or_else(outside)?;
        Ok(Rect { columns, rows })
    }

    /// The bounding box of this one in the coordinate system of a raster.
    fn in_system_of(&self, geo: &Geo, (width, height): (u32, u32)) -> Result<[f64; 4]> {
        let system = self.crs.as_deref().map(crs::read).transpose()?;
        let [west, _, east, _] = self.bounds;
        // West above east is a box across the antimeridian only if the numbers are longitudes.
        if west > east && system.as_ref().unwrap_or(&geo.crs).kind != CrsKind::Geographic {
            let what = format!(
                "a box whose west ({west}) is east of its east ({east}): expected west, south, east, north"
            );
            return Err(Error::usage(what));
        }
        let bounds = match &system {
            Some(system) if !crs::are_same(system, &geo.crs) => converted(self.bounds, system, &geo.crs)?,
            _ => unrolled(self.bounds, &geo.crs),
        };
        Ok(turned(bounds, geo, geo.bounds(width, height)))
    }
}

/// The box with its east above its west, by a whole turn if it crosses the antimeridian.
fn unrolled([west, south, east, north]: [f64; 4], crs: &Crs) -> [f64; 4] {
    let turn = if crs.kind == CrsKind::Geographic && east < west { turn(crs) } else { 0.0 };
    [west, south, east + turn, north]
}

/// A whole turn in units of a geographic system.
fn turn(crs: &Crs) -> f64 {
    std::f64::consts::TAU / crs.unit
}

/// The box moved by whole turns to where it meets the raster, whose longitudes may begin at 0 or at
/// -180.
fn turned(bounds: [f64; 4], geo: &Geo, raster: [f64; 4]) -> [f64; 4] {
    if geo.crs.kind != CrsKind::Geographic {
        return bounds;
    }
    let turn = turn(&geo.crs);
    let moved = |by: f64| [bounds[0] + by, bounds[1], bounds[2] + by, bounds[3]];
    let common = |bounds: &[f64; 4]| bounds[2].min(raster[2]) - bounds[0].max(raster[0]);
    // Of equal overlaps the first wins: the box unmoved.
    let better = |best: [f64; 4], next: [f64; 4]| if common(&next) > common(&best) { next } else { best };
    [-turn, turn].map(moved).into_iter().fold(bounds, better)
}

/// The bounding box, in system `to`, of points along the sides and inside of a box in system
/// `from`.
fn converted(bounds: [f64; 4], from: &Crs, to: &Crs) -> Result<[f64; 4]> {
    let [west, south, east, north] = unrolled(bounds, from);
    let between = Between::new(from, to)?;
    let mut found = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    let mut before: Option<f64> = None;
    for i in 0..=POINTS {
        for j in 0..=POINTS {
            let share = |k: u32| f64::from(k) / f64::from(POINTS);
            let (x, y) = (west + share(i) * (east - west), south + share(j) * (north - south));
            let Some((mut x, y)) = between.convert(x, y) else { continue };
            // Longitudes continue across the antimeridian.
            if let (CrsKind::Geographic, Some(before)) = (to.kind, before) {
                let turn = turn(to);
                x += ((before - x) / turn).round() * turn;
            }
            before = Some(x);
            found = [found[0].min(x), found[1].min(y), found[2].max(x), found[3].max(y)];
        }
    }
    if found[0] > found[2] {
        return Err(Error::usage(format!(
            "the box (west {west}, south {south}, east {east}, north {north}) has no place in the coordinates of the raster"
        )));
    }
    Ok(found)
}

/// Georeference of a part: its samples keep their coordinates.
pub fn part_geo(geo: &Geo, part: &Rect) -> Geo {
    let (column, row) = (f64::from(part.columns.start), f64::from(part.rows.start));
    let transform = geo
        .transform
        .map(|[x0, a, b, y0, d, e]| [x0 + column * a + row * b, a, b, y0 + column * d + row * e, d, e]);
    Geo { transform, ..geo.clone() }
}

/// A window of a raster as a source.
struct Cropped {
    info: SourceInfo,
    part: Rect,
    source: Box<dyn Source>,
}

/// The part of a raster that a box touches.
pub fn apply(source: Box<dyn Source>, bbox: &Bbox) -> Result<Box<dyn Source>> {
    let whole = source.info();
    let part = bbox.window(&whole.geo, (whole.width, whole.height))?;
    if part.columns == (0..whole.width) && part.rows == (0..whole.height) {
        return Ok(source);
    }
    let mut info = whole.clone();
    info.geo = part_geo(&whole.geo, &part);
    info.width = part.columns.end - part.columns.start;
    info.height = part.rows.end - part.rows.start;
    info.reading = whole.reading.of_part((whole.width, info.width), whole.block_rows < whole.height);
    info.footprint =
        whole.footprint.as_ref().map(|rects| rects.iter().filter_map(|rect| common(rect, &part)).collect());
    info.description = format!(
        "{}; columns {} to {} and rows {} to {} of {} x {}",
        whole.description,
        part.columns.start,
        part.columns.end - 1,
        part.rows.start,
        part.rows.end - 1,
        whole.width,
        whole.height
    );
    Ok(Box::new(Cropped { info, part, source }))
}

/// The intersection of a rectangle and a part, in columns and rows of the part.
fn common(rect: &Rect, part: &Rect) -> Option<Rect> {
    let side = |a: &Range<u32>, b: &Range<u32>| {
        let (from, to) = (a.start.max(b.start), a.end.min(b.end));
        (from < to).then(|| from - b.start..to - b.start)
    };
    Some(Rect { columns: side(&rect.columns, &part.columns)?, rows: side(&rect.rows, &part.rows)? })
}

impl Source for Cropped {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window> {
        super::check_window(&self.info, &columns, &rows)?;
        let moved = |range: Range<u32>, by: u32| range.start + by..range.end + by;
        self.source.read_window(moved(columns, self.part.columns.start), moved(rows, self.part.rows.start))
    }

    fn take_back(&self, window: Window) {
        self.source.take_back(window);
    }

    fn release(&self) {
        self.source.release();
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        self.source.fingerprint()
    }

    fn files(&self) -> Vec<PathBuf> {
        self.source.files()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn geo(code: &str, transform: [f64; 6]) -> Geo {
        Geo { transform: Some(transform), pixel_is_point: false, crs: crs::read(code).expect("code") }
    }

    fn window(geo: &Geo, size: (u32, u32), bounds: [f64; 4], crs: Option<&str>) -> Result<Rect> {
        Bbox { bounds, crs: crs.map(str::to_owned) }.window(geo, size)
    }

    #[test]
    fn pixels_that_a_box_touches() {
        let utm = geo("EPSG:32613", [500_000.0, 10.0, 0.0, 4_400_000.0, 0.0, -10.0]);
        let at = |bounds| window(&utm, (100, 80), bounds, None);
        let exact = at([500_100.0, 4_399_500.0, 500_200.0, 4_399_900.0]).expect("inside");
        assert_eq!(exact, Rect { columns: 10..20, rows: 10..50 });
        let more = at([500_099.0, 4_399_499.9, 500_200.1, 4_399_900.1]).expect("inside");
        assert_eq!(more, Rect { columns: 9..21, rows: 9..51 });
        let cut = at([0.0, 4_399_990.0, 500_001.0, 5_000_000.0]).expect("touches");
        assert_eq!(cut, Rect { columns: 0..1, rows: 0..1 });
        let error = at([0.0, 0.0, 10.0, 10.0]).expect_err("outside").to_string();
        assert!(error.contains("east 10,") && error.contains("west 500000,"), "{error}");
    }

    #[test]
    fn degrees_that_begin_at_zero_and_boxes_over_the_antimeridian() {
        let world = geo("EPSG:4326", [0.0, 1.0, 0.0, 90.0, 0.0, -1.0]);
        let west = window(&world, (360, 180), [-10.0, 0.0, -5.0, 5.0], None).expect("turned");
        assert_eq!(west, Rect { columns: 350..355, rows: 85..90 });
        let over = window(&world, (360, 180), [170.0, 0.0, -170.0, 5.0], None).expect("over");
        assert_eq!(over.columns, 170..190);
    }

    #[test]
    fn a_box_in_degrees_over_a_grid_in_metres_bends() {
        // PROJ: the parallel 40 N in zone 13 is lowest at -105 and rises to both sides.
        let utm = geo("EPSG:32613", [400_000.0, 100.0, 0.0, 4_600_000.0, 0.0, -100.0]);
        let found =
            window(&utm, (2000, 3000), [-105.5, 40.0, -104.5, 40.5], Some("EPSG:4326")).expect("inside");
        let bounds = part_geo(&utm, &found)
            .bounds(found.columns.end - found.columns.start, found.rows.end - found.rows.start);
        // cs2cs: corners and the middle of the southern side.
        for (got, wanted) in bounds.into_iter().zip([457_320.1, 4_427_757.2, 542_679.9, 4_483_374.8]) {
            assert!((got - wanted).abs() <= 160.0, "{bounds:?}");
        }
        assert!(window(&utm, (9, 9), [0.0, 0.0, 1.0, 1.0], Some("EPSG:27700")).is_err());
    }

    #[test]
    fn rectangles_are_cut_and_counted_anew() {
        let part = Rect { columns: 10..20, rows: 5..9 };
        let common = |columns, rows| common(&Rect { columns, rows }, &part);
        assert_eq!(common(0..15, 0..6), Some(Rect { columns: 0..5, rows: 0..1 }));
        assert_eq!(common(20..30, 0..90), None);
    }
}
