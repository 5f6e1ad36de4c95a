//! Does a build keep within what `--dry-run` says, and within `--memory`?

#![cfg(target_os = "linux")]

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use relevo::geo::Geo;
use relevo::geotiff_write::{Compression, GeotiffSpec, GeotiffWriter};
use relevo::limits::Limits;
use relevo::sample::SampleType;
use relevo::source::{self, Samples};

const WIDTH: u32 = 8193;
const HEIGHT: u32 = 1100;
/// GDAL and the libraries that it needs, as soon as the program is started: they are not in the
/// estimate.
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
    let (good, took, said) = watch(command.args(["--force", "--progress", "none"]));
    assert!(good, "{options:?}: {said}");
    took
}

/// Runs a command: true if it does its work (a check may find problems), the bytes that it took,
/// and what it says of errors.
fn watch(command: &mut Command) -> (bool, u64, String) {
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("runs");
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
    let mut said = String::new();
    child.stderr.take().expect("piped").read_to_string(&mut said).expect("text");
    (status.code().is_some_and(|code| code < 2), peak, said)
}

/// The first number of MiB that a message tells of: what is needed.
fn figure(said: &str) -> Option<u64> {
    said.split(" MiB").next()?.rsplit(' ').next()?.parse().ok()
}

/// The program in a folder.
fn program(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relevo"));
    command.args(arguments).current_dir(folder);
    command
}

/// Refuses a command with too little memory, then gives it what the refusal asks for: it must keep
/// to that. MiB that it was given.
fn keeps_to_what_it_asks_for(folder: &Path, arguments: &[&str]) -> u64 {
    let mut limit = 1;
    for _ in 0..6 {
        let memory = format!("{limit}MiB");
        let before = Instant::now();
        let (good, took, said) = watch(program(folder, arguments).args(["--memory", &memory]));
        if good {
            assert!(limit > 1, "{arguments:?}: one MiB cannot be enough");
            let most = (limit << 20) + LIBRARIES;
            assert!(took > 0 && took <= most, "{arguments:?}: {} MiB of {limit}", took >> 20);
            eprintln!("{arguments:?}: {} MiB of {limit}, {:.1?}", took >> 20, before.elapsed());
            return limit;
        }
        limit = figure(&said).unwrap_or_else(|| panic!("{arguments:?} with {memory}: {said}"));
    }
    panic!("{arguments:?}: what it asks for is not enough")
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

/// Terrain in blocks as wide as may be: a strip of the whole raster (`None`), or tiles of a side.
fn wide_blocks(path: &Path, (width, height): (u32, u32), side: Option<u32>) {
    let sample = |x: u32, y: u32| ((x / 7) ^ (y / 5)) as i16 + (x * y % 23) as i16;
    let Some(side) = side else {
        let file = std::io::BufWriter::new(fs::File::create(path).expect("file"));
        let packed = tiff::encoder::Compression::Deflate(tiff::encoder::DeflateLevel::Fast);
        let mut encoder = tiff::encoder::TiffEncoder::new(file).expect("header").with_compression(packed);
        let mut image = encoder.new_image::<tiff::encoder::colortype::GrayI16>(width, height).expect("image");
        image.rows_per_strip(height).expect("strips");
        let samples: Vec<i16> = (0..height).flat_map(|y| (0..width).map(move |x| sample(x, y))).collect();
        return image.write_data(&samples).expect("samples");
    };
    let place = geo(1.0);
    let mut spec = GeotiffSpec::new(width, height, SampleType::Int16, &place);
    (spec.tile, spec.compression, spec.force) = (Some(side), Compression::Zstd, true);
    let mut writer = GeotiffWriter::create(path, &spec).expect("create");
    for y in 0..height {
        writer.write_rows(&Samples::Int16((0..width).map(|x| sample(x, y)).collect())).expect("rows");
    }
    writer.finish().expect("dem");
}

/// The least limit in MiB that is not refused: a refusal says what is needed.
fn least_limit(folder: &Path, options: &[&str]) -> u64 {
    let mut limit = 1;
    for _ in 0..9 {
        let told = relevo(folder, options).args(["--memory", &format!("{limit}MiB"), "--dry-run"]).output();
        let told = told.expect("the binary runs");
        if told.status.success() {
            return limit;
        }
        let said = String::from_utf8_lossy(&told.stderr).into_owned();
        limit = figure(&said).unwrap_or_else(|| panic!("{said}"));
    }
    limit
}

#[test]
fn wide_blocks_are_counted() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    for (size, side) in [((6000, 2000), None), ((6000, 2000), Some(2048)), ((600, 9000), Some(2048))] {
        wide_blocks(&folder.join("dem.tif"), size, side);
        for jobs in ["1", "4"] {
            let options = ["--jobs", jobs, "--tile", "128"];
            let (most, took) = (estimate(folder, &options), peak(folder, &options));
            assert!(took > 0 && took <= most + LIBRARIES, "{side:?}, {jobs} jobs: {took} of {most}");
            let least = least_limit(folder, &options);
            let limit = format!("{least}MiB");
            let took = peak(folder, &[&options[..], &["--memory", &limit]].concat());
            assert!(took <= (least << 20) + LIBRARIES, "{side:?}, {jobs} jobs: {took} of {limit}");
        }
    }
}

/// Columns and rows of the picture.
const PICTURE: u32 = 5000;

/// A georeference with its origin in the corner.
fn geo(step: f64) -> Geo {
    Geo { transform: Some([0.0, step, 0.0, 0.0, 0.0, -step]), ..Geo::default() }
}

/// A DEM of 500 x 500.
fn small_dem(folder: &Path) {
    let heights = geo(10.0);
    let spec = GeotiffSpec::new(500, 500, SampleType::Int16, &heights);
    let mut writer = GeotiffWriter::create(folder.join("dem.tif"), &spec).expect("create");
    let samples = (0..500 * 500).map(|i| (i % 977) as i16);
    writer.write_rows(&Samples::Int16(samples.collect())).expect("rows");
    writer.finish().expect("dem");
}

/// The same, and a picture of strips over it.
fn dem_and_picture(folder: &Path) {
    small_dem(folder);
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

/// Rasters whose shape takes memory.
const SHAPES: [(&str, (u32, u32), Option<u32>); 3] =
    [("blocks", (5000, 1200), Some(2048)), ("strip", (3000, 2000), None), ("wide", (24_000, 300), Some(64))];

/// A folder with these rasters, and what is built of them: `blocks.tif`, `blocks.rlv`, and so on.
/// Tests that run as processes of one runner make it once.
fn built() -> PathBuf {
    static READY: OnceLock<PathBuf> = OnceLock::new();
    let make = || {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("memory");
        fs::create_dir_all(&folder).expect("folder");
        let lock = fs::File::create(folder.join("lock")).expect("lock");
        lock.lock().expect("lock");
        let (done, runner) = (folder.join("made-by"), std::os::unix::process::parent_id().to_string());
        if fs::read_to_string(&done).is_ok_and(|by| by == runner) {
            return folder;
        }
        for (name, size, side) in SHAPES {
            let dem = format!("{name}.tif");
            wide_blocks(&folder.join(&dem), size, side);
            let made = program(&folder, &["build", &dem, "--tile", "128", "--force", "--quiet"]).status();
            assert!(made.expect("runs").success(), "{name}");
        }
        fs::write(done, runner).expect("mark");
        folder
    };
    READY.get_or_init(make).clone()
}

/// A lattice of 2^24 x 2^24 samples with few tiles.
fn sparse() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/failing/rlv-sparse-2p24.rlv");
    path.to_str().expect("a name").to_owned()
}

#[test]
fn a_check_keeps_within_its_limit() {
    let folder = built();
    for (name, _, _) in SHAPES {
        let (file, dem) = (format!("{name}.rlv"), format!("{name}.tif"));
        let alone = keeps_to_what_it_asks_for(&folder, &["verify", &file]);
        let with_source = keeps_to_what_it_asks_for(&folder, &["verify", &file, "--source", &dem]);
        assert!(alone <= with_source, "{name}");
    }
    wide_blocks(&folder.join("deep.tif"), (900, 700), Some(256));
    let made = program(&folder, &["build", "deep.tif", "--force", "--quiet"]).status();
    assert!(made.expect("runs").success());
    keeps_to_what_it_asks_for(&folder, &["verify", "deep.rlv", "--deep"]);
    keeps_to_what_it_asks_for(&folder, &["verify", &sparse()]);
}

#[test]
fn an_export_keeps_within_its_limit() {
    let folder = built();
    let samples = |path: &Path| {
        let source = source::open(path, &Limits::default()).expect("a raster");
        let (width, height) = (source.info().width, source.info().height);
        source.read_window(0..width, 0..height).expect("samples").samples
    };
    for (name, _, _) in SHAPES {
        let (file, out) = (format!("{name}.rlv"), format!("{name}-out.tif"));
        keeps_to_what_it_asks_for(&folder, &["export", &file, "-o", &out, "--force"]);
        assert!(samples(&folder.join(format!("{name}.tif"))) == samples(&folder.join(&out)), "{name}");
    }
    let part = ["export", "wide.rlv", "-o", "part.tif", "--force", "--bbox", "100,-290,23000,-10"];
    keeps_to_what_it_asks_for(&folder, &part);
    for picture in [&["-l", "2"][..], &["-t", "3/1/0"]] {
        let arguments = [&["export", "blocks.rlv", "-o", "out.png", "--force"], picture].concat();
        keeps_to_what_it_asks_for(&folder, &arguments);
    }
    keeps_to_what_it_asks_for(
        &folder,
        &["export", &sparse(), "-o", "sparse.tif", "--force", "--compress", "zstd"],
    );
    fs::remove_file(folder.join("sparse.tif")).expect("written");
}

#[test]
fn a_merge_keeps_within_its_limit() {
    let folder = built();
    let size = ["--tile", "128", "--force", "--quiet"];
    for (name, windows) in [("wide", ["0,0,90,3", "90,0,188,3"]), ("blocks", ["0,0,40,5", "0,5,40,10"])] {
        let dem = format!("{name}.tif");
        let pieces = [format!("{name}-a"), format!("{name}-b")];
        for (piece, window) in pieces.iter().zip(windows) {
            let arguments = [&["build", &dem, "-o", piece, "--window", window], &size[..]].concat();
            assert!(program(&folder, &arguments).status().expect("runs").success(), "{arguments:?}");
        }
        let out = format!("{name}-merged.rlv");
        let arguments = ["merge", &pieces[0], &pieces[1], "-o", &out, "--force"];
        keeps_to_what_it_asks_for(&folder, &arguments);
        let same = fs::read(folder.join(&out)).expect("merged")
            == fs::read(folder.join(format!("{name}.rlv"))).expect("built");
        assert!(same, "{name}");
    }
}

/// Bytes of a picture of red, green and blue.
fn colours(side: u32) -> impl Iterator<Item = u8> {
    (0..side).flat_map(move |y| (0..3 * side).map(move |i| ((i / 7) ^ (y / 9)) as u8))
}

/// A picture of one strip, in bytes or in 16 bits.
fn one_strip(path: &Path, side: u32, wide: bool) {
    let file = std::io::BufWriter::new(fs::File::create(path).expect("file"));
    let packed = tiff::encoder::Compression::Deflate(tiff::encoder::DeflateLevel::Fast);
    let mut encoder = tiff::encoder::TiffEncoder::new(file).expect("header").with_compression(packed);
    if wide {
        let mut image = encoder.new_image::<tiff::encoder::colortype::RGB16>(side, side).expect("image");
        image.rows_per_strip(side).expect("strips");
        let samples: Vec<u16> = colours(side).map(|byte| u16::from(byte) * 200).collect();
        image.write_data(&samples).expect("samples");
    } else {
        let mut image = encoder.new_image::<tiff::encoder::colortype::RGB8>(side, side).expect("image");
        image.rows_per_strip(side).expect("strips");
        image.write_data(&colours(side).collect::<Vec<u8>>()).expect("samples");
    }
    fs::write(path.with_extension("tfw"), "2.5\n0\n0\n-2.5\n1.25\n-1.25\n").expect("place");
}

#[test]
fn adding_pictures_of_wide_blocks_keeps_within_its_limit() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    small_dem(folder);
    assert!(relevo(folder, &["--quiet"]).status().expect("runs").success());
    let pixels = geo(2.5);
    let mut spec = GeotiffSpec::new(2000, 2000, SampleType::Uint8, &pixels);
    (spec.bands, spec.tile, spec.compression) = (3, Some(2048), Compression::Deflate);
    let mut writer = GeotiffWriter::create(folder.join("tiled.tif"), &spec).expect("create");
    writer.write_rows(&Samples::Uint8(colours(2000).collect())).expect("rows");
    writer.finish().expect("tiled");
    one_strip(&folder.join("strip.tif"), 2000, false);
    one_strip(&folder.join("strip16.tif"), 2000, true);
    for name in ["tiled.tif", "strip.tif", "strip16.tif"] {
        for jobs in ["1", "3"] {
            let arguments = ["add", "out.rlv", "--imagery", name, "--imagery-tile", "128", "--jobs", jobs];
            keeps_to_what_it_asks_for(folder, &arguments);
        }
    }
}
