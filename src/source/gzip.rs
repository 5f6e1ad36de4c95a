//! Gzipped files such as `dem.tif.gz` and `N44W072.hgt.gz`, unpacked so that they can be read by
//! position.
//!
//! Blocks of a raster are read in any order, a gzip stream only from its start. So the content is
//! unpacked into a file without a name in the system's temporary folder (`TMPDIR`), which
//! disappears when it is closed, even if the program is killed. Messages and the container name the
//! gzipped file, and its stamp tells whether the source has changed.

use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use crate::error::{Error, Result};
use crate::limits::Limits;

/// First bytes of a gzipped file.
const MAGIC: [u8; 3] = [0x1F, 0x8B, 8];

/// Place in errors about a damaged gzipped file.
pub(super) const PLACE: &str = "gzip";

/// Bytes that are unpacked at a time.
const CHUNK: usize = 1 << 20;

/// A file opened for reading, unpacked if it was gzipped.
pub(super) struct Content {
    /// The file itself, or the temporary file with its content.
    pub(super) file: File,
    /// Length of `file` in bytes.
    pub(super) length: u64,
    /// True if it was unpacked.
    pub(super) is_gzipped: bool,
}

/// Opens a file; a gzipped one is unpacked.
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

/// A file as a stream, unpacked if it is gzipped, and whether it is gzipped.
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

/// The error for a failed read from a stream of [`stream`]: of the system or of the file.
pub(super) fn read_error(path: &Path, error: io::Error) -> Error {
    match error.kind() {
        io::ErrorKind::UnexpectedEof | io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData => {
            let got = format!("{error} (it is cut off, or damaged: get it again)");
            Error::format(PLACE, "a whole stream", got).at(path)
        }
        _ => Error::io(path, "read", error),
    }
}

/// The content of a gzipped file in a temporary file, and its length.
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
    // A part of the free disk is left for other programs.
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

/// Free bytes on the disk of a file; `None` if the system does not say.
#[cfg(unix)]
fn free(file: &File) -> Option<u64> {
    let disk = rustix::fs::fstatvfs(file).ok()?;
    disk.f_bavail.checked_mul(disk.f_frsize)
}

/// Free bytes on the disk of a file; not known on this system.
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
        // Two gzip streams one after the other make one file.
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
