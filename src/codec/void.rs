//! What stands in for void samples (`format-spec.md`, section 9.2): among parents, so that their neighbours can be
//! predicted, and among newborn samples, whose fills mostly are the median of what is around them.

use crate::codec::order::Stage;
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

/// The lower median of the codes of the valid samples around the void one at index `at`; `None` if there is none.
pub fn lower_median(codes: &[i32], state: &[u8], stage: Stage, at: usize) -> Option<i32> {
    // A place outside the lattice is the void sample itself.
    let around = stage.around(at);
    let count = around.iter().filter(|&&place| state[place] == VALID).count();
    let near = around.map(|place| if state[place] == VALID { codes[place] } else { i32::MAX });
    median_of(near.map(i64::from), count).map(|code| code as i32)
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

/// Whether a sample of row `y` may have a valid one around it, `h` samples away, column by column into `near`: most void samples have
/// none, and this says so for a whole row at a time.
pub fn near_valid(state: &[u8], width: usize, y: usize, h: usize, near: &mut Vec<bool>) {
    let rows = state.len() / width;
    let row = |y: usize| &state[y * width..(y + 1) * width];
    near.clear();
    near.resize(width, false);
    for y in [y.checked_sub(h), Some(y), y.checked_add(h).filter(|&y| y < rows)].into_iter().flatten() {
        let row = row(y);
        if !row.contains(&VALID) {
            continue;
        }
        for (near, &state) in near.iter_mut().zip(row) {
            *near |= state == VALID;
        }
        for (near, &state) in near[h..].iter_mut().zip(row) {
            *near |= state == VALID;
        }
        for (near, &state) in near.iter_mut().zip(&row[h..]) {
            *near |= state == VALID;
        }
    }
}

/// Replaces the void samples of `(m + 1)^2` parents: straight lines between the valid ones of a row, the nearest valid one
/// at its ends; rows without a valid sample copy the nearest row above that has one, or below.
pub fn replace(parents: &mut [i32], states: &[u8], m: usize) {
    let width = m + 1;
    let mut source = None;
    for (row, states) in states.chunks_exact(width).enumerate() {
        let start = row * width;
        if all_valid(states) || replace_in_row(&mut parents[start..start + width], states) {
            if source.is_none() {
                for above in 0..row {
                    parents.copy_within(start..start + width, above * width);
                }
            }
            source = Some(start);
        } else if let Some(source) = source {
            parents.copy_within(source..source + width, start);
        }
    }
    if source.is_none() {
        parents.fill(0);
    }
}

/// Replaces the void samples of one row; false if none is valid.
fn replace_in_row(row: &mut [i32], states: &[u8]) -> bool {
    let mut last = None;
    each_place(states, VALID, |a| {
        match last {
            None => {
                let code = row[a];
                row[..a].fill(code);
            }
            Some(before) if before + 1 < a => interpolate(&mut row[before..=a]),
            Some(_) => {}
        }
        last = Some(a);
    });
    if let Some(last) = last {
        let code = row[last];
        row[last..].fill(code);
    }
    last.is_some()
}

/// Sets all but the ends of `run` to the straight line between them, rounded down.
fn interpolate(run: &mut [i32]) {
    let (steps, first) = ((run.len() - 1) as i64, i64::from(run[0]));
    let rise = i64::from(run[run.len() - 1]) - first;
    // One division for all of them: what it leaves adds up.
    let (whole, part) = (rise.div_euclid(steps), rise.rem_euclid(steps));
    let (mut code, mut left) = (first, 0);
    for place in &mut run[1..steps as usize] {
        (code, left) = (code + whole, left + part);
        if left >= steps {
            (code, left) = (code + 1, left - steps);
        }
        *place = code as i32;
    }
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
