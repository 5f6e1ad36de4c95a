//! The output is whole or not there, and nothing else is left.

use std::fs;
use std::path::Path;

use relevo::container::Reader;
use relevo::container::directory::ChunkKind;
use relevo::container::metadata::Metadata;
use relevo::writer::ContainerWriter;
use relevo::{Error, TileId};

use super::raster::{INTEGER, Random, Raster};

/// Names in a folder.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

fn raster() -> Raster {
    Raster::bumpy(70, 50, INTEGER, 11)
}

fn filled(raster: &Raster, path: &Path, force: bool) -> ContainerWriter {
    let mut writer = ContainerWriter::create(path, force).unwrap();
    for (record, chunks) in raster.tiles() {
        writer.append(&record, &chunks).unwrap();
    }
    writer
}

fn finish(writer: ContainerWriter, raster: &Raster) -> relevo::Result<()> {
    writer.finish(&raster.header, &Raster::metadata(), &raster.statistics()).map(drop)
}

#[test]
fn the_order_of_tiles_does_not_matter() {
    let folder = tempfile::tempdir().unwrap();
    let (one, two) = (folder.path().join("1.rlv"), folder.path().join("2.rlv"));
    let raster = Raster::bumpy(600, 30, INTEGER, 12);
    raster.write(&one);
    raster.write_in_order(&two, |tiles| {
        let mut random = Random(5);
        for end in (1..tiles.len()).rev() {
            tiles.swap(end, random.below(end as u64 + 1) as usize);
        }
    });
    assert_eq!(fs::read(one).unwrap(), fs::read(two).unwrap());
    assert_eq!(names(folder.path()), ["1.rlv", "2.rlv"]);
}

#[test]
fn the_summary_counts_what_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rlv");
    let raster = raster();
    let summary = raster.write(&path);
    let reader = Reader::open(&path).unwrap();
    let mut bytes = [0; 3];
    reader
        .walk(&mut |entry| {
            for kind in ChunkKind::ALL {
                bytes[kind as usize] += u64::from(entry.chunks.chunk(kind).1);
            }
            Ok(())
        })
        .unwrap();
    let sum = |of: fn(&relevo::writer::LevelBytes) -> u64| summary.levels.iter().map(of).sum::<u64>();
    assert_eq!([sum(|l| l.heights), sum(|l| l.masks), sum(|l| l.errors)], bytes);
    assert_eq!(sum(|l| l.tiles), summary.tiles);
    let fixed = 256 + 5 * 32 + summary.index_bytes + summary.metadata_bytes + summary.statistics_bytes;
    assert_eq!(fixed + bytes.iter().sum::<u64>(), summary.file_bytes);
}

#[test]
fn an_existing_output_is_replaced_only_by_force() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rlv");
    fs::write(&path, "mine").unwrap();
    let refused = ContainerWriter::create(&path, false).err().unwrap();
    assert!(refused.to_string().contains("`force`"), "{refused}");
    assert_eq!(names(folder.path()), ["a.rlv"]);
    let raster = raster();
    finish(filled(&raster, &path, true), &raster).unwrap();
    Reader::open(&path).unwrap();
    // One that comes to be there while the build runs stays as well.
    let late = folder.path().join("late.rlv");
    let writer = filled(&raster, &late, false);
    fs::write(&late, "mine").unwrap();
    assert!(matches!(finish(writer, &raster), Err(Error::Exists { .. })));
    assert_eq!(fs::read(&late).unwrap(), b"mine");
    assert_eq!(names(folder.path()), ["a.rlv", "late.rlv"]);
}

#[test]
fn outputs_that_cannot_be_are_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let missing = ContainerWriter::create(&folder.path().join("none/a.rlv"), false).err().unwrap();
    assert!(matches!(&missing, Error::Io { .. }) && missing.to_string().contains("none"), "{missing}");
    fs::write(folder.path().join("file"), "").unwrap();
    assert!(matches!(
        ContainerWriter::create(&folder.path().join("file/a.rlv"), true),
        Err(Error::Io { .. })
    ));
    for path in [folder.path(), Path::new("/"), Path::new("")] {
        assert!(
            matches!(ContainerWriter::create(path, true), Err(Error::Usage { .. })),
            "{}",
            path.display()
        );
    }
    assert_eq!(names(folder.path()), ["file"]);
}

#[test]
fn one_build_at_a_time_and_stale_folders_are_used_again() {
    let folder = tempfile::tempdir().unwrap();
    let (path, work) = (folder.path().join("a.rlv"), folder.path().join("a.rlv.work"));
    let raster = raster();
    let first = filled(&raster, &path, false);
    let second = ContainerWriter::create(&path, true).err().unwrap();
    assert!(second.to_string().contains("another build"), "{second}");
    drop(first);
    assert!(names(folder.path()).is_empty());
    // What a killed build leaves: its files and a lock that nobody holds.
    fs::create_dir(&work).unwrap();
    fs::write(work.join("relevo.lock"), "").unwrap();
    fs::write(work.join("level-02"), "half a tile").unwrap();
    finish(filled(&raster, &path, false), &raster).unwrap();
    Reader::open(&path).unwrap();
    assert_eq!(names(folder.path()), ["a.rlv"]);
    // A folder of that name that is somebody's own is left alone.
    fs::create_dir(&work).unwrap();
    fs::write(work.join("thesis.txt"), "").unwrap();
    let refused = ContainerWriter::create(&path, true).err().unwrap();
    assert!(refused.to_string().contains("in the way"), "{refused}");
    assert_eq!(names(&work), ["thesis.txt"]);
}

#[test]
fn tiles_that_are_no_tree_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rlv");
    let raster = raster();
    let tiles = raster.tiles();
    let mut writer = filled(&raster, &path, false);
    let (record, chunks) = &tiles[3];
    let twice = writer.append(record, chunks).unwrap_err();
    assert!(twice.to_string().contains(&format!("tile {} came twice", record.id)), "{twice}");
    for id in [TileId::new(2, 4, 0), TileId::new(0, 0, 1), TileId::new(27, 0, 0), TileId::new(255, 0, 0)] {
        let outside = writer.append(&relevo::writer::TileRecord { id, ..*record }, chunks).unwrap_err();
        assert!(outside.to_string().contains(&format!("tile {id}, which is outside")), "{outside}");
    }
    finish(writer, &raster).unwrap();
    fs::remove_file(&path).unwrap();
    for missing in 0..tiles.len() {
        let mut writer = ContainerWriter::create(&path, false).unwrap();
        for (_, (record, chunks)) in tiles.iter().enumerate().filter(|(index, _)| *index != missing) {
            writer.append(record, chunks).unwrap();
        }
        let refused = finish(writer, &raster).unwrap_err();
        let id = tiles[missing].0.id.to_string();
        assert!(matches!(refused, Error::Usage { .. }), "{refused}");
        assert!(refused.to_string().contains(&id) || refused.to_string().contains("root"), "{refused}");
    }
    let mut orphaned = ContainerWriter::create(&path, false).unwrap();
    for (record, chunks) in &tiles {
        let children = if record.id.level == 1 { 0 } else { record.children };
        orphaned.append(&relevo::writer::TileRecord { children, ..*record }, chunks).unwrap();
    }
    assert!(finish(orphaned, &raster).unwrap_err().to_string().contains("does not name it"));
    assert!(names(folder.path()).is_empty());
}

#[test]
fn a_tree_may_be_pruned() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rlv");
    let raster = raster();
    let mut writer = ContainerWriter::create(&path, false).unwrap();
    for (record, chunks) in raster.tiles().into_iter().filter(|(record, _)| record.id.level < 2) {
        let children = if record.id.level == 1 { 0 } else { record.children };
        writer.append(&relevo::writer::TileRecord { children, ..record }, &chunks).unwrap();
    }
    finish(writer, &raster).unwrap();
    let leaves = Reader::open(&path).unwrap().leaves().unwrap();
    assert!(!leaves.is_empty() && leaves.iter().all(|leaf| leaf.level == 1));
}

#[test]
fn metadata_that_would_not_open_with_one_request_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rlv");
    let raster = raster();
    let long = Metadata { tool: "x".repeat(66_000), ..Metadata::default() };
    let refused = filled(&raster, &path, false).finish(&raster.header, &long, &raster.statistics());
    assert!(matches!(refused, Err(Error::Limit { .. })));
    assert!(names(folder.path()).is_empty());
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rlv");
    let raster = raster();
    for full in ["level-02", "assembled"] {
        let mut writer = ContainerWriter::create(&path, false).unwrap();
        std::os::unix::fs::symlink("/dev/full", folder.path().join("a.rlv.work").join(full)).unwrap();
        for (record, chunks) in raster.tiles() {
            writer.append(&record, &chunks).unwrap();
        }
        let failed = finish(writer, &raster).unwrap_err();
        let text = failed.to_string();
        assert!(text.contains("a.rlv: ") && text.contains("no output was written"), "{text}");
        assert!(text.contains("No space left"), "{text}");
        assert!(names(folder.path()).is_empty());
    }
}
