//! Branch and bound over the quadtree of a tile's cells: the largest distance of a misdrawn point, within a per cent.
//!
//! A node is a square of cells. It is skipped if all that lies in it is drawn as it should be, or if nothing in it can
//! be farther from the outline than what is found already. Validity as drawn is linear along the way down: the centre
//! of a square is the mean of the ends of the coarse diagonal, whether the square lies on it or not.

use crate::sample::VALID;

/// Bit of a cell: a sample of its closed square is valid.
pub(super) const HAS_VALID: u8 = 1;
/// Bit of a cell: a sample of its closed square is void.
pub(super) const HAS_VOID: u8 = 2;
/// Both.
pub(super) const MIXED: u8 = HAS_VALID | HAS_VOID;

/// How much larger than the truth a squared distance may end up, by the number of triangles looked at so far: one per
/// cent in the distance at first, more where a pattern repeats itself all over a patch and nothing can be ruled out.
const SLACK: [(u32, f64); 3] = [(500, 1.01 * 1.01), (2_000, 1.04 * 1.04), (u32::MAX, 1.15 * 1.15)];

/// Lower and upper bound of the largest squared distance met so far, square metres.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bound {
    low: f64,
    top: f64,
    /// Triangles looked at.
    effort: u32,
}

impl Bound {
    /// Takes notice of a misdrawn point that is this far.
    pub(super) fn reached(&mut self, squared: f64) {
        self.low = self.low.max(squared);
        self.effort = self.effort.saturating_add(1);
    }

    /// True if points that are at most this far need no closer look; they are covered then.
    pub(super) fn settles(&mut self, squared: f64) -> bool {
        let slack = SLACK.iter().find(|(effort, _)| self.effort <= *effort).map_or(1.0, |&(_, slack)| slack);
        let settled = squared <= self.top || squared <= self.low * slack;
        if settled {
            self.cover(squared);
        }
        settled
    }

    /// Takes this distance as it is, without a closer look.
    pub(super) fn cover(&mut self, squared: f64) {
        self.top = self.top.max(squared);
    }

    /// The same search, for a part of the points.
    pub(super) fn part(self) -> Self {
        Self { top: 0.0, ..self }
    }

    /// Takes over what was found out about a part; gives the upper bound of the part.
    pub(super) fn join(&mut self, part: Self) -> f64 {
        *self = Self { top: self.top.max(part.top), ..part };
        part.top
    }

    /// The bound in metres, rounded up.
    pub(super) fn metres(self) -> f64 {
        self.top.sqrt() * (1.0 + 1e-9)
    }
}

/// Corners of a square: north-west, north-east, south-west, south-east.
pub(super) type Corners = [f64; 4];

/// Looks into one cell of the tile.
pub(super) trait Cell {
    /// Raises `bound` to cover the misdrawn points of cell `(x, y)`, where validity as drawn is `drawn` at its corners.
    fn look(&mut self, cell: (usize, usize), drawn: Corners, bound: &mut Bound);
}

/// Cells of a tile and their unions, four by four: level `j` has squares of `2^j` cells.
#[derive(Debug)]
pub(super) struct Pyramid {
    n: usize,
    levels: Vec<Level>,
}

#[derive(Debug)]
struct Level {
    /// [`HAS_VALID`], [`HAS_VOID`].
    bits: Vec<u8>,
    /// Square metres: no misdrawn point of the square is farther from the outline.
    reach: Vec<f64>,
}

impl Pyramid {
    /// Builds the pyramid over `n x n` cells given row by row as (bits, reach); `n` is a power of two.
    pub(super) fn new(n: usize, cells: impl Iterator<Item = (u8, f64)>) -> Self {
        let (bits, reach) = cells.unzip();
        let mut levels = vec![Level { bits, reach }];
        for level in 0..n.ilog2() as usize {
            levels.push(levels[level].united(n >> level));
        }
        Self { n, levels }
    }

    /// Largest distance of a misdrawn point in square `(x, y)` of level `root`, if drawn at spacing `2^drawn`, in metres.
    pub(super) fn farthest(
        &self,
        drawing: &Drawing,
        root: usize,
        at: (usize, usize),
        cell: &mut impl Cell,
    ) -> f64 {
        let mut search = Search { pyramid: self, drawing, cell, bound: Bound::default() };
        search.visit(root, at, [0.0; 4], true);
        search.bound.metres()
    }
}

impl Level {
    /// The level above this one of `side x side` squares.
    fn united(&self, side: usize) -> Self {
        Self { bits: by_four(&self.bits, side, |a, b| a | b), reach: by_four(&self.reach, side, f64::max) }
    }
}

/// Joins the values of each two by two of `side x side` squares.
fn by_four<T: Copy>(values: &[T], side: usize, join: impl Fn(T, T) -> T) -> Vec<T> {
    let mut joined = Vec::with_capacity(values.len() / 4);
    for rows in values.chunks_exact(2 * side) {
        let (north, south) = rows.split_at(side);
        let pairs = north.chunks_exact(2).zip(south.chunks_exact(2));
        joined.extend(pairs.map(|(a, b)| join(join(a[0], a[1]), join(b[0], b[1]))));
    }
    joined
}

/// How the tile is drawn.
pub(super) struct Drawing<'a> {
    /// States of its samples, `(n + 1)^2`.
    pub(super) state: &'a [u8],
    /// Its spacing is `2^level`.
    pub(super) level: usize,
    /// True if the diagonals are the other way round than the tile's own cell numbers say.
    pub(super) flip: bool,
}

struct Search<'a, C> {
    pyramid: &'a Pyramid,
    drawing: &'a Drawing<'a>,
    cell: &'a mut C,
    bound: Bound,
}

impl<C: Cell> Search<'_, C> {
    /// Searches square `(x, y)` of a level. From the drawn level down `drawn` holds at its corners, and `falling` says
    /// that the diagonal of the drawn cell runs from north-west to south-east.
    fn visit(&mut self, level: usize, (x, y): (usize, usize), mut drawn: Corners, mut falling: bool) {
        let side = self.pyramid.n >> level;
        let squares = &self.pyramid.levels[level];
        let bits = squares.bits[y * side + x];
        if level >= self.drawing.level && bits != MIXED {
            return;
        }
        if level == self.drawing.level {
            drawn = self.corners(x, y);
            falling = ((x + y) % 2 == 0) != self.drawing.flip;
        }
        if level <= self.drawing.level && drawn_right(bits, drawn) {
            return;
        }
        if self.bound.settles(squares.reach[y * side + x]) {
            return;
        }
        if level == 0 {
            self.cell.look((x, y), drawn, &mut self.bound);
            return;
        }
        let finer = &self.pyramid.levels[level - 1].reach;
        let reach = |q: usize| finer[(2 * y + q / 2) * 2 * side + 2 * x + q % 2];
        let mut order = [(0, reach(0)), (1, reach(1)), (2, reach(2)), (3, reach(3))];
        order.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        for (q, _) in order {
            self.visit(level - 1, (2 * x + q % 2, 2 * y + q / 2), quarter(drawn, falling, q), falling);
        }
    }

    /// Validity at the corners of drawn cell `(x, y)`.
    fn corners(&self, x: usize, y: usize) -> Corners {
        let (row, level) = (self.pyramid.n + 1, self.drawing.level);
        [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)]
            .map(|(x, y)| f64::from(u8::from(self.drawing.state[(y << level) * row + (x << level)] == VALID)))
    }
}

/// True if a square with these bits is drawn as it should be, whatever the samples in it.
fn drawn_right(bits: u8, drawn: Corners) -> bool {
    let shown = drawn.iter().any(|&value| value > 0.5);
    let hidden = drawn.iter().any(|&value| value < 0.5);
    !(shown && bits & HAS_VOID != 0 || hidden && bits & HAS_VALID != 0)
}

/// Values at the corners of quarter `q` of a square.
fn quarter([nw, ne, sw, se]: Corners, falling: bool, q: usize) -> Corners {
    let centre = 0.5 * if falling { nw + se } else { ne + sw };
    let (north, south, west, east) = (0.5 * (nw + ne), 0.5 * (sw + se), 0.5 * (nw + sw), 0.5 * (ne + se));
    match q {
        0 => [nw, north, west, centre],
        1 => [north, ne, centre, east],
        2 => [west, centre, sw, south],
        _ => [centre, east, south, se],
    }
}
