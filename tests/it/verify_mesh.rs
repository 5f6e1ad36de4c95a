//! `relevo verify MESH`: any mesh against a DEM or a file, in every frame.

use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use relevo::geo::{Crs, CrsKind, Geo};
use relevo::geotiff_write::{GeotiffSpec, GeotiffWriter};
use relevo::sample::SampleType;
use relevo::source::Samples;
use serde_json::Value;

const COLUMNS: u32 = 9;
const ROWS: u32 = 6;

fn height(column: u32, row: u32) -> i16 {
    ((column * 7 + row * row * 3 + column * row) % 23) as i16
}

/// Writes `dem.tif`, in metres and 10 m from sample to sample, and `dem.rlv`.
fn terrain(folder: &Path) {
    let crs = Crs { kind: CrsKind::Projected, epsg: Some(32611), ..Crs::default() };
    let transform = Some([500_000.0, 10.0, 0.0, 4_000_000.0, 0.0, -10.0]);
    let geo = Geo { transform, crs, ..Geo::default() };
    let spec = GeotiffSpec::new(COLUMNS, ROWS, SampleType::Int16, &geo);
    let mut writer = GeotiffWriter::create(folder.join("dem.tif"), &spec).unwrap();
    let samples = (0..ROWS).flat_map(|row| (0..COLUMNS).map(move |column| height(column, row))).collect();
    writer.write_rows(&Samples::Int16(samples)).unwrap();
    writer.finish().unwrap();
    assert!(relevo(folder, &["build", "dem.tif", "--tile", "16", "--patch", "4", "-q"]).status.success());
}

/// Writes a mesh of all samples, its cells cut as the terrain's, or all in one way; `place` gives
/// the coordinates of a sample, in which rows run north or south.
fn mesh(
    path: &Path,
    comment: &str,
    is_exact: bool,
    runs_south: bool,
    place: impl Fn(u32, u32, f64) -> [f64; 3],
) {
    let (cells, vertices) = ((COLUMNS - 1) * (ROWS - 1), COLUMNS * ROWS);
    let mut text = format!("ply\nformat ascii 1.0\n{comment}element vertex {vertices}\n");
    text += "property double x\nproperty double y\nproperty double z\n";
    write!(text, "element face {}\nproperty list uchar int vertex_indices\nend_header\n", 2 * cells).unwrap();
    for (column, row) in (0..ROWS).flat_map(|row| (0..COLUMNS).map(move |column| (column, row))) {
        let [x, y, z] = place(column, row, f64::from(height(column, row)));
        writeln!(text, "{x} {y} {z}").unwrap();
    }
    for (column, row) in (0..ROWS - 1).flat_map(|row| (0..COLUMNS - 1).map(move |column| (column, row))) {
        let nw = row * COLUMNS + column;
        let (ne, sw, se) = (nw + 1, nw + COLUMNS, nw + COLUMNS + 1);
        let is_falling = !is_exact || (column + row) % 2 == 0;
        for [a, b, c] in if is_falling { [[nw, sw, se], [nw, se, ne]] } else { [[nw, sw, ne], [ne, sw, se]] }
        {
            let [b, c] = if runs_south { [c, b] } else { [b, c] };
            writeln!(text, "3 {a} {b} {c}").unwrap();
        }
    }
    fs::write(path, text).unwrap();
}

fn relevo(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_relevo")).current_dir(folder).args(args).output().unwrap()
}

fn json(folder: &Path, code: i32, args: &[&str]) -> Value {
    let output = relevo(folder, &[args, &["--json"]].concat());
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(
        output.status.code(),
        Some(code),
        "{args:?}: {told}{}",
        String::from_utf8_lossy(&output.stdout)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

/// The largest distance in the middle of a cell that is cut the wrong way.
fn wrong_cuts() -> f64 {
    let of = |column: u32, row: u32| {
        let [a, b, c, d] =
            [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| f64::from(height(column + x, row + y)));
        (a - b - c + d).abs() / 2.0
    };
    let cells = (0..ROWS - 1).flat_map(|row| (0..COLUMNS - 1).map(move |column| (column, row)));
    cells
        .filter(|(column, row)| (column + row) % 2 == 1)
        .map(|(column, row)| of(column, row))
        .fold(0.0, f64::max)
}

#[test]
fn meshes_in_every_frame_are_held_against_dem_and_file() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    terrain(at);
    let [dx, dy] = [10.0, 10.0];
    let local = r#"comment relevo {"relevo":{"frame":"local","to_frame":{"matrix":[[10,0,0],[0,-10,0],[0,0,1]],"offset":[-40,25,-7]},"window":[0,0,9,6],"max_error_m":0.5,"solid":false}}"#;
    let pixel = |column: u32, row: u32, z: f64| [f64::from(column), f64::from(row), 2.5 * z];
    let north = |column: u32, row: u32, z: f64| [f64::from(column), f64::from(ROWS - 1 - row), z];
    let metres =
        |column: u32, row: u32, z: f64| [dx * f64::from(column) - 40.0, 25.0 - dy * f64::from(row), z - 7.0];
    let crs = |column: u32, row: u32, z: f64| {
        [500_005.0 + dx * f64::from(column), 3_999_995.0 - dy * f64::from(row), z]
    };
    let wrong = wrong_cuts();
    assert!(wrong > 5.0);
    for is_exact in [true, false] {
        mesh(&at.join("pixel.ply"), "", is_exact, true, pixel);
        mesh(&at.join("north.ply"), "", is_exact, false, north);
        mesh(&at.join("crs.ply"), "", is_exact, false, crs);
        mesh(&at.join("local.ply"), &format!("{local}\n"), is_exact, false, metres);
        for source in ["dem.tif", "dem.rlv"] {
            for options in [
                &["pixel.ply", "--frame", "pixel", "--z-scale", "2.5", "--max-error", "0.5m"][..],
                &["north.ply", "--frame", "pixel-north", "--max-error", "0.5"],
                &["crs.ply", "--frame", "crs", "--max-error", "0.5m"],
                &["local.ply"],
                &["local.ply", "--frame", "local", "--max-error", "0.5m"],
            ] {
                let args = [&["verify"], options, &["--source", source]].concat();
                let told = json(at, i32::from(!is_exact), &args);
                let largest = told["largest_m"].as_f64().unwrap();
                assert!((largest - if is_exact { 0.0 } else { wrong }).abs() < 1e-9, "{args:?}: {told}");
                assert_eq!((&told["uncovered_samples"], &told["samples"]), (&0.into(), &54.into()), "{told}");
                assert_eq!(
                    (&told["flipped_triangles"], &told["promised_m"]),
                    (&0.into(), &0.5.into()),
                    "{told}"
                );
                assert!(told["largest_at_samples_m"].as_f64().unwrap() < 1e-9, "{told}");
                assert_eq!(told["good"], is_exact, "{told}");
            }
        }
    }
}

#[test]
fn what_is_printed_says_where() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    terrain(at);
    mesh(&at.join("a.ply"), "", true, false, |column, row, z| {
        let off = if (column, row) == (4, 2) { 3.0 } else { 0.0 };
        [f64::from(column), f64::from(ROWS - 1 - row), z + off]
    });
    let args = ["verify", "a.ply", "--source", "dem.rlv", "--frame", "pixel-north"];
    let output = relevo(at, &args);
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{told}");
    assert!(
        told.contains("column 4, row 2, which is 500045, 3999975 in") && told.contains("nothing is promised"),
        "{told}"
    );
    assert!(told.lines().all(|line| line.chars().count() <= 80), "{told}");
    let output = relevo(at, &[&args[..], &["--max-error", "2m"]].concat());
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.code() == Some(1) && told.contains("than it promises"), "{told}");
    let part = json(at, 0, &[&args[..], &["--srcwin", "5,0,4,6", "--max-error", "3m"]].concat());
    assert_eq!(part["window"], serde_json::json!([5, 0, 4, 6]), "{part}");
    assert_eq!((&part["largest_m"], &part["outside_triangles"]), (&0.0.into(), &50.into()), "{part}");
}

#[test]
fn requests_that_make_no_sense_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    terrain(at);
    mesh(&at.join("a.ply"), "", true, false, |column, row, z| [f64::from(column), f64::from(row), z]);
    for (args, words) in [
        (&["a.ply"][..], "give the DEM"),
        (&["a.ply", "--source", "dem.tif"], "give --frame crs"),
        (&["a.ply", "--source", "dem.tif", "dem.rlv", "--frame", "pixel"], "must be the only"),
        (&["a.ply", "--source", "dem.rlv", "--nodata", "3", "--frame", "pixel"], "--nodata is for reading"),
        (&["a.ply", "--source", "dem.tif", "--frame", "pixel", "--deep"], "--deep is for"),
        (&["a.ply", "--source", "dem.tif", "--frame", "pixel", "--srcwin", "5,0,9,9"], "does not lie within"),
        (&["a.ply", "--source", "dem.tif", "--frame", "crs"], "another frame"),
        (&["a.ply", "--source", "dem.tif", "--frame", "east"], "expected local"),
        (&["a.ply", "--source", "dem.tif", "--max-error", "much"], "expected a length"),
        (&["dem.rlv", "--frame", "pixel"], "--frame is for a mesh"),
        (&["none.ply", "--source", "dem.tif", "--frame", "pixel"], "none.ply"),
    ] {
        let output = relevo(at, &[&["verify"], args].concat());
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && told.contains(words), "{args:?}: {told}");
    }
}
