//! Files of every version of the format, made by the program of the time, are read as that program
//! read them.
//!
//! The digests were taken with the program that made the files: of each tile, coarse ones first,
//! the states, codes and lows of its samples, and the codes of its error table.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use relevo::container::Reader;
use relevo::verify::{VerifyOptions, verify};
use sha2::{Digest, Sha256};

/// Name, and the first 16 digits of the SHA-256 of heights and of errors.
const VERSION_1: [(&str, &str, &str); 7] = [
    ("float32_voids_geographic", "f231461dbffc8403", "210159abe65102a5"),
    ("float64_voids", "c217c9307ff4653c", "16b38ff688e16073"),
    ("float64_voids_precision", "20c1ed546879a192", "9865384d802224ac"),
    ("int16_voids_geographic", "1ea2648bfa1bd08b", "e261f456cff3a9d3"),
    ("int16_voids_geographic_paper", "1ea2648bfa1bd08b", "3255901481ca3f6a"),
    ("rmnp_dem_uint16", "2d176d1a90aa00bd", "4639887c71d7dc3f"),
    // Its predictions wrap below the range of i32 where tiles say that they are narrow.
    ("uint32_voids", "bc981652013820c2", "cff6bc6ad328afab"),
];

/// The same of version 2, made by the program of the day before the crates were parted, and of
/// imagery the texels. The digests are of the day after; heights of the last two are those of
/// `rmnp_dem_uint16` above.
const VERSION_2: [(&str, &str, &str, &str); 3] = [
    ("int16_voids", "ef31fe9075647a8d", "38a701cfa2099e06", "e3b0c44298fc1c14"),
    ("uint16_imagery", "2d176d1a90aa00bd", "3f90cf2f6498f74d", "19ee3145cd150842"),
    ("uint16_bc7", "2d176d1a90aa00bd", "3f90cf2f6498f74d", "2fdb987047d343b6"),
];

fn golden(version: u16, name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fixtures/golden/v{version}/{name}.rlv"))
}

fn digits(hash: Sha256) -> String {
    hash.finalize().iter().take(8).fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").expect("text");
        text
    })
}

/// Digests of what a file decodes to: heights, errors.
fn digests(reader: &Reader) -> (String, String) {
    let (mut heights, mut errors) = (Sha256::new(), Sha256::new());
    for level in 0..=reader.header().levels {
        for id in reader.tiles(level).expect("tiles") {
            let tile = reader.read_tile(id).expect("tile");
            heights.update(&tile.state);
            for (at, code) in tile.code.iter().enumerate() {
                heights.update(code.to_le_bytes());
                heights.update(tile.low_at(at).to_le_bytes());
            }
            let table = reader.read_errors(id).expect("errors");
            for code in table.vertical.iter().chain(&table.horizontal) {
                errors.update(code.to_le_bytes());
            }
        }
    }
    (digits(heights), digits(errors))
}

#[test]
fn files_of_version_1_are_read_as_before() {
    for (name, heights, errors) in VERSION_1 {
        let reader = Reader::open(golden(1, name)).expect("open");
        assert_eq!(reader.header().version, 1, "{name}");
        assert_eq!(digests(&reader), (heights.to_owned(), errors.to_owned()), "{name}");
    }
}

/// Digest of all imagery tiles, coarse ones first.
fn imagery(reader: &Reader) -> String {
    let mut texels = Sha256::new();
    let Some(layer) = reader.imagery() else { return digits(texels) };
    for level in 0..=layer.header().leaf {
        for id in layer.tiles(level).expect("tiles") {
            let tile = layer.read_tile(id).expect("texels");
            texels.update(&tile.colour);
            texels.update(tile.alpha.unwrap_or_default());
        }
    }
    digits(texels)
}

#[test]
fn files_of_version_2_are_read_as_before() {
    let read = VERSION_2.map(|(name, ..)| {
        let reader = Reader::open(golden(2, name)).expect("open");
        assert_eq!(reader.header().version, 2, "{name}");
        let (heights, errors) = digests(&reader);
        (name, heights, errors, imagery(&reader))
    });
    let own = |text: &str| text.to_owned();
    let expected =
        VERSION_2.map(|(name, heights, errors, texels)| (name, own(heights), own(errors), own(texels)));
    assert_eq!(read, expected);
}

/// Files with something wrong each: the reader says what, or, where only a chunk is damaged, the
/// check finds it.
#[test]
fn corrupt_files_are_refused_by_name() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/corrupt");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).expect("fixtures/corrupt") {
        let path = entry.expect("entry").path();
        let name = path.file_name().expect("name").to_string_lossy().into_owned();
        count += 1;
        match Reader::open(&path) {
            Err(error) => assert!(error.to_string().contains(&name), "{name}: {error}"),
            Ok(reader) => {
                let report = verify(&reader, None, &VerifyOptions::default(), &relevo::Silent);
                assert!(!report.expect("a report").is_good(), "{name} is good");
            }
        }
    }
    assert!(count >= 14, "{count} files");
}
