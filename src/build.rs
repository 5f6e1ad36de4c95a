//! [`Build`]: a file in the making, from a raster to a `.rlv` file.

use std::path::Path;

use crate::container::layout::Metric;
use crate::error::Result;
use crate::pipeline::imagery::{Imagery, LayerOptions};
use crate::pipeline::{self, BuildOptions, Plan, Report};
use crate::progress::{Progress, Silent};
use crate::rect::Rect;
use crate::source::Source;
use crate::source::picture::Picture;

/// A build: what it is made of, and how. [`Build::run`] makes the file.
///
/// ```
/// use relevo::{Build, Reader, source};
///
/// # fn main() -> relevo::Result<()> {
/// # let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
/// # let dem = root.join("fixtures/dem/rmnp_dem_uint16.tif");
/// # let folder = tempfile::tempdir().unwrap();
/// # let output = folder.path().join("rmnp.rlv");
/// let source = source::open(&dem, &relevo::Limits::default())?;
/// let report = Build::new(&*source).tile(64).patch(16).run(&output)?;
/// assert_eq!((report.header.width, report.header.levels), (152, 2));
/// assert_eq!(Reader::open(&output)?.file_len(), report.file.file_bytes);
/// # Ok(())
/// # }
/// ```
pub struct Build<'a> {
    source: &'a dyn Source,
    options: BuildOptions,
    imagery: Option<Imagery<'a>>,
    progress: &'a dyn Progress,
}

impl<'a> Build<'a> {
    /// A build of a source with tiles of 256 and patches of 32 intervals, lossless, on all cores.
    pub fn new(source: &'a dyn Source) -> Self {
        Self { source, options: BuildOptions::default(), imagery: None, progress: &Silent }
    }

    /// All options at once, in place of those that were given before.
    #[must_use]
    pub fn options(mut self, options: BuildOptions) -> Self {
        self.options = options;
        self
    }

    /// Intervals of a tile: a power of two in 16..=1024.
    #[must_use]
    pub fn tile(mut self, intervals: u32) -> Self {
        self.options.tile = intervals;
        self
    }

    /// Intervals of a patch: a power of two in 4..=64, at most those of a tile.
    #[must_use]
    pub fn patch(mut self, intervals: u32) -> Self {
        self.options.patch = intervals;
        self
    }

    /// The geometric error that is stored: [`Metric::Bound`] unless told otherwise.
    #[must_use]
    pub fn metric(mut self, metric: Metric) -> Self {
        self.options.metric = metric;
        self
    }

    /// Quantises heights to so many metres: they are off by at most half of it.
    #[must_use]
    pub fn precision(mut self, metres: f64) -> Self {
        self.options.precision_m = Some(metres);
        self
    }

    /// Threads, in place of one for each core.
    #[must_use]
    pub fn threads(mut self, count: usize) -> Self {
        self.options.jobs = Some(count);
        self
    }

    /// Bytes of memory that the build keeps within, or is refused before it begins.
    #[must_use]
    pub fn memory(mut self, bytes: u64) -> Self {
        self.options.memory = Some(bytes);
        self
    }

    /// Replaces an output that exists, and an unfinished build of it.
    #[must_use]
    pub fn replace(mut self) -> Self {
        self.options.force = true;
        self
    }

    /// Goes on with an unfinished build of the output, if there is one.
    #[must_use]
    pub fn resume(mut self) -> Self {
        self.options.resume = true;
        self
    }

    /// Makes errors of warnings: then nothing is built.
    #[must_use]
    pub fn strict(mut self) -> Self {
        self.options.strict = true;
        self
    }

    /// Lays pictures over the heights, the last on top.
    #[must_use]
    pub fn imagery(mut self, pictures: &'a [Box<dyn Picture>], options: LayerOptions) -> Self {
        self.imagery = (!pictures.is_empty()).then_some(Imagery { pictures, options });
        self
    }

    /// What hears how far the build is, and says whether it is to stop.
    #[must_use]
    pub fn progress(mut self, progress: &'a dyn Progress) -> Self {
        self.progress = progress;
        self
    }

    /// What the file will be, and the memory that it takes to make it.
    ///
    /// # Errors
    /// [`crate::Error::Usage`] for options that no build can have.
    pub fn plan(&self) -> Result<Plan> {
        pipeline::plan(self.source.info(), &self.options)
    }

    /// Makes the file; it has its name when it is whole.
    ///
    /// # Errors
    /// Those of the source and of the system; on any of them no output is written. If the build has
    /// reached its first checkpoint its work folder stays, and [`Build::resume`] goes on from
    /// there.
    pub fn run(&self, output: &Path) -> Result<Report> {
        pipeline::build_with(self.source, self.imagery.as_ref(), output, &self.options, self.progress)
    }

    /// Makes a piece: a folder with what can be made of a window of leaf tiles alone, for
    /// [`merge`](crate::merge).
    ///
    /// # Errors
    /// As [`Build::run`], and [`crate::Error::Usage`] for a window that is not in the lattice, or
    /// with imagery.
    pub fn run_window(&self, output: &Path, window: &Rect) -> Result<()> {
        if self.imagery.is_some() {
            return Err(crate::Error::usage(
                "a window of a build takes no imagery: add it to the merged file",
            ));
        }
        pipeline::build_window(self.source, output, window, &self.options, self.progress)
    }
}
