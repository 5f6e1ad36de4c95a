//! Gzipped files, `dem.tif.gz` and `N44W072.hgt.gz`: their content as a file that can be read by
//! position.
//!
//! Blocks of a raster are read in any order and a stream of gzip can only be read from its start,
//! so the content is unpacked, into a file without a name in the system's folder for temporary
//! files (`TMPDIR`). It is gone when it is closed, also if the program is killed. Everything else
//! knows the gzipped file only: messages and the container name it, and its stamp is what tells
//! whether it has changed.

use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use crate::error::{Error, Result};
use crate::limits::Limits;

/// What a gzipped file begins with.
const MAGIC: [u8; 3] = [0x1F, 0x8B, 8];

/// Where the damage is of a gzipped file that cannot be unpacked.
pub(super) const PLACE: &str = "gzip";

/// Bytes that are unpacked at a time.
const CHUNK: usize = 1 << 20;

/// A file as it is read.
pub(super) struct Content {
    /// The file, or one with its content.
    pub(super) file: File,
    /// Bytes of it.
    pub(super) length: u64,
    /// True if it was unpacked.
    pub(super) is_gzipped: bool,
}

/// Opens a file, unpacked if it is gzipped.
pub(super) fn open(path: &Path, limits: &Limits) -> Result<Content> {
    let mut file = crate::file::open(path).map_err(|error| Error::io(path, "open", error))?;
    let length = file.metadata().map_err(|error| Error::io(path, "look at", error))?.len();
    let mut start = Vec::new();
    io::Read::by_ref(&mut file)
        .take(MAGIC.len() as u64)
        .read_to_end(&mut start)
        .map_err(|error| Error::io(path, "read", error))?;
    if start != MAGIC {
        return Ok(Content { file, length, is_gzipped: false });
    }
    let (file, length) = unpack(path, limits.unpacked_bytes).map_err(|error| error.at(path))?;
    Ok(Content { file, length, is_gzipped: true })
}

/// A file as a stream from its start, unpacked if it is gzipped; and whether it is.
pub(super) fn stream(path: &Path) -> Result<(Box<dyn Read>, bool)> {
    let open = || crate::file::open(path).map_err(|error| Error::io(path, "open", error));
    let mut start = Vec::new();
    open()?
        .take(MAGIC.len() as u64)
        .read_to_end(&mut start)
        .map_err(|error| Error::io(path, "read", error))?;
    let file = BufReader::new(open()?);
    let is_gzipped = start == MAGIC;
    Ok((if is_gzipped { Box::new(MultiGzDecoder::new(file)) } else { Box::new(file) }, is_gzipped))
}

/// What went wrong with a stream of [`stream`]: the system, or the file.
pub(super) fn read_error(path: &Path, error: io::Error) -> Error {
    match error.kind() {
        io::ErrorKind::UnexpectedEof | io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData => {
            let got = format!("{error} (it is cut off, or damaged: get it again)");
            Error::format(PLACE, "a whole stream", got).at(path)
        }
        _ => Error::io(path, "read", error),
    }
}

/// The content of a gzipped file and its length.
fn unpack(path: &Path, most: u64) -> Result<(File, u64)> {
    let folder = std::env::temp_dir();
    let write_error = |error: io::Error| {
        let action = format!(
            "unpack {} here (name a folder with more room in TMPDIR, or unpack it with gunzip)",
            path.display()
        );
        Error::io(&folder, action, error)
    };
    let mut out = tempfile::tempfile_in(&folder).map_err(write_error)?;
    // The last part of the disk is left to others.
    let room = free(&out).map_or(u64::MAX, |free| free - free / 8);
    let mut from = stream(path)?.0;
    let mut buffer = vec![0; CHUNK];
    let mut length = 0;
    loop {
        let count = match from.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => return Err(read_error(path, error)),
        };
        length += count as u64;
        if length > most {
            return Err(Error::limit("the length of its content in bytes", length, most));
        }
        if length > room {
            return Err(write_error(io::ErrorKind::StorageFull.into()));
        }
        out.write_all(&buffer[..count]).map_err(write_error)?;
    }
    Ok((out, length))
}

/// Bytes that the disk of a file has left; `None` if the system does not say.
#[cfg(unix)]
fn free(file: &File) -> Option<u64> {
    let disk = rustix::fs::fstatvfs(file).ok()?;
    disk.f_bavail.checked_mul(disk.f_frsize)
}

/// Bytes that the disk of a file has left: this system is not asked.
#[cfg(not(unix))]
fn free(_: &File) -> Option<u64> {
    None
}

#[cfg(test)]
mod tests {
    use flate2::Compression;
    use flate2::write::GzEncoder;

    use super::*;
    use crate::file::read_exact_at;

    fn gzipped(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(bytes).expect("memory");
        encoder.finish().expect("memory")
    }

    #[test]
    fn content_is_read_by_position_and_damage_is_named() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("numbers.gz");
        let bytes: Vec<u8> = (0..3_000_000_u32).map(|n| (n.wrapping_mul(n) >> 11) as u8).collect();
        // Two streams after one another are one file.
        let packed = [gzipped(&bytes[..1_000_000]), gzipped(&bytes[1_000_000..])].concat();
        std::fs::write(&path, &packed).expect("write");
        let limits = Limits::default();
        let content = open(&path, &limits).expect("open");
        assert!(content.is_gzipped && content.length == 3_000_000);
        let mut some = [0; 1000];
        read_exact_at(&content.file, &mut some, 2_000_123).expect("read");
        assert_eq!(some, bytes[2_000_123..2_001_123]);

        let mut small = limits;
        small.unpacked_bytes = 2_999_999;
        assert!(matches!(open(&path, &small), Err(Error::Limit { max: 2_999_999, .. })));
        for length in [3, 10, 11, 500, packed.len() - 1] {
            std::fs::write(&path, &packed[..length]).expect("write");
            let message = open(&path, &limits).err().expect("cut off").to_string();
            assert!(message.contains("numbers.gz") && message.contains("cut off"), "{length}: {message}");
        }
        std::fs::write(&path, b"plain").expect("write");
        let content = open(&path, &limits).expect("open");
        assert!(!content.is_gzipped && content.length == 5);
    }
}
