//! An index of members by rows, to find those that a window meets.

use std::ops::Range;

use super::member::Member;

/// Most strips of rows.
const STRIPS: usize = 256;

/// Strips of rows of equal height, each with the members that meet it.
pub(super) struct Index {
    rows_of_strip: u32,
    strips: Vec<Vec<u32>>,
}

impl Index {
    /// The index of members of a mosaic of `height` rows.
    pub(super) fn new(height: u32, members: &[Member]) -> Self {
        let rows_of_strip = height.div_ceil(members.len().clamp(1, STRIPS) as u32).max(1);
        let mut strips = vec![Vec::new(); height.div_ceil(rows_of_strip) as usize];
        for (index, member) in members.iter().enumerate() {
            let rows = &member.rect.rows;
            let met = (rows.start / rows_of_strip) as usize..=((rows.end - 1) / rows_of_strip) as usize;
            strips[met].iter_mut().for_each(|strip| strip.push(index as u32));
        }
        Self { rows_of_strip, strips }
    }

    /// The members that a window meets, in order.
    pub(super) fn meeting(&self, members: &[Member], columns: &Range<u32>, rows: &Range<u32>) -> Vec<usize> {
        if rows.is_empty() || columns.is_empty() {
            return Vec::new();
        }
        let met = (rows.start / self.rows_of_strip) as usize..=((rows.end - 1) / self.rows_of_strip) as usize;
        let mut found: Vec<usize> = self.strips[met].iter().flatten().map(|&index| index as usize).collect();
        found.sort_unstable();
        found.dedup();
        found.retain(|&index| members[index].common(columns, rows).area() > 0);
        found
    }
}
