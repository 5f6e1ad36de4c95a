//! A writer whose tiles come in several goes: marked, resumed from a mark, left as a piece, or fed with pieces.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::levels::{ADOPTED, Adopted, LevelFile, level_file, level_name, open};
use super::{BUFFER, ContainerWriter, RECORDS, spent};
use crate::container::assemble::Tree;
use crate::container::directory::TileEntry;
use crate::error::{Error, Result};
use crate::writer::records;
use crate::writer::work::WorkFolder;

/// How far the files of a writer have come: what a resumed build keeps of them.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mark {
    /// Bytes of each level's chunks, root first.
    pub levels: Vec<u64>,
    /// Tiles of all levels.
    pub tiles: u64,
}

impl ContainerWriter {
    /// Goes on with the files of a work folder as they were at a mark; what was written after it is cut off.
    pub fn resume(work: WorkFolder, mark: &Mark) -> Result<Self> {
        let failed = |name: &str, source| Error::io(work.path(name), "go on with it", source);
        let mut file = open(&work.path(RECORDS), false).map_err(|source| failed(RECORDS, source))?;
        let entries = read_records(&mut file, mark, &work.path(RECORDS))?;
        cut(&mut file, mark.tiles * records::BYTES as u64).map_err(|source| failed(RECORDS, source))?;
        let mut files = Vec::with_capacity(mark.levels.len());
        for (level, &end) in mark.levels.iter().enumerate() {
            let name = level_name(level);
            let mut file = open(&work.path(&name), false).map_err(|source| failed(&name, source))?;
            cut(&mut file, end).map_err(|source| failed(&name, source))?;
            files.push(Some(LevelFile {
                file: BufWriter::with_capacity(BUFFER, file),
                end,
                adopted: Vec::new(),
            }));
        }
        let records = BufWriter::with_capacity(BUFFER, file);
        let mut writer = Self {
            files,
            records,
            tree: Tree::default(),
            levels: Vec::new(),
            imagery: None,
            failed: false,
            work,
        };
        for entry in entries {
            writer.push(entry)?;
        }
        Ok(writer)
    }

    /// Takes over all tiles of a finished piece, the folder `piece`, as they were at its mark. Their chunks stay where they are until
    /// the file is put together.
    pub fn adopt(&mut self, piece: &Path, mark: &Mark) -> Result<()> {
        let path = piece.join(RECORDS);
        let mut file = crate::file::open(&path).map_err(|source| Error::io(&path, "open", source))?;
        let entries = read_records(&mut file, mark, &path)?;
        let mut bases = Vec::with_capacity(mark.levels.len());
        for (level, &end) in mark.levels.iter().enumerate() {
            let path = piece.join(level_name(level));
            let file = crate::file::open(&path).map_err(|source| Error::io(&path, "open", source))?;
            let length = file.metadata().map_err(|source| Error::io(&path, "look at it", source))?.len();
            if length < end {
                return Err(Error::format("chunks", format!("{end} bytes"), length).at(&path));
            }
            let level = level_file(&mut self.files, level, &self.work)
                .map_err(|source| self.work.failed("begin a level", source))?;
            let base = level.adopted.last().map_or(ADOPTED, |adopted| adopted.end);
            bases.push(base);
            level.adopted.push(Adopted { base, end: base + end, file });
        }
        for mut entry in entries {
            entry.chunks.offset += bases[usize::from(entry.id.level)];
            self.push(entry)?;
        }
        Ok(())
    }

    /// Writes out what is buffered, and says how far the files are.
    pub fn mark(&mut self) -> Result<Mark> {
        if self.failed {
            return Err(spent());
        }
        let mut flush = || -> io::Result<Vec<u64>> {
            self.records.flush()?;
            let mut levels = Vec::with_capacity(self.files.len());
            for level in 0..self.files.len() {
                // A level that has no tile yet gets its empty file: a mark names every level.
                let file = level_file(&mut self.files, level, &self.work)?;
                file.file.flush()?;
                levels.push(file.end);
            }
            Ok(levels)
        };
        let levels = flush().map_err(|source| self.work.failed("write what is done so far", source))?;
        Ok(Mark { levels, tiles: self.tree.count() })
    }

    /// The files behind the last mark, to be synced by whoever writes the state.
    pub fn files(&self) -> Result<Vec<File>> {
        let files =
            self.files.iter().flatten().map(|level| level.file.get_ref()).chain([self.records.get_ref()]);
        files
            .map(File::try_clone)
            .collect::<io::Result<_>>()
            .map_err(|source| self.work.failed("open a file twice", source))
    }

    /// Gives the folder with its files and the state, all synced, the output's name: a piece to be merged.
    pub fn finish_piece(mut self, state: &[u8]) -> Result<()> {
        for file in self.files()? {
            file.sync_data().map_err(|source| self.work.failed("sync the piece", source))?;
        }
        self.work.write_state(state)?;
        let Self { files, records, work, .. } = self;
        // Closed before the folder moves.
        drop((files, records));
        work.publish_folder()
    }
}

/// Cuts off what is behind `end`, and goes there. Fails if there is less.
fn cut(file: &mut File, end: u64) -> io::Result<()> {
    let length = file.metadata()?.len();
    if length < end {
        return Err(io::Error::other(format!("it has {length} bytes, {end} were there before")));
    }
    file.set_len(end)?;
    file.seek(SeekFrom::Start(end)).map(|_| ())
}

/// The index rows up to a mark.
fn read_records(file: &mut File, mark: &Mark, path: &Path) -> Result<Vec<TileEntry>> {
    let mut bytes = Vec::new();
    file.take(mark.tiles.saturating_mul(records::BYTES as u64))
        .read_to_end(&mut bytes)
        .map_err(|source| Error::io(path, "read it", source))?;
    let rows = bytes.chunks_exact(records::BYTES);
    if rows.len() as u64 != mark.tiles {
        return Err(Error::format("list of tiles", format!("{} tiles", mark.tiles), rows.len()).at(path));
    }
    let mut entries = Vec::with_capacity(rows.len());
    for row in rows {
        let Some(row) = row.first_chunk() else { continue };
        let entry = records::decode(row).map_err(|error| error.at(path))?;
        let within = mark.levels.get(usize::from(entry.id.level)).copied().unwrap_or(0);
        let end = entry.chunks.offset.checked_add(entry.chunks.bytes());
        if end.is_none_or(|end| end > within) {
            return Err(
                Error::format(format!("tile {}", entry.id), "chunks in its level's file", "others").at(path)
            );
        }
        entries.push(entry);
    }
    Ok(entries)
}
