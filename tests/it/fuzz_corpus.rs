//! The corpus of the fuzzers as ordinary cases: every input runs through its target
//! (`fuzz/README.md`).

use std::fs;
use std::path::Path;

#[path = "../../fuzz/targets.rs"]
#[allow(clippy::pedantic, missing_docs)]
mod targets;

/// Runs all inputs of a target; the names of files are those of a failure.
fn run(target: &str, body: fn(&[u8])) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(target);
    let mut count = 0;
    for entry in fs::read_dir(&folder).expect("fuzz/corpus") {
        let path = entry.expect("entry").path();
        println!("{}", path.display());
        body(&fs::read(&path).expect("input"));
        count += 1;
    }
    assert!(count > 0, "no input of {target}");
}

#[test]
fn containers() {
    run("container", targets::container);
}

#[test]
fn tiles() {
    run("tiles", targets::tiles);
}

#[test]
fn imagery() {
    run("imagery", targets::imagery);
}

#[test]
fn tiffs() {
    run("tiff", targets::tiff);
}

#[test]
fn virtual_rasters() {
    run("vrt", targets::vrt);
}

#[test]
fn work_folders() {
    run("work", targets::work);
}

#[test]
fn meshes() {
    run("meshes", targets::meshes);
}
