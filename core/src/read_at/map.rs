//! A file mapped into memory: its pages are loaded when they are touched, without a call for each
//! read.
//!
//! What it gains is memory that programs share and no file position, not time. Measured on files in
//! the page cache (`benches/reader.rs`, three files of 0.6 to 4.2 million samples, 2 cores), times
//! by map over times by position: opening 1.2 to 1.5, a cold leaf 1.00 to 1.27, every leaf in order
//! 1.11 to 1.28, the same by two threads 0.94 to 1.05. Each measurement opens the file anew, so a
//! map pays a page fault for every 4 KiB where a read copies a whole chunk. Hence by position is
//! the default.
//!
//! The risk is in [`Map`].

use std::io;
use std::path::Path;

use memmap2::Mmap;

use super::ReadAt;

/// A file that is mapped into memory, for trusted local files.
///
/// Relevo itself replaces a finished `.rlv` file only by a rename, which leaves a map as it is. A
/// program that *truncates* the file while it is mapped ends this process with SIGBUS (on Windows
/// it is not allowed to); one that writes into it changes bytes that a CRC has passed. Reading by
/// position, the default, gives errors instead.
pub struct Map(Mmap);

impl Map {
    /// Maps a file.
    ///
    /// # Errors
    /// Those of [`super::open`], and of the system.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = super::open(path)?;
        // SAFETY: the map is only ever read through `ReadAt`, which copies out of it, so no
        // reference to bytes that might change outlives a call. That nobody truncates the file is
        // what the caller of this type answers for.
        #[expect(unsafe_code, reason = "mapping is unsafe for what other programs may do")]
        let map = unsafe { Mmap::map(&file)? };
        Ok(Self(map))
    }
}

impl ReadAt for Map {
    fn byte_count(&self) -> io::Result<u64> {
        Ok(self.0.len() as u64)
    }

    fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()> {
        super::copy(&self.0, bytes, offset)
    }
}
