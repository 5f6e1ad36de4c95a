//! [`Report`]: what a build made.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::container::layout::Header;
use crate::container::metadata::Statistics;
use crate::pipeline::imagery::LayerReport;
use crate::writer::FileSummary;

/// What a build made.
#[derive(Clone, Debug)]
pub struct Report {
    /// Header of the file.
    pub header: Header,
    /// Statistics as stored in it.
    pub statistics: Statistics,
    /// Sizes.
    pub file: FileSummary,
    /// The imagery layer, if there is one.
    pub imagery: Option<LayerReport>,
    /// What the source warns of, then what the heights look like.
    pub warnings: Vec<String>,
    /// Where place, coordinate system, nodata and the like were found, as in the container's
    /// metadata.
    pub origins: BTreeMap<String, String>,
    /// Wall time.
    pub elapsed: Duration,
}
