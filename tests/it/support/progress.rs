//! A [`Progress`] that stops a task at a place of the test's choice.

use std::sync::atomic::{AtomicBool, Ordering};

use relevo::pipeline::{Progress, Stage};

/// Goes on while a function of the parts done and their total says so.
pub struct While<F>(pub F, AtomicBool);

impl<F: Fn(u64, u64) -> bool + Sync> While<F> {
    /// Asks `goes_on` at every report.
    pub fn new(goes_on: F) -> Self {
        Self(goes_on, AtomicBool::new(false))
    }
}

impl<F: Fn(u64, u64) -> bool + Sync> Progress for While<F> {
    fn report(&self, _: Stage, done: u64, total: u64) {
        if !(self.0)(done, total) {
            self.1.store(true, Ordering::Relaxed);
        }
    }

    fn is_cancelled(&self) -> bool {
        self.1.load(Ordering::Relaxed)
    }
}
