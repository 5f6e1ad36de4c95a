//! Text of files on its way to a terminal: no command lets through what moves a cursor, changes a
//! colour, turns letters round, or makes a line of its own.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// What no stream may have.
fn is_unfit(letter: char) -> bool {
    (letter.is_control() && letter != '\n' && letter != '\t')
        || matches!(letter, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/failing").join(name)
}

fn relevo(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_relevo"))
        .current_dir(folder)
        .args(args)
        .output()
        .expect("the binary runs")
}

/// Runs a command, and looks at all it says.
fn is_plain(folder: &Path, args: &[&str]) -> Output {
    let output = relevo(folder, args);
    for (stream, bytes) in [("stdout", &output.stdout), ("stderr", &output.stderr)] {
        let text = String::from_utf8(bytes.clone()).expect("text");
        let unfit: Vec<char> = text.chars().filter(|&letter| is_unfit(letter)).collect();
        assert!(unfit.is_empty(), "{args:?}, {stream}: {unfit:?} in {text:?}");
    }
    output
}

#[test]
fn commands_say_nothing_that_a_terminal_obeys() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    // A name that clears the screen, turns the letters behind it round and forges a line.
    let name = "a\u{1b}[2J\u{202e}b\u{9b}31m\nrelevo: all is good";
    let mut files = vec!["gone".to_owned()];
    for (number, fixed) in
        ["tiff-escape-codes.tif", "rlv-escape-codes.rlv", "vrt-forged-message.vrt"].iter().enumerate()
    {
        let extension = fixed.rsplit('.').next().expect("extension");
        let plain = format!("{number}.{extension}");
        fs::copy(fixture(fixed), folder.join(&plain)).expect("copy");
        files.push(plain);
        if cfg!(unix) {
            let hostile = format!("{number}{name}.{extension}");
            fs::copy(fixture(fixed), folder.join(&hostile)).expect("copy");
            files.push(hostile);
        }
    }
    for file in &files {
        let built = is_plain(folder, &["build", file, "-o", "out.rlv", "--force"]);
        is_plain(folder, &["build", file, "-o", "out.rlv", "--dry-run"]);
        is_plain(folder, &["build", file, "--dry-run", "--json"]);
        is_plain(folder, &["build", file, "-o", "out.rlv", "--force", "--json"]);
        is_plain(folder, &["build", file, "--each", "each", "--progress", "json"]);
        is_plain(folder, &["build", &format!("@{file}"), "-o", "x.rlv"]);
        is_plain(folder, &["merge", file, "-o", "merged.rlv"]);
        is_plain(folder, &["add", "out.rlv", "--imagery", file]);
        let target = if built.status.success() { "out.rlv" } else { file };
        for target in [target, file] {
            for json in [&[][..], &["--json"]] {
                is_plain(folder, &[&["info", target][..], json].concat());
                is_plain(folder, &[&["stats", target][..], json].concat());
                is_plain(folder, &[&["verify", target, "--source", file][..], json].concat());
            }
            is_plain(folder, &["stats", target, "--csv"]);
            is_plain(folder, &["export", target, "-o", "out.tif", "--force"]);
            is_plain(folder, &["export", target, "-o", &format!("{file}/out.tif")]);
        }
    }
    // Every line of a message begins as ours do.
    for file in files.iter().filter(|file| file.contains('\n')) {
        let said = relevo(folder, &["info", &format!("{file}.gone")]).stderr;
        assert!(String::from_utf8_lossy(&said).lines().count() == 1);
    }
}

#[cfg(unix)]
#[test]
fn names_that_are_no_unicode_are_names() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::tempdir().expect("folder");
    let name = |extension: &str| {
        let mut name = b"d\xe4m.".to_vec();
        name.extend_from_slice(extension.as_bytes());
        folder.path().join(OsStr::from_bytes(&name))
    };
    let dem = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem/rmnp_dem_uint16.tif");
    if fs::copy(&dem, name("tif")).is_err() {
        // Some file systems have no such names.
        return;
    }
    let run = |args: &[&OsStr]| {
        let output = Command::new(env!("CARGO_BIN_EXE_relevo")).args(args).output().expect("the binary runs");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success() && !said.contains("panicked"), "{args:?}: {said}");
        output.stdout
    };
    let (tif, rlv, each) = (name("tif"), name("rlv"), name("each"));
    let [tif, rlv, each] = [&tif, &rlv, &each].map(|path| path.as_os_str());
    let words = |words: &[&'static str]| words.iter().map(|word| OsStr::new(*word)).collect::<Vec<_>>();
    let with = |before: &[&'static str], names: &[&OsStr], after: &[&'static str]| {
        let args = [words(before), names.to_vec(), words(after)].concat();
        run(&args)
    };
    let json = |out: Vec<u8>| serde_json::from_slice::<serde_json::Value>(&out).expect("JSON");
    json(with(&["build"], &[tif], &["--dry-run", "--json"]));
    json(with(&["build"], &[tif, OsStr::new("-o"), rlv], &["--json"]));
    json(with(&["build"], &[tif, OsStr::new("--each"), each], &["--json"]));
    json(with(&["build"], &[tif, OsStr::new("--each"), each], &["--json", "--resume"]));
    for command in ["info", "stats", "verify"] {
        json(with(&[command], &[rlv], &["--json"]));
        with(&[command], &[rlv], &[]);
    }
    with(&["verify"], &[rlv, OsStr::new("--source"), tif], &[]);

    // Outputs that nobody named have the names of their inputs, byte for byte, so that no two are
    // the same.
    let other = folder.path().join(OsStr::from_bytes(b"d\xe5m.tif"));
    fs::copy(&dem, &other).expect("a copy");
    let both = folder.path().join("both");
    with(&["build"], &[tif, other.as_os_str(), OsStr::new("--each"), both.as_os_str()], &[]);
    for made in [&b"d\xe4m.rlv"[..], b"d\xe5m.rlv"] {
        assert!(both.join(OsStr::from_bytes(made)).is_file(), "{made:?}");
    }
    let mut build = Command::new(env!("CARGO_BIN_EXE_relevo"));
    let built = build.current_dir(folder.path()).args(["build", "-q"]).arg(&other).status();
    assert!(built.expect("the binary runs").success());
    assert!(folder.path().join(OsStr::from_bytes(b"d\xe5m.rlv")).is_file());
}
