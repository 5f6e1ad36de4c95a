//! Files by position: opened, read, written, told apart, asked for in advance.

use std::fs::{self, File};
use std::io;
use std::path::Path;

pub(crate) use relevo_core::read_at::open;

/// Files that the process may have open at a time; `None` if the system has no such limit.
#[cfg(unix)]
pub(crate) fn most_open() -> Option<u64> {
    rustix::process::getrlimit(rustix::process::Resource::Nofile).current
}

/// Files that the process may have open at a time: no such limit is known.
#[cfg(not(unix))]
pub(crate) fn most_open() -> Option<u64> {
    None
}

/// What tells whether a file is still the one it was, as it was.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Identity {
    entry: (u64, u64),
    bytes: u64,
    modified: Option<std::time::SystemTime>,
}

impl Identity {
    /// That of the file of a name.
    pub(crate) fn of(path: &Path) -> io::Result<Self> {
        fs::metadata(path).map(|found| Self::new(&found))
    }

    /// That of an open file.
    pub(crate) fn of_open(file: &File) -> io::Result<Self> {
        file.metadata().map(|found| Self::new(&found))
    }

    #[cfg(unix)]
    fn new(found: &fs::Metadata) -> Self {
        use std::os::unix::fs::MetadataExt;
        let entry = (found.dev(), found.ino());
        Self { entry, bytes: found.len(), modified: found.modified().ok() }
    }

    /// Elsewhere an open file keeps its name.
    #[cfg(not(unix))]
    fn new(found: &fs::Metadata) -> Self {
        Self { entry: (0, 0), bytes: found.len(), modified: found.modified().ok() }
    }
}

/// All bytes of a file, which must not be more than `most`.
pub(crate) fn read(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    use io::Read;
    let mut bytes = Vec::new();
    open(path)?.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, format!("it has more than {most} bytes")));
    }
    Ok(bytes)
}

/// Fills `bytes` from `offset` on; [`io::ErrorKind::UnexpectedEof`] if the file ends before.
pub(crate) fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    relevo_core::ReadAt::read_exact_at(file, bytes, offset)
}

/// Asks the system to read some bytes of a file soon, so that who comes for them need not wait.
#[cfg(any(target_os = "linux", target_os = "android", target_os = "freebsd"))]
pub(crate) fn will_need(file: &File, bytes: std::ops::Range<u64>) {
    let length = std::num::NonZeroU64::new(bytes.end.saturating_sub(bytes.start));
    // No more than a hint: if it fails, reading will say why.
    let _ = rustix::fs::fadvise(file, bytes.start, length, rustix::fs::Advice::WillNeed);
}

/// Asks the system to read some bytes of a file soon: this one cannot be asked.
#[cfg(not(any(target_os = "linux", target_os = "android", target_os = "freebsd")))]
pub(crate) fn will_need(_: &File, _: std::ops::Range<u64>) {}

/// Writes all of `bytes` from `offset` on. Where the cursor is afterwards depends on the system.
#[cfg(unix)]
pub(crate) fn write_all_at(file: &File, bytes: &[u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, offset)
}

/// Writes all of `bytes` from `offset` on. Where the cursor is afterwards depends on the system.
#[cfg(windows)]
pub(crate) fn write_all_at(file: &File, mut bytes: &[u8], mut offset: u64) -> io::Result<()> {
    use std::os::windows::fs::FileExt;
    while !bytes.is_empty() {
        match file.seek_write(bytes, offset) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(count) => {
                bytes = &bytes[count..];
                offset += count as u64;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}
