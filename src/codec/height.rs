//! The heights chunk of a tile (`format-spec.md`, section 9).
//!
//! Encoder and decoder walk through the same stages and predict from the same samples; only what they do with a row of
//! predictions differs. A sample that is void and has no fill gets its prediction, so its residual of 0 costs next to
//! nothing.

use crate::codec::order::{self, Row, Stage};
use crate::codec::predict::{Planes, Weights, Word, replace_void};
use crate::codec::probe::Target;
use crate::codec::{Scratch, bits, decimal, frame};
use crate::error::{Error, Result};
use crate::sample::{Coding, FILLED, Lattice, VALID, VOID};

/// Bytes before the byte plane.
const HEAD: usize = 12;
/// Flag bit 0: 32-bit arithmetic suffices.
const NARROW: u8 = 1;
/// A tile is narrow if its heights lie closer together than this.
const NARROW_RANGE: i64 = 1 << 22;
/// The same with void samples: where they stand, centres may be up to 2.75 times as far from the base.
const NARROW_RANGE_VOID: i64 = 1 << 20;

/// What encoder and decoder do with the rows of newborn samples.
trait Coder {
    /// Codes of the whole lattice, right for the samples that are known.
    fn codes(&self) -> &[i32];
    /// The code of the next corner of the root, of which the prediction is known.
    fn code_corner(&mut self, at: usize, prediction: i32) -> i32;
    /// Takes the predictions of the next row and puts the codes in their place; void samples keep their predictions.
    fn code_row(&mut self, row: Row, codes: &mut [i32]);
    /// The sharpness of a stage whose parents are set.
    fn sharpness<W: Word>(&mut self, stage: Stage, planes: &mut Planes<W>) -> i32;
    /// The weights of a stage whose centres are set.
    fn weights<W: Word>(&mut self, stage: Stage, planes: &mut Planes<W>) -> Weights;
    /// Codes the fills of the stage's void samples, when its valid samples are all known.
    fn fill(&mut self, stage: Stage);
}

/// Buffers of [`walk`].
#[derive(Default)]
pub(super) struct Walk {
    row: Vec<i32>,
    parents: Vec<i32>,
    valid: Vec<bool>,
    narrow: Planes<i32>,
    wide: Planes<i64>,
}

impl Walk {
    /// Sends all newborn samples through `coder`, in order.
    fn run(&mut self, narrow: bool, state: &[u8], n: usize, root: bool, coder: &mut impl Coder) {
        let Self { row, parents, valid, .. } = self;
        row.clear();
        row.resize(n / 2 + 1, 0);
        let buffers = Buffers { row, parents, valid };
        if narrow {
            walk(buffers, &mut self.narrow, state, n, root, coder);
        } else {
            walk(buffers, &mut self.wide, state, n, root, coder);
        }
    }
}

/// Those of the buffers that do not depend on the width of the arithmetic.
struct Buffers<'a> {
    row: &'a mut Vec<i32>,
    parents: &'a mut Vec<i32>,
    valid: &'a mut Vec<bool>,
}

/// Sends all newborn samples through `coder`, predicted in `W`.
fn walk<W: Word>(
    buffers: Buffers<'_>,
    planes: &mut Planes<W>,
    state: &[u8],
    n: usize,
    root: bool,
    coder: &mut impl Coder,
) {
    let Buffers { row, parents, valid } = buffers;
    let base_of_root = root.then(|| code_corners(n, coder));
    for stage in order::stages(n, root) {
        let m = stage.m;
        parents.clear();
        valid.clear();
        for b in 0..=m {
            parents.extend(stage.parents(b).of(coder.codes()));
            valid.extend(stage.parents(b).of(state).map(|&state| state == VALID));
        }
        if valid.contains(&false) {
            replace_void(parents, valid, m);
        }
        planes.start(m, parents, base_of_root.unwrap_or(parents[0]));
        let sharpness = coder.sharpness(stage, planes);
        for b in 0..m {
            planes.predict_centres(b, sharpness, &mut row[..m]);
            coder.code_row(stage.centres(b), &mut row[..m]);
            planes.set_centres(b, &row[..m]);
        }
        planes.finish_centres();
        let weights = coder.weights(stage, planes);
        for b in 0..=m {
            planes.predict_horizontals(b, weights, &mut row[..m]);
            coder.code_row(stage.horizontals(b), &mut row[..m]);
        }
        for b in 0..m {
            planes.predict_verticals(b, weights, &mut row[..=m]);
            coder.code_row(stage.verticals(b), &mut row[..=m]);
        }
        coder.fill(stage);
    }
}

/// Sends the corners of the root through `coder`, each predicted by the one before; gives the first.
fn code_corners(n: usize, coder: &mut impl Coder) -> i32 {
    let mut code = 0;
    let mut first = None;
    for at in order::corners(n, true).flat_map(Row::indices) {
        code = coder.code_corner(at, code);
        first.get_or_insert(code);
    }
    first.unwrap_or(0)
}

/// The lower median of the codes of the valid samples next to a void one; `None` if there is none.
fn lower_median(codes: &[i32], state: &[u8], stage: Stage, at: usize) -> Option<i32> {
    let mut near = [0; 8];
    let mut count = 0;
    for index in stage.around(at) {
        if state[index] == VALID && count < near.len() {
            near[count] = codes[index];
            count += 1;
        }
    }
    near[..count].sort_unstable();
    (count > 0).then(|| near[(count - 1) / 2])
}

/// Takes residuals of what is there.
struct Encoder<'a> {
    codes: &'a [i32],
    state: &'a [u8],
    residuals: &'a mut Vec<u32>,
    /// Those of the last stage.
    weights: Weights,
    /// Weights are still to be chosen; otherwise they stay.
    choose: bool,
}

impl Encoder<'_> {
    /// What the samples of a stage should be.
    fn target(&self, stage: Stage) -> Target<'_> {
        Target { codes: self.codes, state: self.state, stage }
    }
}

impl Coder for Encoder<'_> {
    fn codes(&self) -> &[i32] {
        self.codes
    }

    fn code_corner(&mut self, at: usize, prediction: i32) -> i32 {
        let residual = if self.state[at] == VOID { 0 } else { self.codes[at].wrapping_sub(prediction) };
        self.residuals.push(bits::zigzag(residual));
        prediction.wrapping_add(residual)
    }

    fn code_row(&mut self, row: Row, codes: &mut [i32]) {
        let samples = row.of(self.codes).zip(row.of(self.state));
        self.residuals.extend(codes.iter_mut().zip(samples).map(|(code, (&actual, &state))| {
            let residual = if state == VOID { 0 } else { actual.wrapping_sub(*code) };
            *code = if state == VALID { actual } else { *code };
            bits::zigzag(residual)
        }));
    }

    fn sharpness<W: Word>(&mut self, stage: Stage, planes: &mut Planes<W>) -> i32 {
        if self.choose {
            self.weights.sharpness = planes.choose_sharpness(self.target(stage));
        }
        self.weights.sharpness
    }

    fn weights<W: Word>(&mut self, stage: Stage, planes: &mut Planes<W>) -> Weights {
        if self.choose {
            self.weights.skew = planes.choose_skew(self.target(stage), self.weights.sharpness);
        }
        self.weights
    }

    fn fill(&mut self, stage: Stage) {
        let start = self.residuals.len() - stage.newborn_count();
        let newborn = stage.newborn().flat_map(Row::indices);
        for (residual, at) in self.residuals[start..].iter_mut().zip(newborn) {
            if self.state[at] == FILLED
                && let Some(median) = lower_median(self.codes, self.state, stage, at)
            {
                *residual = bits::zigzag(self.codes[at].wrapping_sub(median));
            }
        }
    }
}

/// Adds residuals to what was predicted.
struct Decoder<'a> {
    codes: &'a mut [i32],
    state: &'a [u8],
    /// False if all samples are valid: most tiles, and faster.
    has_void: bool,
    residuals: &'a [u32],
    /// Residuals used up.
    used: usize,
    weights: Weights,
}

impl Decoder<'_> {
    /// The next `count` residuals.
    fn take(&mut self, count: usize) -> &[u32] {
        let start = self.used.min(self.residuals.len());
        self.used = (start + count).min(self.residuals.len());
        &self.residuals[start..self.used]
    }
}

impl Coder for Decoder<'_> {
    fn codes(&self) -> &[i32] {
        self.codes
    }

    fn code_corner(&mut self, at: usize, prediction: i32) -> i32 {
        let residual = self.take(1).first().map_or(0, |&g| bits::unzigzag(g));
        self.codes[at] = prediction.wrapping_add(residual);
        self.codes[at]
    }

    fn code_row(&mut self, row: Row, codes: &mut [i32]) {
        let (state, has_void) = (self.state, self.has_void);
        let residuals = self.take(codes.len());
        if has_void {
            for ((code, &g), &state) in codes.iter_mut().zip(residuals).zip(row.of(state)) {
                *code = if state == VALID { code.wrapping_add(bits::unzigzag(g)) } else { *code };
            }
        } else {
            for (code, &g) in codes.iter_mut().zip(residuals) {
                *code = code.wrapping_add(bits::unzigzag(g));
            }
        }
        for (sample, &code) in row.of_mut(self.codes).zip(codes.iter()) {
            *sample = code;
        }
    }

    fn sharpness<W: Word>(&mut self, _: Stage, _: &mut Planes<W>) -> i32 {
        self.weights.sharpness
    }

    fn weights<W: Word>(&mut self, _: Stage, _: &mut Planes<W>) -> Weights {
        self.weights
    }

    fn fill(&mut self, stage: Stage) {
        if !self.has_void {
            return;
        }
        let residuals = &self.residuals[self.used - stage.newborn_count()..self.used];
        for (&g, at) in residuals.iter().zip(stage.newborn().flat_map(Row::indices)) {
            if self.state[at] != VALID {
                let prediction = lower_median(self.codes, self.state, stage, at).unwrap_or(self.codes[at]);
                self.codes[at] = prediction.wrapping_add(bits::unzigzag(g));
            }
        }
    }
}

/// Appends the heights chunk of a tile; appends nothing if its length is 0.
///
/// Samples whose state is not [`VOID`] are kept exactly. Unless `root`, those with even column and row are the parent's.
pub fn encode(
    lattice: &Lattice,
    coding: Coding,
    root: bool,
    scratch: &mut Scratch,
    out: &mut Vec<u8>,
) -> Result<()> {
    check_shape(lattice, coding)?;
    let n = lattice.n;
    let constant = range(&lattice.code, &lattice.state).is_none_or(|(low, high)| low == high);
    let transform = if coding == Coding::Float32 && !constant { decimal::detect(lattice, root) } else { 0 };
    let codes = match decimal::scale(transform) {
        Some(scale) => {
            scratch.decimals.clear();
            scratch.decimals.extend(lattice.code.iter().map(|&code| decimal::q_from_code(code, scale)));
            &scratch.decimals
        }
        None => &lattice.code,
    };
    let narrow = is_narrow(codes, &lattice.state, n, root);
    scratch.residuals.clear();
    let (state, residuals) = (&lattice.state, &mut scratch.residuals);
    let mut coder = Encoder { codes, state, residuals, weights: Weights::USUAL, choose: true };
    scratch.walk.run(narrow, state, n, root, &mut coder);
    if root {
        // Every stage has chosen for itself; there is room for the choice of one.
        coder.residuals.clear();
        coder.choose = false;
        scratch.walk.run(narrow, state, n, root, &mut coder);
    }
    let weights = coder.weights;

    if coding.has_low() {
        gather_lows(lattice, root, &mut scratch.bytes);
    } else {
        scratch.bytes.clear();
    }
    let all_zero = scratch.residuals.iter().all(|&g| g == 0) && scratch.bytes.iter().all(|&byte| byte == 0);
    if all_zero && transform == 0 && weights == Weights::USUAL {
        return Ok(());
    }
    let k = bits::choose_k(&scratch.residuals, &mut scratch.histogram);
    let start = out.len();
    out.extend_from_slice(&[if narrow { NARROW } else { 0 }, k as u8, transform, weights.byte()]);
    out.extend_from_slice(&[0; 8]);
    scratch.raw.clear();
    bits::write_plane(&scratch.residuals, k, &mut scratch.raw);
    frame::compress_parts(&scratch.raw, &order::cuts(n, root), out)?;
    let plane_length = (out.len() - start - HEAD) as u32;
    bits::write_raw(&scratch.residuals, k, out);
    let lows_start = out.len();
    if coding.has_low() {
        frame::compress(&scratch.bytes, out)?;
    }
    let lows_length = (out.len() - lows_start) as u32;
    out[start + 4..start + 8].copy_from_slice(&plane_length.to_le_bytes());
    out[start + 8..start + HEAD].copy_from_slice(&lows_length.to_le_bytes());
    Ok(())
}

/// Fills in the codes (and lows) of all newborn samples of `lattice` from the heights chunk.
///
/// `lattice.state` is decoded already; unless `root`, so are the samples with even column and row, which stay as they
/// are. After an error the newborn samples are not defined.
pub fn decode(
    chunk: &[u8],
    lattice: &mut Lattice,
    coding: Coding,
    root: bool,
    scratch: &mut Scratch,
) -> Result<()> {
    check_shape(lattice, coding)?;
    let n = lattice.n;
    let count = order::newborn_count(n, root);
    let parts = Parts::split(chunk, coding, count)?;
    if let Some(plane) = parts.plane {
        frame::decompress(plane, count..=count * bits::MAX_PLANE_BYTES, "byte plane", &mut scratch.bytes)?;
        bits::read(&scratch.bytes, parts.raw, parts.k, count, &mut scratch.raw, &mut scratch.residuals)?;
    } else {
        scratch.residuals.clear();
        scratch.residuals.resize(count, 0);
    }
    let scale = decimal::scale(parts.transform);
    if let Some(scale) = scale {
        // Newborn samples are overwritten before they are read.
        scratch.decimals.clear();
        scratch.decimals.extend(lattice.code.iter().map(|&code| decimal::q_from_code(code, scale)));
    }
    let codes = if scale.is_some() { &mut scratch.decimals } else { &mut lattice.code };
    let (state, residuals) = (&lattice.state, &scratch.residuals);
    let has_void = state.iter().any(|&state| state != VALID);
    let mut coder = Decoder { codes, state, has_void, residuals, used: 0, weights: parts.weights };
    scratch.walk.run(parts.narrow, state, n, root, &mut coder);
    if let Some(scale) = scale {
        for row in order::newborn(n, root) {
            for (code, &q) in row.of_mut(&mut lattice.code).zip(row.of(&scratch.decimals)) {
                *code = decimal::code_from_q(q, scale);
            }
        }
    }
    match parts.lows {
        Some(lows) => {
            frame::decompress(lows, 4 * count..=4 * count, "plane of lows", &mut scratch.bytes)?;
            scatter_lows(&scratch.bytes, lattice, root);
        }
        None if coding.has_low() => {
            order::newborn(n, root).for_each(|row| row.of_mut(&mut lattice.low).for_each(|low| *low = 0));
        }
        None => {}
    }
    Ok(())
}

/// A heights chunk, taken apart.
struct Parts<'a> {
    narrow: bool,
    k: u32,
    transform: u8,
    weights: Weights,
    /// `None` if all residuals are 0.
    plane: Option<&'a [u8]>,
    raw: &'a [u8],
    lows: Option<&'a [u8]>,
}

impl<'a> Parts<'a> {
    /// Checks the head and the lengths of a chunk for `count` newborn samples.
    fn split(chunk: &'a [u8], coding: Coding, count: usize) -> Result<Self> {
        if chunk.is_empty() {
            let weights = Weights::USUAL;
            return Ok(Self {
                narrow: false,
                k: 0,
                transform: 0,
                weights,
                plane: None,
                raw: &[],
                lows: None,
            });
        }
        let Some((&[flags, k, transform, weights, a0, a1, a2, a3, b0, b1, b2, b3], body)) =
            chunk.split_first_chunk::<HEAD>()
        else {
            return Err(Error::format("heights chunk", format!("at least {HEAD} bytes"), chunk.len()));
        };
        if flags & !NARROW != 0 {
            return Err(Error::format("heights chunk", "reserved flags of 0", format!("{flags:#04x}")));
        }
        let Some(weights) = Weights::from_byte(weights) else {
            let expected = "weights with a sharpness of 0 to 7 and a skew of -7 to 7";
            return Err(Error::format("heights chunk", expected, format!("{weights:#04x}")));
        };
        if u32::from(k) > bits::MAX_RAW_BITS {
            return Err(Error::format("heights chunk", format!("k of 0 to {}", bits::MAX_RAW_BITS), k));
        }
        if transform != 0 && (coding != Coding::Float32 || decimal::scale(transform).is_none()) {
            return Err(Error::format(
                "heights chunk",
                "a transform of 0 to 12, 0 unless float32",
                transform,
            ));
        }
        let raw_length = bits::raw_length(count, u32::from(k));
        let (a, b) = (u32::from_le_bytes([a0, a1, a2, a3]), u32::from_le_bytes([b0, b1, b2, b3]));
        if u64::from(a) + raw_length as u64 + u64::from(b) != body.len() as u64 {
            let expected = format!("byte plane of {a}, raw bits of {raw_length} and lows of {b} bytes");
            return Err(Error::format("heights chunk", expected, format!("{} bytes", body.len())));
        }
        if (b > 0) != coding.has_low() {
            return Err(Error::format(
                "heights chunk",
                "lows exactly for float64",
                format!("{b} bytes of lows"),
            ));
        }
        let (plane, rest) = body.split_at(a as usize);
        let (raw, lows) = rest.split_at(raw_length);
        let lows = coding.has_low().then_some(lows);
        let narrow = flags & NARROW != 0;
        Ok(Self { narrow, k: u32::from(k), transform, weights, plane: Some(plane), raw, lows })
    }
}

/// The planes must be as large as `n` says: whoever calls is wrong otherwise.
fn check_shape(lattice: &Lattice, coding: Coding) -> Result<()> {
    let count = (lattice.n + 1) * (lattice.n + 1);
    let lows = if coding.has_low() { count } else { 0 };
    let fits = lattice.code.len() == count && lattice.state.len() == count && lattice.low.len() == lows;
    if fits && lattice.n >= 2 && lattice.n.is_power_of_two() {
        return Ok(());
    }
    Err(Error::usage(format!("a lattice of {} intervals does not have the samples of a tile", lattice.n)))
}

/// Smallest and largest code of the samples with a height.
fn range(codes: &[i32], state: &[u8]) -> Option<(i32, i32)> {
    let (mut low, mut high) = (i32::MAX, i32::MIN);
    for (&code, &state) in codes.iter().zip(state) {
        low = low.min(if state == VOID { i32::MAX } else { code });
        high = high.max(if state == VOID { i32::MIN } else { code });
    }
    (low <= high).then_some((low, high))
}

/// True if 32-bit arithmetic predicts this tile rightly, relative to its base.
fn is_narrow(codes: &[i32], state: &[u8], n: usize, root: bool) -> bool {
    let Some((low, high)) = range(codes, state) else { return true };
    // The base is one of the heights, or 0; and 0 stands in where no parent is valid.
    let base_is_height = !root || state[0] != VOID;
    let has_parent = order::stages(n, root)
        .take(1)
        .any(|first| (0..=first.m).any(|b| first.parents(b).of(state).any(|&state| state == VALID)));
    let (low, high) = if base_is_height && has_parent { (low, high) } else { (low.min(0), high.max(0)) };
    let limit = if state.contains(&VOID) { NARROW_RANGE_VOID } else { NARROW_RANGE };
    i64::from(high) - i64::from(low) < limit
}

/// The lows of all newborn samples, byte by byte; 0 for those without a height.
fn gather_lows(lattice: &Lattice, root: bool, out: &mut Vec<u8>) {
    out.clear();
    for shift in [0, 8, 16, 24] {
        for row in order::newborn(lattice.n, root) {
            let samples = row.of(&lattice.low).zip(row.of(&lattice.state));
            out.extend(samples.map(|(low, &state)| if state == VOID { 0 } else { (low >> shift) as u8 }));
        }
    }
}

/// The inverse of [`gather_lows`].
fn scatter_lows(bytes: &[u8], lattice: &mut Lattice, root: bool) {
    let mut bytes = bytes.iter();
    for shift in [0, 8, 16, 24] {
        for row in order::newborn(lattice.n, root) {
            for (low, &byte) in row.of_mut(&mut lattice.low).zip(&mut bytes) {
                *low = if shift == 0 { u32::from(byte) } else { *low | u32::from(byte) << shift };
            }
        }
    }
}
