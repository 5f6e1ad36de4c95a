//! What is warned of, and that a warning is an error if that is wanted.

use std::fs;
use std::path::Path;

use serde_json::Value;

use super::plain_tiff::{Kind, Tiff};
use super::{SIZE, ramp, relevo, tiff, told};

/// Lines of warnings.
fn warnings(text: &str) -> Vec<&str> {
    text.lines().filter_map(|line| line.strip_prefix("relevo: warning: ")).collect()
}

/// A file, and words of the one warning that it gets; none if there are no words.
fn cases() -> Vec<(&'static str, Tiff, &'static [&'static str])> {
    let with = |values: &[(usize, f64)], first: f64| {
        let mut all = ramp(first);
        for &(at, value) in values {
            all[at] = value;
        }
        vec![all]
    };
    let bands = |count: usize| vec![ramp(10.0); count];
    let here = Some([7.0, 46.0, 0.01]);
    let palette = Tiff { palette: true, photometric: 3, ..tiff(Kind::U8, &bands(1)) };
    vec![
        ("plain", Tiff { place: here, ..tiff(Kind::I16, &bands(1)) }, &[]),
        ("rgb", Tiff { photometric: 2, ..tiff(Kind::U8, &bands(3)) }, &["band 1 of 3", "RGB", "--band N"]),
        ("many", tiff(Kind::U8, &bands(7)), &["band 1 of 7", "Byte", "picture", "--band N"]),
        ("two", tiff(Kind::F32, &bands(2)), &["band 1 of 2", "Float32", "--band N"]),
        ("classes", palette, &["palette", "classes"]),
        ("minus", tiff(Kind::I16, &with(&[(4, -9999.0)], 300.0)), &["-9999", "300 to 362", "--nodata -9999"]),
        ("lowest", tiff(Kind::I16, &with(&[(4, -32768.0)], 300.0)), &["--nodata -32768"]),
        ("highest", tiff(Kind::U16, &with(&[(4, 65535.0)], 300.0)), &["--nodata 65535"]),
        (
            "float",
            tiff(Kind::F32, &with(&[(4, f64::from(f32::MIN))], 300.0)),
            &["--nodata -3.4028234663852886e38"],
        ),
        ("zero", tiff(Kind::I16, &with(&[(4, 0.0)], 1500.0)), &["--nodata 0"]),
        ("coast", tiff(Kind::I16, &with(&[(4, 0.0)], 1.0)), &[]),
        ("deep", tiff(Kind::I16, &with(&[(4, -9999.0)], -9998.0)), &[]),
        (
            "high",
            Tiff { place: here, ..tiff(Kind::F32, &with(&[], 20_000.0)) },
            &["20000 to 20062 m", "--vertical-unit"],
        ),
        ("nowhere", tiff(Kind::F32, &with(&[], 20_000.0)), &[]),
        (
            "both",
            Tiff { nodata: Some("12".into()), mask: Some(vec![true; 63]), ..tiff(Kind::U8, &bands(1)) },
            &["mask alone", "--nodata"],
        ),
    ]
}

#[test]
fn what_looks_wrong_is_told_once_with_the_option_that_mends_it() {
    let folder = tempfile::tempdir().expect("folder");
    for (name, tiff, words) in cases() {
        let (tif, rlv) = (format!("{name}.tif"), format!("{name}.rlv"));
        tiff.write(&folder.path().join(&tif));
        let built = relevo(folder.path(), &["build", &tif, "-o", &rlv, "--json"]);
        let text = told(&built);
        assert!(built.status.success(), "{name}: {text}");
        let found = warnings(&text);
        assert_eq!(found.len(), usize::from(!words.is_empty()), "{name}: {text}");
        let report: Value = serde_json::from_slice(&built.stdout).expect("JSON");
        assert_eq!(report["warnings"], serde_json::json!(found), "{name}");
        for word in words {
            assert!(
                found[0].contains(word) && found[0].starts_with(&tif),
                "{name}: {word:?} is not in {text}"
            );
        }
        // As errors: nothing is left, neither file nor folder.
        let strict = relevo(folder.path(), &["build", &tif, "-o", "strict.rlv", "--strict"]);
        assert_eq!(
            strict.status.code(),
            Some(if words.is_empty() { 0 } else { 2 }),
            "{name}: {}",
            told(&strict)
        );
        let is_there = |name: &str| folder.path().join(name).exists();
        assert_eq!(is_there("strict.rlv"), words.is_empty(), "{name}");
        assert!(!is_there("strict.rlv.work"), "{name}");
        let _ = fs::remove_file(folder.path().join("strict.rlv"));
    }
}

#[test]
fn advice_that_is_taken_is_not_given_again() {
    let folder = tempfile::tempdir().expect("folder");
    for (name, tiff, _) in cases() {
        tiff.write(&folder.path().join(format!("{name}.tif")));
    }
    for (name, option) in [
        ("rgb", "--band=1"),
        ("minus", "--nodata=-9999"),
        ("float", "--nodata=-3.4028234663852886e38"),
        ("high", "--vertical-unit=ft"),
        ("both", "--nodata=12"),
    ] {
        let tif = format!("{name}.tif");
        let built = relevo(folder.path(), &["build", &tif, "-o", "a.rlv", "--force", "--strict", option]);
        assert!(built.status.success() && warnings(&told(&built)).is_empty(), "{name}: {}", told(&built));
    }
}

#[test]
fn a_batch_goes_on_and_its_record_has_the_warnings() {
    let folder = tempfile::tempdir().expect("folder");
    for (name, tiff, _) in cases() {
        if ["plain", "minus", "rgb"].contains(&name) {
            tiff.write(&folder.path().join(format!("{name}.tif")));
        }
    }
    let all = ["build", "--each", "out", "plain.tif", "minus.tif", "rgb.tif"];
    let batch = relevo(folder.path(), &all);
    assert!(batch.status.success(), "{}", told(&batch));
    assert_eq!(warnings(&told(&batch)).len(), 2, "{}", told(&batch));
    let record = fs::read_to_string(folder.path().join("out/relevo-each.jsonl")).expect("record");
    let told_of: Vec<bool> = ["plain", "minus", "rgb"]
        .map(|name| {
            record.lines().any(|line| line.contains(&format!("{name}.rlv")) && line.contains("warnings"))
        })
        .to_vec();
    assert_eq!(told_of, [false, true, true], "{record}");
    let strict = relevo(folder.path(), &[&all[..], &["--strict", "--force"]].concat());
    assert_eq!(strict.status.code(), Some(2), "{}", told(&strict));
    assert!(String::from_utf8_lossy(&strict.stdout).contains("1 built, 2 failed"), "{}", told(&strict));
}

#[test]
fn warnings_of_pictures_are_errors_too_if_asked_for() {
    let folder = tempfile::tempdir().expect("folder");
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    for (fixture, name) in [("dem/rmnp_dem_uint16.tif", "dem.tif"), ("imagery/rmnp_rgb.tif", "rgb.tif")] {
        fs::copy(fixtures.join(fixture), folder.path().join(name)).expect("a copy");
    }
    let said =
        "<PAMDataset><PAMRasterBand band=\"1\"><NoDataValue>many</NoDataValue></PAMRasterBand></PAMDataset>";
    fs::write(folder.path().join("rgb.tif.aux.xml"), said).expect("a sidecar");
    let build = ["build", "dem.tif", "-o", "a.rlv", "--imagery", "rgb.tif"];
    let strict = relevo(folder.path(), &[&build[..], &["--strict"]].concat());
    assert_eq!(strict.status.code(), Some(2), "{}", told(&strict));
    assert_eq!(warnings(&told(&strict)).len(), 1, "{}", told(&strict));
    assert!(!folder.path().join("a.rlv").exists());
    assert!(relevo(folder.path(), &build[..4]).status.success());
    let before = fs::read(folder.path().join("a.rlv")).expect("the file");
    let add = ["add", "a.rlv", "--imagery", "rgb.tif"];
    let strict = relevo(folder.path(), &[&add[..], &["--strict"]].concat());
    assert_eq!(strict.status.code(), Some(2), "{}", told(&strict));
    assert!(fs::read(folder.path().join("a.rlv")).expect("the file") == before);
    assert!(relevo(folder.path(), &add).status.success());
}

#[test]
fn both_sides_of_the_date_line_are_told_of() {
    let folder = tempfile::tempdir().expect("folder");
    let place = |west: f64| Some([west, 10.0, 0.5]);
    for (name, west) in [("east.tif", 175.5), ("west.tif", -180.0), ("near.tif", -170.0)] {
        Tiff { place: place(west), ..tiff(Kind::I16, &[ramp(10.0)]) }.write(&folder.path().join(name));
    }
    let far = relevo(folder.path(), &["build", "east.tif", "west.tif", "-o", "a.rlv", "--dry-run"]);
    assert!(
        warnings(&told(&far)).iter().any(|text| text.contains("180 degrees") && text.contains("--crs")),
        "{}",
        told(&far)
    );
    let near = relevo(folder.path(), &["build", "near.tif", "west.tif", "-o", "a.rlv", "--dry-run"]);
    assert!(warnings(&told(&near)).is_empty(), "{}", told(&near));
}

#[test]
fn a_scale_that_leaves_no_height_is_refused_by_name() {
    let folder = tempfile::tempdir().expect("folder");
    for (text, words) in [("nan", "scale"), ("0", "scale"), ("inf", "scale")] {
        let item = format!(
            "<GDALMetadata><Item name=\"SCALE\" sample=\"0\" role=\"scale\">{text}</Item></GDALMetadata>"
        );
        Tiff { metadata: Some(item), ..tiff(Kind::I16, &[ramp(10.0)]) }.write(&folder.path().join("a.tif"));
        let refused = relevo(folder.path(), &["build", "a.tif", "-o", "a.rlv"]);
        let message = told(&refused);
        assert_eq!(refused.status.code(), Some(2), "{message}");
        assert!(message.contains(words) && message.contains("a.tif"), "{text}: {message}");
    }
    // Heights beyond a float32 are built, for the samples hold them, and told as what they look
    // like.
    let mut values = ramp(10.0);
    values[7] = -1e300;
    Tiff::new(SIZE, Kind::F64, vec![values]).write(&folder.path().join("a.tif"));
    let built = relevo(folder.path(), &["build", "a.tif", "-o", "a.rlv"]);
    assert!(built.status.success(), "{}", told(&built));
    assert!(told(&built).contains("-1e300") && told(&built).contains("--nodata"), "{}", told(&built));
}
