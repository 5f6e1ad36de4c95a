//! What stands in for void samples (`format-spec.md`, section 9.2): among parents, so that their neighbours can be
//! predicted, and among newborn samples, whose fills mostly are the median of what is around them.

use std::ops::Range;

use crate::codec::order::Stage;
use crate::sample::VALID;
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
        if states::all_valid(states) || replace_in_row(&mut parents[start..start + width], states) {
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
    let mut run = 0..0;
    states::each_other_place(states, VALID, |void| {
        if void > run.end {
            replace_run(row, &run);
            run.start = void;
        }
        run.end = void + 1;
    });
    replace_run(row, &run);
    run.len() < row.len()
}

/// Replaces a run of void samples that ends where the row does, or at a valid one.
fn replace_run(row: &mut [i32], run: &Range<usize>) {
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
