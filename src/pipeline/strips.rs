//! A build within a limit of memory: strips of columns one after the other, each a window of its own, then merged.
//!
//! Memory grows with the width of what is worked on at once. The strips lie as pieces in the work folder of the output; one that is
//! finished is not built again when the build is resumed, and one that is not goes on from its own checkpoint.

use std::ops::Range;
use std::path::PathBuf;
use std::time::Instant;

use crate::error::{Error, Result};
use crate::pipeline::imagery::Imagery;
use crate::pipeline::plan::Plan;
use crate::pipeline::reach::Extent;
use crate::pipeline::run::Begun;
use crate::pipeline::{BuildOptions, Observer, Report, Stage, merge};
use crate::source::Source;

/// Columns of tiles on either side of a strip that are read with it.
const HALO: u32 = 1;

/// Builds the strips that are not there yet, and joins them.
pub fn build(
    (source, imagery): (&dyn Source, Option<&Imagery<'_>>),
    begun: Begun,
    strips: Vec<Extent>,
    options: &BuildOptions,
    observer: &dyn Observer,
    plan: &Plan,
    start: Instant,
) -> Result<Report> {
    let new = begun.is_new();
    let (mut work, mut state) = begun.into_work();
    if new {
        state.strips = strips;
        // From here on there is something to resume.
        work.write_state(&state.encode()?)?;
    }
    let pieces: Vec<PathBuf> =
        (0..state.strips.len()).map(|i| work.folder().join(format!("strip-{i:03}"))).collect();
    for (i, (strip, piece)) in state.strips.iter().zip(&pieces).enumerate() {
        if piece.is_dir() {
            continue;
        }
        let options = BuildOptions { resume: true, force: false, ..options.clone() };
        let observer = Strip { observer, before: i as u64, of: pieces.len() as u64 };
        let mut plan = plan.clone();
        let largest = Some(state.largest);
        let begun = Begun::new(source, piece, &options, &observer, &mut plan, strip.clone(), largest)?;
        begun.run(source, &options, &observer, &plan)?.into_piece()?;
        // The next strip decodes again what it shares with this one: to keep it for that would be to have it twice.
        source.release();
    }
    merge::join(&pieces, |_, _| Ok(work), (imagery, options.strict), observer, start)
}

/// Numbers of strips that are tried: all up to 32, then each a little more, up to one for every column of tiles.
fn counts(columns: u64) -> impl Iterator<Item = u64> {
    let next = move |&count: &u64| (count < columns).then(|| (count + 1 + count / 32).min(columns));
    std::iter::successors((columns >= 2).then_some(2), next)
}

/// Tells of the strips as of one build.
struct Strip<'a> {
    observer: &'a dyn Observer,
    before: u64,
    of: u64,
}

impl Observer for Strip<'_> {
    fn rows(&self, stage: Stage, done: u64, total: u64) {
        self.observer.rows(stage, self.before * total + done, self.of * total);
    }

    fn cancelled(&self) -> bool {
        self.observer.cancelled()
    }
}

impl Plan {
    /// The windows to build one after the other so that none needs more than `limit` bytes: as few as possible, about equally wide.
    ///
    /// # Errors
    /// [`Error::Usage`] if that is not enough for a strip of one tile.
    pub fn strips(&self, limit: Option<u64>) -> Result<Vec<Extent>> {
        let all = Extent::of_level(self, self.levels);
        let columns = u64::from(all.columns.end);
        let Some(limit) = limit.filter(|&limit| self.memory(&all.columns) > limit) else {
            return Ok(vec![all]);
        };
        let narrowest = self.cut(columns).iter().map(|strip| self.memory_beside(&strip.columns)).max();
        if let Some(narrowest) = narrowest.filter(|&narrowest| narrowest > limit) {
            return Err(self.too_narrow(narrowest));
        }
        let fitting = counts(columns).map(|count| self.cut(count));
        fitting.into_iter().find(|strips| self.memory_in_strips(strips) <= limit).ok_or_else(|| {
            self.too_little("it is joining the strips that takes it; allow that, or use smaller tiles")
        })
    }

    /// As many strips, about equally wide.
    fn cut(&self, count: u64) -> Vec<Extent> {
        let all = Extent::of_level(self, self.levels);
        let column = |i: u64| (u64::from(all.columns.end) * i / count) as u32;
        let strip = |i| Extent { columns: column(i)..column(i + 1), rows: all.rows.clone() };
        (0..count).map(strip).collect()
    }

    /// Says the least memory that is enough at this width: narrow strips take little, but many of them are more to join.
    fn too_little(&self, why: &str) -> Error {
        let columns = u64::from(Extent::of_level(self, self.levels).columns.end);
        let of_strips = counts(columns).map(|count| self.memory_in_strips(&self.cut(count)));
        let least = of_strips.chain([self.memory_in_strips(&[])]).min().unwrap_or(0).div_ceil(1 << 20);
        let (width, side, jobs) = (self.width, self.tile, self.jobs);
        Error::usage(format!(
            "--memory: a raster {width} samples wide takes {least} MiB at least, with tiles of {side} x {side} on {jobs} threads; {why}"
        ))
    }

    /// Not even a strip of one tile is within the limit.
    fn too_narrow(&self, narrowest: u64) -> Error {
        let reading = self.memory_of_reading(&(0..2 * HALO + 1));
        if reading <= narrowest / 2 {
            return self.too_little("allow that, or use smaller tiles or fewer threads");
        }
        self.too_little(&format!(
            "{} MiB of it to decode the blocks of the input, which are read whole; allow that, use fewer threads, or cut it \
             into smaller blocks (gdal_translate -co TILED=YES)",
            reading.div_ceil(1 << 20)
        ))
    }

    /// [`Plan::memory`] of a strip, with the columns beside it that are read with it.
    fn memory_beside(&self, strip: &Range<u32>) -> u64 {
        self.memory(&(strip.start.saturating_sub(HALO)..strip.end + HALO))
    }

    /// Bytes of memory that a build in these strips takes at most; none, or a single one: in one go.
    pub fn memory_in_strips(&self, strips: &[Extent]) -> u64 {
        if strips.len() < 2 {
            return self.memory(&Extent::of_level(self, self.levels).columns);
        }
        let widest = strips.iter().map(|strip| self.memory_beside(&strip.columns)).max();
        widest.unwrap_or(0).max(self.memory_to_merge(strips))
    }

    /// Fails if a build that was begun in these strips (none: in one go) takes more than `limit`.
    pub fn check_limit(&self, strips: &[Extent], limit: Option<u64>) -> Result<()> {
        let needed = self.memory_in_strips(strips);
        if limit.is_none_or(|limit| needed <= limit) {
            return Ok(());
        }
        Err(Error::usage(format!(
            "--memory: the unfinished build was begun with more and may take {} MiB: resume it with that, or begin anew with --force",
            needed.div_ceil(1 << 20)
        )))
    }
}
