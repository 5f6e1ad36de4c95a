//! [`TileStore`]: the tiles of an unfinished build, in the files of its work folder.
//!
//! Tiles are appended as they come. A [`Mark`] says how far the files are; a store can be resumed
//! at a mark, become a piece, or adopt the tiles of finished pieces.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

use wincode::{SchemaRead, SchemaWrite};

use super::folder::{WorkFolder, open_file};
use super::level_file::{ADOPTED, Adopted, BUFFER, LevelFile, level_file, level_name};
use super::tile_list;
use crate::container::directory::TileEntry;
use crate::error::{Error, Result};

/// Index rows of the tiles in the order in which they came.
const LIST: &str = "records";

/// How far the files of a store have come: what a resumed build keeps of them.
#[derive(Clone, Debug, Default, PartialEq, Eq, SchemaRead, SchemaWrite)]
pub struct Mark {
    /// Bytes of each level's chunks, root first.
    pub levels: Vec<u64>,
    /// Tiles of all levels.
    pub tiles: u64,
}

/// The tiles of an unfinished build.
pub struct TileStore {
    // Closed before the folder is removed: fields drop in this order.
    files: Vec<Option<LevelFile>>,
    list: BufWriter<File>,
    tiles: u64,
    /// A write has failed part of the way: the files hold bytes that no row counts.
    failed: bool,
    folder: WorkFolder,
}

impl TileStore {
    /// An empty store in a work folder.
    pub fn begin(folder: WorkFolder) -> Result<Self> {
        let file = open_file(&folder.path(LIST), true)
            .map_err(|source| folder.failed("begin the list of tiles", source))?;
        let list = BufWriter::with_capacity(BUFFER, file);
        Ok(Self { files: Vec::new(), list, tiles: 0, failed: false, folder })
    }

    /// The store as it was at a mark, and the rows of its tiles. What was written after the mark is
    /// cut off.
    pub fn resume(folder: WorkFolder, mark: &Mark) -> Result<(Self, Vec<TileEntry>)> {
        let failed = |name: &str, source| Error::io(folder.path(name), "go on with it", source);
        let mut file = open_file(&folder.path(LIST), false).map_err(|source| failed(LIST, source))?;
        let entries = read_list(&mut file, mark, &folder.path(LIST))?;
        cut(&mut file, mark.tiles * tile_list::BYTES as u64).map_err(|source| failed(LIST, source))?;
        let mut files = Vec::with_capacity(mark.levels.len());
        for (level, &end) in mark.levels.iter().enumerate() {
            let name = level_name(level);
            let mut file = open_file(&folder.path(&name), false).map_err(|source| failed(&name, source))?;
            cut(&mut file, end).map_err(|source| failed(&name, source))?;
            let file = BufWriter::with_capacity(BUFFER, file);
            files.push(Some(LevelFile { file, end, adopted: Vec::new() }));
        }
        let list = BufWriter::with_capacity(BUFFER, file);
        Ok((Self { files, list, tiles: mark.tiles, failed: false, folder }, entries))
    }

    /// Appends the chunks of a tile, and its row, whose offset is set to where the chunks lie in
    /// the level's file.
    pub fn append(&mut self, entry: &mut TileEntry, chunks: [&[u8]; 3]) -> Result<()> {
        let id = entry.id;
        let failed = |folder: &WorkFolder, action, source| Err(folder.failed(action, source));
        match self.write(entry, chunks) {
            Ok(offset) => entry.chunks.offset = offset,
            Err(source) => return failed(&self.folder, &format!("write tile {id}"), source),
        }
        let row = tile_list::encode(entry)?;
        self.failed = true;
        if let Err(source) = self.list.write_all(&row) {
            return failed(&self.folder, &format!("list tile {id}"), source);
        }
        self.failed = false;
        self.tiles += 1;
        Ok(())
    }

    /// Writes the chunks of a tile. Returns their offset.
    fn write(&mut self, entry: &TileEntry, chunks: [&[u8]; 3]) -> io::Result<u64> {
        let file = level_file(&mut self.files, usize::from(entry.id.level), &self.folder)?;
        let offset = file.end;
        self.failed = true;
        for chunk in chunks {
            file.file.write_all(chunk)?;
        }
        self.failed = false;
        file.end += entry.chunks.bytes();
        Ok(offset)
    }

    /// Takes over all tiles of a finished piece, the folder `piece`, as they were at its mark.
    /// Returns their rows. Their chunks stay where they are until the file is put together.
    pub fn adopt(&mut self, piece: &Path, mark: &Mark) -> Result<Vec<TileEntry>> {
        let path = piece.join(LIST);
        let mut file = crate::file::open(&path).map_err(|source| Error::io(&path, "open", source))?;
        let mut entries = read_list(&mut file, mark, &path)?;
        let mut bases = Vec::with_capacity(mark.levels.len());
        for (level, &end) in mark.levels.iter().enumerate() {
            let path = piece.join(level_name(level));
            let file = crate::file::open(&path).map_err(|source| Error::io(&path, "open", source))?;
            let length = file.metadata().map_err(|source| Error::io(&path, "look at it", source))?.len();
            if length < end {
                return Err(Error::format("chunks", format!("{end} bytes"), length).at(&path));
            }
            let level = level_file(&mut self.files, level, &self.folder)
                .map_err(|source| self.folder.failed("begin a level", source))?;
            let base = level.adopted.last().map_or(ADOPTED, |adopted| adopted.end);
            bases.push(base);
            level.adopted.push(Adopted { base, end: base + end, file });
        }
        for entry in &mut entries {
            entry.chunks.offset += bases[usize::from(entry.id.level)];
        }
        self.tiles += entries.len() as u64;
        Ok(entries)
    }

    /// Writes out what is buffered, and returns how far the files are.
    pub fn mark(&mut self) -> Result<Mark> {
        self.check()?;
        let mut flush = || -> io::Result<Vec<u64>> {
            self.list.flush()?;
            let mut levels = Vec::with_capacity(self.files.len());
            for level in 0..self.files.len() {
                // A level that has no tile yet gets its empty file: a mark names every level.
                let file = level_file(&mut self.files, level, &self.folder)?;
                file.file.flush()?;
                levels.push(file.end);
            }
            Ok(levels)
        };
        let levels = flush().map_err(|source| self.folder.failed("write what is done so far", source))?;
        Ok(Mark { levels, tiles: self.tiles })
    }

    /// The files behind the last mark. They must be synced before a state that holds the mark
    /// counts.
    pub fn files(&self) -> Result<Vec<File>> {
        let files =
            self.files.iter().flatten().map(|level| level.file.get_ref()).chain([self.list.get_ref()]);
        files
            .map(File::try_clone)
            .collect::<io::Result<_>>()
            .map_err(|source| self.folder.failed("open a file twice", source))
    }

    /// Fails if a tile could not be written.
    pub fn check(&self) -> Result<()> {
        if self.failed { Err(spent()) } else { Ok(()) }
    }

    /// The chunks of a level, written out, if the level has any.
    pub fn level(&mut self, level: usize) -> io::Result<Option<&LevelFile>> {
        let Some(file) = self.files.get_mut(level).and_then(Option::as_mut) else { return Ok(None) };
        file.file.flush()?;
        Ok(Some(file))
    }

    /// The work folder.
    pub fn folder(&self) -> &WorkFolder {
        &self.folder
    }

    /// The work folder, to be kept, discarded or published.
    pub fn folder_mut(&mut self) -> &mut WorkFolder {
        &mut self.folder
    }

    /// Makes the folder a piece: writes the state, syncs all files and gives the folder the
    /// output's name.
    pub fn finish_piece(mut self, state: &[u8]) -> Result<()> {
        for file in self.files()? {
            file.sync_data().map_err(|source| self.folder.failed("sync the piece", source))?;
        }
        self.folder.write_state(state)?;
        let Self { files, list, folder, .. } = self;
        // Closed before the folder moves.
        drop((files, list));
        folder.publish_folder()
    }
}

/// The error of a writer in which a write has failed.
pub(crate) fn spent() -> Error {
    Error::usage("a tile could not be written; the file cannot be finished")
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
fn read_list(file: &mut File, mark: &Mark, path: &Path) -> Result<Vec<TileEntry>> {
    let mut bytes = Vec::new();
    file.take(mark.tiles.saturating_mul(tile_list::BYTES as u64))
        .read_to_end(&mut bytes)
        .map_err(|source| Error::io(path, "read it", source))?;
    let rows = bytes.chunks_exact(tile_list::BYTES);
    if rows.len() as u64 != mark.tiles {
        return Err(Error::format("list of tiles", format!("{} tiles", mark.tiles), rows.len()).at(path));
    }
    let mut entries = Vec::with_capacity(rows.len());
    for row in rows {
        let Some(row) = row.first_chunk() else { continue };
        let entry = tile_list::decode(row).map_err(|error| error.at(path))?;
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
