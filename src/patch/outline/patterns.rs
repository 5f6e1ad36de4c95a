//! Upper bounds of the distance from the outline of the points of a cell, or of a square of 2 x 2
//! cells, from its own samples alone.
//!
//! They are bounds because the outline elsewhere may be nearer. Most squares that are drawn at
//! twice the spacing have the nearest piece of the outline inside, and voids have the same few
//! patterns over and over, so each pattern is measured once for many tiles.

use super::bound::Bound;
use super::grid::{Grid, halvings};
use super::search::{as_validity, child_corners, drawn_sample};
use super::shape::{Corners, Farthest, Fault, Segments};
use crate::geo::{Plane, Planes};
use crate::simd;

/// Number of patterns of the nine samples of a square.
const SQUARES: usize = 1 << 9;
/// Number of patterns of the four samples of a cell, with either diagonal.
const CELLS: usize = 1 << 5;
/// The cells of a square.
const CELLS_OF_SQUARE: [(usize, usize); 4] = [(0, 0), (1, 0), (0, 1), (1, 1)];
/// Bits of the ratio of a cell's sides that are dropped: those below 1 / 128.
const RATIO_BITS: u32 = 45;
/// Bits that are dropped in a tile whose rows have different ratios: those below 1 / 16.
const RATIO_BITS_UNEVEN: u32 = 48;
/// Most shapes of cells that are kept.
const SHAPES: usize = 32;
/// Ways in which a square may be misdrawn: at all void points, at all valid points, and at those
/// where it differs from one drawn cell, with either diagonal.
const WAYS: usize = 4;
/// The value of a pattern that has not been measured.
const UNKNOWN: f64 = -1.0;
/// Both faults.
const BOTH: [Fault; 2] = [Fault::Shown, Fault::Hidden];

/// Largest squared distances of misdrawn points from the outline, by pattern, for cells of a few
/// shapes.
#[derive(Debug, Default)]
pub(super) struct Patterns {
    shapes: Vec<Shape>,
    /// Index of the shape that was used last.
    last: usize,
    ratio_bits: u32,
}

/// Distances in cells of one shape; a side of a cell is 1 interval.
///
/// The ratio to the other side is rounded up a little, so that many rows of tiles have the same:
/// distances in longer cells are no smaller. (Sheared cells are not rounded.)
#[derive(Debug)]
struct Shape {
    plane: Plane,
    /// For each pattern, for each way.
    squares: Vec<[f64; WAYS]>,
    /// For each pattern, for each fault.
    cells: Vec<[f64; 2]>,
}

impl Shape {
    fn new(plane: Plane) -> Self {
        Self { plane, squares: vec![[UNKNOWN; WAYS]; SQUARES], cells: vec![[UNKNOWN; 2]; CELLS] }
    }
}

impl Patterns {
    /// Starts a tile.
    pub(super) fn start(&mut self, planes: &Planes) {
        self.ratio_bits = if planes.is_even() { RATIO_BITS } else { RATIO_BITS_UNEVEN };
    }

    /// The shape that the cells of a plane have.
    #[inline]
    fn shape(&mut self, plane: Plane) -> &mut Shape {
        let rest = (1_u64 << self.ratio_bits) - 1;
        let ratio = plane.dy / plane.dx;
        let plane = if plane.skew == 0.0 {
            Plane { dx: 1.0, skew: 0.0, dy: f64::from_bits((ratio.to_bits() + rest) & !rest) }
        } else {
            Plane { dx: 1.0, skew: plane.skew / plane.dx * (1.0 + 1e-12), dy: ratio * (1.0 + 1e-12) }
        };
        if self.shapes.get(self.last).is_none_or(|shape| shape.plane != plane) {
            self.find(plane);
        }
        &mut self.shapes[self.last]
    }

    /// Finds or adds the shape of a plane, and makes it the last one used.
    #[inline(never)]
    fn find(&mut self, plane: Plane) {
        let place = self.shapes.iter().position(|shape| shape.plane == plane);
        self.last = place.unwrap_or_else(|| {
            if self.shapes.len() == SHAPES {
                self.shapes.clear();
            }
            self.shapes.push(Shape::new(plane));
            self.shapes.len() - 1
        });
    }

    /// For each fault, the upper bound of all points of a cell at which it is possible; square
    /// metres.
    pub(super) fn cell(
        &mut self,
        grid: Grid,
        (x, y): (usize, usize),
        plane: Plane,
        segments: &mut Segments,
    ) -> [f64; 2] {
        let shape = self.shape(plane);
        let [nw, ne, sw, se] = grid.full(x, y);
        let odd = (x + y) % 2;
        let pattern = usize::from(nw | ne << 1 | sw << 2 | se << 3) | odd << 4;
        if shape.cells[pattern][0] == UNKNOWN {
            // A cell with that diagonal is the western or the eastern one in the north of a square.
            let mut samples = [0; 9];
            for (corner, sample) in [nw, ne, sw, se].into_iter().enumerate() {
                samples[corner / 2 * 3 + corner % 2 + odd] = sample;
            }
            let mut of =
                |fault: Fault| shape.farthest(&samples, &[(odd, 0)], &[fault], |_| all_of(fault), segments);
            shape.cells[pattern] = [of(Fault::Shown), of(Fault::Hidden)];
        }
        shape.cells[pattern].map(|squared| squared * plane.dx * plane.dx)
    }

    /// For each fault, the upper bound of all points of the square of 2 x 2 cells at `(2x, 2y)` at
    /// which it is possible; square metres.
    pub(super) fn square(
        &mut self,
        grid: Grid,
        at: (usize, usize),
        plane: Plane,
        segments: &mut Segments,
    ) -> [f64; 2] {
        let (shape, pattern) = (self.shape(plane), pattern(grid, at));
        let of = [shape.of_square(pattern, 0, segments), shape.of_square(pattern, 1, segments)];
        of.map(|squared| squared * plane.dx * plane.dx)
    }

    /// The upper bound of the misdrawn points of the square at `(2x, 2y)`, drawn as one cell;
    /// square metres.
    pub(super) fn drawn(
        &mut self,
        grid: Grid,
        (x, y): (usize, usize),
        plane: Plane,
        segments: &mut Segments,
    ) -> f64 {
        let squared = self.shape(plane).of_square(pattern(grid, (x, y)), 2 + (x + y) % 2, segments);
        squared * plane.dx * plane.dx
    }
}

impl Shape {
    /// The value of a pattern for a way; measured if it is not known.
    #[inline]
    fn of_square(&mut self, pattern: usize, way: usize, segments: &mut Segments) -> f64 {
        if self.squares[pattern][way] == UNKNOWN {
            self.squares[pattern][way] = self.measure(pattern, way, segments);
        }
        self.squares[pattern][way]
    }

    /// Measures the value of [`Shape::of_square`].
    #[cold]
    fn measure(&self, pattern: usize, way: usize, segments: &mut Segments) -> f64 {
        let samples: [u8; 9] = std::array::from_fn(|i| (pattern >> i & 1) as u8);
        if let Some(&fault) = BOTH.get(way) {
            return self.farthest(&samples, &CELLS_OF_SQUARE, &[fault], |_| all_of(fault), segments);
        }
        let corners = [0, 2, 6, 8].map(|i| drawn_sample(samples[i]));
        let drawn = child_corners(corners, way == 2).map(as_validity);
        self.farthest(&samples, &CELLS_OF_SQUARE, &BOTH, |cell| drawn[cell], segments)
    }

    /// The largest squared distance of the points of some cells of a square at which they are
    /// misdrawn by some faults.
    fn farthest(
        &self,
        samples: &[u8; 9],
        cells: &[(usize, usize)],
        faults: &[Fault],
        drawn: impl Fn(usize) -> Corners,
        segments: &mut Segments,
    ) -> f64 {
        let grid = Grid { valid: samples, n: 2 };
        let mut bound = Bound::default();
        for (index, &at) in cells.iter().enumerate() {
            segments.clear();
            for &cell in cells {
                grid.push_segments(segments, at, cell, self.plane);
            }
            for &fault in faults {
                let polygons = grid.misdrawn(at, drawn(index), fault, self.plane);
                let sites = &mut *segments;
                simd::run(Farthest {
                    polygons: &polygons,
                    sites,
                    halvings: halvings(self.plane),
                    bound: &mut bound,
                });
            }
        }
        bound.upper()
    }
}

/// Drawn corners with which all points of a cell at which a fault is possible are misdrawn.
fn all_of(fault: Fault) -> Corners {
    [if fault == Fault::Shown { 1.0 } else { 0.0 }; 4]
}

/// The samples of the square of 2 x 2 cells at `(2x, 2y)` as bits, row by row.
#[inline]
fn pattern(grid: Grid, (x, y): (usize, usize)) -> usize {
    let row = |j: usize| {
        let from = (2 * y + j) * (grid.n + 1) + 2 * x;
        let samples = &grid.valid[from..from + 3];
        usize::from(samples[0] | samples[1] << 1 | samples[2] << 2)
    };
    row(0) | row(1) << 3 | row(2) << 6
}
