//! Inputs and files with numbers that no reader can use: refused by name, before there is an
//! output, and in little memory.

use std::path::{Path, PathBuf};

use relevo::container::reader::Reader;
use relevo::limits::Limits;
use relevo::pipeline::{BuildOptions, Silent, build};
use relevo::source;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/failing").join(name)
}

#[test]
fn what_cannot_stand_in_a_file_is_refused_before_there_is_one() {
    let folder = tempfile::tempdir().unwrap();
    for (name, words) in
        [("tiff-band-scale-1e308.tif", "band scale"), ("tiff-pixel-scale-1e308.tif", "geotransform")]
    {
        let output = folder.path().join("a.rlv");
        let built = source::open(&fixture(name), &Limits::default())
            .and_then(|source| build(&*source, &output, &BuildOptions::default(), &Silent));
        let refusal = built.unwrap_err().to_string();
        assert!(refusal.contains(words), "{name}: {refusal}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "{name}: something was left");
    }
}

/// GDAL drops such a key, and so do we, with a warning: what is left can stand in a file.
#[test]
fn a_key_that_is_no_number_does_not_come_into_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("a.rlv");
    let source = source::open(&fixture("tiff-geokey-nan.tif"), &Limits::default()).unwrap();
    assert!(
        source.info().warnings.iter().any(|text| text.contains("not a finite number")),
        "{:?}",
        source.info().warnings
    );
    build(&*source, &output, &BuildOptions::default(), &Silent).unwrap();
    let reader = Reader::open(&output).unwrap();
    assert!(reader.geo().crs.ellipsoid.a.is_finite());
    assert!(reader.geo().crs.keys.iter().flat_map(|keys| &keys.doubles).all(|key| key.is_finite()));
}

#[test]
fn the_command_line_refuses_them_with_2() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["tiff-band-scale-1e308.tif", "tiff-pixel-scale-1e308.tif"] {
        let output = folder.path().join("a.rlv");
        let mut command = assert_cmd::Command::cargo_bin("relevo").unwrap();
        let run = command.arg("build").arg(fixture(name)).arg("-o").arg(&output).output().unwrap();
        assert_eq!(run.status.code(), Some(2), "{name}");
        assert!(!output.exists(), "{name}");
    }
}

#[test]
fn statistics_that_unfold_to_gigabytes_are_refused() {
    for name in ["rlv-statistics-histogram.rlv", "rlv-statistics-steps.rlv"] {
        let reader = Reader::open(fixture(name)).unwrap();
        let refusal = reader.statistics().unwrap_err().to_string();
        assert!(refusal.contains("a list of more than"), "{name}: {refusal}");
    }
}
