//! What stands in for void samples (`format-spec.md`, section 9.2): among parents, so that their neighbours can be
//! predicted, and among newborn samples, whose fills mostly are the median of what is around them.

use crate::codec::order::Stage;
use crate::sample::VALID;
use crate::simd::{self, Kernel};
use crate::states;

/// The lower median of the codes of the valid samples around the void one in column `x`, row `y`; `None` if there is none.
pub fn lower_median(codes: &[i32], state: &[u8], stage: Stage, at: (usize, usize)) -> Option<i32> {
    let (mut near, mut count) = ([i32::MAX; 8], 0);
    // A place outside the lattice is the void sample itself.
    for (near, place) in near.iter_mut().zip(stage.around(at)) {
        // All ones of a sample that does not count: there is no telling which do, so no branch that could guess.
        let out = -i32::from(state[place] != VALID);
        *near = (codes[place] & !out) | (out & i32::MAX);
        count += (out + 1) as usize;
    }
    states::median_of(near, count)
}

/// Whether a sample of row `y` may have a valid one around it, `h` samples away, column by column into `near`, 1 if so: most void samples have
/// none, and this says so for a whole row at a time.
pub fn near_valid(state: &[u8], width: usize, y: usize, h: usize, near: &mut Vec<u8>) {
    near.clear();
    near.resize(width, 0);
    simd::run(NearValid { state, width, y, h, near });
}

/// See [`near_valid`].
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
