//! Damage and malice: an error each time, no panic, no hours, no gigabytes.

use std::time::{Duration, Instant};

use relevo::codec::frame;
use relevo::container::directory::{ChunkKind, Page, PageRef, TileEntry};
use relevo::container::{Header, Reader};
use relevo::{Error, Result, TileId};

use super::opening::{Bench, lay_out, repair};
use super::raster::{INTEGER, Random, Raster};

/// Reads all that is there.
fn read_all(reader: &Reader) -> Result<()> {
    reader.statistics()?;
    for section in reader.sections() {
        reader.check_section(section)?;
    }
    reader.walk(&mut |entry| {
        reader.read_tile(entry.id)?;
        reader.read_errors(entry.id)?;
        relevo::surface::height_at_sample(reader, 3.5, 4.25)?;
        Ok(())
    })
}

/// What becomes of a changed file; fails if that takes long.
fn attempt(bench: &Bench, bytes: &[u8]) -> Result<()> {
    let start = Instant::now();
    let result = bench.open(bytes).and_then(|reader| read_all(&reader));
    assert!(start.elapsed() < Duration::from_secs(20), "took {:?}", start.elapsed());
    result
}

fn packed(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    frame::compress(bytes, &mut out).unwrap();
    out
}

fn unpacked(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    frame::decompress(bytes, 1..=1 << 20, "page", &mut out).unwrap();
    out
}

/// A file of one level of pages below the root page, taken apart.
struct Parts {
    bench: Bench,
    header: Header,
    root: Page,
    /// The other pages, unpacked, in the order in which the root page names them.
    pages: Vec<Vec<u8>>,
    tiles: Vec<u8>,
}

impl Parts {
    fn new() -> Self {
        let bench = Bench::new(&Raster::sparse(1500, 6, 50));
        let header = bench.opening().header;
        let root = Page::decode(&unpacked(&bench.section(2)), TileId::ROOT, &header).unwrap();
        let stored = bench.section(4);
        let page = |place: &PageRef| {
            let from = place.offset as usize;
            unpacked(&stored[from..from + place.length as usize])
        };
        let pages = root.pages.iter().map(page).collect();
        let tiles = bench.section(5);
        Self { bench, header, root, pages, tiles }
    }

    /// The file with all CRCs and references right, but with this root page in place of the one
    /// that is due.
    fn join(&self, root: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
        let mut stored = Vec::new();
        let mut page = self.root.clone();
        for (place, bytes) in page.pages.iter_mut().zip(&self.pages) {
            let frame = packed(bytes);
            let length = frame.len() as u32;
            *place = PageRef { offset: stored.len() as u64, length, crc: crc32fast::hash(&frame) };
            stored.extend(frame);
        }
        let mut encoded = page.encode();
        root(&mut encoded);
        let bench = &self.bench;
        let parts = [
            (2, 3, packed(&encoded)),
            (1, 2, bench.section(1)),
            (3, 2, bench.section(3)),
            (5, 1, self.tiles.clone()),
            (4, 1, stored),
        ];
        lay_out(&bench.opening(), &parts)
    }
}

/// Puts something nasty somewhere.
fn mutate(bytes: &mut [u8], random: &mut Random) {
    for _ in 0..=random.below(3) {
        let at = random.below(bytes.len() as u64) as usize;
        let width = [1, 2, 4, 8][random.below(4) as usize].min(bytes.len() - at);
        let value = match random.below(6) {
            0 => 0,
            1 => u64::MAX,
            2 => 1 << random.below(64),
            3 => random.below(300),
            _ => random.next(),
        };
        bytes[at..at + width].copy_from_slice(&value.to_le_bytes()[..width]);
    }
}

#[test]
fn every_flipped_bit_is_noticed() {
    let bench = Bench::new(&Raster::bumpy(40, 30, INTEGER, 51));
    attempt(&bench, &bench.bytes).unwrap();
    let mut random = Random(9);
    for at in 0..bench.bytes.len() {
        let mut bytes = bench.bytes.clone();
        bytes[at] ^= 1 << random.below(8);
        let error = attempt(&bench, &bytes).expect_err(&format!("byte {at} is under no checksum"));
        assert!(error.to_string().contains("changed.rlv"), "{error}");
    }
}

#[test]
fn a_damaged_chunk_is_named_with_tile_and_place() {
    let bench = Bench::new(&Raster::bumpy(40, 30, INTEGER, 52));
    let reader = bench.open(&bench.bytes).unwrap();
    let id = reader.leaves().unwrap()[2];
    let start = reader.sections().iter().find(|section| section.kind == 5).unwrap().offset;
    let (offset, _, crc) = reader.entry(id).unwrap().unwrap().chunks.chunk(ChunkKind::Mask);
    let mut bytes = bench.bytes.clone();
    bytes[(start + offset) as usize] ^= 4;
    let reader = bench.open(&bytes).unwrap();
    let text = reader.read_tile(id).unwrap_err().to_string();
    for part in
        [&format!("tile {id}, mask chunk at offset {}", start + offset), &format!("{crc:08X}"), "changed.rlv"]
    {
        assert!(text.contains(part), "{text}");
    }
    // What is not damaged can be read on.
    reader.read_tile(id.parent().unwrap()).unwrap();
    reader.read_errors(id).unwrap();
}

#[test]
fn headers_with_nasty_fields_and_right_checksums() {
    let bench = Bench::new(&Raster::bumpy(40, 30, INTEGER, 53));
    let mut random = Random(10);
    let end = 256 + 5 * 32;
    for _ in 0..4000 {
        let mut bytes = bench.bytes.clone();
        mutate(&mut bytes[8..end], &mut random);
        repair(&mut bytes);
        let _ = attempt(&bench, &bytes);
    }
}

#[test]
fn pages_with_nasty_fields_and_right_checksums() {
    let mut parts = Parts::new();
    attempt(&parts.bench, &parts.join(|_| {})).unwrap();
    assert!(parts.header.levels == 7 && parts.pages.len() > 3);
    let mut random = Random(11);
    let mut refused = 0;
    for turn in 0..4000 {
        let bytes = if turn % 2 == 0 {
            parts.join(|root| mutate(root, &mut random))
        } else {
            let page = random.below(parts.pages.len() as u64) as usize;
            let good = parts.pages[page].clone();
            mutate(&mut parts.pages[page], &mut random);
            let bytes = parts.join(|_| {});
            parts.pages[page] = good;
            bytes
        };
        refused += usize::from(attempt(&parts.bench, &bytes).is_err());
    }
    assert!(refused > 2000, "{refused}");
}

#[test]
fn chunks_with_nasty_bytes_and_right_checksums() {
    let bench = Bench::new(&Raster::bumpy(33, 33, INTEGER, 54));
    let opening = bench.opening();
    let good = Page::decode(&unpacked(&bench.section(2)), TileId::ROOT, &opening.header).unwrap();
    let mut random = Random(12);
    for _ in 0..4000 {
        let (mut page, mut tiles) = (good.clone(), bench.section(5));
        let entry = random.below(page.tiles.len() as u64) as usize;
        let chunks = &mut page.tiles[entry].chunks;
        for kind in ChunkKind::ALL {
            let (offset, length, _) = chunks.chunk(kind);
            let chunk = &mut tiles[offset as usize..][..length as usize];
            if length > 0 && random.below(2) == 0 {
                mutate(chunk, &mut random);
            }
            chunks.crcs[kind as usize] = crc32fast::hash(chunk);
        }
        let parts = [
            (2, 3, packed(&page.encode())),
            (1, 2, bench.section(1)),
            (4, 1, bench.section(4)),
            (5, 1, tiles),
        ];
        let _ = attempt(&bench, &lay_out(&opening, &parts));
    }
}

#[test]
fn pages_out_of_place_and_in_circles_are_refused() {
    let parts = Parts::new();
    let refusal = |bytes: &[u8]| attempt(&parts.bench, bytes).unwrap_err().to_string();
    // The page of one tile in the place of another.
    let swapped = Parts { pages: parts.pages.iter().rev().cloned().collect(), ..Parts::new() };
    assert!(refusal(&swapped.join(|_| {})).contains("index page of tile"));
    // A tile more than the header says, or fewer.
    for count in [parts.header.tile_count - 1, parts.header.tile_count + 1] {
        let mut bytes = parts.join(|_| {});
        bytes[152..160].copy_from_slice(&count.to_le_bytes());
        repair(&mut bytes);
        assert!(refusal(&bytes).contains("tiles in the index"));
    }
    // More bytes of chunks than there are: some are shared.
    let mut page = parts.root.clone();
    page.tiles[1].chunks.lengths[0] = parts.tiles.len() as u32 / 2;
    page.tiles[1].chunks.offset = 0;
    let reader = parts.bench.open(&parts.join(|root| *root = page.encode())).unwrap();
    assert!(reader.walk(&mut |_| Ok(())).unwrap_err().to_string().contains("bytes of all chunks"));
    // A depth, level or count that cannot be.
    for (at, value) in [(0, 1), (1, 5), (2, 1), (4, 1), (12, 0), (12, 255)] {
        assert!(refusal(&parts.join(|root| root[at] = value)).contains("index page of tile 0/0/0"));
    }
}

#[test]
fn a_page_may_not_refer_to_itself_or_behind() {
    // Three levels of pages: root, level 2, level 7; leaves at 11.
    let bench = Bench::new(&Raster::sparse(20_000, 2, 55));
    let opening = bench.opening();
    assert_eq!(opening.header.levels, 11);
    let root = Page::decode(&unpacked(&bench.section(2)), TileId::ROOT, &opening.header).unwrap();
    let Some((first, place)) =
        root.tiles.iter().flat_map(TileEntry::child_ids).filter(|id| id.level == 2).zip(&root.pages).next()
    else {
        panic!("no page at level 2")
    };
    let stored = bench.section(4);
    let raw = unpacked(&stored[place.offset as usize..][..place.length as usize]);
    let mut page = Page::decode(&raw, first, &opening.header).unwrap();
    let mut root = root.clone();
    // The child page, as good as before, stands behind its parent now.
    let child = page.pages[0];
    let child_bytes = stored[child.offset as usize..][..child.length as usize].to_vec();
    let mut pages = stored.clone();
    page.pages[0].offset = pages.len() as u64 + 4096;
    let frame = packed(&page.encode());
    root.pages[0] =
        PageRef { offset: pages.len() as u64, length: frame.len() as u32, crc: crc32fast::hash(&frame) };
    pages.extend(frame);
    pages.resize(stored.len() + 4096, 0);
    pages.extend(child_bytes);
    let parts =
        [(2, 3, packed(&root.encode())), (1, 2, bench.section(1)), (4, 1, pages), (5, 1, bench.section(5))];
    let error = attempt(&bench, &lay_out(&opening, &parts)).unwrap_err();
    assert!(
        matches!(error, Error::Format { .. }) && error.to_string().contains("before its parent"),
        "{error}"
    );
}
