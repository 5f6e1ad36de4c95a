//! How far a task is, and whether it is to stop.

/// What a build tells while it runs, and how it is told to stop.
pub trait Observer: Sync {
    /// `done` of `total` raster rows have been read and put into tiles.
    fn rows(&self, stage: Stage, done: u64, total: u64);

    /// True as soon as the build is to stop; asked between bands.
    fn cancelled(&self) -> bool {
        false
    }
}

/// The parts of a build that take time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Looking for the largest height, with `precision_m` only.
    Scan,
    /// The sweep.
    Build,
    /// Finishing what lies between pieces.
    Merge,
    /// The tiles of the imagery layer.
    Imagery,
    /// Putting the file together.
    Write,
}

/// An observer that hears nothing and never stops a build.
pub struct Silent;

impl Observer for Silent {
    fn rows(&self, _: Stage, _: u64, _: u64) {}
}
