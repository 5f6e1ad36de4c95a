//! [`Rect`]: a rectangle of samples, or of the tiles of a level.

use std::ops::Range;

use wincode::{SchemaRead, SchemaWrite};

/// A rectangle of columns and rows: of the samples of a raster, or of the tiles of a level.
#[derive(Clone, Debug, PartialEq, Eq, SchemaRead, SchemaWrite)]
pub struct Rect {
    /// Columns, from the west.
    pub columns: Range<u32>,
    /// Rows, from the north.
    pub rows: Range<u32>,
}

impl std::fmt::Display for Rect {
    /// West, north, east and south side, as `--window` takes them.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { columns, rows } = self;
        write!(f, "{},{},{},{}", columns.start, rows.start, columns.end, rows.end)
    }
}

impl Rect {
    /// True if column `x` and row `y` are in it.
    pub fn contains(&self, x: u32, y: u32) -> bool {
        self.columns.contains(&x) && self.rows.contains(&y)
    }

    /// True if nothing is in it.
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty() || self.rows.is_empty()
    }

    /// True if all of `other` is in it.
    pub fn covers(&self, other: &Self) -> bool {
        let within = |a: &Range<u32>, b: &Range<u32>| a.start <= b.start && b.end <= a.end;
        within(&self.columns, &other.columns) && within(&self.rows, &other.rows)
    }

    /// What both have in common; empty if they have nothing.
    #[must_use]
    pub fn common(&self, other: &Self) -> Self {
        self.within(&other.columns, &other.rows)
    }

    /// The part of it in some columns and rows; empty if there is none.
    #[must_use]
    pub fn within(&self, columns: &Range<u32>, rows: &Range<u32>) -> Self {
        let both = |a: &Range<u32>, b: &Range<u32>| {
            let (start, end) = (a.start.max(b.start), a.end.min(b.end));
            start..end.max(start)
        };
        Self { columns: both(&self.columns, columns), rows: both(&self.rows, rows) }
    }

    /// Number of columns times rows.
    pub(crate) fn area(&self) -> usize {
        self.columns.len() * self.rows.len()
    }
}
