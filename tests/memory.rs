//! Does a build keep within what `--dry-run` says, and within `--memory`?

#![cfg(target_os = "linux")]
#![expect(clippy::expect_used, reason = "a test that cannot go on says why")]

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use relevo::geo::Geo;
use relevo::geotiff_write::{Compression, GeotiffSpec, GeotiffWriter};
use relevo::sample::SampleType;
use relevo::source::Samples;

const WIDTH: u32 = 8193;
const HEIGHT: u32 = 1100;
/// GDAL and the libraries that it needs, as soon as the program is started: they are not in the estimate.
const LIBRARIES: u64 = if cfg!(feature = "gdal") { 48 << 20 } else { 0 };

/// Rough terrain, wide, with voids of all sizes.
fn dem(path: &Path) {
    let geo = Geo::default();
    let mut spec = GeotiffSpec::new(WIDTH, HEIGHT, SampleType::Float32, &geo);
    spec.nodata = Some(-9999.0);
    spec.compression = Compression::None;
    let mut writer = GeotiffWriter::create(path, &spec).expect("create");
    let mut random = 1_u64;
    for y in 0..HEIGHT {
        let row = (0..WIDTH).map(|x| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let (noise, patch) = ((random >> 40) as f32 / 16_777_216.0, (x / 90 + 7 * (y / 70)) % 9 == 0);
            if noise < 0.02 || patch { -9999.0 } else { 40.0 * (x as f32 / 300.0).sin() + 10.0 * noise }
        });
        writer.write_rows(&Samples::Float32(row.collect())).expect("rows");
    }
    writer.finish().expect("dem");
}

fn relevo(folder: &Path, options: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relevo"));
    command.arg("build").arg(folder.join("dem.tif")).arg("-o").arg(folder.join("out.rlv")).args(options);
    command
}

/// Bytes that a build is to take at most.
fn estimate(folder: &Path, options: &[&str]) -> u64 {
    let told = relevo(folder, options).args(["--dry-run", "--json"]).output().expect("the binary runs");
    let told: serde_json::Value = serde_json::from_slice(&told.stdout).expect("JSON");
    told["memory_bytes"].as_u64().expect("a number")
}

/// Bytes that it took, as the system counts them as long as it runs.
fn peak(folder: &Path, options: &[&str]) -> u64 {
    let mut command = relevo(folder, options);
    let mut child =
        command.args(["--force", "--progress", "none"]).stdout(Stdio::null()).spawn().expect("runs");
    let mut peak = 0;
    let status = loop {
        let status = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kilobytes = line.and_then(|line| line.trim().strip_suffix(" kB")?.parse().ok());
        peak = kilobytes.map_or(peak, |kilobytes: u64| kilobytes << 10);
        if let Some(status) = child.try_wait().expect("wait") {
            break status;
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    assert!(status.success(), "{options:?}");
    peak
}

#[test]
fn builds_keep_within_the_estimate() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    dem(&folder.join("dem.tif"));
    for options in [
        &["--jobs", "6"][..],
        &["--jobs", "6", "--patch", "4"],
        &["--jobs", "3", "--tile", "32", "--patch", "16"],
        &["--jobs", "2", "--tile", "64", "--patch", "8", "--checkpoint", "0"],
        &["--jobs", "2", "--memory", "140MiB"],
    ] {
        let (most, took) = (estimate(folder, options), peak(folder, options));
        assert!(took > 0 && took <= most + LIBRARIES, "{options:?}: {took} bytes, {most} were to be enough");
        assert!(!options.contains(&"140MiB") || most <= 140 << 20, "{most}");
    }
}

/// Columns and rows of the picture.
const PICTURE: u32 = 5000;

/// A DEM of 500 x 500, and a picture of strips over it.
fn dem_and_picture(folder: &Path) {
    let geo = |step: f64| Geo { transform: Some([0.0, step, 0.0, 0.0, 0.0, -step]), ..Geo::default() };
    let heights = geo(10.0);
    let spec = GeotiffSpec::new(500, 500, SampleType::Int16, &heights);
    let mut writer = GeotiffWriter::create(folder.join("dem.tif"), &spec).expect("create");
    let samples = (0..500 * 500).map(|i| (i % 977) as i16);
    writer.write_rows(&Samples::Int16(samples.collect())).expect("rows");
    writer.finish().expect("dem");
    let pixels = geo(1.0);
    let mut spec = GeotiffSpec::new(PICTURE, PICTURE, SampleType::Uint8, &pixels);
    (spec.bands, spec.compression) = (3, Compression::None);
    let mut writer = GeotiffWriter::create(folder.join("picture.tif"), &spec).expect("create");
    for y in 0..PICTURE {
        let row = (0..3 * PICTURE).map(|i| ((i / 7) ^ (y / 9)) as u8);
        writer.write_rows(&Samples::Uint8(row.collect())).expect("rows");
    }
    writer.finish().expect("picture");
}

#[test]
fn imagery_keeps_within_the_estimate() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    dem_and_picture(folder);
    let picture = folder.join("picture.tif");
    let picture = picture.to_str().expect("a name");
    let imagery = ["--imagery", picture, "--imagery-tile", "128", "--jobs", "2"];
    let limited = |limit| [&imagery[..], &["--memory", limit]].concat();
    let (most, took) = (estimate(folder, &imagery), peak(folder, &imagery));
    assert!(took > 0 && took <= most + LIBRARIES, "{took} bytes, {most} were to be enough");
    assert_eq!(estimate(folder, &limited("64GiB")), most);
    let file = fs::read(folder.join("out.rlv")).expect("file");
    let (least, took) = (estimate(folder, &limited("90MiB")), peak(folder, &limited("90MiB")));
    assert!(most > 90 << 20 && least <= 90 << 20, "{most}, {least}");
    assert!(took <= (90 << 20) + LIBRARIES, "{took} bytes of 90 MiB");
    assert!(fs::read(folder.join("out.rlv")).expect("file") == file, "what pictures keep shows");
    let refused = relevo(folder, &limited("30MiB")).arg("--force").output().expect("the binary runs");
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(refused.status.code() == Some(2) && said.contains("--imagery-tile"), "{said}");
    let added = ["add", "out.rlv", "--imagery", picture, "--memory", "30MiB"];
    let added = Command::new(env!("CARGO_BIN_EXE_relevo")).args(added).current_dir(folder).output();
    assert_eq!(added.expect("the binary runs").status.code(), Some(2));
    assert!(fs::read(folder.join("out.rlv")).expect("file") == file);
}
