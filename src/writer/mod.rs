//! Writes a container: chunks go to one file per level as they come, and at the end into their places.
//!
//! Memory is one row per tile, whatever the area. The output appears by one rename when it is whole and synced; until
//! then all lies in a work folder beside it, which goes when the writer goes, unless a state was written from which the build can be
//! resumed. The same tiles give the same bytes in whatever order they came. The writer knows no samples: what a chunk means
//! is the codec's affair.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::codec::frame;
use crate::container::assemble::Tree;
use crate::container::directory::{ChunkKind, ChunkPlace, TileEntry};
use crate::container::layout::Header;
use crate::container::metadata::{Metadata, Statistics};
use crate::container::opening::{OPENING_BYTES, Opening};
use crate::container::sections::{self, SectionEntry};
use crate::error::{Error, Result};
use crate::tile::TileId;
use work::{Earlier, WorkFolder};

pub mod amend;
mod imagery;
mod levels;
mod records;
mod unfinished;
pub mod work;

pub use imagery::{ImagerySections, ImageryWriter};
pub use unfinished::Mark;

use levels::{LevelFile, copy_tiles, level_file, open};

const BUFFER: usize = 1 << 20;
/// Index rows of the tiles in the order in which they came.
const RECORDS: &str = "records";
/// Tiles copied between two questions whether to go on.
const TILES_AT_ONCE: usize = 256;
/// Tiles copied by one thread at a time, some 500 KB of most rasters.
const TILES_A_THREAD: usize = 16;

/// What the index says of a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileRecord {
    /// Which tile.
    pub id: TileId,
    /// Bit `q` is set if child `q` exists.
    pub children: u8,
    /// True if the tile's own lattice has a valid sample.
    pub has_valid: bool,
    /// True if it has a void one.
    pub has_void: bool,
    /// Error code: the largest vertical error of its patches at step 0.
    pub vertical: u16,
    /// Error code: the largest horizontal error likewise.
    pub horizontal: u16,
    /// Lowest height in metres of what is below, rounded down.
    pub min_m: f32,
    /// Greatest height in metres, rounded up.
    pub max_m: f32,
}

/// The chunks of a tile as they are stored.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TileChunks {
    /// Heights (section 9); empty if all residuals are 0.
    pub heights: Vec<u8>,
    /// Void mask (section 8); empty unless the tile has valid and void samples.
    pub mask: Vec<u8>,
    /// Error table (section 10).
    pub errors: Vec<u8>,
}

/// What a level takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LevelBytes {
    /// Tiles.
    pub tiles: u64,
    /// Bytes of their heights.
    pub heights: u64,
    /// Bytes of their masks.
    pub masks: u64,
    /// Bytes of their error tables.
    pub errors: u64,
}

impl LevelBytes {
    /// Bytes of all chunks.
    pub fn bytes(self) -> u64 {
        self.heights + self.masks + self.errors
    }
}

/// What was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileSummary {
    /// The file.
    pub path: PathBuf,
    /// Its length.
    pub file_bytes: u64,
    /// Tiles of all levels.
    pub tiles: u64,
    /// The levels, root first.
    pub levels: Vec<LevelBytes>,
    /// Bytes of the index as stored.
    pub index_bytes: u64,
    /// Bytes of the metadata section.
    pub metadata_bytes: u64,
    /// Bytes of the statistics section as stored.
    pub statistics_bytes: u64,
    /// Bytes of the imagery layer.
    pub imagery_bytes: u64,
}

/// Writes one container; dropped before [`ContainerWriter::finish`], it leaves nothing behind but what a state needs.
pub struct ContainerWriter {
    // Closed before the folder is removed: fields drop in this order.
    files: Vec<Option<LevelFile>>,
    records: BufWriter<File>,
    tree: Tree,
    levels: Vec<LevelBytes>,
    imagery: Option<ImagerySections>,
    failed: bool,
    work: WorkFolder,
}

impl ContainerWriter {
    /// Begins a file. Refuses an existing output unless `force`, and an output that another build is writing.
    pub fn create(output: &Path, force: bool) -> Result<Self> {
        let earlier = if force { Earlier::Discard } else { Earlier::Refuse };
        Self::begin(WorkFolder::take(output, force, earlier)?)
    }

    /// Begins a file in a work folder.
    pub fn begin(work: WorkFolder) -> Result<Self> {
        let file = open(&work.path(RECORDS), true)
            .map_err(|source| work.failed("begin the list of tiles", source))?;
        let records = BufWriter::with_capacity(BUFFER, file);
        Ok(Self {
            files: Vec::new(),
            records,
            tree: Tree::default(),
            levels: Vec::new(),
            imagery: None,
            failed: false,
            work,
        })
    }

    /// Adds a tile. Tiles may come in any order, each once; levels may be mixed.
    pub fn append(&mut self, record: &TileRecord, chunks: &TileChunks) -> Result<()> {
        let id = record.id;
        self.tree.check_new(id)?;
        let parts = [&chunks.heights, &chunks.mask, &chunks.errors];
        let mut place = ChunkPlace::default();
        for (index, part) in parts.iter().enumerate() {
            let most = u32::MAX;
            place.lengths[index] = u32::try_from(part.len())
                .map_err(|_| Error::limit(format!("chunk of tile {id}"), part.len() as u64, most.into()))?;
            place.crcs[index] = crc32fast::hash(part);
        }
        let mut entry = entry_of(record, place);
        entry.check()?;
        let level = usize::from(id.level);
        let failed = &mut self.failed;
        let work = &self.work;
        let mut write = || -> io::Result<u64> {
            let file = level_file(&mut self.files, level, work)?;
            let offset = file.end;
            // A write that fails part of the way leaves bytes that no row counts: the writer is spent.
            *failed = true;
            for part in parts {
                file.file.write_all(part)?;
            }
            *failed = false;
            file.end += place.bytes();
            Ok(offset)
        };
        entry.chunks.offset = write().map_err(|source| work.failed(&format!("write tile {id}"), source))?;
        self.record(&entry).map_err(|source| self.work.failed(&format!("list tile {id}"), source))?;
        self.tree.push(entry);
        self.count(level, place.lengths);
        Ok(())
    }

    /// Adds a tile to the list in the work folder.
    fn record(&mut self, entry: &TileEntry) -> io::Result<()> {
        self.failed = true;
        self.records.write_all(&records::encode(entry))?;
        self.failed = false;
        Ok(())
    }

    /// Adds a tile whose chunks are in the files.
    fn push(&mut self, entry: TileEntry) -> Result<()> {
        self.tree.check_new(entry.id)?;
        self.tree.push(entry);
        self.count(usize::from(entry.id.level), entry.chunks.lengths);
        Ok(())
    }

    /// Gives the file an imagery layer. The metadata of [`ContainerWriter::finish`] are to tell of it too.
    pub fn attach(&mut self, imagery: ImagerySections) {
        self.imagery = Some(imagery);
    }

    /// The work folder.
    pub fn work(&self) -> &WorkFolder {
        &self.work
    }

    /// The work folder, to keep a state in.
    pub fn work_mut(&mut self) -> &mut WorkFolder {
        &mut self.work
    }

    fn count(&mut self, level: usize, lengths: [u32; 3]) {
        if self.levels.len() <= level {
            self.levels.resize(level + 1, LevelBytes::default());
        }
        let bytes = &mut self.levels[level];
        let [heights, mask, errors] = lengths.map(u64::from);
        bytes.tiles += 1;
        bytes.heights += heights;
        bytes.masks += mask;
        bytes.errors += errors;
    }

    /// What a level takes so far.
    pub fn level_bytes(&self, level: u8) -> LevelBytes {
        self.levels.get(usize::from(level)).copied().unwrap_or_default()
    }

    /// Tiles so far, all levels.
    pub fn tile_count(&self) -> u64 {
        self.tree.count()
    }

    /// The output, with links followed.
    pub fn output(&self) -> &Path {
        self.work.output()
    }

    /// Puts the file together, syncs it and gives it its name. `header.tile_count` is set to what came.
    pub fn finish(
        self,
        header: &Header,
        metadata: &Metadata,
        statistics: &Statistics,
    ) -> Result<FileSummary> {
        self.finish_while(header, metadata, statistics, &|_| Ok(()), &mut |_, _| true)
    }

    /// [`ContainerWriter::finish`], but stops with [`Error::Interrupted`] when `go_on`, told the tiles copied and their total, says no, and
    /// with the error of `inspect`, which is shown the whole file before it gets its name.
    pub fn finish_while(
        mut self,
        header: &Header,
        metadata: &Metadata,
        statistics: &Statistics,
        inspect: &dyn Fn(&Path) -> Result<()>,
        go_on: &mut dyn FnMut(u64, u64) -> bool,
    ) -> Result<FileSummary> {
        if self.failed {
            return Err(spent());
        }
        let header = Header { tile_count: self.tree.count(), ..header.clone() };
        self.tree.check(&header)?;
        header.check()?;
        check_sizes(&self.tree, &header)?;
        let metadata = metadata.encode()?;
        let mut packed = Vec::new();
        frame::compress(&statistics.encode()?, &mut packed)?;
        let statistics = packed;
        let (sources, tiles_bytes) = self.tree.place();
        let index = self.tree.pages(header.levels)?;
        let mut small = vec![(sections::ROOT_PAGE, index.root), (sections::METADATA, metadata)];
        small.extend(self.imagery.as_ref().map(|imagery| (sections::IMAGERY, imagery.opening.clone())));
        small.push((sections::STATISTICS, statistics));
        let mut large = vec![(sections::TILES, tiles_bytes), (sections::PAGES, index.pages.len() as u64)];
        large.extend(self.imagery.iter().flat_map(ImagerySections::large));
        let opening = opening(header, &small, &large)?;
        let path = self.work.path("assembled");
        let bytes = |kind| opening.sections.iter().find(|s| s.kind == kind).map_or(0, |s| s.length);
        let parts = (small.as_slice(), index.pages.as_slice());
        if !self
            .assemble(&path, &opening, parts, &sources, go_on)
            .map_err(|source| self.work.failed("write the file", source))?
        {
            return Err(Error::Interrupted);
        }
        inspect(&path)?;
        self.work.publish(&path)?;
        Ok(FileSummary {
            path: self.work.output().to_owned(),
            file_bytes: opening.file_length,
            tiles: self.tree.count(),
            levels: self.levels.clone(),
            index_bytes: bytes(sections::ROOT_PAGE) + bytes(sections::PAGES),
            metadata_bytes: bytes(sections::METADATA),
            statistics_bytes: bytes(sections::STATISTICS),
            imagery_bytes: self.imagery.as_ref().map_or(0, ImagerySections::bytes),
        })
    }

    /// Writes and syncs the file under its working name. False if told to stop. What it is made of stays: a build that fails here
    /// can be resumed.
    fn assemble(
        &mut self,
        path: &Path,
        opening: &Opening,
        (small, pages): (&[(u32, Vec<u8>)], &[u8]),
        sources: &[Vec<u64>],
        go_on: &mut dyn FnMut(u64, u64) -> bool,
    ) -> io::Result<bool> {
        let Some(tiles) = opening.sections.iter().find(|section| section.kind == sections::TILES) else {
            return Err(io::Error::other("there is no section for the tiles"));
        };
        let mut out = BufWriter::with_capacity(BUFFER, File::create(path)?);
        out.write_all(&opening.encode())?;
        for (_, bytes) in small {
            out.write_all(bytes)?;
        }
        // Most of it is the system finding memory for the new file's pages, which threads do side by side.
        let file = out.into_inner().map_err(io::IntoInnerError::into_error)?;
        let (mut done, total) = (0, self.tree.count());
        for (level, sources) in sources.iter().enumerate() {
            let Some(level_file) = self.files.get_mut(level).and_then(Option::as_mut) else { continue };
            level_file.file.flush()?;
            let (level_file, entries) = (&*level_file, self.tree.level(level as u8));
            for (entries, sources) in entries.chunks(TILES_AT_ONCE).zip(sources.chunks(TILES_AT_ONCE)) {
                let pieces = entries.par_chunks(TILES_A_THREAD).zip(sources.par_chunks(TILES_A_THREAD));
                pieces.try_for_each(|(entries, sources)| {
                    copy_tiles(level_file, entries, sources, (&file, tiles.offset))
                })?;
                done += entries.len() as u64;
                if !go_on(done, total) {
                    return Ok(false);
                }
            }
        }
        let mut out = BufWriter::with_capacity(BUFFER, file);
        out.seek(SeekFrom::Start(tiles.end()))?;
        out.write_all(pages)?;
        if let Some(imagery) = &self.imagery {
            imagery.copy(&mut out)?;
        }
        let file = out.into_inner().map_err(io::IntoInnerError::into_error)?;
        let length = file.metadata()?.len();
        if length != opening.file_length {
            let what = format!("{length} bytes arrived of {}", opening.file_length);
            return Err(io::Error::other(what));
        }
        file.sync_all()?;
        Ok(true)
    }
}

fn spent() -> Error {
    Error::usage("a tile could not be written; the file cannot be finished")
}

fn entry_of(record: &TileRecord, chunks: ChunkPlace) -> TileEntry {
    TileEntry {
        id: record.id,
        children: record.children,
        has_valid: record.has_valid,
        has_void: record.has_void,
        vertical: record.vertical,
        horizontal: record.horizontal,
        min_m: record.min_m,
        max_m: record.max_m,
        chunks,
    }
}

/// Fails if a chunk is longer than any terrain of this tile size needs: readers would refuse it.
fn check_sizes(tree: &Tree, header: &Header) -> Result<()> {
    let most = header.max_chunk_bytes();
    for entry in (0..=header.levels).flat_map(|level| tree.level(level)) {
        for kind in ChunkKind::ALL {
            let length = u64::from(entry.chunks.chunk(kind).1);
            if length > most {
                return Err(Error::limit(
                    format!("{} chunk of tile {}", kind.name(), entry.id),
                    length,
                    most,
                ));
            }
        }
    }
    Ok(())
}

/// The section table: what is small first, then the others.
pub(super) fn opening(header: Header, small: &[(u32, Vec<u8>)], large: &[(u32, u64)]) -> Result<Opening> {
    let mut end = Opening::bytes(small.len() + large.len());
    let mut sections = Vec::with_capacity(small.len() + large.len());
    for (kind, bytes) in small {
        let section = SectionEntry::of(*kind, end, bytes.len() as u64, crc32fast::hash(bytes));
        end = section.end();
        if *kind == sections::METADATA && end > OPENING_BYTES {
            return Err(Error::limit("end of header, root page and metadata", end, OPENING_BYTES));
        }
        sections.push(section);
    }
    for &(kind, length) in large {
        let section = SectionEntry::of(kind, end, length, 0);
        end = section.end();
        sections.push(section);
    }
    Ok(Opening { header, sections, file_length: end })
}
