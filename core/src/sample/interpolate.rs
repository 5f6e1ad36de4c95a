//! Linear interpolation of codes across voids, row by row.
//!
//! Predictions (`format-spec.md`, section 9.2) and bounds that are made of such codes are better
//! the nearer the codes are to the heights around them.

use std::ops::Range;

use crate::sample::state;
use crate::sample::{VALID, VOID};

/// Interpolates across the samples that are not valid, of a plane of rows of `width`. Returns
/// false, and changes nothing, if no sample is valid.
///
/// Such a sample gets its code from the straight line between the nearest valid samples of its row,
/// rounded down; beyond the first or last of them it gets the code of that one. A row without a
/// valid sample is a copy of the nearest row above that has one, or else of the nearest below.
pub fn across_voids(codes: &mut [i32], states: &[u8], width: usize) -> bool {
    across(codes, states, width, state::all_valid, |states, visit| {
        state::each_other_place(states, VALID, visit);
    })
}

/// [`across_voids`] that leaves fills as they are: it interpolates across samples without a height.
pub fn across_unfilled(codes: &mut [i32], states: &[u8], width: usize) -> bool {
    let is_whole = |states: &[u8]| states.iter().fold(VALID, |least, &state| state.min(least)) != VOID;
    across(codes, states, width, is_whole, |states, visit| state::each_place(states, VOID, visit))
}

/// Interpolates across the places that `each_gap` visits in order.
fn across(
    codes: &mut [i32],
    states: &[u8],
    width: usize,
    is_whole: impl Fn(&[u8]) -> bool,
    each_gap: impl Fn(&[u8], &mut dyn FnMut(usize)),
) -> bool {
    let mut source = None;
    for (row, states) in states.chunks_exact(width).enumerate() {
        let start = row * width;
        let codes_of_row = &mut codes[start..start + width];
        if is_whole(states) || across_row(codes_of_row, |visit| each_gap(states, visit)) {
            if source.is_none() {
                for above in 0..row {
                    codes.copy_within(start..start + width, above * width);
                }
            }
            source = Some(start);
        } else if let Some(source) = source {
            codes.copy_within(source..source + width, start);
        }
    }
    source.is_some()
}

/// Interpolates across the gaps of one row. Returns false if the whole row is a gap.
fn across_row(row: &mut [i32], each_gap: impl Fn(&mut dyn FnMut(usize))) -> bool {
    let mut run = 0..0;
    each_gap(&mut |gap| {
        if gap > run.end {
            across_run(row, &run);
            run.start = gap;
        }
        run.end = gap + 1;
    });
    across_run(row, &run);
    run.len() < row.len()
}

/// Interpolates across `run`, consecutive gaps with a sample or the end of the row on either side.
fn across_run(row: &mut [i32], run: &Range<usize>) {
    match (run.start.checked_sub(1), row.get(run.end)) {
        _ if run.is_empty() => {}
        (Some(before), Some(_)) => interpolate(&mut row[before..=run.end]),
        (None, Some(&after)) => row[run.clone()].fill(after),
        (Some(before), None) => {
            let code = row[before];
            row[run.clone()].fill(code);
        }
        (None, None) => {}
    }
}

/// Sets all of `run` but its ends to the straight line between the ends, rounded down.
fn interpolate(run: &mut [i32]) {
    let (steps, first) = ((run.len() - 1) as i64, i64::from(run[0]));
    let rise = i64::from(run[run.len() - 1]) - first;
    // One division for all of them: the remainders add up.
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
    use crate::sample::FILLED;

    #[test]
    fn rows_are_interpolated_and_rows_without_a_sample_are_copies() {
        let (x, f, v) = (VOID, FILLED, VALID);
        let states = [[x; 6], [x, v, x, f, v, x], [v, x, x, x, x, v], [x; 6]].concat();
        let codes = [[9; 6], [9, 4, 9, 8, 2, 9], [-1, 9, 9, 9, 9, 9], [9; 6]].concat();
        let mut filled = codes.clone();
        assert!(across_voids(&mut filled, &states, 6));
        let [first, second] = [[4, 4, 3, 2, 2, 2], [-1, 1, 3, 5, 7, 9]];
        assert_eq!(filled, [first, first, second, second].concat());
        let mut filled = codes;
        assert!(across_unfilled(&mut filled, &states, 6));
        let first = [4, 4, 6, 8, 2, 2];
        assert_eq!(filled, [first, first, second, second].concat());
        let mut nothing = [5; 8];
        assert!(!across_voids(&mut nothing, &[VOID, FILLED, VOID, FILLED, VOID, VOID, VOID, VOID], 4));
        assert!(!across_unfilled(&mut nothing, &[VOID; 8], 4));
        assert_eq!(nothing, [5; 8]);
    }
}
