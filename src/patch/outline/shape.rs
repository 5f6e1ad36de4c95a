//! The misdrawn part of a triangle, and how far it lies from the outline.
//!
//! Lengths are metres from the north-west corner of the cell in question. The distance to a convex thing is convex, so
//! over a triangle it is largest at a corner; the largest distance to the nearest of several things is at most the
//! least of these maxima. Where that is too coarse the triangle is halved.

use super::search::{Bound, Corners};

/// Corners (of north-west, north-east, south-west, south-east) of the two triangles of a cell.
pub(super) fn triangles(falling: bool) -> [[usize; 3]; 2] {
    if falling { [[0, 1, 3], [0, 3, 2]] } else { [[0, 1, 2], [1, 3, 2]] }
}

/// A thing whose distance from a point is a convex function of the point.
pub(super) trait Convex: Copy {
    /// Squared distance from `(x, y)`, square metres.
    fn squared(&self, point: (f64, f64)) -> f64;
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
}

impl Convex for Segment {
    #[inline]
    fn squared(&self, (x, y): (f64, f64)) -> f64 {
        let (x, y) = (x - self.from.0, y - self.from.1);
        let t = ((x * self.along.0 + y * self.along.1) * self.inverse).clamp(0.0, 1.0);
        let (x, y) = (x - t * self.along.0, y - t * self.along.1);
        x * x + y * y
    }
}

/// A rectangle somewhere in which there is a point of the outline: its distance is that of its farthest corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Somewhere {
    /// Its centre.
    pub(super) centre: (f64, f64),
    /// Half its width and height; 0 for a point.
    pub(super) half: (f64, f64),
}

impl Convex for Somewhere {
    #[inline]
    fn squared(&self, (x, y): (f64, f64)) -> f64 {
        let (x, y) = ((x - self.centre.0).abs() + self.half.0, (y - self.centre.1).abs() + self.half.1);
        x * x + y * y
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
    /// The misdrawn part of a triangle of a cell of size `(dx, dy)`; `None` if there is none.
    pub(super) fn misdrawn(
        triangle: [usize; 3],
        (dx, dy): (f64, f64),
        full: Corners,
        drawn: Corners,
        fault: Fault,
    ) -> Option<Self> {
        let sign = if fault == Fault::Shown { 1.0 } else { -1.0 };
        let wrong_full = |corner: &Corner| sign * (0.5 - corner.full);
        let wrong_drawn = |corner: &Corner| sign * (corner.drawn - 0.5);
        let mut polygon = Self { len: 3, ..Self::default() };
        for (corner, q) in polygon.corners.iter_mut().zip(triangle) {
            let at = ((q % 2) as f64 * dx, (q / 2) as f64 * dy);
            *corner = Corner { at, full: full[q], drawn: drawn[q] };
        }
        if !polygon.corners().iter().any(|c| wrong_full(c) > 0.0)
            || !polygon.corners().iter().any(|c| wrong_drawn(c) > 0.0)
        {
            return None;
        }
        let polygon = polygon.cut(wrong_full).cut(wrong_drawn);
        (polygon.len > 2).then_some(polygon)
    }

    fn corners(&self) -> &[Corner] {
        &self.corners[..self.len]
    }

    /// The part where `value`, linear over the polygon, is not negative.
    fn cut(&self, value: impl Fn(&Corner) -> f64) -> Self {
        let mut part = Self::default();
        for (i, corner) in self.corners().iter().enumerate() {
            let next = &self.corners[(i + 1) % self.len];
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
        part
    }

    /// Adds a corner; a triangle cut twice has no more than five.
    fn push(&mut self, corner: Corner) {
        if let Some(place) = self.corners.get_mut(self.len) {
            *place = corner;
            self.len += 1;
        }
    }

    /// No point of the polygon is farther than this from the nearest of `things`; infinite if there are none.
    pub(super) fn at_most(&self, things: &[impl Convex]) -> f64 {
        let corners = self.corners();
        let farthest =
            |thing| corners.iter().map(|corner| Convex::squared(thing, corner.at)).fold(0.0, f64::max);
        things.iter().map(farthest).fold(f64::INFINITY, f64::min)
    }

    /// Raises `bound` to the largest distance of a point of the polygon from the nearest of `things`, which are as
    /// they were afterwards.
    pub(super) fn farthest(&self, things: &mut Vec<impl Convex>, halvings: u32, bound: &mut Bound) {
        let at = |i: usize| self.corners[i].at;
        for i in 2..self.len {
            farthest([at(0), at(i - 1), at(i)], things, 0, halvings, bound);
        }
    }
}

/// [`Polygon::farthest`] of a triangle and the things from number `first` on.
fn farthest(
    triangle: [(f64, f64); 3],
    things: &mut Vec<impl Convex>,
    first: usize,
    halvings: u32,
    bound: &mut Bound,
) {
    let mut top = f64::INFINITY;
    let mut near = [f64::INFINITY; 3];
    for thing in &things[first..] {
        let squared = triangle.map(|corner| thing.squared(corner));
        top = top.min(squared[0].max(squared[1]).max(squared[2]));
        for (near, squared) in near.iter_mut().zip(squared) {
            *near = near.min(squared);
        }
    }
    bound.reached(near[0].max(near[1]).max(near[2]));
    if bound.settles(top) {
        return;
    }
    if halvings == 0 {
        bound.cover(top);
        return;
    }
    let [a, b, c] = longest_side_first(triangle);
    let end = things.len();
    keep_near([a, b, c], things, first);
    let middle = (0.5 * (a.0 + b.0), 0.5 * (a.1 + b.1));
    farthest([a, c, middle], things, end, halvings - 1, bound);
    farthest([b, c, middle], things, end, halvings - 1, bound);
    things.truncate(end);
}

/// Appends those of the things from number `first` on that may be the nearest of a point of the triangle.
fn keep_near([a, b, c]: [(f64, f64); 3], things: &mut Vec<impl Convex>, first: usize) {
    let middle = ((a.0 + b.0 + c.0) / 3.0, (a.1 + b.1 + c.1) / 3.0);
    let from_middle =
        |p: (f64, f64)| (p.0 - middle.0) * (p.0 - middle.0) + (p.1 - middle.1) * (p.1 - middle.1);
    let radius = from_middle(a).max(from_middle(b)).max(from_middle(c)).sqrt();
    let end = things.len();
    let nearest = things[first..].iter().map(|thing| thing.squared(middle)).fold(f64::INFINITY, f64::min);
    // Something farther than that from the middle is farther from any point of the triangle than the nearest is.
    let limit = (nearest.sqrt() + 2.0 * radius) * (1.0 + 1e-9);
    for i in first..end {
        let thing = things[i];
        if thing.squared(middle) <= limit * limit {
            things.push(thing);
        }
    }
}

/// The triangle turned so that its longest side runs from the first to the second corner.
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
