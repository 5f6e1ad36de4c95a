//! `relevo build --each`: the real binary on many inputs, good and bad.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem").join(name)
}

fn relevo(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_relevo"))
        .current_dir(folder)
        .args(args)
        .output()
        .expect("the binary runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Copies of a real DEM, one that is cut short, one that is none, and one that is not there.
fn inputs(folder: &Path) -> Vec<String> {
    let small = fixture("rmnp_dem_uint16.tif");
    for name in ["a.tif", "b.tif", "c.tif", "d.tif"] {
        fs::copy(&small, folder.join(name)).expect("copy");
    }
    fs::copy(fixture("co_elevation_float32_lzw.tif"), folder.join("large.tif")).expect("copy");
    let bytes = fs::read(&small).expect("read");
    fs::write(folder.join("short.tif"), &bytes[..bytes.len() / 2]).expect("write");
    fs::write(folder.join("words.tif"), "no raster").expect("write");
    ["a", "b", "large", "short", "c", "words", "d", "gone"].map(|name| format!("{name}.tif")).to_vec()
}

#[test]
fn bad_inputs_are_told_and_passed_over() {
    let folder = tempfile::tempdir().expect("folder");
    let inputs = inputs(folder.path());
    let mut args = vec!["build", "--each", "out", "--verify", "--progress", "none"];
    args.extend(inputs.iter().map(String::as_str));
    let output = relevo(folder.path(), &args);
    let (said, told) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(said.contains("5 built, 3 failed in "), "{said}");
    let record = fs::read_to_string(folder.path().join("out/relevo-each.jsonl")).expect("record");
    for name in ["short.tif", "words.tif", "gone.tif"] {
        // Told once, and kept in the record.
        assert_eq!(told.lines().filter(|line| line.contains(name)).count(), 1, "{told}");
        let kept: Vec<Value> = record.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
        let failed = kept.iter().find(|entry| entry["failed"] == name).expect("in the record");
        assert!(failed["error"].as_str().is_some_and(|error| error.contains(name)), "{failed}");
        assert!(
            told.contains(name) && said.lines().any(|l| l.contains(name) && l.ends_with("failed")),
            "{said}"
        );
    }
    assert_eq!(told.lines().filter(|line| line.starts_with("relevo: ")).count(), 3, "{told}");
    for name in ["a", "b", "c", "d", "large"] {
        let one = folder.path().join(format!("{name}-alone.rlv"));
        let alone = relevo(folder.path(), &["build", &format!("{name}.tif"), "-o", &one.to_string_lossy()]);
        assert!(alone.status.success());
        let each = fs::read(folder.path().join(format!("out/{name}.rlv"))).expect("output");
        assert!(each == fs::read(one).expect("alone"), "{name}");
    }
    let mut left: Vec<_> = fs::read_dir(folder.path().join("out"))
        .expect("out")
        .map(|entry| entry.expect("entry").file_name().to_string_lossy().into_owned())
        .collect();
    left.sort();
    assert_eq!(left, ["a.rlv", "b.rlv", "c.rlv", "d.rlv", "large.rlv", "relevo-each.jsonl"]);
}

#[test]
fn resume_passes_over_what_is_done_and_unchanged() {
    let folder = tempfile::tempdir().expect("folder");
    inputs(folder.path());
    let at = |name: &str| folder.path().join(name);
    fs::write(at("list.txt"), "# a list\na.tif\n\n  b.tif\nlarge.tif\n").expect("list");
    let run = |more: &[&str]| {
        let args = [&["build", "--each", "out", "@list.txt", "c.tif", "--json"], more].concat();
        let output = relevo(folder.path(), &args);
        let report: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
        let mut states: Vec<_> = report["files"]
            .as_array()
            .map(Vec::as_slice)
            .unwrap_or_default()
            .iter()
            .map(|file| format!("{} {}", file["sources"][0], file["status"]).replace('"', ""))
            .collect();
        states.sort();
        (output.status.code(), states)
    };
    let all = |states: [&str; 4]| {
        let names = ["a.tif", "b.tif", "c.tif", "large.tif"];
        names.iter().zip(states).map(|(name, state)| format!("{name} {state}")).collect::<Vec<_>>()
    };
    assert_eq!(run(&[]), (Some(0), all(["built"; 4])));
    // Without a word nothing is replaced, and nothing is lost.
    assert_eq!(run(&[]), (Some(2), all(["failed"; 4])));
    assert_eq!(run(&["--resume"]), (Some(0), all(["unchanged"; 4])));
    // One input is another now, one output is gone, one was tampered with.
    fs::copy(at("large.tif"), at("a.tif")).expect("copy");
    fs::remove_file(at("out/b.rlv")).expect("remove");
    fs::write(at("out/c.rlv"), "something else").expect("write");
    assert_eq!(run(&["--resume"]), (Some(0), all(["built", "built", "built", "unchanged"])));
    assert!(fs::read(at("out/a.rlv")).expect("a") != fs::read(at("out/b.rlv")).expect("b"));
    // A record whose last line was being written when the power went.
    let record = fs::read(at("out/relevo-each.jsonl")).expect("record");
    fs::write(at("out/relevo-each.jsonl"), &record[..record.len() - 9]).expect("write");
    let (code, states) = run(&["--resume"]);
    assert_eq!(code, Some(0));
    assert_eq!(states.iter().filter(|state| state.ends_with("unchanged")).count(), 3, "{states:?}");
    // Other options make other files.
    assert_eq!(run(&["--resume", "--tile", "128"]), (Some(0), all(["built"; 4])));
    assert_eq!(run(&["--force"]), (Some(0), all(["built"; 4])));
}

#[test]
fn what_cannot_be_is_refused_at_once() {
    let folder = tempfile::tempdir().expect("folder");
    inputs(folder.path());
    fs::create_dir(folder.path().join("other")).expect("folder");
    fs::copy(folder.path().join("a.tif"), folder.path().join("other/a.tif")).expect("copy");
    fs::create_dir(folder.path().join("nothing")).expect("folder");
    fs::write(folder.path().join("nothing/a.rlv"), "none").expect("file");
    fs::write(folder.path().join("empty.txt"), "# nothing\n").expect("list");
    for (args, word) in [
        (&["a.tif", "./a.tif"][..], "would both become"),
        (&["nothing"], "rasters (.tif"),
        (&["@empty.txt"], "one name a line"),
        (&["@missing.txt"], "missing.txt"),
        (&["a.tif", "-o", "x.rlv"], "cannot be used with"),
    ] {
        let output = relevo(folder.path(), &[&["build", "--each", "out"], args].concat());
        let told = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{args:?}: {told}");
        assert!(told.contains(word), "{args:?}: {told}");
        assert!(!folder.path().join("out").exists());
    }
}

#[test]
fn a_folder_stands_for_its_rasters_and_names_tell_folders_apart() {
    let folder = tempfile::tempdir().expect("folder");
    let small = fixture("rmnp_dem_uint16.tif");
    for path in ["north/deep", "south"] {
        fs::create_dir_all(folder.path().join(path)).expect("folder");
    }
    for path in ["north/n1.tif", "north/n2.TIF", "north/deep/n3.tif", "north/.hidden.tif", "south/n1.tif"] {
        fs::copy(&small, folder.path().join(path)).expect("copy");
    }
    fs::write(folder.path().join("north/notes.txt"), "no raster").expect("file");
    fs::write(folder.path().join("north/n1.tif.aux.xml"), "<PAMDataset/>").expect("file");
    let built = relevo(folder.path(), &["build", "--each", "out", "north", "south/n1.tif"]);
    assert!(built.status.success(), "{}", text(&built.stderr));
    let mut left: Vec<_> = fs::read_dir(folder.path().join("out"))
        .expect("out")
        .map(|entry| entry.expect("entry").file_name().to_string_lossy().into_owned())
        .collect();
    left.sort();
    assert_eq!(left, ["n2.rlv", "north-n1.rlv", "relevo-each.jsonl", "south-n1.rlv"]);
    // A batch that was made with these names is whole.
    let again = relevo(folder.path(), &["build", "--each", "out", "north", "south/n1.tif", "--resume"]);
    assert!(text(&again.stdout).contains("0 built, 3 unchanged"), "{}", text(&again.stdout));
    assert_eq!(again.status.code(), Some(0));
}
