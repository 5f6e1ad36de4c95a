//! Runs over a window: bands of the source become rows of leaf tiles, which go through the sweep, with checkpoints.
//!
//! While a row is worked on, the next band is read.

use std::fs::File;
use std::time::Instant;

use super::bands::Bands;
use super::begun::Begun;
use super::buffers::Buffers;
use super::checkpoint::Checkpoints;
use super::job::Job;
use super::options::CHECKPOINT;
use super::reach::Reach;
use super::seam::SeamFile;
use super::state::{State, difference};
use super::sweep::{Output, Sweep};
use super::tally::Tally;
use crate::error::{Error, Result};
use crate::progress::Stage;
use crate::work_folder::NewState;
use crate::writer::ContainerWriter;

/// A window all of whose rows have been through the sweep.
pub struct Done {
    /// Has all tiles that could be finished.
    pub writer: ContainerWriter,
    /// What has been counted.
    pub tally: Tally,
    /// The state to be kept with a piece.
    state: Vec<u8>,
}

impl Done {
    /// Nothing left to be merged.
    pub fn new(writer: ContainerWriter, tally: Tally) -> Self {
        Self { writer, tally, state: Vec::new() }
    }

    /// Gives the work folder the output's name.
    pub fn into_piece(self) -> Result<()> {
        self.writer.finish_piece(&self.state)
    }
}

/// Runs over the window of a build.
pub fn run(job: &Job<'_>, begun: Begun) -> Result<Done> {
    let Begun { work, mut state, seams, resumed } = begun;
    let writer =
        if resumed { ContainerWriter::resume(work, &state.mark)? } else { ContainerWriter::begin(work)? };
    // The old seam file belongs to the old state until there is a new one.
    let generation: u64 = state.seam.0.rsplit('-').next().and_then(|n| n.parse().ok()).unwrap_or(0);
    let name = format!("seam-{}", generation + u64::from(resumed));
    let seam = SeamFile::create(writer.store().folder().path(&name))?;
    state.seam = (name, 0);
    let reach = Reach::new(&job.plan.pyramid, &state.window);
    let buffers = Buffers::default();
    let output = Output { writer, tally: state.tally.clone(), seam };
    let sweep = Sweep::new(&job.plan, &buffers, reach, output, seams);
    let checkpoints = Checkpoints::new(job.options.checkpoint.unwrap_or(CHECKPOINT), resumed);
    let mut run = Run { job, buffers: &buffers, state, sweep, checkpoints };
    let result = run.rows();
    run.end(result)
}

struct Run<'a> {
    job: &'a Job<'a>,
    buffers: &'a Buffers,
    state: State,
    sweep: Sweep<'a>,
    checkpoints: Checkpoints,
}

impl Run<'_> {
    /// Sends all rows of the window, and those around it, through the sweep.
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
                if self.job.progress.cancelled() {
                    return Err(Error::Interrupted);
                }
                let (this, next) = (this?, rows.next());
                let (y, first) = (this.y, self.state.next);
                let sweep = &mut self.sweep;
                let (pushed, read) = rayon::join(|| sweep.push(this), || next.map(|y| bands.row(y, first)));
                pushed?;
                row = read;
                self.job.progress.rows(Stage::Build, pyramid.rows_down_to(y), u64::from(pyramid.height));
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

    /// Writes the state, of which the rows before `next` are finished.
    fn checkpoint(&mut self, next: u32) -> Result<()> {
        let begun = Instant::now();
        self.check_source()?;
        let mut new = NewState::create(self.sweep.writer().store().folder().folder())?;
        let files = self.snapshot(next, &mut |bytes| new.append(bytes))?;
        self.checkpoints.publish(files, new, begun);
        Ok(())
    }

    /// Gives `put` the state as bytes; gives back the files to be synced before it counts.
    fn snapshot(&mut self, next: u32, put: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<Vec<File>> {
        self.sweep.settle()?;
        let mark = self.sweep.writer().store_mut().mark()?;
        let mut files = self.sweep.writer().store().files()?;
        let (length, file) = self.sweep.seam().mark()?;
        files.push(file);
        let seam = (self.state.seam.0.clone(), length);
        let state = State { next, mark, seam, tally: self.sweep.tally().clone(), ..self.state.clone() };
        put(&state.encode()?)?;
        self.sweep.standing(put)?;
        Ok(files)
    }

    /// Fails if the source is not what it was when the build began.
    fn check_source(&self) -> Result<()> {
        let now = self.job.source.fingerprint()?;
        if now == self.state.fingerprint {
            return Ok(());
        }
        let how = difference(&self.state.fingerprint, &now);
        Err(Error::usage(format!("the input has changed while it was read: {how}; begin anew with --force")))
    }

    /// Ends the run, well or not: the folder is kept if there is a state to go on from.
    fn end(mut self, result: Result<()>) -> Result<Done> {
        let result = result.and_then(|()| {
            self.checkpoints.wait()?;
            let mut state = Vec::new();
            let files = self.snapshot(self.state.next, &mut |bytes| {
                state.extend_from_slice(bytes);
                Ok(())
            })?;
            if self.checkpoints.is_written() {
                // Putting the file together may fail too.
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
        let Output { writer, tally, .. } = self.sweep.into_output();
        Ok(Done { writer, tally, state })
    }
}
