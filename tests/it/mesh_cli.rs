//! `relevo mesh` and `relevo verify MESH` on real terrain, as a user types them.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use relevo::mesh_file;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem").join(name)
}

fn relevo(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_relevo")).current_dir(folder).args(args).output().unwrap()
}

/// Runs a command that must succeed, and gives what it prints.
fn done(folder: &Path, args: &[&str]) -> String {
    let output = relevo(folder, args);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{args:?}: {text}{}", String::from_utf8_lossy(&output.stderr));
    text
}

/// Runs a command that must be refused, and gives the message, its line breaks left out.
fn refused(folder: &Path, args: &[&str]) -> String {
    let output = relevo(folder, args);
    assert_eq!(output.status.code(), Some(2), "{args:?}");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

const CO: &str = "co_elevation_float32_lzw.tif";
const RMNP: &str = "rmnp_dem_uint16.tif";

#[test]
fn every_format_keeps_its_promise_on_real_terrain() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for name in [CO, RMNP] {
        std::fs::copy(fixture(name), at.join(name)).unwrap();
    }
    for dem in [CO, RMNP] {
        done(at, &["build", dem, "-o", "terrain.rlv", "--force"]);
        for mesh in ["a.glb", "a.ply", "a.obj", "a.stl"] {
            for (error, method) in [("300cm", "nested"), ("30", "tin")] {
                let how = ["--max-error", error, "--method", method];
                done(at, &[&["mesh", "terrain.rlv", "-o", mesh, "--force"], &how[..]].concat());
                let frame: &[&str] =
                    if mesh == "a.stl" { &["--frame", "local", "--max-error", error] } else { &[] };
                for source in ["terrain.rlv", dem] {
                    done(at, &[&["verify", mesh, "--source", source], frame].concat());
                }
            }
        }
        // Held to less than it promises it fails.
        let less = relevo(at, &["verify", "a.glb", "--source", dem, "--max-error", "20m"]);
        assert_eq!(less.status.code(), Some(1));
    }
}

#[test]
fn meshes_of_dems_and_of_parts_are_those_of_files() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::copy(fixture(CO), at.join("dem.tif")).unwrap();
    done(at, &["build", "dem.tif"]);
    done(at, &["mesh", "dem.tif", "--max-error", "20", "-o", "of_dem.ply", "--jobs", "1"]);
    done(at, &["mesh", "dem.rlv", "--max-error", "20", "-o", "of_file.ply", "--jobs", "3"]);
    let bytes = |name: &str| std::fs::read(at.join(name)).unwrap();
    assert!(bytes("of_dem.ply") == bytes("of_file.ply"), "another mesh");
    let part = ["--srcwin", "100,70,300,211", "--max-error", "20"];
    for more in [&["--method", "nested"][..], &["--frame", "crs"], &["--up", "y"]] {
        done(at, &[&["mesh", "dem.rlv", "-o", "part.ply", "--force"], &part[..], more].concat());
        let up = if more == ["--up", "y"] { more } else { &[] };
        let told = done(at, &[&["verify", "part.ply", "--source", "dem.tif"], up].concat());
        assert!(told.contains("300 x 211 samples from column 100"), "{told}");
        let json = done(at, &[&["verify", "part.ply", "--source", "dem.tif", "--json"], up].concat());
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!(json["frame"], if more.contains(&"crs") { "crs" } else { "local" });
    }
    done(
        at,
        &["mesh", "dem.rlv", "--quantize", "-o", "part.glb", "--srcwin", "0,0,300,211", "--max-error", "20"],
    );
    done(at, &["verify", "part.glb", "--source", "dem.tif"]);
    let whole = mesh_file::read(&at.join("of_file.ply"), None).unwrap();
    let crs = mesh_file::read(&at.join("part.ply"), None).unwrap();
    assert!(crs.triangles.len() < whole.triangles.len());
    let left: Vec<_> = std::fs::read_dir(at).unwrap().map(|file| file.unwrap().file_name()).collect();
    assert_eq!(left.len(), 6, "{left:?}");
}

#[test]
fn a_number_of_triangles_is_kept_and_nearly_used() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::copy(fixture(CO), at.join("dem.tif")).unwrap();
    done(at, &["build", "dem.tif"]);
    let mut before = f64::INFINITY;
    for most in [500_u64, 10_000, 200_000, 2_000_000] {
        let (triangles, method) = (most.to_string(), if most == 500 { "tin" } else { "nested" });
        let how = ["--triangles", &triangles, "--method", method, "-f", "--json"];
        let told = done(at, &[&["mesh", "dem.rlv", "-o", "m.ply"], &how[..]].concat());
        let told: serde_json::Value = serde_json::from_str(&told).unwrap();
        let (count, promised) = (told["triangles"].as_u64().unwrap(), told["promised_m"].as_f64().unwrap());
        let all = 2 * 1006 * 632;
        assert!(count <= most && count as f64 > 0.9 * most.min(all) as f64, "{count} of {most}");
        assert!(promised < before, "{promised} m with {count}, {before} m with fewer");
        before = promised;
        done(at, &["verify", "m.ply", "--source", "dem.tif"]);
    }
    assert!(before < 1e-9, "{before} m with all triangles");
    assert!(refused(at, &["mesh", "dem.rlv", "--triangles", "1", "-o", "m.ply", "-f"]).contains("coarsest"));
}

#[test]
fn what_makes_no_sense_is_refused_with_a_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::copy(fixture(RMNP), at.join("dem.tif")).unwrap();
    done(at, &["build", "dem.tif", "--precision", "2"]);
    let mesh = |args: &[&str]| refused(at, &[&["mesh"], args].concat());
    let error = ["--max-error", "2"];
    assert!(mesh(&["dem.rlv", "-o", "a.fbx", "--max-error", "2"]).contains(".glb, .obj, .ply or .stl"));
    let rounded = mesh(&["dem.rlv", "-o", "a.glb", "--max-error", "50cm"]);
    assert!(rounded.contains("rounded to within 1 m") && rounded.contains("larger error"), "{rounded}");
    assert!(mesh(&[&["dem.rlv", "dem.tif", "-o", "a.glb"], &error[..]].concat()).contains("only input"));
    assert!(mesh(&[&["dem.rlv", "-o", "a.glb", "--nodata", "3"], &error[..]].concat()).contains("--nodata"));
    assert!(
        mesh(&[&["dem.rlv", "-o", "a.glb", "--srcwin", "5,5,1,9"], &error[..]].concat()).contains("2 x 2")
    );
    assert!(mesh(&[&["dem.rlv", "-o", "a.ply", "--quantize"], &error[..]].concat()).contains("GLB"));
    assert!(mesh(&[&["dem.rlv", "-o", "a.glb", "--up", "z"], &error[..]].concat()).contains("y is up"));
    assert!(mesh(&[&["dem.rlv", "-o", "a.stl", "--frame", "crs"], &error[..]].concat()).contains("PLY"));
    for length in ["2 parsecs", "-1", "nan", "2mmm", ""] {
        refused(at, &["mesh", "dem.rlv", "-o", "a.glb", &format!("--max-error={length}")]);
    }
    let memory = mesh(&[&["dem.rlv", "-o", "a.glb", "--memory", "64MiB"], &error[..]].concat());
    assert!(memory.contains("nested mesh") && memory.contains("MiB"), "{memory}");
    let nested = ["mesh", "dem.rlv", "--memory", "64MiB", "--method", "nested", "-o", "n.glb"];
    assert!(done(at, &[&nested[..], &error].concat()).contains("not been checked"));
    assert!(mesh(&[&["dem.rlv", "-o", "nowhere/a.glb"], &error[..]].concat()).contains("no such folder"));
    std::fs::write(at.join("a.glb"), "something else").unwrap();
    assert!(mesh(&[&["dem.rlv", "-o", "a.glb"], &error[..]].concat()).contains("--force"));
    assert_eq!(std::fs::read(at.join("a.glb")).unwrap(), b"something else");
}
