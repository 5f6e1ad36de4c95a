//! `format-spec.md` against the program: its worked example, and an independent reader written from
//! its text.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use relevo::container::{Metric, Reader};
use relevo::geo::Geo;
use relevo::geotiff_write::{GeotiffSpec, GeotiffWriter};
use relevo::limits::Limits;
use relevo::pipeline::{self, BuildOptions, Silent};
use relevo::sample::{SampleType, VALID};
use relevo::source::{self, Samples};
use sha2::{Digest, Sha256};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem").join(name)
}

fn build(dem: &Path, output: &Path, options: &BuildOptions) {
    let source = source::open(dem, &Limits::default()).expect("source");
    pipeline::build(&*source, output, &BuildOptions { force: true, ..options.clone() }, &Silent)
        .expect("build");
}

/// Bytes of the one `hex` block of the specification: `OOOOOOOO  xx xx ...`.
fn worked_example() -> Vec<u8> {
    let spec = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("format-spec.md"));
    let spec = spec.expect("format-spec.md");
    let block = spec.split("```hex\n").nth(1).and_then(|rest| rest.split("```").next()).expect("a hex block");
    let mut bytes = Vec::new();
    for line in block.lines().filter(|line| !line.trim().is_empty()) {
        let mut words = line.split_whitespace();
        let offset = usize::from_str_radix(words.next().expect("offset"), 16).expect("hex offset");
        assert_eq!(offset, bytes.len(), "{line}");
        bytes.extend(words.map(|word| u8::from_str_radix(word, 16).expect("hex byte")));
    }
    bytes
}

#[test]
fn the_worked_example_is_what_the_program_writes() {
    let folder = tempfile::tempdir().expect("folder");
    let output = folder.path().join("tiny.rlv");
    let options = BuildOptions { tile: 16, patch: 4, ..BuildOptions::default() };
    build(&fixture("tiny_3x2.tif"), &output, &options);
    let written = std::fs::read(&output).expect("file");
    let expected = worked_example();
    let first = written.iter().zip(&expected).position(|(a, b)| a != b);
    assert!(
        written == expected,
        "the file ({} bytes) and format-spec.md ({} bytes) first differ at {first:x?}: change both or neither",
        written.len(),
        expected.len()
    );
}

/// What the Python reader prints, made with the Rust reader.
fn listing(path: &Path) -> String {
    let reader = Reader::open(path).expect("open");
    let header = reader.header();
    let mut out = String::new();
    for level in 0..=header.levels {
        for id in reader.tiles(level).expect("tiles") {
            let entry = reader.entry(id).expect("index").expect("tile");
            let tile = reader.read_tile(id).expect("tile");
            let table = reader.read_errors(id).expect("errors");
            let valid = |i: &usize| tile.state[*i] == VALID;
            let mut heights = Vec::new();
            for i in 0..tile.code.len() {
                heights.extend(if valid(&i) { tile.code[i] } else { 0 }.to_le_bytes());
            }
            for i in 0..tile.low.len() {
                heights.extend(if valid(&i) { tile.low[i] } else { 0 }.to_le_bytes());
            }
            let validity: Vec<u8> = (0..tile.state.len()).map(|i| u8::from(valid(&i))).collect();
            let mut errors: Vec<u8> = table.drawable.iter().map(|&d| u8::from(d)).collect();
            for code in table.vertical.iter().chain(&table.horizontal) {
                errors.extend(code.to_le_bytes());
            }
            let flags = u8::from(entry.has_valid) | u8::from(entry.has_void) << 1;
            let sums = [heights, validity, errors].map(|bytes| {
                Sha256::digest(&bytes).iter().fold(String::new(), |mut hex, byte| {
                    write!(hex, "{byte:02x}").expect("a string");
                    hex
                })
            });
            writeln!(out, "{id} {} {flags} {}", entry.children, sums.join(" ")).expect("a string");
        }
    }
    out
}

fn python(path: &Path) -> String {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/spec_reader.py");
    let output = Command::new("python3").arg(script).arg(path).output();
    let output = output.expect("python3 runs: install python3 and its module zstandard, as ./test.sh does");
    let talk = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {talk}", path.display());
    String::from_utf8(output.stdout).expect("text")
}

/// A DEM with voids in every shape: `value(column, row)`, `None` is void.
fn dem(path: &Path, kind: SampleType, size: (u32, u32), value: impl Fn(u32, u32) -> Option<f64>) {
    dem_with(path, (kind, if kind.is_float() { -9999.0 } else { 77.0 }), size, value);
}

/// [`dem`] with a nodata value.
fn dem_with(
    path: &Path,
    (kind, nodata): (SampleType, f64),
    size: (u32, u32),
    value: impl Fn(u32, u32) -> Option<f64>,
) {
    let geo = Geo { transform: Some([10.0, 0.01, 0.002, 50.0, 0.001, -0.02]), ..Geo::default() };
    let mut spec = GeotiffSpec::new(size.0, size.1, kind, &geo);
    spec.nodata = Some(nodata);
    spec.force = true;
    let void = spec.nodata.unwrap_or(0.0);
    let mut writer = GeotiffWriter::create(path, &spec).expect("create");
    for row in 0..size.1 {
        let row = (0..size.0).map(|column| value(column, row).unwrap_or(void));
        let samples = match kind {
            SampleType::Int8 => Samples::Int8(row.map(|v| v as i8).collect()),
            SampleType::Uint8 => Samples::Uint8(row.map(|v| v as u8).collect()),
            SampleType::Int16 => Samples::Int16(row.map(|v| v as i16).collect()),
            SampleType::Uint16 => Samples::Uint16(row.map(|v| v as u16).collect()),
            SampleType::Int32 => Samples::Int32(row.map(|v| v as i32).collect()),
            SampleType::Uint32 => Samples::Uint32(row.map(|v| v as u32).collect()),
            SampleType::Float32 => Samples::Float32(row.map(|v| v as f32).collect()),
            SampleType::Float64 => Samples::Float64(row.collect()),
        };
        writer.write_rows(&samples).expect("write");
    }
    writer.finish().expect("finish");
}

#[test]
fn an_independent_reader_agrees() {
    let folder = tempfile::tempdir().expect("folder");
    let (tif, rlv) = (folder.path().join("dem.tif"), folder.path().join("dem.rlv"));
    let shape = |tile, patch| BuildOptions { tile, patch, ..BuildOptions::default() };
    let agree = |dem: &Path, options: &BuildOptions| {
        build(dem, &rlv, options);
        assert_eq!(python(&rlv), listing(&rlv), "{} with {options:?}", dem.display());
    };
    agree(&fixture("tiny_3x2.tif"), &shape(16, 4));
    agree(&fixture("rmnp_dem_uint16.tif"), &shape(32, 8));
    agree(&fixture("rmnp_dem_uint16.tif"), &BuildOptions { metric: Metric::Paper, ..shape(64, 64) });
    agree(&fixture("co_elevation_float32_lzw.tif"), &shape(256, 64));
    agree(
        &fixture("co_elevation_float32_lzw.tif"),
        &BuildOptions { precision_m: Some(0.01), ..shape(128, 16) },
    );
    for kind in SampleType::ALL {
        // Two decimals take the decimal transform in float32; a hash is noise to the predictor.
        let value = |x: u32, y: u32| {
            let hash = x.wrapping_mul(2_654_435_761).wrapping_add(y.wrapping_mul(40_503)) >> 9;
            let height = match kind {
                SampleType::Int8 | SampleType::Uint8 => f64::from(hash % 60),
                SampleType::Float32 => (f64::from(x * 31 + y * 17 + hash % 7) * 0.25 * 100.0).round() / 100.0,
                SampleType::Float64 => f64::from(hash) / 3.0,
                _ => f64::from(x * 5 + y * 3 + hash % 50),
            };
            let void = (x / 11 + y / 5).is_multiple_of(4) || hash.is_multiple_of(41);
            (!void).then_some(height)
        };
        dem(&tif, kind, (90, 70), value);
        agree(&tif, &shape(16, 4));
        agree(&tif, &shape(32, 32));
    }
    dem(&tif, SampleType::Int16, (1, 1), |_, _| Some(5.0));
    agree(&tif, &shape(16, 16));
}

/// The lowest and the highest sample of an integer type.
fn ends(kind: SampleType) -> Option<(f64, f64)> {
    let ends = |bits: u32, signed: bool| {
        let all = 2_f64.powi(bits as i32);
        if signed { (-all / 2.0, all / 2.0 - 1.0) } else { (0.0, all - 1.0) }
    };
    Some(match kind {
        SampleType::Int8 => ends(8, true),
        SampleType::Uint8 => ends(8, false),
        SampleType::Int16 => ends(16, true),
        SampleType::Uint16 => ends(16, false),
        SampleType::Int32 => ends(32, true),
        SampleType::Uint32 => ends(32, false),
        SampleType::Float32 | SampleType::Float64 => return None,
    })
}

/// Smooth heights with voids, near an end of the range of their type: predictions where there are
/// voids lie outside it. The independent reader heeds no hint of the format.
#[test]
fn an_independent_reader_agrees_at_the_ends_of_the_types() {
    let folder = tempfile::tempdir().expect("folder");
    let (tif, rlv) = (folder.path().join("dem.tif"), folder.path().join("dem.rlv"));
    for (kind, (low, high)) in SampleType::ALL.into_iter().filter_map(|kind| Some((kind, ends(kind)?))) {
        for at_top in [false, true] {
            let value = |x: u32, y: u32| {
                let hash = x.wrapping_mul(2_654_435_761).wrapping_add(y.wrapping_mul(2_246_822_519)) >> 8;
                let wave = 50.0 * (f64::from(x) / 9.0).sin() * (f64::from(y) / 13.0).cos();
                let away = (wave + f64::from(hash % 7)).max(0.0).round();
                (!hash.is_multiple_of(10)).then_some(if at_top { high - away } else { low + away })
            };
            dem_with(&tif, (kind, if at_top { low } else { high }), (120, 100), value);
            build(&tif, &rlv, &BuildOptions { tile: 16, patch: 4, ..BuildOptions::default() });
            assert_eq!(python(&rlv), listing(&rlv), "{kind:?}, {at_top}");
        }
    }
}
