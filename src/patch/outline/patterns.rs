//! What the samples of a cell, or of a square of 2 x 2 cells, say of the distance of its points from the outline, without those
//! around it.
//!
//! A bound: the outline elsewhere may be nearer. Most squares that are drawn at twice the spacing have the nearest piece of the
//! outline within, and voids have the same few patterns over and over, so each is looked into once for many tiles.

use super::leaf_cell::{Grid, LEAF_HALVINGS};
use super::search::{Bound, Corners, drawn, quarters, shares};
use super::shape::{Farthest, Fault, Segments};
use crate::geo::Spacing;
use crate::simd;

/// Patterns of the nine samples of a square.
const SQUARES: usize = 1 << 9;
/// Patterns of the four samples of a cell, with either diagonal.
const CELLS: usize = 1 << 5;
/// The cells of a square, as quarters of it.
const QUARTERS: [(usize, usize); 4] = [(0, 0), (1, 0), (0, 1), (1, 1)];
/// Bits of the ratio of a cell's sides that are not looked at.
const RATIO_BITS: u64 = (1 << 45) - 1;
/// Points that a square may have misdrawn: all that are void, all that are valid; those of one drawn cell with either diagonal.
const WAYS: usize = 4;
/// What has not been looked into.
const UNKNOWN: f64 = -1.0;
/// Both faults.
const BOTH: [Fault; 2] = [Fault::Shown, Fault::Hidden];

/// Largest squared distances of points from the outline, by patterns; a side of a cell is 1 interval, the other one `ratio`.
///
/// The ratio is rounded up by less than 1 / 128, so that it is the same for many rows of tiles: distances in longer cells are no
/// smaller.
#[derive(Debug, Default)]
pub(super) struct Patterns {
    ratio: f64,
    /// Square metres of a square interval across.
    scale: f64,
    /// For each pattern, for each of the ways.
    squares: Vec<[f64; WAYS]>,
    /// For each pattern, for each fault.
    cells: Vec<[f64; 2]>,
}

impl Patterns {
    /// Starts a tile.
    pub(super) fn start(&mut self, spacing: Spacing) {
        let ratio = spacing.dy / spacing.dx;
        let ratio = f64::from_bits((ratio.to_bits() + RATIO_BITS) & !RATIO_BITS);
        self.scale = spacing.dx * spacing.dx;
        if self.ratio != ratio {
            self.ratio = ratio;
            self.squares.clear();
            self.squares.resize(SQUARES, [UNKNOWN; WAYS]);
            self.cells.clear();
            self.cells.resize(CELLS, [UNKNOWN; 2]);
        }
    }

    /// For each fault, the bound of all points of a cell that it is possible at; square metres.
    pub(super) fn cell(&mut self, grid: Grid, (x, y): (usize, usize), segments: &mut Segments) -> [f64; 2] {
        let [nw, ne, sw, se] = grid.full(x, y);
        let odd = (x + y) % 2;
        let pattern = usize::from(nw | ne << 1 | sw << 2 | se << 3) | odd << 4;
        if self.cells[pattern][0] == UNKNOWN {
            // A cell with that diagonal is the western or the eastern one in the north of a square.
            let mut samples = [0; 9];
            for (corner, sample) in [nw, ne, sw, se].into_iter().enumerate() {
                samples[corner / 2 * 3 + corner % 2 + odd] = sample;
            }
            let mut of =
                |fault: Fault| self.farthest(&samples, &[(odd, 0)], &[fault], |_| all_of(fault), segments);
            self.cells[pattern] = [of(Fault::Shown), of(Fault::Hidden)];
        }
        self.cells[pattern].map(|squared| squared * self.scale)
    }

    /// For each fault, the bound of all points of the square of 2 x 2 cells at `(2x, 2y)` that it is possible at; square metres.
    pub(super) fn square(&mut self, grid: Grid, at: (usize, usize), segments: &mut Segments) -> [f64; 2] {
        let pattern = pattern(grid, at);
        [self.of_square(pattern, 0, segments), self.of_square(pattern, 1, segments)]
    }

    /// The bound of the misdrawn points of the square at `(2x, 2y)`, drawn as one cell; square metres.
    pub(super) fn drawn(&mut self, grid: Grid, (x, y): (usize, usize), segments: &mut Segments) -> f64 {
        self.of_square(pattern(grid, (x, y)), 2 + (x + y) % 2, segments)
    }

    /// One of the ways of a pattern.
    #[inline]
    fn of_square(&mut self, pattern: usize, way: usize, segments: &mut Segments) -> f64 {
        if self.squares[pattern][way] == UNKNOWN {
            self.squares[pattern][way] = self.look_into(pattern, way, segments);
        }
        self.squares[pattern][way] * self.scale
    }

    /// What [`Patterns::of_square`] remembers.
    #[cold]
    fn look_into(&self, pattern: usize, way: usize, segments: &mut Segments) -> f64 {
        let samples: [u8; 9] = std::array::from_fn(|i| (pattern >> i & 1) as u8);
        if let Some(&fault) = BOTH.get(way) {
            return self.farthest(&samples, &QUARTERS, &[fault], |_| all_of(fault), segments);
        }
        let corners = [0, 2, 6, 8].map(|i| drawn(samples[i]));
        let drawn = quarters(corners, way == 2).map(shares);
        self.farthest(&samples, &QUARTERS, &BOTH, |quarter| drawn[quarter], segments)
    }

    /// The largest squared distance of the points of some cells of a square that are misdrawn by some faults.
    fn farthest(
        &self,
        samples: &[u8; 9],
        cells: &[(usize, usize)],
        faults: &[Fault],
        drawn: impl Fn(usize) -> Corners,
        segments: &mut Segments,
    ) -> f64 {
        let grid = Grid { valid: samples, n: 2, half: (0.5, 0.5 * self.ratio) };
        let mut bound = Bound::default();
        for (quarter, &at) in cells.iter().enumerate() {
            segments.clear();
            for &cell in cells {
                grid.push_segments(segments, at, cell);
            }
            for &fault in faults {
                let polygons = grid.misdrawn(at, drawn(quarter), fault);
                let things = &mut *segments;
                simd::run(Farthest {
                    polygons: &polygons,
                    things,
                    halvings: LEAF_HALVINGS,
                    bound: &mut bound,
                });
            }
        }
        bound.top()
    }
}

/// How the corners of a cell are drawn if all points are that a fault is possible at.
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
