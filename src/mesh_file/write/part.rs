//! A run of bytes of a file, written in pieces.

use crate::error::Result;
use crate::output::NewFile;

/// Bytes that wait, at most, before they are written.
const WAITING: usize = 1 << 18;

/// Bytes from an offset on, several of which can be written in turns.
#[derive(Debug, Default)]
pub(super) struct Part {
    next: u64,
    waiting: Vec<u8>,
}

impl Part {
    /// One that begins at a byte of the file.
    pub(super) fn at(next: u64) -> Self {
        Self { next, waiting: Vec::new() }
    }

    /// Where bytes can be added; [`Part::check`] after some.
    pub(super) fn bytes(&mut self) -> &mut Vec<u8> {
        &mut self.waiting
    }

    /// Writes what waits if it is much.
    pub(super) fn check(&mut self, file: &mut NewFile) -> Result<()> {
        if self.waiting.len() >= WAITING { self.flush(file) } else { Ok(()) }
    }

    /// Writes what waits.
    pub(super) fn flush(&mut self, file: &mut NewFile) -> Result<()> {
        file.seek(self.next)?;
        file.put(&self.waiting)?;
        self.next += self.waiting.len() as u64;
        self.waiting.clear();
        Ok(())
    }

    /// The offset of the next byte.
    pub(super) fn position(&self) -> u64 {
        self.next + self.waiting.len() as u64
    }
}
