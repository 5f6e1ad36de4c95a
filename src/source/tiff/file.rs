//! One open TIFF file, read by position from several threads.
//!
//! Nothing is mapped: a file that another program shortens or a disk that fails gives an error that names the place,
//! and what is read is copied once, into a buffer whose size does not come from the file alone.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::file::{read_exact_at, will_need};

/// Bytes that a [`Cursor`] reads at a time: header and directories of most files at once.
const BUFFER: usize = 64 << 10;

/// A file and its length when it was opened.
pub(super) struct TiffFile {
    file: File,
    path: PathBuf,
    length: u64,
}

impl TiffFile {
    /// Opens a file.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|error| Error::io(path, "open", error))?;
        let length = file.metadata().map_err(|error| Error::io(path, "look at", error))?.len();
        Ok(Self { file, path: path.to_owned(), length })
    }

    /// Where it is.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Its length when it was opened.
    pub(super) fn length(&self) -> u64 {
        self.length
    }

    /// Fills `bytes` from `offset` on; `name` says what they are in messages.
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

    /// Says that some bytes will be read soon.
    pub(super) fn will_need(&self, bytes: Range<u64>) {
        will_need(&self.file, bytes);
    }

    /// Reads the file from its start.
    pub(super) fn cursor(&self) -> Cursor<'_> {
        Cursor { file: self, position: 0, buffer: Vec::new(), start: 0 }
    }
}

/// Buffered reading here and there; the buffer outlasts a seek.
pub(super) struct Cursor<'a> {
    file: &'a TiffFile,
    position: u64,
    buffer: Vec<u8>,
    /// Where the buffer stands in the file.
    start: u64,
}

impl Cursor<'_> {
    /// What the buffer has from the position on.
    fn ahead(&self) -> &[u8] {
        let skip = self.position.checked_sub(self.start).and_then(|skip| usize::try_from(skip).ok());
        skip.and_then(|skip| self.buffer.get(skip..)).unwrap_or_default()
    }

    fn refill(&mut self, left: u64) -> io::Result<()> {
        self.buffer.resize(left.min(BUFFER as u64) as usize, 0);
        self.start = self.position;
        read_exact_at(&self.file.file, &mut self.buffer, self.start).inspect_err(|_| self.buffer.clear())
    }
}

impl Read for Cursor<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let left = self.file.length.saturating_sub(self.position);
        if left == 0 || out.is_empty() {
            return Ok(0);
        }
        let mut count = out.len();
        if self.ahead().is_empty() {
            if count >= BUFFER {
                count = count.min(usize::try_from(left).unwrap_or(usize::MAX));
                read_exact_at(&self.file.file, &mut out[..count], self.position)?;
                self.position += count as u64;
                return Ok(count);
            }
            self.refill(left)?;
        }
        let ahead = self.ahead();
        count = count.min(ahead.len());
        out[..count].copy_from_slice(&ahead[..count]);
        self.position += count as u64;
        Ok(count)
    }
}

impl Seek for Cursor<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let position = match to {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::Current(by) => self.position.checked_add_signed(by),
            SeekFrom::End(by) => self.file.length.checked_add_signed(by),
        };
        self.position = position.ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cursor_reads_what_the_file_has_in_any_order() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("numbers");
        let bytes: Vec<u8> = (0..200_000_u32).map(|n| (n.wrapping_mul(n) >> 7) as u8).collect();
        std::fs::write(&path, &bytes).expect("write");
        let file = TiffFile::open(&path).expect("open");
        let mut cursor = file.cursor();
        for (at, length) in
            [(0, 8), (100, 50), (65_530, 20), (0, 3), (70_000, 130_000), (199_990, 10), (5, 70_000)]
        {
            cursor.seek(SeekFrom::Start(at as u64)).expect("seek");
            let mut got = vec![0; length];
            cursor.read_exact(&mut got).expect("read");
            assert_eq!(got, bytes[at..at + length], "{length} at {at}");
        }
        cursor.seek(SeekFrom::End(-2)).expect("seek");
        let error = cursor.read_exact(&mut [0; 3]).expect_err("beyond the end");
        assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
    }

    #[test]
    fn what_is_gone_is_named() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("short");
        std::fs::write(&path, [7; 100]).expect("write");
        let file = TiffFile::open(&path).expect("open");
        File::options().write(true).open(&path).expect("open").set_len(60).expect("shorten");
        // Only a hint.
        file.will_need(50..1000);
        let mut bytes = [0; 50];
        file.read(&mut bytes[..20], 40, &|| "strip 3".to_owned()).expect("there");
        let message = file.read(&mut bytes, 40, &|| "strip 3".to_owned()).expect_err("gone").to_string();
        let words = ["strip 3", "50 bytes from offset 40", "file at 60", "shortened from 100", "start again"];
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    }
}
