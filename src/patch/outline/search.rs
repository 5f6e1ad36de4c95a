//! Branch and bound over the quadtree of a tile's cells: the largest distance of a misdrawn point,
//! within half a per cent.
//!
//! A node is a square of cells. It is pruned if all of it is drawn rightly, or if its upper bound
//! is no larger than the distance found already. Validity as drawn is linear along the way down:
//! the centre of a square is the mean of the ends of the coarse diagonal, whether the square lies
//! on it or not.

use super::bound::{Bound, UpperBounds};
use super::pyramid::Pyramid;
use super::shape::Corners;
use crate::patch::blocks::{HAS_VALID, HAS_VOID, MIXED};

/// Evaluates the cells of a tile, and bounds squares of them.
pub(super) trait Cells {
    /// For each fault an upper bound, in square metres, of the squared distance from the outline of
    /// the points of square `(x, y)` of `2^level` cells, which hold `bits`, at which the fault is
    /// possible.
    fn upper_bound(&mut self, level: usize, at: (usize, usize), bits: u8) -> [f64; 2];

    /// Raises `bound` to the points of cell `(x, y)` that are misdrawn by one of `faults`, where
    /// validity as drawn is `drawn` at its corners. Lowers `upper_bounds` if it finds smaller ones
    /// for all points of the cell at which a fault is possible, however they are drawn.
    fn evaluate(
        &mut self,
        cell: (usize, usize),
        drawn: Corners,
        faults: [bool; 2],
        upper_bounds: &mut UpperBounds,
        bound: &mut Bound,
    );
}

/// How a tile is drawn.
pub(super) struct Drawing<'a> {
    /// 1 for each of its samples that is valid, `(n + 1)^2`.
    pub(super) valid: &'a [u8],
    /// Binary logarithm of the drawn spacing.
    pub(super) level: usize,
    /// True if the diagonals are the other way round than the tile's own cell numbers say.
    pub(super) flip: bool,
}

/// A node of the search: a square in which a point may be misdrawn.
#[derive(Clone, Copy, Default)]
struct Node {
    /// Validity as drawn at its corners; not defined above the drawn level.
    drawn: DrawnCorners,
    /// True if the diagonal of the drawn cell runs from north-west to south-east; not defined above
    /// the drawn level.
    falling: bool,
    /// Which faults are possible.
    faults: [bool; 2],
}

/// A search of the squares of a tile.
struct Search<'a, C> {
    pyramid: &'a mut Pyramid,
    drawing: &'a Drawing<'a>,
    cells: &'a mut C,
    bound: Bound,
}

impl<C: Cells> Search<'_, C> {
    /// The node of square `(x, y)` of a level, which holds `bits`; `None` if all of it is drawn
    /// rightly. `drawn` and `falling` come from the parent; they are not defined above the drawn
    /// level.
    #[inline(always)]
    fn node(
        &self,
        level: usize,
        (x, y): (usize, usize),
        bits: u8,
        drawn: DrawnCorners,
        falling: bool,
    ) -> Option<Node> {
        if level < self.drawing.level {
            let faults = faults(bits, drawn);
            return faults.contains(&true).then_some(Node { drawn, falling, faults });
        }
        if bits != MIXED {
            return None;
        }
        if level > self.drawing.level {
            return Some(Node { drawn, falling, faults: [true; 2] });
        }
        let drawn = self.corners(x, y);
        let faults = faults(bits, drawn);
        let falling = ((x + y) % 2 == 0) != self.drawing.flip;
        faults.contains(&true).then_some(Node { drawn, falling, faults })
    }

    /// The upper bounds of square `at` of a level, which is child `child` of [`Pyramid::siblings`]
    /// `siblings`.
    #[inline]
    fn upper_bounds(
        &mut self,
        level: usize,
        at: (usize, usize),
        bits: u8,
        (siblings, child): (usize, usize),
    ) -> UpperBounds {
        let known = *self.pyramid.upper_bounds(siblings, child);
        if known.is_known() { known } else { self.compute_upper_bounds(level, at, bits, (siblings, child)) }
    }

    /// Computes and stores upper bounds.
    #[inline(never)]
    fn compute_upper_bounds(
        &mut self,
        level: usize,
        at: (usize, usize),
        bits: u8,
        (siblings, child): (usize, usize),
    ) -> UpperBounds {
        let of_square = self.pyramid.upper_bounds(siblings, child);
        for (fault, squared) in self.cells.upper_bound(level, at, bits).into_iter().enumerate() {
            of_square.lower(fault, squared);
        }
        *of_square
    }

    /// Expands the node of square `(x, y)` of a level, which its upper bounds do not prune:
    /// evaluates a cell, or searches the children. Returns its upper bounds, which may be lower
    /// than `own` was.
    fn expand(
        &mut self,
        level: usize,
        (x, y): (usize, usize),
        node: Node,
        mut own: UpperBounds,
    ) -> UpperBounds {
        let Node { drawn, falling, faults } = node;
        if level == 0 {
            self.cells.evaluate((x, y), as_validity(drawn), faults, &mut own, &mut self.bound);
            return own;
        }
        let side = self.pyramid.side() >> level;
        let siblings = self.pyramid.siblings(level - 1, y * side + x);
        let (north, south) = (4 * y * side + 2 * x, (4 * y + 2) * side + 2 * x);
        let bits = self.pyramid.bits(level - 1);
        let bits = [bits[north], bits[north + 1], bits[south], bits[south + 1]];
        // The children with the largest upper bounds first.
        let (mut order, mut inside) = ([(0.0, 0); 4], [Node::default(); 4]);
        let mut count = 0;
        for (q, drawn) in child_corners(drawn, falling).into_iter().enumerate() {
            let at = (2 * x + q % 2, 2 * y + q / 2);
            let Some(here) = self.node(level - 1, at, bits[q], drawn, falling) else { continue };
            inside[q] = here;
            let upper = self.upper_bounds(level - 1, at, bits[q], (siblings, q)).highest(here.faults);
            let mut place = count;
            while place > 0 && order[place - 1].0 < upper {
                order[place] = order[place - 1];
                place -= 1;
            }
            order[place] = (upper, q);
            count += 1;
        }
        for &(upper, q) in &order[..count] {
            // The upper bounds of the rest are no larger.
            if self.bound.prunes(upper) {
                break;
            }
            let at = (2 * x + q % 2, 2 * y + q / 2);
            let before = *self.pyramid.upper_bounds(siblings, q);
            let now = self.expand(level - 1, at, inside[q], before);
            *self.pyramid.upper_bounds(siblings, q) = now;
        }
        own.lower_to(self.pyramid.all_upper_bounds(siblings), bits);
        own
    }

    /// Validity at the corners of drawn cell `(x, y)`.
    fn corners(&self, x: usize, y: usize) -> DrawnCorners {
        let (row, level) = (self.pyramid.side() + 1, self.drawing.level);
        let at = |x: usize, y: usize| drawn_sample(self.drawing.valid[(y << level) * row + (x << level)]);
        [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)]
    }
}

/// Largest squared distance, in square metres, of a misdrawn point in square `(x, y)` of level
/// `root`, if the tile is drawn as `drawing` says; `finer` if that is larger.
pub(super) fn farthest(
    pyramid: &mut Pyramid,
    drawing: &Drawing,
    root: usize,
    at: (usize, usize),
    finer: f64,
    cells: &mut impl Cells,
) -> f64 {
    let mut search = Search { pyramid, drawing, cells, bound: Bound::starting_from(finer) };
    let side = search.pyramid.side() >> root;
    let bits = search.pyramid.bits(root)[at.1 * side + at.0];
    if let Some(node) = search.node(root, at, bits, [0; 4], true) {
        let siblings = search.pyramid.siblings(root, at.1 / 2 * (side / 2) + at.0 / 2);
        let child = at.1 % 2 * 2 + at.0 % 2;
        let upper_bounds = search.upper_bounds(root, at, bits, (siblings, child));
        if !search.bound.prunes(upper_bounds.highest(node.faults)) {
            let now = search.expand(root, at, node, upper_bounds);
            *search.pyramid.upper_bounds(siblings, child) = now;
        }
    }
    search.bound.upper()
}

/// Validity as drawn at the corners of a square, less 1/2, in units of 1 / [`ONE`]. It stays exact
/// however often a tile can be halved.
pub(super) type DrawnCorners = [i32; 4];
/// Validity 1 in these units.
const ONE: i32 = 1 << 16;

/// The drawn value of a sample whose validity is 1 or 0.
#[inline]
pub(super) fn drawn_sample(valid: u8) -> i32 {
    i32::from(valid) * ONE - ONE / 2
}

/// The validity of drawn corners, 0 to 1.
#[inline]
pub(super) fn as_validity(drawn: DrawnCorners) -> Corners {
    drawn.map(|value| 0.5 + f64::from(value) / f64::from(ONE))
}

/// True for each fault, shown and hidden, that is possible in a square with these bits, whatever
/// its samples.
#[inline]
fn faults(bits: u8, [nw, ne, sw, se]: DrawnCorners) -> [bool; 2] {
    // Negative if one of the terms is: if a part is shown, or a part is hidden.
    let (shown, hidden) = (-nw | -ne | -sw | -se, nw | ne | sw | se);
    [shown < 0 && bits & HAS_VOID != 0, hidden < 0 && bits & HAS_VALID != 0]
}

/// The drawn values at the corners of the four children of a square.
#[inline]
pub(super) fn child_corners([nw, ne, sw, se]: DrawnCorners, falling: bool) -> [DrawnCorners; 4] {
    let middle = |a: i32, b: i32| (a + b) >> 1;
    let centre = if falling { middle(nw, se) } else { middle(ne, sw) };
    let (north, south, west, east) = (middle(nw, ne), middle(sw, se), middle(nw, sw), middle(ne, se));
    [
        [nw, north, west, centre],
        [north, ne, centre, east],
        [west, centre, sw, south],
        [centre, east, south, se],
    ]
}
