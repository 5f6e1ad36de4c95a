//! The misdrawn part of a triangle, and how far it lies from the outline.
//!
//! Lengths are metres from the north-west corner of the cell in question. The distance to a convex thing is convex, so
//! over a triangle it is largest at a corner; the largest distance to the nearest of several things is at most the
//! least of these maxima. Squared it is convex as well, so it is nowhere above the plane through its values at the
//! corners, and the distance to the nearer of two things nowhere above the lower one of two planes. Where all that is too
//! coarse the triangle is halved.

use super::search::{Bound, Corners};
use crate::geo::Plane;
use crate::simd::Kernel;

/// Corners (of north-west, north-east, south-west, south-east) of the two triangles of a cell.
pub(super) fn triangles(falling: bool) -> [[usize; 3]; 2] {
    if falling { [[0, 1, 3], [0, 3, 2]] } else { [[0, 1, 2], [1, 3, 2]] }
}

/// Points that are looked at together.
const LANES: usize = 4;

/// A thing whose distance from a point is a convex function of the point.
pub(super) trait Convex: Copy {
    /// Squared distances from some points `(x, y)`, square metres.
    fn squared(&self, x: [f64; LANES], y: [f64; LANES]) -> [f64; LANES];
}

/// A piece of the outline.
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

    /// The way to a point from the nearest of the segment.
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

/// A parallelogram somewhere in which there is a point of the outline: its distance is that of its farthest corner. Or a segment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Somewhere {
    /// The centre, or the segment.
    middle: Segment,
    /// Half the diagonals of the parallelogram, else 0.
    diagonals: [(f64, f64); 2],
    /// Their squared lengths.
    squared: [f64; 2],
}

impl Somewhere {
    /// A point.
    pub(super) fn point(centre: (f64, f64)) -> Self {
        let middle = Segment { from: centre, along: (0.0, 0.0), inverse: 0.0 };
        Self { middle, diagonals: [(0.0, 0.0); 2], squared: [0.0; 2] }
    }

    /// Any point of the segment between two different points.
    pub(super) fn segment(from: (f64, f64), to: (f64, f64)) -> Self {
        Self { middle: Segment::new(from, to), ..Self::point(from) }
    }

    /// Half a cell to either side of its centre.
    pub(super) fn block(centre: (f64, f64), plane: Plane) -> Self {
        let diagonals = [plane.at(0.5, 0.5), plane.at(0.5, -0.5)];
        Self { diagonals, squared: diagonals.map(|(x, y)| x * x + y * y), ..Self::point(centre) }
    }
}

impl Convex for Somewhere {
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

/// A polygon that is still to be cut.
#[derive(Clone, Copy, Debug, Default)]
struct Uncut {
    corners: [Corner; 5],
    len: usize,
}

/// Which points are misdrawn.
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

/// Things near a cell, and room for a search among them.
#[derive(Debug)]
pub(super) struct Things<T> {
    list: Vec<T>,
    /// Squared distances from the corners and the middle of a triangle.
    distances: Vec<[f64; LANES]>,
    /// Parts that are still to be looked at.
    pending: Vec<Part>,
}

/// Pieces of the outline near a cell.
pub(super) type Segments = Things<Segment>;
/// Places near a block, each with a point of the outline.
pub(super) type Somewheres = Things<Somewhere>;

/// A part of a triangle.
#[derive(Clone, Copy, Debug)]
struct Part {
    corners: [(f64, f64); 3],
    /// Of which of the things one is the nearest of any point of it.
    first: usize,
    end: usize,
    /// How often it may be halved.
    halvings: u32,
}

impl<T> Default for Things<T> {
    fn default() -> Self {
        Self { list: Vec::new(), distances: Vec::new(), pending: Vec::new() }
    }
}

impl<T: Convex> Things<T> {
    /// Forgets all things.
    pub(super) fn clear(&mut self) {
        self.list.clear();
    }

    /// Adds a thing.
    pub(super) fn push(&mut self, thing: T) {
        self.list.push(thing);
    }

    /// Looks at one part of a triangle; the halves that need a look are left pending.
    #[inline(always)]
    fn look(&mut self, part: Part, bound: &mut Bound) {
        let Part { first, end, halvings, .. } = part;
        self.list.truncate(end);
        let [a, b, c] = longest_side_first(part.corners);
        let middle = ((a.0 + b.0 + c.0) / 3.0, (a.1 + b.1 + c.1) / 3.0);
        let (x, y) = ([a.0, b.0, c.0, middle.0], [a.1, b.1, c.1, middle.1]);
        let (mut top, mut lowest) = (f64::INFINITY, 0);
        let mut near = [f64::INFINITY; LANES];
        let things = &self.list[first..end];
        self.distances.resize(things.len(), [0.0; LANES]);
        let distances = &mut self.distances[..things.len()];
        for thing in 0..things.len() {
            let squared = things[thing].squared(x, y);
            for i in 0..LANES {
                near[i] = smaller(squared[i], near[i]);
            }
            let farthest = larger(larger(squared[0], squared[1]), squared[2]);
            lowest = if farthest < top { thing } else { lowest };
            top = smaller(farthest, top);
            distances[thing] = squared;
        }
        bound.reached(near[0].max(near[1]).max(near[2]));
        if bound.settles(top) {
            return;
        }
        let (below, crossings) = self.below_two(lowest, near);
        let top = smaller(top, below);
        if bound.settles(top) {
            return;
        }
        // The farthest point is often where two things are equally near, between the corners.
        bound.raise(self.nearest_on_sides([a, b, c], crossings, first));
        if bound.settles(top) {
            return;
        }
        if halvings == 0 {
            bound.cover(top);
            return;
        }
        self.keep_near([a, b, c], middle, near[3], first);
        let centre = (0.5 * (a.0 + b.0), 0.5 * (a.1 + b.1));
        let half = Part { corners: [b, c, centre], first: end, end: self.list.len(), halvings: halvings - 1 };
        self.pending.push(half);
        self.pending.push(Part { corners: [a, c, centre], ..half });
    }

    /// An upper bound for the squared distance to the nearer one of two things: number `one` of those looked at, and the one that
    /// is nearest where that is farthest. Also how far along the sides from one corner to the next their planes cross; 0 where they do not.
    #[inline(always)]
    fn below_two(&self, one: usize, near: [f64; LANES]) -> (f64, [f64; 3]) {
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
        let (mut top, mut crossings) = (0.0, [0.0; 3]);
        for (i, crossing) in crossings.iter_mut().enumerate() {
            let next = (i + 1) % 3;
            let (at_start, at_end) = (ones[i] - others[i], ones[next] - others[next]);
            top = larger(smaller(ones[i], others[i]), top);
            if at_start * at_end < 0.0 {
                *crossing = at_start / (at_start - at_end);
                top = larger(ones[i] + (ones[next] - ones[i]) * *crossing, top);
            }
        }
        (top, crossings)
    }

    /// The largest squared distance from the nearest of the things from number `first` on, of a point on each side of a triangle.
    #[inline(always)]
    fn nearest_on_sides(&self, corners: [(f64, f64); 3], along: [f64; 3], first: usize) -> f64 {
        let (mut x, mut y) = ([corners[0].0; LANES], [corners[0].1; LANES]);
        for i in 0..3 {
            let (from, to) = (corners[i], corners[(i + 1) % 3]);
            (x[i], y[i]) = (from.0 + (to.0 - from.0) * along[i], from.1 + (to.1 - from.1) * along[i]);
        }
        let mut near = [f64::INFINITY; LANES];
        for thing in &self.list[first..] {
            let squared = thing.squared(x, y);
            for i in 0..LANES {
                near[i] = smaller(squared[i], near[i]);
            }
        }
        near.into_iter().fold(0.0, f64::max)
    }

    /// Appends those of the things from number `first` on that may be the nearest of a point of the triangle. The
    /// squared distance of the nearest of its middle is `nearest`.
    #[inline(always)]
    fn keep_near(&mut self, corners: [(f64, f64); 3], middle: (f64, f64), nearest: f64, first: usize) {
        let [a, b, c] =
            corners.map(|p| (p.0 - middle.0) * (p.0 - middle.0) + (p.1 - middle.1) * (p.1 - middle.1));
        let radius = larger(larger(a, b), c).sqrt();
        // Something farther than that from the middle is farther from any point of the triangle than the nearest is.
        let limit = (nearest.sqrt() + 2.0 * radius) * (1.0 + 1e-9);
        for i in 0..self.distances.len() {
            if self.distances[i][3] <= limit * limit {
                let thing = self.list[first + i];
                self.list.push(thing);
            }
        }
    }
}

/// Raises `bound` to the largest distance of a point of the polygons from the nearest of `things`, which are as they were
/// afterwards.
pub(super) struct Farthest<'a, T> {
    pub(super) polygons: &'a [Option<Polygon>],
    pub(super) things: &'a mut Things<T>,
    /// How often a triangle may be halved.
    pub(super) halvings: u32,
    pub(super) bound: &'a mut Bound,
}

impl<T: Convex> Kernel for Farthest<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { polygons, things, halvings, bound } = self;
        let end = things.list.len();
        for polygon in polygons {
            let Some(polygon) = polygon else { continue };
            for i in 2..polygon.len {
                let at = |i: usize| polygon.corners[i];
                let corners = [at(0), at(i - 1), at(i)];
                things.pending.clear();
                things.pending.push(Part { corners, first: 0, end, halvings });
                while let Some(part) = things.pending.pop() {
                    things.look(part, bound);
                }
            }
        }
        things.list.truncate(end);
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
