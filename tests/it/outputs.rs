//! Outputs: never over what is read, under whatever name; and what is refused is refused before the
//! work.

#![cfg(unix)]

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

/// Runs a command, which must come to its end.
fn relevo(folder: &Path, args: &[&str]) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_relevo"))
        .current_dir(folder)
        .args(args)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary runs");
    let begun = Instant::now();
    while child.try_wait().expect("wait").is_none() {
        if begun.elapsed() > Duration::from_secs(60) {
            let _ = child.kill();
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    child.wait_with_output().expect("ends")
}

fn refused(folder: &Path, args: &[&str], words: &[&str]) {
    let output = relevo(folder, args);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{args:?}: {said}");
    assert_eq!(said.lines().count(), 1, "{args:?}: {said}");
    assert!(words.iter().all(|word| said.contains(word)), "{args:?}: {said}");
}

fn done(folder: &Path, args: &[&str]) {
    let output = relevo(folder, args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// Every file of a folder that stands still.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).expect("folder") {
        let path = entry.expect("entry").path();
        if path.is_file() {
            let bytes = fs::read(&path).expect("read");
            all.push((path, bytes));
        } else if path.is_dir() {
            all.extend(contents(&path));
        }
    }
    all.sort();
    all
}

const VRT: &str = r#"<VRTDataset rasterXSize="152" rasterYSize="187"><VRTRasterBand dataType="UInt16" band="1"><SimpleSource>
<SourceFilename relativeToVRT="1">dem.tif</SourceFilename><SourceBand>1</SourceBand>
<SrcRect xOff="0" yOff="0" xSize="152" ySize="187"/><DstRect xOff="0" yOff="0" xSize="152" ySize="187"/></SimpleSource>
</VRTRasterBand></VRTDataset>"#;

#[test]
fn no_output_is_an_input() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    let path = |name: &str| folder.join(name);
    fs::copy(fixture("dem/rmnp_dem_uint16.tif"), path("dem.tif")).expect("copy");
    fs::copy(fixture("imagery/rmnp_rgb.tif"), path("rgb.tif")).expect("copy");
    done(folder, &["build", "dem.tif", "-o", "t.rlv", "--tile", "64"]);
    done(folder, &["build", "dem.tif", "-o", "dem.tif.msk.rlv", "--tile", "64"]);
    for (piece, window) in [("a", "0,0,1,3"), ("b", "1,0,3,3")] {
        done(folder, &["build", "dem.tif", "-o", piece, "--tile", "64", "--window", window]);
    }
    done(folder, &["merge", "a", "b", "-o", "ab.rlv"]);
    fs::write(path("a.vrt"), VRT).expect("write");
    fs::write(path("list"), "dem.tif\n").expect("write");
    fs::copy(path("t.rlv"), path("t.tif")).expect("copy");
    for name in ["dem.tif", "rgb.tif", "a.vrt", "list"] {
        fs::hard_link(path(name), path(&format!("hard {name}.rlv"))).expect("link");
        symlink(name, path(&format!("soft {name}.rlv"))).expect("link");
    }
    fs::create_dir(path("each")).expect("folder");
    fs::copy(path("dem.tif"), path("each/x.rlv")).expect("copy");
    let before = contents(folder);
    let same = ["same file"];
    for output in ["hard dem.tif.rlv", "soft dem.tif.rlv", "./each/../hard dem.tif.rlv"] {
        refused(folder, &["build", "dem.tif", "-o", output, "--force"], &same);
        refused(folder, &["build", "a.vrt", "-o", output, "--force"], &same);
        refused(folder, &["build", "dem.tif", "-o", output, "--force", "--window", "0,0,1,1"], &same);
        refused(folder, &["build", "@list", "-o", output, "--force"], &same);
        refused(folder, &["build", "dem.tif", "-o", output, "--force", "--dry-run"], &same);
    }
    for kind in ["hard", "soft"] {
        let [vrt, list, rgb] = ["a.vrt", "list", "rgb.tif"].map(|name| format!("{kind} {name}.rlv"));
        refused(folder, &["build", "a.vrt", "-o", &vrt, "--force"], &same);
        refused(folder, &["build", "@list", "-o", &list, "--force"], &same);
        refused(folder, &["build", "dem.tif", "--imagery", "rgb.tif", "-o", &rgb, "--force"], &same);
    }
    // Their own names are not those of a container, besides.
    for output in ["dem.tif", "a.vrt", "list"] {
        refused(folder, &["build", "a.vrt", "@list", "-o", output, "--force"], &[]);
    }
    refused(folder, &["build", "each/x.rlv", "--each", "each", "--force"], &same);
    refused(folder, &["export", "t.tif", "-o", "t.tif", "--force"], &same);
    refused(folder, &["export", "t.tif", "--tile", "0/0/0", "-o", "t.tif", "--force"], &same);
    refused(folder, &["merge", "a", "b", "-o", "a", "--force"], &[]);
    refused(folder, &["merge", "a", "b", "-o", "a/records", "--force"], &[]);
    assert!(contents(folder) == before, "something was written or removed");
}

#[test]
fn what_cannot_be_written_is_refused_before_the_work() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    fs::copy(fixture("dem/rmnp_dem_uint16.tif"), folder.join("dem.tif")).expect("copy");
    symlink("nowhere/at/all", folder.join("link.rlv")).expect("link");
    for force in [&[][..], &["--force"]] {
        refused(folder, &[&["build", "dem.tif", "-o", "link.rlv"][..], force].concat(), &["leads nowhere"]);
    }
    done(folder, &["build", "dem.tif", "-o", "t.rlv"]);
    symlink("nowhere/at/all", folder.join("link.tif")).expect("link");
    refused(folder, &["export", "t.rlv", "-o", "link.tif", "--force"], &["leads nowhere"]);
    // The size of the raster is too much for an index of blocks.
    let sparse = fixture("failing/rlv-sparse-2p24.rlv");
    let sparse = sparse.to_str().expect("a name");
    done(folder, &["export", sparse, "-o", "sparse.tif", "--compress", "zstd"]);
    let file = fs::metadata(folder.join("sparse.tif")).expect("file");
    assert!(file.len() < 80 << 20, "{}", file.len());
    let left: Vec<_> = contents(folder)
        .into_iter()
        .filter(|(path, _)| path.extension().is_some_and(|e| e == "part"))
        .collect();
    assert!(left.is_empty());
}

#[test]
fn pipes_and_devices_are_no_files() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    fs::copy(fixture("dem/rmnp_dem_uint16.tif"), folder.join("dem.tif")).expect("copy");
    done(folder, &["build", "dem.tif", "-o", "t.rlv"]);
    for pipe in ["pipe", "pipe.rlv"] {
        assert!(Command::new("mkfifo").arg(folder.join(pipe)).status().expect("mkfifo runs").success());
    }
    for file in ["pipe", "/dev/zero"] {
        for args in [
            &["build", file, "-o", "x.rlv"][..],
            &["info", file],
            &["stats", file],
            &["verify", file],
            &["export", file, "-o", "x.tif"],
        ] {
            refused(folder, args, &["pipe or a device"]);
        }
        refused(folder, &["verify", "t.rlv", "--source", file], &["pipe or a device"]);
        refused(folder, &["build", "dem.tif", "--imagery", file, "-o", "x.rlv"], &["pipe or a device"]);
    }
    refused(folder, &["build", "@/dev/zero", "-o", "x.rlv"], &["list of files", "67108864"]);
    refused(folder, &["build", "dem.tif", "-o", "pipe.rlv", "--force"], &["no regular file"]);
}

#[test]
fn a_thousand_threads_cost_little() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    fs::copy(fixture("dem/rmnp_dem_uint16.tif"), folder.join("dem.tif")).expect("copy");
    let begun = Instant::now();
    done(folder, &["build", "dem.tif", "-o", "t.rlv", "--jobs", "1024", "--tile", "16", "--patch", "4"]);
    assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
}

#[test]
fn few_files_may_be_open() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    let geo = |x: u32| relevo::geo::Geo {
        transform: Some([f64::from(x) * 4.0, 1.0, 0.0, 0.0, 0.0, -1.0]),
        ..relevo::geo::Geo::default()
    };
    let mut list = String::new();
    for x in 0..120 {
        let (geo, name) = (geo(x), format!("{x}.tif"));
        let spec = relevo::geotiff_write::GeotiffSpec::new(4, 40, relevo::sample::SampleType::Int16, &geo);
        let mut writer =
            relevo::geotiff_write::GeotiffWriter::create(folder.join(&name), &spec).expect("create");
        writer.write_rows(&relevo::source::Samples::Int16((0..160).collect())).expect("rows");
        writer.finish().expect("file");
        list.push_str(&name);
        list.push('\n');
    }
    fs::write(folder.join("list"), list).expect("write");
    let build = |limit: u32| {
        let binary = env!("CARGO_BIN_EXE_relevo");
        let script = format!(
            "ulimit -n {limit}; exec '{binary}' build @list -o {limit}.rlv --tile 16 --patch 4 --checkpoint 0"
        );
        let output =
            Command::new("bash").current_dir(folder).args(["-c", &script]).output().expect("bash runs");
        assert!(output.status.success(), "{limit}: {}", String::from_utf8_lossy(&output.stderr));
        fs::read(folder.join(format!("{limit}.rlv"))).expect("file")
    };
    assert!(build(64) == build(1000));
}

#[test]
fn imagery_is_not_laid_over_another_terrain() {
    use relevo::limits::Limits;
    use relevo::pipeline::imagery::{LayerOptions, add};
    use relevo::pipeline::{Progress, Stage};
    use relevo::source::picture::{PictureOptions, open_all};

    /// Puts another file in the place of the one that is worked on, once its imagery is being
    /// written.
    struct Replace(PathBuf, PathBuf);
    impl Progress for Replace {
        fn report(&self, stage: Stage, _: u64, _: u64) {
            if stage == Stage::Write && self.1.exists() {
                fs::rename(&self.1, &self.0).expect("rename");
            }
        }
    }
    let folder = tempfile::tempdir().expect("folder");
    let path = |name: &str| folder.path().join(name);
    fs::copy(fixture("dem/rmnp_dem_uint16.tif"), path("dem.tif")).expect("copy");
    done(folder.path(), &["build", "dem.tif", "-o", "t.rlv", "--tile", "64"]);
    done(folder.path(), &["build", "dem.tif", "-o", "other.rlv", "--tile", "32"]);
    let other = fs::read(path("other.rlv")).expect("read");
    let pictures = [fixture("imagery/rmnp_rgb.tif")];
    let open =
        |crs: &relevo::geo::Crs| open_all(&pictures, &PictureOptions::default(), crs, &Limits::default());
    let replace = Replace(path("t.rlv"), path("other.rlv"));
    let added = add(&path("t.rlv"), &open, &LayerOptions::default(), Some(1), None, &replace);
    let message = added.expect_err("replaced").to_string();
    assert!(message.contains("has been replaced"), "{message}");
    assert!(fs::read(path("t.rlv")).expect("read") == other && !path("t.rlv.work").exists());
}

#[test]
fn what_is_built_of_odd_inputs_is_good() {
    let folder = tempfile::tempdir().expect("folder");
    let mut built = 0;
    for entry in fs::read_dir(fixture("failing")).expect("fixtures") {
        let path = entry.expect("entry").path();
        let (Some(input), Some(name)) = (path.to_str(), path.file_name().and_then(|name| name.to_str()))
        else {
            continue;
        };
        // Metres that are called degrees: built with a warning, and `verify` says so once more.
        let contradicts = name == "crs-mosaic-epsg4326-east.tif";
        let is_dem = [".tif", ".vrt"].iter().any(|end| name.ends_with(end));
        if !is_dem || contradicts || fs::metadata(&path).expect("size").len() > 100_000 {
            continue;
        }
        let args = ["build", input, "-o", "a.rlv", "--force", "--quiet"];
        if relevo(folder.path(), &args).status.success() {
            built += 1;
            let said = relevo(folder.path(), &["verify", "a.rlv", "--source", input]);
            assert!(said.status.success(), "{name}: {}", String::from_utf8_lossy(&said.stdout));
        }
    }
    assert!(built > 15, "{built} were built");
}
