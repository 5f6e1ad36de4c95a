//! The place of a picture on the texel grid: an affine map from texels to pixels, its level, its
//! outline.

use std::ops::Range;
use std::path::Path;

use super::square::Square;
use super::{PlacedPicture, Resolution, TexelGrid};
use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::source::picture::Picture;

/// Levels of an imagery layer below the root, at most.
pub(super) const MAX_LEVEL: u8 = 24;

/// From continuous texel coordinates (column, row) to continuous pixel coordinates:
/// `(a c + b r + x, d c + e r + y)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Map {
    pub(super) a: f64,
    pub(super) b: f64,
    pub(super) x: f64,
    pub(super) d: f64,
    pub(super) e: f64,
    pub(super) y: f64,
}

/// A polygon of up to eight corners.
type Polygon = Vec<(f64, f64)>;

/// A picture with its place.
pub(super) struct Placed<'a> {
    pub(super) picture: &'a dyn Picture,
    /// The finest level that it is resampled to.
    pub(super) level: u8,
    /// The map from texels of level 0.
    map: Map,
    /// Its corners in texels of level 0.
    corners: [(f64, f64); 4],
    /// Least and greatest column, and row, of its corners.
    bounds: ((f64, f64), (f64, f64)),
    /// Texels along the root square at level 0.
    tile: f64,
    /// Texels of level 0, along columns and rows, that lie over the lattice. A sample covers half
    /// an interval on each side.
    extent: (f64, f64),
}

impl Map {
    /// The map of GDAL's geotransform: pixel to world.
    fn of(transform: &[f64; 6]) -> Self {
        let [x, a, b, y, d, e] = *transform;
        Self { a, b, x, d, e, y }
    }

    /// The pixel coordinates of a point.
    pub(super) fn apply(&self, c: f64, r: f64) -> (f64, f64) {
        (self.a * c + self.b * r + self.x, self.d * c + self.e * r + self.y)
    }

    /// The inverse map; `None` if the map is singular.
    fn inverse(&self) -> Option<Self> {
        let determinant = self.a * self.e - self.b * self.d;
        if determinant == 0.0 || !determinant.is_finite() {
            return None;
        }
        let (a, b) = (self.e / determinant, -self.b / determinant);
        let (d, e) = (-self.d / determinant, self.a / determinant);
        Some(Self { a, b, x: -(a * self.x + b * self.y), d, e, y: -(d * self.x + e * self.y) })
    }

    /// The composition: `self` after `first`.
    fn after(&self, first: &Self) -> Self {
        let (x, y) = self.apply(first.x, first.y);
        Self {
            a: self.a * first.a + self.b * first.d,
            b: self.a * first.b + self.b * first.e,
            x,
            d: self.d * first.a + self.e * first.d,
            e: self.d * first.b + self.e * first.e,
            y,
        }
    }

    /// The same map from texels of a finer level.
    fn at_level(&self, level: u8) -> Self {
        // Powers of two: nothing is rounded.
        let part = 0.5_f64.powi(i32::from(level));
        Self { a: self.a * part, b: self.b * part, d: self.d * part, e: self.e * part, ..*self }
    }

    /// How many pixels one texel spans along columns and along rows.
    pub(super) fn steps(&self) -> (f64, f64) {
        (self.a.hypot(self.d), self.b.hypot(self.e))
    }

    /// Most columns and rows of pixels that a square of `side` texels needs, wherever it lies; with
    /// two more on each side.
    pub(super) fn box_of(&self, side: f64) -> (f64, f64) {
        ((self.a.abs() + self.b.abs()) * side + 5.0, (self.d.abs() + self.e.abs()) * side + 5.0)
    }

    /// True if columns of texels are columns of pixels.
    pub(super) fn is_straight(&self) -> bool {
        self.b == 0.0 && self.d == 0.0
    }
}

impl<'a> Placed<'a> {
    /// Finds the place of a picture over a lattice. Fails if it lies wholly beside the lattice.
    pub(super) fn new(
        picture: &'a dyn Picture,
        geo: &Geo,
        grid: &TexelGrid,
        resolution: Resolution,
    ) -> Result<Self> {
        let info = picture.info();
        let name = &info.note.name;
        let wrong = |what: &str| Error::usage(format!("{name}: {what}"));
        let transform = info.geo.transform.ok_or_else(|| wrong("it does not say where it lies"))?;
        let pixel_from_world =
            Map::of(&transform).inverse().ok_or_else(|| wrong("its geotransform is singular"))?;
        let tile = f64::from(grid.tile);
        let step = grid.intervals as f64 / tile;
        // A sample stands at the centre of its pixel.
        let sample_from_texel = Map { a: step, b: 0.0, x: 0.5, d: 0.0, e: step, y: 0.5 };
        let world_from_texel = Map::of(&geo.transform_or_identity()).after(&sample_from_texel);
        let mut map = pixel_from_world.after(&world_from_texel);
        // Less than a thousandth of a pixel from side to side is rounding.
        if map.b.abs() * tile < 1e-3 && map.d.abs() * tile < 1e-3 {
            (map.b, map.d) = (0.0, 0.0);
        }
        let back = map.inverse().ok_or_else(|| wrong("its pixels have no area on the heights"))?;
        let (w, h) = (f64::from(info.width), f64::from(info.height));
        let corners = [(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)].map(|(c, r)| back.apply(c, r));
        let level = level(map.steps(), resolution)
            .ok_or_else(|| wrong(&format!("its pixels are too small: more than {MAX_LEVEL} levels")))?;
        let range = |values: [f64; 4]| {
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            (low, values.iter().copied().fold(f64::NEG_INFINITY, f64::max))
        };
        let bounds = (range(corners.map(|corner| corner.0)), range(corners.map(|corner| corner.1)));
        let over = |samples: u32| (f64::from(samples) / step).min(tile);
        let extent = (over(grid.samples.0), over(grid.samples.1));
        let placed = Self { picture, level, map, corners, bounds, tile, extent };
        if placed.inside() > 0.0 {
            return Ok(placed);
        }
        Err(wrong("it lies wholly beside the heights: are both in the same place and coordinate system?"))
    }

    /// The map from texels of a level to pixels.
    pub(super) fn map(&self, level: u8) -> Map {
        self.map.at_level(level)
    }

    /// Its name, for errors.
    pub(super) fn name(&self) -> &Path {
        Path::new(&self.picture.info().note.name)
    }

    /// Its description, for people.
    pub(super) fn describe(&self) -> PlacedPicture {
        PlacedPicture {
            note: self.picture.info().note.clone(),
            level: self.level,
            pixels_per_texel: self.map(self.level).steps(),
            inside: self.inside(),
        }
    }

    /// Columns and rows of pixels that a square of texels can need, with a margin; empty if it lies
    /// outside.
    pub(super) fn window(&self, square: Square) -> (Range<u32>, Range<u32>) {
        let side = square.side as f64;
        self.pixels(square.level, (square.left as f64, square.top as f64), (side, side))
    }

    /// False if the picture certainly has no texel to show in a rectangle, given by its first
    /// column and row, width and height.
    pub(super) fn may_show(&self, level: u8, start: (f64, f64), size: (f64, f64)) -> bool {
        let texel = 0.5_f64.powi(i32::from(level));
        let apart = |(low, high): (f64, f64), start: f64, size: f64| {
            high < (start - 1.0) * texel || low > (start + size + 1.0) * texel
        };
        if apart(self.bounds.0, start.0, size.0) || apart(self.bounds.1, start.1, size.1) {
            return false;
        }
        let (columns, rows) = self.pixels(level, start, size);
        !columns.is_empty() && !rows.is_empty() && self.picture.may_show(columns, rows)
    }

    fn pixels(&self, level: u8, start: (f64, f64), size: (f64, f64)) -> (Range<u32>, Range<u32>) {
        let (map, info) = (self.map(level), self.picture.info());
        let (right, bottom) = (start.0 + size.0, start.1 + size.1);
        let corners = [start, (right, start.1), (start.0, bottom), (right, bottom)];
        let corners = corners.map(|(c, r)| map.apply(c, r));
        (span(corners.map(|corner| corner.0), info.width), span(corners.map(|corner| corner.1), info.height))
    }

    /// The part of its area that lies over the lattice, 0 to 1.
    pub(super) fn inside(&self) -> f64 {
        let part = clip(&self.corners, (0.0, self.extent.0), (0.0, self.extent.1));
        (area(&part) / area(&self.corners)).min(1.0)
    }

    /// Rows of tiles of a level that the picture touches.
    pub(super) fn rows(&self, level: u8) -> Range<u32> {
        let part = clip(&self.corners, (0.0, self.extent.0), (0.0, self.extent.1));
        self.tiles(level, part.iter().map(|corner| corner.1))
    }

    /// Columns of tiles of a level that the picture touches.
    pub(super) fn all_columns(&self, level: u8) -> Range<u32> {
        let part = clip(&self.corners, (0.0, self.extent.0), (0.0, self.extent.1));
        self.tiles(level, part.iter().map(|corner| corner.0))
    }

    /// Columns of tiles of a level that the picture touches in row `row`.
    pub(super) fn columns(&self, level: u8, row: u32) -> Range<u32> {
        let side = self.tile / 2.0_f64.powi(i32::from(level));
        let (top, bottom) = (f64::from(row) * side, (f64::from(row) + 1.0) * side);
        let part = clip(&self.corners, (0.0, self.extent.0), (top, bottom.min(self.extent.1)));
        self.tiles(level, part.iter().map(|corner| corner.0))
    }

    /// Tiles from the least to the greatest of some coordinates in texels of level 0, none if there
    /// are none.
    fn tiles(&self, level: u8, coordinates: impl Iterator<Item = f64>) -> Range<u32> {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        coordinates.for_each(|value| (low, high) = (low.min(value), high.max(value)));
        if low > high {
            return 0..0;
        }
        let count = 2.0_f64.powi(i32::from(level));
        let first = (low / self.tile * count).floor().clamp(0.0, count - 1.0);
        let last = ((high / self.tile * count).ceil() - 1.0).clamp(first, count - 1.0);
        first as u32..last as u32 + 1
    }
}

/// Pixels between coordinates, and two more on each side.
fn span(coordinates: [f64; 4], pixels: u32) -> Range<u32> {
    let low = coordinates.iter().copied().fold(f64::INFINITY, f64::min) - 2.0;
    let high = coordinates.iter().copied().fold(f64::NEG_INFINITY, f64::max) + 2.0;
    let end = f64::from(pixels);
    low.floor().clamp(0.0, end) as u32..high.ceil().clamp(0.0, end) as u32
}

/// The level for a picture of whose pixels a texel of level 0 spans `steps`; `None` if it is too
/// deep.
fn level(steps: (f64, f64), resolution: Resolution) -> Option<u8> {
    let exact = (steps.0 * steps.1).sqrt().log2();
    // Rounding must not make two levels of one that fits.
    let level = match resolution {
        Resolution::Closest => exact.round(),
        Resolution::Finer => (exact - 1e-6).ceil(),
        Resolution::Coarser => (exact + 1e-6).floor(),
    };
    (level <= f64::from(MAX_LEVEL)).then(|| level.max(0.0) as u8)
}

/// The part of a convex polygon between two columns and between two rows.
fn clip(polygon: &[(f64, f64)], columns: (f64, f64), rows: (f64, f64)) -> Polygon {
    let part = cut(polygon, |p| p.0 - columns.0);
    let part = cut(&part, |p| columns.1 - p.0);
    let part = cut(&part, |p| p.1 - rows.0);
    cut(&part, |p| rows.1 - p.1)
}

/// The part where `side` is not negative.
fn cut(polygon: &[(f64, f64)], side: impl Fn(&(f64, f64)) -> f64) -> Polygon {
    let mut part = Vec::new();
    for (index, from) in polygon.iter().enumerate() {
        let to = &polygon[(index + 1) % polygon.len()];
        let (here, there) = (side(from), side(to));
        if here >= 0.0 {
            part.push(*from);
        }
        if (here >= 0.0) != (there >= 0.0) {
            let t = here / (here - there);
            part.push((from.0 + t * (to.0 - from.0), from.1 + t * (to.1 - from.1)));
        }
    }
    part
}

fn area(polygon: &[(f64, f64)]) -> f64 {
    let Some(first) = polygon.first() else { return 0.0 };
    // From a corner, so that no digits are lost far from the origin.
    let at = |p: &(f64, f64)| (p.0 - first.0, p.1 - first.1);
    let pairs = polygon.iter().zip(polygon.iter().cycle().skip(1));
    let twice: f64 = pairs.map(|(p, q)| (at(p), at(q))).map(|(p, q)| p.0 * q.1 - p.1 * q.0).sum();
    (twice / 2.0).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_undo_each_other() {
        let map = Map { a: 2.0, b: -1.0, x: 5.0, d: 0.5, e: 3.0, y: -7.0 };
        let back = map.inverse().expect("not flat");
        let (c, r) = back.apply(map.apply(11.0, -4.0).0, map.apply(11.0, -4.0).1);
        assert!((c - 11.0).abs() < 1e-12 && (r + 4.0).abs() < 1e-12);
        let one = back.after(&map);
        assert!((one.a - 1.0).abs() < 1e-12 && one.b.abs() < 1e-12 && one.x.abs() < 1e-12);
    }

    #[test]
    fn clipped_areas() {
        let diamond = [(0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)];
        assert!((area(&diamond) - 2.0).abs() < 1e-12);
        assert!((area(&clip(&diamond, (0.0, 9.0), (0.0, 9.0))) - 0.5).abs() < 1e-12);
        assert_eq!(area(&clip(&diamond, (2.0, 3.0), (0.0, 1.0))), 0.0);
    }

    #[test]
    fn the_closest_level() {
        let of = |pixels: f64, resolution| level((pixels, pixels), resolution);
        assert_eq!(of(11.0, Resolution::Closest), Some(3));
        assert_eq!(of(12.0, Resolution::Closest), Some(4));
        assert_eq!(of(12.0, Resolution::Coarser), Some(3));
        assert_eq!(of(9.0, Resolution::Finer), Some(4));
        assert_eq!(of(8.0 + 1e-9, Resolution::Finer), Some(3));
        assert_eq!(of(0.1, Resolution::Closest), Some(0));
        assert_eq!(of(1e12, Resolution::Closest), None);
    }
}
