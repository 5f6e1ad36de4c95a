//! Runs over a window: bands of the source become rows of leaf tiles, which go through the sweep,
//! with checkpoints.
//!
//! While a row is worked on, the next band is read.

use std::fs::File;
use std::path::PathBuf;
use std::time::Instant;

use super::bands::Bands;
use super::begun::Begun;
use super::buffers::Buffers;
use super::carry::CarryFile;
use super::checkpoint::Checkpoints;
use super::job::Job;
use super::options::CHECKPOINT;
use super::state::{State, difference};
use super::statistics::StatisticsBuilder;
use super::sweep::{Output, Sweep};
use super::window_levels::WindowLevels;
use crate::error::{Error, Result};
use crate::progress::Stage;
use crate::work_folder::NewState;
use crate::writer::ContainerWriter;

/// A window whose rows have all been through the sweep.
pub struct Done {
    /// Has all tiles that could be finished.
    pub writer: ContainerWriter,
    /// What has been counted.
    pub statistics: StatisticsBuilder,
    /// The state to be kept with a piece.
    state: Vec<u8>,
}

impl Done {
    /// A whole raster: nothing is left for a merge.
    pub fn new(writer: ContainerWriter, statistics: StatisticsBuilder) -> Self {
        Self { writer, statistics, state: Vec::new() }
    }

    /// Makes the work folder a piece.
    pub fn into_piece(self) -> Result<()> {
        self.writer.finish_piece(&self.state)
    }
}

/// Runs over the window of a build.
pub fn run(job: &Job<'_>, begun: Begun) -> Result<Done> {
    let Begun { work, mut state, carried, resumed } = begun;
    let writer =
        if resumed { ContainerWriter::resume(work, &state.mark)? } else { ContainerWriter::begin(work)? };
    // The old carry file belongs to the old state until there is a new one.
    let generation: u64 = state.carry.0.rsplit('-').next().and_then(|n| n.parse().ok()).unwrap_or(0);
    let name = format!("seam-{}", generation + u64::from(resumed));
    let carry = CarryFile::create(writer.store().folder().path(&name))?;
    state.carry = (name, 0);
    let window_levels = WindowLevels::new(&job.plan.pyramid, &state.window);
    let buffers = Buffers::default();
    let output = Output { writer, statistics: state.statistics.clone(), carry };
    let sweep = Sweep::new(&job.plan, &buffers, window_levels, output, carried);
    let checkpoints = Checkpoints::new(job.options.checkpoint.unwrap_or(CHECKPOINT), resumed);
    let mut run = Run { job, buffers: &buffers, state, sweep, checkpoints };
    let result = run.rows();
    run.end(result)
}

/// A run in progress.
struct Run<'a> {
    job: &'a Job<'a>,
    buffers: &'a Buffers,
    state: State,
    sweep: Sweep<'a>,
    checkpoints: Checkpoints,
}

impl Run<'_> {
    /// Sends all rows of the window, and the rows next to it, through the sweep.
    fn rows(&mut self) -> Result<()> {
        for y in self.state.window.rows.start..self.state.next {
            self.sweep.pass(y)?;
        }
        let pyramid = self.job.plan.pyramid;
        let last = pyramid.leaves().rows.end;
        if self.state.next < self.state.window.rows.end {
            let mut rows = self.state.next.saturating_sub(1)..(self.state.window.rows.end + 1).min(last);
            let bands = Bands { job: self.job, buffers: self.buffers, window: self.state.window.clone() };
            let mut row = rows.next().map(|y| bands.row(y, self.state.next));
            while let Some(this) = row.take() {
                if self.job.progress.is_cancelled() {
                    return Err(Error::Interrupted);
                }
                let (this, next) = (this?, rows.next());
                let (y, first) = (this.y, self.state.next);
                let sweep = &mut self.sweep;
                let (pushed, read) = rayon::join(|| sweep.push(this), || next.map(|y| bands.row(y, first)));
                pushed?;
                row = read;
                self.job.progress.report(Stage::Build, pyramid.rows_down_to(y), u64::from(pyramid.height));
                if self.state.window.rows.contains(&y) && y > self.state.next && self.checkpoints.is_due()? {
                    self.checkpoint(y)?;
                }
            }
            self.check_source()?;
        }
        self.sweep.finish()?;
        self.state.next = self.state.window.rows.end;
        Ok(())
    }

    /// Writes the state, in which the rows before `next` are finished.
    fn checkpoint(&mut self, next: u32) -> Result<()> {
        let begun = Instant::now();
        self.check_source()?;
        let mut new = NewState::create(self.sweep.writer().store().folder().folder())?;
        let files = self.snapshot(next, &mut |bytes| new.append(bytes))?;
        self.checkpoints.publish(files, new, begun);
        Ok(())
    }

    /// Hands the state to `put` as bytes. Returns the files that must be synced before the state
    /// counts.
    fn snapshot(&mut self, next: u32, put: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<Vec<File>> {
        self.sweep.settle()?;
        let mark = self.sweep.writer().store_mut().mark()?;
        let mut files = self.sweep.writer().store().files()?;
        let (length, file) = self.sweep.carry_file().mark()?;
        files.push(file);
        let carry = (self.state.carry.0.clone(), length);
        let state =
            State { next, mark, carry, statistics: self.sweep.statistics().clone(), ..self.state.clone() };
        put(&state.encode()?)?;
        self.sweep.carry_all(put)?;
        Ok(files)
    }

    /// Fails if the source is not what it was when the build began.
    fn check_source(&self) -> Result<()> {
        let now = self.job.source.fingerprint()?;
        if now == self.state.fingerprint {
            return Ok(());
        }
        let how = difference(&self.state.fingerprint, &now);
        let how = format!("the input has changed while it was read: {how}; `force` begins anew");
        Err(Error::Changed { path: PathBuf::new(), how })
    }

    /// Ends the run, whether it failed or not. The folder is kept if it holds a state to go on
    /// from.
    fn end(mut self, result: Result<()>) -> Result<Done> {
        let result = result.and_then(|()| {
            self.checkpoints.wait()?;
            let mut state = Vec::new();
            let files = self.snapshot(self.state.next, &mut |bytes| {
                state.extend_from_slice(bytes);
                Ok(())
            })?;
            if self.checkpoints.is_written() {
                // The build may still fail when the file is put together, and then be resumed.
                let mut new = NewState::create(self.sweep.writer().store().folder().folder())?;
                new.append(&state)?;
                self.checkpoints.publish(files, new, Instant::now());
            }
            Ok(state)
        });
        let waited = self.checkpoints.wait();
        if self.checkpoints.is_written() {
            self.sweep.writer().store_mut().folder_mut().keep();
        }
        let state = result?;
        waited?;
        let Output { writer, statistics, .. } = self.sweep.into_output();
        Ok(Done { writer, statistics, state })
    }
}
