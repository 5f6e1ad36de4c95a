//! Codes where samples have none: straight lines between those beside them.
//!
//! What is predicted from them (`format-spec.md`, section 9.2) or bounded by them is better for their being near.

use std::ops::Range;

use crate::sample::{VALID, VOID};
use crate::states;

/// Bridges the samples of a plane of rows of `width` that are not valid. False if none is: then nothing is changed.
///
/// They get the codes of straight lines between the others of their row, at its ends that of the nearest one; rows without any copy the
/// nearest row above that has one, or below.
pub fn bridge_voids(codes: &mut [i32], states: &[u8], width: usize) -> bool {
    bridge(codes, states, width, states::all_valid, |states, visit| {
        states::each_other_place(states, VALID, visit);
    })
}

/// [`bridge_voids`] of the samples without a height: fills stay.
pub fn bridge_unfilled(codes: &mut [i32], states: &[u8], width: usize) -> bool {
    let is_whole = |states: &[u8]| states.iter().fold(VALID, |least, &state| state.min(least)) != VOID;
    bridge(codes, states, width, is_whole, |states, visit| states::each_place(states, VOID, visit))
}

/// Bridges the places that `each_gap` visits, in order.
fn bridge(
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
        if is_whole(states) || bridge_row(codes_of_row, |visit| each_gap(states, visit)) {
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

/// Bridges the gaps of one row; false if it is nothing else.
fn bridge_row(row: &mut [i32], each_gap: impl Fn(&mut dyn FnMut(usize))) -> bool {
    let mut run = 0..0;
    each_gap(&mut |gap| {
        if gap > run.end {
            bridge_run(row, &run);
            run.start = gap;
        }
        run.end = gap + 1;
    });
    bridge_run(row, &run);
    run.len() < row.len()
}

/// Bridges a run that ends where the row does, or at another sample.
fn bridge_run(row: &mut [i32], run: &Range<usize>) {
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
    use crate::sample::FILLED;

    #[test]
    fn rows_are_bridged_by_straight_lines_and_rows_of_nothing_are_copies() {
        let (x, f, v) = (VOID, FILLED, VALID);
        let states = [[x; 6], [x, v, x, f, v, x], [v, x, x, x, x, v], [x; 6]].concat();
        let codes = [[9; 6], [9, 4, 9, 8, 2, 9], [-1, 9, 9, 9, 9, 9], [9; 6]].concat();
        let mut bridged = codes.clone();
        assert!(bridge_voids(&mut bridged, &states, 6));
        let [first, second] = [[4, 4, 3, 2, 2, 2], [-1, 1, 3, 5, 7, 9]];
        assert_eq!(bridged, [first, first, second, second].concat());
        let mut bridged = codes;
        assert!(bridge_unfilled(&mut bridged, &states, 6));
        let first = [4, 4, 6, 8, 2, 2];
        assert_eq!(bridged, [first, first, second, second].concat());
        let mut nothing = [5; 8];
        assert!(!bridge_voids(&mut nothing, &[VOID, FILLED, VOID, FILLED, VOID, VOID, VOID, VOID], 4));
        assert!(!bridge_unfilled(&mut nothing, &[VOID; 8], 4));
        assert_eq!(nothing, [5; 8]);
    }
}
