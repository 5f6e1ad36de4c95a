//! Metres on the ground between points of the lattice. Nothing is shared with [`crate::geo`], in
//! whose metres the stored errors were measured, so that the two can disagree.
//!
//! Points are `[column, row]` of the lattice, fractions allowed; samples stand on integers. The
//! distance of two points is the length of the straight line between them in the raster; for a
//! geographic raster, its length on the ellipsoid (specification, section 2).

use std::f64::consts::FRAC_PI_2;

use crate::container::layout::Header;
use crate::container::reader::Reader;
use crate::geo::CrsKind;
use crate::tile::TileId;

/// A point of the lattice.
pub(super) type Point = [f64; 2];

/// Nodes and weights of Gauss's five-point rule on 0..=1.
const GAUSS: [(f64, f64); 5] = [
    (0.046_910_077_030_668, 0.118_463_442_528_094_5),
    (0.230_765_344_947_158_5, 0.239_314_335_249_683_2),
    (0.5, 0.284_444_444_444_444_4),
    (0.769_234_655_052_841_5, 0.239_314_335_249_683_2),
    (0.953_089_922_969_332, 0.118_463_442_528_094_5),
];
/// Largest latitude difference, in radians, of one piece of a line: the rule is then exact to 13
/// digits.
const PIECE: f64 = 0.05;
/// Most pieces of a line: pole to pole.
const PIECES: f64 = 64.0;
/// Steps of a golden-section search: the minimum's place is found to 10^-3 of its interval, the
/// value of a smooth minimum to 10^-6.
const STEPS: u32 = 15;
/// Relative error of a minimum found so, upwards.
const TOO_LARGE: f64 = 1e-6;
/// Relative difference of scales below which the smallest is used; the true errors are estimated
/// from below in any case.
const SLIGHT: f64 = 3e-4;
/// Most rows whose scales are kept.
const MOST_ROWS: u32 = 1 << 20;

/// Metres of one unit of each coordinate: along x, along y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale {
    pub x: f64,
    pub y: f64,
}

/// Place and scale of a lattice on the ground.
#[derive(Clone, Debug)]
pub(super) struct Ground {
    /// What a step of a column and of a row adds to x and y.
    a: f64,
    b: f64,
    d: f64,
    e: f64,
    /// Latitude in radians of sample (0, 0), and what a column and a row add to it.
    latitude: [f64; 3],
    shape: Shape,
    /// Scales of the rows from the first on, if all samples of a row have the same latitude.
    of_rows: Vec<Scale>,
}

#[derive(Clone, Copy, Debug)]
enum Shape {
    /// Metres of a unit, the same everywhere.
    Plane(f64),
    /// Semi-major axis, squared eccentricity, and radians of a unit.
    Ellipsoid(f64, f64, f64),
}

impl Ground {
    /// The ground of a file.
    pub fn of(reader: &Reader) -> Self {
        let [_, a, b, y0, d, e] = reader.header().transform.unwrap_or([0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        let crs = &reader.metadata().crs;
        let shape = if crs.kind == CrsKind::Geographic {
            let inverse = crs.ellipsoid.inverse_flattening;
            let flattening = if inverse > 1.0 { 1.0 / inverse } else { 0.0 };
            Shape::Ellipsoid(crs.ellipsoid.a, flattening * (2.0 - flattening), crs.unit)
        } else {
            Shape::Plane(crs.unit)
        };
        // Pixel centres lie half a column and half a row from the corner that the geotransform
        // gives.
        let first = y0 + 0.5 * d + 0.5 * e;
        let latitude = [first, d, e].map(|term| term * crs.unit);
        Self { a, b, d, e, latitude, shape, of_rows: Vec::new() }
    }

    /// The same ground with the scales of `rows` rows computed in advance.
    pub fn with_rows(mut self, rows: u32) -> Self {
        if self.is_curved() && self.d == 0.0 && rows <= MOST_ROWS {
            let latitude = |row: u32| self.latitude([0.0, f64::from(row)]);
            self.of_rows = (0..=rows).map(|row| self.scale_at(latitude(row))).collect();
        }
        self
    }

    /// A plane with intervals of `dx` by `dy` metres.
    #[cfg(test)]
    pub fn plane(dx: f64, dy: f64) -> Self {
        let (shape, latitude) = (Shape::Plane(1.0), [0.0; 3]);
        Self { a: dx, b: 0.0, d: 0.0, e: dy, latitude, shape, of_rows: Vec::new() }
    }

    /// Longitudes and latitudes in degrees, on a sphere or WGS 84, with a geotransform of pixel
    /// corners.
    #[cfg(test)]
    pub fn degrees([_, a, b, y0, d, e]: [f64; 6]) -> Self {
        let unit = 1.0_f64.to_radians();
        let latitude = [y0 + 0.5 * (d + e), d, e].map(|term| term * unit);
        let f = 1.0 / 298.257_223_563;
        let shape = Shape::Ellipsoid(6_378_137.0, f * (2.0 - f), unit);
        Self { a, b, d, e, latitude, shape, of_rows: Vec::new() }
    }

    /// True if metres depend on where a point is.
    pub fn is_curved(&self) -> bool {
        matches!(self.shape, Shape::Ellipsoid(..))
    }

    /// Latitude in radians; beyond a pole it exceeds a right angle.
    fn latitude(&self, [column, row]: Point) -> f64 {
        let [first, per_column, per_row] = self.latitude;
        first + per_column * column + per_row * row
    }

    /// Metres of a unit at a latitude; 0 beyond the poles.
    fn scale_at(&self, latitude: f64) -> Scale {
        match self.shape {
            Shape::Plane(unit) => Scale { x: unit, y: unit },
            Shape::Ellipsoid(..) if latitude.abs() > FRAC_PI_2 => Scale { x: 0.0, y: 0.0 },
            Shape::Ellipsoid(a, e2, unit) => {
                // Radii of curvature: N of the prime vertical, M of the meridian.
                let sine = latitude.sin();
                let square = 1.0 - e2 * sine * sine;
                let prime = a / square.sqrt();
                let meridian = prime * (1.0 - e2) / square;
                Scale { x: prime * latitude.cos().max(0.0) * unit, y: meridian * unit }
            }
        }
    }

    /// The smallest and the largest scale among some points and all points between them.
    pub fn scales(&self, points: &[Point]) -> (Scale, Scale) {
        if let Shape::Plane(unit) = self.shape {
            let scale = Scale { x: unit, y: unit };
            return (scale, scale);
        }
        if let Some(known) = self.scales_of_rows(points) {
            return known;
        }
        let (mut south, mut north) = (f64::INFINITY, f64::NEG_INFINITY);
        for &point in points {
            let latitude = self.latitude(point);
            (south, north) = (south.min(latitude), north.max(latitude));
        }
        let far = south.abs().max(north.abs());
        let near = if south <= 0.0 && north >= 0.0 { 0.0 } else { south.abs().min(north.abs()) };
        // Parallels shrink and degrees of a meridian grow towards the poles, where both end.
        let (at_near, at_far) = (self.scale_at(near), self.scale_at(far.min(FRAC_PI_2)));
        let most = Scale { x: at_near.x, y: if near > FRAC_PI_2 { 0.0 } else { at_far.y } };
        let least =
            if far > FRAC_PI_2 { Scale { x: 0.0, y: 0.0 } } else { Scale { x: at_far.x, y: at_near.y } };
        (least, most)
    }

    /// [`Ground::scales`] of the whole rows around some points, if these have been computed.
    fn scales_of_rows(&self, points: &[Point]) -> Option<(Scale, Scale)> {
        let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
        for [_, row] in points {
            (first, last) = (first.min(*row), last.max(*row));
        }
        let (first, last) = (first.floor(), last.ceil());
        if self.of_rows.is_empty() || first < 0.0 {
            return None;
        }
        let (a, b) = (self.of_rows.get(first as usize)?, self.of_rows.get(last as usize)?);
        let [latitude, _, per_row] = self.latitude;
        // Between the equator and a pole, scales change monotonically from row to row.
        let ends = (latitude + first * per_row, latitude + last * per_row);
        let one_side = ends.0 * ends.1 > 0.0 && ends.0.abs().max(ends.1.abs()) < FRAC_PI_2;
        one_side.then(|| {
            let least = Scale { x: a.x.min(b.x), y: a.y.min(b.y) };
            (least, Scale { x: a.x.max(b.x), y: a.y.max(b.y) })
        })
    }

    /// A step of columns and rows in metres, at a fixed scale.
    pub fn flat(&self, [columns, rows]: Point, scale: Scale) -> Point {
        [scale.x * (self.a * columns + self.b * rows), scale.y * (self.d * columns + self.e * rows)]
    }

    /// Metres from one point to another.
    pub fn distance(&self, from: Point, to: Point) -> f64 {
        let step = [to[0] - from[0], to[1] - from[1]];
        if !self.is_curved() {
            return norm(self.flat(step, self.scale_at(0.0)));
        }
        let [first, last] = [self.latitude(from), self.latitude(to)];
        let (start, end) = between_poles(first, last);
        let pieces = (((end - start) * (last - first)).abs() / PIECE).ceil().clamp(1.0, PIECES);
        let length = (end - start) / pieces;
        let mut sum = 0.0;
        let mut piece = 0.0;
        while piece < pieces {
            for (node, weight) in GAUSS {
                let along = start + (piece + node) * length;
                sum += weight * norm(self.flat(step, self.scale_at(first + along * (last - first))));
            }
            piece += 1.0;
        }
        sum * length
    }

    /// Metres from a point to the nearest point of a segment, if less than `than`: never too large,
    /// and too small by at most a share of [`SLIGHT`].
    pub fn to_segment(&self, point: Point, [a, b]: [Point; 2], than: f64) -> Option<f64> {
        let (least, most) = self.scales(&[point, a, b]);
        let flat = |to: Point| self.flat([to[0] - point[0], to[1] - point[1]], least);
        let lower = from_origin(flat(a), flat(b));
        if lower >= than {
            return None;
        }
        if most.x <= least.x * (1.0 + SLIGHT) && most.y <= least.y * (1.0 + SLIGHT) {
            return Some(lower);
        }
        let at = |t: f64| self.distance(point, [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
        let found = least_of(at) * (1.0 - TOO_LARGE);
        Some(found.max(lower)).filter(|&distance| distance < than)
    }

    /// A lower bound of the metres from a point to any point of a block, the square of the lattice
    /// from `[west, north]` to `[east, south]`.
    pub fn to_block(&self, point: Point, [west, north]: Point, [east, south]: Point) -> f64 {
        let nearest = [point[0].clamp(west, east), point[1].clamp(north, south)];
        if nearest == point {
            return 0.0;
        }
        let corners = [[west, north], [east, north], [east, south], [west, south]];
        let (least, _) = self.scales(&[point, corners[0], corners[1], corners[2], corners[3]]);
        let flat = |to: Point| self.flat([to[0] - point[0], to[1] - point[1]], least);
        if (self.b, self.d) == (0.0, 0.0) {
            return norm(flat(nearest));
        }
        let sides = (0..4).map(|i| from_origin(flat(corners[i]), flat(corners[(i + 1) % 4])));
        sides.fold(f64::INFINITY, f64::min)
    }

    /// An upper bound of the metres from any point of a block to point `to`. The block has half the
    /// size `half` about `centre`.
    pub fn upper_bound(&self, centre: Point, half: f64, to: Point) -> f64 {
        let corner = |x: f64, y: f64| [centre[0] + x * half, centre[1] + y * half];
        let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0)];
        let (_, most) = self.scales(&[corners[0], corners[1], corners[2], corners[3], to]);
        let away = corners.map(|corner| norm(self.flat([to[0] - corner[0], to[1] - corner[1]], most)));
        away.into_iter().fold(0.0, f64::max)
    }

    /// Metres of an interval along a row and along a column of a tile, as metric `paper` and the
    /// statistics use them: at the largest scales among the tile's samples in the raster, times a
    /// factor that covers shear.
    pub fn intervals(&self, header: &Header, id: TileId) -> [f64; 2] {
        let step = f64::from(header.spacing(id.level));
        let span = f64::from(header.tile()) * step;
        let along = |index: u32, samples: u32| {
            let (first, last) = (f64::from(index) * span, f64::from(samples - 1));
            [first.min(last), (first + span).min(last)]
        };
        let ([west, east], [north, south]) = (along(id.x, header.width), along(id.y, header.height));
        let (_, most) = self.scales(&[[west, north], [east, north], [west, south], [east, south]]);
        let (u, v) = (self.flat([step, 0.0], most), self.flat([0.0, step], most));
        let lengths = [norm(u), norm(v)];
        let product = lengths[0] * lengths[1];
        let cosine = if product > 0.0 { ((u[0] * v[0] + u[1] * v[1]) / product).abs() } else { 0.0 };
        let shear = if cosine > 1e-9 { (1.0 + cosine).sqrt() } else { 1.0 };
        lengths.map(|length| length * shear)
    }

    /// The longest intervals of columns and rows among some points.
    #[cfg(test)]
    pub fn longest_intervals(&self, points: &[Point]) -> [f64; 2] {
        let (_, most) = self.scales(points);
        [norm(self.flat([1.0, 0.0], most)), norm(self.flat([0.0, 1.0], most))]
    }

    /// True if columns and rows are not at right angles.
    #[cfg(test)]
    pub fn is_sheared(&self) -> bool {
        (self.b, self.d) != (0.0, 0.0)
    }
}

/// The part of a line, within 0..=1, that lies between the poles.
fn between_poles(first: f64, last: f64) -> (f64, f64) {
    if first.abs().max(last.abs()) <= FRAC_PI_2 {
        return (0.0, 1.0);
    }
    let at = |pole: f64| ((pole - first) / (last - first)).clamp(0.0, 1.0);
    if first == last {
        return (0.0, 0.0);
    }
    let (south, north) = (at(-FRAC_PI_2), at(FRAC_PI_2));
    (south.min(north), south.max(north))
}

/// Length of a vector.
fn norm([x, y]: Point) -> f64 {
    x.hypot(y)
}

/// Distance of the origin from a segment of the plane.
fn from_origin(a: Point, b: Point) -> f64 {
    let step = [b[0] - a[0], b[1] - a[1]];
    let square = step[0] * step[0] + step[1] * step[1];
    let along = if square > 0.0 { -(a[0] * step[0] + a[1] * step[1]) / square } else { 0.0 };
    let along = along.clamp(0.0, 1.0);
    norm([a[0] + along * step[0], a[1] + along * step[1]])
}

/// The minimum on 0..=1 of a function with a single minimum there.
fn least_of(f: impl Fn(f64) -> f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_894_8;
    let (mut low, mut high) = (0.0, 1.0);
    let (mut left, mut right) = (1.0 - GOLDEN, GOLDEN);
    let (mut at_left, mut at_right) = (f(left), f(right));
    let mut best = f(0.0).min(f(1.0));
    for _ in 0..STEPS {
        best = best.min(at_left).min(at_right);
        if at_left < at_right {
            (high, right, at_right) = (right, left, at_left);
            left = high - GOLDEN * (high - low);
            at_left = f(left);
        } else {
            (low, left, at_left) = (left, right, at_right);
            right = low + GOLDEN * (high - low);
            at_right = f(right);
        }
    }
    best.min(at_left).min(at_right)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Length of a line as the sum of many straight pieces.
    fn summed(ground: &Ground, from: Point, to: Point) -> f64 {
        const PARTS: u32 = 200_000;
        let step = [(to[0] - from[0]) / f64::from(PARTS), (to[1] - from[1]) / f64::from(PARTS)];
        let middle = |i: u32| [0, 1].map(|axis| from[axis] + (f64::from(i) + 0.5) * step[axis]);
        (0..PARTS).map(|i| norm(ground.flat(step, ground.scale_at(ground.latitude(middle(i)))))).sum()
    }

    #[test]
    fn distances_are_those_of_short_pieces() {
        let ground = Ground::degrees([0.0, 1.0, 0.0, 80.0, 0.0, -0.1]);
        let lines = [([0.0, 0.0], [30.0, 700.0]), ([3.5, 39.5], [3.0, 55.0]), ([0.0, 1600.0], [90.0, 0.0])];
        for (from, to) in lines {
            let (got, want) = (ground.distance(from, to), summed(&ground, from, to));
            assert!((got / want - 1.0).abs() < 1e-9, "{from:?} {to:?}: {got} {want}");
        }
        // From beyond one pole to beyond the other: the length is that of a meridian.
        let meridian = ground.distance([0.0, -300.0], [0.0, 2000.0]);
        assert!((meridian - 2.0 * 10_001_965.729).abs() < 0.01, "{meridian}");
        assert_eq!(ground.distance([0.0, -300.0], [50.0, -200.0]), 0.0);
    }

    #[test]
    fn known_arcs() {
        // A degree of latitude and of longitude at the equator and at 60 degrees, from tables of
        // the ellipsoid.
        let ground = Ground::degrees([0.0, 1.0, 0.0, 90.5, 0.0, -1.0]);
        let along = |row: f64| ground.distance([0.0, row], [1.0, row]);
        assert!((along(90.0) - 111_319.491).abs() < 0.001);
        assert!((along(30.0) - 55_800.019).abs() < 0.05);
        assert!((ground.distance([0.0, 89.5], [0.0, 90.5]) - 110_574.3).abs() < 0.1);
        assert!(
            (ground.distance([0.0, 0.0], [0.0, 90.0]) - 10_001_965.729).abs() < 0.01,
            "a quarter of a meridian"
        );
    }

    #[test]
    fn bounds_bound() {
        for transform in [[0.0, 1.0, 0.0, 80.0, 0.0, -0.1], [3.0, 0.2, 0.15, 60.0, 0.1, -0.3]] {
            let ground = Ground::degrees(transform);
            let mut seed = 1_u64;
            let mut random = || {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (seed >> 40) as f64 / 262_144.0
            };
            for _ in 0..300 {
                let (point, corner, size) = ([random(), random()], [random(), random()], random() / 8.0);
                let far = [corner[0] + size, corner[1] + size];
                let lower = ground.to_block(point, corner, far);
                let upper =
                    ground.upper_bound([corner[0] + size / 2.0, corner[1] + size / 2.0], size / 2.0, point);
                for i in 0..25 {
                    let inside = [
                        corner[0] + size * f64::from(i % 5) / 4.0,
                        corner[1] + size * f64::from(i / 5) / 4.0,
                    ];
                    let distance = ground.distance(point, inside);
                    assert!(lower <= distance * (1.0 + 1e-9), "{lower} {distance}");
                    assert!(distance <= upper * (1.0 + 1e-9), "{distance} {upper}");
                }
                let segment = [corner, [corner[0] + size, corner[1] + size / 2.0]];
                let found = ground.to_segment(point, segment, f64::INFINITY).unwrap();
                let samples = (0..=2000).map(|i| {
                    let t = f64::from(i) / 2000.0;
                    ground.distance(point, [segment[0][0] + t * size, segment[0][1] + t * size / 2.0])
                });
                let sampled = samples.fold(f64::INFINITY, f64::min);
                let [dx, dy] = ground.longest_intervals(&[corner, far]);
                let apart = (dx + dy) * size / 2000.0 + SLIGHT * sampled;
                assert!(found <= sampled * (1.0 + 1e-9) && found >= sampled - apart, "{found} {sampled}");
                let known = ground.clone().with_rows(80);
                for block in [[corner, far], [point, far]] {
                    let (inner, outer) = (ground.scales(&block), known.scales(&block));
                    assert!(outer.0.x <= inner.0.x && outer.0.y <= inner.0.y);
                    assert!(outer.1.x >= inner.1.x && outer.1.y >= inner.1.y);
                }
            }
        }
    }
}
