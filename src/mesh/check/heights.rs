//! Where the heights of the terrain come from: a raster, or the leaves of a file.

use std::ops::Range;

use rayon::prelude::*;

use crate::container::reader::Reader;
use crate::error::{Error, Result};
use crate::sample::{Coding, Lattice, VALID};
use crate::source::Source;
use crate::tile::TileId;

/// Heights of all samples of a terrain, window by window.
pub trait Heights: Sync {
    /// Columns and rows.
    fn size(&self) -> [u32; 2];

    /// Heights of a window in metres, row by row; NaN where void. The window lies within the
    /// terrain.
    fn window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Vec<f64>>;

    /// True if heights fall where the numbers in the file rise, as those of depths do. The height
    /// of a void sample beside valid ones is the lower median of numbers, not of heights.
    fn falls(&self) -> bool {
        false
    }
}

/// The heights of a raster.
pub struct Raster<'a>(pub &'a dyn Source);

impl Heights for Raster<'_> {
    fn size(&self) -> [u32; 2] {
        [self.0.info().width, self.0.info().height]
    }

    fn window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Vec<f64>> {
        let info = self.0.info();
        let (count, nodata) = (columns.len() * rows.len(), info.voids());
        let window = self.0.read_window(columns, rows)?;
        if window.samples.len() != count {
            return Err(Error::internal("a source gave a window of another size"));
        }
        let height = |at: usize| {
            let value = window.samples.value(at);
            let metres = (info.band_offset + info.band_scale * value) * info.vertical_unit.0;
            if window.is_void(at, nodata) { f64::NAN } else { metres }
        };
        let heights = (0..count).map(height).collect();
        self.0.take_back(window);
        Ok(heights)
    }

    fn falls(&self) -> bool {
        self.0.info().band_scale < 0.0
    }
}

/// The heights of a file, as its leaves have them.
pub struct Leaves<'a>(pub &'a Reader);

impl Leaves<'_> {
    /// The leaf of the finest level in a place; `None` if all there is void.
    fn leaf(&self, id: TileId) -> Result<Option<TileId>> {
        if self.0.entry(id)?.is_some() {
            return Ok(Some(id));
        }
        let mut above = id.parent();
        while let Some(parent) = above {
            match self.0.entry(parent)? {
                Some(entry) if entry.is_leaf() => {
                    let hint = "compare with the raster that it was made of";
                    return Err(
                        Error::unsupported("a file with leaves of several levels", hint).at(self.0.path())
                    );
                }
                Some(_) => return Ok(None),
                None => above = parent.parent(),
            }
        }
        Ok(None)
    }
}

impl Heights for Leaves<'_> {
    fn size(&self) -> [u32; 2] {
        [self.0.header().width, self.0.header().height]
    }

    fn window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Vec<f64>> {
        let header = self.0.header();
        let tile = header.tile();
        let width = columns.len();
        let mut heights = vec![f64::NAN; width * rows.len()];
        let last = (1_u32 << header.levels) - 1;
        let tiles = |range: &Range<u32>| {
            (range.start / tile).min(last)..=(range.end.saturating_sub(1) / tile).min(last)
        };
        for y in tiles(&rows) {
            let read = |x: u32| -> Result<Option<(TileId, std::sync::Arc<Lattice>)>> {
                let leaf = self.leaf(TileId::new(header.levels, x, y))?;
                leaf.map(|id| Ok((id, self.0.read_tile(id)?))).transpose()
            };
            let row: Vec<_> = tiles(&columns).into_par_iter().map(read).collect::<Result<_>>()?;
            for (id, lattice) in row.into_iter().flatten() {
                let (left, top) = (id.x * tile, id.y * tile);
                let within =
                    |first: u32, range: &Range<u32>| range.start.max(first)..range.end.min(first + tile + 1);
                for r in within(top, &rows) {
                    for c in within(left, &columns) {
                        let at = lattice.at((c - left) as usize, (r - top) as usize);
                        let to = (r - rows.start) as usize * width + (c - columns.start) as usize;
                        if lattice.state[at] == VALID {
                            heights[to] = header.metres_of(lattice.code[at], lattice.low_at(at));
                        }
                    }
                }
            }
        }
        Ok(heights)
    }

    fn falls(&self) -> bool {
        let header = self.0.header();
        let scale = if let Coding::Integer { scale, .. } = header.coding { scale } else { 1.0 };
        (header.band_scale < 0.0) != (scale < 0.0)
    }
}
