//! The import order of the modules: a module imports only from lower layers, so that data flows one way.

#![expect(clippy::expect_used, reason = "a test that cannot go on says why")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Layer of each top module of the library; see ARCHITECTURE.md.
const LAYERS: [(&str, u8); 28] = [
    ("error", 0),
    ("file", 0),
    ("output", 0),
    ("error_code", 0),
    ("limits", 0),
    ("gaps", 0),
    ("geo", 0),
    ("sample", 0),
    ("simd", 0),
    ("states", 0),
    ("texel", 0),
    ("text", 0),
    ("source", 1),
    ("tile", 2),
    ("codec", 2),
    ("patch", 3),
    ("imagery", 3),
    ("container", 4),
    ("pipeline", 5),
    ("select", 5),
    ("surface", 5),
    ("geotiff_write", 5),
    ("hillshade", 5),
    ("verify", 6),
    ("export", 6),
    ("observed", 6),
    ("cli", 7),
    ("main", 7),
];

/// Pairs that must not know each other, or only in this direction, whatever their layers.
const APART: [(&str, &str); 4] = [
    ("container", "source"),
    ("codec", "tile"),
    ("container::writer", "reader"),
    ("container::reader", "writer"),
];

fn files(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("folder") {
        let path = entry.expect("entry").path();
        if path.is_dir() {
            files(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

/// `src/container/reader.rs` -> `container::reader`.
fn module(root: &Path, file: &Path) -> String {
    let relative = file.strip_prefix(root).expect("inside src").with_extension("");
    let parts: Vec<_> = relative.iter().map(|p| p.to_string_lossy().into_owned()).collect();
    parts.join("::").trim_end_matches("::mod").to_owned()
}

/// Modules named after `crate::` outside tests, comments and the crate's own re-exports.
fn imports(text: &str) -> Vec<String> {
    let code = text.split("#[cfg(test)]\nmod").next().unwrap_or(text);
    let lines = code.lines().filter(|line| !line.trim_start().starts_with("//"));
    lines
        .flat_map(|line| line.split("crate::").skip(1).map(str::to_owned).collect::<Vec<_>>())
        .map(|rest| rest.chars().take_while(|c| c.is_alphanumeric() || matches!(c, '_' | ':')).collect())
        .collect()
}

#[test]
fn modules_import_only_lower_layers() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let layers: BTreeMap<_, _> = LAYERS.into_iter().collect();
    let mut sources = Vec::new();
    files(&root, &mut sources);
    let mut wrong = Vec::new();
    for file in sources {
        let name = module(&root, &file);
        let top = name.split("::").next().unwrap_or(&name).to_owned();
        if matches!(top.as_str(), "lib" | "main" | "cli") || name.ends_with("tests") {
            continue;
        }
        let layer = *layers.get(top.as_str()).unwrap_or_else(|| panic!("{top} has no layer in {}", file!()));
        let text = fs::read_to_string(&file).expect("source file");
        for import in imports(&text) {
            let target = import.split("::").next().unwrap_or_default();
            let Some(&other) = layers.get(target) else { continue };
            let same = target == top;
            if !same && other >= layer && layer > 0 || layer == 0 && other > 0 {
                wrong.push(format!("{name} (layer {layer}) imports {import} (layer {other})"));
            }
            for (from, to) in APART {
                if name.starts_with(from) && import.split("::").any(|part| part == to) {
                    wrong.push(format!("{name} imports {import}: these two are to stay apart"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
