//! `fixtures/vectors/`: each file decodes to what its JSON says, by this crate's reader and by
//! `tests/spec_reader.py`, which made it.
//!
//! And the same two readers against each other over random small rasters, whose files nobody has
//! looked at.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::terrain::{self, Kind, Memory, noise};
use relevo::container::Reader;
use relevo::container::directory::TileEntry;
use relevo::pipeline::{BuildOptions, Silent, build};
use relevo::sample::{Coding, Lattice, SampleType, VALID};
use relevo::source::Samples;
use relevo::verify::{VerifyOptions, verify};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

fn vectors() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/vectors");
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<_> = files.filter(|path| path.extension().is_some_and(|e| e == "rlv")).collect();
    files.sort();
    assert!(files.len() >= 15, "{files:?}");
    files
}

fn hex(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().fold(String::new(), |mut hex, byte| {
        write!(hex, "{byte:02x}").unwrap();
        hex
    })
}

/// What the Python reader prints of some files.
fn python(arguments: &[&str], files: &[PathBuf]) -> String {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/spec_reader.py");
    let output = Command::new("python3").arg(script).args(arguments).args(files).output();
    let hint = "python3 runs: install python3 and its module zstandard, as ./test.sh does";
    let output = output.unwrap_or_else(|error| unreachable!("{hint}: {error}"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn number(value: f64) -> Value {
    if value.is_finite() { json!(value) } else { json!(value.to_string().to_lowercase()) }
}

fn header(reader: &Reader) -> Value {
    let header = reader.header();
    let (kind, scale, offset) = match header.coding {
        Coding::Integer { scale, offset } => (1, scale, offset),
        Coding::Float32 => (2, 1.0, 0.0),
        Coding::Float64 => (3, 1.0, 0.0),
    };
    json!({
        "width": header.width, "height": header.height, "tile": header.tile(), "patch": header.patch(),
        "leaf_level": header.levels, "metric": header.metric.as_str(), "sample_kind": kind,
        "source_type": format!("{:?}", header.source_type).to_lowercase(), "scale": scale, "offset": offset,
        "band_scale": header.band_scale, "band_offset": header.band_offset, "unit_metres": header.unit_metres,
        "quantisation_error": header.quantisation_error, "nodata": header.nodata.map(number),
        "geotransform": header.transform, "tile_count": header.tile_count,
    })
}

/// Codes and lows of the valid samples (0 of the others), validity, and error tables, as the Python
/// reader sums them.
fn parts(reader: &Reader, tile: &Lattice, entry: &TileEntry) -> [Vec<u8>; 3] {
    let valid = |i: usize| tile.state[i] == VALID;
    let codes = (0..tile.code.len()).flat_map(|i| if valid(i) { tile.code[i] } else { 0 }.to_le_bytes());
    let lows = (0..tile.low.len()).flat_map(|i| if valid(i) { tile.low[i] } else { 0 }.to_le_bytes());
    let table = reader.read_errors(entry.id).unwrap();
    let mut errors: Vec<u8> = table.drawable.iter().map(|&drawable| u8::from(drawable)).collect();
    errors.extend(table.vertical.iter().chain(&table.horizontal).flat_map(|code| code.to_le_bytes()));
    let validity = (0..tile.state.len()).map(|i| u8::from(valid(i))).collect();
    [codes.chain(lows).collect(), validity, errors]
}

/// Holds one tile against its object.
fn check_tile(reader: &Reader, entry: &TileEntry, expected: &Value, name: &str) {
    let tile = reader.read_tile(entry.id).unwrap();
    let side = tile.n + 1;
    let [heights, valid, errors] = parts(reader, &tile, entry).map(|bytes| hex(&bytes));
    let rows = |value: &dyn Fn(usize) -> Value| -> Vec<Vec<Value>> {
        let count = expected["codes"].as_array().unwrap().len();
        let sample = |at: usize| if tile.state[at] == VALID { value(at) } else { Value::Null };
        (0..count).map(|row| (0..side).map(|column| sample(row * side + column)).collect()).collect()
    };
    let flags = u8::from(entry.has_valid) | u8::from(entry.has_void) << 1;
    let mut got = json!({
        "tile": entry.id.to_string(), "children": entry.children, "flags": flags, "vertical": entry.vertical,
        "horizontal": entry.horizontal, "min_m": number(entry.min_m.into()), "max_m": number(entry.max_m.into()),
        "offset": entry.chunks.offset, "lengths": entry.chunks.lengths,
        "heights_sha256": heights, "valid_sha256": valid, "errors_sha256": errors,
        "codes": rows(&|at| json!(tile.code[at])),
        "values": rows(&|at| number(tile.value(at, reader.header().coding))),
    });
    if !tile.low.is_empty() {
        got["lows"] = json!(rows(&|at| json!(tile.low[at])));
    }
    let table = reader.read_errors(entry.id).unwrap();
    let patches = table.drawable.len();
    got["drawable"] = table.drawable.iter().map(|&drawable| json!(u8::from(drawable))).collect();
    for (member, codes) in [("vertical_codes", &table.vertical), ("horizontal_codes", &table.horizontal)] {
        let steps = expected[member].as_object().unwrap().keys();
        let plane = |step: &String| {
            let start = step.parse::<usize>().unwrap() * patches;
            (step.clone(), json!(codes[start..start + patches]))
        };
        got[member] = Value::Object(steps.map(plane).collect());
    }
    assert_eq!(alike(&got), alike(expected), "{name}, tile {}", entry.id);
}

/// A JSON value with every number as f64: 1 and 1.0 are one number.
fn alike(value: &Value) -> Value {
    match value {
        Value::Number(number) => json!(number.as_f64().unwrap()),
        Value::Array(list) => list.iter().map(alike).collect(),
        Value::Object(members) => {
            Value::Object(members.iter().map(|(name, value)| (name.clone(), alike(value))).collect())
        }
        other => other.clone(),
    }
}

fn check_imagery(reader: &Reader, expected: &Value, name: &str) {
    let Some(layer) = reader.imagery() else {
        assert!(expected.is_null(), "{name}");
        return;
    };
    let mut entries = Vec::new();
    layer
        .walk(&mut |entry| {
            entries.push(*entry);
            Ok(())
        })
        .unwrap();
    entries.sort_by_key(|entry| (entry.id.level, entry.id.hilbert()));
    let tiles = expected["tiles"].as_array().unwrap();
    assert_eq!(entries.len(), tiles.len(), "{name}");
    for (entry, expected) in entries.iter().zip(tiles) {
        let texels = layer.read_tile(entry.id).unwrap();
        assert_eq!(expected["tile"], entry.id.to_string(), "{name}");
        // What the Python reader had no decoder for is null.
        if let Some(sum) = expected["colour_sha256"].as_str() {
            assert_eq!(sum, hex(&texels.colour), "{name}, imagery tile {}", entry.id);
        }
        let alpha = texels.alpha.unwrap_or_else(|| vec![255; layer.header().side().pow(2)]);
        if let Some(sum) = expected["alpha_sha256"].as_str() {
            assert_eq!(sum, hex(&alpha), "{name}, imagery tile {}", entry.id);
        }
    }
}

#[test]
fn the_reader_decodes_the_vectors_to_what_is_written_beside_them() {
    for path in vectors() {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let length = std::fs::metadata(&path).unwrap().len();
        assert!(length < 30_000, "{name}: {length} bytes");
        let expected: Value =
            serde_json::from_str(&std::fs::read_to_string(path.with_extension("json")).unwrap()).unwrap();
        let reader = Reader::open(&path).unwrap();
        let mut of_header = expected["header"].clone();
        let version = of_header.as_object_mut().unwrap().remove("version").unwrap();
        assert_eq!(
            version == 1,
            name.starts_with("v1-"),
            "{name}: version {version}; run fixtures/vectors/make.sh"
        );
        assert_eq!(alike(&header(&reader)), alike(&of_header), "{name}");
        let metadata = serde_json::to_value(reader.metadata()).unwrap();
        assert_eq!(alike(&metadata), alike(&expected["metadata"]), "{name}");
        let statistics = serde_json::to_value(reader.statistics().unwrap()).unwrap();
        assert_eq!(alike(&statistics), alike(&expected["statistics"]), "{name}");
        let mut tiles = expected["tiles"].as_array().unwrap().iter();
        for level in 0..=reader.header().levels {
            for id in reader.tiles(level).unwrap() {
                let entry = reader.entry(id).unwrap().unwrap();
                check_tile(&reader, &entry, tiles.next().unwrap(), &name);
            }
        }
        assert!(tiles.next().is_none(), "{name}");
        check_imagery(&reader, &expected["imagery"], &name);
    }
}

#[test]
fn the_python_reader_still_says_so() {
    for path in vectors() {
        let stored: Value =
            serde_json::from_str(&std::fs::read_to_string(path.with_extension("json")).unwrap()).unwrap();
        let mut said: Value =
            serde_json::from_str(&python(&["--json"], std::slice::from_ref(&path))).unwrap();
        if let (Some(said), Some(stored)) = (said.get_mut("imagery"), stored.get("imagery")) {
            // It decodes WebP where Pillow is installed.
            let tiles = said["tiles"].as_array_mut().unwrap();
            for (tile, stored) in tiles.iter_mut().zip(stored["tiles"].as_array().unwrap()) {
                if tile["colour_sha256"].is_null() {
                    *tile = stored.clone();
                }
            }
        }
        assert_eq!(said, stored, "{}", path.display());
    }
}

#[test]
fn the_vectors_are_good_files() {
    for path in vectors() {
        let reader = Reader::open(&path).unwrap();
        let options = VerifyOptions { deep: true, ..VerifyOptions::default() };
        // Of the sparse one the root square is too large for brute force.
        let deep = u64::from(reader.header().width) * u64::from(reader.header().height) < 1 << 24;
        let report = verify(&reader, None, &VerifyOptions { deep, ..options }, &Silent).unwrap();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let wrong = report.checks.iter().filter(|check| check.problems > 0);
        let wrong: Vec<_> = wrong.map(|check| (check.name, check.first.clone())).collect();
        if name == "v1-beyond-the-last-row" {
            assert_eq!(wrong.len(), 1, "{wrong:?}");
            assert_eq!(wrong[0].0, "horizontal errors");
        } else {
            assert!(wrong.is_empty(), "{name}: {wrong:?}");
        }
    }
}

/// What the Python reader prints of a file without options, made with this crate's reader.
fn listing(path: &Path) -> String {
    let reader = Reader::open(path).unwrap();
    let mut out = String::new();
    for level in 0..=reader.header().levels {
        for id in reader.tiles(level).unwrap() {
            let entry = reader.entry(id).unwrap().unwrap();
            let flags = u8::from(entry.has_valid) | u8::from(entry.has_void) << 1;
            let sums = parts(&reader, &reader.read_tile(id).unwrap(), &entry).map(|bytes| hex(&bytes));
            writeln!(out, "{id} {} {flags} {}", entry.children, sums.join(" ")).unwrap();
        }
    }
    out
}

/// A random small raster of any type: smooth, at the ends of its type, or rough, with voids or
/// without.
fn random(seed: u64) -> (Memory, BuildOptions) {
    let pick = |what: u32, of: u64| noise(seed, what, 77) % of;
    let (width, height) = (1 + pick(1, 70) as u32, 1 + pick(2, 50) as u32);
    let kind = SampleType::ALL[(seed % 8) as usize];
    let mut raster = match pick(3, 4) {
        0 => terrain::int16(width, height, Kind::ALL[pick(4, 13) as usize], seed),
        1 => terrain::smooth(width, height, kind, pick(5, 2) == 0),
        _ => terrain::extreme(width, height, kind, seed),
    };
    if pick(6, 3) == 0 && raster.info.nodata.is_none() {
        raster.mask = None;
    }
    // A cliff of the whole range in otherwise smooth terrain: predictions beside it leave the type.
    if let (Samples::Uint32(samples), 0) = (&mut raster.samples, pick(7, 2)) {
        for (at, sample) in samples.iter_mut().enumerate() {
            *sample =
                if at as u32 % width < width / 2 { (at % 9) as u32 } else { u32::MAX - (at % 7) as u32 };
        }
    }
    let (tile, patch) = [(16, 4), (16, 16), (32, 8), (64, 16)][pick(8, 4) as usize];
    let precision_m = (pick(9, 5) == 0 && kind.is_float() && pick(3, 4) == 1).then_some(0.25);
    (raster, BuildOptions { tile, patch, precision_m, jobs: Some(1), ..BuildOptions::default() })
}

#[test]
fn random_rasters_decode_alike_in_both_readers() {
    let folder = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    for seed in 0..48 {
        let (raster, options) = random(seed);
        let path = folder.path().join(format!("{seed}.rlv"));
        match build(&raster, &path, &options, &Silent) {
            Ok(_) => files.push(path),
            Err(error) => assert!(error.to_string().contains("at least one valid sample"), "{seed}: {error}"),
        }
    }
    assert!(files.len() >= 40);
    let mut expected = String::new();
    for path in &files {
        writeln!(expected, "{}", path.display()).unwrap();
        expected += &listing(path);
    }
    let said = python(&[], &files);
    for (said, expected) in said.lines().zip(expected.lines()) {
        assert_eq!(said, expected);
    }
    assert_eq!(said.lines().count(), expected.lines().count());
}
