//! What people read: every page fits 80 columns, says what is wrong in words, and is as loud as it
//! was asked to be.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use relevo::geo::Geo;
use relevo::geotiff_write::{GeotiffSpec, GeotiffWriter};
use relevo::sample::SampleType;
use relevo::source::Samples;

/// Columns of a page that nobody says the width of.
const PAGE: usize = 80;
const COMMANDS: [&str; 8] = ["build", "merge", "mesh", "add", "info", "stats", "verify", "export"];

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

fn relevo(folder: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relevo"));
    command.current_dir(folder).env_remove("NO_COLOR").args(args).output().expect("the binary runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs a command that is to end well, or to find problems; what it prints.
fn page(folder: &Path, args: &[&str]) -> String {
    let output = relevo(folder, args);
    assert!(output.status.code().is_some_and(|code| code < 2), "{args:?}: {}", text(&output.stderr));
    let out = text(&output.stdout);
    for line in out.lines() {
        assert!(line.chars().count() <= PAGE, "{args:?}: {} columns\n{line}\n\n{out}", line.chars().count());
    }
    out
}

/// DEMs of several kinds by short names: floats and integers, voids, in degrees and metres, small
/// and with many tiles.
fn dems(folder: &Path) -> Vec<String> {
    let mut names = Vec::new();
    for entry in fs::read_dir(fixture("dem")).expect("fixtures") {
        let path = entry.expect("entry").path();
        if path.extension().is_some_and(|extension| extension == "tif") {
            let name = path.file_name().expect("a name").to_string_lossy().into_owned();
            fs::copy(&path, folder.join(&name)).expect("copy");
            names.push(name);
        }
    }
    assert!(names.len() >= 2, "{names:?}");
    // Large numbers in every cell: steep, full of voids, in feet.
    let geo = Geo { transform: Some([500_000.0, 0.001, 0.0, 5_000_000.0, 0.0, -0.001]), ..Geo::default() };
    let mut spec = GeotiffSpec::new(700, 600, SampleType::Float32, &geo);
    spec.nodata = Some(f64::from(f32::MIN));
    let mut writer = GeotiffWriter::create(folder.join("steep.tif"), &spec).expect("create");
    for row in 0..600_u32 {
        let sample = |column: u32| {
            let hash = (column.wrapping_mul(2_654_435_761) ^ row.wrapping_mul(2_246_822_519)) >> 7;
            if hash.is_multiple_of(13) { f32::MIN } else { (hash % 9_000_000) as f32 + 0.123 }
        };
        writer.write_rows(&Samples::Float32((0..700).map(sample).collect())).expect("write");
    }
    writer.finish().expect("finish");
    names.push("steep.tif".to_owned());
    names
}

#[test]
fn every_page_fits_80_columns() {
    let folder = tempfile::tempdir().expect("folder");
    let at = folder.path();
    let names = dems(at);
    for name in &names {
        let rlv = name.replace(".tif", ".rlv");
        page(at, &["build", name, "--dry-run"]);
        page(at, &["build", name, "--tile", "64", "--patch", "16"]);
        page(at, &["info", &rlv]);
        page(at, &["info", &rlv, "-v"]);
        page(at, &["stats", &rlv]);
        page(at, &["verify", &rlv, "--source", name]);
    }
    page(at, &["verify", "steep.rlv", "--source", &names[0]]);
    page(at, &["verify", "steep.rlv", "--deep"]);
    page(at, &["mesh", "steep.rlv", "--max-error", "50m", "-o", "steep.glb"]);
    page(at, &["verify", "steep.glb", "--source", "steep.rlv"]);
    page(at, &["export", "steep.rlv", "--tile", "0/0/0", "-o", "tile.png"]);
    let all: Vec<String> = names.iter().map(|name| name.replace(".tif", ".rlv")).collect();
    page(at, &[&["info"][..], &all.iter().map(String::as_str).collect::<Vec<_>>()].concat());
    fs::copy(fixture("imagery/rmnp_rgb.tif"), at.join("rgb.tif")).expect("copy");
    page(at, &["add", "rmnp_dem_uint16.rlv", "--imagery", "rgb.tif"]);
    page(at, &["info", "rmnp_dem_uint16.rlv"]);
    let long = "a_folder_with_a_name/that_is_much_longer/than_what_a_table_has_room_for";
    fs::create_dir_all(at.join(long)).expect("folder");
    fs::copy(at.join("rmnp_dem_uint16.tif"), at.join(long).join("dem.tif")).expect("copy");
    let each = page(at, &["build", "--each", "out", &format!("{long}/dem.tif"), "steep.tif"]);
    assert!(each.contains("dem.tif") && each.contains('…'), "{each}");
}

#[test]
fn every_help_fits_80_columns() {
    let folder = tempfile::tempdir().expect("folder");
    for command in COMMANDS {
        for help in ["--help", "-h"] {
            page(folder.path(), &[command, help]);
        }
    }
    page(folder.path(), &["--help"]);
    let alone = relevo(folder.path(), &[]);
    let help = text(&alone.stdout) + &text(&alone.stderr);
    assert!(help.contains("relevo build dem.tif") && help.contains("verify"), "{help}");
    assert!(help.lines().all(|line| line.chars().count() <= PAGE), "{help}");
}

/// A terminal of so many columns, by the `script` and `stty` of the system.
#[cfg(target_os = "linux")]
#[test]
fn a_terminal_of_another_width_is_used() {
    let folder = tempfile::tempdir().expect("folder");
    let dem = fixture("dem/co_elevation_float32_lzw.tif");
    fs::copy(dem, folder.path().join("co.tif")).expect("copy");
    page(folder.path(), &["build", "co.tif"]);
    let on_terminal = |columns: usize, what: &str| {
        let command = format!("stty rows 40 cols {columns} <&1; '{}' {what}", env!("CARGO_BIN_EXE_relevo"));
        let mut script = Command::new("script");
        script.args(["-qec", &command, "/dev/null"]).current_dir(folder.path()).env("TERM", "xterm");
        let output = script.stdin(std::process::Stdio::null()).output();
        output.ok().filter(|output| output.status.success()).map(|output| text(&output.stdout))
    };
    // Not every system has `script`.
    let Some(narrow) = on_terminal(50, "info co.rlv") else { return };
    let widest = |out: &str| out.lines().map(|line| line.trim_end().chars().count()).max().unwrap_or(0);
    assert!(widest(&narrow) <= 50, "{narrow}");
    let wide = on_terminal(120, "info co.rlv").expect("script");
    assert!(widest(&wide) > 80 && widest(&wide) <= 120, "{wide}");
    let help = on_terminal(120, "build --help").expect("script");
    assert!(widest(&help) > 80 && widest(&help) <= 110, "{help}");
}

#[test]
fn heights_and_nodata_are_told_short() {
    let folder = tempfile::tempdir().expect("folder");
    let at = folder.path();
    dems(at);
    page(at, &["build", "steep.tif"]);
    let info = page(at, &["info", "steep.rlv"]);
    assert!(info.contains("nodata     -3.4028235e38\n"), "{info}");
    assert!(
        info.lines().any(|line| line.trim_start().starts_with("range") && line.contains(" to ")),
        "{info}"
    );
    page(at, &["build", "steep.tif", "--vertical-unit", "ft", "--force"]);
    let info = page(at, &["info", "steep.rlv"]);
    assert!(info.contains("in the unit of the source"), "{info}");
}

/// Words that only Rust's own notation has.
const RUST: [&str; 9] = ["Some(", "None", "{ ", " }", "::", "Ok(", "Err(", "\"", "[0"];

#[test]
fn a_wrong_source_is_told_in_words() {
    let folder = tempfile::tempdir().expect("folder");
    let at = folder.path();
    let names = dems(at);
    for name in &names {
        page(at, &["build", name]);
    }
    for name in &names {
        let rlv = name.replace(".tif", ".rlv");
        for other in names.iter().filter(|other| *other != name) {
            let said = page(at, &["verify", &rlv, "--source", other]);
            for word in RUST {
                assert!(!said.contains(word), "{word:?} in\n{said}");
            }
            assert!(said.contains("problem"), "{said}");
        }
    }
    // A damaged tile is named once in a line.
    let mut bytes = fs::read(at.join("steep.rlv")).expect("file");
    let middle = bytes.len() / 2;
    bytes[middle..middle + 64].fill(0x5a);
    fs::write(at.join("steep.rlv"), bytes).expect("file");
    let said = page(at, &["verify", "steep.rlv", "--source", "steep.tif"]);
    assert!(said.contains("tile ") && !said.contains("\"good\""), "{said}");
    for line in said.lines().filter(|line| line.contains("expected")) {
        let names: Vec<_> = line.match_indices("tile ").collect();
        assert!(names.len() <= 1, "{line}");
    }
}

#[test]
fn rasters_in_the_place_of_containers_are_named() {
    let folder = tempfile::tempdir().expect("folder");
    let at = folder.path();
    fs::copy(fixture("dem/rmnp_dem_uint16.tif"), at.join("dem.tif")).expect("copy");
    fs::write(at.join("dem.vrt"), "<VRTDataset rasterXSize=\"1\">").expect("file");
    fs::write(at.join("N51E001.hgt"), [0; 100]).expect("file");
    for (name, kind) in [("dem.tif", "a TIFF"), ("dem.vrt", "a VRT"), ("N51E001.hgt", "SRTM")] {
        for args in [
            &["info", name][..],
            &["stats", name],
            &["verify", name],
            &["verify", name, "--source", "dem.tif"],
            &["export", name, "-o", "x.tif"],
            &["add", name, "--imagery", "dem.tif"],
        ] {
            let output = relevo(at, args);
            let told = text(&output.stderr);
            assert_eq!(output.status.code(), Some(2), "{args:?}: {told}");
            // `add` knows it by its whole path.
            let advised = told.contains(&format!("relevo build {name}"))
                || args[0] == "add" && told.contains("relevo build ");
            assert!(told.contains(kind) && advised, "{args:?}: {told}");
            assert_eq!(told.lines().count(), 1, "{told}");
        }
        let told = text(&relevo(at, &["merge", name, "-o", "x.rlv"]).stderr);
        assert!(told.contains("not a piece"), "{told}");
    }
}

#[test]
fn names_that_promise_another_format_are_refused() {
    let folder = tempfile::tempdir().expect("folder");
    let at = folder.path();
    fs::copy(fixture("dem/rmnp_dem_uint16.tif"), at.join("dem.tif")).expect("copy");
    for args in [
        &["build", "dem.tif", "-o", "p.tif"][..],
        &["build", "dem.tif", "-o", "p"],
        &["build", "dem.tif", "-o", "p.tif", "--dry-run"],
        &["merge", "piece", "-o", "p.png"],
    ] {
        let output = relevo(at, args);
        let told = text(&output.stderr);
        assert!(output.status.code() == Some(2) && told.contains("p.rlv"), "{args:?}: {told}");
    }
    assert!(relevo(at, &["build", "dem.tif", "-o", "P.RLV"]).status.success());
}

#[test]
fn it_is_as_loud_and_as_colourful_as_asked() {
    let folder = tempfile::tempdir().expect("folder");
    let at = folder.path();
    fs::copy(fixture("dem/rmnp_dem_uint16.tif"), at.join("dem.tif")).expect("copy");
    let quiet = relevo(at, &["build", "dem.tif", "-q", "--verify"]);
    assert!(quiet.status.success() && quiet.stdout.is_empty() && quiet.stderr.is_empty(), "{quiet:?}");
    let json = relevo(at, &["build", "dem.tif", "--quiet", "--json", "--force"]);
    assert!(json.status.success() && json.stdout.starts_with(b"{"), "{json:?}");
    let verbose = relevo(at, &["-v", "build", "dem.tif", "--force"]);
    let told = text(&verbose.stderr);
    assert!(told.contains("build took") && told.contains("write took"), "{told}");
    assert!(page(at, &["info", "dem.rlv", "-v"]).contains("offset (bytes)"));

    // Its own errors, and those of the parser, which knows the option only when it is done.
    for wrong in [&["info", "none.rlv"][..], &["info"]] {
        for (colour, is) in [("auto", false), ("never", false), ("always", true)] {
            let told = text(&relevo(at, &[wrong, &["--color", colour]].concat()).stderr);
            assert_eq!(told.contains("\x1b[1m"), is, "{wrong:?} {colour}: {told:?}");
            let told = text(&relevo(at, &[&[&*format!("--color={colour}")], wrong].concat()).stderr);
            assert_eq!(told.contains("\x1b[1m"), is, "{wrong:?} {colour}: {told:?}");
        }
    }
    assert_eq!(relevo(at, &["info", "dem.rlv", "-q", "-v"]).status.code(), Some(2));
}

#[test]
fn the_memory_that_a_refusal_names_is_the_least_that_is_enough() {
    let folder = tempfile::tempdir().expect("folder");
    let at = folder.path();
    let geo = Geo::default();
    let width = 24_000;
    let mut writer =
        GeotiffWriter::create(at.join("wide.tif"), &GeotiffSpec::new(width, 64, SampleType::Int16, &geo))
            .expect("create");
    for row in 0..64_u32 {
        let samples = (0..width).map(|column| (column % 97 + row) as i16).collect();
        writer.write_rows(&Samples::Int16(samples)).expect("write");
    }
    writer.finish().expect("finish");
    let with = |memory: &str| {
        let output = relevo(at, &["build", "wide.tif", "--dry-run", "--jobs", "2", "--memory", memory]);
        (output.status.code(), text(&output.stderr))
    };
    let (code, told) = with("30MiB");
    assert_eq!(code, Some(2), "{told}");
    let least = told.split(" MiB at least").next().and_then(|before| before.rsplit(' ').next());
    let least: u64 = least.and_then(|number| number.parse().ok()).expect("a number of MiB");
    assert_eq!(with(&format!("{least}MiB")).0, Some(0), "{told}");
    let (code, less) = with(&format!("{}MiB", least - 1));
    assert!(code == Some(2) && less.contains(&format!("{least} MiB at least")), "{less}");
}

/// What a dry run says, held against what the build makes.
#[test]
fn a_dry_run_is_right_about_the_disk() {
    let folder = tempfile::tempdir().expect("folder");
    let at = folder.path();
    for name in dems(at) {
        let plan = relevo(at, &["build", &name, "--dry-run", "--json"]);
        let plan: serde_json::Value = serde_json::from_slice(&plan.stdout).expect("JSON");
        let built = relevo(at, &["build", &name, "--json"]);
        let built: serde_json::Value = serde_json::from_slice(&built.stdout).expect("JSON");
        let (said, is) =
            (plan["disk_bytes"].as_f64().expect("bytes"), built["bytes"].as_f64().expect("bytes"));
        assert!((is / 1.5..=is * 1.5).contains(&said), "{name}: {said} bytes, really {is}");
        assert!(plan["estimated_seconds"].as_f64().is_some_and(|seconds| seconds > 0.0), "{plan}");
    }
}
