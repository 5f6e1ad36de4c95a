//! Buffers of the threads of a build, kept from row to row.

use std::sync::{Mutex, PoisonError};

use crate::codec::Scratch;

/// Buffers that no thread is using.
#[derive(Default)]
pub struct Buffers(Mutex<Vec<Scratch>>);

/// Buffers of a thread while it works on some tiles; they go back by themselves.
pub struct Lent<'a> {
    /// The buffers.
    pub scratch: Scratch,
    owner: &'a Buffers,
}

impl Buffers {
    /// Some that have been used before, if there are any.
    pub fn lend(&self) -> Lent<'_> {
        let scratch = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
        Lent { scratch, owner: self }
    }
}

impl Drop for Lent<'_> {
    fn drop(&mut self) {
        let scratch = std::mem::take(&mut self.scratch);
        self.owner.0.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
    }
}
