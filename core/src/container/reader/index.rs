//! One layer's index: look-up of rows, and walks through them; pages are read on demand.
//!
//! A walk goes depth first, children along the Hilbert curve: so the tiles of every level come in
//! storage order. It ends with an error as soon as it has seen more tiles, or more bytes of chunks,
//! than the file can hold; its time is bounded.

use std::path::PathBuf;
use std::sync::Arc;

use super::check_crc;
use crate::codec::frame;
use crate::container::cache::Store;
use crate::container::directory::{Found, IndexPage, PageRef, Quadtree, Row, existing_children};
use crate::container::sections::SectionEntry;
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::read_at::ReadAt;
use crate::tile::TileId;

/// The bytes of the file, and its name for errors.
pub(super) struct Input {
    pub path: PathBuf,
    pub bytes: Box<dyn ReadAt>,
}

impl Input {
    /// Reads bytes of the file. The caller has checked offset and length against the file and a
    /// limit.
    pub fn read(&self, offset: u64, length: u64, what: &str) -> Result<Vec<u8>> {
        let mut bytes = vec![0; length as usize];
        self.read_into(&mut bytes, offset, what)?;
        Ok(bytes)
    }

    /// Fills `bytes` from the file.
    pub fn read_into(&self, bytes: &mut [u8], offset: u64, what: &str) -> Result<()> {
        let action = |length| format!("read {what} ({length} bytes at offset {offset})");
        let length = bytes.len();
        let read = self.bytes.read_exact_at(bytes, offset);
        read.map_err(|source| Error::io(&self.path, action(length), source))
    }
}

/// A page, and its place in the pages section (`None` for the root page).
struct Loaded<R> {
    page: IndexPage<R>,
    offset: Option<u64>,
}

/// The index of a layer.
pub(super) struct Index<T, R> {
    tree: T,
    /// The section of the chunks.
    pub tiles: SectionEntry,
    /// The section of all pages but the root.
    pub pages: SectionEntry,
    /// Existing tiles.
    count: u64,
    root: Arc<Loaded<R>>,
    loaded: Store<Loaded<R>>,
    limits: Limits,
}

impl<T: Quadtree, R: Row> Index<T, R> {
    /// The index whose root page is stored as `root`; `cache` is how many bytes of other pages to
    /// cache.
    pub fn new(
        root: &[u8],
        tree: T,
        count: u64,
        [tiles, pages]: [SectionEntry; 2],
        limits: Limits,
        cache: u64,
    ) -> Result<Self> {
        if count > tiles.length {
            let most = format!("at most {}", tiles.length);
            return Err(Error::format(format!("header, {}tile count", R::LAYER), most, count));
        }
        let page = unpack(root, TileId::ROOT, &tree, &limits)?;
        check(&page, &tree, &tiles, &pages)?;
        let root = Arc::new(Loaded { page, offset: None });
        Ok(Self { tree, tiles, pages, count, root, loaded: Store::new(cache), limits })
    }

    /// The root page.
    pub fn root_page(&self) -> &IndexPage<R> {
        &self.root.page
    }

    /// The row of a tile; `None` if the tile does not exist.
    pub fn entry(&self, input: &Input, id: TileId) -> Result<Option<R>> {
        if !self.tree.holds(id) {
            return Ok(None);
        }
        let mut page = Arc::clone(&self.root);
        loop {
            page = match page.page.find(id) {
                Found::Tile(entry) => return Ok(Some(*entry)),
                Found::Nothing => return Ok(None),
                Found::Below(root, place) => self.page(input, root, place, page.offset)?,
            };
        }
    }

    /// The page that begins with tile `root`, from the cache or the file; `before` is the place of
    /// the page that refers to it.
    fn page(
        &self,
        input: &Input,
        root: TileId,
        place: PageRef,
        before: Option<u64>,
    ) -> Result<Arc<Loaded<R>>> {
        if let Some(page) = self.loaded.get(root) {
            return Ok(page);
        }
        let page = self.load(input, root, place, before).map_err(|error| error.at(&input.path))?;
        let bytes = page.memory() as u64;
        let loaded = Arc::new(Loaded { page, offset: Some(place.offset) });
        self.loaded.insert(root, Arc::clone(&loaded), bytes, 1);
        Ok(loaded)
    }

    fn load(&self, input: &Input, root: TileId, place: PageRef, before: Option<u64>) -> Result<IndexPage<R>> {
        let start = self.pages.offset + place.offset;
        let name = || format!("{}index page of tile {root} at offset {start}", R::LAYER);
        let end = place.offset.saturating_add(place.length.into());
        if let Some(before) = before.filter(|&before| end > before) {
            return Err(Error::format(name(), format!("its end before its parent's, {before}"), end));
        }
        let packed = input.read(start, place.length.into(), "an index page")?;
        check_crc(&packed, place.crc, name)?;
        let page = unpack(&packed, root, &self.tree, &self.limits)?;
        check(&page, &self.tree, &self.tiles, &self.pages)?;
        Ok(page)
    }

    /// Visits every tile, parents before children, children along the Hilbert curve: tiles of one
    /// level come in storage order. Fails if the number of tiles is not the one stated, or their
    /// chunks do not fill their section.
    pub fn walk(&self, input: &Input, visit: &mut dyn FnMut(&R) -> Result<()>) -> Result<()> {
        let (mut tiles, mut bytes) = (0, 0);
        let mut count = |entry: &R| {
            tiles += 1;
            bytes += entry.chunk_bytes();
            self.check_counts(input, tiles, bytes, false)?;
            visit(entry)
        };
        self.walk_from(input, TileId::ROOT, &self.root, u8::MAX, &mut count)?;
        self.check_counts(input, tiles, bytes, true)
    }

    /// The existing tiles of a level in storage order.
    pub fn tiles_of(&self, input: &Input, level: u8) -> Result<Vec<TileId>> {
        let (mut ids, mut tiles) = (Vec::new(), 0);
        let mut keep = |entry: &R| {
            tiles += 1;
            self.check_counts(input, tiles, 0, false)?;
            if entry.id().level == level {
                ids.push(entry.id());
            }
            Ok(())
        };
        self.walk_from(input, TileId::ROOT, &self.root, level, &mut keep)?;
        Ok(ids)
    }

    /// Columns of the existing tiles of one row of a level, from west to east. Only pages on the
    /// way to that row are read.
    pub fn row(&self, input: &Input, level: u8, y: u32) -> Result<Vec<u32>> {
        let mut columns = Vec::new();
        self.row_from(input, TileId::ROOT, &self.root, (level, y), &mut columns)?;
        columns.sort_unstable();
        Ok(columns)
    }

    /// The row of a tile on the way down, and its page: `page`, or the page below, which is kept in
    /// `below`.
    fn step<'a>(
        &self,
        input: &Input,
        id: TileId,
        page: &'a Loaded<R>,
        below: &'a mut Option<Arc<Loaded<R>>>,
    ) -> Result<Option<(&'a Loaded<R>, &'a R)>> {
        let (page, found) = match page.page.find(id) {
            Found::Below(root, place) => {
                let loaded: &'a Loaded<R> = below.insert(self.page(input, root, place, page.offset)?);
                (loaded, loaded.page.find(id))
            }
            found => (page, found),
        };
        Ok(if let Found::Tile(entry) = found { Some((page, entry)) } else { None })
    }

    fn row_from(
        &self,
        input: &Input,
        id: TileId,
        page: &Loaded<R>,
        (level, y): (u8, u32),
        columns: &mut Vec<u32>,
    ) -> Result<()> {
        let mut below = None;
        let Some((page, entry)) = self.step(input, id, page, &mut below)? else { return Ok(()) };
        if id.level == level {
            columns.push(id.x);
            return self.check_counts(input, columns.len() as u64, 0, false);
        }
        let leads_there = |child: &TileId| y >> (level - child.level) == child.y;
        let mut children = existing_children(id, entry.children()).filter(leads_there);
        children.try_for_each(|child| self.row_from(input, child, page, (level, y), columns))
    }

    /// Fails if a walk has seen more tiles or bytes than the file has, or, at its end, fewer.
    fn check_counts(&self, input: &Input, tiles: u64, bytes: u64, end: bool) -> Result<()> {
        let counts = [
            ("tiles in the index", tiles, self.count),
            ("bytes of all chunks in the index", bytes, self.tiles.length),
        ];
        for (what, got, expected) in counts {
            if got > expected || (end && got < expected) {
                return Err(Error::format(format!("{}{what}", R::LAYER), expected, got).at(&input.path));
            }
        }
        Ok(())
    }

    fn walk_from(
        &self,
        input: &Input,
        id: TileId,
        page: &Loaded<R>,
        to_level: u8,
        visit: &mut dyn FnMut(&R) -> Result<()>,
    ) -> Result<()> {
        let mut below = None;
        let Some((page, entry)) = self.step(input, id, page, &mut below)? else { return Ok(()) };
        visit(entry)?;
        if id.level >= to_level {
            return Ok(());
        }
        let mut children: Vec<_> = existing_children(id, entry.children()).collect();
        children.sort_by_key(|child| child.hilbert());
        children.into_iter().try_for_each(|child| self.walk_from(input, child, page, to_level, visit))
    }
}

fn unpack<R: Row>(
    packed: &[u8],
    root: TileId,
    tree: &impl Quadtree,
    limits: &Limits,
) -> Result<IndexPage<R>> {
    let max = limits.page_bytes.min(IndexPage::<R>::MAX_BYTES) as usize;
    let mut bytes = Vec::new();
    frame::decompress(packed, 1..=max, &format!("{}index page of tile {root}", R::LAYER), &mut bytes)?;
    IndexPage::decode(&bytes, root, tree)
}

/// Fails if a chunk or page that a page refers to lies outside its section, or is longer than
/// allowed.
fn check<R: Row>(
    page: &IndexPage<R>,
    tree: &impl Quadtree,
    tiles: &SectionEntry,
    pages: &SectionEntry,
) -> Result<()> {
    let inside = |offset: u64, length: u64, section: &SectionEntry, what: &dyn Fn() -> String| {
        let end = offset.saturating_add(length);
        if end <= section.length {
            return Ok(());
        }
        Err(Error::format(what(), format!("its end within the section, at most {}", section.length), end))
    };
    let most = tree.max_chunk_bytes();
    let most_of_page = 2 * IndexPage::<R>::MAX_BYTES;
    for entry in &page.tiles {
        let what = || format!("{}chunks of tile {}", R::LAYER, entry.id());
        inside(entry.offset(), entry.chunk_bytes(), tiles, &what)?;
        for &length in entry.lengths() {
            if u64::from(length) > most {
                let what = format!("{}chunk of tile {}", R::LAYER, entry.id());
                return Err(Error::limit(what, length.into(), most));
            }
        }
    }
    for place in &page.pages {
        let what = || format!("{}index page below tile {}", R::LAYER, page.root());
        inside(place.offset, place.length.into(), pages, &what)?;
        if u64::from(place.length) > most_of_page {
            return Err(Error::limit(what(), place.length.into(), most_of_page));
        }
    }
    Ok(())
}
