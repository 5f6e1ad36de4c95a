//! The index (section 6 of the specification): pages, each a subtree of at most five levels of the
//! existing tiles.
//!
//! A page that decodes is whole: the `children` bits and the counts agree, every row is sound, and
//! it begins with the tile that was asked for. The caller, who knows the sections, checks that its
//! offsets lie within them.

use super::bytes::Bytes;
pub use super::entry::{ChunkKind, ChunkPlace, TileEntry};
use crate::error::{Error, Result};
use crate::tile::TileId;

/// Levels of a full page.
const PAGE_LEVELS: u8 = 5;
/// Most tiles of a page: 1 + 4 + 16 + 64 + 256.
const MAX_TILES: usize = 341;

/// The quadtree of a layer, as its index has to know it.
pub trait Quadtree {
    /// The level that no tile lies below.
    fn leaf(&self) -> u8;

    /// True if a tile of this id can exist.
    fn holds(&self, id: TileId) -> bool;

    /// Bytes that a stored chunk may have at most.
    fn max_chunk_bytes(&self) -> u64;
}

/// A row of an index: a tile's children, where its chunks lie, and columns that only its layer
/// knows.
pub trait Row: Copy {
    /// Bytes of a row on a page.
    const BYTES: usize;
    /// The word that error messages put before "tile" and "index page".
    const LAYER: &'static str;
    /// Deepest level that a layer can have.
    const MAX_LEVEL: u8;

    /// Which tile.
    fn id(&self) -> TileId;

    /// Bit `q` is set if child `q` exists.
    fn children(&self) -> u8;

    /// Offset of the first chunk from the start of the layer's tiles section.
    fn offset(&self) -> u64;

    /// Sets the offset of the first chunk.
    fn set_offset(&mut self, offset: u64);

    /// Bytes of each chunk.
    fn lengths(&self) -> &[u32];

    /// Bytes of all chunks.
    fn chunk_bytes(&self) -> u64 {
        self.lengths().iter().map(|&length| u64::from(length)).sum()
    }

    /// Appends the columns of `rows` that follow `children`.
    fn encode(rows: &[Self], out: &mut Vec<u8>);

    /// Reads the rows of the tiles `ids` from the columns that follow `children`. Fails if a row
    /// contradicts itself.
    fn decode(bytes: &mut Bytes, ids: &[TileId], children: &[u8]) -> Result<Vec<Self>>;
}

/// The children of a tile that exist, by quadrant.
pub(super) fn existing_children(id: TileId, children: u8) -> impl Iterator<Item = TileId> + use<> {
    (0..4).filter(move |quadrant| children >> quadrant & 1 != 0).map(move |quadrant| id.child(quadrant))
}

/// Appends one column.
pub(super) fn encode_columns<R, const N: usize>(
    rows: &[R],
    out: &mut Vec<u8>,
    field: impl Fn(&R) -> [u8; N],
) {
    out.extend(rows.iter().flat_map(field));
}

/// The place of another page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageRef {
    /// Offset from the start of the pages section.
    pub offset: u64,
    /// Bytes as stored.
    pub length: u32,
    /// CRC as stored.
    pub crc: u32,
}

/// The result of looking a tile up on a page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Found<'a, R = TileEntry> {
    /// Its row.
    Tile(&'a R),
    /// It is on a page below: the root of that page, which is the tile or an ancestor of it, and
    /// the place of the page.
    Below(TileId, PageRef),
    /// The tile does not exist.
    Nothing,
}

/// A subtree of the heights' index.
pub type Page = IndexPage<TileEntry>;

/// A subtree of an index.
#[derive(Clone, Debug, PartialEq)]
pub struct IndexPage<R> {
    /// Levels in the page.
    pub depth: u8,
    /// The rows: level by level from the page's root, in the order of the parents, children by
    /// quadrant.
    pub tiles: Vec<R>,
    /// The pages below, in the order of the children of the last level's tiles.
    pub pages: Vec<PageRef>,
    /// For each tile the index of its first child, in `tiles` or, on the last level, in `pages`.
    first_child: Vec<u16>,
}

/// Levels of the page whose root stands at `level`, in a file of leaf level `leaf`.
pub fn page_depth(level: u8, leaf: u8) -> u8 {
    (level + 1..=leaf).find(|&next| is_page_root(next, leaf)).unwrap_or(leaf + 1) - level
}

/// True if pages start at this level.
pub fn is_page_root(level: u8, leaf: u8) -> bool {
    level == 0 || (leaf + 1 - level).is_multiple_of(PAGE_LEVELS)
}

impl<R: Row> IndexPage<R> {
    /// Bytes of the largest page: 16, 341 rows, 1024 references of 16.
    pub const MAX_BYTES: u64 = (16 + MAX_TILES * R::BYTES + 1024 * 16) as u64;

    /// A page of rows and references in their order.
    pub fn new(depth: u8, tiles: Vec<R>, pages: Vec<PageRef>) -> Self {
        let mut page = Self { depth, tiles, pages, first_child: Vec::new() };
        page.link();
        page
    }

    /// The tile that the page begins with.
    pub fn root(&self) -> TileId {
        self.tiles.first().map_or(TileId::ROOT, Row::id)
    }

    /// About how many bytes of memory the page takes.
    pub fn memory(&self) -> usize {
        size_of::<Self>() + self.tiles.len() * (size_of::<R>() + 2) + self.pages.len() * size_of::<PageRef>()
    }

    /// Sets `first_child`.
    fn link(&mut self) {
        let last = self.root().level + self.depth - 1;
        let (mut tile, mut page) = (1, 0);
        self.first_child.clear();
        for entry in &self.tiles {
            let next = if entry.id().level == last { &mut page } else { &mut tile };
            self.first_child.push(*next);
            *next += entry.children().count_ones() as u16;
        }
    }

    /// Looks up a tile at or below the page's root.
    pub fn find(&self, id: TileId) -> Found<'_, R> {
        let root = self.root();
        let Some(down) = id.level.checked_sub(root.level) else { return Found::Nothing };
        if id.x.checked_shr(down.into()) != Some(root.x) || id.y.checked_shr(down.into()) != Some(root.y) {
            return Found::Nothing;
        }
        let mut index = 0;
        for left in (0..down).rev() {
            let child = TileId::new(id.level - left, id.x >> left, id.y >> left);
            let Some(entry) = self.tiles.get(index) else { return Found::Nothing };
            let children = entry.children();
            if children >> child.quadrant() & 1 == 0 {
                return Found::Nothing;
            }
            let before = (children & ((1 << child.quadrant()) - 1)).count_ones() as usize;
            index = before + self.first_child.get(index).map_or(0, |&first| usize::from(first));
            if child.level - root.level == self.depth {
                return self.pages.get(index).map_or(Found::Nothing, |&page| Found::Below(child, page));
            }
        }
        self.tiles.get(index).map_or(Found::Nothing, Found::Tile)
    }

    /// The page's bytes before compression.
    pub fn encode(&self) -> Vec<u8> {
        let root = self.root();
        let mut out = vec![root.level, self.depth, 0, 0];
        for number in [root.x, root.y, self.tiles.len() as u32] {
            out.extend(number.to_le_bytes());
        }
        out.extend(self.tiles.iter().map(Row::children));
        R::encode(&self.tiles, &mut out);
        out.extend(self.pages.iter().flat_map(|page| page.offset.to_le_bytes()));
        out.extend(self.pages.iter().flat_map(|page| page.length.to_le_bytes()));
        out.extend(self.pages.iter().flat_map(|page| page.crc.to_le_bytes()));
        out
    }

    /// Decodes the page that begins with tile `root`.
    pub fn decode(bytes: &[u8], root: TileId, tree: &impl Quadtree) -> Result<Self> {
        let place = format!("index page of tile {root}");
        let mut bytes = Bytes::new(bytes, &place);
        let (level, depth, reserved) = (bytes.u8()?, bytes.u8()?, bytes.u16()?);
        let (x, y) = (bytes.u32()?, bytes.u32()?);
        let expected_depth = page_depth(root.level, tree.leaf());
        if TileId::new(level, x, y) != root || depth != expected_depth || reserved != 0 {
            let expected = format!("tile {root}, {expected_depth} levels, reserved 0");
            return Err(Error::format(place, expected, format!("{level}/{x}/{y}, {depth}, {reserved}")));
        }
        let count = bytes.u32()? as usize;
        if !(1..=MAX_TILES).contains(&count) {
            return Err(Error::format(place, format!("1 to {MAX_TILES} tiles"), count));
        }
        let children = bytes.take(count)?;
        let ids = ids_of(root, depth, children, tree).map_err(|error| error_in(&place, error))?;
        let tiles: Vec<R> = R::decode(&mut bytes, &ids, children)?;
        let last = root.level + depth - 1;
        let last_level = tiles.iter().filter(|entry| entry.id().level == last);
        let below: u32 = last_level.map(|entry| entry.children().count_ones()).sum();
        let offsets = column(&mut bytes, below as usize, Bytes::u64)?;
        let lengths = column(&mut bytes, below as usize, Bytes::u32)?;
        let crcs = column(&mut bytes, below as usize, Bytes::u32)?;
        bytes.end()?;
        let refs = offsets.into_iter().zip(lengths).zip(crcs);
        let pages = refs.map(|((offset, length), crc)| PageRef { offset, length, crc }).collect();
        Ok(Self::new(depth, tiles, pages))
    }
}

fn error_in(place: &str, got: String) -> Error {
    Error::format(place, "children and tiles that agree", got)
}

/// The tiles of a page in order, by its `children` bits; an error message if the bits contradict
/// each other or the tree.
fn ids_of(root: TileId, depth: u8, children: &[u8], tree: &impl Quadtree) -> Result<Vec<TileId>, String> {
    let mut ids = vec![root];
    let last = root.level + depth - 1;
    for (index, &bits) in children.iter().enumerate() {
        let Some(&id) = ids.get(index) else {
            return Err(format!("{} tiles, {} of them with a parent", children.len(), ids.len()));
        };
        for child in existing_children(id, bits) {
            if !tree.holds(child) {
                return Err(format!(
                    "tile {child}, outside the raster or below the leaf level {}",
                    tree.leaf()
                ));
            }
            if id.level < last {
                ids.push(child);
            }
        }
    }
    if ids.len() == children.len() {
        return Ok(ids);
    }
    Err(format!("{} tiles, {} by the children", children.len(), ids.len()))
}

/// Reads one column.
pub(super) fn column<'a, T>(
    bytes: &mut Bytes<'a>,
    count: usize,
    read: impl Fn(&mut Bytes<'a>) -> Result<T>,
) -> Result<Vec<T>> {
    (0..count).map(|_| read(bytes)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::container::layout::{Header, Metric, leaf_level};
    use crate::sample::{Coding, SampleType};

    #[test]
    fn pages_divide_the_levels_and_the_last_is_full() {
        for leaf in 0..=26 {
            let mut level = 0;
            let mut depths = Vec::new();
            while level <= leaf {
                assert!(is_page_root(level, leaf));
                let depth = page_depth(level, leaf);
                assert!((1..=5).contains(&depth));
                assert!((level + 1..level + depth).all(|between| !is_page_root(between, leaf)));
                depths.push(depth);
                level += depth;
            }
            assert_eq!(level, leaf + 1);
            assert!(depths.iter().skip(1).all(|&depth| depth == 5), "{leaf}: {depths:?}");
        }
    }

    fn header() -> Header {
        Header {
            version: 2,
            width: 1000,
            height: 900,
            tile_log2: 4,
            patch_log2: 2,
            levels: leaf_level(1000, 900, 16),
            metric: Metric::Bound,
            coding: Coding::Float32,
            source_type: SampleType::Float32,
            band_scale: 1.0,
            band_offset: 0.0,
            unit_metres: 1.0,
            quantisation_error: 0.0,
            nodata: None,
            transform: None,
            tile_count: 1,
        }
    }

    /// A page of two levels, root and its children 0, 1 and 3, with pages below two of them.
    fn page() -> Page {
        let row = |id: TileId, children: u8| TileEntry {
            id,
            children,
            has_valid: id.x == 0,
            has_void: true,
            vertical: 7,
            horizontal: 0xFF00,
            min_m: -1.5,
            max_m: f32::INFINITY,
            chunks: ChunkPlace {
                offset: u64::from(id.x) << 40,
                lengths: [5, u32::from(id.x == 0), 9],
                crcs: [1, u32::from(id.x == 0), 3],
            },
        };
        let root = TileId::ROOT;
        let tiles = vec![
            row(root, 0b1011),
            row(root.child(0), 0b0101),
            row(root.child(1), 0),
            row(root.child(3), 0b0001),
        ];
        let pages =
            (0..3).map(|index| PageRef { offset: 100 * index, length: 50, crc: index as u32 }).collect();
        Page::new(2, tiles, pages)
    }

    #[test]
    fn pages_round_trip_and_know_their_tiles() {
        let mut header = header();
        assert_eq!(header.levels, 6);
        assert_eq!(page_depth(0, 6), 2);
        let page = page();
        let bytes = page.encode();
        assert_eq!(bytes.len(), 16 + 4 * 46 + 3 * 16);
        assert_eq!(Page::decode(&bytes, TileId::ROOT, &header).unwrap(), page);
        for end in 0..bytes.len() {
            assert!(Page::decode(&bytes[..end], TileId::ROOT, &header).is_err(), "cut at {end}");
        }
        assert!(Page::decode(&[&bytes[..], &[0]].concat(), TileId::ROOT, &header).is_err());
        for entry in &page.tiles {
            assert_eq!(page.find(entry.id), Found::Tile(entry));
        }
        let below = |x, y, index: usize| {
            let child = TileId::new(2, x, y);
            assert_eq!(page.find(child), Found::Below(child, page.pages[index]));
            assert_eq!(
                page.find(TileId::new(6, x * 16 + 5, y * 16 + 9)),
                Found::Below(child, page.pages[index])
            );
        };
        below(0, 0, 0);
        below(0, 1, 1);
        below(2, 2, 2);
        for absent in
            [TileId::new(1, 0, 1), TileId::new(2, 1, 0), TileId::new(2, 2, 0), TileId::new(6, 63, 63)]
        {
            assert_eq!(page.find(absent), Found::Nothing);
        }
        // The same page in a raster that ends west of its second column of tiles.
        header.width = 500;
        assert!(Page::decode(&bytes, TileId::ROOT, &header).is_err());
    }
}
