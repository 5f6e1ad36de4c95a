//! A file as a slice of memory, read only: the one place of the readers that needs `unsafe`.
//!
//! Nothing is read ahead of use and nothing is copied, so a raster larger than memory costs only the pages in use.
//! If another process shortens the file while it is mapped, the system ends this process with `SIGBUS` (Windows
//! forbids the shortening); if it is overwritten in place, samples are a mixture of old and new. Do neither to the
//! input of a running build. A file that was already short when opened is a plain [`Error::Format`].

use std::fs::File;
use std::path::Path;

use crate::error::{Error, Result};

/// The bytes of a file.
#[derive(Debug)]
pub(super) struct Map(memmap2::Mmap);

impl Map {
    /// Maps the whole of a file.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|error| Error::io(path, "open", error))?;
        // SAFETY: the map is only ever seen as `&[u8]`, for which any bytes are valid values, and its length is fixed
        // here. What is left is a change of the file by someone else while it is mapped: the module's documentation
        // says what happens, and no decoder relies on reading the same byte twice with the same result (each block
        // is decoded from one pass into buffers whose sizes do not come from the bytes being decoded).
        #[expect(unsafe_code, reason = "memory-mapped input; see SAFETY")]
        let map = unsafe { memmap2::Mmap::map(&file) };
        map.map(Self).map_err(|error| Error::io(path, "map into memory", error))
    }

    /// All bytes.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.0
    }
}
