//! A raster that is warped block by block while it is read.
//!
//! Every sample is made as part of the same block whatever window is read, so windows, memory and
//! number of threads do not change a bit.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use rayon::prelude::*;

use super::blocks::Shared;
use super::operation::{Operation, Request, filled};
use super::{dataset, files};
use crate::error::Result;
use crate::source::{Fingerprint, Samples, Source, SourceInfo, Window, check_window};

/// A raster on another grid than its own.
pub(super) struct Warped {
    pub(super) path: PathBuf,
    pub(super) files: Vec<PathBuf>,
    pub(super) info: SourceInfo,
    pub(super) request: Request,
    /// Side of a block in samples.
    pub(super) side: u32,
    /// Number of this raster among those of the warp.
    pub(super) number: usize,
    pub(super) shared: Arc<Shared>,
}

impl Warped {
    /// Prepares an operation, as each thread will, to find out whether the request is valid.
    pub(super) fn check(&self) -> Result<()> {
        self.shared.put_back(self.number, self.operation()?);
        Ok(())
    }

    fn operation(&self) -> Result<Operation> {
        Operation::new(dataset(&self.path)?, &self.request)
    }

    /// A block by its column and row of blocks.
    fn block(&self, (column, row): (u32, u32)) -> Result<Arc<Samples>> {
        self.shared.block((self.number, column, row), || {
            let operation = self.shared.take(self.number).map_or_else(|| self.operation(), Ok)?;
            let (x, y) = (column * self.side, row * self.side);
            let (width, height) = (self.side.min(self.info.width - x), self.side.min(self.info.height - y));
            let block = operation.block([x, y, width, height]);
            self.shared.put_back(self.number, operation);
            block
        })
    }
}

impl Source for Warped {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window> {
        check_window(&self.info, &columns, &rows)?;
        let mut samples = filled(self.info.sample_type, columns.len() * rows.len(), 0.0);
        let blocks = |range: &Range<u32>| range.start / self.side..range.end.div_ceil(self.side);
        let ids: Vec<(u32, u32)> = blocks(&rows)
            .flat_map(|y| blocks(&columns).map(move |x| (x, y)))
            .filter(|_| !columns.is_empty() && !rows.is_empty())
            .collect();
        // A few at a time: otherwise a wide window would be in memory twice.
        for some in ids.chunks(8 * rayon::current_num_threads().max(1)) {
            let made: Vec<_> = some
                .par_iter()
                .map(|&id| self.block(id))
                .collect::<Result<_>>()
                .map_err(|error| error.at(&self.path))?;
            for (&(x, y), block) in some.iter().zip(&made) {
                let (left, top) = (x * self.side, y * self.side);
                let width = self.side.min(self.info.width - left);
                let height = self.side.min(self.info.height - top);
                let common = |range: &Range<u32>, start: u32, length: u32| {
                    range.start.max(start)..range.end.min(start + length)
                };
                let (across, down) = (common(&columns, left, width), common(&rows, top, height));
                for row in down {
                    let from = (row - top) as usize * width as usize + (across.start - left) as usize;
                    let to =
                        (row - rows.start) as usize * columns.len() + (across.start - columns.start) as usize;
                    copy(block, from, &mut samples, to, across.len());
                }
            }
        }
        Ok(Window { samples, mask: None })
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        files::fingerprint(&self.files)
    }

    fn files(&self) -> Vec<PathBuf> {
        self.files.clone()
    }
}

/// Copies `count` samples of a row; both must be of the same type.
fn copy(from: &Samples, start: usize, to: &mut Samples, at: usize, count: usize) {
    macro_rules! rows {
        ($($kind:ident),*) => {
            match (from, to) {
                $((Samples::$kind(from), Samples::$kind(to)) => {
                    to[at..at + count].copy_from_slice(&from[start..start + count]);
                })*
                _ => {}
            }
        };
    }
    rows!(Int8, Uint8, Int16, Uint16, Int32, Uint32, Float32, Float64);
}
