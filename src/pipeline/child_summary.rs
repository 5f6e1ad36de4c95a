//! [`ChildSummary`]: what a finished tile leaves for its parent. That is half its samples, its
//! blocks, its errors, and the range of heights of it and of all tiles below.
//!
//! As bytes, for a build that goes on elsewhere or later, it is one zstd frame. Nothing is rounded:
//! decoding returns what was encoded.

use crate::error::{Error, Result};
use crate::patch::Errors;
use crate::patch::blocks::Blocks;
use crate::pipeline::buffers::Buffers;
use crate::pipeline::bytes::{Reader, Writer, unpacked};
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
        let mut out = Writer::default();
        out.integers(&self.lattice.code);
        out.integers(&self.lattice.low.iter().map(|low| low.cast_signed()).collect::<Vec<_>>());
        out.bytes(&self.lattice.state);
        out.integers(&self.blocks.min);
        out.integers(&self.blocks.max);
        out.bytes(&self.blocks.state);
        let errors = &self.errors;
        for steps in [&errors.vertical, &errors.horizontal, &errors.ahead_vertical, &errors.ahead_horizontal]
        {
            out.number(steps.len());
            for step in steps {
                out.number(step.len());
                for error in step {
                    out.bytes(&error.to_le_bytes());
                }
            }
        }
        out.bytes(&self.range.low.to_le_bytes());
        out.bytes(&self.range.high.to_le_bytes());
        out.packed()
    }

    /// The inverse of [`ChildSummary::encode`], for the tiles of a plan.
    pub fn decode(packed: &[u8], plan: &Plan) -> Result<Self> {
        let (n, coding) = (plan.pyramid.tile, plan.recipe.coding);
        let half = n / 2;
        let bytes = unpacked(packed, n)?;
        let mut from = Reader::new(&bytes);
        let count = (half + 1) * (half + 1);
        let code = from.integers(count)?;
        let low = if coding.has_low() { from.integers(count)? } else { Vec::new() };
        let low = low.into_iter().map(i32::cast_unsigned).collect();
        let lattice = Lattice { n: half, code, low, state: from.take(count)?.to_vec() };
        let blocks = Blocks {
            n: half,
            min: from.integers(half * half)?,
            max: from.integers(half * half)?,
            state: from.take(half * half)?.to_vec(),
        };
        let mut steps = || -> Result<Vec<Vec<f64>>> {
            let count = from.number(n)?;
            (0..count)
                .map(|_| {
                    let count = from.number(n * n)?;
                    (0..count).map(|_| from.float()).collect()
                })
                .collect()
        };
        let errors = Errors {
            vertical: steps()?,
            horizontal: steps()?,
            ahead_vertical: steps()?,
            ahead_horizontal: steps()?,
        };
        let range = ValueRange { low: from.float()?, high: from.float()? };
        from.end()?;
        let patches = n / plan.patch;
        if !errors.is_of(patches, plan.patch.trailing_zeros() as usize + 1) {
            let expected = format!("errors of {patches} x {patches} patches");
            return Err(Error::format("what a tile left for its parent", expected, "others"));
        }
        Ok(Self { lattice, blocks, errors, range })
    }
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
    let mut out = Writer::default();
    for index in border(lattice.n) {
        out.bytes(&lattice.code[index].to_le_bytes());
        out.bytes(&lattice.low_at(index).to_le_bytes());
        out.bytes(&[lattice.state[index]]);
    }
    out.packed()
}

/// The inverse of [`encode_border`]: a lattice that is void within.
pub fn decode_border(packed: &[u8], plan: &Plan) -> Result<Lattice> {
    let (n, coding) = (plan.pyramid.tile, plan.recipe.coding);
    let bytes = unpacked(packed, n)?;
    let mut from = Reader::new(&bytes);
    let mut lattice = Lattice::new(n, coding);
    for index in border(n) {
        lattice.code[index] = from.word()? as i32;
        let low = from.word()?;
        if let Some(to) = lattice.low.get_mut(index) {
            *to = low;
        }
        lattice.state[index] = from.take(1)?[0].min(VALID);
    }
    from.end()?;
    Ok(lattice)
}

/// Indices of the border samples.
fn border(n: usize) -> impl Iterator<Item = usize> {
    let last = n * (n + 1);
    let sides = (1..n).flat_map(move |y| [y * (n + 1), y * (n + 1) + n]);
    (0..=n).chain(sides).chain(last..=last + n)
}
