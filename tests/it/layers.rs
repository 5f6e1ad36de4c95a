//! The order of the modules of this crate: each knows those before it, so that data flows one way.
//! The crates keep the rest: `relevo-core` knows no raster, no thread pool and no command line.

use std::fs;
use std::path::{Path, PathBuf};

/// Modules that may know those in lines above their own, and themselves.
const LAYERS: [&[&str]; 8] = [
    &["file", "mesh_file", "progress", "rect"],
    &["source"],
    &["tile", "work_folder"],
    &["patch", "imagery", "writer"],
    &["pipeline", "geotiff_write", "hillshade"],
    &["build"],
    &["verify", "export", "mesh"],
    &["cli", "main"],
];

fn files(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("folder") {
        let path = entry.expect("entry").path();
        if path.is_dir() { files(&path, out) } else { out.push(path) }
    }
}

fn layer(module: &str) -> Option<usize> {
    LAYERS.iter().position(|layer| layer.contains(&module))
}

#[test]
fn modules_know_only_those_of_lower_layers() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut sources = Vec::new();
    files(&root, &mut sources);
    for path in sources.iter().filter(|path| !path.ends_with("lib.rs")) {
        let inside = path.strip_prefix(&root).expect("inside src").with_extension("");
        let own = inside.iter().next().expect("name").to_string_lossy().into_owned();
        let mine = layer(&own).unwrap_or_else(|| panic!("{own} has no layer"));
        let text = fs::read_to_string(path).expect("source file");
        let code = text.split("#[cfg(test)]\nmod").next().unwrap_or_default();
        let lines = code.lines().filter(|line| !line.trim_start().starts_with("//"));
        for known in lines.flat_map(|line| line.split("crate::").skip(1).collect::<Vec<_>>()) {
            let known = known.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default();
            let is_lower = layer(known).is_none_or(|other| other < mine || known == own);
            assert!(is_lower || own == "cli", "{}: it knows {known}, which is not below it", path.display());
        }
    }
}
