//! Branch and bound over the quadtree of a tile's cells: the largest distance of a misdrawn point, within half a
//! per cent.
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

/// How much larger than the truth a squared distance may end up, by the number of triangles looked at so far: half a
/// per cent in the distance at first, more where a pattern repeats itself all over a patch and nothing can be ruled out.
const SLACK: [(u32, f64); 3] = [(500, 1.005 * 1.005), (2_000, 1.04 * 1.04), (u32::MAX, 1.15 * 1.15)];

/// Lower and upper bound of the largest squared distance met so far, square metres.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bound {
    low: f64,
    top: f64,
    /// Triangles looked at.
    effort: u32,
}

impl Bound {
    /// Takes notice of a misdrawn point of a triangle that is this far.
    #[inline]
    pub(super) fn reached(&mut self, squared: f64) {
        self.raise(squared);
        self.effort = self.effort.saturating_add(1);
    }

    /// Takes notice of another misdrawn point of that triangle.
    #[inline]
    pub(super) fn raise(&mut self, squared: f64) {
        self.low = self.low.max(squared);
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

    /// The upper bound, square metres.
    pub(super) fn top(self) -> f64 {
        self.top
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
}

/// Corners of a square: north-west, north-east, south-west, south-east.
pub(super) type Corners = [f64; 4];

/// Looks at the cells of a tile, and at squares of them.
pub(super) trait Cells {
    /// For each fault, squared metres: no point of square `(x, y)` of `2^level` cells, which hold `bits`, that the fault is
    /// possible at is farther from the outline.
    fn reach(&mut self, level: usize, at: (usize, usize), bits: u8) -> [f64; 2];

    /// Raises `bound` to cover the points of cell `(x, y)` that are misdrawn by one of `faults`, where validity as drawn is
    /// `drawn` at its corners. Lowers `ceilings` to what it finds out about all points of the cell that a fault is possible
    /// at, however they are drawn.
    fn look(
        &mut self,
        cell: (usize, usize),
        drawn: Corners,
        faults: [bool; 2],
        ceilings: &mut Ceilings,
        bound: &mut Bound,
    );
}

/// For each fault, square metres: no point of a square at which it is possible is farther from the outline, whatever is drawn.
/// Infinite as long as nobody asked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ceilings([f32; 2]);

impl Ceilings {
    /// Nobody has asked.
    const UNKNOWN: Self = Self([f32::INFINITY; 2]);

    /// True if somebody has asked.
    #[inline]
    fn is_known(self) -> bool {
        self.0[0] < f32::INFINITY
    }

    /// The ceiling of a fault.
    #[inline]
    pub(super) fn of(self, fault: usize) -> f64 {
        f64::from(self.0[fault])
    }

    /// Lowers the ceiling of a fault.
    #[inline]
    pub(super) fn lower(&mut self, fault: usize, squared: f64) {
        let rounded = squared as f32;
        let above = if f64::from(rounded) < squared { rounded.next_up() } else { rounded };
        self.0[fault] = self.0[fault].min(above);
    }

    /// Lowers the ceilings of a square to those of its quarters, which hold `bits`.
    #[inline]
    fn lower_to(&mut self, quarters: &[Self; 4], bits: [u8; 4]) {
        let mut highest = [0.0_f32; 2];
        for (Self([shown, hidden]), bits) in quarters.iter().zip(bits) {
            highest[0] = larger(highest[0], if bits & HAS_VOID != 0 { *shown } else { 0.0 });
            highest[1] = larger(highest[1], if bits & HAS_VALID != 0 { *hidden } else { 0.0 });
        }
        for (own, highest) in self.0.iter_mut().zip(highest) {
            *own = if highest < *own { highest } else { *own };
        }
    }

    /// The highest of some faults.
    #[inline]
    fn highest(self, faults: [bool; 2]) -> f64 {
        let of = |fault: usize| if faults[fault] { self.0[fault] } else { 0.0 };
        f64::from(larger(of(0), of(1)))
    }
}

/// The larger of two numbers, of which none is NaN: that needs no care.
#[inline]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Cells of a tile and their unions, four by four: level `j` has squares of `2^j` cells.
#[derive(Debug, Default)]
pub(super) struct Pyramid {
    n: usize,
    levels: Vec<Level>,
    /// Ceilings of four squares that are quarters of one, in the order in which they were asked for: a search finds those that it
    /// needs near each other. The first are nobody's.
    ceilings: Vec<[Ceilings; 4]>,
}

#[derive(Debug, Default)]
struct Level {
    /// [`HAS_VALID`], [`HAS_VOID`].
    bits: Vec<u8>,
    /// For each square of the next level, row by row: where the ceilings of its quarters are, 0 if nobody has asked. The last level, of
    /// one square, has one number for it.
    families: Vec<u32>,
}

impl Pyramid {
    /// Starts a pyramid over `n x n` cells, a power of two: gives their bits, row by row, to be written. Then
    /// [`Pyramid::build`].
    pub(super) fn start(&mut self, n: usize) -> &mut [u8] {
        self.ceilings.clear();
        self.ceilings.push([Ceilings::UNKNOWN; 4]);
        self.n = n;
        self.levels.resize_with(n.ilog2() as usize + 1, Level::default);
        for (level, squares) in self.levels.iter_mut().enumerate() {
            let count = (n >> level) * (n >> level);
            squares.bits.resize(count, 0);
            squares.families.clear();
            squares.families.resize(count.div_ceil(4), 0);
        }
        &mut self.levels[0].bits
    }

    /// Builds the levels above the cells.
    pub(super) fn build(&mut self) {
        simd::run(Build(self));
    }

    /// Where the ceilings of the quarters of a square of the level above `level` are, or of the one square of the last level.
    #[inline]
    fn family(&mut self, level: usize, square: usize) -> usize {
        let number = &mut self.levels[level].families[square];
        if *number == 0 {
            // At most (2048 / 2)^2 and what is above them.
            *number = self.ceilings.len() as u32;
            self.ceilings.push([Ceilings::UNKNOWN; 4]);
        }
        *number as usize
    }

    /// Bits of the squares of a level, row by row.
    pub(super) fn bits(&self, level: usize) -> &[u8] {
        &self.levels[level].bits
    }

    /// Largest squared distance of a misdrawn point in square `(x, y)` of level `root`, if drawn as `drawing` says, in square
    /// metres; `finer` if that is larger.
    pub(super) fn farthest(
        &mut self,
        drawing: &Drawing,
        root: usize,
        at: (usize, usize),
        finer: f64,
        cells: &mut impl Cells,
    ) -> f64 {
        let bound = Bound { top: finer, ..Bound::default() };
        let mut search = Search { pyramid: self, drawing, cells, bound };
        let side = search.pyramid.n >> root;
        let bits = search.pyramid.levels[root].bits[at.1 * side + at.0];
        if let Some(entered) = search.enter(root, at, bits, [0; 4], true) {
            let family = search.pyramid.family(root, at.1 / 2 * (side / 2) + at.0 / 2);
            let quarter = at.1 % 2 * 2 + at.0 % 2;
            let ceilings = search.ceilings(root, at, bits, (family, quarter));
            if !search.bound.settles(ceilings.highest(entered.faults)) {
                let now = search.visit(root, at, entered, ceilings);
                search.pyramid.ceilings[family][quarter] = now;
            }
        }
        search.bound.top
    }
}

/// Builds a pyramid.
struct Build<'a>(&'a mut Pyramid);

impl Kernel for Build<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Pyramid { n, levels, .. } = self.0;
        for level in 1..levels.len() {
            let (finer, coarser) = levels.split_at_mut(level);
            by_four(&finer[level - 1].bits, *n >> (level - 1), &mut coarser[0].bits);
        }
    }
}

/// Joins the bits of each two by two of `side x side` squares.
#[inline(always)]
fn by_four(bits: &[u8], side: usize, joined: &mut [u8]) {
    let half = side / 2;
    for row in 0..half {
        let (north, south) = (&bits[2 * row * side..][..side], &bits[(2 * row + 1) * side..][..side]);
        let (north, south) = (&north.as_chunks::<2>().0[..half], &south.as_chunks::<2>().0[..half]);
        let joined = &mut joined[row * half..][..half];
        for x in 0..half {
            let ([a, b], [c, d]) = (north[x], south[x]);
            joined[x] = a | b | c | d;
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

/// A square in which something may be misdrawn.
#[derive(Clone, Copy, Default)]
struct Entered {
    /// Validity as drawn at its corners; not defined above the drawn level.
    drawn: Drawn,
    /// True if the diagonal of the drawn cell runs from north-west to south-east; likewise.
    falling: bool,
    /// Which faults are possible.
    faults: [bool; 2],
}

struct Search<'a, C> {
    pyramid: &'a mut Pyramid,
    drawing: &'a Drawing<'a>,
    cells: &'a mut C,
    bound: Bound,
}

impl<C: Cells> Search<'_, C> {
    /// What is to be known of square `(x, y)` of a level, which holds `bits`; `None` if all of it is drawn as it should be.
    /// `drawn` and `falling` are those that the square above gives; above the drawn level they are not defined.
    #[inline(always)]
    fn enter(
        &self,
        level: usize,
        (x, y): (usize, usize),
        bits: u8,
        drawn: Drawn,
        falling: bool,
    ) -> Option<Entered> {
        if level < self.drawing.level {
            let faults = faults(bits, drawn);
            return faults.contains(&true).then_some(Entered { drawn, falling, faults });
        }
        if bits != MIXED {
            return None;
        }
        if level > self.drawing.level {
            return Some(Entered { drawn, falling, faults: [true; 2] });
        }
        let drawn = self.corners(x, y);
        let faults = faults(bits, drawn);
        let falling = ((x + y) % 2 == 0) != self.drawing.flip;
        faults.contains(&true).then_some(Entered { drawn, falling, faults })
    }

    /// The ceilings of square `at` of a level, which are number `quarter` of [`Pyramid::family`] `family`.
    #[inline]
    fn ceilings(
        &mut self,
        level: usize,
        at: (usize, usize),
        bits: u8,
        (family, quarter): (usize, usize),
    ) -> Ceilings {
        let known = self.pyramid.ceilings[family][quarter];
        if known.is_known() { known } else { self.ask(level, at, bits, (family, quarter)) }
    }

    /// Finds ceilings that are not known yet.
    #[inline(never)]
    fn ask(
        &mut self,
        level: usize,
        at: (usize, usize),
        bits: u8,
        (family, quarter): (usize, usize),
    ) -> Ceilings {
        let of_square = &mut self.pyramid.ceilings[family][quarter];
        for (fault, reach) in self.cells.reach(level, at, bits).into_iter().enumerate() {
            of_square.lower(fault, reach);
        }
        *of_square
    }

    /// Searches square `(x, y)` of a level, which has been entered, and which its ceilings do not settle. Gives its ceilings, which may be
    /// lower than they were.
    fn visit(
        &mut self,
        level: usize,
        (x, y): (usize, usize),
        entered: Entered,
        mut own: Ceilings,
    ) -> Ceilings {
        let Entered { drawn, falling, faults } = entered;
        if level == 0 {
            self.cells.look((x, y), shares(drawn), faults, &mut own, &mut self.bound);
            return own;
        }
        let side = self.pyramid.n >> level;
        let family = self.pyramid.family(level - 1, y * side + x);
        let (north, south) = (4 * y * side + 2 * x, (4 * y + 2) * side + 2 * x);
        let bits = &self.pyramid.levels[level - 1].bits;
        let bits = [bits[north], bits[north + 1], bits[south], bits[south + 1]];
        // Those that may be farthest first.
        let (mut order, mut inside) = ([(0.0, 0); 4], [Entered::default(); 4]);
        let mut count = 0;
        for (q, drawn) in quarters(drawn, falling).into_iter().enumerate() {
            let at = (2 * x + q % 2, 2 * y + q / 2);
            let Some(here) = self.enter(level - 1, at, bits[q], drawn, falling) else { continue };
            inside[q] = here;
            let ceiling = self.ceilings(level - 1, at, bits[q], (family, q)).highest(here.faults);
            let mut place = count;
            while place > 0 && order[place - 1].0 < ceiling {
                order[place] = order[place - 1];
                place -= 1;
            }
            order[place] = (ceiling, q);
            count += 1;
        }
        for &(ceiling, q) in &order[..count] {
            // The rest is no farther.
            if self.bound.settles(ceiling) {
                break;
            }
            let at = (2 * x + q % 2, 2 * y + q / 2);
            let before = self.pyramid.ceilings[family][q];
            let now = self.visit(level - 1, at, inside[q], before);
            self.pyramid.ceilings[family][q] = now;
        }
        own.lower_to(&self.pyramid.ceilings[family], bits);
        own
    }

    /// Validity at the corners of drawn cell `(x, y)`.
    fn corners(&self, x: usize, y: usize) -> Drawn {
        let (row, level) = (self.pyramid.n + 1, self.drawing.level);
        let at = |x: usize, y: usize| drawn(self.drawing.valid[(y << level) * row + (x << level)]);
        [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)]
    }
}

/// Validity as drawn at the corners of a square, less 1/2, in units of 1 / [`ONE`]: halved as often as a tile can be, it is exact.
pub(super) type Drawn = [i32; 4];
/// Validity 1.
const ONE: i32 = 1 << 16;

/// A sample that is drawn as it is, 1 or 0.
#[inline]
pub(super) fn drawn(valid: u8) -> i32 {
    i32::from(valid) * ONE - ONE / 2
}

/// In units of 1.
#[inline]
pub(super) fn shares(drawn: Drawn) -> Corners {
    drawn.map(|value| 0.5 + f64::from(value) / f64::from(ONE))
}

/// Which faults, of shown and hidden, are possible in a square with these bits, whatever the samples in it.
#[inline]
fn faults(bits: u8, [nw, ne, sw, se]: Drawn) -> [bool; 2] {
    // Negative if one of them is: if something is drawn, or not drawn.
    let (shown, hidden) = (-nw | -ne | -sw | -se, nw | ne | sw | se);
    [shown < 0 && bits & HAS_VOID != 0, hidden < 0 && bits & HAS_VALID != 0]
}

/// Values at the corners of the quarters of a square.
#[inline]
pub(super) fn quarters([nw, ne, sw, se]: Drawn, falling: bool) -> [Drawn; 4] {
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
