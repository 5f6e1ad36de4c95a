//! [`Checkpoints`]: from time to time a build writes its state, so that it can be resumed.
//!
//! The files that the state counts on are synced first. Then the state replaces the one before, by
//! a rename. A thread of its own does both, while the build goes on. A build that ends before its
//! first checkpoint leaves nothing.

use std::fs::File;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::error::{Error, Result};
use crate::work_folder::NewState;

/// A checkpoint may take this share of the time at most.
const SHARE: u32 = 16;

/// When the next checkpoint is due, and the one that is being written.
pub struct Checkpoints {
    every: Duration,
    due: Instant,
    running: Option<JoinHandle<Result<()>>>,
    written: bool,
}

impl Checkpoints {
    /// The first is due after `every`. `written`: there is a state already.
    pub fn new(every: Duration, written: bool) -> Self {
        Self { every, due: Instant::now() + every, running: None, written }
    }

    /// True if it is time for the next one, and the last one is written.
    pub fn is_due(&mut self) -> Result<bool> {
        if self.running.as_ref().is_some_and(JoinHandle::is_finished) {
            self.wait()?;
        }
        Ok(self.running.is_none() && Instant::now() >= self.due)
    }

    /// Syncs `files`, then publishes `state`, on a thread. `begun` is when the state began to be
    /// collected. The last checkpoint must be written ([`Checkpoints::is_due`],
    /// [`Checkpoints::wait`]).
    pub fn publish(&mut self, files: Vec<File>, state: NewState, begun: Instant) {
        self.running = Some(std::thread::spawn(move || sync_and_publish(&files, state)));
        self.due = Instant::now() + self.every.max(begun.elapsed() * SHARE);
    }

    /// Waits for the checkpoint that is being written, if any.
    pub fn wait(&mut self) -> Result<()> {
        let Some(running) = self.running.take() else { return Ok(()) };
        let result = running
            .join()
            .unwrap_or_else(|_| Err(Error::internal("the thread that writes the state of the build failed")));
        self.written |= result.is_ok();
        result
    }

    /// True if there is a state to go on from.
    pub fn is_written(&self) -> bool {
        self.written
    }
}

impl Drop for Checkpoints {
    fn drop(&mut self) {
        // It is dropped without waiting only where another error is reported.
        let _ = self.wait();
    }
}

fn sync_and_publish(files: &[File], state: NewState) -> Result<()> {
    for file in files {
        file.sync_data().map_err(|source| state.failed("sync what is done so far", source))?;
    }
    state.publish()
}
