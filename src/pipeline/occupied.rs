//! [`Occupied`]: which leaf tiles can hold samples.
//!
//! A mosaic says where its files lie (`SourceInfo::footprint`); everything else is void and is not
//! read. So time and memory follow the tiles that exist: a strip of files along a road costs what
//! it holds, not what its bounding box would.

use std::ops::Range;

use crate::rect::Rect;

/// Rectangles of leaf tiles outside of which there are none.
#[derive(Clone, Debug)]
pub struct Occupied {
    /// By their first row.
    rects: Vec<Rect>,
    /// Rows of the tallest.
    tallest: u32,
}

impl Occupied {
    /// The tiles of `all` that a footprint touches with their closed squares of `tile` intervals.
    /// No footprint: all.
    pub fn new(footprint: Option<&[Rect]>, tile: u32, all: &Rect) -> Self {
        let along = |samples: &Range<u32>| {
            // The first sample may be the last of the tile before.
            let first = samples.start.saturating_sub(1) / tile;
            first..samples.end.saturating_sub(1) / tile + 1
        };
        let mut rects = match footprint {
            None => vec![all.clone()],
            Some(rects) => rects
                .iter()
                .filter(|rect| !rect.columns.is_empty() && !rect.rows.is_empty())
                .map(|rect| all.common(&Rect { columns: along(&rect.columns), rows: along(&rect.rows) }))
                .filter(|extent| !extent.is_empty())
                .collect(),
        };
        rects.sort_unstable_by_key(|rect| (rect.rows.start, rect.columns.start));
        let tallest = rects.iter().map(|rect| rect.rows.len() as u32).max().unwrap_or(0);
        Self { rects, tallest }
    }

    /// Runs of tiles in a row of leaf tiles, cut to `columns`: ascending, with gaps between them.
    pub fn runs(&self, y: u32, columns: &Range<u32>) -> Vec<Range<u32>> {
        let from = self.rects.partition_point(|rect| rect.rows.start + self.tallest <= y);
        let to = self.rects.partition_point(|rect| rect.rows.start <= y);
        let here = self.rects.get(from..to).unwrap_or_default().iter().filter(|rect| rect.rows.contains(&y));
        union(here.map(|rect| &rect.columns), columns)
    }

    /// Rows of tiles in groups with the same columns, `levels_up` levels above the leaves, within
    /// `columns` of leaf tiles: how many rows, how many tiles each. Rows without tiles are left
    /// out.
    fn groups(&self, levels_up: u8, columns: &Range<u32>) -> Vec<(u64, u64)> {
        let mut groups = Vec::new();
        self.each_group(levels_up, columns, |rows, runs| {
            groups.push((rows, runs.iter().map(|run| run.len() as u64).sum()));
        });
        groups
    }

    /// Calls `tell` for each such group, with its number of rows and the runs of its tiles.
    fn each_group(&self, levels_up: u8, columns: &Range<u32>, mut tell: impl FnMut(u64, &[Range<u32>])) {
        let up = |range: &Range<u32>| range.start >> levels_up..((range.end - 1) >> levels_up) + 1;
        let rects: Vec<Rect> = self
            .rects
            .iter()
            .map(|rect| rect.common(&Rect { columns: columns.clone(), rows: rect.rows.clone() }))
            .filter(|rect| !rect.is_empty())
            .map(|rect| Rect { columns: up(&rect.columns), rows: up(&rect.rows) })
            .collect();
        let mut edges: Vec<u32> = rects.iter().flat_map(|rect| [rect.rows.start, rect.rows.end]).collect();
        edges.sort_unstable();
        edges.dedup();
        // Rectangles stay sorted by their first row: those that may still be active are a window of
        // them.
        let mut from = 0;
        for pair in edges.windows(2) {
            let (y, rows) = (pair[0], u64::from(pair[1] - pair[0]));
            while rects.get(from).is_some_and(|rect| rect.rows.end <= y) {
                from += 1;
            }
            let here = rects[from..].iter().take_while(|rect| rect.rows.start <= y);
            let here = here.filter(|rect| rect.rows.contains(&y)).map(|rect| &rect.columns);
            let runs = union(here, &(0..u32::MAX));
            if !runs.is_empty() {
                tell(rows, &runs);
            }
        }
    }

    /// Most tiles in one row, `levels_up` levels above the leaves, within `columns` of leaf tiles.
    pub fn widest(&self, levels_up: u8, columns: &Range<u32>) -> u64 {
        self.groups(levels_up, columns).iter().map(|(_, tiles)| *tiles).max().unwrap_or(0)
    }

    /// Most leaf tiles in one row within `columns`, and most runs of them in one.
    pub fn fullest(&self, columns: &Range<u32>) -> (u64, u64) {
        let mut most = (0, 0);
        self.each_group(0, columns, |_, runs| {
            let tiles = runs.iter().map(|run| run.len() as u64).sum();
            most = (most.0.max(tiles), most.1.max(runs.len() as u64));
        });
        most
    }

    /// Tiles, `levels_up` levels above the leaves.
    pub fn count(&self, levels_up: u8) -> u64 {
        self.groups(levels_up, &(0..u32::MAX)).iter().map(|(rows, tiles)| rows * tiles).sum()
    }
}

/// The union of ranges, cut to one range: ascending, with gaps between them.
fn union<'a>(ranges: impl Iterator<Item = &'a Range<u32>>, within: &Range<u32>) -> Vec<Range<u32>> {
    let mut ranges: Vec<Range<u32>> = ranges
        .map(|range| range.start.max(within.start)..range.end.min(within.end))
        .filter(|range| !range.is_empty())
        .collect();
    ranges.sort_unstable_by_key(|range| range.start);
    let mut runs: Vec<Range<u32>> = Vec::with_capacity(ranges.len());
    for range in ranges {
        match runs.last_mut() {
            Some(last) if range.start <= last.end => last.end = last.end.max(range.end),
            _ => runs.push(range),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn rect() -> impl Strategy<Value = Rect> {
        (0_u32..200, 0_u32..200, 0_u32..90, 0_u32..90)
            .prop_map(|(x, y, w, h)| Rect { columns: x..(x + w).min(230), rows: y..(y + h).min(230) })
    }

    proptest! {
        #[test]
        fn agrees_with_a_bitmap(rects in prop::collection::vec(rect(), 0..9), window in (0_u32..15, 0_u32..16)) {
            let all = Rect { columns: 0..15, rows: 0..15 };
            let occupied = Occupied::new(Some(&rects), 16, &all);
            let touches = |x: u32, y: u32| {
                let meets = |tile: u32, samples: &Range<u32>| {
                    !samples.is_empty() && tile * 16 < samples.end && samples.start <= tile * 16 + 16
                };
                rects.iter().any(|rect| meets(x, &rect.columns) && meets(y, &rect.rows))
            };
            let columns = window.0..window.0 + window.1;
            for y in 0..15 {
                let runs = occupied.runs(y, &columns);
                for x in 0..15 {
                    let expected = columns.contains(&x) && touches(x, y);
                    prop_assert_eq!(runs.iter().any(|run| run.contains(&x)), expected, "{}/{}", x, y);
                }
                prop_assert!(runs.windows(2).all(|pair| pair[0].end < pair[1].start));
            }
            for up in 0..4_u8 {
                let side = (15 >> up) + 1;
                let has = |x: u32, y: u32| {
                    let below = |v: u32| v << up..((v + 1) << up).min(15);
                    below(y).any(|y| below(x).any(|x| touches(x, y)))
                };
                let inside = |x: u32, y: u32| {
                    let below = |v: u32| v << up..((v + 1) << up).min(15);
                    below(y).any(|y| below(x).any(|x| columns.contains(&x) && touches(x, y)))
                };
                let count = (0..side).flat_map(|y| (0..side).map(move |x| (x, y))).filter(|&(x, y)| has(x, y)).count();
                prop_assert_eq!(occupied.count(up), count as u64);
                let widest = (0..side).map(|y| (0..side).filter(|&x| inside(x, y)).count()).max().unwrap_or(0);
                prop_assert_eq!(occupied.widest(up, &columns), widest as u64);
            }
        }
    }
}
