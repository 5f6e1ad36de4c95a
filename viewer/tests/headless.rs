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
    let down = ["--eye", "76,93,9000", "--target", "76,92,2000", "--paint", "step", "--wireframe", "--force"];
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
            .args(["--headless", "--count", "8", "--size", "320x200", "--tolerance", "0.1", "--force"])
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
        (&["--shot", "a.jpg"], ".png"),
        (&["--shot", "a"], ".png"),
        (&["--force"], "--headless|--shot"),
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
            command.arg(&file).args([
                "--headless",
                "--count",
                "8",
                "--size",
                "320x200",
                "--observe",
                "--force",
            ]);
            command.args(["--tolerance", tolerance]).args(mode);
            let (out, errors) = run(command.arg("--metrics").arg(&csv), 2);
            assert!(out.is_empty(), "{out}");
            let last = errors.lines().last().expect("words");
            assert!(last.contains("--observe") && last.contains("CRC"), "{errors}");
            assert!(last.contains(&format!("{leaf}/2/3")), "{errors}");
        }
    }
}

/// Every option of one of the two programs without a window, with the other one: it must not be
/// passed over in silence.
#[test]
fn options_of_one_mode_are_refused_in_the_other() {
    let (folder, file) = rmnp();
    let journey: &[&[&str]] = &[
        &["--path", "auto"],
        &["--frames", "frames"],
        &["--metrics", "figures.csv"],
        &["--count", "2"],
        &["--fps", "10"],
        &["--streaming"],
        &["--observe"],
    ];
    let shot: &[&[&str]] = &[&["--eye", "1,1,9000"], &["--target", "2,2,0"], &["--coordinates", "crs"]];
    for (mode, options) in
        [(&["--shot", "a.png"][..], journey), (&["--headless"], shot), (&[], journey), (&[], shot)]
    {
        for option in options {
            let mut command = viewer();
            let (out, errors) =
                run(command.current_dir(folder.path()).arg(&file).args(mode).args(*option), 2);
            assert!(out.is_empty() && errors.contains("--"), "{mode:?} {option:?}: {errors}");
        }
    }
    assert_eq!(fs::read_dir(folder.path()).expect("folder").count(), 1, "something was written");
}

#[test]
fn what_is_there_is_replaced_only_with_a_word() {
    let (folder, file) = rmnp();
    let at = |name: &str| folder.path().join(name);
    for name in ["frames", "later"] {
        fs::create_dir(at(name)).expect("folder");
    }
    for name in ["shot.png", "figures.csv", "frames/000000.png", "later/000002.png"] {
        fs::write(at(name), "precious").expect("write");
    }
    let ours = |args: &[&str], code: i32| {
        let mut command = viewer();
        run(command.current_dir(folder.path()).arg(&file).args(["--size", "64x48"]).args(args), code)
    };
    for (args, name) in [
        (&["--shot", "shot.png"][..], "shot.png"),
        (&["--headless", "--count", "1", "--metrics", "figures.csv"], "figures.csv"),
        (&["--headless", "--count", "1", "--frames", "frames"], "frames/000000.png"),
        (&["--headless", "--count", "3", "--frames", "later"], "later/000002.png"),
    ] {
        let (_, errors) = ours(args, 2);
        assert!(errors.contains(name) && errors.contains("--force"), "{errors}");
        assert_eq!(fs::read(at(name)).expect("still there"), b"precious");
        let (out, _) = ours(&[args, &["--force", "--quiet"]].concat(), 0);
        assert!(out.is_empty(), "{out}");
        assert_ne!(fs::read(at(name)).expect("replaced"), b"precious");
    }
}

#[cfg(unix)]
#[test]
fn what_is_read_is_never_replaced_whatever_it_is_called() {
    use std::os::unix::fs::{MetadataExt, symlink};

    let (folder, file) = rmnp();
    let at = |name: &str| folder.path().join(name);
    // A name that a picture may have.
    fs::rename(&file, at("dem.png")).expect("rename");
    let json = r#"{ "keys": [ { "time": 0, "eye": [70, 150, 9000], "target": [75, 90, 2500] } ] }"#;
    fs::write(at("path.json"), json).expect("path");
    symlink(".", at("folder")).expect("link");
    for (input, end) in [("dem.png", "png"), ("path.json", "json")] {
        fs::hard_link(at(input), at(&format!("hard.{end}"))).expect("link");
        symlink(input, at(&format!("soft.{end}"))).expect("link");
        symlink(format!("soft.{end}"), at(&format!("softer.{end}"))).expect("link");
        for kind in ["hard", "soft"] {
            let frames = at(&format!("{kind}-{end}"));
            fs::create_dir(&frames).expect("folder");
            // The second frame: the first must not be written either.
            let second = frames.join("000001.png");
            match kind {
                "hard" => fs::hard_link(at(input), second).expect("link"),
                _ => symlink(at(input), second).expect("link"),
            }
        }
    }
    let inputs = || {
        let of = |name: &str| {
            let meta = fs::metadata(at(name)).expect("still there");
            (meta.ino(), meta.nlink(), fs::read(at(name)).expect("readable"))
        };
        (of("dem.png"), of("path.json"))
    };
    let before = (inputs(), fs::read_dir(folder.path()).expect("folder").count());
    let refused = |args: &[&str]| {
        for force in [&[][..], &["--force"]] {
            let mut command = viewer();
            command.current_dir(folder.path()).args(["dem.png", "--size", "64x48"]).args(args).args(force);
            let (out, errors) = run(&mut command, 2);
            assert!(out.is_empty() && errors.contains("same file"), "{args:?}: {errors}");
            assert_eq!(errors.lines().count(), 1, "{errors}");
            let after = (inputs(), fs::read_dir(folder.path()).expect("folder").count());
            assert!(after == before, "{args:?} has changed something");
        }
    };
    for name in ["dem.png", "./dem.png", "folder/dem.png", "hard.png", "soft.png", "softer.png"] {
        refused(&["--shot", name]);
        refused(&["--headless", "--count", "1", "--metrics", name]);
    }
    for name in ["path.json", "folder/path.json", "hard.json", "soft.json", "softer.json"] {
        refused(&["--headless", "--count", "1", "--path", "path.json", "--metrics", name]);
        refused(&["--headless", "--count", "1", "--path", name, "--metrics", "path.json"]);
    }
    for frames in ["hard-png", "soft-png", "hard-json", "soft-json"] {
        refused(&["--headless", "--count", "2", "--path", "path.json", "--frames", frames]);
        assert!(!at(frames).join("000000.png").exists(), "{frames}: a frame was written");
    }
}

#[test]
fn a_taller_terrain_stays_in_the_picture() {
    let (folder, file) = rmnp();
    let picture = |name: &str, args: &[&str]| {
        let output = folder.path().join(name);
        let (_, errors) =
            run(viewer().arg(&file).args(["--size", "300x200"]).args(args).arg("--shot").arg(&output), 0);
        (covered(&output), errors)
    };
    // (Much taller than that, the corner that is taken for sky is a mountain in a low flight.)
    for exaggeration in ["1", "5"] {
        let tall = ["--exaggeration", exaggeration];
        let (all, _) = picture(&format!("all-{exaggeration}.png"), &tall);
        assert!((0.05..0.99).contains(&all), "{exaggeration}: {all}");
        let place = ["--eye", "76,150,5000", "--target", "76,92,2500"];
        let (near, _) = picture(&format!("near-{exaggeration}.png"), &[&tall[..], &place].concat());
        assert!(near > 0.3, "{exaggeration}: {near}");
        let mut command = viewer();
        let frames = folder.path().join(format!("frames-{exaggeration}"));
        command.arg(&file).args(["--headless", "--count", "5", "--size", "300x200"]).args(tall);
        run(command.arg("--frames").arg(&frames), 0);
        assert!(
            (0..5).all(|frame| covered(&frames.join(format!("{frame:06}.png"))) > 0.05),
            "{exaggeration}"
        );
    }
    // Below the ground there is nothing to see: the eye is raised, and a message says so.
    let (_, errors) = picture("below.png", &["--eye", "76,93,-500", "--target", "80,20,2500"]);
    assert!(errors.contains("below the ground") && errors.lines().count() == 1, "{errors}");
}

#[test]
fn a_place_may_be_given_in_the_coordinates_of_the_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = fixture(folder.path(), "co_elevation_float32_lzw.tif", 64, 16);
    let reader = Reader::open(&file).expect("open");
    let geo = reader.geo();
    let world = |column: f64, row: f64, height: f64| {
        let (x, y) = geo.world_from_sample(column, row);
        format!("{x},{y},{height}")
    };
    let shot = |name: &str, args: &[&str]| {
        let output = folder.path().join(name);
        run(viewer().arg(&file).args(["--size", "200x150"]).args(args).arg("--shot").arg(&output), 0);
        png(&output).2
    };
    let samples = shot("a.png", &["--eye", "500,600,9000", "--target", "500,300,2000"]);
    let (eye, target) = (world(500.0, 600.0, 9000.0), world(500.0, 300.0, 2000.0));
    for what in ["crs", "lonlat"] {
        let args = ["--coordinates", what, "--eye", &eye, "--target", &target];
        let same = shot(&format!("{what}.png"), &args);
        let unlike = same.iter().zip(&samples).filter(|(a, b)| a.abs_diff(**b) > 8).count();
        assert!(unlike < samples.len() / 100, "{what}: {unlike} bytes of {}", samples.len());
    }
    let projected = common::Hills::new(65).build(folder.path(), 32, 8);
    let mut command = viewer();
    command.current_dir(folder.path()).arg(&projected).args([
        "--shot",
        "x.png",
        "--coordinates",
        "lonlat",
        "--eye",
        "1,2,3",
    ]);
    let (_, errors) = run(&mut command, 2);
    assert!(errors.contains("--coordinates crs"), "{errors}");
}

#[test]
fn rasters_in_the_place_of_terrain_are_named() {
    let dem = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/dem/rmnp_dem_uint16.tif");
    for mode in [&[][..], &["--headless"]] {
        let (_, errors) = run(viewer().arg(&dem).args(mode), 2);
        assert!(errors.contains("a TIFF") && errors.contains("relevo build"), "{errors}");
        assert!(!errors.contains("\x1b["), "{errors:?}");
    }
    let (_, errors) = run(viewer().arg(&dem).args(["--color", "always"]), 2);
    assert!(errors.contains("\x1b[31m"), "{errors:?}");
}
