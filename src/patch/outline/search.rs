//! Branch and bound over the quadtree of a tile's cells: the largest distance of a misdrawn point, within a per cent.
//!
//! A node is a square of cells. It is skipped if all that lies in it is drawn as it should be, or if nothing in it can
//! be farther from the outline than what is found already. Validity as drawn is linear along the way down: the centre
//! of a square is the mean of the ends of the coarse diagonal, whether the square lies on it or not.

use crate::simd::{self, Kernel};

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
    #[inline]
    pub(super) fn reached(&mut self, squared: f64) {
        self.low = self.low.max(squared);
        self.effort = self.effort.saturating_add(1);
    }

    /// True if points that are at most this far need no closer look; they are covered then.
    #[inline]
    pub(super) fn settles(&mut self, squared: f64) -> bool {
        let [(few, close), (more, wide), (_, widest)] = SLACK;
        let slack = if self.effort <= few {
            close
        } else if self.effort <= more {
            wide
        } else {
            widest
        };
        let settled = squared <= self.top || squared <= self.low * slack;
        if settled {
            self.cover(squared);
        }
        settled
    }

    /// Takes this distance as it is, without a closer look.
    #[inline]
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
#[derive(Debug, Default)]
pub(super) struct Pyramid {
    n: usize,
    levels: Vec<Level>,
}

#[derive(Debug, Default)]
struct Level {
    /// [`HAS_VALID`], [`HAS_VOID`].
    bits: Vec<u8>,
    /// Square metres: no misdrawn point of the square is farther from the outline.
    reach: Vec<f64>,
}

impl Pyramid {
    /// Starts a pyramid over `n x n` cells, a power of two: gives their bits and reaches, row by row, to be written. Then
    /// [`Pyramid::build`].
    pub(super) fn start(&mut self, n: usize) -> (&mut [u8], &mut [f64]) {
        self.n = n;
        self.levels.resize_with(n.ilog2() as usize + 1, Level::default);
        for (level, squares) in self.levels.iter_mut().enumerate() {
            let count = (n >> level) * (n >> level);
            squares.bits.resize(count, 0);
            squares.reach.resize(count, 0.0);
        }
        let cells = &mut self.levels[0];
        (&mut cells.bits, &mut cells.reach)
    }

    /// Builds the levels above the cells.
    pub(super) fn build(&mut self) {
        simd::run(Build(self));
    }

    /// Bits of the cells.
    pub(super) fn bits(&self) -> &[u8] {
        &self.levels[0].bits
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
        if let Some((drawn, falling)) = search.enter(root, at, [0; 4], true) {
            search.visit(root, at, drawn, falling);
        }
        search.bound.metres()
    }
}

/// Builds a pyramid.
struct Build<'a>(&'a mut Pyramid);

impl Kernel for Build<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Pyramid { n, levels } = self.0;
        for level in 1..levels.len() {
            let (finer, coarser) = levels.split_at_mut(level);
            let (from, to, side) = (&finer[level - 1], &mut coarser[0], *n >> (level - 1));
            by_four(&from.bits, side, &mut to.bits, |a, b| a | b);
            by_four(&from.reach, side, &mut to.reach, |a, b| if a > b { a } else { b });
        }
    }
}

/// Joins the values of each two by two of `side x side` squares.
#[inline(always)]
fn by_four<T: Copy>(values: &[T], side: usize, joined: &mut [T], join: impl Fn(T, T) -> T) {
    let half = side / 2;
    for row in 0..half {
        let (north, south) = (&values[2 * row * side..][..side], &values[(2 * row + 1) * side..][..side]);
        let (north, south) = (&north.as_chunks::<2>().0[..half], &south.as_chunks::<2>().0[..half]);
        let joined = &mut joined[row * half..][..half];
        for x in 0..half {
            let ([a, b], [c, d]) = (north[x], south[x]);
            joined[x] = join(join(a, b), join(c, d));
        }
    }
}

/// How the tile is drawn.
pub(super) struct Drawing<'a> {
    /// 1 for each of its samples that is valid, `(n + 1)^2`.
    pub(super) valid: &'a [u8],
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
    /// Validity as drawn at the corners of square `(x, y)` of a level, and whether the diagonal of the drawn cell runs from
    /// north-west to south-east; `None` if all of the square is drawn as it should be. `drawn` and `falling` are those
    /// that the square above gives; above the drawn level they are not defined.
    #[inline]
    fn enter(
        &self,
        level: usize,
        (x, y): (usize, usize),
        drawn: Drawn,
        falling: bool,
    ) -> Option<(Drawn, bool)> {
        let bits = self.pyramid.levels[level].bits[y * (self.pyramid.n >> level) + x];
        if level > self.drawing.level {
            return (bits == MIXED).then_some((drawn, falling));
        }
        if level < self.drawing.level {
            return (!drawn_right(bits, drawn)).then_some((drawn, falling));
        }
        if bits != MIXED {
            return None;
        }
        let drawn = self.corners(x, y);
        (!drawn_right(bits, drawn)).then_some((drawn, ((x + y) % 2 == 0) != self.drawing.flip))
    }

    /// Searches square `(x, y)` of a level, which has been entered.
    fn visit(&mut self, level: usize, (x, y): (usize, usize), drawn: Drawn, falling: bool) {
        let side = self.pyramid.n >> level;
        if self.bound.settles(self.pyramid.levels[level].reach[y * side + x]) {
            return;
        }
        if level == 0 {
            let share = |value: i32| f64::from(value) / f64::from(ONE);
            let [nw, ne, sw, se] = drawn;
            self.cell.look((x, y), [share(nw), share(ne), share(sw), share(se)], &mut self.bound);
            return;
        }
        // Those that may be farthest first.
        let finer = &self.pyramid.levels[level - 1].reach;
        let (mut order, mut entered) = ([(0.0, 0); 4], [([0; 4], falling); 4]);
        let mut count = 0;
        for (q, drawn) in quarters(drawn, falling).into_iter().enumerate() {
            let at = (2 * x + q % 2, 2 * y + q / 2);
            let Some(here) = self.enter(level - 1, at, drawn, falling) else { continue };
            entered[q] = here;
            let reach = finer[at.1 * 2 * side + at.0];
            let mut place = count;
            while place > 0 && order[place - 1].0 < reach {
                order[place] = order[place - 1];
                place -= 1;
            }
            order[place] = (reach, q);
            count += 1;
        }
        for &(_, q) in &order[..count] {
            let (drawn, falling) = entered[q];
            self.visit(level - 1, (2 * x + q % 2, 2 * y + q / 2), drawn, falling);
        }
    }

    /// Validity at the corners of drawn cell `(x, y)`.
    fn corners(&self, x: usize, y: usize) -> Drawn {
        let (row, level) = (self.pyramid.n + 1, self.drawing.level);
        let at = |x: usize, y: usize| i32::from(self.drawing.valid[(y << level) * row + (x << level)]) * ONE;
        [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)]
    }
}

/// Validity as drawn at the corners of a square, in units of 1 / [`ONE`]: halved as often as a tile can be, it is exact.
type Drawn = [i32; 4];
/// Validity 1.
const ONE: i32 = 1 << 16;

/// True if a square with these bits is drawn as it should be, whatever the samples in it.
#[inline]
fn drawn_right(bits: u8, [nw, ne, sw, se]: Drawn) -> bool {
    let shown = nw.max(ne).max(sw).max(se) > ONE / 2;
    let hidden = nw.min(ne).min(sw).min(se) < ONE / 2;
    let wrong = (u8::from(shown) * HAS_VOID) | (u8::from(hidden) * HAS_VALID);
    wrong & bits == 0
}

/// Values at the corners of the quarters of a square.
#[inline]
fn quarters([nw, ne, sw, se]: Drawn, falling: bool) -> [Drawn; 4] {
    let centre = if falling { nw + se } else { ne + sw } / 2;
    let (north, south, west, east) = ((nw + ne) / 2, (sw + se) / 2, (nw + sw) / 2, (ne + se) / 2);
    [
        [nw, north, west, centre],
        [north, ne, centre, east],
        [west, centre, sw, south],
        [centre, east, south, se],
    ]
}
