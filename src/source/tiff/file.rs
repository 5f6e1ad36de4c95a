//! An open TIFF file, read by position from several threads.
//!
//! The file is not mapped: if another program shortens it or a disk fails, an error names the
//! place. Data is copied once, into a buffer whose size does not come from the file alone.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::file::{read_exact_at, will_need};
use crate::limits::Limits;
use crate::source::gzip;

/// A file, or the content of a gzipped one, with its length when it was opened.
pub(super) struct TiffFile {
    file: File,
    path: PathBuf,
    length: u64,
    is_gzipped: bool,
}

impl TiffFile {
    /// Opens a file.
    pub(super) fn open(path: &Path, limits: &Limits) -> Result<Self> {
        let gzip::Content { file, length, is_gzipped } = gzip::open(path, limits)?;
        Ok(Self { file, path: path.to_owned(), length, is_gzipped })
    }

    /// True if this is the content of a gzipped file.
    pub(super) fn is_gzipped(&self) -> bool {
        self.is_gzipped
    }

    /// Path of the file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Length when it was opened.
    pub(super) fn length(&self) -> u64 {
        self.length
    }

    /// Fills `bytes` from `offset` on; `name` names them in messages.
    pub(super) fn read(&self, bytes: &mut [u8], offset: u64, name: &dyn Fn() -> String) -> Result<()> {
        read_exact_at(&self.file, bytes, offset).map_err(|source| {
            let what = format!("{} bytes from offset {offset} on", bytes.len());
            if source.kind() != io::ErrorKind::UnexpectedEof {
                return Error::io(&self.path, format!("read {}, {what}", name()), source);
            }
            let now = self.file.metadata().map_or(0, |metadata| metadata.len());
            let hint = "start again when nothing writes to it";
            let got = format!("the end of the file at {now}, shortened from {} since: {hint}", self.length);
            Error::format(name(), what, got)
        })
    }

    /// Tells the system that some bytes will be read soon.
    pub(super) fn will_need(&self, bytes: Range<u64>) {
        will_need(&self.file, bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_gone_is_named() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("short");
        std::fs::write(&path, [7; 100]).expect("write");
        let file = TiffFile::open(&path, &Limits::default()).expect("open");
        File::options().write(true).open(&path).expect("open").set_len(60).expect("shorten");
        // This is only a hint.
        file.will_need(50..1000);
        let mut bytes = [0; 50];
        file.read(&mut bytes[..20], 40, &|| "strip 3".to_owned()).expect("there");
        let message = file.read(&mut bytes, 40, &|| "strip 3".to_owned()).expect_err("gone").to_string();
        let words = ["strip 3", "50 bytes from offset 40", "file at 60", "shortened from 100", "start again"];
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    }
}
