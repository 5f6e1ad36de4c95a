//! What was written comes back, in the order and at the cost that the reader promises.

use std::sync::atomic::{AtomicUsize, Ordering};

use relevo::codec::table;
use relevo::container::directory::{ChunkKind, TileEntry};
use relevo::container::{Reader, ReaderOptions};
use relevo::sample::Coding;
use relevo::{Error, TileId};

use super::raster::{INTEGER, Random, Raster, seen};

fn rasters() -> Vec<Raster> {
    let mut one = Raster::new(1, 1, INTEGER);
    one.valid.insert((0, 0), (5, 0));
    let mut corner = Raster::new(4000, 300, Coding::Float32);
    corner.valid.insert((3999, 299), (0x4040_0000, 0));
    vec![
        one,
        corner,
        Raster::bumpy(17, 17, INTEGER, 1),
        Raster::bumpy(50, 121, INTEGER, 2),
        Raster::bumpy(90, 40, Coding::Float32, 3),
        Raster::bumpy(60, 60, Coding::Float64, 4),
        Raster::sparse((1 << 20) + 1, 40, 5),
        Raster::sparse(1 << 30, 9, 6),
    ]
}

#[test]
fn everything_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    for (number, raster) in rasters().into_iter().enumerate() {
        let path = folder.path().join(format!("{number}.rlv"));
        let summary = raster.write(&path);
        let reader = Reader::open(&path).unwrap();
        let tiles = raster.tiles();
        assert_eq!(summary.file_bytes, std::fs::metadata(&path).unwrap().len());
        assert_eq!(summary.file_bytes, reader.file_len());
        assert_eq!(reader.header().tile_count, tiles.len() as u64);
        let count = reader.header().tile_count;
        assert_eq!(
            *reader.header(),
            relevo::container::Header { tile_count: count, ..raster.header.clone() }
        );
        assert_eq!(*reader.metadata(), Raster::metadata());
        assert_eq!(reader.statistics().unwrap(), Some(raster.statistics()));
        assert_eq!(reader.geo().transform, raster.header.transform);
        for section in reader.sections() {
            reader.check_section(section).unwrap();
        }
        for (record, chunks) in tiles {
            let id = record.id;
            let entry = reader.entry(id).unwrap().unwrap();
            let TileEntry { children, has_valid, has_void, vertical, horizontal, min_m, max_m, .. } = entry;
            assert_eq!(
                (id, children, has_valid, has_void),
                (entry.id, record.children, record.has_valid, record.has_void)
            );
            assert_eq!((vertical, horizontal), (record.vertical, record.horizontal));
            assert_eq!((min_m, max_m), (record.min_m, record.max_m));
            assert_eq!(reader.raw_chunk(id, ChunkKind::Heights).unwrap(), chunks.heights);
            assert_eq!(reader.raw_chunk(id, ChunkKind::Mask).unwrap(), chunks.mask);
            assert_eq!(reader.raw_chunk(id, ChunkKind::Errors).unwrap(), chunks.errors);
            assert_eq!(reader.read_errors(id).unwrap(), table::decode(&chunks.errors, 4, 3).unwrap());
            assert_eq!(reader.read_errors(id).unwrap(), raster.errors(id));
            let oracle = raster.lattice(id);
            let lattice = reader.read_tile(id).unwrap();
            assert_eq!(seen(&lattice, &oracle), seen(&oracle, &oracle), "tile {id} of raster {number}");
        }
    }
}

#[test]
fn tiles_that_do_not_exist_are_absent() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rlv");
    let raster = Raster::sparse(10_000, 3, 8);
    raster.write(&path);
    let reader = Reader::open(&path).unwrap();
    let there: std::collections::HashSet<_> = raster.existing().into_iter().collect();
    let mut random = Random(3);
    for _ in 0..5000 {
        let level = random.below(13) as u8;
        let id = TileId::new(level, random.below(1 << level) as u32, random.below(1 << level) as u32);
        assert_eq!(reader.entry(id).unwrap().is_some(), there.contains(&id), "{id}");
    }
    for id in [TileId::new(0, 1, 0), TileId::new(200, 0, 0), TileId::new(3, u32::MAX, 8)] {
        assert_eq!(reader.entry(id).unwrap(), None);
        assert!(matches!(reader.read_tile(id), Err(Error::Usage { .. })));
    }
}

#[test]
fn walks_follow_the_storage_order() {
    let folder = tempfile::tempdir().unwrap();
    for (number, raster) in rasters().into_iter().enumerate() {
        let path = folder.path().join(format!("{number}.rlv"));
        raster.write(&path);
        let reader = Reader::open(&path).unwrap();
        let existing = raster.existing();
        let mut end = 0;
        for level in 0..=raster.header.levels {
            let mut expected: Vec<_> = existing.iter().copied().filter(|id| id.level == level).collect();
            expected.sort_by_key(|id| id.hilbert());
            let tiles = reader.tiles(level).unwrap();
            assert_eq!(tiles, expected);
            for id in tiles {
                let chunks = reader.entry(id).unwrap().unwrap().chunks;
                assert_eq!(chunks.offset, end);
                end += chunks.bytes();
            }
        }
        let mut visited = Vec::new();
        reader
            .walk(&mut |entry| {
                visited.push(entry.id);
                Ok(())
            })
            .unwrap();
        assert!(visited.iter().all(|id| id.parent().is_none_or(|parent| visited.contains(&parent))));
        visited.sort();
        assert_eq!(visited, existing);
        let stop = reader.walk(&mut |_| Err(Error::Interrupted));
        assert!(matches!(stop, Err(Error::Interrupted)));
    }
}

#[test]
fn depth_first_reading_decodes_no_tile_twice_even_without_a_cache() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rlv");
    let raster = Raster::bumpy(200, 140, INTEGER, 9);
    raster.write(&path);
    for cache_bytes in [0, 10_000, 64 << 20] {
        let options = ReaderOptions { cache_bytes, ..ReaderOptions::default() };
        let reader = Reader::open_with(&path, options).unwrap();
        for id in reader.leaves().unwrap() {
            reader.read_tile(id).unwrap();
        }
        assert_eq!(reader.decoded_tiles(), reader.header().tile_count, "cache of {cache_bytes} bytes");
        let again = Reader::open_with(&path, options).unwrap();
        again.walk(&mut |entry| again.read_tile(entry.id).map(drop)).unwrap();
        assert_eq!(again.decoded_tiles(), again.header().tile_count);
    }
}

#[test]
fn threads_read_the_same_and_no_tile_twice() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rlv");
    let raster = Raster::bumpy(150, 150, INTEGER, 10);
    raster.write(&path);
    for cache_bytes in [3000, 64 << 20] {
        let options = ReaderOptions { cache_bytes, ..ReaderOptions::default() };
        let reader = Reader::open_with(&path, options).unwrap();
        let ids = reader.leaves().unwrap();
        let next = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    while let Some(&id) = ids.get(next.fetch_add(1, Ordering::Relaxed)) {
                        let oracle = raster.lattice(id);
                        assert_eq!(seen(&reader.read_tile(id).unwrap(), &oracle), seen(&oracle, &oracle));
                    }
                });
            }
        });
        if cache_bytes > 1 << 20 {
            assert_eq!(reader.decoded_tiles(), reader.header().tile_count);
        }
    }
}

#[test]
fn a_reader_is_for_many_threads() {
    fn check<T: Send + Sync>() {}
    check::<Reader>();
}
