//! The reader of a container: header and root page at once, other pages and tiles on demand, from
//! many threads.
//!
//! Every byte is checked against its CRC and every number against its limit before it is used. A
//! damaged file gives an error that says where; it never gives wrong heights, and never takes more
//! memory than its own size and the caches explain. Nothing is mapped: a file that changes
//! underneath gives errors, not signals.
//!
//! There is no way to decode masks alone: a mask needs its parent's, and the states come with the
//! heights of [`Reader::read_tile`]. To count samples, use [`Reader::statistics`].

mod alone;
mod imagery;
mod index;
mod tiles;
mod walk;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use super::cache::{Lattices, POOLED};
use super::directory::{ChunkKind, TileEntry};
use super::foreign;
use super::layout::Header;
use super::metadata::{Metadata, Statistics};
use super::opening::{OPENING_BYTES, Opening};
use super::sections::{self, SectionEntry};
use crate::codec::table::ErrorTable;
use crate::codec::{self, frame};
use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::limits::Limits;
use crate::read_at::ReadAt;
use crate::tile::TileId;
pub use imagery::ImageryLayer;
use index::{Index, Input};

/// Bytes of scratch memory for each sample of a tile that a thread decodes: its chunks and the
/// memory of the codec.
const SCRATCH_BYTES: u64 = 24;

/// The limits of a reader: what it caches and what it accepts.
#[derive(Clone, Copy, Debug)]
pub struct ReaderOptions {
    /// Bytes of decoded tiles and pages to cache (default 64 MiB), an eighth of it for pages. The
    /// ancestors of the tile that is being read stay in any case.
    pub cache_bytes: u64,
    /// Limits for the numbers of the file.
    pub limits: Limits,
    /// Bytes of memory that the reading program keeps within (default: no limit): by it an export
    /// and a verification choose how they work, or refuse.
    pub memory: Option<u64>,
}

impl ReaderOptions {
    /// The options of a program that keeps within `memory` bytes. With a limit the cache is
    /// smaller, and the same for all limits, so that the memory needed does not grow with the
    /// limit.
    pub fn within(memory: Option<u64>) -> Self {
        let options = Self::default();
        let cache_bytes = memory.map_or(options.cache_bytes, |_| 16 << 20);
        Self { cache_bytes, memory, ..options }
    }
}

impl Default for ReaderOptions {
    fn default() -> Self {
        Self { cache_bytes: 64 << 20, limits: Limits::default(), memory: None }
    }
}

/// An open container.
pub struct Reader {
    input: Arc<Input>,
    opening: Opening,
    metadata: Metadata,
    geo: Geo,
    options: ReaderOptions,
    index: Index<Header, TileEntry>,
    imagery: Option<ImageryLayer>,
    lattices: Lattices,
    /// Scratch memory that no thread uses now.
    pool: Mutex<Vec<tiles::Scratch>>,
}

impl Reader {
    /// Opens a file with the default options.
    #[cfg(any(unix, windows))]
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_with(path, ReaderOptions::default())
    }

    /// Opens a file: reads and checks header, section table, root page and metadata.
    #[cfg(any(unix, windows))]
    pub fn open_with(path: impl AsRef<Path>, options: ReaderOptions) -> Result<Self> {
        let path = path.as_ref();
        let file = crate::read_at::open(path).map_err(|source| Error::io(path, "open", source))?;
        Self::new(file, path, options)
    }

    /// Opens bytes from anywhere: reads and checks header, section table, root page and metadata.
    /// Messages call them `name`.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// use relevo_core::ReaderOptions;
    ///
    /// let bytes = std::fs::read(path).unwrap();
    /// let reader = Reader::new(bytes, "in memory", ReaderOptions::default())?;
    /// assert_eq!(reader.header().width, 70);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn new(
        bytes: impl ReadAt + 'static,
        name: impl Into<PathBuf>,
        options: ReaderOptions,
    ) -> Result<Self> {
        let input = Input { path: name.into(), bytes: Box::new(bytes) };
        let name = input.path.clone();
        Self::of_input(input, options).map_err(|error| error.at(&name))
    }

    fn of_input(input: Input, options: ReaderOptions) -> Result<Self> {
        let (path, input) = (input.path.clone(), Arc::new(input));
        let length = input.bytes.byte_count().map_err(|source| Error::io(&path, "look at", source))?;
        let start = input.read(0, length.min(OPENING_BYTES), "the start of the file")?;
        if let Some(error) = foreign::refused(&start, &path) {
            return Err(error);
        }
        let opening = Opening::decode(&start, length)?;
        let section = |kind| opening.sections.iter().find(|section| section.kind == kind).copied();
        let must =
            |kind| section(kind).ok_or_else(|| Error::format("section table", "all sections", "fewer"));
        let (tiles, pages) = (must(sections::TILES)?, must(sections::PAGES)?);
        let metadata = Metadata::decode(small_section(&start, &must(sections::METADATA)?)?)?;
        let root = small_section(&start, &must(sections::ROOT_PAGE)?)?;
        let for_pages = options.cache_bytes / 8;
        let header = opening.header.clone();
        let count = header.tile_count;
        let index = Index::new(root, header, count, [tiles, pages], options.limits, for_pages)?;
        let imagery = ImageryLayer::open(&input, &start, &opening, options.limits, for_pages)?;
        let geo = Geo {
            transform: opening.header.transform,
            pixel_is_point: metadata.pixel_is_point,
            crs: metadata.crs.clone(),
        };
        Ok(Self {
            input,
            opening,
            metadata,
            geo,
            options,
            index,
            imagery,
            lattices: Lattices::new(options.cache_bytes - for_pages),
            pool: Mutex::default(),
        })
    }

    /// The header: the terrain of the file.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// let header = reader.header();
    /// assert_eq!((header.width, header.height, header.tile()), (70, 50, 16));
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn header(&self) -> &Header {
        &self.opening.header
    }

    /// The metadata: facts for people and for an export.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The georeference of the terrain.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// let (x, y) = reader.geo().world_from_sample(0.0, 0.0);
    /// assert!((x - 10.005).abs() < 1e-9 && (y - 61.9975).abs() < 1e-9);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn geo(&self) -> &Geo {
        &self.geo
    }

    /// The path of the file.
    pub fn path(&self) -> &Path {
        &self.input.path
    }

    /// The length of the file in bytes.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// assert_eq!(reader.file_len(), 13_095);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn file_len(&self) -> u64 {
        self.opening.file_length
    }

    /// The sections of the file, including those of unknown kinds.
    pub fn sections(&self) -> &[SectionEntry] {
        &self.opening.sections
    }

    /// The imagery layer, if the file has one.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// assert!(reader.imagery().is_none());
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn imagery(&self) -> Option<&ImageryLayer> {
        self.imagery.as_ref()
    }

    /// Bytes of memory that the reading program keeps within; `None`: no limit.
    pub fn memory_limit(&self) -> Option<u64> {
        self.options.memory
    }

    /// Most bytes of memory that reading tiles on `threads` threads takes: the caches, the tiles
    /// that are being decoded with their ancestors, and scratch memory.
    pub fn memory(&self, threads: usize) -> u64 {
        let (header, threads) = (self.header(), threads as u64);
        let samples = (u64::from(header.tile()) + 1).pow(2);
        let lattice = samples * if header.coding.has_low() { 9 } else { 5 } + 256;
        let (all, cache) = (header.tile_count, self.options.cache_bytes);
        let at_hand = (threads + 1) * (u64::from(header.levels) + 2) + POOLED as u64;
        let layers = 1 + u64::from(self.imagery.is_some());
        let kept = all.saturating_mul(lattice).min(cache).saturating_add(layers * (cache / 8 + (1 << 20)));
        kept.saturating_add(all.min(at_hand).saturating_mul(lattice))
            .saturating_add(threads * samples * SCRATCH_BYTES)
    }

    /// The statistics, if the file has any.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// assert_eq!(reader.statistics()?.unwrap().levels.len(), 4);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn statistics(&self) -> Result<Option<Statistics>> {
        let Some(section) = self.sections().iter().find(|section| section.kind == sections::STATISTICS)
        else {
            return Ok(None);
        };
        self.decode_statistics(section).map(Some).map_err(|error| error.at(self.path()))
    }

    fn decode_statistics(&self, section: &SectionEntry) -> Result<Statistics> {
        let max = self.options.limits.statistics_bytes;
        if section.length > max {
            return Err(Error::limit("length of the statistics", section.length, max));
        }
        let packed = self.input.read(section.offset, section.length, "the statistics")?;
        check_crc(&packed, section.crc, || format!("statistics at offset {}", section.offset))?;
        let mut json = Vec::new();
        frame::decompress(&packed, 1..=usize::try_from(max).unwrap_or(usize::MAX), "statistics", &mut json)?;
        let statistics = Statistics::decode(&json)?;
        let levels = usize::from(self.header().levels) + 1;
        if statistics.levels.len() != levels {
            return Err(Error::format("statistics", format!("{levels} levels"), statistics.levels.len()));
        }
        Ok(statistics)
    }

    /// The index row of a tile; `None` if the tile does not exist.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// let root = reader.entry(TileId::ROOT)?.unwrap();
    /// assert_eq!((root.min_m, root.max_m, root.children), (61.0, 739.0, 0b0011));
    /// assert!(reader.entry(TileId::new(1, 0, 1))?.is_none());
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn entry(&self, id: TileId) -> Result<Option<TileEntry>> {
        self.index.entry(&self.input, id)
    }

    /// A chunk as stored, checked against its CRC.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// use relevo_core::ChunkKind;
    ///
    /// assert_eq!(reader.raw_chunk(TileId::ROOT, ChunkKind::Heights)?.len(), 210);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn raw_chunk(&self, id: TileId, kind: ChunkKind) -> Result<Vec<u8>> {
        let entry = self.existing(id)?;
        self.chunk(&entry, kind).map_err(|error| error.at(self.path()))
    }

    fn chunk(&self, entry: &TileEntry, kind: ChunkKind) -> Result<Vec<u8>> {
        let (offset, length, crc) = entry.chunks.chunk(kind);
        let offset = self.index.tiles.offset + offset;
        let bytes = self.input.read(offset, length.into(), kind.name())?;
        check_crc(&bytes, crc, || format!("tile {}, {} chunk at offset {offset}", entry.id, kind.name()))?;
        Ok(bytes)
    }

    /// The error table of a tile.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// let errors = reader.read_errors(TileId::ROOT)?;
    /// assert_eq!((errors.patches, errors.steps), (4, 3));
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn read_errors(&self, id: TileId) -> Result<ErrorTable> {
        let chunk = self.raw_chunk(id, ChunkKind::Errors)?;
        let (patches, steps) = (self.header().patches() as usize, self.header().steps() as usize);
        codec::table::decode(&chunk, patches, steps).map_err(|error| self.in_tile(id, error))
    }

    fn existing(&self, id: TileId) -> Result<TileEntry> {
        let absent = || Error::usage(format!("there is no tile {id} in {}", self.path().display()));
        self.entry(id)?.ok_or_else(absent)
    }

    /// Fails unless a section with a CRC of its own agrees with it.
    pub fn check_section(&self, section: &SectionEntry) -> Result<()> {
        if section.flags & sections::COVERED == 0 {
            return Ok(());
        }
        let mut crc = crc32fast::Hasher::new();
        let mut done = 0;
        while done < section.length {
            let bytes =
                self.input.read(section.offset + done, (section.length - done).min(1 << 20), "a section")?;
            crc.update(&bytes);
            done += bytes.len() as u64;
        }
        compare_crc(crc.finalize(), section.crc, || format!("section {}", section.name()))
            .map_err(|error| error.at(self.path()))
    }

    /// Adds the tile to an error of the codec.
    fn in_tile(&self, id: TileId, mut error: Error) -> Error {
        if let Error::Format { place, .. } = &mut error {
            *place = format!("tile {id}, {place}");
        }
        error.at(self.path())
    }
}

/// The bytes of a section that lies in the start of the file.
fn small_section<'a>(start: &'a [u8], section: &SectionEntry) -> Result<&'a [u8]> {
    let range = section.offset as usize..section.end() as usize;
    let bytes = start.get(range).ok_or_else(|| {
        Error::format(
            section.name(),
            format!("its end within the first {OPENING_BYTES} bytes"),
            section.end(),
        )
    })?;
    check_crc(bytes, section.crc, || format!("{} at offset {}", section.name(), section.offset))?;
    Ok(bytes)
}

fn check_crc(bytes: &[u8], expected: u32, place: impl Fn() -> String) -> Result<()> {
    compare_crc(crc32fast::hash(bytes), expected, place)
}

fn compare_crc(got: u32, expected: u32, place: impl Fn() -> String) -> Result<()> {
    if got == expected {
        return Ok(());
    }
    Err(Error::format(place(), format!("CRC {expected:08X}"), format!("{got:08X}: damaged")))
}
