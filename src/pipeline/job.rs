//! [`Job`]: what every part of a build works with.

use super::options::BuildOptions;
use super::plan::Plan;
use crate::progress::Progress;
use crate::source::Source;

/// A build of one source: what it reads, how it goes about it, and what hears of its progress.
pub struct Job<'a> {
    /// The raster.
    pub source: &'a dyn Source,
    /// The pyramid that is built of it, and how.
    pub plan: Plan,
    /// What the build was asked for.
    pub options: &'a BuildOptions,
    /// Hears how far the build is, and says whether it is to stop.
    pub progress: &'a dyn Progress,
}
