//! Scans over the states of samples: are all valid, where is which, and the range of the codes that
//! count; also the median of up to eight numbers. Fills, errors and the codec use them.

use crate::sample::{FILLED, VALID};
use crate::simd::{self, Kernel};

/// True if all samples are valid. Reads all of them without an early end: that is faster.
#[inline]
pub fn all_valid(state: &[u8]) -> bool {
    state.iter().fold(0, |different, state| different | (state ^ VALID)) == 0
}

/// Lowest and highest code; `None` if there are none.
pub fn range(code: &[i32]) -> Option<(i32, i32)> {
    simd::run(RangeOfAll(code))
}

/// Lowest and highest code of the samples that have a height, valid or filled; `None` if none has.
/// `state` has one state for each code.
pub fn known_range(code: &[i32], state: &[u8]) -> Option<(i32, i32)> {
    simd::run(RangeOf::<FILLED> { code, state })
}

/// Lowest and highest code of the valid samples; `None` if there are none. `state` has one state
/// for each code.
pub fn valid_range(code: &[i32], state: &[u8]) -> Option<(i32, i32)> {
    simd::run(RangeOf::<VALID> { code, state })
}

/// [`range`] as a kernel. It has no early end, so that the compiler can use vectors.
struct RangeOfAll<'a>(&'a [i32]);

impl Kernel for RangeOfAll<'_> {
    type Output = Option<(i32, i32)>;

    #[inline(always)]
    fn run(self) -> Option<(i32, i32)> {
        let (mut low, mut high) = (i32::MAX, i32::MIN);
        for &code in self.0 {
            (low, high) = (low.min(code), high.max(code));
        }
        (!self.0.is_empty()).then_some((low, high))
    }
}

/// Lowest and highest code of the samples whose state is at least `LEAST`.
struct RangeOf<'a, const LEAST: u8> {
    code: &'a [i32],
    state: &'a [u8],
}

impl<const LEAST: u8> Kernel for RangeOf<'_, LEAST> {
    type Output = Option<(i32, i32)>;

    #[inline(always)]
    fn run(self) -> Option<(i32, i32)> {
        let (code, state) = (self.code, &self.state[..self.code.len()]);
        if all_valid(state) {
            return RangeOfAll(code).run();
        }
        let (mut low, mut high) = (i32::MAX, i32::MIN);
        for i in 0..code.len() {
            // All ones if the sample does not count. A condition would become masked loads, which
            // are slow.
            let out = -i32::from(state[i] < LEAST);
            low = low.min((code[i] & !out) | (out & i32::MAX));
            high = high.max((code[i] & !out) | (out & i32::MIN));
        }
        // Only where no sample counts is the lowest above the highest.
        (low <= high).then_some((low, high))
    }
}

/// Calls `visit` with the index of each sample of `row` that is in `state`, in order. Samples are
/// tested 32 at a time: most often none of them is.
pub fn each_place(row: &[u8], state: u8, visit: impl FnMut(usize)) {
    visit_places::<true>(row, state, visit);
}

/// Calls `visit` with the index of each sample of `row` that is not in `state`, in order.
pub fn each_other_place(row: &[u8], state: u8, visit: impl FnMut(usize)) {
    visit_places::<false>(row, state, visit);
}

/// [`each_place`] if `EQUAL`, else [`each_other_place`].
#[inline]
fn visit_places<const EQUAL: bool>(row: &[u8], state: u8, mut visit: impl FnMut(usize)) {
    let (blocks, rest) = row.as_chunks::<32>();
    let mut last = [if EQUAL { !state } else { state }; 32];
    last[..rest.len()].copy_from_slice(rest);
    for (first, block) in (0..).step_by(32).zip(blocks.iter().chain([&last])) {
        if block.iter().fold(0, |any, &other| any | u8::from((other == state) == EQUAL)) != 0 {
            visit_places_of_block::<EQUAL>(block, state, |place| visit(first + place));
        }
    }
}

/// [`visit_places`] of one block, eight samples at a time.
fn visit_places_of_block<const EQUAL: bool>(block: &[u8; 32], state: u8, mut visit: impl FnMut(usize)) {
    const LOW: u64 = 0x7F7F_7F7F_7F7F_7F7F;
    let wanted = u64::from_le_bytes([state; 8]);
    for (first, word) in (0..).step_by(8).zip(block.as_chunks::<8>().0) {
        let different = u64::from_le_bytes(*word) ^ wanted;
        // The highest bit of every byte that is not 0.
        let other = (((different & LOW) + LOW) | different) & !LOW;
        let mut found = if EQUAL { other ^ !LOW } else { other };
        while found != 0 {
            visit(first + found.trailing_zeros() as usize / 8);
            found &= found - 1;
        }
    }
}

/// The lower median of the `count` smallest of eight numbers; `None` if `count` is 0.
pub fn median_of<N: Ord + Copy>(mut numbers: [N; 8], count: usize) -> Option<N> {
    let middle = count.checked_sub(1)? / 2;
    // A sorting network has no branches that the processor could predict wrongly.
    let mut sort = |a: usize, b: usize| {
        (numbers[a], numbers[b]) = (numbers[a].min(numbers[b]), numbers[a].max(numbers[b]));
    };
    for a in [0, 1, 4, 5] {
        sort(a, a + 2);
    }
    for a in [0, 1, 2, 3] {
        sort(a, a + 4);
    }
    for a in [0, 2, 4, 6] {
        sort(a, a + 1);
    }
    for a in [2, 3] {
        sort(a, a + 2);
    }
    for a in [1, 3] {
        sort(a, a + 3);
    }
    for a in [1, 3, 5] {
        sort(a, a + 1);
    }
    Some(numbers[middle])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_are_those_of_sorted_numbers() {
        // A network that sorts all zeros and ones sorts everything.
        for bits in 0..256 {
            let numbers = std::array::from_fn(|place| i64::from(bits >> place & 1));
            let mut sorted = numbers;
            sorted.sort_unstable();
            assert_eq!(median_of(numbers, 0), None);
            for count in 1..=8 {
                assert_eq!(median_of(numbers, count), Some(sorted[(count - 1) / 2]));
            }
        }
    }

    #[test]
    fn ranges_are_those_of_the_samples_that_count() {
        let mut seed = 7_u32;
        let mut random = move || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            seed >> 8
        };
        for length in [0, 1, 15, 16, 17, 66, 300] {
            for kinds in [1, 2, 3, 40] {
                let state: Vec<u8> = (0..length).map(|_| (random() % kinds % 3) as u8).collect();
                let ends = [i32::MIN, i32::MAX, -5, 9];
                let code: Vec<i32> = (0..length).map(|_| ends[random() as usize % 4]).collect();
                for (least, range) in
                    [(FILLED, known_range(&code, &state)), (VALID, valid_range(&code, &state))]
                {
                    let counting = || {
                        code.iter().zip(&state).filter(|(_, state)| **state >= least).map(|(code, _)| *code)
                    };
                    assert_eq!(range, counting().min().zip(counting().max()));
                }
            }
        }
    }

    #[test]
    fn every_place_is_visited_in_order() {
        for length in [0, 7, 32, 33, 129] {
            let row: Vec<u8> = (0..length).map(|place| (place * place / 5 % 3) as u8).collect();
            for state in 0..3 {
                let mut places = Vec::new();
                each_place(&row, state, |place| places.push(place));
                let expected: Vec<_> = (0..length).filter(|&place| row[place] == state).collect();
                assert_eq!(places, expected);
                let mut others = Vec::new();
                each_other_place(&row, state, |place| others.push(place));
                let expected: Vec<_> = (0..length).filter(|&place| row[place] != state).collect();
                assert_eq!(others, expected);
            }
        }
    }
}
