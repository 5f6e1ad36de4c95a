//! Does a reader stay small and quick whatever the size of the file? Counted, not timed: bytes
//! read, tiles decoded.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use relevo::container::{Reader, ReaderOptions};
use relevo::pipeline::{self, BuildOptions, Silent};
use relevo::sample::{Lattice, SampleType, VOID};
use relevo::source::{Fingerprint, Samples, Source, SourceInfo, Window};
use relevo::{Result, TileId};

use crate::support::terrain::info;

/// Bytes in which header, root page and metadata lie.
const OPENING: u64 = 65_536;

/// Hills with a lake, computed where they are asked for.
struct Hills(SourceInfo);

impl Hills {
    fn new(side: u32, sample_type: SampleType) -> Self {
        Self(SourceInfo { nodata: Some(-9999.0), block_rows: 1, ..info(side, side, sample_type) })
    }
}

/// Height of one place.
fn height(x: u32, y: u32) -> f64 {
    let (u, v) = (f64::from(x) / 40.0, f64::from(y) / 30.0);
    let lake = (u - 5.0).hypot(v - 4.0) < 3.0;
    let noise = f64::from(x.wrapping_mul(2_654_435_761).wrapping_add(y.wrapping_mul(40_503)) >> 29);
    if lake { -9999.0 } else { (900.0 + 300.0 * u.sin() * v.cos() + noise).round() / 8.0 }
}

impl Source for Hills {
    fn info(&self) -> &SourceInfo {
        &self.0
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window> {
        let heights = rows.flat_map(|y| columns.clone().map(move |x| height(x, y)));
        let samples = match self.0.sample_type {
            SampleType::Int16 => Samples::Int16(heights.map(|z| z as i16).collect()),
            SampleType::Float32 => Samples::Float32(heights.map(|z| z as f32).collect()),
            _ => Samples::Float64(heights.collect()),
        };
        Ok(Window { samples, mask: None })
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        Ok(Fingerprint { files: Vec::new() })
    }
}

/// A file of tiles with 16 intervals: many of them in little space.
fn build(folder: &Path, side: u32, sample_type: SampleType) -> PathBuf {
    let path = folder.join(format!("{side}_{sample_type:?}.rlv"));
    let options = BuildOptions { tile: 16, patch: 4, ..BuildOptions::default() };
    pipeline::build(&Hills::new(side, sample_type), &path, &options, &Silent).expect("build");
    path
}

/// Bytes that this thread has read from files so far, where the system counts them.
fn bytes_read() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/thread-self/io").ok()?;
    text.lines().find_map(|line| line.strip_prefix("rchar: "))?.parse().ok()
}

/// What some work reads; `None` where the system does not count.
fn counted<R>(work: impl FnOnce() -> R) -> (R, Option<u64>) {
    // Counting reads something too.
    let own = bytes_read().zip(bytes_read()).map(|(a, b)| b - a);
    let before = bytes_read();
    let result = work();
    let read =
        bytes_read().zip(before).zip(own).map(|((after, before), own)| (after - before).saturating_sub(own));
    if read.is_none() {
        eprintln!("this system does not count what a thread reads: not checked");
    }
    (result, read)
}

fn cached(path: &Path, cache_bytes: u64) -> Reader {
    Reader::open_with(path, ReaderOptions { cache_bytes, ..ReaderOptions::default() }).expect("open")
}

#[test]
fn opening_reads_the_first_64_kib_whatever_the_number_of_tiles() {
    let folder = tempfile::tempdir().expect("folder");
    for (side, least) in [(65, 20), (1025, 5000)] {
        let path = build(folder.path(), side, SampleType::Int16);
        let (reader, read) = counted(|| Reader::open(&path).expect("open"));
        assert!(reader.header().tile_count > least);
        // A few bytes more: counting is not exact to the digit.
        assert!(read.is_none_or(|read| read <= OPENING + 100), "{read:?} bytes for {side}");
    }
    // And it needs nothing else: with everything behind destroyed the file still opens, and says so
    // when it is used.
    let path = folder.path().join("1025_Int16.rlv");
    let mut bytes = std::fs::read(&path).expect("read");
    assert!(bytes.len() as u64 > 4 * OPENING);
    bytes[OPENING as usize..].fill(0xA5);
    std::fs::write(&path, bytes).expect("write");
    let reader = Reader::open(&path).expect("open");
    assert!(reader.leaves().is_err());
}

#[test]
fn a_cold_leaf_reads_its_own_path_alone() {
    let folder = tempfile::tempdir().expect("folder");
    let path = build(folder.path(), 1025, SampleType::Int16);
    let length = std::fs::metadata(&path).expect("file").len();
    for (x, y) in [(0, 0), (63, 63), (17, 40)] {
        let reader = Reader::open(&path).expect("open");
        let (leaf, read) = counted(|| reader.read_tile(TileId::new(6, x, y)).expect("tile"));
        assert_eq!(leaf.n, 16);
        assert_eq!(reader.decoded_tiles(), 7, "the leaf and its ancestors");
        assert!(read.is_none_or(|read| read < length / 20), "{read:?} of {length} bytes");
        reader.read_tile(TileId::new(6, x ^ 1, y)).expect("tile");
        assert_eq!(reader.decoded_tiles(), 8, "its brother is one tile more");
    }
}

/// All tiles, read one after the other by one thread.
fn oracle(path: &Path) -> BTreeMap<TileId, Arc<Lattice>> {
    let reader = Reader::open(path).expect("open");
    let mut tiles = BTreeMap::new();
    let visit = &mut |entry: &relevo::container::TileEntry| {
        tiles.insert(entry.id, reader.read_tile(entry.id)?);
        Ok(())
    };
    reader.walk(visit).expect("walk");
    tiles
}

#[test]
fn threads_get_the_same_tiles_each_decoded_once() {
    let folder = tempfile::tempdir().expect("folder");
    let path = build(folder.path(), 513, SampleType::Float32);
    let tiles = oracle(&path);
    let ids: Vec<TileId> = tiles.keys().copied().collect();
    // With room for all tiles, for a few, for none.
    for cache_bytes in [64 << 20, 200_000, 0] {
        let reader = cached(&path, cache_bytes);
        std::thread::scope(|scope| {
            for thread in 0..8 {
                let (reader, tiles, ids) = (&reader, &tiles, &ids);
                // Each begins elsewhere, and half of them go backwards.
                scope.spawn(move || {
                    let mut buffer = Lattice::default();
                    for turn in 0..ids.len() {
                        let turn = if thread % 2 == 0 { turn } else { ids.len() - 1 - turn };
                        let id = ids[(turn + thread * ids.len() / 8) % ids.len()];
                        if cache_bytes > 1 << 20 || turn % 3 > 0 {
                            assert_eq!(reader.read_tile(id).expect("tile"), tiles[&id], "{id}");
                        } else {
                            reader.read_tile_into(id, &mut buffer).expect("tile");
                            assert_eq!(buffer, *tiles[&id], "{id}");
                        }
                    }
                });
            }
        });
        if cache_bytes > 1 << 20 {
            assert_eq!(reader.decoded_tiles(), tiles.len() as u64);
        }
    }
}

#[test]
fn a_tile_does_not_depend_on_what_was_in_its_memory() {
    let folder = tempfile::tempdir().expect("folder");
    for sample_type in [SampleType::Int16, SampleType::Float32, SampleType::Float64] {
        let path = build(folder.path(), 257, sample_type);
        let tiles = oracle(&path);
        let reader = cached(&path, 0);
        for (id, tile) in &tiles {
            for dirt in [0, 77, -1] {
                let mut buffer = Lattice::clone(tile);
                buffer.code.fill(123_456_789_i32.wrapping_mul(dirt));
                buffer.low.fill(dirt as u32);
                buffer.state.fill(dirt as u8);
                reader.read_tile_into(*id, &mut buffer).expect("tile");
                assert_eq!(buffer, **tile, "{id}, {sample_type:?}");
            }
        }
    }
}

#[test]
fn a_tile_read_alone_is_the_same_tile() {
    let folder = tempfile::tempdir().expect("folder");
    let vectors = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/vectors");
    let vectors = std::fs::read_dir(vectors).expect("vectors").map(|file| file.expect("file").path());
    let mut files: Vec<_> = vectors.filter(|path| path.extension().is_some_and(|end| end == "rlv")).collect();
    assert!(files.len() > 9, "{files:?}");
    let types = [SampleType::Int16, SampleType::Float32, SampleType::Float64];
    files.extend(types.map(|sample_type| build(folder.path(), 513, sample_type)));
    let mut with_voids = 0;
    for path in files {
        let tiles = oracle(&path);
        for (turn, (id, tile)) in tiles.iter().enumerate() {
            let reader = Reader::open(&path).expect("open");
            let mut buffer = Lattice::clone(tile);
            buffer.code.fill(turn as i32 * 1_000_003);
            buffer.low.fill(77);
            buffer.state.fill(turn as u8);
            reader.read_tile_alone(*id, &mut buffer).expect("tile");
            assert_eq!(buffer, **tile, "{id} of {}", path.display());
            assert_eq!(reader.decoded_tiles(), u64::from(id.level) + 1, "{id}");
            // And nothing that it left behind is taken for a tile.
            if let Some(parent) = id.parent() {
                assert_eq!(reader.read_tile(parent).expect("tile"), tiles[&parent], "{parent}");
                reader.read_tile_alone(*id, &mut buffer).expect("tile");
                assert_eq!(buffer, **tile, "{id} after its parent");
                assert_eq!(reader.decoded_tiles(), 2 * u64::from(id.level) + 2, "{id}");
            }
        }
        with_voids += u32::from(tiles.values().any(|tile| tile.state.contains(&VOID)));
    }
    assert!(with_voids > 0, "no file with voids");
}

#[test]
fn leaves_read_into_one_buffer_decode_each_tile_once() {
    let folder = tempfile::tempdir().expect("folder");
    let path = build(folder.path(), 513, SampleType::Int16);
    for cache_bytes in [0, 64 << 20] {
        let reader = cached(&path, cache_bytes);
        let mut buffer = Lattice::default();
        for id in reader.leaves().expect("leaves") {
            reader.read_tile_into(id, &mut buffer).expect("tile");
        }
        assert_eq!(reader.decoded_tiles(), reader.header().tile_count, "cache of {cache_bytes} bytes");
    }
    let reader = Reader::open(&path).expect("open");
    assert!(reader.read_tile_into(TileId::new(9, 0, 0), &mut Lattice::default()).is_err());
}
