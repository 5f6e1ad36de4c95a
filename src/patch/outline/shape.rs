//! The misdrawn part of a triangle, and how far it lies from the outline.
//!
//! Positions are in metres from the north-west corner of the cell in question. A *site* is a convex
//! set with a point of the outline in it. The distance to a site is convex, so over a triangle it
//! is largest at a corner; the largest distance to the nearest of several sites is at most the
//! least of these maxima. The squared distance is convex too, so it is nowhere above the plane
//! through its values at the corners, and the squared distance to the nearer of two sites is
//! nowhere above the lower one of two planes. If these upper bounds are too loose the triangle is
//! halved.

use super::bound::Bound;
use crate::geo::Plane;
use crate::simd::Kernel;

/// Values at the corners of a square: north-west, north-east, south-west, south-east.
pub(super) type Corners = [f64; 4];

/// The two triangles of a cell, as indices of its [`Corners`].
pub(super) fn triangles(falling: bool) -> [[usize; 3]; 2] {
    if falling { [[0, 1, 3], [0, 3, 2]] } else { [[0, 1, 2], [1, 3, 2]] }
}

/// Points that are evaluated together.
const LANES: usize = 4;

/// A site: its distance from a point is a convex function of the point.
pub(super) trait Convex: Copy {
    /// Squared distances from some points `(x, y)`, square metres.
    fn squared(&self, x: [f64; LANES], y: [f64; LANES]) -> [f64; LANES];
}

/// A straight piece of the outline.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    from: (f64, f64),
    along: (f64, f64),
    /// 1 / squared length.
    inverse: f64,
}

impl Segment {
    /// The segment between two different points.
    pub(super) fn new(from: (f64, f64), to: (f64, f64)) -> Self {
        let along = (to.0 - from.0, to.1 - from.1);
        Self { from, along, inverse: 1.0 / (along.0 * along.0 + along.1 * along.1) }
    }

    /// The vector to a point from the nearest point of the segment.
    #[inline(always)]
    fn away(&self, x: f64, y: f64) -> (f64, f64) {
        let (x, y) = (x - self.from.0, y - self.from.1);
        let t = (x * self.along.0 + y * self.along.1) * self.inverse;
        let t = smaller(larger(t, 0.0), 1.0);
        (x - t * self.along.0, y - t * self.along.1)
    }
}

impl Convex for Segment {
    #[inline(always)]
    fn squared(&self, x: [f64; LANES], y: [f64; LANES]) -> [f64; LANES] {
        let mut squared = [0.0; LANES];
        for i in 0..LANES {
            let (x, y) = self.away(x[i], y[i]);
            squared[i] = x * x + y * y;
        }
        squared
    }
}

/// A point of the outline that is known to lie in a parallelogram, whose distance is that of the
/// farthest corner; or any point of a segment.
#[derive(Clone, Copy, Debug)]
pub(super) struct UncertainPoint {
    /// The centre of the parallelogram, or the segment.
    middle: Segment,
    /// Half the diagonals of the parallelogram; 0 for a segment.
    diagonals: [(f64, f64); 2],
    /// Their squared lengths.
    squared: [f64; 2],
}

impl UncertainPoint {
    /// A point at a known place.
    pub(super) fn point(centre: (f64, f64)) -> Self {
        let middle = Segment { from: centre, along: (0.0, 0.0), inverse: 0.0 };
        Self { middle, diagonals: [(0.0, 0.0); 2], squared: [0.0; 2] }
    }

    /// Any point of the segment between two different points.
    pub(super) fn segment(from: (f64, f64), to: (f64, f64)) -> Self {
        Self { middle: Segment::new(from, to), ..Self::point(from) }
    }

    /// A point somewhere in the cell around `centre`.
    pub(super) fn block(centre: (f64, f64), plane: Plane) -> Self {
        let diagonals = [plane.at(0.5, 0.5), plane.at(0.5, -0.5)];
        Self { diagonals, squared: diagonals.map(|(x, y)| x * x + y * y), ..Self::point(centre) }
    }
}

impl Convex for UncertainPoint {
    #[inline(always)]
    fn squared(&self, x: [f64; LANES], y: [f64; LANES]) -> [f64; LANES] {
        let mut squared = [0.0; LANES];
        for i in 0..LANES {
            let (x, y) = self.middle.away(x[i], y[i]);
            let [first, second] =
                self.diagonals.map(|diagonal| 2.0 * (x * diagonal.0 + y * diagonal.1).abs());
            squared[i] = x * x + y * y + larger(first + self.squared[0], second + self.squared[1]);
        }
        squared
    }
}

/// A corner of a polygon, with validity at full resolution and as drawn.
#[derive(Clone, Copy, Debug, Default)]
struct Corner {
    at: (f64, f64),
    full: f64,
    drawn: f64,
}

/// A convex polygon: a triangle, cut at most twice.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Polygon {
    corners: [(f64, f64); 5],
    len: usize,
}

/// A polygon with the values by which it is cut.
#[derive(Clone, Copy, Debug, Default)]
struct Uncut {
    corners: [Corner; 5],
    len: usize,
}

/// The two ways in which a point is misdrawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Fault {
    /// Drawn, though void.
    Shown,
    /// Not drawn, though valid.
    Hidden,
}

impl Fault {
    /// True if this fault is possible where validity as drawn is `drawn`.
    pub(super) fn concerns(self, drawn: f64) -> bool {
        if self == Self::Shown { drawn >= 0.5 } else { drawn <= 0.5 }
    }
}

impl Polygon {
    /// The misdrawn part of a triangle of a cell in a plane; `None` if there is none.
    pub(super) fn misdrawn(
        triangle: [usize; 3],
        plane: Plane,
        full: Corners,
        drawn: Corners,
        fault: Fault,
    ) -> Option<Self> {
        let sign = if fault == Fault::Shown { 1.0 } else { -1.0 };
        let may_be = triangle.iter().any(|&q| sign * (0.5 - full[q]) > 0.0)
            && triangle.iter().any(|&q| sign * (drawn[q] - 0.5) > 0.0);
        if !may_be {
            return None;
        }
        let wrong_full = |corner: &Corner| sign * (0.5 - corner.full);
        let wrong_drawn = |corner: &Corner| sign * (corner.drawn - 0.5);
        let mut polygon = Uncut { len: 3, ..Uncut::default() };
        for (corner, q) in polygon.corners.iter_mut().zip(triangle) {
            let at = plane.at((q % 2) as f64, (q / 2) as f64);
            *corner = Corner { at, full: full[q], drawn: drawn[q] };
        }
        let (mut once, mut twice) = (Uncut::default(), Uncut::default());
        polygon.cut(wrong_full, &mut once);
        once.cut(wrong_drawn, &mut twice);
        let mut polygon = Self { len: twice.len, ..Self::default() };
        for (corner, cut) in polygon.corners.iter_mut().zip(&twice.corners) {
            *corner = cut.at;
        }
        (polygon.len > 2).then_some(polygon)
    }
}

impl Uncut {
    /// The part where `value`, linear over the polygon, is not negative.
    #[inline(always)]
    fn cut(&self, value: impl Fn(&Corner) -> f64, part: &mut Self) {
        for i in 0..self.len {
            let corner = &self.corners[i];
            let next = &self.corners[if i + 1 == self.len { 0 } else { i + 1 }];
            let (a, b) = (value(corner), value(next));
            if a >= 0.0 {
                part.push(*corner);
            }
            if a * b < 0.0 {
                let t = a / (a - b);
                let mix = |from: f64, to: f64| from + t * (to - from);
                part.push(Corner {
                    at: (mix(corner.at.0, next.at.0), mix(corner.at.1, next.at.1)),
                    full: mix(corner.full, next.full),
                    drawn: mix(corner.drawn, next.drawn),
                });
            }
        }
    }

    /// Adds a corner; a triangle cut twice has no more than five.
    #[inline(always)]
    fn push(&mut self, corner: Corner) {
        if let Some(place) = self.corners.get_mut(self.len) {
            *place = corner;
            self.len += 1;
        }
    }
}

/// The larger of two numbers.
#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The smaller of two numbers.
#[inline(always)]
fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// The sites near a cell, and scratch memory for a search among them.
#[derive(Debug)]
pub(super) struct Sites<T> {
    list: Vec<T>,
    /// Squared distances from the corners and the middle of a triangle.
    distances: Vec<[f64; LANES]>,
    /// Triangles that are still to be evaluated.
    pending: Vec<SubTriangle>,
}

/// Pieces of the outline near a cell.
pub(super) type Segments = Sites<Segment>;
/// Points of the outline near a block, each known up to a block.
pub(super) type UncertainPoints = Sites<UncertainPoint>;

/// A triangle that a search has reached by halving.
#[derive(Clone, Copy, Debug)]
struct SubTriangle {
    corners: [(f64, f64); 3],
    /// Range of the sites one of which is the nearest of any point of it.
    first: usize,
    end: usize,
    /// How often it may be halved.
    halvings: u32,
}

impl<T> Default for Sites<T> {
    fn default() -> Self {
        Self { list: Vec::new(), distances: Vec::new(), pending: Vec::new() }
    }
}

impl<T: Convex> Sites<T> {
    /// Removes all sites.
    pub(super) fn clear(&mut self) {
        self.list.clear();
    }

    /// Adds a site.
    pub(super) fn push(&mut self, site: T) {
        self.list.push(site);
    }

    /// Evaluates one triangle; the halves that must be evaluated too are left pending.
    #[inline(always)]
    fn evaluate(&mut self, triangle: SubTriangle, bound: &mut Bound) {
        let SubTriangle { first, end, halvings, .. } = triangle;
        self.list.truncate(end);
        let [a, b, c] = longest_side_first(triangle.corners);
        let middle = ((a.0 + b.0 + c.0) / 3.0, (a.1 + b.1 + c.1) / 3.0);
        let (x, y) = ([a.0, b.0, c.0, middle.0], [a.1, b.1, c.1, middle.1]);
        let (mut upper, mut lowest) = (f64::INFINITY, 0);
        let mut near = [f64::INFINITY; LANES];
        let sites = &self.list[first..end];
        self.distances.resize(sites.len(), [0.0; LANES]);
        let distances = &mut self.distances[..sites.len()];
        for site in 0..sites.len() {
            let squared = sites[site].squared(x, y);
            for i in 0..LANES {
                near[i] = smaller(squared[i], near[i]);
            }
            let farthest = larger(larger(squared[0], squared[1]), squared[2]);
            lowest = if farthest < upper { site } else { lowest };
            upper = smaller(farthest, upper);
            distances[site] = squared;
        }
        bound.evaluated(near[0].max(near[1]).max(near[2]));
        if bound.prunes(upper) {
            return;
        }
        let (below, crossings) = self.upper_bound_of_two(lowest, near);
        let upper = smaller(upper, below);
        if bound.prunes(upper) {
            return;
        }
        // The farthest point is often where two sites are equally near, between the corners.
        bound.raise_lower(self.nearest_on_sides([a, b, c], crossings, first));
        if bound.prunes(upper) {
            return;
        }
        if halvings == 0 {
            bound.raise_upper(upper);
            return;
        }
        self.keep_near([a, b, c], middle, near[3], first);
        let centre = (0.5 * (a.0 + b.0), 0.5 * (a.1 + b.1));
        let half =
            SubTriangle { corners: [b, c, centre], first: end, end: self.list.len(), halvings: halvings - 1 };
        self.pending.push(half);
        self.pending.push(SubTriangle { corners: [a, c, centre], ..half });
    }

    /// An upper bound of the squared distance to the nearer one of two sites: number `one` of those
    /// evaluated, and the one that is nearest where that is farthest. Also where along the sides,
    /// from one corner to the next, their planes cross; 0 where they do not.
    #[inline(always)]
    fn upper_bound_of_two(&self, one: usize, near: [f64; LANES]) -> (f64, [f64; 3]) {
        let Some(&[a, b, c, _]) = self.distances.get(one) else { return (f64::INFINITY, [0.0; 3]) };
        let corner = if a >= b && a >= c {
            0
        } else if b >= c {
            1
        } else {
            2
        };
        let nearest = self.distances.iter().find(|squared| squared[corner] <= near[corner]);
        let Some(&[d, e, f, _]) = nearest else { return (f64::INFINITY, [0.0; 3]) };
        // The lower one of two planes is highest at a corner, or on a side where they cross.
        let (ones, others) = ([a, b, c], [d, e, f]);
        let (mut upper, mut crossings) = (0.0, [0.0; 3]);
        for (i, crossing) in crossings.iter_mut().enumerate() {
            let next = (i + 1) % 3;
            let (at_start, at_end) = (ones[i] - others[i], ones[next] - others[next]);
            upper = larger(smaller(ones[i], others[i]), upper);
            if at_start * at_end < 0.0 {
                *crossing = at_start / (at_start - at_end);
                upper = larger(ones[i] + (ones[next] - ones[i]) * *crossing, upper);
            }
        }
        (upper, crossings)
    }

    /// The largest squared distance, from the nearest of the sites from number `first` on, of one
    /// point on each side of a triangle.
    #[inline(always)]
    fn nearest_on_sides(&self, corners: [(f64, f64); 3], along: [f64; 3], first: usize) -> f64 {
        let (mut x, mut y) = ([corners[0].0; LANES], [corners[0].1; LANES]);
        for i in 0..3 {
            let (from, to) = (corners[i], corners[(i + 1) % 3]);
            (x[i], y[i]) = (from.0 + (to.0 - from.0) * along[i], from.1 + (to.1 - from.1) * along[i]);
        }
        let mut near = [f64::INFINITY; LANES];
        for site in &self.list[first..] {
            let squared = site.squared(x, y);
            for i in 0..LANES {
                near[i] = smaller(squared[i], near[i]);
            }
        }
        near.into_iter().fold(0.0, f64::max)
    }

    /// Appends those of the sites from number `first` on that may be the nearest of a point of the
    /// triangle. `nearest` is the squared distance of its middle from the nearest site.
    #[inline(always)]
    fn keep_near(&mut self, corners: [(f64, f64); 3], middle: (f64, f64), nearest: f64, first: usize) {
        let [a, b, c] =
            corners.map(|p| (p.0 - middle.0) * (p.0 - middle.0) + (p.1 - middle.1) * (p.1 - middle.1));
        let radius = larger(larger(a, b), c).sqrt();
        // A site farther than this from the middle is farther from every point of the triangle than
        // the nearest.
        let limit = (nearest.sqrt() + 2.0 * radius) * (1.0 + 1e-9);
        for i in 0..self.distances.len() {
            if self.distances[i][3] <= limit * limit {
                let site = self.list[first + i];
                self.list.push(site);
            }
        }
    }
}

/// Kernel: raises `bound` to the largest squared distance of a point of the polygons from the
/// nearest of `sites`, which stay as they are.
pub(super) struct Farthest<'a, T> {
    pub(super) polygons: &'a [Option<Polygon>],
    pub(super) sites: &'a mut Sites<T>,
    /// How often a triangle may be halved.
    pub(super) halvings: u32,
    pub(super) bound: &'a mut Bound,
}

impl<T: Convex> Kernel for Farthest<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { polygons, sites, halvings, bound } = self;
        let end = sites.list.len();
        for polygon in polygons {
            let Some(polygon) = polygon else { continue };
            for i in 2..polygon.len {
                let at = |i: usize| polygon.corners[i];
                let corners = [at(0), at(i - 1), at(i)];
                sites.pending.clear();
                sites.pending.push(SubTriangle { corners, first: 0, end, halvings });
                while let Some(triangle) = sites.pending.pop() {
                    sites.evaluate(triangle, bound);
                }
            }
        }
        sites.list.truncate(end);
    }
}

/// The triangle turned so that its longest side runs from the first to the second corner.
#[inline(always)]
fn longest_side_first([a, b, c]: [(f64, f64); 3]) -> [(f64, f64); 3] {
    let squared = |p: (f64, f64), q: (f64, f64)| (p.0 - q.0) * (p.0 - q.0) + (p.1 - q.1) * (p.1 - q.1);
    let (ab, bc, ca) = (squared(a, b), squared(b, c), squared(c, a));
    if ab >= bc && ab >= ca {
        [a, b, c]
    } else if bc >= ca {
        [b, c, a]
    } else {
        [c, a, b]
    }
}
