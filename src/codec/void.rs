//! What stands in for void samples (`format-spec.md`, section 9.2): among parents, so that their neighbours can be
//! predicted, and among newborn samples, whose fills mostly are the median of what is around them.

use crate::codec::order::Stage;
use crate::sample::VALID;

/// True if no sample is void. Looks at all of them: that is fast.
pub fn all_valid(state: &[u8]) -> bool {
    state.iter().fold(0, |different, state| different | (state ^ VALID)) == 0
}

/// The lower median of the codes of the valid samples around the void one at index `at`; `None` if there is none.
pub fn lower_median(codes: &[i32], state: &[u8], stage: Stage, at: usize) -> Option<i32> {
    let around = stage.around(at);
    if !around.iter().any(|&place| state[place] == VALID) {
        return None;
    }
    let mut near = [0; 8];
    let mut count = 0;
    // A place outside the lattice is the void sample itself.
    for place in around {
        near[count] = codes[place];
        count += usize::from(state[place] == VALID);
    }
    near[..count].sort_unstable();
    Some(near[(count - 1) / 2])
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
pub fn replace(parents: &mut [i32], valid: &[bool], m: usize) {
    let width = m + 1;
    let mut source = None;
    for (row, valid) in valid.chunks_exact(width).enumerate() {
        let start = row * width;
        if replace_in_row(&mut parents[start..start + width], valid) {
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
fn replace_in_row(row: &mut [i32], valid: &[bool]) -> bool {
    let mut last = None;
    for a in 0..row.len() {
        if !valid[a] {
            continue;
        }
        match last {
            None => {
                let code = row[a];
                row[..a].fill(code);
            }
            Some(before) if before + 1 < a => interpolate(&mut row[before..=a]),
            Some(_) => {}
        }
        last = Some(a);
    }
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
    for (step, code) in run.iter_mut().enumerate().take(steps as usize).skip(1) {
        *code = (first + (rise * step as i64).div_euclid(steps)) as i32;
    }
}
