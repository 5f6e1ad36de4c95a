//! Questions about states of samples that both fills and the codec ask.

use crate::sample::VALID;

/// True if no sample is void. Looks at all of them: that is fast.
pub fn all_valid(state: &[u8]) -> bool {
    state.iter().fold(0, |different, state| different | (state ^ VALID)) == 0
}

/// Visits the places of `state` in a row of states, in order. Looks at 32 at a time, of which most often none is.
pub fn each_place(row: &[u8], state: u8, mut visit: impl FnMut(usize)) {
    let (blocks, rest) = row.as_chunks::<32>();
    let mut last = [!state; 32];
    last[..rest.len()].copy_from_slice(rest);
    for (first, block) in (0..).step_by(32).zip(blocks.iter().chain([&last])) {
        if block.iter().fold(0, |any, &other| any | u8::from(other == state)) != 0 {
            each_place_of_block(block, state, |place| visit(first + place));
        }
    }
}

/// [`each_place`], eight at a time.
fn each_place_of_block(block: &[u8; 32], state: u8, mut visit: impl FnMut(usize)) {
    const LOW: u64 = 0x7F7F_7F7F_7F7F_7F7F;
    let wanted = u64::from_le_bytes([state; 8]);
    for (first, word) in (0..).step_by(8).zip(block.as_chunks::<8>().0) {
        let different = u64::from_le_bytes(*word) ^ wanted;
        // The highest bit of every byte that is 0.
        let mut found = !(((different & LOW) + LOW) | different | LOW);
        while found != 0 {
            visit(first + found.trailing_zeros() as usize / 8);
            found &= found - 1;
        }
    }
}

/// The lower median of the `count` smallest of eight numbers; `None` if `count` is 0.
pub fn median_of(mut numbers: [i64; 8], count: usize) -> Option<i64> {
    let middle = count.checked_sub(1)? / 2;
    // A network of comparisons sorts without a branch to be guessed wrong.
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
    fn every_place_is_visited_in_order() {
        for length in [0, 7, 32, 33, 129] {
            let row: Vec<u8> = (0..length).map(|place| (place * place / 5 % 3) as u8).collect();
            for state in 0..3 {
                let mut places = Vec::new();
                each_place(&row, state, |place| places.push(place));
                let expected: Vec<_> = (0..length).filter(|&place| row[place] == state).collect();
                assert_eq!(places, expected);
            }
        }
    }
}
