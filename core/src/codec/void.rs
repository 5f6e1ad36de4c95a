//! Fills among newborn samples (`format-spec.md`, section 9.2): most are the median of the samples
//! around them.

use crate::codec::bits;
use crate::codec::order::Stage;
use crate::sample::state;
use crate::sample::{FILLED, VALID};
use crate::simd::{self, Kernel};

/// Where the fills of a tile come from: a hint that saves the encoder work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fills {
    /// Unknown.
    Any,
    /// Every void sample off the tile's border that has valid samples around it is filled with
    /// their lower median, as `tile::fill` does in a leaf. If this is not so, the fills are decoded
    /// as other heights; only builds with debug assertions check it.
    Beside,
}

/// Sets the residuals of the fills of a stage, all of whose valid samples are known.
///
/// `residuals` are those of its newborn samples in order, against their predictions. `near` is
/// scratch memory for a row.
pub fn code_fills(
    (codes, state): (&[i32], &[u8]),
    stage: Stage,
    fills: Fills,
    mut residuals: &mut [u32],
    near: &mut Vec<u8>,
) {
    let n = stage.intervals();
    let width = n + 1;
    for row in stage.newborn() {
        let of_row = residuals.split_off_mut(..row.count).unwrap_or_default();
        let states = &state[row.first..row.end()];
        if state::all_valid(states) {
            continue;
        }
        let (first, y) = (row.first % width, row.first / width);
        let residual = |x: usize| {
            let median = lower_median(codes, state, stage, (x, y))?;
            Some(bits::zigzag(codes[y * width + x].wrapping_sub(median)))
        };
        if fills == Fills::Beside && stage.half() == 1 && (1..n).contains(&y) {
            near_valid(state, width, y, 1, near);
            // On the border `Fills::Beside` says nothing.
            for x in [0, n].into_iter().filter(|&x| states.len() == width && state[y * width + x] == FILLED) {
                near[x] = 0;
                of_row[x / 2] = residual(x).unwrap_or(of_row[x / 2]);
            }
            if cfg!(debug_assertions) {
                let beside = |x: usize| state[y * width + x] == FILLED && near[x] == 1;
                let wrong =
                    (first..first + states.len()).step_by(2).find(|&x| beside(x) && residual(x) != Some(0));
                debug_assert_eq!(wrong, None, "a fill is not what Fills::Beside says");
            }
            simd::run(NoneBeside { states, near: &near[first..], residuals: of_row });
            continue;
        }
        // The step is a power of two.
        let step = row.step.trailing_zeros();
        state::each_place(states, FILLED, |place| {
            let number = place >> step;
            if number << step == place
                && let Some(residual) = residual(first + place)
            {
                of_row[number] = residual;
            }
        });
    }
}

/// The inverse of [`code_fills`]: the codes of a stage's void samples, from their predictions and
/// residuals.
pub fn restore_fills(codes: &mut [i32], state: &[u8], stage: Stage, mut residuals: &[u32]) {
    let (width, mut near) = (stage.intervals() + 1, Vec::new());
    for row in stage.newborn() {
        let of_row = residuals.split_off(..row.count).unwrap_or_default();
        if state::all_valid(&state[row.first..row.end()]) {
            continue;
        }
        let y = row.first / width;
        near_valid(state, width, y, stage.half(), &mut near);
        for (&g, at) in of_row.iter().zip(row.indices()) {
            if state[at] != VALID {
                let x = at - y * width;
                let median = (near[x] == 1).then(|| lower_median(codes, state, stage, (x, y))).flatten();
                codes[at] = median.unwrap_or(codes[at]).wrapping_add(bits::unzigzag(g));
            }
        }
    }
}

/// Kernel: sets the residuals of void samples with a valid one beside them to 0. `residuals` has
/// every second sample of `states` from the first on.
struct NoneBeside<'a> {
    states: &'a [u8],
    near: &'a [u8],
    residuals: &'a mut [u32],
}

impl Kernel for NoneBeside<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { states, near, residuals } = self;
        let count = residuals.len();
        let (states, near) = (&states[..2 * count - 1], &near[..2 * count - 1]);
        for i in 0..count {
            let keeps = u8::from(states[2 * i] == VALID) | (near[2 * i] ^ 1);
            residuals[i] &= -i32::from(keeps) as u32;
        }
    }
}

/// The lower median of the codes of the valid samples around the void sample in column `x`, row
/// `y`; `None` if there is none.
fn lower_median(codes: &[i32], state: &[u8], stage: Stage, at: (usize, usize)) -> Option<i32> {
    let (mut near, mut count) = ([i32::MAX; 8], 0);
    // A place outside the lattice is the void sample itself.
    for (near, place) in near.iter_mut().zip(stage.around(at)) {
        // All ones if the sample does not count. Which do is random, so a branch would be predicted
        // badly.
        let out = -i32::from(state[place] != VALID);
        *near = (codes[place] & !out) | (out & i32::MAX);
        count += (out + 1) as usize;
    }
    state::median_of(near, count)
}

/// Sets `near`, for each column of row `y`, to 1 if a sample `h` away in any of the eight
/// directions may be valid, else to 0. Most void samples have no valid one near; this finds out for
/// a whole row at a time.
fn near_valid(state: &[u8], width: usize, y: usize, h: usize, near: &mut Vec<u8>) {
    near.clear();
    near.resize(width, 0);
    simd::run(NearValid { state, width, y, h, near });
}

/// [`near_valid`] as a kernel.
struct NearValid<'a> {
    state: &'a [u8],
    width: usize,
    y: usize,
    h: usize,
    near: &'a mut [u8],
}

impl Kernel for NearValid<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { state, width, y, h, near } = self;
        let rows = state.len() / width;
        for y in [y.checked_sub(h), Some(y), y.checked_add(h).filter(|&y| y < rows)].into_iter().flatten() {
            let row = &state[y * width..(y + 1) * width];
            for (from, to, count) in [(0, 0, width), (0, h, width - h), (h, 0, width - h)] {
                let (row, near) = (&row[from..from + count], &mut near[to..to + count]);
                for x in 0..count {
                    near[x] |= u8::from(row[x] == VALID);
                }
            }
        }
    }
}
