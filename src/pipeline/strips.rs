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
    }
    merge::join(&pieces, || Ok(work), imagery, observer, start)
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
        let most = |strips: &[Range<u32>]| strips.iter().map(|strip| self.memory_beside(strip)).max();
        let strips = |count: u64| -> Vec<Range<u32>> {
            let column = |i: u64| (columns * i / count) as u32;
            (0..count).map(|i| column(i)..column(i + 1)).collect()
        };
        let narrowest = most(&strips(columns)).unwrap_or(0);
        if narrowest > limit {
            return Err(Error::usage(format!(
                "--memory: a strip of tiles of {} x {} takes about {} MiB on {} threads; allow more, or use smaller tiles or \
                 fewer threads",
                self.tile,
                self.tile,
                narrowest.div_ceil(1 << 20),
                self.jobs
            )));
        }
        let fitting = (2..=columns).map(strips).find(|strips| most(strips) <= Some(limit));
        let strips = fitting.unwrap_or_default();
        let strips: Vec<_> =
            strips.into_iter().map(|columns| Extent { columns, rows: all.rows.clone() }).collect();
        let joined = self.memory_to_merge(&strips);
        if joined > limit {
            return Err(Error::usage(format!(
                "--memory: to join the strips of {} tiles that fit takes about {} MiB on {} threads; allow more, or use smaller tiles",
                strips[0].columns.len(),
                joined.div_ceil(1 << 20),
                self.jobs
            )));
        }
        Ok(strips)
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
