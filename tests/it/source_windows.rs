//! Are windows what they should be: crops of the whole, of the file as it stands, whatever the
//! layout of the file?
//!
//! The variants are written by `gdal_translate`; these tests fail without the GDAL command line
//! tools.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;

use relevo::Error;
use relevo::limits::Limits;
use relevo::source::{self, Source};

fn run(tool: &str, arguments: &[&str]) {
    let status = Command::new(tool).args(arguments).env("GDAL_PAM_ENABLED", "NO").status();
    let status = status.unwrap_or_else(|error| {
        panic!("cannot run {tool} ({error}): these tests need the GDAL command line tools (apt-get install gdal-bin)")
    });
    assert!(status.success(), "{tool} {}", arguments.join(" "));
}

fn translate(options: &str, from: &Path, to: &Path) {
    let mut arguments: Vec<&str> = options.split_whitespace().collect();
    arguments.extend(["-q", from.to_str().expect("path"), to.to_str().expect("path")]);
    run("gdal_translate", &arguments);
}

fn fixture() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem/rmnp_dem_uint16.tif")
}

fn open(path: &Path) -> Box<dyn Source> {
    source::open(path, &Limits::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// Windows of every kind: whole, single samples, columns, rows, across the borders of blocks.
fn check_windows(path: &Path) {
    let source = open(path);
    let (width, height) = (source.info().width, source.info().height);
    let whole = source.read_rows(0..height).expect("rows");
    let mut seed = 1_u32;
    let mut random = |below: u32| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 8) % below
    };
    let mut windows = vec![
        (0..width, 0..height),
        (0..1, 0..height),
        (width - 1..width, height - 1..height),
        (0..width - 1, 3..4),
        (1..width, 0..height),
        (60..70, 40..52),
        (5..5, 0..height),
        (0..width, 7..7),
    ];
    for _ in 0..30 {
        let (x, y) = (random(width), random(height));
        let wide = if random(2) == 0 { random(9) } else { random(width) };
        windows.push((x..(x + 1 + wide).min(width), y..(y + 1 + random(height)).min(height)));
    }
    for (columns, rows) in windows {
        let window = source.read_window(columns.clone(), rows.clone()).expect("window");
        let about = || format!("{} {columns:?} {rows:?}", source.info().description);
        assert_eq!(window.samples.len(), columns.len() * rows.len(), "{}", about());
        let at = |x: u32, y: u32| (y * width + x) as usize;
        let mut index = 0;
        for y in rows.clone() {
            for x in columns.clone() {
                let (got, expected) = (window.samples.value(index), whole.samples.value(at(x, y)));
                assert_eq!(got.to_bits(), expected.to_bits(), "{} at {x}, {y}", about());
                let valid = |mask: &Option<Vec<u8>>, at: usize| mask.as_ref().map(|mask| mask[at]);
                assert_eq!(valid(&window.mask, index), valid(&whole.mask, at(x, y)), "{}", about());
                index += 1;
            }
        }
    }
}

const BLOCKS: [&str; 4] = [
    "-co BLOCKYSIZE=1",
    "-co BLOCKYSIZE=7",
    "-co BLOCKYSIZE=187",
    "-co TILED=YES -co BLOCKXSIZE=64 -co BLOCKYSIZE=48",
];

#[test]
fn windows_are_crops_of_the_whole() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("variant.tif");
    let mut turn = 0;
    for block in BLOCKS {
        for packing in ["NONE", "LZW -co PREDICTOR=2", "DEFLATE -co PREDICTOR=2", "ZSTD", "PACKBITS"] {
            for order in ["LITTLE", "BIG"] {
                turn += 1;
                let kind = ["Int16", "Float32", "Byte -scale", "Float64", "Int32"][turn % 5];
                let options = format!("-ot {kind} {block} -co COMPRESS={packing} -co ENDIANNESS={order}");
                translate(&options, &fixture(), &path);
                check_windows(&path);
            }
        }
    }
}

#[test]
fn windows_of_many_bands() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let stack = folder.path().join("stack.vrt");
    let dem = fixture();
    let names = [&stack, &dem, &dem, &dem].map(|path| path.to_str().expect("path"));
    run("gdalbuildvrt", &[&["-q", "-separate"], names.as_slice()].concat());
    let path = folder.path().join("bands.tif");
    for block in BLOCKS {
        for packing in ["NONE -co INTERLEAVE=PIXEL", "NONE -co INTERLEAVE=BAND", "ZSTD -co INTERLEAVE=PIXEL"]
        {
            for order in ["LITTLE", "BIG"] {
                translate(&format!("{block} -co COMPRESS={packing} -co ENDIANNESS={order}"), &stack, &path);
                check_windows(&path);
            }
        }
    }
}

#[test]
fn windows_of_sparse_files_and_masks() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let dem = folder.path().join("dem.tif");
    translate("-srcwin -90 -90 300 310 -a_nodata 65535", &fixture(), &dem);
    let path = folder.path().join("variant.tif");
    for block in BLOCKS {
        for packing in ["NONE", "DEFLATE"] {
            translate(&format!("{block} -co SPARSE_OK=TRUE -co COMPRESS={packing}"), &dem, &path);
            check_windows(&path);
            for inside in ["YES", "NO"] {
                let mask = format!("--config GDAL_TIFF_INTERNAL_MASK {inside} -mask mask -a_nodata none");
                translate(&format!("{mask} {block} -co COMPRESS={packing}"), &dem, &path);
                assert!(open(&path).read_rows(0..1).expect("row").mask.is_some());
                check_windows(&path);
            }
            std::fs::remove_file(folder.path().join("variant.tif.msk")).expect("mask beside");
        }
    }
}

/// A file that shrinks while it is open: the rows that are left are read, the others are an error
/// that names the place.
#[test]
fn a_file_cut_off_while_open_is_an_error() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("shrinking.tif");
    for block in BLOCKS {
        for packing in ["NONE", "LZW", "DEFLATE", "ZSTD"] {
            // The directory first: what is cut off are samples.
            translate(&format!("{block} -co COMPRESS={packing}"), &fixture(), &path);
            let source = open(&path);
            let height = source.info().height;
            let length = std::fs::metadata(&path).expect("file").len();
            File::options().write(true).open(&path).and_then(|file| file.set_len(length / 2)).expect("cut");
            for columns in [0..source.info().width, 3..9] {
                let error = source.read_window(columns, height - 9..height).expect_err("cut off");
                let message = error.to_string();
                assert!(matches!(error, Error::Format { .. }), "{message}");
                let block = if block.contains("TILED") { "tile " } else { "strip " };
                let words = ["shrinking.tif", block, "at offset", "expected", "start again"];
                assert!(words.iter().all(|word| message.contains(word)), "{message}");
            }
            if !block.contains("187") {
                source.read_rows(0..9).expect("the first rows are still there");
            }
        }
    }
}

#[test]
fn the_fingerprint_tells_of_every_file_and_every_change() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let dem = folder.path().join("dem.tif");
    translate("-srcwin -20 -20 200 220 -a_nodata 65535", &fixture(), &dem);
    let path = folder.path().join("masked.tif");
    translate("--config GDAL_TIFF_INTERNAL_MASK NO -mask mask -a_nodata none", &dem, &path);
    let source = open(&path);
    let before = source.fingerprint().expect("fingerprint");
    let names: Vec<_> = before.files.iter().map(|file| file.name.as_str()).collect();
    assert_eq!(names, ["masked.tif", "masked.tif.msk"]);
    assert_eq!(source.fingerprint().expect("again"), before);
    for name in names {
        let file = folder.path().join(name);
        let bytes = std::fs::read(&file).expect("read");
        let time = std::fs::metadata(&file).and_then(|metadata| metadata.modified()).expect("time");
        let now = || source.fingerprint().expect("fingerprint");
        std::fs::write(&file, [&bytes[..], b"x"].concat()).expect("longer");
        assert_ne!(now(), before, "{name}, longer");
        std::fs::write(&file, &bytes).expect("write");
        let later = time + std::time::Duration::from_secs(2);
        File::options().write(true).open(&file).and_then(|file| file.set_modified(later)).expect("time");
        assert_ne!(now(), before, "{name}, as long, written later");
        File::options().write(true).open(&file).and_then(|file| file.set_modified(time)).expect("time");
        assert_eq!(now(), before, "{name}, as it was");
    }
    std::fs::remove_file(folder.path().join("masked.tif.msk")).expect("remove");
    assert!(matches!(source.fingerprint(), Err(Error::Io { .. })), "the mask is gone");
    assert_ne!(open(&path).fingerprint().expect("fingerprint"), before, "opened without the mask");
}
