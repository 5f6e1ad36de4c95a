//! Several rasters joined into one on a common lattice.
//!
//! A window is read only from the members that it meets, in parallel, and they are added in order:
//! the result does not depend on the number of threads. If one member covers the window alone its
//! samples are passed on unchanged. Files are opened when needed and closed when a sweep has passed
//! them, so ten thousand files work as well as ten, and each decodes no block twice in a sweep (see
//! `pool` for the one exception).
//!
//! A void never hides a valid sample, whatever the order. The sample type is the narrowest that
//! holds the samples of all members exactly. Voids are the nodata value if all members share one,
//! NaN in floats, and a mask for integers with different nodata values.

mod canvas;
mod index;
mod join;
mod lattice;
mod member;
mod pool;
mod same;

use std::ops::Range;
use std::path::PathBuf;

use rayon::prelude::*;

pub(crate) use self::canvas::holds_all;
use self::canvas::{Canvas, Number};
use self::index::Index;
pub use self::join::Piece;
pub(crate) use self::join::{Rule, common_nodata, kinds, member, parts, reading, vertical_unit};
pub(crate) use self::member::{Member, Scaled};
use self::pool::Pool;
pub(crate) use self::same::{crs_name, same_crs, same_unit};
use super::{FileStamp, Fingerprint, Nodata, Overlap, Rect, Source, SourceInfo, Window, check_window};
use crate::error::Result;
use crate::sample::SampleType;

/// Samples of members read ahead of adding them, as a multiple of the window's.
const AHEAD: usize = 2;

/// Several rasters on one lattice.
pub struct Mosaic {
    info: SourceInfo,
    members: Vec<Member>,
    index: Index,
    pool: Pool,
    overlap: Overlap,
    /// Value of void samples; `None`: a mask marks them.
    fill: Option<f64>,
    /// True if a valid sample of a member that equals `info.nodata` becomes void.
    nodata_of_all: bool,
    /// Files that describe the mosaic, such as a VRT.
    beside: Vec<PathBuf>,
}

/// The parts of a mosaic.
pub(crate) struct Assembly {
    /// Properties of the mosaic; files and footprint are those of the members.
    pub(crate) info: SourceInfo,
    /// Members in order, first to last.
    pub(crate) members: Vec<Member>,
    /// The rule for samples where members overlap.
    pub(crate) overlap: Overlap,
    /// True if a valid sample of a member that equals `info.nodata` becomes void.
    pub(crate) nodata_of_all: bool,
    /// Files that describe the mosaic, such as a VRT.
    pub(crate) beside: Vec<PathBuf>,
}

impl Mosaic {
    /// Builds a mosaic. Its sample type must hold those of all members, except of converted ones.
    pub(crate) fn assemble(assembly: Assembly) -> Self {
        let Assembly { mut info, members, overlap, nodata_of_all, beside } = assembly;
        info.footprint = footprint(&info, &members);
        info.overlap = (members.len() > 1).then_some(overlap);
        let index = Index::new(info.height, &members);
        let fill = info.voids().sample(info.sample_type).or(info.sample_type.is_float().then_some(f64::NAN));
        Self { info, members, index, pool: Pool::default(), overlap, fill, nodata_of_all, beside }
    }

    /// Samples of a window, read from the members and combined.
    fn compose<T: Number>(
        &self,
        columns: &Range<u32>,
        rows: &Range<u32>,
        wanted: &[usize],
    ) -> Result<Window> {
        let mut canvas = Canvas::<T>::new(columns, rows, self.overlap, self.fill)?;
        let nodata = if self.nodata_of_all { self.info.voids() } else { Nodata::NONE };
        let mut rest = wanted;
        while !rest.is_empty() {
            let (batch, later) = rest.split_at(self.batch(rest, columns, rows));
            let read = |&index: &usize| self.read_member(index, columns, rows);
            let windows: Vec<Result<Window>> = batch.par_iter().map(read).collect();
            for (&index, window) in batch.iter().zip(windows) {
                canvas.paint(&self.members[index], &window?, nodata);
            }
            rest = later;
        }
        Ok(canvas.finish())
    }

    /// Number of members to read at a time: those that take twice the memory of the window, at
    /// least one.
    fn batch(&self, members: &[usize], columns: &Range<u32>, rows: &Range<u32>) -> usize {
        let most = AHEAD * columns.len() * rows.len();
        let mut samples = 0_usize;
        let fits = |index: &&usize| {
            samples = samples.saturating_add(self.members[**index].common(columns, rows).area());
            samples <= most
        };
        members.iter().take_while(fits).count().max(1)
    }

    /// The samples of a member in a window of the mosaic.
    fn read_member(&self, index: usize, columns: &Range<u32>, rows: &Range<u32>) -> Result<Window> {
        let member = &self.members[index];
        let own = member.own(&member.common(columns, rows));
        let source = self.pool.source(index, member)?;
        source.read_window(own.columns, own.rows).map_err(|error| error.at(&member.path))
    }
}

impl Source for Mosaic {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window> {
        check_window(&self.info, &columns, &rows)?;
        self.pool.close_passed(&self.members, &rows);
        let wanted = self.index.meeting(&self.members, &columns, &rows);
        if let &[index] = &wanted[..]
            && self.members[index].is_plain(&self.info)
            && self.members[index].covers(&columns, &rows)
        {
            return self.read_member(index, &columns, &rows);
        }
        match self.info.sample_type {
            SampleType::Int8 => self.compose::<i8>(&columns, &rows, &wanted),
            SampleType::Uint8 => self.compose::<u8>(&columns, &rows, &wanted),
            SampleType::Int16 => self.compose::<i16>(&columns, &rows, &wanted),
            SampleType::Uint16 => self.compose::<u16>(&columns, &rows, &wanted),
            SampleType::Int32 => self.compose::<i32>(&columns, &rows, &wanted),
            SampleType::Uint32 => self.compose::<u32>(&columns, &rows, &wanted),
            SampleType::Float32 => self.compose::<f32>(&columns, &rows, &wanted),
            SampleType::Float64 => self.compose::<f64>(&columns, &rows, &wanted),
        }
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        let mut files: Vec<FileStamp> =
            self.beside.iter().map(|path| FileStamp::of(path)).collect::<Result<_>>()?;
        for member in &self.members {
            let stamps = member.open().and_then(|source| source.fingerprint());
            files.extend(stamps.map_err(|error| error.at(&member.path))?.files);
        }
        Ok(Fingerprint { files })
    }

    fn files(&self) -> Vec<PathBuf> {
        let of_members = self.members.iter().flat_map(|member| &member.files);
        self.beside.iter().chain(of_members).cloned().collect()
    }

    fn release(&self) {
        self.pool.clear();
    }
}

/// Rectangles that hold all valid samples; `None` if one member covers everything.
fn footprint(info: &SourceInfo, members: &[Member]) -> Option<Vec<Rect>> {
    let all = Rect { columns: 0..info.width, rows: 0..info.height };
    let rects: Vec<Rect> = members.iter().flat_map(|member| member.footprint.iter().cloned()).collect();
    (!rects.contains(&all)).then_some(rects)
}

#[cfg(test)]
mod tests;
