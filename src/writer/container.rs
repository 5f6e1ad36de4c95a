//! [`ContainerWriter`]: chunks go to one file per level as they come, and at the end to their
//! places.
//!
//! Memory is one row per tile, whatever the area. The output appears by one rename when it is whole
//! and synced.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

use rayon::prelude::*;

use super::imagery::ImagerySections;
use super::sections::{check_sizes, opening};
use super::tile::{FileSummary, LevelBytes, TileChunks, TileRecord};
use crate::codec::frame;
use crate::container::assemble::Tree;
use crate::container::directory::{ChunkPlace, TileEntry};
use crate::container::layout::Header;
use crate::container::metadata::{Metadata, Statistics};
use crate::container::opening::Opening;
use crate::container::sections;
use crate::error::{Error, Result};
use crate::progress::{Progress, Silent, Stage};
use crate::work_folder::{BUFFER, Earlier, Mark, TileStore, WorkFolder};

/// Tiles copied between two cancellation checks.
const TILES_AT_ONCE: usize = 256;
/// Tiles copied by one thread at a time, some 500 KB of most rasters.
const TILES_A_THREAD: usize = 16;

/// Writes one container. Dropped before [`ContainerWriter::finish`], it leaves nothing behind,
/// unless a state was written from which the build can be resumed.
pub struct ContainerWriter {
    store: TileStore,
    tree: Tree,
    levels: Vec<LevelBytes>,
    imagery: Option<ImagerySections>,
}

impl ContainerWriter {
    /// Begins a file. Refuses an existing output unless `force`, and an output that another build
    /// is writing.
    pub fn create(output: &Path, force: bool) -> Result<Self> {
        let earlier = if force { Earlier::Discard } else { Earlier::Refuse };
        Self::begin(WorkFolder::take(output, force, earlier)?)
    }

    /// Begins a file in a work folder.
    pub fn begin(work: WorkFolder) -> Result<Self> {
        Ok(Self::of(TileStore::begin(work)?))
    }

    /// Goes on with the tiles of a work folder as they were at a mark; what was written after it is
    /// cut off.
    pub fn resume(work: WorkFolder, mark: &Mark) -> Result<Self> {
        let (store, entries) = TileStore::resume(work, mark)?;
        let mut writer = Self::of(store);
        entries.into_iter().try_for_each(|entry| writer.push(entry))?;
        Ok(writer)
    }

    fn of(store: TileStore) -> Self {
        Self { store, tree: Tree::default(), levels: Vec::new(), imagery: None }
    }

    /// Takes over all tiles of a finished piece, the folder `piece`, as they were at its mark.
    pub fn adopt(&mut self, piece: &Path, mark: &Mark) -> Result<()> {
        let entries = self.store.adopt(piece, mark)?;
        entries.into_iter().try_for_each(|entry| self.push(entry))
    }

    /// Adds a tile. Tiles may come in any order, each once; levels may be mixed.
    pub fn append(&mut self, record: &TileRecord, chunks: &TileChunks) -> Result<()> {
        let id = record.id;
        self.tree.check_new(id)?;
        let parts = [&chunks.heights[..], &chunks.mask, &chunks.errors];
        let mut place = ChunkPlace::default();
        for (index, part) in parts.iter().enumerate() {
            let most = u32::MAX;
            place.lengths[index] = u32::try_from(part.len())
                .map_err(|_| Error::limit(format!("chunk of tile {id}"), part.len() as u64, most.into()))?;
            place.crcs[index] = crc32fast::hash(part);
        }
        let mut entry = record.entry(place);
        entry.check()?;
        self.store.append(&mut entry, parts)?;
        self.tree.push(entry);
        self.count(usize::from(id.level), place.lengths);
        Ok(())
    }

    /// Adds a tile whose chunks are in the store.
    fn push(&mut self, entry: TileEntry) -> Result<()> {
        self.tree.check_new(entry.id)?;
        self.tree.push(entry);
        self.count(usize::from(entry.id.level), entry.chunks.lengths);
        Ok(())
    }

    /// Gives the file an imagery layer. The metadata of [`ContainerWriter::finish`] are to tell of
    /// it too.
    pub fn attach(&mut self, imagery: ImagerySections) {
        self.imagery = Some(imagery);
    }

    /// The tiles so far, in their work folder.
    pub fn store(&self) -> &TileStore {
        &self.store
    }

    /// The tiles so far, to be marked, or the folder to be kept or discarded.
    pub fn store_mut(&mut self) -> &mut TileStore {
        &mut self.store
    }

    /// Makes the work folder a piece, to be merged with others.
    pub fn finish_piece(self, state: &[u8]) -> Result<()> {
        self.store.finish_piece(state)
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
        self.store.folder().output()
    }

    /// Puts the file together, syncs it and gives it its name. `header.tile_count` is set to what
    /// came.
    pub fn finish(
        self,
        header: &Header,
        metadata: &Metadata,
        statistics: &Statistics,
    ) -> Result<FileSummary> {
        self.finish_while(header, metadata, statistics, &|_| Ok(()), &Silent)
    }

    /// [`ContainerWriter::finish`], but fails with [`Error::Interrupted`] if `progress`, which
    /// hears of the tiles copied, says so, and with the error of `inspect`, which is shown the
    /// whole file before it gets its name.
    pub fn finish_while(
        mut self,
        header: &Header,
        metadata: &Metadata,
        statistics: &Statistics,
        inspect: &dyn Fn(&Path) -> Result<()>,
        progress: &dyn Progress,
    ) -> Result<FileSummary> {
        self.store.check()?;
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
        let path = self.store.folder().path("assembled");
        let bytes = |kind| opening.sections.iter().find(|s| s.kind == kind).map_or(0, |s| s.length);
        let parts = (small.as_slice(), index.pages.as_slice());
        if !self
            .assemble(&path, &opening, parts, &sources, progress)
            .map_err(|source| self.store.folder().failed("write the file", source))?
        {
            return Err(Error::Interrupted);
        }
        inspect(&path)?;
        self.store.folder_mut().publish(&path)?;
        Ok(FileSummary {
            path: self.store.folder().output().to_owned(),
            file_bytes: opening.file_length,
            tiles: self.tree.count(),
            levels: self.levels.clone(),
            index_bytes: bytes(sections::ROOT_PAGE) + bytes(sections::PAGES),
            metadata_bytes: bytes(sections::METADATA),
            statistics_bytes: bytes(sections::STATISTICS),
            imagery_bytes: self.imagery.as_ref().map_or(0, ImagerySections::bytes),
        })
    }

    /// Writes and syncs the file under its working name. False if told to stop. What it is made of
    /// stays: a build that fails here can be resumed.
    fn assemble(
        &mut self,
        path: &Path,
        opening: &Opening,
        (small, pages): (&[(u32, Vec<u8>)], &[u8]),
        sources: &[Vec<u64>],
        progress: &dyn Progress,
    ) -> io::Result<bool> {
        let Some(tiles) = opening.sections.iter().find(|section| section.kind == sections::TILES) else {
            return Err(io::Error::other("there is no section for the tiles"));
        };
        let mut out = BufWriter::with_capacity(BUFFER, File::create(path)?);
        out.write_all(&opening.encode())?;
        for (_, bytes) in small {
            out.write_all(bytes)?;
        }
        // Most of it is the system finding memory for the new file's pages, which threads do side
        // by side.
        let file = out.into_inner().map_err(io::IntoInnerError::into_error)?;
        let (mut done, total) = (0, self.tree.count());
        for (level, sources) in sources.iter().enumerate() {
            let Some(chunks) = self.store.level(level)? else { continue };
            let entries = self.tree.level(level as u8);
            for (entries, sources) in entries.chunks(TILES_AT_ONCE).zip(sources.chunks(TILES_AT_ONCE)) {
                let pieces = entries.par_chunks(TILES_A_THREAD).zip(sources.par_chunks(TILES_A_THREAD));
                pieces.try_for_each(|(entries, sources)| {
                    chunks.copy_tiles(entries, sources, &file, tiles.offset)
                })?;
                done += entries.len() as u64;
                if !progress.goes_on(Stage::Write, done, total) {
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
