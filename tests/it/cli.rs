//! The real binary on real files: what it prints, what it leaves behind, and how it fails.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use relevo::geo::Geo;
use relevo::geotiff_write::{GeotiffSpec, GeotiffWriter};
use relevo::sample::SampleType;
use relevo::source::Samples;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem").join(name)
}

fn relevo(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_relevo")).args(args).output().expect("the binary runs")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("utf-8 path")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// An int16 GeoTIFF whose sample at (column, row) is `height(column, row)`; nodata -32768.
fn dem(path: &Path, width: u32, height: u32, sample: impl Fn(u32, u32) -> i16) {
    let geo = Geo { transform: Some([500_000.0, 30.0, 0.0, 5_000_000.0, 0.0, -30.0]), ..Geo::default() };
    let mut spec = GeotiffSpec::new(width, height, SampleType::Int16, &geo);
    spec.nodata = Some(-32768.0);
    let mut writer = GeotiffWriter::create(path, &spec).expect("create");
    for row in 0..height {
        let samples = (0..width).map(|column| sample(column, row)).collect();
        writer.write_rows(&Samples::Int16(samples)).expect("write");
    }
    writer.finish().expect("finish");
}

/// Names in a folder, sorted.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> = fs::read_dir(folder)
        .expect("folder")
        .map(|e| e.expect("entry").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// Fails with exit code 2, one line that has all of `words`, and nothing in `folder` but `left`.
fn fails(output: &Output, words: &[&str], folder: &Path, left: &[&str]) {
    let message = stderr(output);
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    for word in words {
        assert!(message.contains(word), "{word:?} is not in {message:?}");
    }
    assert_eq!(names(folder), left, "{message}");
}

#[test]
fn build_info_stats_export_on_a_real_dem() {
    let folder = tempfile::tempdir().expect("folder");
    let (rlv, tif, png) =
        (folder.path().join("co.rlv"), folder.path().join("co.tif"), folder.path().join("co.png"));
    let source = fixture("co_elevation_float32_lzw.tif");
    let built = relevo(&["build", text(&source), "-o", text(&rlv)]);
    assert!(built.status.success(), "{}", stderr(&built));
    let report = String::from_utf8_lossy(&built.stdout).into_owned();
    for word in ["1007 x 633 Float32", "EPSG:4269", "17 tiles", "lossless"] {
        assert!(report.contains(word), "{word:?} is not in\n{report}");
    }
    assert_eq!(names(folder.path()), ["co.rlv"]);

    let info = relevo(&["info", text(&rlv), "--json"]);
    let facts: serde_json::Value = serde_json::from_slice(&info.stdout).expect("JSON");
    assert_eq!(facts[0]["columns"], 1007);
    assert_eq!(facts[0]["metadata"]["crs"]["epsg"], 4269);
    let human = relevo(&["info", text(&rlv)]);
    assert!(String::from_utf8_lossy(&human.stdout).contains("EPSG:4269"));

    let stats = relevo(&["stats", text(&rlv), "--json"]);
    let stats: serde_json::Value = serde_json::from_slice(&stats.stdout).expect("JSON");
    assert_eq!(stats["statistics"]["levels"].as_array().expect("levels").len(), 3);
    assert_eq!(stats["statistics"]["levels"][0]["void_share"], 0.0);
    let csv = relevo(&["stats", text(&rlv), "--csv"]);
    let csv = String::from_utf8(csv.stdout).expect("text");
    assert_eq!(csv.lines().count(), 1 + 3 * 6);
    let columns = csv.lines().next().expect("heading").split(',').count();
    assert!(csv.lines().all(|line| line.split(',').count() == columns));

    for output in [&tif, &png] {
        let exported = relevo(&["export", text(&rlv), "-o", text(output)]);
        assert!(exported.status.success(), "{}", stderr(&exported));
    }
    let again = relevo(&["export", text(&rlv), "-o", text(&tif)]);
    assert_eq!(again.status.code(), Some(2));
    assert!(stderr(&again).contains("--force"));
}

#[test]
fn one_and_two_threads_give_the_same_bytes() {
    let folder = tempfile::tempdir().expect("folder");
    let rough = folder.path().join("rough.tif");
    // Voids at tile corners and in blobs, several levels at --tile 16.
    dem(&rough, 333, 150, |x, y| {
        let hash = (x.wrapping_mul(2_654_435_761) ^ y.wrapping_mul(2_246_822_519)) >> 7;
        if (x / 9 + y / 7) % 5 == 0 || hash % 31 == 0 { -32768 } else { (hash % 900) as i16 + (x * 3) as i16 }
    });
    for (source, options) in [
        (fixture("co_elevation_float32_lzw.tif"), ["--tile", "64", "--patch", "16"]),
        (fixture("rmnp_dem_uint16.tif"), ["--tile", "16", "--metric", "paper"]),
        (rough, ["--tile", "16", "--patch", "4"]),
    ] {
        let build = |jobs: &str| {
            let out = folder.path().join(format!("{jobs}.rlv"));
            let patch = if options.contains(&"--patch") { vec![] } else { vec!["--patch", "8"] };
            let mut args = vec!["build", text(&source), "-o", text(&out), "--force", "--jobs", jobs];
            args.extend(options);
            args.extend(patch);
            let output = relevo(&args);
            assert!(output.status.success(), "{}", stderr(&output));
            fs::read(&out).expect("file")
        };
        assert!(build("1") == build("2"), "{}", source.display());
    }
}

#[test]
fn inputs_that_cannot_be_read_leave_nothing() {
    let folder = tempfile::tempdir().expect("folder");
    let out = folder.path().join("out.rlv");
    let missing = folder.path().join("missing.tif");
    fails(
        &relevo(&["build", text(&missing), "-o", text(&out)]),
        &["missing.tif", "No such file"],
        folder.path(),
        &[],
    );

    let whole = fs::read(fixture("co_elevation_float32_lzw.tif")).expect("fixture");
    let cut = folder.path().join("cut.tif");
    fs::write(&cut, &whole[..whole.len() / 2]).expect("write");
    fails(&relevo(&["build", text(&cut), "-o", text(&out)]), &["cut.tif"], folder.path(), &["cut.tif"]);
    fs::remove_file(&cut).expect("remove");

    let void = folder.path().join("void.tif");
    dem(&void, 40, 30, |_, _| -32768);
    let words = ["void.tif", "40 x 30", "all void", "-32768", "--nodata"];
    fails(&relevo(&["build", text(&void), "-o", text(&out)]), &words, folder.path(), &["void.tif"]);

    let text_file = folder.path().join("notes.tif");
    fs::remove_file(&void).expect("remove");
    fs::write(&text_file, "not a raster").expect("write");
    fails(
        &relevo(&["build", text(&text_file), "-o", text(&out)]),
        &["notes.tif"],
        folder.path(),
        &["notes.tif"],
    );
}

#[test]
fn outputs_that_cannot_be_written_leave_nothing() {
    let folder = tempfile::tempdir().expect("folder");
    let source = fixture("rmnp_dem_uint16.tif");
    let out = folder.path().join("out.rlv");
    fs::write(&out, "precious").expect("write");
    let kept = relevo(&["build", text(&source), "-o", text(&out)]);
    fails(&kept, &["out.rlv", "--force"], folder.path(), &["out.rlv"]);
    assert_eq!(fs::read(&out).expect("still there"), b"precious");
    assert!(relevo(&["build", text(&source), "-o", text(&out), "--force"]).status.success());
    assert_ne!(fs::read(&out).expect("replaced"), b"precious");
    fs::remove_file(&out).expect("remove");

    let nowhere = folder.path().join("no/such/folder/out.rlv");
    fails(&relevo(&["build", text(&source), "-o", text(&nowhere)]), &["no/such/folder"], folder.path(), &[]);
    let inside_file = folder.path().join("file");
    fs::write(&inside_file, "").expect("write");
    let under = inside_file.join("out.rlv");
    fails(
        &relevo(&["build", text(&source), "-o", text(&under)]),
        &["file", "not a directory"],
        folder.path(),
        &["file"],
    );
}

/// A write limit stands for a full disk: the system call fails in the middle of the data.
#[cfg(unix)]
#[test]
fn a_full_disk_leaves_nothing() {
    let folder = tempfile::tempdir().expect("folder");
    let out = folder.path().join("out.rlv");
    let source = fixture("co_elevation_float32_lzw.tif");
    let script = format!(
        "trap '' XFSZ; ulimit -f 200; exec '{}' build '{}' -o '{}'",
        env!("CARGO_BIN_EXE_relevo"),
        source.display(),
        out.display()
    );
    let output = Command::new("bash").args(["-c", &script]).output().expect("bash runs");
    fails(&output, &["out.rlv"], folder.path(), &[]);
}

/// A folder that the user may not write to; root may, so there the test looks at a read-only system
/// folder.
#[cfg(target_os = "linux")]
#[test]
fn a_read_only_folder_is_named() {
    let folder = tempfile::tempdir().expect("folder");
    let source = fixture("rmnp_dem_uint16.tif");
    let output = relevo(&["build", text(&source), "-o", "/proc/out.rlv"]);
    fails(&output, &["/proc/out.rlv"], folder.path(), &[]);
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_nothing() {
    let folder = tempfile::tempdir().expect("folder");
    let source = folder.path().join("big.tif");
    dem(&source, 3000, 3000, |x, y| ((x * 7919 + y * 104_729) % 5000) as i16);
    let out = folder.path().join("out.rlv");
    let mut child = Command::new(env!("CARGO_BIN_EXE_relevo"))
        .args(["build", text(&source), "-o", text(&out), "--tile", "64", "--jobs", "1"])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("the binary runs");
    let work = folder.path().join("out.rlv.work");
    while !work.exists() {
        assert!(child.try_wait().expect("wait").is_none(), "ended before it could be interrupted");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill runs");
    assert!(killed.success());
    let output = child.wait_with_output().expect("ends");
    fails(&output, &["interrupted"], folder.path(), &["big.tif"]);
}

#[test]
fn options_that_make_no_sense_are_refused() {
    let folder = tempfile::tempdir().expect("folder");
    let out = folder.path().join("out.rlv");
    let source = fixture("rmnp_dem_uint16.tif");
    for (options, word) in [
        (["--tile", "100"], "power of two"),
        (["--tile", "2048"], "16 to 1024"),
        (["--patch", "128"], "4 to 64"),
        (["--precision", "0"], "above 0"),
        (["--precision", "nan"], "above 0"),
    ] {
        let mut args = vec!["build", text(&source), "-o", text(&out)];
        args.extend(options);
        fails(&relevo(&args), &[word], folder.path(), &[]);
    }
    let same = folder.path().join("a.tif");
    fs::copy(&source, &same).expect("copy");
    let output = relevo(&["build", text(&same), "-o", text(&same), "--force"]);
    fails(&output, &["same file"], folder.path(), &["a.tif"]);
    assert_eq!(relevo(&["build"]).status.code(), Some(2));
    assert_eq!(relevo(&["nonsense"]).status.code(), Some(2));
}

#[test]
fn a_dry_run_writes_nothing_and_counts_right() {
    let folder = tempfile::tempdir().expect("folder");
    let out = folder.path().join("out.rlv");
    let source = fixture("co_elevation_float32_lzw.tif");
    let output = relevo(&["build", text(&source), "-o", text(&out), "--dry-run", "--json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(names(folder.path()), Vec::<String>::new());
    let plan: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(plan["most_tiles"], 17);
    assert_eq!(plan["level_count"], 3);
}

/// Reading a table into `head` must not be an error.
#[cfg(unix)]
#[test]
fn a_closed_pipe_is_no_error() {
    let folder = tempfile::tempdir().expect("folder");
    let out = folder.path().join("out.rlv");
    assert!(relevo(&["build", text(&fixture("rmnp_dem_uint16.tif")), "-o", text(&out)]).status.success());
    let script = format!(
        "'{}' stats '{}' --json | true; echo ${{PIPESTATUS[0]}}",
        env!("CARGO_BIN_EXE_relevo"),
        out.display()
    );
    let output = Command::new("bash").args(["-c", &script]).output().expect("bash runs");
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), "0", "{}", stderr(&output));
}

#[test]
fn progress_as_json_is_json() {
    let folder = tempfile::tempdir().expect("folder");
    let out = folder.path().join("out.rlv");
    let source = fixture("co_elevation_float32_lzw.tif");
    let output =
        relevo(&["build", text(&source), "-o", text(&out), "--progress", "json", "--precision", "0.01"]);
    let lines = stderr(&output);
    assert!(lines.lines().count() >= 3, "{lines}");
    for line in lines.lines() {
        let event: serde_json::Value = serde_json::from_str(line).expect("a JSON object a line");
        assert!(event["done"].as_u64() <= event["total"].as_u64());
    }
}
