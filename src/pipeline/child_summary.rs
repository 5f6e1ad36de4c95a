//! [`ChildSummary`]: what a finished tile leaves for its parent. That is half its samples, its
//! blocks, its errors, and the range of heights of it and of all tiles below.
//!
//! As bytes, for a build that goes on elsewhere or later, it is one zstd frame. Nothing is rounded:
//! decoding returns what was encoded.

use wincode::{SchemaRead, SchemaWrite};

use crate::error::{Error, Result};
use crate::patch::Errors;
use crate::patch::blocks::Blocks;
use crate::pipeline::buffers::Buffers;
use crate::pipeline::encoding::{from_planes, pack, planes, unpack};
use crate::pipeline::plan::Plan;
use crate::pipeline::value_range::ValueRange;
use crate::sample::{Lattice, VALID};

/// What a finished tile leaves for its parent, of which it becomes one quadrant.
#[derive(Clone, Debug, PartialEq)]
pub struct ChildSummary {
    /// Every second sample of the tile, `(n / 2 + 1)^2`.
    pub lattice: Lattice,
    /// Its blocks, `(n / 2)^2`.
    pub blocks: Blocks,
    /// Its errors.
    pub errors: Errors,
    /// Heights of it and of all below.
    pub range: ValueRange,
}

impl ChildSummary {
    /// Takes the summary of the child in a quadrant out of a parent again.
    pub fn cut(lattice: &Lattice, blocks: &Blocks, quadrant: u8, errors: Errors, range: ValueRange) -> Self {
        let half = lattice.n / 2;
        let (x, y) = (usize::from(quadrant & 1) * half, usize::from(quadrant >> 1) * half);
        let samples = Square { stride: lattice.n + 1, x, y, side: half + 1 };
        let cells = Square { stride: blocks.n, x, y, side: half };
        let low = if lattice.low.is_empty() { Vec::new() } else { samples.of(&lattice.low) };
        Self {
            lattice: Lattice {
                n: half,
                code: samples.of(&lattice.code),
                low,
                state: samples.of(&lattice.state),
            },
            blocks: Blocks {
                n: half,
                min: cells.of(&blocks.min),
                max: cells.of(&blocks.max),
                state: cells.of(&blocks.state),
            },
            errors,
            range,
        }
    }

    /// The errors alone, when samples and blocks have been copied into the parent.
    pub fn into_errors(self, buffers: &Buffers) -> Errors {
        buffers.lattices.give(self.lattice.n, self.lattice);
        buffers.blocks.give(self.blocks.n, self.blocks);
        self.errors
    }

    /// The summary as bytes.
    pub fn encode(&self) -> Result<Vec<u8>> {
        let low: Vec<i32> = self.lattice.low.iter().map(|low| low.cast_signed()).collect();
        let errors = self.errors.clone();
        pack(&Stored {
            code: planes(&self.lattice.code),
            low: planes(&low),
            state: self.lattice.state.clone(),
            min: planes(&self.blocks.min),
            max: planes(&self.blocks.max),
            block_state: self.blocks.state.clone(),
            errors: [errors.vertical, errors.horizontal, errors.ahead_vertical, errors.ahead_horizontal],
            range: (self.range.low, self.range.high),
        })
    }

    /// The inverse of [`ChildSummary::encode`], for the tiles of a plan.
    pub fn decode(packed: &[u8], plan: &Plan) -> Result<Self> {
        let (n, coding) = (plan.pyramid.tile, plan.recipe.coding);
        let half = n / 2;
        let stored: Stored = unpack(packed, n)?;
        let (samples, blocks) = ((half + 1) * (half + 1), half * half);
        let low = from_planes(&stored.low, if coding.has_low() { samples } else { 0 })?;
        let lattice = Lattice {
            n: half,
            code: from_planes(&stored.code, samples)?,
            low: low.into_iter().map(i32::cast_unsigned).collect(),
            state: states(stored.state, samples)?,
        };
        let blocks = Blocks {
            n: half,
            min: from_planes(&stored.min, blocks)?,
            max: from_planes(&stored.max, blocks)?,
            state: states(stored.block_state, blocks)?,
        };
        let [vertical, horizontal, ahead_vertical, ahead_horizontal] = stored.errors;
        let errors = Errors { vertical, horizontal, ahead_vertical, ahead_horizontal };
        let patches = n / plan.patch;
        if !errors.is_of(patches, plan.patch.trailing_zeros() as usize + 1) {
            let expected = format!("errors of {patches} x {patches} patches");
            return Err(Error::format("what a tile left for its parent", expected, "others"));
        }
        let (low, high) = stored.range;
        Ok(Self { lattice, blocks, errors, range: ValueRange { low, high } })
    }
}

/// A summary as it is stored: numbers as [`planes`].
#[derive(SchemaRead, SchemaWrite)]
struct Stored {
    code: Vec<u8>,
    low: Vec<u8>,
    state: Vec<u8>,
    min: Vec<u8>,
    max: Vec<u8>,
    block_state: Vec<u8>,
    errors: [Vec<Vec<f64>>; 4],
    range: (f64, f64),
}

/// A border sample as it is stored.
#[derive(SchemaRead, SchemaWrite)]
struct BorderSample {
    code: i32,
    low: u32,
    state: u8,
}

/// States of `count` samples or blocks.
fn states(states: Vec<u8>, count: usize) -> Result<Vec<u8>> {
    if states.len() == count {
        return Ok(states);
    }
    Err(Error::format("what a tile left for its parent", format!("{count} states"), states.len()))
}

/// A square of a plane of samples or blocks.
#[derive(Clone, Copy)]
struct Square {
    stride: usize,
    x: usize,
    y: usize,
    side: usize,
}

impl Square {
    /// Row by row.
    fn of<T: Copy>(self, plane: &[T]) -> Vec<T> {
        let row = |y: usize| {
            let from = (self.y + y) * self.stride + self.x;
            &plane[from..from + self.side]
        };
        (0..self.side).flat_map(|y| row(y).iter().copied()).collect()
    }
}

/// The border samples of a tile as bytes. Above the leaves, neighbours look at nothing else.
pub fn encode_border(lattice: &Lattice) -> Result<Vec<u8>> {
    let sample = |i| BorderSample { code: lattice.code[i], low: lattice.low_at(i), state: lattice.state[i] };
    pack(&border(lattice.n).map(sample).collect::<Vec<_>>())
}

/// The inverse of [`encode_border`]: a lattice that is void within.
pub fn decode_border(packed: &[u8], plan: &Plan) -> Result<Lattice> {
    let (n, coding) = (plan.pyramid.tile, plan.recipe.coding);
    let samples: Vec<BorderSample> = unpack(packed, n)?;
    if samples.len() != border(n).count() {
        return Err(Error::format("border of a tile", format!("{} samples", 4 * n), samples.len()));
    }
    let mut lattice = Lattice::new(n, coding);
    for (index, sample) in border(n).zip(samples) {
        lattice.code[index] = sample.code;
        if let Some(low) = lattice.low.get_mut(index) {
            *low = sample.low;
        }
        lattice.state[index] = sample.state.min(VALID);
    }
    Ok(lattice)
}

/// Indices of the border samples.
fn border(n: usize) -> impl Iterator<Item = usize> {
    let last = n * (n + 1);
    let sides = (1..n).flat_map(move |y| [y * (n + 1), y * (n + 1) + n]);
    (0..=n).chain(sides).chain(last..=last + n)
}
