//! Files put together by hand: newer, older, longer and shorter than ours.

use std::fs;
use std::path::PathBuf;

use relevo::Error;
use relevo::container::Reader;
use relevo::container::opening::{HEADER_BYTES, Opening};
use relevo::container::sections::{COVERED, REQUIRED, SectionEntry};
use tempfile::TempDir;

use super::raster::{INTEGER, Raster};

/// A small file and a place for changed copies of it.
pub struct Bench {
    folder: TempDir,
    pub bytes: Vec<u8>,
}

impl Bench {
    pub fn new(raster: &Raster) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("good.rlv");
        raster.write(&path);
        Self { folder, bytes: fs::read(path).unwrap() }
    }

    pub fn path(&self, bytes: &[u8]) -> PathBuf {
        let path = self.folder.path().join("changed.rlv");
        fs::write(&path, bytes).unwrap();
        path
    }

    pub fn open(&self, bytes: &[u8]) -> relevo::Result<Reader> {
        Reader::open(self.path(bytes))
    }

    pub fn opening(&self) -> Opening {
        Opening::decode(&self.bytes, self.bytes.len() as u64).unwrap()
    }

    /// The bytes of a section.
    pub fn section(&self, kind: u32) -> Vec<u8> {
        let opening = self.opening();
        let section = opening.sections.iter().find(|section| section.kind == kind).unwrap();
        self.bytes[section.offset as usize..section.end() as usize].to_vec()
    }
}

/// Makes the CRC of header and section table right again.
pub fn repair(bytes: &mut [u8]) {
    let count = u32::from_le_bytes(bytes[20..24].try_into().unwrap()) as usize;
    let Some(table) = bytes.get(HEADER_BYTES..HEADER_BYTES.saturating_add(count.saturating_mul(32))) else {
        return;
    };
    let mut crc = crc32fast::Hasher::new();
    crc.update(&bytes[..HEADER_BYTES - 4]);
    crc.update(table);
    let crc = crc.finalize().to_le_bytes();
    bytes[HEADER_BYTES - 4..HEADER_BYTES].copy_from_slice(&crc);
}

/// A file of these sections (kind, flags, bytes), in this order.
pub fn lay_out(opening: &Opening, parts: &[(u32, u32, Vec<u8>)]) -> Vec<u8> {
    let mut end = Opening::bytes(parts.len());
    let mut sections = Vec::new();
    for (kind, flags, bytes) in parts {
        let crc = if flags & COVERED != 0 { crc32fast::hash(bytes) } else { 0 };
        let length = bytes.len() as u64;
        sections.push(SectionEntry { kind: *kind, flags: *flags, offset: end, length, crc });
        end += length;
    }
    let mut out = Opening { sections, file_length: end, ..opening.clone() }.encode();
    for (_, _, bytes) in parts {
        out.extend(bytes);
    }
    out
}

fn text(error: Option<Error>) -> String {
    error.map(|error| error.to_string()).unwrap_or_default()
}

#[test]
fn the_opening_round_trips() {
    let bench = Bench::new(&Raster::bumpy(40, 40, INTEGER, 40));
    let opening = bench.opening();
    let encoded = opening.encode();
    assert_eq!(encoded, bench.bytes[..encoded.len()]);
}

#[test]
fn truncated_and_longer_files_are_named_as_such() {
    let bench = Bench::new(&Raster::bumpy(20, 20, INTEGER, 41));
    for end in 0..bench.bytes.len() {
        let got = text(bench.open(&bench.bytes[..end]).err());
        assert!(got.contains("truncated") && got.contains("changed.rlv"), "cut at {end}: {got}");
    }
    let longer = [&bench.bytes[..], &[0; 7]].concat();
    assert!(text(bench.open(&longer).err()).contains("7 trailing bytes"));
    assert!(text(bench.open(b"II*\0 a tiff").err()).contains(".rlv"));
    let missing = Reader::open(bench.path(b"").with_file_name("none.rlv")).err();
    assert!(matches!(missing, Some(Error::Io { .. })));
}

#[test]
fn what_a_newer_program_wrote_is_refused_by_name() {
    let bench = Bench::new(&Raster::bumpy(20, 20, INTEGER, 42));
    let changed = |at: usize, value: u8| {
        let mut bytes = bench.bytes.clone();
        bytes[at] = value;
        repair(&mut bytes);
        match bench.open(&bytes).err() {
            Some(Error::Unsupported { what, .. }) => what,
            other => panic!("byte {at}: {other:?}"),
        }
    };
    assert!(changed(8, 3).contains("version 3"));
    assert!(changed(13, 4).contains("feature bit 10"));
    assert!(changed(43, 3).contains("metric 3"));
    assert!(changed(44, 9).contains("sample kind 9"));
    assert!(changed(45, 99).contains("source type 99"));
    // Optional features are nobody's duty.
    let mut optional = bench.bytes.clone();
    optional[17] = 0xFF;
    repair(&mut optional);
    bench.open(&optional).unwrap();
}

#[test]
fn unknown_sections_are_skipped_unless_they_are_required() {
    let raster = Raster::bumpy(40, 40, INTEGER, 43);
    let bench = Bench::new(&raster);
    let known = |kind: u32, flags: u32| (kind, flags, bench.section(kind));
    let parts = |kind, flags| {
        vec![
            known(5, REQUIRED),
            known(1, COVERED),
            (kind, flags, b"later".to_vec()),
            known(4, REQUIRED),
            known(2, REQUIRED | COVERED),
            (kind, flags, Vec::new()),
        ]
    };
    // In another order, without statistics, with two sections of a kind to come.
    let reader = bench.open(&lay_out(&bench.opening(), &parts(20, COVERED))).unwrap();
    assert_eq!(reader.statistics().unwrap(), None);
    assert_eq!(reader.sections().len(), 6);
    for section in reader.sections() {
        reader.check_section(section).unwrap();
    }
    for id in raster.existing() {
        reader.read_tile(id).unwrap();
    }
    let refused = bench.open(&lay_out(&bench.opening(), &parts(20, REQUIRED))).err();
    assert!(text(refused).contains("section of kind 20"));
    for (flags, expected) in [(4, "flags"), (0x8000_0000, "flags")] {
        assert!(text(bench.open(&lay_out(&bench.opening(), &parts(17, flags))).err()).contains(expected));
    }
    for missing in [0, 1, 3, 4] {
        let mut fewer = parts(20, 0);
        fewer.remove(missing);
        assert!(text(bench.open(&lay_out(&bench.opening(), &fewer)).err()).contains("one section"));
    }
    let mut twice = parts(20, 0);
    twice.push(known(1, COVERED));
    assert!(text(bench.open(&lay_out(&bench.opening(), &twice)).err()).contains("one section metadata"));
    let mut far = parts(20, 0);
    far.insert(0, (21, 0, vec![0; 70_000]));
    assert!(text(bench.open(&lay_out(&bench.opening(), &far)).err()).contains("first 65536 bytes"));
}

#[test]
fn header_fields_out_of_range_are_refused() {
    let bench = Bench::new(&Raster::bumpy(40, 40, INTEGER, 44));
    let changes: &[(usize, &[u8], &str)] = &[
        (10, &[255, 0], "header length"),
        (20, &[65, 0, 0, 0], "section count"),
        (20, &[0, 0, 0, 0], "section count"),
        (32, &[0; 4], "width"),
        (32, &[1, 0, 0, 64], "width"),
        (36, &[0xFF; 4], "height"),
        (40, &[3], "tile size"),
        (40, &[11], "tile size"),
        (41, &[5], "patch size"),
        (41, &[1], "patch size"),
        (42, &[1], "leaf level"),
        (42, &[200], "leaf level"),
        (46, &[0xF3], "flags"),
        (46, &[1], "nodata"),
        (46, &[2], "geotransform"),
        (46, &[7], "quantisation"),
        (48, &[0; 8], "scale"),
        (56, &f64::NAN.to_le_bytes(), "offset"),
        (64, &f64::INFINITY.to_le_bytes(), "band scale"),
        (72, &f64::INFINITY.to_le_bytes(), "band offset"),
        (80, &(-1.0_f64).to_le_bytes(), "unit metres"),
        (88, &(-1.0_f64).to_le_bytes(), "quantisation"),
        (104, &f64::NAN.to_le_bytes(), "geotransform"),
        (152, &[0; 8], "tile count"),
        (152, &[0xFF; 8], "tile count"),
        (160, &[1], "reserved"),
        (251, &[1], "reserved"),
        (256 + 8, &[0, 2], "offset"),
        (256 + 16, &[0xFF; 8], "end of the file"),
        (256 + 28, &[1], "reserved"),
    ];
    for (at, value, expected) in changes {
        let mut bytes = bench.bytes.clone();
        bytes[*at..at + value.len()].copy_from_slice(value);
        repair(&mut bytes);
        let got = text(bench.open(&bytes).err());
        assert!(got.contains(expected), "byte {at}: {got}");
    }
}
