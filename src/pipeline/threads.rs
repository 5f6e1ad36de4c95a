//! How many threads a build works with, and the pool of them.

use crate::error::{Error, Result};

/// Threads that may share a core, where there are more than [`LEAST_MOST`].
const THREADS_A_CORE: usize = 4;
/// Threads that may be asked for on any machine.
const LEAST_MOST: usize = 16;

/// Threads that work if `jobs` are asked for. Far more threads than cores would only wait for one
/// another.
pub fn workers(jobs: Option<usize>) -> usize {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    jobs.unwrap_or(cores).clamp(1, (THREADS_A_CORE * cores).max(LEAST_MOST))
}

/// A pool of [`workers`].
pub(super) fn threads(jobs: Option<usize>) -> Result<rayon::ThreadPool> {
    let count = workers(jobs);
    rayon::ThreadPoolBuilder::new()
        .num_threads(count)
        .build()
        .map_err(|e| Error::io("", format!("start {count} threads"), std::io::Error::other(e)))
}
