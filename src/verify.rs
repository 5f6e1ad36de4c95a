//! Checks a container: checksums, structure and invariants; on request also every sample against
//! its source, and every error by brute force.
//!
//! Nothing here prints or repairs: whatever is wrong becomes a [`Problem`] in a [`VerifyReport`].
//! An `Err` means that the check could not be made. Values are recomputed independently: the
//! geometry here shares no formula with `patch`, and metres are computed in `ground`.
//!
//! # What nobody can check
//! A file that lies with care, about a thing that stands in it once, cannot be caught by itself:
//! - With its source only: size, geotransform with bounds and WKT, band scale, offset and unit
//!   (told alike in header, index, statistics), the samples, a tile left out that no other tile and
//!   no statistics tell of, `pixel_is_point` without keys, vertical systems.
//! - Not even then: `tool`, `sources`, `more_sources`, `name`, options but tile, patch, metric,
//!   nodata and precision, members and sections of other programs, optional features, the nodata
//!   value (a build may have been given another), the quality of JPEGs, what pictures showed,
//!   texels that should be there and the gutters of imagery tiles.
//! - Errors that are too large: they are bounds. How much too large, `deep` tells; the true
//!   horizontal ones are found from below, to about half a sample.
//! - What void samples without a fill decode to: it is never used.

mod about;
mod borders;
mod deep;
mod full;
mod ground;
mod hints;
mod imagery;
mod index;
mod memory;
mod outline;
mod paper;
mod range;
mod raster;
mod report;
mod shape;
mod statistics;
mod tables;
#[cfg(test)]
mod tests;
mod tiles;
mod values;
mod vertical;
mod wkt;
mod words;

pub use report::{Check, Place, Problem, Ratios, Tightness, VerifyReport};

use crate::container::layout::Metric;
use crate::container::reader::Reader;
use crate::error::{Error, Result};
use crate::geo::CrsKind;
use crate::progress::Progress;
use crate::source::Source;

/// What to check, and how many problems to report.
#[derive(Clone, Copy, Debug)]
pub struct VerifyOptions {
    /// Recompute every error by brute force. Needs the lattice of full resolution in memory.
    pub deep: bool,
    /// Most problems that each check keeps; all are counted.
    pub keep: usize,
    /// Most samples of full resolution for `deep` (2^28).
    pub max_deep_samples: u64,
}

impl Default for VerifyOptions {
    fn default() -> Self {
        Self { deep: false, keep: 10, max_deep_samples: 1 << 28 }
    }
}

/// Checks an open file.
///
/// Damage is a problem in the report, not an error; a disk that cannot be read, or a raster too
/// large for `deep`, is an error. If the reader has a memory limit (`ReaderOptions::memory`) the
/// source is read in fewer rows at a time, and a check that still exceeds the limit is refused at
/// the start.
pub fn verify(
    reader: &Reader,
    source: Option<&dyn Source>,
    options: &VerifyOptions,
    progress: &dyn Progress,
) -> Result<VerifyReport> {
    let shape = memory::shape(reader, source, options)?;
    let mut report = VerifyReport::default();
    report.checks.push(index::sections(reader, options)?);
    report.checks.push(index::pages(reader, options)?);
    report.checks.push(about::check(reader, options.keep));
    let (tables, checks) = tiles::check(reader, options, progress)?;
    report.checks.extend(checks);
    if let Some(layer) = reader.imagery() {
        report.checks.push(index::imagery_pages(reader, layer, options)?);
        report.checks.push(imagery::tiles(layer, options, progress)?);
    }
    if let Some(source) = source {
        report.checks.extend(raster::check(reader, source, shape, options, progress)?);
    }
    if options.deep {
        deep::check(reader, &tables, options, progress, &mut report)?;
    }
    report.checks.extend(unproven(reader, options.keep));
    Ok(report)
}

/// A check that was not made, with the reason: version 1 of the format left something open.
fn unproven(reader: &Reader, keep: usize) -> Option<Check> {
    let header = reader.header();
    let geographic = reader.geo().crs.kind == CrsKind::Geographic;
    (header.version == 1 && header.metric == Metric::Bound && geographic).then(|| {
        let mut check = Check::new("proof of horizontal errors", "files", keep);
        check.note = "horizontal errors of geographic rasters are not proven in files of version 1 of the format, where a tile reaches beyond \
                      the raster; build the file anew"
            .into();
        check
    })
}

/// The report of a file that the reader refused to open as damaged. Any other error is returned.
pub fn refused(error: Error) -> Result<VerifyReport> {
    let mut check = Check::new("opening", "files", 1);
    check.looked_at = 1;
    check.take(Err::<(), _>(error), Place::default())?;
    Ok(VerifyReport { checks: vec![check], tightness: Vec::new() })
}
