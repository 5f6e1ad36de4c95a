//! [`Progress`]: hears how far a task is, and says whether it is to stop.

use crate::error::{Error, Result};

/// Hears how far a task is, and says whether it is to stop. Several threads may call it.
pub trait Progress: Sync {
    /// `done` of `total` parts of a stage are done: rows of samples, tiles or bytes.
    fn report(&self, stage: Stage, done: u64, total: u64);

    /// True as soon as the task is to stop. It then fails with [`Error::Interrupted`].
    fn is_cancelled(&self) -> bool {
        false
    }
}

impl dyn Progress + '_ {
    /// Reports, and returns whether to go on.
    pub(crate) fn goes_on(&self, stage: Stage, done: u64, total: u64) -> bool {
        self.report(stage, done, total);
        !self.is_cancelled()
    }

    /// Reports, and fails if the task is to stop.
    pub(crate) fn step(&self, stage: Stage, done: u64, total: u64) -> Result<()> {
        if self.goes_on(stage, done, total) { Ok(()) } else { Err(Error::Interrupted) }
    }
}

/// The parts of a task that take time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// A build looks for the largest height, with `precision_m` only.
    Scan,
    /// The rows of a build go through the sweep.
    Build,
    /// A merge finishes the tiles that no piece could finish.
    Merge,
    /// The tiles of an imagery layer are made, or checked.
    Imagery,
    /// A file is put together.
    Write,
    /// The tiles of heights are checked.
    Tiles,
    /// The samples of a file are compared with its source.
    Source,
    /// A deep check compares the samples of all levels.
    Samples,
    /// A deep check computes every error anew.
    Errors,
    /// The triangles of a mesh are made.
    Triangles,
}

impl Stage {
    /// Its name: `scan`, `build`, ...
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Scan => "scan",
            Self::Build => "build",
            Self::Merge => "merge",
            Self::Imagery => "imagery",
            Self::Write => "write",
            Self::Tiles => "tiles",
            Self::Source => "source",
            Self::Samples => "samples",
            Self::Errors => "errors",
            Self::Triangles => "triangles",
        }
    }
}

/// Hears nothing, and never stops a task.
pub struct Silent;

impl Progress for Silent {
    fn report(&self, _: Stage, _: u64, _: u64) {}
}
