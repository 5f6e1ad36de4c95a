//! The void mask of a tile (`format-spec.md`, section 8): one bit for each newborn sample, set
//! where its validity is not that of the majority of its neighbours.

use std::ops::Range;

use crate::codec::order::{self, Row, Stage};
use crate::codec::{Scratch, bits, frame};
use crate::error::{Error, Result};
use crate::sample::state;
use crate::sample::{Lattice, VALID, VOID};
use crate::simd::{self, Kernel};

/// Which kinds of samples a tile's own lattice has: bits 0 and 1 of the flags of its index entry.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Occupancy {
    /// At least one sample is valid.
    pub has_valid: bool,
    /// At least one sample is void.
    pub has_void: bool,
}

/// Validity (0 or 1) of the samples that a stage predicts from.
#[derive(Default)]
pub(super) struct Validity {
    /// `P`, `(m + 1)^2`.
    parents: Vec<u8>,
    /// `C`, with a frame of zeros around it, `(m + 2)^2`.
    centres: Vec<u8>,
    /// Validity of one row.
    row: Vec<u8>,
    /// States of one row.
    states: Vec<u8>,
}

/// The part in which encoder and decoder differ.
trait Coder {
    /// States of the whole lattice; those of newborn samples that are still to come are not
    /// defined.
    fn state(&self) -> &[u8];
    /// Replaces the predictions of the next row by the validity.
    fn code_row(&mut self, row: Row, valid: &mut [u8], states: &mut Vec<u8>);
}

impl Validity {
    /// Sends all newborn samples through `coder`, in order.
    fn run(&mut self, n: usize, root: bool, coder: &mut impl Coder) {
        self.row.clear();
        self.row.resize((n / 2 + 1).max(2), 0);
        for corners in order::corners(n, root) {
            self.row[..2].fill(1);
            coder.code_row(corners, &mut self.row[..2], &mut self.states);
        }
        order::stages(n, root).for_each(|stage| self.refine(stage, coder));
    }

    /// Sends the newborn samples of one stage through `coder`.
    fn refine(&mut self, stage: Stage, coder: &mut impl Coder) {
        let m = stage.m;
        let Self { parents, centres, row, states } = self;
        parents.clear();
        for b in 0..=m {
            stage.parents(b).gather_states(coder.state(), parents);
        }
        for state in &mut *parents {
            *state = u8::from(*state == VALID);
        }
        centres.clear();
        centres.resize((m + 2) * (m + 2), 0);
        let row_of_parents = |b: usize| &parents[b * (m + 1)..][..=m];
        for b in 0..m {
            let (upper, lower) = (row_of_parents(b), row_of_parents(b + 1));
            majority(&mut row[..m], [&upper[..m], &upper[1..], &lower[..m], &lower[1..]]);
            coder.code_row(stage.centres(b), &mut row[..m], states);
            centres[(b + 1) * (m + 2) + 1..][..m].copy_from_slice(&row[..m]);
        }
        let row_of_centres = |b: usize| &centres[b * (m + 2)..][..m + 2];
        for b in 0..=m {
            let parents = row_of_parents(b);
            let (north, south) = (&row_of_centres(b)[1..=m], &row_of_centres(b + 1)[1..=m]);
            majority(&mut row[..m], [&parents[..m], &parents[1..], north, south]);
            coder.code_row(stage.horizontals(b), &mut row[..m], states);
        }
        for b in 0..m {
            let between = row_of_centres(b + 1);
            let sides = [row_of_parents(b), row_of_parents(b + 1), &between[..=m], &between[1..]];
            majority(&mut row[..=m], sides);
            coder.code_row(stage.verticals(b), &mut row[..=m], states);
        }
    }
}

/// Sets `out` to 1 where at least two of four neighbours are 1. At a border there are three, and
/// half of them is also two.
fn majority(out: &mut [u8], of: [&[u8]; 4]) {
    simd::run(Majority { of, out });
}

/// [`majority`] as a kernel.
struct Majority<'a> {
    of: [&'a [u8]; 4],
    out: &'a mut [u8],
}

impl Kernel for Majority<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let ([a, b, c, d], out) = (self.of, self.out);
        let count = out.len();
        let (a, b, c, d) = (&a[..count], &b[..count], &c[..count], &d[..count]);
        for i in 0..count {
            out[i] = u8::from(a[i] + b[i] + c[i] + d[i] >= 2);
        }
    }
}

/// Kernel: replaces predictions by validity, and sets the bits where they were wrong.
struct Correct<'a> {
    valid: &'a mut [u8],
    states: &'a [u8],
    bits: &'a mut [u8],
}

impl Kernel for Correct<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { valid, states, bits } = self;
        let (states, bits) = (&states[..valid.len()], &mut bits[..valid.len()]);
        for i in 0..valid.len() {
            let actual = u8::from(states[i] == VALID);
            bits[i] = valid[i] ^ actual;
            valid[i] = actual;
        }
    }
}

/// The coder that collects where predictions are wrong.
struct Encoder<'a> {
    state: &'a [u8],
    bits: &'a mut Vec<u8>,
}

impl Coder for Encoder<'_> {
    fn state(&self) -> &[u8] {
        self.state
    }

    fn code_row(&mut self, row: Row, valid: &mut [u8], states: &mut Vec<u8>) {
        states.clear();
        row.gather_states(self.state, states);
        let start = self.bits.len();
        self.bits.resize(start + valid.len(), 0);
        simd::run(Correct { valid, states, bits: &mut self.bits[start..] });
    }
}

/// The coder that corrects predictions.
struct Decoder<'a> {
    state: &'a mut [u8],
    bits: &'a [u8],
}

impl Coder for Decoder<'_> {
    fn state(&self) -> &[u8] {
        self.state
    }

    fn code_row(&mut self, row: Row, valid: &mut [u8], states: &mut Vec<u8>) {
        let (bits, rest) = self.bits.split_at(valid.len().min(self.bits.len()));
        self.bits = rest;
        states.clear();
        states.extend(valid.iter_mut().zip(bits).map(|(valid, bit)| {
            *valid ^= bit;
            if *valid == 1 { VALID } else { VOID }
        }));
        row.scatter(states, self.state);
    }
}

/// Appends the mask chunk of a tile; appends nothing unless it has both valid and void samples.
#[cfg(feature = "write")]
pub fn encode(lattice: &Lattice, root: bool, scratch: &mut Scratch, out: &mut Vec<u8>) -> Result<Occupancy> {
    check_shape(lattice)?;
    let has_valid = lattice.state.contains(&VALID);
    let has_void = !state::all_valid(&lattice.state);
    if has_valid && has_void {
        scratch.bytes.clear();
        let mut coder = Encoder { state: &lattice.state, bits: &mut scratch.bytes };
        scratch.validity.run(lattice.n, root, &mut coder);
        scratch.raw.clear();
        bits::pack(&scratch.bytes, &mut scratch.raw);
        frame::compress(&scratch.raw, out)?;
    }
    Ok(Occupancy { has_valid, has_void })
}

/// Sets the state of all newborn samples (of all samples, if the tile has one kind only) to
/// [`VALID`] or [`VOID`].
///
/// Unless `root`, the samples with even column and row have the states of the parent already.
pub fn decode(
    chunk: &[u8],
    occupancy: Occupancy,
    lattice: &mut Lattice,
    root: bool,
    scratch: &mut Scratch,
) -> Result<()> {
    let known = if root { 0..0 } else { 0..lattice.n / 2 + 1 };
    decode_wanted(chunk, occupancy, lattice, (root, known), scratch)
}

/// [`decode`] of a tile without voids below the root, only some rows of whose parents are known:
/// `known`, numbers of even rows, halved.
pub fn decode_rows(
    chunk: &[u8],
    lattice: &mut Lattice,
    known: Range<usize>,
    scratch: &mut Scratch,
) -> Result<()> {
    let occupancy = Occupancy { has_valid: true, has_void: false };
    decode_wanted(chunk, occupancy, lattice, (false, known), scratch)
}

/// [`decode`], with the numbers of the even rows, halved, whose samples are the parent's.
fn decode_wanted(
    chunk: &[u8],
    occupancy: Occupancy,
    lattice: &mut Lattice,
    (root, known): (bool, Range<usize>),
    scratch: &mut Scratch,
) -> Result<()> {
    check_shape(lattice)?;
    let uniform = match occupancy {
        Occupancy { has_valid: true, has_void: true } => {
            let count = order::newborn_count(lattice.n, root);
            let packed = count.div_ceil(8);
            frame::decompress(chunk, packed..=packed, "mask chunk", &mut scratch.raw)?;
            bits::unpack(&scratch.raw, count, &mut scratch.bytes)?;
            let mut coder = Decoder { state: &mut lattice.state, bits: &scratch.bytes };
            scratch.validity.run(lattice.n, root, &mut coder);
            if lattice.state.contains(&VALID) && lattice.state.contains(&VOID) {
                return Ok(());
            }
            return Err(Error::format("mask chunk", "valid and void samples, as the flags say", "one kind"));
        }
        Occupancy { has_valid: true, .. } => VALID,
        Occupancy { has_void: true, .. } => VOID,
        Occupancy { .. } => {
            return Err(Error::format("tile flags", "valid samples, void samples or both", "neither"));
        }
    };
    if !chunk.is_empty() {
        return Err(Error::format("mask chunk", "none for a tile without void samples", chunk.len()));
    }
    if !even_states(lattice, known).all(|state| (state == VALID) == (uniform == VALID)) {
        return Err(Error::format("tile flags", "one kind of samples, as the parent has", "the other kind"));
    }
    lattice.state.fill(uniform);
    Ok(())
}

/// States of the samples with even column in some even rows, given by half their numbers.
fn even_states(lattice: &Lattice, halves: Range<usize>) -> impl Iterator<Item = u8> {
    let even_rows = lattice.state.chunks_exact(lattice.n + 1).step_by(2);
    even_rows.skip(halves.start).take(halves.len()).flat_map(|row| row.iter().copied().step_by(2))
}

/// Fails unless the plane has the size that `n` calls for: another one is the caller's mistake.
fn check_shape(lattice: &Lattice) -> Result<()> {
    let count = (lattice.n + 1) * (lattice.n + 1);
    if lattice.state.len() == count && lattice.n >= 2 && lattice.n.is_power_of_two() {
        return Ok(());
    }
    Err(Error::usage(format!("a lattice of {} intervals does not have the states of a tile", lattice.n)))
}
