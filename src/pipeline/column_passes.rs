//! A build within a limit of memory: strips of columns one after the other, each a window of its
//! own, then a merge.
//!
//! Memory grows with the width of what is built at once. Each pass makes a piece in the work folder
//! of the output. When the build is resumed, a finished pass is not built again, and an unfinished
//! one goes on from its own checkpoint.

use std::ops::Range;
use std::path::PathBuf;
use std::time::Instant;

use super::begun::Begun;
use super::imagery::Imagery;
use super::job::Job;
use super::options::BuildOptions;
use super::plan::Plan;
use super::report::Report;
use super::{memory, merge, run};
use crate::error::{Error, Result};
use crate::progress::{Progress, Stage};
use crate::rect::Rect;

/// Columns of tiles on either side of a pass that are read with it.
const HALO: u32 = 1;

/// Runs the passes that are not finished yet, and joins their pieces.
pub fn build(
    job: &Job<'_>,
    imagery: Option<&Imagery<'_>>,
    begun: Begun,
    passes: Vec<Rect>,
    start: Instant,
) -> Result<Report> {
    let new = begun.is_new();
    let (mut work, mut state) = begun.into_work();
    if new {
        state.passes = passes;
        // From here on the build can be resumed.
        work.write_state(&state.encode()?)?;
    }
    let pieces: Vec<PathBuf> =
        (0..state.passes.len()).map(|i| work.folder().join(format!("strip-{i:03}"))).collect();
    for (i, (pass, piece)) in state.passes.iter().zip(&pieces).enumerate() {
        if piece.is_dir() {
            continue;
        }
        let options = BuildOptions { resume: true, force: false, ..job.options.clone() };
        let progress = Pass { progress: job.progress, before: i as u64, of: pieces.len() as u64 };
        let largest = Some(state.largest);
        let mut job =
            Job { source: job.source, plan: job.plan.clone(), options: &options, progress: &progress };
        let begun = Begun::new(&mut job, piece, pass.clone(), largest)?;
        run::run(&job, begun)?.into_piece()?;
        // The next pass decodes again what it shares with this one: keeping it would take the
        // memory twice.
        job.source.release();
    }
    merge::join(&pieces, |_, _| Ok(work), imagery, job.options.strict, job.progress, start)
}

/// Numbers of passes that are tried: all up to 32, then in growing steps, up to one for every
/// column of tiles.
fn counts(columns: u64) -> impl Iterator<Item = u64> {
    let next = move |&count: &u64| (count < columns).then(|| (count + 1 + count / 32).min(columns));
    std::iter::successors((columns >= 2).then_some(2), next)
}

/// Reports the progress of all passes as that of one build.
struct Pass<'a> {
    progress: &'a dyn Progress,
    before: u64,
    of: u64,
}

impl Progress for Pass<'_> {
    fn report(&self, stage: Stage, done: u64, total: u64) {
        self.progress.report(stage, self.before * total + done, self.of * total);
    }

    fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled()
    }
}

/// The windows to build one after the other so that none needs more than `limit` bytes: as few as
/// possible, about equally wide.
///
/// # Errors
/// [`Error::Usage`] if that is not enough for a pass of one column of tiles.
pub fn windows(plan: &Plan, limit: Option<u64>) -> Result<Vec<Rect>> {
    let all = plan.pyramid.leaves();
    let columns = u64::from(all.columns.end);
    let Some(limit) = limit.filter(|&limit| memory::estimate(plan, &all.columns) > limit) else {
        return Ok(vec![all]);
    };
    let narrowest = cut(plan, columns).iter().map(|pass| memory_beside(plan, &pass.columns)).max();
    if let Some(narrowest) = narrowest.filter(|&narrowest| narrowest > limit) {
        return Err(too_narrow(plan, narrowest));
    }
    let fitting = counts(columns).map(|count| cut(plan, count));
    fitting.into_iter().find(|passes| memory_of(plan, passes) <= limit).ok_or_else(|| {
        too_little(plan, "it is joining the strips that takes it; allow that, or use smaller tiles")
    })
}

/// The windows of `count` passes, about equally wide.
fn cut(plan: &Plan, count: u64) -> Vec<Rect> {
    let all = plan.pyramid.leaves();
    let column = |i: u64| (u64::from(all.columns.end) * i / count) as u32;
    let pass = |i| Rect { columns: column(i)..column(i + 1), rows: all.rows.clone() };
    (0..count).map(pass).collect()
}

/// The error that names the least memory that is enough. Narrow passes take little, but joining
/// many takes more.
fn too_little(plan: &Plan, why: &str) -> Error {
    let columns = u64::from(plan.pyramid.leaves().columns.end);
    let of_strips = counts(columns).map(|count| memory_of(plan, &cut(plan, count)));
    let least = of_strips.chain([memory_of(plan, &[])]).min().unwrap_or(0).div_ceil(1 << 20);
    let (width, side, jobs) = (plan.pyramid.width, plan.pyramid.tile, plan.jobs);
    Error::usage(format!(
        "`memory`: a raster {width} samples wide takes {least} MiB at least, with tiles of {side} x {side} on {jobs} threads; {why}"
    ))
}

/// The error if a pass of one column of tiles takes more than the limit.
fn too_narrow(plan: &Plan, narrowest: u64) -> Error {
    let reading = memory::of_reading(plan, &(0..2 * HALO + 1));
    if reading <= narrowest / 2 {
        return too_little(plan, "allow that, or use smaller tiles or fewer threads");
    }
    too_little(
        plan,
        &format!(
            "{} MiB of it to decode the blocks of the input, which are read whole; allow that, use fewer threads, or cut it \
         into smaller blocks (gdal_translate -co TILED=YES)",
            reading.div_ceil(1 << 20)
        ),
    )
}

/// [`memory::estimate`] of a pass, with the columns beside it that are read with it.
fn memory_beside(plan: &Plan, pass: &Range<u32>) -> u64 {
    memory::estimate(plan, &(pass.start.saturating_sub(HALO)..pass.end + HALO))
}

/// Bytes of memory that a build in these passes takes at most. None or one: a build in one go.
pub fn memory_of(plan: &Plan, passes: &[Rect]) -> u64 {
    if passes.len() < 2 {
        return memory::estimate(plan, &plan.pyramid.leaves().columns);
    }
    let widest = passes.iter().map(|pass| memory_beside(plan, &pass.columns)).max();
    widest.unwrap_or(0).max(memory::of_merge(plan, passes))
}

/// Fails if a build that was begun in these passes (none: in one go) takes more than `limit`.
pub fn check_limit(plan: &Plan, passes: &[Rect], limit: Option<u64>) -> Result<()> {
    let needed = memory_of(plan, passes);
    if limit.is_none_or(|limit| needed <= limit) {
        return Ok(());
    }
    Err(Error::usage(format!(
        "`memory`: the unfinished build was begun with more and may take {} MiB: resume it with that, or begin anew by `force`",
        needed.div_ceil(1 << 20)
    )))
}

/// Bytes of memory that a build with these options takes at most, imagery not counted.
pub fn memory_estimate(plan: &Plan, options: &BuildOptions) -> Result<u64> {
    Ok(memory_of(plan, &windows(plan, options.memory)?))
}
