//! Inputs that are packed, listed, named by others, or no rasters at all: what is read of them, and
//! what is said.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use flate2::write::GzEncoder;
use relevo::limits::Limits;
use relevo::source::{self, OpenOptions, Source};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

fn gzip(from: &Path, to: &Path) {
    let file = std::fs::File::create(to).expect("file");
    let mut encoder = GzEncoder::new(file, flate2::Compression::fast());
    encoder.write_all(&std::fs::read(from).expect("read")).expect("write");
    encoder.finish().expect("finish");
}

fn open(path: &Path) -> Box<dyn Source> {
    source::open(path, &Limits::default()).unwrap_or_else(|error| panic!("{error}"))
}

fn refusal(path: &Path) -> String {
    source::open(path, &Limits::default()).err().expect("refused").to_string()
}

fn relevo(folder: &Path, args: &[&str], input: &str) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_relevo"))
        .args(args)
        .current_dir(folder)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary runs");
    child.stdin.take().expect("input").write_all(input.as_bytes()).expect("write");
    child.wait_with_output().expect("the binary ends")
}

#[test]
fn gzipped_rasters_are_the_rasters() {
    let folder = tempfile::tempdir().expect("folder");
    let plain = fixture("dem/co_elevation_float32_lzw.tif");
    let packed = folder.path().join("co.tif.gz");
    gzip(&plain, &packed);
    let (one, two) = (open(&plain), open(&packed));
    let (own, info) = (one.info(), two.info());
    assert_eq!(
        (own.width, own.height, &own.geo, own.nodata),
        (info.width, info.height, &info.geo, info.nodata)
    );
    assert_eq!(info.description, format!("{}, gzipped", own.description));
    assert_eq!(info.parts[0].name, "co.tif.gz");
    assert_eq!(one.read_rows(0..own.height).expect("rows"), two.read_rows(0..own.height).expect("rows"));
    // The stamp is that of the packed file.
    let stamp = &two.fingerprint().expect("stamp").files[0];
    let bytes = std::fs::metadata(&packed).expect("there").len();
    assert_eq!((stamp.name.as_str(), stamp.bytes), ("co.tif.gz", bytes));
    assert_eq!(source::stem(&packed), "co");
    // Cut off, or more than is allowed.
    let whole = std::fs::read(&packed).expect("read");
    std::fs::write(&packed, &whole[..whole.len() / 2]).expect("write");
    let message = refusal(&packed);
    assert!(message.contains("co.tif.gz") && message.contains("cut off"), "{message}");
    std::fs::write(&packed, &whole).expect("write");
    let mut limits = Limits::default();
    limits.unpacked_bytes = 1 << 20;
    assert!(matches!(source::open(&packed, &limits), Err(relevo::Error::Limit { .. })));
}

#[test]
fn gzipped_tiles_of_srtm_join() {
    let folder = tempfile::tempdir().expect("folder");
    let write = |name: &str, shift: i16| {
        let bytes: Vec<u8> =
            (0..1201_i32 * 1201).flat_map(|n| ((n % 1201) as i16 + shift).to_be_bytes()).collect();
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("write");
        let packed = folder.path().join(format!("{name}.gz"));
        gzip(&path, &packed);
        (path, packed)
    };
    let (west, east) = (write("N44W072.hgt", 0), write("n44w071.HGT", 1200));
    let read = |paths: &[PathBuf]| {
        let source = source::open_all(paths, &OpenOptions::default(), &Limits::default()).expect("open");
        let info = source.info();
        let rows = source.read_rows(100..300).expect("rows").samples;
        (info.width, info.height, info.geo.transform, rows, source.fingerprint().expect("stamps").files.len())
    };
    let plain = read(&[west.0, east.0]);
    assert_eq!(plain.0, 2401);
    assert_eq!(plain, read(&[west.1, east.1]));
}

#[test]
fn lists_come_from_files_with_a_mark_and_from_standard_input() {
    let folder = tempfile::tempdir().expect("folder");
    let name = "dem.tif";
    std::fs::copy(fixture("dem/tiny_3x2.tif"), folder.path().join(name)).expect("copy");
    std::fs::write(folder.path().join("list"), format!("\u{FEFF}{name}\r\n")).expect("write");
    for (list, input) in [("@list", String::new()), ("@-", format!("# all\n\n{name}\n"))] {
        let output = relevo(folder.path(), &["build", list, "-o", "out.rlv", "--force"], &input);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(folder.path().join("out.rlv").is_file());
    }
    let output = relevo(folder.path(), &["build", "@-", "-o", "out.rlv", "--force"], "\n");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && message.contains("one name a line"), "{message}");
}

#[test]
fn what_is_no_raster_is_named_with_advice_that_helps() {
    let folder = tempfile::tempdir().expect("folder");
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("write");
        path
    };
    let output = relevo(
        folder.path(),
        &["build", fixture("dem/tiny_3x2.tif").to_str().expect("path"), "-o", "a.rlv"],
        "",
    );
    assert!(output.status.success());
    for (path, words) in [
        (folder.path().join("a.rlv"), &["a.rlv", "Relevo file already", "relevo info"][..]),
        (write("notes.tif", b"the password is secret\n"), &["notes.tif", "a text file"]),
        (write("empty.tif", b""), &["empty.tif", "an empty file"]),
        (write("dem.zip", b"PK\x03\x04rest"), &["dem.zip", "zip archive", "unpack"]),
        (write("dem.pdf", b"%PDF-1.4"), &["dem.pdf", "PDF"]),
    ] {
        let message = refusal(&path);
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
        assert!(!message.contains("install") && !message.contains("secret"), "{message}");
    }
}

const BAND: &str = "<VRTDataset rasterXSize=\"3\" rasterYSize=\"2\"><GeoTransform>0,1,0,2,0,-1</GeoTransform>\
                    <VRTRasterBand dataType=\"Int16\" band=\"1\">";

/// A VRT of one source with more in it, and of more in the band.
fn vrt(folder: &Path, file: &str, source: &str, band: &str) -> PathBuf {
    let path = folder.join("dem.vrt");
    let text = format!(
        "{BAND}{band}<ComplexSource><SourceFilename relativeToVRT=\"1\">{file}</SourceFilename>{source}\
         </ComplexSource></VRTRasterBand></VRTDataset>"
    );
    std::fs::write(&path, text).expect("write");
    path
}

#[test]
fn elements_of_a_vrt_are_understood_or_refused() {
    let folder = tempfile::tempdir().expect("folder");
    std::fs::copy(fixture("dem/tiny_3x2.tif"), folder.path().join("a.tif")).expect("copy");
    for (source, band) in [
        ("", ""),
        (
            "<SourceBand>1</SourceBand><SourceProperties RasterXSize=\"3\" BlockXSize=\"3\"/>",
            "<ColorInterp>Gray</ColorInterp>",
        ),
        ("<UseMaskBand>false</UseMaskBand>", "<Metadata><MDI key=\"a\">b</MDI></Metadata><Histograms/>"),
        (
            "<NODATA le_hex_endian=\"0\">7</NODATA>",
            "<Overview><SourceFilename>b.tif</SourceFilename></Overview>",
        ),
    ] {
        open(&vrt(folder.path(), "a.tif", source, band));
    }
    for (source, band, words) in [
        ("<UseMaskBand>true</UseMaskBand>", "", "UseMaskBand"),
        ("<UseMaskBand>1</UseMaskBand>", "", "UseMaskBand"),
        ("<usemaskband>true</usemaskband>", "", "usemaskband"),
        ("<Exponent>2</Exponent>", "", "Exponent"),
        ("<LUT>0:0</LUT>", "", "LUT"),
        ("<OpenOptions/>", "", "OpenOptions"),
        ("<Future>1</Future>", "", "ComplexSource with Future"),
        ("<SrcRect xOff=\"0\" yOff=\"0\" xSize=\"3\" ySize=\"2\" turn=\"1\"/>", "", "SrcRect with turn"),
        ("", "<NewNoData>3</NewNoData>", "VRTRasterBand with NewNoData"),
        ("", "<MaskBand/>", "MaskBand"),
    ] {
        let path = vrt(folder.path(), "a.tif", source, band);
        if cfg!(feature = "gdal") {
            // Read by GDAL, or refused by it.
            continue;
        }
        let message = refusal(&path);
        assert!(message.contains("dem.vrt") && message.contains(words), "{message}");
    }
}

#[test]
fn what_a_vrt_names_is_neither_told_nor_fetched() {
    let folder = tempfile::tempdir().expect("folder");
    std::fs::write(folder.path().join("passwd"), "root:x:0:0:secret:/root:/bin/sh\n").expect("write");
    let message = refusal(&vrt(folder.path(), "passwd", "", ""));
    assert!(
        message.contains("passwd") && !message.contains("secret") && !message.contains("root"),
        "{message}"
    );
    for name in
        ["/vsicurl/http://localhost:1/a.tif", "/vsizip//vsis3/a/b.zip/c.tif", "https://localhost:1/a.tif"]
    {
        // Also where something else makes it a matter for GDAL.
        for more in ["", "<LUT>0:0</LUT>"] {
            let message = refusal(&vrt(folder.path(), name, more, ""));
            assert!(message.contains(name) && message.contains("not a file of this machine"), "{message}");
        }
    }
}

#[test]
fn hostile_markup_is_refused_before_it_is_parsed() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("dem.vrt");
    let attributes = (0..100_000).map(|n| format!(" a{n}=\"\"")).collect::<Vec<_>>().concat();
    let spaces = (0..100_000).map(|n| format!("<b xmlns:n{n}=\"u{n}\"/>")).collect::<Vec<_>>().concat();
    for text in [format!("<VRTDataset{attributes}/>"), format!("<VRTDataset>{spaces}</VRTDataset>")] {
        std::fs::write(&path, text).expect("write");
        assert!(matches!(source::open(&path, &Limits::default()), Err(relevo::Error::Limit { .. })));
    }
}
