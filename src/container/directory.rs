//! The index (section 6 of the specification): pages, each a subtree of at most five levels of the existing tiles.
//!
//! A page that decodes is whole: the `children` bits and the counts agree, every row is sound, and it stands at the place
//! it was asked for. Whether its offsets lie within their sections is checked by who knows the sections.

use super::bytes::Bytes;
use super::layout::Header;
use crate::error::{Error, Result};
use crate::error_code;
use crate::tile::TileId;

/// Levels of a full page.
const PAGE_LEVELS: u8 = 5;
/// Most tiles of a page: 1 + 4 + 16 + 64 + 256.
const MAX_TILES: usize = 341;
const HAS_VALID: u8 = 1;
const HAS_VOID: u8 = 2;

/// The chunks of a tile, in the order in which they stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ChunkKind {
    /// Heights, section 9.
    Heights = 0,
    /// Void mask, section 8.
    Mask = 1,
    /// Error table, section 10.
    Errors = 2,
}

impl ChunkKind {
    /// All kinds, in order.
    pub const ALL: [Self; 3] = [Self::Heights, Self::Mask, Self::Errors];

    /// What people call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Heights => "heights",
            Self::Mask => "mask",
            Self::Errors => "errors",
        }
    }
}

/// Where the chunks of a tile stand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChunkPlace {
    /// Of the first chunk, from the start of the tiles section.
    pub offset: u64,
    /// Bytes of each, by [`ChunkKind`].
    pub lengths: [u32; 3],
    /// CRC of each as stored.
    pub crcs: [u32; 3],
}

impl ChunkPlace {
    /// Bytes of all chunks.
    pub fn bytes(&self) -> u64 {
        self.lengths.iter().map(|&length| u64::from(length)).sum()
    }

    /// Offset (from the start of the tiles section), length and CRC of one chunk.
    pub fn chunk(&self, kind: ChunkKind) -> (u64, u32, u32) {
        let index = kind as usize;
        let before: u64 = self.lengths.iter().take(index).map(|&length| u64::from(length)).sum();
        (self.offset.saturating_add(before), self.lengths[index], self.crcs[index])
    }
}

/// A row of the index: everything about a tile but its content.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileEntry {
    /// Which tile.
    pub id: TileId,
    /// Bit `q` is set if child `q` exists; 0 for a leaf.
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
    /// Where its chunks stand.
    pub chunks: ChunkPlace,
}

impl TileEntry {
    /// True if no child exists.
    pub fn is_leaf(&self) -> bool {
        self.children == 0
    }

    /// True if child `quadrant` exists.
    pub fn has_child(&self, quadrant: u8) -> bool {
        self.children >> quadrant & 1 != 0
    }

    /// The children that exist, by quadrant.
    pub fn child_ids(&self) -> impl Iterator<Item = TileId> {
        let entry = *self;
        (0..4)
            .filter(move |&quadrant| entry.has_child(quadrant))
            .map(move |quadrant| entry.id.child(quadrant))
    }

    /// Vertical error in metres.
    pub fn vertical_m(&self) -> f32 {
        error_code::metres_from_code(self.vertical)
    }

    /// Horizontal error in metres.
    pub fn horizontal_m(&self) -> f32 {
        error_code::metres_from_code(self.horizontal)
    }

    /// Fails if the row contradicts itself.
    pub(super) fn check(&self) -> Result<()> {
        let demand = |is: bool, expected: &str, got: String| {
            if is {
                Ok(())
            } else {
                Err(Error::format(format!("index row of tile {}", self.id), expected, got))
            }
        };
        demand(self.children < 16, "children in bits 0 to 3", format!("{:#x}", self.children))?;
        demand(self.has_valid || self.has_void, "valid or void samples", "neither".into())?;
        let worst = self.vertical.max(self.horizontal);
        demand(worst <= error_code::MAX_CODE, "error codes up to 0xFF00", format!("{worst:#06x}"))?;
        let range = format!("{} to {}", self.min_m, self.max_m);
        demand(self.min_m <= self.max_m, "a height range", range)?;
        let [heights, mask, errors] = self.chunks.lengths;
        demand(errors > 0, "an error table", "none".into())?;
        let mixed = self.has_valid && self.has_void;
        let expected = if mixed { "a mask" } else { "no mask" };
        demand((mask > 0) == mixed, expected, format!("one of {mask} bytes"))?;
        let [heights_crc, mask_crc, _] = self.chunks.crcs;
        let absent = |length: u32, crc: u32| length > 0 || crc == 0;
        demand(absent(heights, heights_crc) && absent(mask, mask_crc), "CRC 0 of no bytes", "another".into())
    }
}

/// Where another page stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageRef {
    /// From the start of the pages section.
    pub offset: u64,
    /// Bytes as stored.
    pub length: u32,
    /// CRC as stored.
    pub crc: u32,
}

/// What a page knows of a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Found<'a> {
    /// Its row.
    Tile(&'a TileEntry),
    /// The page whose root is the tile or an ancestor of it: that ancestor, and where the page stands.
    Below(TileId, PageRef),
    /// It does not exist.
    Nothing,
}

/// A subtree of the index.
#[derive(Clone, Debug, PartialEq)]
pub struct Page {
    /// Levels in the page.
    pub depth: u8,
    /// The rows: level by level from the page's root, in the order of the parents, children by quadrant.
    pub tiles: Vec<TileEntry>,
    /// The pages below, in the order of the children of the last level's tiles.
    pub pages: Vec<PageRef>,
    /// For each tile the place of its first child, in `tiles` or, on the last level, in `pages`.
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

impl Page {
    /// Bytes of the largest page: 16 + 341 rows of 46 bytes + 1024 references of 16.
    pub const MAX_BYTES: u64 = (16 + MAX_TILES * 46 + 1024 * 16) as u64;

    /// A page of rows and references in their order.
    pub fn new(depth: u8, tiles: Vec<TileEntry>, pages: Vec<PageRef>) -> Self {
        let mut page = Self { depth, tiles, pages, first_child: Vec::new() };
        page.link();
        page
    }

    /// The tile that the page begins with.
    pub fn root(&self) -> TileId {
        self.tiles.first().map_or(TileId::ROOT, |entry| entry.id)
    }

    /// Bytes that the page takes in memory, about.
    pub fn memory(&self) -> usize {
        size_of::<Self>()
            + self.tiles.len() * (size_of::<TileEntry>() + 2)
            + self.pages.len() * size_of::<PageRef>()
    }

    /// Fills in the places of the children.
    fn link(&mut self) {
        let last = self.root().level + self.depth - 1;
        let (mut tile, mut page) = (1, 0);
        self.first_child.clear();
        for entry in &self.tiles {
            let next = if entry.id.level == last { &mut page } else { &mut tile };
            self.first_child.push(*next);
            *next += entry.children.count_ones() as u16;
        }
    }

    /// Looks up a tile at or below the page's root.
    pub fn find(&self, id: TileId) -> Found<'_> {
        let root = self.root();
        let Some(down) = id.level.checked_sub(root.level) else { return Found::Nothing };
        if id.x.checked_shr(down.into()) != Some(root.x) || id.y.checked_shr(down.into()) != Some(root.y) {
            return Found::Nothing;
        }
        let mut index = 0;
        for left in (0..down).rev() {
            let child = TileId::new(id.level - left, id.x >> left, id.y >> left);
            let Some(entry) = self.tiles.get(index) else { return Found::Nothing };
            if !entry.has_child(child.quadrant()) {
                return Found::Nothing;
            }
            let before = (entry.children & ((1 << child.quadrant()) - 1)).count_ones() as usize;
            index = before + self.first_child.get(index).map_or(0, |&first| usize::from(first));
            if child.level - root.level == self.depth {
                return self.pages.get(index).map_or(Found::Nothing, |&page| Found::Below(child, page));
            }
        }
        self.tiles.get(index).map_or(Found::Nothing, Found::Tile)
    }

    /// The page's bytes, before they are packed.
    pub fn encode(&self) -> Vec<u8> {
        let root = self.root();
        let mut out = vec![root.level, self.depth, 0, 0];
        for number in [root.x, root.y, self.tiles.len() as u32] {
            out.extend(number.to_le_bytes());
        }
        let flags = |entry: &TileEntry| {
            (if entry.has_valid { HAS_VALID } else { 0 }) | (if entry.has_void { HAS_VOID } else { 0 })
        };
        let tiles = || self.tiles.iter();
        out.extend(tiles().map(|entry| entry.children));
        out.extend(tiles().map(flags));
        out.extend(tiles().flat_map(|entry| entry.vertical.to_le_bytes()));
        out.extend(tiles().flat_map(|entry| entry.horizontal.to_le_bytes()));
        out.extend(tiles().flat_map(|entry| entry.min_m.to_le_bytes()));
        out.extend(tiles().flat_map(|entry| entry.max_m.to_le_bytes()));
        out.extend(tiles().flat_map(|entry| entry.chunks.offset.to_le_bytes()));
        for kind in ChunkKind::ALL {
            out.extend(tiles().flat_map(|entry| entry.chunks.chunk(kind).1.to_le_bytes()));
        }
        for kind in ChunkKind::ALL {
            out.extend(tiles().flat_map(|entry| entry.chunks.chunk(kind).2.to_le_bytes()));
        }
        out.extend(self.pages.iter().flat_map(|page| page.offset.to_le_bytes()));
        out.extend(self.pages.iter().flat_map(|page| page.length.to_le_bytes()));
        out.extend(self.pages.iter().flat_map(|page| page.crc.to_le_bytes()));
        out
    }

    /// Decodes the page that begins with tile `root`.
    pub fn decode(bytes: &[u8], root: TileId, header: &Header) -> Result<Self> {
        let place = format!("index page of tile {root}");
        let mut bytes = Bytes::new(bytes, &place);
        let (level, depth, reserved) = (bytes.u8()?, bytes.u8()?, bytes.u16()?);
        let (x, y) = (bytes.u32()?, bytes.u32()?);
        let expected_depth = page_depth(root.level, header.levels);
        if TileId::new(level, x, y) != root || depth != expected_depth || reserved != 0 {
            let expected = format!("tile {root}, {expected_depth} levels, reserved 0");
            return Err(Error::format(place, expected, format!("{level}/{x}/{y}, {depth}, {reserved}")));
        }
        let count = bytes.u32()? as usize;
        if !(1..=MAX_TILES).contains(&count) {
            return Err(Error::format(place, format!("1 to {MAX_TILES} tiles"), count));
        }
        let children = bytes.take(count)?;
        let ids = ids_of(root, depth, children, header).map_err(|error| error_in(&place, error))?;
        let tiles = decode_rows(&mut bytes, &ids, children)?;
        let below: u32 =
            last_level(&tiles, root.level + depth - 1).map(|entry| entry.children.count_ones()).sum();
        let offsets = column(&mut bytes, below as usize, Bytes::u64)?;
        let lengths = column(&mut bytes, below as usize, Bytes::u32)?;
        let crcs = column(&mut bytes, below as usize, Bytes::u32)?;
        bytes.end()?;
        let refs = offsets.into_iter().zip(lengths).zip(crcs);
        let pages = refs.map(|((offset, length), crc)| PageRef { offset, length, crc }).collect();
        Ok(Self::new(depth, tiles, pages))
    }
}

fn last_level(tiles: &[TileEntry], level: u8) -> impl Iterator<Item = &TileEntry> {
    tiles.iter().filter(move |entry| entry.id.level == level)
}

fn error_in(place: &str, got: String) -> Error {
    Error::format(place, "children and tiles that agree", got)
}

/// The tiles that a page's `children` bits tell of, in the page's order; the reason if they cannot be.
fn ids_of(root: TileId, depth: u8, children: &[u8], header: &Header) -> Result<Vec<TileId>, String> {
    let mut ids = vec![root];
    let last = root.level + depth - 1;
    for (index, &bits) in children.iter().enumerate() {
        let Some(&id) = ids.get(index) else {
            return Err(format!("{} tiles, {} of them with a parent", children.len(), ids.len()));
        };
        for child in (0..4).filter(|quadrant| bits >> quadrant & 1 != 0).map(|quadrant| id.child(quadrant)) {
            if !header.holds(child) {
                return Err(format!(
                    "tile {child}, outside the raster or below the leaf level {}",
                    header.levels
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

fn column<'a, T>(
    bytes: &mut Bytes<'a>,
    count: usize,
    read: impl Fn(&mut Bytes<'a>) -> Result<T>,
) -> Result<Vec<T>> {
    (0..count).map(|_| read(bytes)).collect()
}

/// The columns behind `children`, as rows.
fn decode_rows(bytes: &mut Bytes, ids: &[TileId], children: &[u8]) -> Result<Vec<TileEntry>> {
    let count = ids.len();
    let flags = bytes.take(count)?;
    let vertical = column(bytes, count, Bytes::u16)?;
    let horizontal = column(bytes, count, Bytes::u16)?;
    let min_m = column(bytes, count, Bytes::f32)?;
    let max_m = column(bytes, count, Bytes::f32)?;
    let offset = column(bytes, count, Bytes::u64)?;
    let mut six = || column(bytes, count, Bytes::u32);
    let lengths = [six()?, six()?, six()?];
    let crcs = [six()?, six()?, six()?];
    let mut tiles = Vec::with_capacity(count);
    for (index, &id) in ids.iter().enumerate() {
        if flags[index] & !(HAS_VALID | HAS_VOID) != 0 {
            return Err(Error::format(format!("index row of tile {id}"), "flags 1 to 3", flags[index]));
        }
        let entry = TileEntry {
            id,
            children: children[index],
            has_valid: flags[index] & HAS_VALID != 0,
            has_void: flags[index] & HAS_VOID != 0,
            vertical: vertical[index],
            horizontal: horizontal[index],
            min_m: min_m[index],
            max_m: max_m[index],
            chunks: ChunkPlace {
                offset: offset[index],
                lengths: lengths.each_ref().map(|column| column[index]),
                crcs: crcs.each_ref().map(|column| column[index]),
            },
        };
        entry.check()?;
        tiles.push(entry);
    }
    Ok(tiles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::container::layout::{Metric, leaf_level};
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
