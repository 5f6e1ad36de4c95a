//! The program without a window: pictures, figures, and what it says of bad input.
#![expect(clippy::expect_used, reason = "a test that cannot go on says why")]

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::{Table, chequered, covered, fixture, png, run, viewer};
use relevo::TileId;
use relevo::container::{ChunkKind, Reader, sections};
use tempfile::TempDir;

fn rmnp() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let file = fixture(folder.path(), "rmnp_dem_uint16.tif", 32, 8);
    (folder, file)
}

#[test]
fn a_path_gives_a_row_and_a_picture_for_every_frame() {
    let (folder, file) = rmnp();
    let (csv, frames) = (folder.path().join("out.csv"), folder.path().join("frames"));
    let mut command = viewer();
    command.arg(&file).args([
        "--headless",
        "--count",
        "6",
        "--size",
        "320x200",
        "--tolerance",
        "0.7",
        "--observe",
    ]);
    let (out, errors) = run(command.arg("--metrics").arg(&csv).arg("--frames").arg(&frames), 0);
    assert!(
        out.contains("6 frames") && out.contains("largest observed error") && errors.is_empty(),
        "{out}{errors}"
    );
    let table = Table::read(&csv);
    assert_eq!(table.column("frame"), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    assert!(table.column("time_s").windows(2).all(|pair| pair[0] < pair[1]));
    for name in ["tiles", "patches", "triangles", "draws", "gpu_bytes", "frame_ms", "select_ms"] {
        assert!(table.column(name).iter().all(|&number| number > 0.0), "{name}");
    }
    assert!(table.column("loads_pending").iter().all(|&pending| pending == 0.0));
    assert!(table.column("tolerance_px").iter().all(|&tolerance| tolerance == 0.7));
    let (promised, observed) = (table.column("promised_px"), table.column("observed_px"));
    assert!(promised.iter().all(|&pixels| (0.0..=0.7001).contains(&pixels)), "{promised:?}");
    assert!(
        promised.iter().zip(&observed).all(|(promised, observed)| *observed <= promised + 1e-3),
        "{observed:?}"
    );
    assert!(observed.iter().any(|&pixels| pixels > 0.0), "{observed:?}");
    for frame in 0..6 {
        let picture = frames.join(format!("{frame:06}.png"));
        assert_eq!((png(&picture).0, png(&picture).1), (320, 200));
        assert!(covered(&picture) > 0.1, "frame {frame} shows sky only");
    }
}

#[test]
fn a_camera_path_of_ones_own_is_followed() {
    let (folder, file) = rmnp();
    let json = folder.path().join("path.json");
    let csv = folder.path().join("out.csv");
    let text = r#"{ "fov": 60, "keys": [
        { "time": 10, "eye": [70, 150, 9000], "target": [75, 90, 2500] },
        { "time": 11, "eye": [70, 120, 8000], "target": [75, 70, 2500] } ] }"#;
    fs::write(&json, text).expect("path");
    let ours = || {
        let mut command = viewer();
        command.arg(&file).args(["--headless", "--size", "200x120"]).arg("--path").arg(&json);
        command
    };
    run(ours().args(["--fps", "4"]).arg("--metrics").arg(&csv), 0);
    assert_eq!(Table::read(&csv).column("time_s"), [10.0, 10.25, 10.5, 10.75, 11.0]);
    fs::write(&json, text.replace("\"target\": [75, 70, 2500]", "\"target\": [75, 70]")).expect("path");
    let (_, errors) = run(&mut ours(), 2);
    assert!(errors.contains("path.json") && errors.contains("keys[1].target"), "{errors}");
    fs::remove_file(&json).expect("path");
    let (_, errors) = run(&mut ours(), 2);
    assert!(errors.contains("path.json"), "{errors}");
}

#[test]
fn what_is_loaded_at_the_moment_gets_better() {
    let (folder, file) = rmnp();
    let (json, csv) = (folder.path().join("path.json"), folder.path().join("out.csv"));
    let text = r#"{ "keys": [ { "time": 0, "eye": [70, 200, 20000], "target": [75, 90, 2500] },
                              { "time": 1, "eye": [70, 200, 19990], "target": [75, 90, 2500] } ] }"#;
    fs::write(&json, text).expect("path");
    let mut command = viewer();
    command.arg(&file).args(["--headless", "--streaming", "--count", "40", "--size", "320x200"]);
    run(command.arg("--path").arg(&json).arg("--metrics").arg(&csv), 0);
    let table = Table::read(&csv);
    let (pending, promised) = (table.column("loads_pending"), table.column("promised_px"));
    assert!(pending[0] > 0.0, "nothing is loaded in the first frame");
    assert!(pending[39] == 0.0 && promised[39] <= 1.0001, "{pending:?} {promised:?}");
}

#[test]
fn a_limit_of_triangles_raises_the_tolerance_while_the_camera_moves() {
    let (folder, file) = rmnp();
    let csv = folder.path().join("out.csv");
    let mut command = viewer();
    command.arg(&file).args(["--headless", "--count", "30", "--size", "320x200", "--tolerance", "0.2"]);
    run(command.args(["--max-triangles", "6000"]).arg("--metrics").arg(&csv), 0);
    let table = Table::read(&csv);
    let (tolerance, triangles) = (table.column("tolerance_px"), table.column("triangles"));
    assert_eq!(tolerance[0], 0.2);
    assert!(triangles[0] > 6000.0 && tolerance[12] > 0.2, "{triangles:?} {tolerance:?}");
    let late = triangles[10..25].iter().sum::<f64>() / 15.0;
    assert!(late < 7500.0, "{triangles:?}");
}

#[test]
fn one_picture_is_of_the_place_that_was_asked_for() {
    let (folder, file) = rmnp();
    let output = folder.path().join("shot.png");
    let (out, _) = run(viewer().arg(&file).args(["--size", "300x200"]).arg("--shot").arg(&output), 0);
    assert!(out.contains("largest promised error"), "{out}");
    let all = covered(&output);
    assert!((0.1..0.95).contains(&all), "an overview shows land and sky, not {all}");
    let down = ["--eye", "76,93,9000", "--target", "76,92,2000", "--paint", "step", "--wireframe"];
    run(viewer().arg(&file).args(["--size", "300x200"]).args(down).arg("--shot").arg(&output), 0);
    let (_, _, bytes, channels) = png(&output);
    let colours: std::collections::HashSet<_> = bytes.chunks_exact(channels).collect();
    assert!(colours.len() > 3, "{} colours", colours.len());
}

#[test]
fn bad_files_are_refused_in_a_sentence() {
    let (folder, file) = rmnp();
    let bytes = fs::read(&file).expect("file");
    let bad = folder.path().join("bad.rlv");
    let refused = |what: &str| {
        for mode in [&["--headless", "--count", "1"][..], &["--shot", "no.png"]] {
            let (out, errors) = run(viewer().current_dir(folder.path()).arg(&bad).args(mode), 2);
            assert!(out.is_empty() && errors.contains("bad.rlv"), "{what}: {errors}");
            assert_eq!(errors.lines().count(), 1, "{what}: {errors}");
        }
    };
    refused("no such file");
    fs::write(&bad, b"").expect("write");
    refused("an empty file");
    fs::write(&bad, vec![b'x'; 5000]).expect("write");
    refused("another kind of file");
    for share in [0.01, 0.5, 0.99] {
        fs::write(&bad, &bytes[..(bytes.len() as f64 * share) as usize]).expect("write");
        refused("a truncated file");
    }
}

/// Flips a byte of a tile's heights.
fn damage(file: &Path, id: TileId) {
    let reader = Reader::open(file).expect("open");
    let tiles = reader.sections().iter().find(|section| section.kind == sections::TILES).expect("tiles");
    let entry = reader.entry(id).expect("row").expect("tile");
    let at = (tiles.offset + entry.chunks.chunk(ChunkKind::Heights).0 + 3) as usize;
    drop(reader);
    let mut bytes = fs::read(file).expect("read");
    bytes[at] ^= 0x10;
    fs::write(file, bytes).expect("write");
}

#[test]
fn a_damaged_tile_is_reported_once_and_drawn_from_its_parent() {
    let (folder, file) = rmnp();
    let leaf = Reader::open(&file).expect("open").header().levels;
    damage(&file, TileId::new(leaf, 2, 3));
    let (csv, frames) = (folder.path().join("out.csv"), folder.path().join("frames"));
    for mode in [&[][..], &["--streaming"]] {
        let mut command = viewer();
        command
            .arg(&file)
            .args(["--headless", "--count", "8", "--size", "320x200", "--tolerance", "0.1"])
            .args(mode);
        let (_, errors) = run(command.arg("--metrics").arg(&csv).arg("--frames").arg(&frames), 0);
        let told: Vec<_> = errors.lines().filter(|line| line.contains(&format!("{leaf}/2/3"))).collect();
        assert_eq!((told.len(), errors.lines().count()), (1, 1), "{errors}");
        assert!(told[0].contains("CRC") && told[0].contains("parent"), "{errors}");
        // Before anything is loaded there is sky.
        let first = if mode.is_empty() { 0 } else { 7 };
        assert!((first..8).all(|frame| covered(&frames.join(format!("{frame:06}.png"))) > 0.05));
    }
    assert!(Table::read(&csv).column("triangles")[7] > 0.0);
}

#[test]
fn without_its_root_nothing_can_be_shown() {
    let (_folder, file) = rmnp();
    damage(&file, TileId::ROOT);
    let (_, errors) = run(viewer().arg(&file).args(["--headless", "--count", "3"]), 2);
    assert!(errors.contains("0/0/0") && errors.contains("CRC"), "{errors}");
}

#[test]
fn without_an_adapter_it_says_what_to_install() {
    let (_folder, file) = rmnp();
    let mut command = viewer();
    command.env("VK_ICD_FILENAMES", "/nowhere.json").env("WGPU_BACKEND", "vulkan");
    let (_, errors) = run(command.arg(&file).args(["--headless", "--count", "1"]), 2);
    assert!(errors.contains("mesa-vulkan-drivers"), "{errors}");
    let (_, errors) =
        run(viewer().args(["--adapter", "Voodoo"]).arg(&file).args(["--headless", "--count", "1"]), 2);
    assert!(errors.contains("Voodoo") && errors.contains("there are:"), "{errors}");
}

#[test]
fn arguments_that_make_no_sense_are_refused() {
    let (_folder, file) = rmnp();
    for (arguments, says) in [
        (&["--tolerance", "0"][..], "--tolerance"),
        (&["--size", "large"], "1280x720"),
        (&["--gpu-memory", "much"], "GiB"),
        (&["--headless", "--count", "1", "--gpu-memory", "1KiB"], "--gpu-memory"),
        (&["--count", "3"], "--headless"),
        (&["--lod", "tiles"], "--headless|--shot"),
        (&["--lod", "hybrid"], "--headless|--shot"),
        (&["--headless", "--shot", "a.png"], "--shot"),
        (&["--target-fps", "30", "--max-triangles", "100"], "--max-triangles"),
    ] {
        let (_, errors) = run(viewer().arg(&file).args(arguments), 2);
        assert!(errors.contains(says), "{arguments:?}: {errors}");
    }
}

#[test]
fn the_memory_that_a_refusal_names_is_the_least_that_is_accepted() {
    let (folder, file) = rmnp();
    let chequers = chequered(folder.path(), 129);
    for file in [&file, &chequers] {
        let with = |memory: &str, code| {
            let mut command = viewer();
            command.arg(file).args([
                "--headless",
                "--count",
                "2",
                "--size",
                "640x400",
                "--gpu-memory",
                memory,
            ]);
            run(&mut command, code).1
        };
        let refusal = with("1KiB", 2);
        let least = refusal.split("at least ").nth(1).and_then(|rest| rest.split(' ').next());
        let least: u32 = least.and_then(|number| number.parse().ok()).expect("a number of MiB");
        assert!(with(&format!("{}MiB", least - 1), 2).contains(&format!("at least {least} MiB")));
        assert_eq!(with(&format!("{least}MiB"), 0), "");
    }
}

#[test]
fn what_a_damaged_leaf_hides_is_not_said_to_be_measured() {
    let (folder, file) = rmnp();
    let leaf = Reader::open(&file).expect("open").header().levels;
    damage(&file, TileId::new(leaf, 2, 3));
    let csv = folder.path().join("out.csv");
    // With the finest tiles drawn, and with coarse ones, whose errors the leaves tell.
    for tolerance in ["0.1", "50"] {
        for mode in [&[][..], &["--streaming"]] {
            let mut command = viewer();
            command.arg(&file).args(["--headless", "--count", "8", "--size", "320x200", "--observe"]);
            command.args(["--tolerance", tolerance]).args(mode);
            let (out, errors) = run(command.arg("--metrics").arg(&csv), 2);
            assert!(out.is_empty(), "{out}");
            let last = errors.lines().last().expect("words");
            assert!(last.contains("--observe") && last.contains("CRC"), "{errors}");
            assert!(last.contains(&format!("{leaf}/2/3")), "{errors}");
        }
    }
}
