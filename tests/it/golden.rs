//! Files of every version of the format, made by the program of the time, are read as that program read them.
//!
//! The digests were taken with the program that made the files: of each tile, coarse ones first, the states, codes and lows of
//! its samples, and the codes of its error table.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use relevo::container::Reader;
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
