//! Bytes that are read by position: a file, bytes in memory, or a program's own source, such as
//! ranges of a file on a server.

use std::io;

#[cfg(feature = "map")]
mod map;

#[cfg(feature = "map")]
pub use map::Map;

/// Bytes that can be read from any position, by several threads at a time.
///
/// A [`Reader`](crate::Reader) reads only through this trait. It finds damaged bytes by their CRCs,
/// so an implementation need not check the bytes that it delivers.
///
/// ```
/// use relevo_core::ReadAt;
///
/// let bytes = vec![1, 2, 3, 4];
/// let mut two = [0; 2];
/// bytes.read_exact_at(&mut two, 1).unwrap();
/// assert_eq!((bytes.byte_count().unwrap(), two), (4, [2, 3]));
/// assert!(bytes.read_exact_at(&mut two, 3).is_err());
/// ```
pub trait ReadAt: Send + Sync {
    /// The number of bytes.
    ///
    /// # Errors
    /// Those of the system.
    fn byte_count(&self) -> io::Result<u64>;

    /// Fills `bytes` with the bytes from `offset` on.
    ///
    /// # Errors
    /// [`io::ErrorKind::UnexpectedEof`] if the bytes end before; the errors of the system.
    fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()>;
}

impl ReadAt for Vec<u8> {
    fn byte_count(&self) -> io::Result<u64> {
        Ok(self.len() as u64)
    }

    fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()> {
        copy(self, bytes, offset)
    }
}

impl ReadAt for &'static [u8] {
    fn byte_count(&self) -> io::Result<u64> {
        Ok(self.len() as u64)
    }

    fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()> {
        copy(self, bytes, offset)
    }
}

/// Copies bytes of `from`, from `offset` on.
fn copy(from: &[u8], to: &mut [u8], offset: u64) -> io::Result<()> {
    let start = usize::try_from(offset).ok().filter(|&start| start <= from.len());
    let found = start.and_then(|start| from[start..].get(..to.len()));
    to.copy_from_slice(found.ok_or(io::ErrorKind::UnexpectedEof)?);
    Ok(())
}

#[cfg(any(unix, windows))]
pub use files::open;

#[cfg(any(unix, windows))]
mod files {
    use std::fs::{self, File};
    use std::io;
    use std::path::Path;

    use super::ReadAt;

    /// Reads by position and ignores the cursor, so that threads share one open file. (On Windows
    /// the cursor moves.)
    impl ReadAt for File {
        fn byte_count(&self) -> io::Result<u64> {
            self.metadata().map(|found| found.len())
        }

        #[cfg(unix)]
        fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()> {
            std::os::unix::fs::FileExt::read_exact_at(self, bytes, offset)
        }

        #[cfg(windows)]
        fn read_exact_at(&self, mut bytes: &mut [u8], mut offset: u64) -> io::Result<()> {
            use std::os::windows::fs::FileExt;
            while !bytes.is_empty() {
                match self.seek_read(bytes, offset) {
                    Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                    Ok(count) => {
                        bytes = &mut bytes[count..];
                        offset += count as u64;
                    }
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    Err(error) => return Err(error),
                }
            }
            Ok(())
        }
    }

    /// Opens a file to read it by position.
    ///
    /// # Errors
    /// Those of the system; [`io::ErrorKind::InvalidInput`] for a pipe, which would make the
    /// program wait for a writer, and for a device, which may have no end.
    pub fn open(path: &Path) -> io::Result<File> {
        let refuse = |found: &fs::Metadata| -> io::Result<()> {
            if found.is_dir() {
                return Err(io::ErrorKind::IsADirectory.into());
            }
            if found.is_file() {
                return Ok(());
            }
            let what = "it is a pipe or a device, which cannot be read here and there; copy it to a file";
            Err(io::Error::new(io::ErrorKind::InvalidInput, what))
        };
        // Opening a pipe waits already.
        refuse(&fs::metadata(path)?)?;
        let file = File::open(path)?;
        refuse(&file.metadata()?)?;
        Ok(file)
    }
}
