//! Which vertices of one tile a mesh must have: the exact rule, scale by scale.
//!
//! A vertex is needed if one of the two triangles that it splits is off by more than the limit, or
//! shows part valid and part void ground, or if a vertex that needs it is needed. Small triangles
//! come first. What the triangles of a vertex are off by is bounded by what their halves are off
//! by and the distance of the vertex from the side that it splits; only where that bound exceeds
//! the limit are the samples of a triangle looked at, one by one.

use super::terrain::Extent;
use super::triangle::Triangle;
use crate::error::Result;
use crate::sample::VALID;

/// At least one sample is valid.
pub(super) const HAS_VALID: u8 = 1;
/// At least one sample is void.
pub(super) const HAS_VOID: u8 = 2;
/// Both.
pub(super) const MIXED: u8 = HAS_VALID | HAS_VOID;

/// What is known of how far a triangle is off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Verdict {
    /// At most this, which is within the limit.
    Within(f64),
    /// More than the limit.
    Beyond,
    /// Not known: the samples of this tile do not tell.
    Open,
}

/// What a tile tells the tile around it of the vertex at its middle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Below {
    /// True if the vertex is needed.
    pub is_marked: bool,
    /// What the triangles that it splits are off by at most, if it is not.
    pub bound: f64,
    /// Kinds of samples of the tile.
    pub kinds: u8,
}

/// Answers for a triangle, in coordinates of the whole lattice, that a tile's samples leave open.
pub(super) type Resolve<'a> = &'a dyn Fn(&Triangle) -> Result<Verdict>;

/// One tile while its vertices are marked. Coordinates are its own, `0..=n`.
#[derive(Default)]
pub(super) struct Square {
    /// Intervals on a side.
    pub n: usize,
    /// Heights; those outside the window are those of the nearest sample in it.
    pub heights: Vec<f64>,
    /// States of the samples; empty if all are valid.
    pub states: Vec<u8>,
    /// The sample of its corner, and the samples from one of its own to the next.
    pub place: ((i64, i64), i64),
    /// The window.
    pub extent: Extent,
    /// First and last column, first and last row within the window; may be empty.
    pub inside: [(i64, i64); 2],
    /// What the terrain between its samples is off by at most; infinite if nothing is known.
    pub between: f64,
    /// The limit.
    pub limit: f64,
    /// True if the diagonal of the whole tile runs from north-west to south-east.
    pub is_falling: bool,
    /// 1 for the vertices that are needed.
    pub marks: Vec<u8>,
    /// Bounds of the triangles that each vertex splits.
    bounds: Vec<f32>,
    /// Kinds of the samples of these triangles.
    kinds: Vec<u8>,
}

impl Square {
    /// Gets ready for a tile of `n` intervals.
    pub fn begin(&mut self, n: usize) {
        let count = (n + 1) * (n + 1);
        self.n = n;
        self.heights.resize(count, 0.0);
        self.states.clear();
        self.marks.clear();
        self.marks.resize(count, 0);
        self.bounds.clear();
        self.bounds.resize(count, 0.0);
        self.kinds.clear();
        self.kinds.resize(count, 0);
    }

    /// Index of a vertex.
    fn at(&self, x: usize, y: usize) -> usize {
        y * (self.n + 1) + x
    }

    /// True if all of the tile lies within the window.
    fn is_inside(&self) -> bool {
        let n = self.n as i64;
        self.inside.iter().all(|&(first, last)| first <= 0 && last >= n)
    }

    /// Marks the vertices of every scale. `resolve` is asked where `between` leaves a verdict open.
    pub fn mark_all(&mut self, resolve: Resolve<'_>) -> Result<Below> {
        if self.states.is_empty() && self.is_inside() && self.n >= 2 {
            self.first_edges();
        } else {
            self.edges(1, resolve)?;
        }
        self.centres(1, resolve)?;
        let mut s = 2;
        while 2 * s <= self.n {
            self.edges(s, resolve)?;
            self.centres(s, resolve)?;
            s *= 2;
        }
        Ok(self.below())
    }

    /// Marks the middle of the tile and of its sides, whose four quadrants have been marked.
    pub fn mark_outer(&mut self, quadrants: [Below; 4], resolve: Resolve<'_>) -> Result<Below> {
        let (n, half) = (self.n, self.n / 2);
        for (number, below) in quadrants.into_iter().enumerate() {
            let at = self.at(half / 2 + (number & 1) * half, half / 2 + (number >> 1) * half);
            self.marks[at] = u8::from(below.is_marked);
            self.bounds[at] = up(below.bound);
            self.kinds[at] = below.kinds;
        }
        let kinds = quadrants.iter().fold(0, |kinds, below| kinds | below.kinds);
        self.edges(half, resolve)?;
        self.centres(half, resolve)?;
        debug_assert_eq!(half * 2, n);
        Ok(Below { kinds, ..self.below() })
    }

    fn below(&self) -> Below {
        let middle = self.at(self.n / 2, self.n / 2);
        let kinds = if self.states.is_empty() {
            HAS_VALID
        } else {
            self.kinds_of_rows(|_| (0, self.n as i64), (0, self.n as i64))
        };
        Below { is_marked: self.marks[middle] == 1, bound: self.bounds[middle].into(), kinds }
    }

    /// [`Square::edges`] of scale 1 where all samples are valid and within the window.
    fn first_edges(&mut self) {
        let (n, width) = (self.n, self.n + 1);
        let (between, limit) = (self.between, self.limit);
        for y in 0..=n {
            let row = y * width;
            for x in (1 - y % 2..=n).step_by(2) {
                let at = row + x;
                let (before, after) = if y % 2 == 0 { (at - 1, at + 1) } else { (at - width, at + width) };
                let off = (self.heights[at] - 0.5 * (self.heights[before] + self.heights[after])).abs();
                self.marks[at] = u8::from(off > limit);
                self.bounds[at] = up(off + between);
                self.kinds[at] = HAS_VALID;
            }
        }
    }

    /// Marks the edge vertices of a scale.
    fn edges(&mut self, s: usize, resolve: Resolve<'_>) -> Result<()> {
        let n = self.n;
        for y in (0..=n).step_by(s) {
            // On even rows the sides lie along the row, on odd ones along columns.
            let along_row = (y / s).is_multiple_of(2);
            for x in (if along_row { s } else { 0 }..=n).step_by(2 * s) {
                self.edge((x, y), s, along_row, resolve)?;
            }
        }
        Ok(())
    }

    /// Marks an edge vertex, if it is needed.
    fn edge(
        &mut self,
        (x, y): (usize, usize),
        s: usize,
        along_row: bool,
        resolve: Resolve<'_>,
    ) -> Result<()> {
        let (n, at, half) = (self.n, self.at(x, y), s / 2);
        let place = |along: i64, across: i64| {
            let (dx, dy) = if along_row { (along, across) } else { (across, along) };
            (x as i64 + dx, y as i64 + dy)
        };
        let index = |(x, y): (i64, i64)| self.at(x as usize, y as usize);
        let (a, b) = (place(-(s as i64), 0), place(s as i64, 0));
        let across = if along_row { y } else { x };
        let sides = [(-1, across >= s), (1, across + s <= n)];
        let (mut bound, mut kinds) = (0.0_f64, 0);
        for (side, _) in sides.iter().filter(|(_, there)| *there) {
            if half > 0 {
                for along in [-1, 1] {
                    let child = index(place(along * half as i64, side * half as i64));
                    if self.marks[child] == 1 {
                        self.marks[at] = 1;
                        return Ok(());
                    }
                    bound = bound.max(self.bounds[child].into());
                    kinds |= self.kinds[child];
                }
            } else {
                bound = self.between;
                kinds |= self.kind(index(place(0, *side)));
            }
        }
        if half == 0 {
            kinds |= self.kind(index(a)) | self.kind(index(b)) | self.kind(at);
        }
        let off = (self.heights[at] - 0.5 * (self.heights[index(a)] + self.heights[index(b)])).abs();
        let triangles =
            sides.iter().filter(|(_, there)| *there).map(|(side, _)| [a, b, place(0, side * s as i64)]);
        let triangles: [Option<[(i64, i64); 3]>; 2] = {
            let mut each = triangles;
            [each.next(), each.next()]
        };
        self.decide((x, y), (off, bound, kinds), triangles, resolve)
    }

    /// Marks the centres of a scale.
    fn centres(&mut self, s: usize, resolve: Resolve<'_>) -> Result<()> {
        let n = self.n;
        for y in (s..n).step_by(2 * s) {
            for x in (s..n).step_by(2 * s) {
                self.centre((x, y), s, resolve)?;
            }
        }
        Ok(())
    }

    /// Marks a centre, if it is needed.
    fn centre(&mut self, (x, y): (usize, usize), s: usize, resolve: Resolve<'_>) -> Result<()> {
        let at = self.at(x, y);
        let children = [self.at(x, y - s), self.at(x - s, y), self.at(x + s, y), self.at(x, y + s)];
        let (mut bound, mut kinds) = (0.0_f64, 0);
        for child in children {
            if self.marks[child] == 1 {
                self.marks[at] = 1;
                return Ok(());
            }
            bound = bound.max(self.bounds[child].into());
            kinds |= self.kinds[child];
        }
        let (west, east, north, south) = ((x - s) as i64, (x + s) as i64, (y - s) as i64, (y + s) as i64);
        // The parity of the cell. Within the tile it is that of the whole level, unless one cell
        // fills the tile.
        let is_falling =
            if 2 * s == self.n { self.is_falling } else { (x / (2 * s) + y / (2 * s)).is_multiple_of(2) };
        let (a, b, c, d) = if is_falling {
            ((west, north), (east, south), (east, north), (west, south))
        } else {
            ((east, north), (west, south), (west, north), (east, south))
        };
        let height = |(x, y): (i64, i64)| self.heights[self.at(x as usize, y as usize)];
        let off = (self.heights[at] - 0.5 * (height(a) + height(b))).abs();
        self.decide((x, y), (off, bound, kinds), [Some([a, b, c]), Some([a, b, d])], resolve)
    }

    /// Marks a vertex if one of its triangles is off by more than the limit, and sets its bound.
    fn decide(
        &mut self,
        (x, y): (usize, usize),
        (off, bound, kinds): (f64, f64, u8),
        triangles: [Option<[(i64, i64); 3]>; 2],
        resolve: Resolve<'_>,
    ) -> Result<()> {
        let at = self.at(x, y);
        self.kinds[at] = kinds;
        let all_valid = kinds == HAS_VALID;
        if all_valid && off > self.limit && self.contains(x as i64, y as i64) {
            self.marks[at] = 1;
            return Ok(());
        }
        let mut total = if all_valid { off + bound } else { f64::INFINITY };
        if kinds == HAS_VOID || kinds == 0 {
            total = 0.0;
        } else if total > self.limit {
            total = 0.0;
            for corners in triangles.into_iter().flatten() {
                let heights = corners.map(|(x, y)| self.heights[self.at(x as usize, y as usize)]);
                let triangle = Triangle { corners, heights };
                let absolute = self.absolute(&triangle);
                if !self.is_inside() && !self.extent.meets(&absolute) {
                    continue;
                }
                let verdict = match self.measure(&triangle, kinds) {
                    Verdict::Open => resolve(&absolute)?,
                    verdict => verdict,
                };
                match verdict {
                    Verdict::Within(most) => total = total.max(most),
                    Verdict::Beyond | Verdict::Open => {
                        self.marks[at] = 1;
                        return Ok(());
                    }
                }
            }
        }
        self.bounds[at] = up(total);
        Ok(())
    }

    /// A triangle in coordinates of the whole lattice.
    fn absolute(&self, triangle: &Triangle) -> Triangle {
        let ((left, top), spacing) = self.place;
        let corners = triangle.corners.map(|(x, y)| (left + x * spacing, top + y * spacing));
        Triangle { corners, heights: triangle.heights }
    }

    /// What a triangle is off by, by the samples of this tile.
    fn measure(&self, triangle: &Triangle, kinds: u8) -> Verdict {
        if kinds & HAS_VOID != 0 {
            let corners = triangle.corners.iter().map(|&(x, y)| self.kind(self.at(x as usize, y as usize)));
            let mut found = corners.fold(0, |kinds, kind| kinds | kind);
            for part in triangle.parts() {
                let columns = |row: i64| {
                    let step = row - part.rows.0;
                    (part.left.0 + part.left.1 * step, part.right.0 + part.right.1 * step)
                };
                found |= self.kinds_of_rows(columns, part.rows);
            }
            match found {
                MIXED => return Verdict::Beyond,
                HAS_VALID => {}
                _ if self.between == 0.0 => return Verdict::Within(0.0),
                _ => return Verdict::Open,
            }
        }
        let plane = triangle.plane();
        let mut most = 0.0_f64;
        for part in triangle.parts() {
            let (first, last) = (part.rows.0.max(self.inside[1].0), part.rows.1.min(self.inside[1].1));
            for row in first..=last {
                let step = row - part.rows.0;
                let left = (part.left.0 + part.left.1 * step).max(self.inside[0].0);
                let right = (part.right.0 + part.right.1 * step).min(self.inside[0].1);
                if left > right {
                    continue;
                }
                let samples = &self.heights
                    [self.at(left as usize, row as usize)..=self.at(right as usize, row as usize)];
                most = most.max(furthest(samples, plane.height(left, row), plane.along()));
                if most > self.limit {
                    return Verdict::Beyond;
                }
            }
        }
        // Two surfaces that are linear between the samples differ most at samples; the terrain
        // lies as far from one of them as `between` says.
        if most + self.between <= self.limit { Verdict::Within(most + self.between) } else { Verdict::Open }
    }

    /// Kinds of the samples of some rows that lie within the window.
    fn kinds_of_rows(&self, columns: impl Fn(i64) -> (i64, i64), rows: (i64, i64)) -> u8 {
        let mut kinds = 0;
        for row in rows.0.max(self.inside[1].0)..=rows.1.min(self.inside[1].1) {
            let (left, right) = columns(row);
            for column in left.max(self.inside[0].0)..=right.min(self.inside[0].1) {
                kinds |= self.kind(self.at(column as usize, row as usize));
            }
            if kinds == MIXED {
                break;
            }
        }
        kinds
    }

    /// The kind of a sample.
    fn kind(&self, at: usize) -> u8 {
        if self.states.is_empty() || self.states[at] == VALID { HAS_VALID } else { HAS_VOID }
    }

    /// True if a place lies within the window.
    fn contains(&self, x: i64, y: i64) -> bool {
        let within = |value: i64, (first, last): (i64, i64)| first <= value && value <= last;
        within(x, self.inside[0]) && within(y, self.inside[1])
    }
}

/// The largest distance of a row of heights from a straight line.
fn furthest(samples: &[f64], start: f64, slope: f64) -> f64 {
    let mut lanes = [0.0_f64; 4];
    let (fours, rest) = samples.as_chunks::<4>();
    for (number, four) in fours.iter().enumerate() {
        let column = (4 * number) as f64;
        for lane in 0..4 {
            let off = (four[lane] - (start + slope * (column + lane as f64))).abs();
            lanes[lane] = if off > lanes[lane] { off } else { lanes[lane] };
        }
    }
    let done = samples.len() - rest.len();
    for (number, &sample) in rest.iter().enumerate() {
        lanes[0] = lanes[0].max((sample - (start + slope * (done + number) as f64)).abs());
    }
    lanes.into_iter().fold(0.0, f64::max)
}

/// A bound as f32, never below it.
fn up(bound: f64) -> f32 {
    let near = bound as f32;
    if f64::from(near) < bound { near.next_up() } else { near }
}
