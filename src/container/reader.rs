//! Reads a container: header and index at once, pages and tiles when they are asked for, by many threads.
//!
//! Every byte is held against its CRC and every number against its limit before it is used. A file that is damaged gives
//! an error that says where; it never gives wrong heights, and never takes more memory than its own size and the caches
//! explain. Nothing is mapped: a file that changes underneath gives errors, not signals.
//!
//! There is no way to decode masks alone: a mask needs its parent's, and the states come with the heights of
//! [`Reader::read_tile`]. What only counts samples finds the counts in [`Reader::statistics`].

mod tiles;
mod walk;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use super::cache::{Lattices, Store};
use super::directory::{ChunkKind, Found, Page, PageRef, TileEntry};
use super::layout::Header;
use super::metadata::{Metadata, Statistics};
use super::opening::{OPENING_BYTES, Opening};
use super::sections::{self, SectionEntry};
use crate::codec::table::ErrorTable;
use crate::codec::{self, frame};
use crate::error::{Error, Result};
use crate::file::read_exact_at;
use crate::geo::Geo;
use crate::limits::Limits;
use crate::tile::TileId;

/// How much a reader keeps and accepts.
#[derive(Clone, Copy, Debug)]
pub struct ReaderOptions {
    /// Bytes of decoded tiles and pages to keep (64 MiB): an eighth of it for pages. The ancestors of the tile that is
    /// being read stay whatever they take.
    pub cache_bytes: u64,
    /// What numbers of the file are held against.
    pub limits: Limits,
}

impl Default for ReaderOptions {
    fn default() -> Self {
        Self { cache_bytes: 64 << 20, limits: Limits::default() }
    }
}

/// A page and where it stands in the pages section; `None` for the root page.
struct Loaded {
    page: Page,
    offset: Option<u64>,
}

/// An open container.
pub struct Reader {
    path: PathBuf,
    file: File,
    opening: Opening,
    metadata: Metadata,
    geo: Geo,
    limits: Limits,
    tiles: SectionEntry,
    pages: SectionEntry,
    root: Arc<Loaded>,
    loaded: Store<Loaded>,
    lattices: Lattices,
    desks: Mutex<Vec<tiles::Desk>>,
}

impl Reader {
    /// Opens a file with the default options.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_with(path, ReaderOptions::default())
    }

    /// Opens a file: reads and checks header, section table, root page and metadata.
    pub fn open_with(path: impl AsRef<Path>, options: ReaderOptions) -> Result<Self> {
        let path = path.as_ref();
        Self::open_file(path, options).map_err(|error| error.at(path))
    }

    fn open_file(path: &Path, options: ReaderOptions) -> Result<Self> {
        let file = File::open(path).map_err(|source| Error::io(path, "open", source))?;
        let length = file.metadata().map_err(|source| Error::io(path, "look at", source))?.len();
        let mut start = vec![0; length.min(OPENING_BYTES) as usize];
        read_exact_at(&file, &mut start, 0).map_err(|source| Error::io(path, "read", source))?;
        let opening = Opening::decode(&start, length)?;
        let section = |kind| opening.sections.iter().find(|section| section.kind == kind).copied();
        let must =
            |kind| section(kind).ok_or_else(|| Error::format("section table", "all sections", "fewer"));
        let (tiles, pages) = (must(sections::TILES)?, must(sections::PAGES)?);
        let count = opening.header.tile_count;
        if count > tiles.length {
            return Err(Error::format("header, tile count", format!("at most {}", tiles.length), count));
        }
        let metadata = Metadata::decode(small_section(&start, &must(sections::METADATA)?)?)?;
        let root = small_section(&start, &must(sections::ROOT_PAGE)?)?;
        let page = unpack_page(root, TileId::ROOT, &opening.header, &options.limits)?;
        check_page(&page, &opening.header, &tiles, &pages)?;
        let geo = Geo {
            transform: opening.header.transform,
            pixel_is_point: metadata.pixel_is_point,
            crs: metadata.crs.clone(),
        };
        let for_pages = options.cache_bytes / 8;
        Ok(Self {
            path: path.to_owned(),
            file,
            opening,
            metadata,
            geo,
            limits: options.limits,
            tiles,
            pages,
            root: Arc::new(Loaded { page, offset: None }),
            loaded: Store::new(for_pages),
            lattices: Lattices::new(options.cache_bytes - for_pages),
            desks: Mutex::default(),
        })
    }

    /// What the file says about its terrain.
    pub fn header(&self) -> &Header {
        &self.opening.header
    }

    /// What it says for people and for an export.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Where the terrain lies.
    pub fn geo(&self) -> &Geo {
        &self.geo
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its length in bytes.
    pub fn file_len(&self) -> u64 {
        self.opening.file_length
    }

    /// Its sections, those of unknown kinds as well.
    pub fn sections(&self) -> &[SectionEntry] {
        &self.opening.sections
    }

    /// The statistics, if the file has any.
    pub fn statistics(&self) -> Result<Option<Statistics>> {
        let Some(section) = self.sections().iter().find(|section| section.kind == sections::STATISTICS)
        else {
            return Ok(None);
        };
        self.decode_statistics(section).map(Some).map_err(|error| error.at(&self.path))
    }

    fn decode_statistics(&self, section: &SectionEntry) -> Result<Statistics> {
        let max = self.limits.statistics_bytes;
        if section.length > max {
            return Err(Error::limit("length of the statistics", section.length, max));
        }
        let packed = self.read(section.offset, section.length, "the statistics")?;
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
    pub fn entry(&self, id: TileId) -> Result<Option<TileEntry>> {
        if !self.header().holds(id) {
            return Ok(None);
        }
        let mut page = Arc::clone(&self.root);
        loop {
            page = match page.page.find(id) {
                Found::Tile(entry) => return Ok(Some(*entry)),
                Found::Nothing => return Ok(None),
                Found::Below(root, place) => self.page(root, place, page.offset)?,
            };
        }
    }

    /// The page that begins with tile `root`, from the cache or the file; `before` is where the page stands that
    /// refers to it.
    fn page(&self, root: TileId, place: PageRef, before: Option<u64>) -> Result<Arc<Loaded>> {
        if let Some(page) = self.loaded.get(root) {
            return Ok(page);
        }
        let page = self.load_page(root, place, before).map_err(|error| error.at(&self.path))?;
        let bytes = page.memory() as u64;
        let loaded = Arc::new(Loaded { page, offset: Some(place.offset) });
        self.loaded.insert(root, Arc::clone(&loaded), bytes, 1);
        Ok(loaded)
    }

    fn load_page(&self, root: TileId, place: PageRef, before: Option<u64>) -> Result<Page> {
        let name = || format!("index page of tile {root} at offset {}", self.pages.offset + place.offset);
        let end = place.offset.saturating_add(place.length.into());
        if let Some(before) = before.filter(|&before| end > before) {
            return Err(Error::format(name(), format!("its end before its parent's, {before}"), end));
        }
        let packed = self.read(self.pages.offset + place.offset, place.length.into(), "an index page")?;
        check_crc(&packed, place.crc, name)?;
        let page = unpack_page(&packed, root, self.header(), &self.limits)?;
        check_page(&page, self.header(), &self.tiles, &self.pages)?;
        Ok(page)
    }

    /// A chunk as stored, held against its CRC.
    pub fn raw_chunk(&self, id: TileId, kind: ChunkKind) -> Result<Vec<u8>> {
        let entry = self.existing(id)?;
        self.chunk(&entry, kind).map_err(|error| error.at(&self.path))
    }

    fn chunk(&self, entry: &TileEntry, kind: ChunkKind) -> Result<Vec<u8>> {
        let (offset, length, crc) = entry.chunks.chunk(kind);
        let offset = self.tiles.offset + offset;
        let bytes = self.read(offset, length.into(), kind.name())?;
        check_crc(&bytes, crc, || format!("tile {}, {} chunk at offset {offset}", entry.id, kind.name()))?;
        Ok(bytes)
    }

    /// The error table of a tile.
    pub fn read_errors(&self, id: TileId) -> Result<ErrorTable> {
        let chunk = self.raw_chunk(id, ChunkKind::Errors)?;
        let (patches, steps) = (self.header().patches() as usize, self.header().steps() as usize);
        codec::table::decode(&chunk, patches, steps).map_err(|error| self.in_tile(id, error))
    }

    fn existing(&self, id: TileId) -> Result<TileEntry> {
        let absent = || Error::usage(format!("there is no tile {id} in {}", self.path.display()));
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
                self.read(section.offset + done, (section.length - done).min(1 << 20), "a section")?;
            crc.update(&bytes);
            done += bytes.len() as u64;
        }
        compare_crc(crc.finalize(), section.crc, || format!("section {}", section.name()))
            .map_err(|error| error.at(&self.path))
    }

    /// Bytes of the file. The caller has held offset and length against the file and a limit.
    fn read(&self, offset: u64, length: u64, what: &str) -> Result<Vec<u8>> {
        let mut bytes = vec![0; length as usize];
        self.read_into(&mut bytes, offset, what)?;
        Ok(bytes)
    }

    /// Fills `bytes` from the file.
    fn read_into(&self, bytes: &mut [u8], offset: u64, what: &str) -> Result<()> {
        let action = |length| format!("read {what} ({length} bytes at offset {offset})");
        let length = bytes.len();
        read_exact_at(&self.file, bytes, offset)
            .map_err(|source| Error::io(&self.path, action(length), source))
    }

    /// An error of the codec, with the tile it concerns.
    fn in_tile(&self, id: TileId, mut error: Error) -> Error {
        if let Error::Format { place, .. } = &mut error {
            *place = format!("tile {id}, {place}");
        }
        error.at(&self.path)
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

fn unpack_page(packed: &[u8], root: TileId, header: &Header, limits: &Limits) -> Result<Page> {
    let max = limits.page_bytes.min(Page::MAX_BYTES) as usize;
    let mut bytes = Vec::new();
    frame::decompress(packed, 1..=max, &format!("index page of tile {root}"), &mut bytes)?;
    Page::decode(&bytes, root, header)
}

/// Fails if a chunk or page that a page tells of lies outside its section, or is longer than one can be.
fn check_page(page: &Page, header: &Header, tiles: &SectionEntry, pages: &SectionEntry) -> Result<()> {
    let inside = |offset: u64, length: u64, section: &SectionEntry, what: &dyn Fn() -> String| {
        let end = offset.saturating_add(length);
        if end <= section.length {
            return Ok(());
        }
        Err(Error::format(what(), format!("its end within the section, at most {}", section.length), end))
    };
    let most = header.max_chunk_bytes();
    for entry in &page.tiles {
        let what = || format!("chunks of tile {}", entry.id);
        inside(entry.chunks.offset, entry.chunks.bytes(), tiles, &what)?;
        for length in entry.chunks.lengths {
            if u64::from(length) > most {
                return Err(Error::limit(format!("a chunk of tile {}", entry.id), length.into(), most));
            }
        }
    }
    for place in &page.pages {
        let what = || format!("an index page below tile {}", page.root());
        inside(place.offset, place.length.into(), pages, &what)?;
        if u64::from(place.length) > 2 * Page::MAX_BYTES {
            return Err(Error::limit(what(), place.length.into(), 2 * Page::MAX_BYTES));
        }
    }
    Ok(())
}
