//! The walk through a tile's newborn samples. Encoder and decoder go through the same stages and
//! predictions, and differ in what they do with a row of predictions.

use std::ops::Range;

use crate::codec::bits;
use crate::codec::order::{self, Needed, Row, Stage};
use crate::codec::predict::Planes;
use crate::codec::probe::{Probe, Target};
use crate::codec::void::{self, Fills};
use crate::codec::word::{Weights, Word};
use crate::sample::interpolate;
use crate::sample::state;
use crate::sample::{VALID, VOID};
use crate::simd::{self, Kernel};

/// The part of the walk in which encoder and decoder differ.
pub trait Coder {
    /// Codes of the whole lattice; those of newborn samples that are still to come are not defined.
    fn codes(&self) -> &[i32];
    /// Codes the next corner of the root from its prediction, and returns its code.
    fn code_corner(&mut self, at: usize, prediction: i32) -> i32;
    /// Replaces the predictions of the next row by the codes; void samples keep their predictions.
    fn code_row(&mut self, row: Row, codes: &mut [i32]);
    /// Passes over a row that is not needed.
    fn skip_row(&mut self, row: Row);
    /// The sharpness of a stage whose parents are set.
    fn sharpness<W: Word>(&mut self, stage: Stage, numbers: &mut Numbers<W>) -> i32;
    /// The weights of a stage whose centres are set.
    fn weights<W: Word>(&mut self, stage: Stage, numbers: &mut Numbers<W>) -> Weights;
    /// Codes the fills of the stage's void samples, when its valid samples are all known.
    fn fill(&mut self, stage: Stage);
}

/// Which samples a tile has, and which of them are valid.
#[derive(Clone, Copy)]
pub struct Places<'a> {
    /// Intervals on a side.
    pub n: usize,
    /// True if the tile has no parent.
    pub root: bool,
    /// State of all samples.
    pub state: &'a [u8],
    /// False if all samples are valid, as in most tiles; they take a faster way.
    pub has_void: bool,
    /// First row that is wanted, and the row after the last. Those of a tile without voids below
    /// the root may be a part; the samples of other rows are then not defined, before and after.
    pub rows: (usize, usize),
}

impl<'a> Places<'a> {
    /// The places of a tile with these states, all of which are wanted.
    pub fn new(n: usize, root: bool, state: &'a [u8]) -> Self {
        Self { n, root, state, has_void: !state::all_valid(state), rows: (0, n + 1) }
    }

    /// The rows that are wanted.
    fn rows(self) -> Range<usize> {
        self.rows.0..self.rows.1
    }
}

/// Scratch memory of [`Walk::run`].
#[derive(Default)]
pub struct Walk {
    scratch: Scratch,
    narrow: Numbers<i32>,
    wide: Numbers<i64>,
}

/// The part of the scratch memory that depends on the width of the arithmetic.
#[derive(Default)]
pub struct Numbers<W> {
    planes: Planes<W>,
    probe: Probe<W>,
}

/// The part of the scratch memory that does not depend on the width of the arithmetic: rows of
/// codes and states.
#[derive(Default)]
struct Scratch {
    row: Vec<i32>,
    parents: Vec<i32>,
    states: Vec<u8>,
}

impl Walk {
    /// Sends all newborn samples through `coder`, in order.
    pub fn run(&mut self, narrow: bool, places: Places<'_>, coder: &mut impl Coder) {
        if narrow {
            self.scratch.walk(&mut self.narrow, places, coder);
        } else {
            self.scratch.walk(&mut self.wide, places, coder);
        }
    }
}

impl Scratch {
    /// Sends all newborn samples through `coder`, predicted in `W`.
    fn walk<W: Word>(&mut self, numbers: &mut Numbers<W>, places: Places<'_>, coder: &mut impl Coder) {
        let Places { n, root, .. } = places;
        self.row.clear();
        self.row.resize(n / 2 + 1, 0);
        let base_of_root = root.then(|| code_corners(n, coder));
        for stage in order::stages(n, root) {
            let needed =
                if root { stage.needed(&(0..2 * stage.m + 1)) } else { stage.needed(&places.rows()) };
            self.gather_parents(stage, &needed.parents, places, coder.codes());
            // Any parent is a base: numbers do not wrap, so predictions do not depend on it.
            let base = base_of_root.unwrap_or(self.parents[0]);
            numbers.planes.start(stage.m, (needed.parents.start, &self.parents), base);
            refine(&mut self.row, numbers, (stage, needed), coder);
            if places.has_void {
                coder.fill(stage);
            }
        }
    }

    /// Sets the parents of a stage; void ones are interpolated.
    fn gather_parents(&mut self, stage: Stage, rows: &Range<usize>, places: Places<'_>, codes: &[i32]) {
        self.parents.clear();
        for b in rows.clone() {
            stage.parents(b).gather(codes, &mut self.parents);
        }
        if places.has_void {
            self.states.clear();
            for b in 0..=stage.m {
                stage.parents(b).gather_states(places.state, &mut self.states);
            }
            if !interpolate::across_voids(&mut self.parents, &self.states, stage.m + 1) {
                self.parents.fill(0);
            }
        }
    }
}

/// Sends the needed rows of C, H and V of a stage through `coder`.
fn refine<W: Word>(
    row: &mut [i32],
    numbers: &mut Numbers<W>,
    (stage, needed): (Stage, Needed),
    coder: &mut impl Coder,
) {
    let m = stage.m;
    let sharpness = coder.sharpness(stage, numbers);
    for b in 0..m {
        if !needed.centres.contains(&b) {
            coder.skip_row(stage.centres(b));
            continue;
        }
        numbers.planes.predict_centres(b, sharpness, &mut row[..m]);
        coder.code_row(stage.centres(b), &mut row[..m]);
        numbers.planes.set_centres(b, &row[..m]);
    }
    numbers.planes.finish_centres();
    let weights = coder.weights(stage, numbers);
    let planes = &numbers.planes;
    for b in 0..=m {
        if !needed.horizontals.contains(&b) {
            coder.skip_row(stage.horizontals(b));
            continue;
        }
        planes.predict_horizontals(b, weights, &mut row[..m]);
        coder.code_row(stage.horizontals(b), &mut row[..m]);
    }
    for b in 0..m {
        if !needed.verticals.contains(&b) {
            coder.skip_row(stage.verticals(b));
            continue;
        }
        planes.predict_verticals(b, weights, &mut row[..=m]);
        coder.code_row(stage.verticals(b), &mut row[..=m]);
    }
}

/// Sends the corners of the root through `coder`, each predicted by the one before. Returns the
/// code of the first.
fn code_corners(n: usize, coder: &mut impl Coder) -> i32 {
    let mut code = 0;
    let mut first = None;
    for at in order::corners(n, true).flat_map(Row::indices) {
        code = coder.code_corner(at, code);
        first.get_or_insert(code);
    }
    first.unwrap_or(0)
}

/// Kernel: residuals (zigzag) of codes from their predictions.
struct Subtract<'a> {
    codes: &'a [i32],
    actual: &'a [i32],
    residuals: &'a mut [u32],
}

impl Kernel for Subtract<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { codes, actual, residuals } = self;
        let (codes, actual) = (&codes[..residuals.len()], &actual[..residuals.len()]);
        for i in 0..residuals.len() {
            residuals[i] = bits::zigzag(actual[i].wrapping_sub(codes[i]));
        }
    }
}

/// Kernel: adds residuals (zigzag) to predictions.
struct Add<'a> {
    codes: &'a mut [i32],
    residuals: &'a [u32],
}

impl Kernel for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { codes, residuals } = self;
        let residuals = &residuals[..codes.len()];
        for i in 0..codes.len() {
            codes[i] = codes[i].wrapping_add(bits::unzigzag(residuals[i]));
        }
    }
}

/// [`Subtract`] where some samples are void: those have residual 0 and keep their predictions.
struct SubtractValid<'a> {
    codes: &'a mut [i32],
    actual: &'a [i32],
    states: &'a [u8],
    residuals: &'a mut [u32],
}

impl Kernel for SubtractValid<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { codes, actual, states, residuals } = self;
        let (codes, actual) = (&mut codes[..residuals.len()], &actual[..residuals.len()]);
        let states = &states[..residuals.len()];
        for i in 0..residuals.len() {
            let residual = actual[i].wrapping_sub(codes[i]);
            // A fill has a residual until its median is known; a void sample without a fill never
            // has.
            residuals[i] = bits::zigzag(residual & -i32::from(states[i] != VOID));
            codes[i] = codes[i].wrapping_add(residual & -i32::from(states[i] == VALID));
        }
    }
}

/// [`Add`] where some samples are void: those keep their predictions.
struct AddValid<'a> {
    codes: &'a mut [i32],
    residuals: &'a [u32],
    states: &'a [u8],
}

impl Kernel for AddValid<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { codes, residuals, states } = self;
        let (residuals, states) = (&residuals[..codes.len()], &states[..codes.len()]);
        for i in 0..codes.len() {
            let valid = -i32::from(states[i] == VALID);
            codes[i] = codes[i].wrapping_add(bits::unzigzag(residuals[i]) & valid);
        }
    }
}

/// The coder that computes residuals.
pub struct Encoder<'a> {
    pub codes: &'a [i32],
    pub places: Places<'a>,
    pub fills: Fills,
    /// Residuals (zigzag), appended to.
    pub residuals: &'a mut Vec<u32>,
    /// True codes of one row.
    pub actual: &'a mut Vec<i32>,
    /// States of one row.
    pub states: &'a mut Vec<u8>,
    /// For each sample of one row: 1 if a sample beside it is valid.
    pub near: &'a mut Vec<u8>,
    /// Weights of the last stage.
    pub weights: Weights,
    /// True if the weights of each stage are to be chosen; else they stay.
    pub choose: bool,
}

impl Encoder<'_> {
    /// The true heights of the samples of a stage.
    fn target(&self, stage: Stage) -> Target<'_> {
        Target { codes: self.codes, state: self.places.state, stage }
    }
}

impl Coder for Encoder<'_> {
    fn codes(&self) -> &[i32] {
        self.codes
    }

    fn code_corner(&mut self, at: usize, prediction: i32) -> i32 {
        let void = self.places.state[at] == VOID;
        let residual = if void { 0 } else { self.codes[at].wrapping_sub(prediction) };
        self.residuals.push(bits::zigzag(residual));
        prediction.wrapping_add(residual)
    }

    fn code_row(&mut self, row: Row, codes: &mut [i32]) {
        self.actual.clear();
        row.gather(self.codes, self.actual);
        let start = self.residuals.len();
        self.residuals.resize(start + codes.len(), 0);
        let residuals = &mut self.residuals[start..];
        if self.places.has_void {
            self.states.clear();
            row.gather_states(self.places.state, self.states);
            simd::run(SubtractValid { codes, actual: self.actual, states: self.states, residuals });
        } else {
            simd::run(Subtract { codes, actual: self.actual, residuals });
            codes.copy_from_slice(self.actual);
        }
    }

    fn skip_row(&mut self, row: Row) {
        debug_assert!(false, "every row is encoded");
        self.residuals.resize(self.residuals.len() + row.count, 0);
    }

    fn sharpness<W: Word>(&mut self, stage: Stage, numbers: &mut Numbers<W>) -> i32 {
        if self.choose {
            let Numbers { planes, probe } = numbers;
            self.weights.sharpness = probe.choose_sharpness(planes, self.target(stage));
        }
        self.weights.sharpness
    }

    fn weights<W: Word>(&mut self, stage: Stage, numbers: &mut Numbers<W>) -> Weights {
        if self.choose {
            let Numbers { planes, probe } = numbers;
            self.weights.skew = probe.choose_skew(planes, self.target(stage), self.weights.sharpness);
        }
        self.weights
    }

    fn fill(&mut self, stage: Stage) {
        let start = self.residuals.len() - stage.newborn_count();
        let samples = (self.codes, self.places.state);
        void::code_fills(samples, stage, self.fills, &mut self.residuals[start..], self.near);
    }
}

/// The coder that adds residuals to predictions.
pub struct Decoder<'a> {
    pub codes: &'a mut [i32],
    pub places: Places<'a>,
    /// Residuals (zigzag) of all newborn samples.
    pub residuals: &'a [u32],
    /// How many residuals have been used.
    pub used: usize,
    /// States of one row.
    pub states: &'a mut Vec<u8>,
    /// The weights of the chunk.
    pub weights: Weights,
}

impl Coder for Decoder<'_> {
    fn codes(&self) -> &[i32] {
        self.codes
    }

    fn code_corner(&mut self, at: usize, prediction: i32) -> i32 {
        self.codes[at] = prediction.wrapping_add(bits::unzigzag(self.residuals[self.used]));
        self.used += 1;
        self.codes[at]
    }

    fn code_row(&mut self, row: Row, codes: &mut [i32]) {
        let residuals = &self.residuals[self.used..self.used + row.count];
        self.used += row.count;
        if self.places.has_void {
            self.states.clear();
            row.gather_states(self.places.state, self.states);
            simd::run(AddValid { codes, residuals, states: self.states });
        } else {
            simd::run(Add { codes, residuals });
        }
        row.scatter(codes, self.codes);
    }

    fn skip_row(&mut self, row: Row) {
        self.used += row.count;
    }

    fn sharpness<W: Word>(&mut self, _: Stage, _: &mut Numbers<W>) -> i32 {
        self.weights.sharpness
    }

    fn weights<W: Word>(&mut self, _: Stage, _: &mut Numbers<W>) -> Weights {
        self.weights
    }

    fn fill(&mut self, stage: Stage) {
        let residuals = &self.residuals[self.used - stage.newborn_count()..self.used];
        void::restore_fills(self.codes, self.places.state, stage, residuals);
    }
}
