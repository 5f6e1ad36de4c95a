//! Lies: every statement of a file that can be checked is made false, one at a time, checksums
//! repaired, and `verify` names it.
//!
//! What `verify` cannot know is listed in its module documentation; everything else of sections 3
//! to 11 of `format-spec.md` has a case here.

use std::path::{Path, PathBuf};

use super::{report, words};
use crate::support::terrain::{self, Kind, Memory};
use crate::verify::patch::{METADATA, Parts, Row, pack, unpack};
use crate::verify::statements::member;
use relevo::container::reader::Reader;
use relevo::geo::{Crs, CrsKind, Ellipsoid, Geo, GeoKeys};
use relevo::pipeline::{BuildOptions, Silent, build};
use relevo::sample::SampleType;
use relevo::source::Samples;
use serde_json::json;
use tempfile::TempDir;

/// A built file and what it was built from.
pub struct Honest {
    folder: TempDir,
    source: Memory,
}

impl Honest {
    fn new(source: Memory, precision_m: Option<f64>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let options =
            BuildOptions { tile: 16, patch: 4, precision_m, jobs: Some(1), ..BuildOptions::default() };
        build(&source, &folder.path().join("a.rlv"), &options, &Silent).unwrap();
        Self { folder, source }
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("a.rlv")
    }

    /// The file with one thing changed.
    pub fn with(&self, lie: impl FnOnce(&mut Parts)) -> PathBuf {
        let path = self.folder.path().join("lie.rlv");
        let mut parts = Parts::read(&self.path());
        lie(&mut parts);
        parts.write(&path);
        path
    }
}

/// What a verification is given.
#[derive(Clone, Copy, PartialEq)]
pub enum With {
    Nothing,
    Deep,
    Source,
}

pub type Lie = (&'static str, With, &'static str, fn(&mut Parts));

/// Tells each lie, and expects words in what is found.
pub fn tell(honest: &Honest, lies: &[Lie]) {
    let plain = honest.with(|_| ());
    let good = report(&plain, Some(&honest.source), true);
    assert!(good.is_good(), "a file that was only taken apart: {}", words(&good));
    for (name, with, expected, lie) in lies {
        let path = honest.with(lie);
        let source = (*with == With::Source).then_some(&honest.source);
        let found = report(&path, source, *with == With::Deep);
        assert!(!found.is_good(), "{name}: nothing was found");
        let found = words(&found);
        assert!(found.contains(expected), "{name}: expected {expected:?} in\n{found}");
    }
}

fn geographic() -> Crs {
    let wkt = r#"GEOGCRS["WGS 84",DATUM["World Geodetic System 1984",ELLIPSOID["WGS 84",6378137,298.257223563,LENGTHUNIT["metre",1]]],CS[ellipsoidal,2],AXIS["latitude",north,ANGLEUNIT["degree",0.0174532925199433]],AXIS["longitude",east,ANGLEUNIT["degree",0.0174532925199433]],ID["EPSG",4326]]"#;
    Crs {
        kind: CrsKind::Geographic,
        epsg: Some(4326),
        wkt: wkt.into(),
        unit: 1.0_f64.to_radians(),
        keys: Some(GeoKeys {
            directory: vec![1, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 2, 2048, 0, 1, 4326],
            ..GeoKeys::default()
        }),
        ..Crs::default()
    }
}

/// A file of four levels with voids, on a geographic grid.
pub fn usual() -> Honest {
    let mut source = terrain::int16(100, 80, Kind::Islands, 9);
    let transform = Some([10.0, 0.01, 0.0, 60.0, 0.0, -0.01]);
    source.info.geo = Geo { transform, pixel_is_point: true, crs: geographic() };
    source.info.vertical_unit = (0.3048, "foot".into());
    source.info.band_scale = 0.5;
    Honest::new(source, None)
}

/// The leaf that has most in it, valid and void.
fn busiest(parts: &mut Parts) -> &mut Row {
    let leaves = parts.rows.iter_mut().filter(|row| row.level == 3 && row.flags == 3);
    leaves.max_by_key(|row| row.chunks[0].len()).unwrap()
}

fn leave_out(parts: &mut Parts) {
    let Row { level, x, y, .. } = *busiest(parts);
    parts.leave_out(level, x, y);
}

const IN_THE_INDEX: &[Lie] = &[
    ("a range too wide below", With::Nothing, "height range", |p| p.row(0, 0, 0).min_m -= 10_000.0),
    ("a range too wide above", With::Nothing, "height range", |p| busiest(p).max_m += 10_000.0),
    ("a leaf's range a little too wide", With::Deep, "height range", |p| {
        let row = busiest(p);
        row.max_m = row.max_m.next_up().next_up();
    }),
    ("the root's range a little too wide", With::Deep, "height range", |p| {
        let row = p.row(0, 0, 0);
        row.min_m = row.min_m.next_down().next_down();
    }),
    ("a range too narrow", With::Nothing, "height range", |p| {
        let row = p.row(1, 0, 0);
        row.max_m = row.min_m;
    }),
    ("a range that is infinite", With::Nothing, "height range", |p| {
        p.row(2, 1, 1).max_m = f32::INFINITY;
    }),
    ("a vertical error", With::Nothing, "vertical error in the index", |p| p.row(1, 0, 0).vertical -= 1),
    ("a horizontal error", With::Nothing, "horizontal error in the index", |p| {
        p.row(1, 0, 0).horizontal += 1;
    }),
    ("flags", With::Nothing, "", |p| p.row(1, 0, 0).flags ^= 3),
    ("no void", With::Nothing, "", |p| {
        p.row(1, 0, 0).flags = 1;
        p.row(1, 0, 0).chunks[1].clear();
    }),
    ("a child that is not there", With::Nothing, "", |p| busiest(p).children = 1),
    ("a tile left out", With::Nothing, "existence", |p| leave_out(p)),
    ("a tile left out, seen by its source", With::Source, "source samples", |p| leave_out(p)),
];

#[test]
fn lies_in_the_index() {
    tell(&usual(), IN_THE_INDEX);
}

/// Bytes of an error table's four planes.
fn with_errors(row: &mut Row, edit: impl FnOnce(&mut [u8])) {
    let chunk = &mut row.chunks[2];
    let mut table = unpack(chunk);
    edit(&mut table);
    *chunk = pack(&table);
}

/// Of 16 patches of three steps: after 2 bytes of bits, planes of 48 bytes.
const VERTICAL_HIGH: usize = 2 + 48;
const HORIZONTAL_HIGH: usize = 2 + 3 * 48;

const IN_ERROR_TABLES: &[Lie] = &[
    ("no vertical error at the coarsest step", With::Deep, "vertical errors", |p| {
        with_errors(busiest(p), |table| {
            table[2 + 16..2 + 48].fill(0);
            table[VERTICAL_HIGH + 16..VERTICAL_HIGH + 48].fill(0);
        });
    }),
    ("no horizontal error at the coarsest step", With::Deep, "horizontal errors", |p| {
        with_errors(busiest(p), |table| {
            table[2 + 96 + 16..2 + 96 + 48].fill(0);
            table[HORIZONTAL_HIGH + 16..HORIZONTAL_HIGH + 48].fill(0);
        });
    }),
    ("no errors in the root", With::Nothing, "monotone errors", |p| {
        with_errors(p.row(0, 0, 0), |table| table[2..].fill(0));
        let row = p.row(0, 0, 0);
        (row.vertical, row.horizontal) = (0, 0);
    }),
    ("an error of a leaf's finest step", With::Nothing, "monotone errors", |p| {
        with_errors(busiest(p), |table| table[VERTICAL_HIGH] = 0x40);
        busiest(p).vertical = 0x4000;
    }),
    ("a code above infinity", With::Nothing, "chunks", |p| {
        with_errors(busiest(p), |table| {
            (table[2 + 16], table[VERTICAL_HIGH + 16]) = (1, 0xFF);
        });
    }),
    ("a patch that cannot be drawn", With::Nothing, "drawable", |p| {
        with_errors(busiest(p), |table| table[0] ^= 0x10);
    }),
];

#[test]
fn lies_in_error_tables() {
    tell(&usual(), IN_ERROR_TABLES);
}

const IN_MASKS_AND_HEIGHTS: &[Lie] = &[
    // Bit 7 of byte 5: sample 47 of C, in the middle of a leaf.
    ("a void that is none", With::Nothing, "", |p| flip_mask(busiest(p), 5)),
    ("a void that is none, by its source", With::Source, "source samples", |p| flip_mask(busiest(p), 5)),
    ("a void in the root", With::Deep, "samples across levels", |p| flip_mask(p.row(0, 0, 0), 20)),
    ("heights", With::Source, "source samples", |p| {
        let row = busiest(p);
        (0..64).for_each(|number| change_height(row, number));
    }),
    ("a height of a coarser level", With::Nothing, "", |p| change_height(p.row(1, 0, 0), 30)),
    ("a border", With::Nothing, "borders", |p| {
        // Every residual of V and H, borders among them.
        let row = busiest(p);
        (64..192).for_each(|number| change_height(row, number));
    }),
    ("weights", With::Source, "source samples", |p| busiest(p).chunks[0][3] ^= 1),
];

#[test]
fn lies_in_masks_and_heights() {
    tell(&usual(), IN_MASKS_AND_HEIGHTS);
}

fn flip_mask(row: &mut Row, byte: usize) {
    let chunk = &mut row.chunks[1];
    let mut mask = unpack(chunk);
    mask[byte] ^= 0x80;
    *chunk = pack(&mask);
}

/// Changes the residual of a newborn sample.
fn change_height(row: &mut Row, number: usize) {
    let chunk = &mut row.chunks[0];
    let length = u32::from_le_bytes(chunk[4..8].try_into().unwrap()) as usize;
    let mut plane = unpack(&chunk[12..12 + length]);
    plane[number] ^= if plane[number] >= 254 { 128 } else { 1 };
    let plane = pack(&plane);
    let rest = chunk.split_off(12 + length);
    chunk.truncate(12);
    chunk[4..8].copy_from_slice(&(plane.len() as u32).to_le_bytes());
    chunk.extend(plane);
    chunk.extend(rest);
}

/// A file of one tile whose lone heights lie 2^23 apart, and says that 32 bits are enough for it.
#[test]
fn a_promise_of_narrow_heights_that_does_not_hold() {
    let mut source = terrain::extreme(17, 17, SampleType::Int32, 3);
    source.mask = None;
    let file = Honest::new(source, None);
    let narrow: Lie = ("narrow", With::Nothing, "narrow", |p| p.row(0, 0, 0).chunks[0][0] |= 1);
    let path = file.with(narrow.3);
    let found = words(&report(&path, None, false));
    assert!(found.contains("narrow"), "{found}");
}

#[test]
fn lies_about_rounding() {
    let source = terrain::smooth(60, 60, SampleType::Float32, true);
    let file = Honest::new(source, Some(0.01));
    tell(
        &file,
        &[
            ("an error of rounding too small", With::Source, "source samples", |p| {
                p.double(88, |error| error / 2.0);
            }),
            ("an error of rounding too large", With::Nothing, "precision_m", |p| {
                p.double(88, |error| error * 2.0);
            }),
            ("no rounding", With::Nothing, "", |p| {
                p.set(46, &[0]);
                p.double(88, |_| 0.0);
            }),
            ("precision", With::Nothing, "precision_m", |p| {
                p.json(METADATA, |m| *member(m, "/options/precision_m") = json!(0.005));
            }),
        ],
    );
}

#[test]
fn degrees_that_cannot_be() {
    let mut source = terrain::int16(40, 30, Kind::RandomVoids, 1);
    source.info.geo.transform = Some([2e5, 500.0, 0.0, 5.0e6, 0.0, -500.0]);
    source.info.geo.crs.kind = CrsKind::Projected;
    let file = Honest::new(source, None);
    let lie: Lie = ("metres that are degrees", With::Nothing, "geographic raster", |p| {
        p.json(METADATA, |m| {
            *member(m, "/crs/kind") = json!("geographic");
            *member(m, "/crs/unit") = json!(1.0_f64.to_radians());
        });
    });
    tell(&file, &[lie]);
    let sphere = Ellipsoid { a: 1.0, inverse_flattening: 0.0 };
    assert!(sphere.metres_of_radian(0.0).0 > 0.0);
}

/// A geographic raster whose last row is not the end of its surface: the program before version 2
/// of the format stored 247 808 m at step 5.
fn beyond_the_last_row() -> Memory {
    let mut source = terrain::int16(40, 40, Kind::Rough, 0);
    source.info.nodata = None;
    let Samples::Int16(samples) = &mut source.samples else { unreachable!() };
    samples.iter_mut().enumerate().for_each(|(i, sample)| *sample = (i % 40 * 3) as i16);
    source.info.geo =
        Geo { transform: Some([0.0, 1.0, 0.0, 80.0, 0.0, -0.1]), pixel_is_point: false, crs: geographic() };
    source.info.geo.crs.keys = None;
    source
}

#[test]
fn a_distance_beyond_the_last_row_is_measured_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rlv");
    let options = BuildOptions { tile: 64, patch: 64, jobs: Some(1), ..BuildOptions::default() };
    build(&beyond_the_last_row(), &path, &options, &Silent).unwrap();
    // As the scale of the last row had it.
    let code = (247_808.0_f32.to_bits() >> 15) as u16;
    let mut parts = Parts::read(&path);
    let chunk = &mut parts.row(0, 0, 0).chunks[2];
    let mut table = unpack(chunk);
    // One patch, seven steps: a byte of bits, then planes of 7.
    let sums: Vec<u16> = (0..7)
        .scan(0, |sum, step| {
            *sum += u16::from(table[15 + step]) | u16::from(table[22 + step]) << 8;
            Some(*sum)
        })
        .collect();
    let lower: Vec<u16> = sums.iter().map(|&sum| sum.min(code)).collect();
    for step in 0..7 {
        let increase = lower[step] - if step == 0 { 0 } else { lower[step - 1] };
        [table[15 + step], table[22 + step]] = increase.to_le_bytes();
    }
    *chunk = pack(&table);
    let lie = folder.path().join("lie.rlv");
    parts.write(&lie);
    let found = report(&lie, None, true);
    let check = found.check("horizontal errors").unwrap();
    assert!(check.problems > 0, "{found:?}");
    assert_eq!(check.first[0].place.step, Some(5));
    assert!(check.first[0].expected.starts_with("25478"), "{}", check.first[0]);
}

/// `fixtures/vectors`: a file of version 1, as the program before wrote it.
#[test]
fn version_1_stored_too_little_beyond_the_last_row() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/vectors/v1-beyond-the-last-row.rlv");
    let found = report(&path, None, true);
    let check = found.check("horizontal errors").unwrap();
    assert_eq!(found.problems(), check.problems, "{}", words(&found));
    assert_eq!(check.first[0].got, "247808 m");
    // Said even without looking: the version proves nothing here.
    let quick = report(&path, None, false);
    assert!(
        quick.is_good() && quick.check("proof of horizontal errors").unwrap().note.contains("not proven")
    );
    assert!(check.first[0].expected.starts_with("25478"), "{}", check.first[0]);
}

/// Section 9.1: a reader takes escapes of more bytes than they need.
#[test]
fn an_escape_may_be_longer_than_it_must() {
    let vector = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/vectors/float32-decimal.rlv");
    let folder = tempfile::tempdir().unwrap();
    let heights = |padding: &[u8]| {
        let mut parts = Parts::read(&vector);
        let chunk = &mut parts.row(0, 0, 0).chunks[0];
        let length = u32::from_le_bytes(chunk[4..8].try_into().unwrap()) as usize;
        let mut plane = unpack(&chunk[12..12 + length]);
        assert!(plane.len() > 17 * 17, "there are escapes");
        if !padding.is_empty() {
            *plane.last_mut().unwrap() |= 0x80;
            plane.extend(padding);
        }
        let plane = pack(&plane);
        let rest = chunk.split_off(12 + length);
        chunk.truncate(12);
        chunk[4..8].copy_from_slice(&(plane.len() as u32).to_le_bytes());
        chunk.extend(plane);
        chunk.extend(rest);
        let path = folder.path().join("a.rlv");
        parts.write(&path);
        let tile = Reader::open(&path).unwrap().read_tile(relevo::TileId::ROOT);
        tile.map(|tile| tile.code.clone())
    };
    let plain = heights(&[]).unwrap();
    assert_eq!(heights(&[0]).unwrap(), plain);
    assert_eq!(heights(&[0x80, 0]).unwrap(), plain);
    assert!(heights(&[0x80, 0x80, 0x80, 0x80, 0]).is_err(), "six bytes");
    assert!(heights(&[0x80, 0x80, 0x80, 0x10]).is_err(), "2^32 and more, in five bytes");
}
