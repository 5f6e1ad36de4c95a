//! Comments are wrapped: no line of one has more than 100 columns, but for rows of tables.

use std::fs;
use std::path::{Path, PathBuf};

/// Columns of a line of a comment, at most; `rustfmt.toml` says the same of code, with a few more.
const COLUMNS: usize = 100;

fn files(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("folder") {
        let path = entry.expect("entry").path();
        if path.is_dir() {
            files(&path, out);
        } else if path.extension().is_some_and(|end| end == "rs") {
            out.push(path);
        }
    }
}

#[test]
fn comments_are_wrapped() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut sources = Vec::new();
    for folder in ["src", "core", "viewer", "tests", "benches", "examples", "fuzz/fuzz_targets"] {
        files(&root.join(folder), &mut sources);
    }
    sources.push(root.join("fuzz/targets.rs"));
    assert!(sources.len() > 300, "{} files", sources.len());
    let mut wide = Vec::new();
    for path in sources {
        for (number, line) in fs::read_to_string(&path).expect("source").lines().enumerate() {
            let text = line.trim_start();
            let is_table = text.trim_start_matches(['/', '!']).trim_start().starts_with('|');
            if text.starts_with("//") && !is_table && line.chars().count() > COLUMNS {
                wide.push(format!("{}:{}", path.display(), number + 1));
            }
        }
    }
    assert!(wide.is_empty(), "wider than {COLUMNS} columns:\n{}", wide.join("\n"));
}
