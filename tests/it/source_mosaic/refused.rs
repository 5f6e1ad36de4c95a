//! Files that do not fit together, and damaged ones: refused by name, never a panic.

use super::*;
use relevo::Error;

fn flat(at: (i64, i64)) -> Tile {
    Tile::new(at, (20, 20), SampleType::Int16, |x, y| f64::from(x + y))
}

fn two(folder: &Path) -> [PathBuf; 2] {
    let paths = ["first.tif", "second.tif"].map(|name| folder.join(name));
    flat((0, 0)).write(&paths[0]);
    flat((10, 0)).write(&paths[1]);
    paths
}

fn expect(message: &str, words: &[&str]) {
    assert!(words.iter().all(|word| message.contains(word)), "{message}");
}

#[test]
fn what_cannot_be_right_is_refused_by_file_name() {
    let folder = tempfile::tempdir().expect("folder");
    let paths = two(folder.path());
    join(&paths, Overlap::Last);
    let second = || flat((10, 0));
    Tile { unit: "ft", ..second() }.write(&paths[1]);
    expect(&refusal(&paths), &["second.tif", "first.tif", "ft (0.3048 m)", "metres", "`vertical_unit`"]);
    Tile { epsg: Some(32633), ..second() }.write(&paths[1]);
    expect(
        &refusal(&paths),
        &["second.tif", "first.tif", "EPSG:32633", "EPSG:32632", "`crs`", "--features gdal"],
    );
    Tile { epsg: None, ..second() }.write(&paths[1]);
    expect(&refusal(&paths), &["second.tif", "not given", "EPSG:32632", "-a_srs"]);
    let place = |x: f64, pixel: f64| [x, pixel, 0.0, 5_000_000.0, 0.0, -pixel];
    second().write_at(&paths[1], place(400_011.1, 30.0));
    expect(&refusal(&paths), &["second.tif", "0.3700 columns and 0.0000 rows off", "first.tif", "gdalwarp"]);
    second().write_at(&paths[1], place(400_300.0, 30.1));
    expect(&refusal(&paths), &["second.tif", "30.1 x -30.1, not 30 x -30", "first.tif"]);
    second().write_at(&paths[1], place(400_000.0 + 3e12, 30.0));
    assert!(refusal(&paths).contains("columns"), "{}", refusal(&paths));
    second().write_at(&paths[1], place(400_000.0 + 30.0 * 2e9, 30.0));
    expect(&refusal(&paths), &["width of all rasters together", "limit"]);
    second().write_at(&paths[1], place(f64::from(f32::MAX), 30.0));
    expect(&refusal(&paths), &["second.tif"]);
    std::fs::remove_file(&paths[1]).expect("remove");
    expect(&refusal(&paths), &["second.tif"]);
}

#[test]
fn files_without_a_place_folders_and_nothing() {
    let folder = tempfile::tempdir().expect("folder");
    let [first, second] = two(folder.path());
    let bare = folder.path().join("bare.tif");
    let options = ["-q", "-co", "PROFILE=BASELINE", text(&second), text(&bare)];
    run("gdal_translate", &options);
    expect(&refusal(&[bare.clone(), bare.clone()]), &["bare.tif", "not georeferenced"]);
    expect(&refusal(&[folder.path().to_owned()]), &["a folder", "/*.tif"]);
    expect(&refusal(&[first.clone(), folder.path().to_owned()]), &["a folder", "/*.tif"]);
    assert!(matches!(
        source::open_all(&[], &OpenOptions::default(), &Limits::default()),
        Err(Error::Usage { .. })
    ));
    let other = folder.path().join("notes.txt");
    std::fs::write(&other, "not a raster").expect("write");
    expect(&refusal(&[first, other]), &["notes.txt"]);
}

#[test]
fn a_part_that_is_replaced_while_it_is_read_is_an_error() {
    let folder = tempfile::tempdir().expect("folder");
    let paths = two(folder.path());
    let source = join(&paths, Overlap::Last);
    let before = source.fingerprint().expect("fingerprint");
    let names: Vec<_> = before.files.iter().map(|file| file.name.as_str()).collect();
    assert_eq!(names, ["first.tif", "second.tif"]);
    Tile::new((10, 0), (21, 20), SampleType::Int16, |_, _| 5.0).write(&paths[1]);
    let message = source.read_rows(0..3).expect_err("another size").to_string();
    expect(&message, &["second.tif", "20 x 20", "21 x 20", "start again"]);
    std::fs::remove_file(&paths[0]).expect("remove");
    assert!(matches!(source.fingerprint(), Err(Error::Io { .. } | Error::Format { .. })));
}

#[test]
fn damaged_tiles_of_srtm() {
    let folder = tempfile::tempdir().expect("folder");
    for (name, length, words) in [
        ("N44W072.hgt", 2_884_800, "the length of the file"),
        ("N44W072.hgt", 0, "the length of the file"),
        ("dem.hgt", 2_884_802, "such as N44W072"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, vec![0; length]).expect("write");
        expect(&refusal(&[path]), &[name, words]);
    }
    let path = folder.path().join("N44W072.hgt");
    std::fs::write(&path, vec![1; 2_884_802]).expect("write");
    let source = source::open(&path, &Limits::default()).expect("open");
    std::fs::write(&path, vec![1; 1000]).expect("cut");
    let message = source.read_rows(0..9).expect_err("cut off").to_string();
    expect(&message, &["N44W072.hgt", "end of the file"]);
}

/// Every prefix of a VRT, and every one with a byte changed: an error or a raster, soon.
#[test]
fn damaged_vrts() {
    let folder = tempfile::tempdir().expect("folder");
    let paths = two(folder.path());
    let vrt = folder.path().join("both.vrt");
    run("gdalbuildvrt", &["-q", "-srcnodata", "3", text(&vrt), text(&paths[0]), text(&paths[1])]);
    let good = std::fs::read(&vrt).expect("read");
    let path = folder.path().join("damaged.vrt");
    let look = |bytes: &[u8]| {
        std::fs::write(&path, bytes).expect("write");
        if let Ok(source) = source::open(&path, &Limits::default()) {
            let info = source.info();
            let (columns, rows) = (0..info.width.min(50), 0..info.height.min(50));
            // A source that the damage has moved is read where it lies.
            let _ = source.read_window(columns, rows);
        }
    };
    for length in (0..good.len()).step_by(7) {
        look(&good[..length]);
    }
    for at in (0..good.len()).step_by(3) {
        for byte in [b'0', b'9', b'-', b'<', b' ', 0xFF] {
            let mut bad = good.clone();
            bad[at] = byte;
            look(&bad);
        }
    }
    for (from, to, words) in [
        ("rasterXSize=\"30\"", "rasterXSize=\"99999999999999999999\"", "rasterXSize"),
        ("rasterXSize=\"30\"", "rasterXSize=\"4000000000\"", "rasterXSize"),
        ("rasterXSize=\"30\"", "rasterXSize=\"0\"", "at least 1"),
        ("xOff=\"10\"", "xOff=\"NaN\"", "DstRect in line"),
        ("<NODATA>3", "<NODATA>none", "NODATA in line"),
        ("ComplexSource", "Comment", "a VRTRasterBand with Comment"),
        ("second.tif", "third.tif", "third.tif"),
        ("second.tif", "damaged.vrt", "at most 8 within one another"),
        ("<VRTDataset", "<!DOCTYPE a [<!ENTITY b \"c\">]><VRTDataset", "XML"),
    ] {
        let text = String::from_utf8(good.clone()).expect("text");
        assert!(text.contains(from), "{from} in {text}");
        std::fs::write(&path, text.replace(from, to)).expect("write");
        if cfg!(feature = "gdal") && words.contains("Comment") {
            // GDAL passes over it, and has a raster without sources.
            continue;
        }
        let message = refusal(std::slice::from_ref(&path));
        // GDAL has its own words where it is built in and asked.
        expect(&message, &["damaged.vrt"].map(|_| words));
    }
}
