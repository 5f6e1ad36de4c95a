//! What `--json` prints, held against docs/json.md field by field.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// A field as the page describes it.
#[derive(Clone, Debug)]
struct Field {
    /// `integer`, `list of object level`.
    kind: String,
    nullable: bool,
    optional: bool,
}

type Section = BTreeMap<String, Field>;

/// The tables of the page by the names of their sections.
fn page() -> BTreeMap<String, Section> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/json.md");
    let text = fs::read_to_string(path).expect("the page");
    let mut sections: BTreeMap<String, Section> = BTreeMap::new();
    let mut current = String::new();
    for line in text.lines() {
        if let Some(title) = line.strip_prefix("## ") {
            current = title.replace('`', "");
            sections.entry(current.clone()).or_default();
        }
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let [name, kind, _unit, meaning] = cells[..] else { continue };
        let Some(name) = name.strip_prefix('`').and_then(|name| name.strip_suffix('`')) else { continue };
        assert!(!meaning.is_empty(), "{current}, {name}: no meaning");
        let optional = kind.starts_with('(');
        let kind = kind.trim_matches(['(', ')']);
        let field =
            Field { kind: kind.trim_end_matches('?').into(), nullable: kind.ends_with('?'), optional };
        let before = sections.get_mut(&current).expect("a section").insert(name.to_owned(), field);
        assert!(before.is_none(), "{current}, {name}: twice");
    }
    // What is built says the same wherever it is told.
    let built = sections["build"].clone();
    for (name, without) in [("merge", &["sources"][..]), ("Object batch", &[])] {
        let section = sections.get_mut(name).expect("a section");
        for (field, description) in built.iter().filter(|(field, _)| !without.contains(&field.as_str())) {
            let optional = name != "merge" || description.optional;
            section.entry(field.clone()).or_insert(Field { optional, ..description.clone() });
        }
    }
    sections
}

/// Fails unless a value is of a kind.
fn check(value: &Value, kind: &str, place: &str, page: &BTreeMap<String, Section>) {
    if let Some(of) = kind.strip_prefix("list of ") {
        let list = value.as_array().unwrap_or_else(|| panic!("{place}: {value} is no list"));
        list.iter().enumerate().for_each(|(i, one)| check(one, of, &format!("{place}[{i}]"), page));
    } else if kind == "texts by name" {
        let fields = value.as_object().unwrap_or_else(|| panic!("{place}: {value} is no object"));
        fields.iter().for_each(|(name, text)| check(text, "text", &format!("{place}.{name}"), page));
    } else if let Some(name) = kind.strip_prefix("object ") {
        let fields = value.as_object().unwrap_or_else(|| panic!("{place}: {value} is no object"));
        // The specification describes it.
        if name != "metadata" {
            check_object(fields, &format!("Object {name}"), place, page);
        }
    } else {
        let is = kind.split(" or ").any(|kind| match kind {
            "text" => value.is_string(),
            "integer" => value.is_u64() || value.is_i64(),
            "number" => value.is_number(),
            "boolean" => value.is_boolean(),
            other => panic!("{place}: the page has no kind {other}"),
        });
        assert!(is, "{place}: {value} is not {kind}");
    }
}

/// Fails unless an object has the fields of a section, and no others.
fn check_object(
    fields: &serde_json::Map<String, Value>,
    section: &str,
    place: &str,
    page: &BTreeMap<String, Section>,
) {
    let described = page.get(section).unwrap_or_else(|| panic!("the page has no section {section}"));
    for (name, value) in fields {
        let place = format!("{place}.{name}");
        let field = described.get(name).unwrap_or_else(|| panic!("{place} is not on the page ({section})"));
        if value.is_null() {
            assert!(field.nullable, "{place} is null");
        } else {
            check(value, &field.kind, &place, page);
        }
    }
    for (name, field) in described {
        assert!(field.optional || fields.contains_key(name), "{place}: no {name}");
    }
}

/// Runs the program in a folder; what it prints.
fn run(folder: &Path, code: i32, args: &[&str]) -> Value {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relevo"));
    let output = command.current_dir(folder).args(args).output().expect("the binary runs");
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {told}");
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{args:?}: {error}: {told}"))
}

/// Fails unless an object of a command is as its section says.
fn check_command(value: &Value, command: &str, page: &BTreeMap<String, Section>) {
    assert_eq!(value["command"], command);
    let fields = value.as_object().expect("an object");
    let mut page = page.clone();
    let head = page["Every command"].clone();
    page.get_mut(command).expect("a section").extend(head);
    check_object(fields, command, command, &page);
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

#[test]
fn every_field_of_every_command_is_on_the_page() {
    let page = page();
    let folder = tempfile::tempdir().expect("folder");
    let at = folder.path();
    for (name, from) in [("f.tif", "dem/co_elevation_float32_lzw.tif"), ("u.tif", "dem/rmnp_dem_uint16.tif")]
    {
        fs::copy(fixture(from), at.join(name)).expect("copy");
    }
    for dem in ["f", "u"] {
        let (tif, rlv) = (format!("{dem}.tif"), format!("{dem}.rlv"));
        check_command(&run(at, 0, &["build", &tif, "--dry-run", "--json"]), "build --dry-run", &page);
        check_command(&run(at, 0, &["build", &tif, "--json"]), "build", &page);
        let info = run(at, 0, &["info", &rlv, "--json"]);
        check_command(&info[0], "info", &page);
        check_command(&run(at, 0, &["stats", &rlv, "--json"]), "stats", &page);
        check_command(&run(at, 0, &["verify", &rlv, "--source", &tif, "--json"]), "verify", &page);
    }
    check_command(&run(at, 0, &["verify", "u.rlv", "--deep", "--json"]), "verify", &page);
    check_command(&run(at, 1, &["verify", "u.rlv", "--source", "f.tif", "--json"]), "verify", &page);
    let head =
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n";
    let faces =
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n9 0 0\n0 9 0\n3 0 1 2\n";
    fs::write(at.join("m.ply"), format!("{head}{faces}")).expect("file");
    for source in ["u.tif", "u.rlv"] {
        let mesh = run(at, 1, &["verify", "m.ply", "--source", source, "--frame", "pixel", "--json"]);
        check_command(&mesh, "verify MESH", &page);
    }
    let mesh = run(at, 0, &["mesh", "u.rlv", "--max-error", "20m", "-o", "u.glb", "--json"]);
    check_command(&mesh, "mesh", &page);
    check_command(&run(at, 0, &["verify", "u.glb", "--source", "u.tif", "--json"]), "verify MESH", &page);
    let mut bytes = fs::read(at.join("f.rlv")).expect("file");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(at.join("bad.rlv"), bytes).expect("file");
    check_command(&run(at, 1, &["verify", "bad.rlv", "--json"]), "verify", &page);
    fs::write(at.join("words.tif"), "no raster").expect("file");
    let each = ["build", "--each", "out", "f.tif", "words.tif", "--json"];
    check_command(&run(at, 2, &each), "build --each", &page);
    check_command(&run(at, 2, &[&each[..], &["--resume"]].concat()), "build --each", &page);
    for (window, piece) in [("0,0,2,3", "west"), ("2,0,4,3", "east")] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relevo"));
        let args = ["build", "f.tif", "--window", window, "-o", piece];
        assert!(command.current_dir(at).args(args).status().expect("runs").success());
    }
    let merged = run(at, 0, &["merge", "west", "east", "-o", "merged.rlv", "--json"]);
    check_command(&merged, "merge", &page);
}

#[test]
fn imagery_is_on_the_page() {
    let page = page();
    let folder = tempfile::tempdir().expect("folder");
    let at = folder.path();
    fs::copy(fixture("dem/rmnp_dem_uint16.tif"), at.join("u.tif")).expect("copy");
    fs::copy(fixture("imagery/rmnp_rgb.tif"), at.join("rgb.tif")).expect("copy");
    check_command(&run(at, 0, &["build", "u.tif", "--imagery", "rgb.tif", "--json"]), "build", &page);
    check_command(&run(at, 0, &["add", "u.rlv", "--imagery", "rgb.tif", "--json"]), "add", &page);
    check_command(&run(at, 0, &["info", "u.rlv", "--json"])[0], "info", &page);
}

#[test]
fn progress_is_on_the_page() {
    let page = page();
    let folder = tempfile::tempdir().expect("folder");
    fs::copy(fixture("dem/rmnp_dem_uint16.tif"), folder.path().join("u.tif")).expect("copy");
    let mut command = Command::new(env!("CARGO_BIN_EXE_relevo"));
    let args = ["build", "u.tif", "--progress", "json", "--precision", "0.5"];
    let output = command.current_dir(folder.path()).args(args).output().expect("runs");
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(told.lines().count() >= 3, "{told}");
    for line in told.lines() {
        let event: Value = serde_json::from_str(line).expect("JSON");
        check_object(event.as_object().expect("an object"), "Progress", "progress", &page);
    }
}

#[test]
fn a_name_means_the_same_type_in_every_section() {
    let base = |kind: &str| match kind.split(' ').next() {
        Some("list") => "list".to_owned(),
        Some("object") => "object".to_owned(),
        // A number that is written as a text where JSON has none is a number.
        Some("number") => "number".to_owned(),
        _ => kind.to_owned(),
    };
    let mut kinds: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for section in page().values() {
        for (name, field) in section {
            kinds.entry(name.clone()).or_default().insert(base(&field.kind));
        }
    }
    let unlike: Vec<_> = kinds.iter().filter(|(_, kinds)| kinds.len() > 1).collect();
    assert!(unlike.is_empty(), "{unlike:?}");
}
