//! Windows of a raster built apart and merged: the same bytes as one build, whatever the windows.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use proptest::prelude::*;
use relevo::Rect;
use relevo::geo::Geo;
use relevo::geotiff_write::{GeotiffSpec, GeotiffWriter};
use relevo::limits::Limits;
use relevo::pipeline::{self, BuildOptions, Silent, column_passes, memory};
use relevo::sample::SampleType;
use relevo::source::{self, Samples};

/// A GeoTIFF of hills with lakes of voids; `share` of 16 samples in the lakes' neighbourhood are
/// void.
fn dem(path: &Path, (width, height): (u32, u32), seed: u32, kind: SampleType) {
    let geo = Geo { transform: Some([7.0, 0.001, 0.0, 47.0, 0.0, -0.001]), ..Geo::default() };
    let mut spec = GeotiffSpec::new(width, height, kind, &geo);
    spec.nodata = Some(-9999.0);
    let mut writer = GeotiffWriter::create(path, &spec).expect("create");
    let lattice = |x: u32, y: u32| {
        let h = (x.wrapping_mul(0x9E37_79B9) ^ y.wrapping_mul(0x85EB_CA6B) ^ seed).wrapping_mul(0xC2B2_AE35);
        f64::from(h >> 16) / 65_536.0
    };
    let noise = |x: u32, y: u32, cell: u32| {
        let (i, j) = (x / cell, y / cell);
        let (u, v) = (f64::from(x % cell) / f64::from(cell), f64::from(y % cell) / f64::from(cell));
        let north = lattice(i, j) * (1.0 - u) + lattice(i + 1, j) * u;
        north * (1.0 - v) + (lattice(i, j + 1) * (1.0 - u) + lattice(i + 1, j + 1) * u) * v
    };
    for y in 0..height {
        let row = (0..width).map(|x| {
            let lake = noise(x, y, 37) + 0.3 * lattice(x, y) > 0.95;
            if lake { -9999.0 } else { 900.0 * noise(x, y, 61) + 90.0 * noise(x, y, 9) + 8.0 * lattice(x, y) }
        });
        let samples = match kind {
            SampleType::Float32 => Samples::Float32(row.map(|v| v as f32).collect()),
            SampleType::Float64 => Samples::Float64(row.collect()),
            _ => Samples::Int16(row.map(|v| v as i16).collect()),
        };
        writer.write_rows(&samples).expect("write");
    }
    writer.finish().expect("finish");
}

/// Cuts a rectangle of tiles in two, again and again, as the numbers say.
fn cut(all: Rect, cuts: &[u32]) -> Vec<Rect> {
    let mut pieces = vec![all];
    for &number in cuts {
        let piece = pieces.remove(number as usize % pieces.len());
        let Rect { columns, rows } = piece.clone();
        let number = number >> 8;
        let (wide, high) = (columns.len() as u32, rows.len() as u32);
        if number % 2 == 0 && wide > 1 {
            let at = columns.start + 1 + number / 2 % (wide - 1);
            pieces.push(Rect { columns: columns.start..at, rows: rows.clone() });
            pieces.push(Rect { columns: at..columns.end, rows });
        } else if high > 1 {
            let at = rows.start + 1 + number / 2 % (high - 1);
            pieces.push(Rect { columns: columns.clone(), rows: rows.start..at });
            pieces.push(Rect { columns, rows: at..rows.end });
        } else {
            pieces.push(piece);
        }
    }
    pieces
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn pieces_merge_to_the_bytes_of_one_build(
        size in (1_u32..420, 1_u32..420),
        seed: u32,
        cuts in prop::collection::vec(any::<u32>(), 0..9),
        patch in prop::sample::select(vec![4_u32, 8, 16]),
        kind in prop::sample::select(vec![SampleType::Int16, SampleType::Float32, SampleType::Float64]),
        precision in prop::option::of(0.3..3.0_f64),
        backwards: bool,
    ) {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("dem.tif");
        dem(&path, size, seed, kind);
        let source = source::open(&path, &Limits::default()).expect("open");
        let options = BuildOptions { tile: 16, patch, precision_m: precision, ..BuildOptions::default() };
        let whole = folder.path().join("whole.rlv");
        let built = pipeline::build(&*source, &whole, &options, &Silent);
        prop_assume!(built.is_ok());
        let plan = pipeline::plan(source.info(), &options).expect("plan");
        let windows = cut(plan.pyramid.leaves(), &cuts);
        let mut pieces: Vec<PathBuf> = Vec::new();
        for (i, window) in windows.iter().enumerate() {
            let piece = folder.path().join(format!("piece-{i}"));
            pipeline::build_window(&*source, &piece, window, &options, &Silent).expect("piece");
            pieces.push(piece);
        }
        if backwards {
            pieces.reverse();
        }
        let merged = folder.path().join("merged.rlv");
        pipeline::merge(&pieces, &merged, None, false, &Silent).expect("merge");
        prop_assert_eq!(fs::read(&merged).expect("merged"), fs::read(&whole).expect("whole"), "{:?}", windows);
    }
}

fn relevo(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_relevo")).args(args).output().expect("the binary runs")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("utf-8 path")
}

/// Exit code 2 and one line with all of `words`.
fn fails(output: &Output, words: &[&str]) {
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    for word in words {
        assert!(message.contains(word), "{word:?} is not in {message:?}");
    }
}

#[test]
fn the_command_line_builds_windows_of_a_real_dem_and_merges_them() {
    let folder = tempfile::tempdir().expect("folder");
    let at = |name: &str| folder.path().join(name);
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem/co_elevation_float32_lzw.tif");
    let build = |out: &Path, more: &[&str]| {
        let args =
            [&["build", text(&source), "-o", text(out), "--tile", "64", "--progress", "none"], more].concat();
        relevo(&args)
    };
    assert!(build(&at("whole.rlv"), &[]).status.success());
    for (name, window) in [("nw", "0,0,5,3"), ("ne", "5,0,16,3"), ("s", "0,3,16,10")] {
        let built = build(&at(name), &["--window", window]);
        assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    }
    let (nw, ne, s, out) = (at("nw"), at("ne"), at("s"), at("merged.rlv"));
    let [nw, ne, s, out] = [&nw, &ne, &s, &out].map(|path| text(path));
    assert!(relevo(&["merge", ne, s, nw, "-o", out]).status.success());
    assert_eq!(fs::read(out).expect("merged"), fs::read(at("whole.rlv")).expect("whole"));

    fails(&relevo(&["merge", ne, s, nw, "-o", out]), &["merged.rlv", "--force"]);
    fails(&relevo(&["merge", ne, nw, "-o", out, "--force"]), &["no piece has leaf tile 0/3", "0,0,16,10"]);
    fails(&relevo(&["merge", ne, nw, s, nw, "-o", out, "--force"]), &["both have the tiles 0,0,5,3"]);
    // A folder that is no piece; the output in it is not touched.
    fails(&relevo(&["merge", text(folder.path()), "-o", out, "--force"]), &["input and output are the same"]);
    let (empty, aside) = (at("empty"), at("aside.rlv"));
    fs::create_dir(&empty).expect("folder");
    fails(&relevo(&["merge", text(&empty), "-o", text(&aside), "--force"]), &["state"]);
    let other = at("other");
    assert!(build(&other, &["--window", "5,0,16,3", "--patch", "16"]).status.success());
    fails(&relevo(&["merge", nw, text(&other), s, "-o", out, "--force"]), &["--patch was 32, now it is 16"]);
    fails(&build(&at("none"), &["--window", "0,0,17,10"]), &["--window 0,0,17,10", "0,0,16,10"]);
    fails(&build(&at("nw"), &["--window", "0,0,5,3"]), &["nw", "--force"]);
    assert!(build(&at("nw"), &["--window", "0,0,5,3", "--force"]).status.success());
    assert!(relevo(&["merge", ne, s, nw, "-o", out, "--force"]).status.success());

    // A piece that has been damaged or cut.
    let tiles = at("s").join("level-04");
    let bytes = fs::read(&tiles).expect("level file");
    fs::write(&tiles, &bytes[..bytes.len() - 1]).expect("write");
    fails(&relevo(&["merge", ne, s, nw, "-o", out, "--force"]), &["level-04"]);
    let mut wrong = bytes.clone();
    wrong[100] ^= 1;
    fs::write(&tiles, &wrong).expect("write");
    fails(&relevo(&["merge", ne, s, nw, "-o", out, "--force"]), &["merged.rlv", "other bytes"]);
    fs::write(&tiles, &bytes).expect("write");
    let state = at("s").join("state");
    let mut wrong = fs::read(&state).expect("state");
    let last = wrong.len() - 1;
    wrong[30] ^= 4;
    fs::write(&state, &wrong).expect("write");
    fails(&relevo(&["merge", ne, s, nw, "-o", out, "--force"]), &["state", "damaged"]);
    wrong[30] ^= 4;
    fs::write(&state, &wrong[..last]).expect("write");
    let cut = relevo(&["merge", ne, s, nw, "-o", out, "--force"]);
    // The standing items of a finished window may be none; then nothing was cut off that matters.
    assert!(matches!(cut.status.code(), Some(0 | 2)));
    let left: Vec<_> =
        fs::read_dir(folder.path()).expect("folder").flatten().map(|e| e.file_name()).collect();
    assert!(!left.iter().any(|name| name.to_string_lossy().ends_with(".work")), "{left:?}");
}

#[test]
fn a_limit_of_memory_changes_no_byte() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("dem.tif");
    dem(&path, (700, 300), 5, SampleType::Int16);
    let source = source::open(&path, &Limits::default()).expect("open");
    let options = BuildOptions { tile: 16, patch: 8, jobs: Some(2), ..BuildOptions::default() };
    let plan = pipeline::plan(source.info(), &options).expect("plan");
    let whole = folder.path().join("whole.rlv");
    pipeline::build(&*source, &whole, &options, &Silent).expect("build");
    // Wherever so many columns lie.
    let memory = |columns: u32| (0..=44 - columns).map(|x| memory::estimate(&plan, &(x..x + columns))).max();
    for columns in [17, 28, 40] {
        let memory = memory(columns);
        let strips = column_passes::windows(&plan, memory).expect("strips");
        // A strip is read with a column on either side; the raster has none beyond its own.
        assert!(strips.len() > 1 && strips.iter().all(|strip| strip.columns.len() < columns as usize));
        let limited = folder.path().join("limited.rlv");
        let options = BuildOptions { memory, force: true, ..options.clone() };
        pipeline::build(&*source, &limited, &options, &Silent).expect("build");
        assert_eq!(fs::read(&limited).expect("limited"), fs::read(&whole).expect("whole"), "{columns}");
    }
    assert_eq!(column_passes::windows(&plan, memory(44)).expect("one").len(), 1);
    // Narrow strips leave everything above them to be joined at once.
    let refused = column_passes::windows(&plan, memory(3)).expect_err("too little to join").to_string();
    assert!(refused.contains("joining the strips"), "{refused}");
    let refused = column_passes::windows(&plan, memory(1)).expect_err("too little").to_string();
    assert!(refused.contains("`memory`") && refused.contains("16 x 16"), "{refused}");
}
