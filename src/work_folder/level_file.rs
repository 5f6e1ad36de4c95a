//! The chunks of one level: those of this build in the order in which they came, and those of
//! adopted pieces.

use std::fs::File;
use std::io::{self, BufWriter};

use super::folder::{WorkFolder, open_file};
use crate::container::directory::TileEntry;
use crate::file::{read_exact_at, write_all_at};

/// Bytes that are buffered before they are written, and bytes of chunks that are copied at once.
pub(crate) const BUFFER: usize = 1 << 20;

/// Chunks of one level in the order in which they came.
pub struct LevelFile {
    pub(super) file: BufWriter<File>,
    pub(super) end: u64,
    /// Files of pieces, as if they stood one after the other from [`ADOPTED`] on.
    pub(super) adopted: Vec<Adopted>,
}

/// Offset of the first adopted file: far behind the end of any other.
pub(super) const ADOPTED: u64 = 1 << 60;

/// A level's file of a piece.
pub(super) struct Adopted {
    pub(super) base: u64,
    pub(super) end: u64,
    pub(super) file: File,
}

impl LevelFile {
    /// Fills `bytes` from an offset of the level's own file, or of an adopted one.
    fn read(&self, bytes: &mut [u8], offset: u64) -> io::Result<()> {
        match self.adopted.iter().find(|adopted| (adopted.base..adopted.end).contains(&offset)) {
            Some(adopted) => read_exact_at(&adopted.file, bytes, offset - adopted.base),
            None => read_exact_at(self.file.get_ref(), bytes, offset),
        }
    }

    /// Copies the chunks of tiles that follow one another in `out`, whose tiles section begins at
    /// `base`. Fails if their checksums are not those of the chunks that came.
    pub fn copy_tiles(
        &self,
        entries: &[TileEntry],
        sources: &[u64],
        out: &File,
        base: u64,
    ) -> io::Result<()> {
        let Some(first) = entries.first() else { return Ok(()) };
        let (mut buffer, mut offset) = (Vec::new(), base + first.chunks.offset);
        for (entry, &source) in entries.iter().zip(sources) {
            let start = buffer.len();
            buffer.resize(start + entry.chunks.bytes() as usize, 0);
            let mut rest = &mut buffer[start..];
            self.read(rest, source)?;
            for (length, crc) in entry.chunks.lengths.into_iter().zip(entry.chunks.crcs) {
                let (chunk, behind) = rest.split_at_mut(length as usize);
                if crc32fast::hash(chunk) != crc {
                    let what =
                        format!("the disk gave back other bytes for tile {} than it was given", entry.id);
                    return Err(io::Error::other(what));
                }
                rest = behind;
            }
            // Tiles may be megabytes, and threads many.
            if buffer.len() >= BUFFER {
                write_all_at(out, &buffer, offset)?;
                offset += buffer.len() as u64;
                buffer.clear();
            }
        }
        write_all_at(out, &buffer, offset)
    }
}

pub(super) fn level_name(level: usize) -> String {
    format!("level-{level:02}")
}

/// The file of a level, opened when its first tile comes.
pub(super) fn level_file<'a>(
    files: &'a mut Vec<Option<LevelFile>>,
    level: usize,
    work: &WorkFolder,
) -> io::Result<&'a mut LevelFile> {
    if files.len() <= level {
        files.resize_with(level + 1, || None);
    }
    let slot = &mut files[level];
    if let Some(file) = slot {
        return Ok(file);
    }
    let file = open_file(&work.path(&level_name(level)), true)?;
    Ok(slot.insert(LevelFile { file: BufWriter::with_capacity(BUFFER, file), end: 0, adopted: Vec::new() }))
}
