//! Does the native reader give what GDAL gives, sample for sample?
//!
//! Every variant is written by `gdal_translate` and compared with GDAL's own raw dump. These tests
//! fail without the GDAL command line tools: a check that is skipped proves nothing.

use std::path::{Path, PathBuf};
use std::process::Command;

use relevo::limits::Limits;
use relevo::sample::SampleType;
use relevo::source::{self, Samples, Source, Window};

type Json = serde_json::Value;

fn run(tool: &str, arguments: &[&str]) -> String {
    let output = Command::new(tool).args(arguments).env("GDAL_PAM_ENABLED", "NO").output().unwrap_or_else(|error| {
        panic!("cannot run {tool} ({error}): these tests need the GDAL command line tools (apt-get install gdal-bin)")
    });
    assert!(
        output.status.success(),
        "{tool} {}: {}",
        arguments.join(" "),
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).expect("text")
}

fn translate(options: &str, from: &Path, to: &Path) {
    let mut arguments: Vec<&str> = options.split_whitespace().collect();
    arguments.extend(["-q", from.to_str().expect("path"), to.to_str().expect("path")]);
    run("gdal_translate", &arguments);
}

fn info(path: &Path) -> Json {
    serde_json::from_str(&run("gdalinfo", &["-json", path.to_str().expect("path")])).expect("JSON")
}

/// What GDAL reads, as raw bytes of this machine; `band` is `1` or `mask`.
fn dump(path: &Path, band: &str, folder: &Path) -> Vec<u8> {
    let raw = folder.join("dump.bin");
    // A rotated geotransform would make the driver complain; the dump needs none.
    translate(&format!("-of ENVI -b {band} -a_ullr 0 1 1 0"), path, &raw);
    std::fs::read(&raw).expect("raw dump")
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem").join(name)
}

fn bytes(samples: &Samples) -> Vec<u8> {
    match samples {
        Samples::Int8(v) => v.iter().flat_map(|s| s.to_ne_bytes()).collect(),
        Samples::Uint8(v) => v.clone(),
        Samples::Int16(v) => v.iter().flat_map(|s| s.to_ne_bytes()).collect(),
        Samples::Uint16(v) => v.iter().flat_map(|s| s.to_ne_bytes()).collect(),
        Samples::Int32(v) => v.iter().flat_map(|s| s.to_ne_bytes()).collect(),
        Samples::Uint32(v) => v.iter().flat_map(|s| s.to_ne_bytes()).collect(),
        Samples::Float32(v) => v.iter().flat_map(|s| s.to_ne_bytes()).collect(),
        Samples::Float64(v) => v.iter().flat_map(|s| s.to_ne_bytes()).collect(),
    }
}

/// Reads a raster in bands of 33 rows, 1 of them shared, as the builder does.
fn sweep(source: &dyn Source) -> (Vec<u8>, Option<Vec<u8>>) {
    let height = source.info().height;
    let (mut all, mut mask) = (Vec::new(), None::<Vec<u8>>);
    let mut start = 0;
    while start < height {
        let Window { samples, mask: valid } =
            source.read_rows(start.saturating_sub(1)..(start + 32).min(height)).expect("rows");
        let width = source.info().width as usize;
        let skip = if start > 0 { width } else { 0 };
        all.extend_from_slice(&bytes(&samples)[skip * samples.sample_type().bytes()..]);
        if let Some(valid) = valid {
            mask.get_or_insert_default().extend_from_slice(&valid[skip..]);
        }
        start += 32;
    }
    (all, mask)
}

fn open(path: &Path) -> Box<dyn Source> {
    source::open(path, &Limits::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// Compares everything with GDAL; the samples with `expected`, or else with a dump.
fn compare(path: &Path, expected: Option<&[u8]>, folder: &Path) {
    let source = open(path);
    let (samples, _) = sweep(source.as_ref());
    let own;
    let expected = if let Some(bytes) = expected {
        bytes
    } else {
        own = dump(path, "1", folder);
        &own
    };
    assert_eq!(samples.len(), expected.len(), "{}", path.display());
    let differ = samples.iter().zip(expected).position(|(a, b)| a != b);
    assert_eq!(differ, None, "{}: first differing byte ({})", path.display(), source.info().description);
    compare_info(path, source.as_ref());
}

/// GDAL's geotransform with all its digits, which a VRT has and `gdalinfo` has not.
fn geotransform(path: &Path) -> Option<Vec<f64>> {
    let vrt = run("gdal_translate", &["-q", "-of", "VRT", path.to_str().expect("path"), "/vsistdout/"]);
    let (_, rest) = vrt.split_once("<GeoTransform>")?;
    let (six, _) = rest.split_once("</GeoTransform>")?;
    Some(six.split(',').map(|number| number.trim().parse().expect("number")).collect())
}

fn compare_info(path: &Path, source: &dyn Source) {
    let (json, info) = (info(path), source.info());
    let name = path.display();
    let band = &json["bands"][0];
    assert_eq!(json["size"][0], info.width, "{name}");
    assert_eq!(json["size"][1], info.height, "{name}");
    let kind = if info.sample_type == SampleType::Int8 { "Byte" } else { info.sample_type.gdal_name() };
    assert_eq!(band["type"], kind, "{name}");
    assert_eq!(info.geo.transform.map(|six| six.to_vec()), geotransform(path), "{name}");
    let nodata = match &band["noDataValue"] {
        Json::String(text) if text.eq_ignore_ascii_case("nan") => Some(f64::NAN),
        value => value.as_f64(),
    };
    // gdalinfo prints the nodata value of a float32 with the digits of a float32.
    let same = |a: f64, b: f64| a == b || a.is_nan() && b.is_nan() || (a as f32) == (b as f32);
    match (info.nodata, nodata) {
        (None, None) => {}
        (Some(ours), Some(theirs)) => assert!(same(ours, theirs), "{name}: nodata {ours}, GDAL {theirs}"),
        (ours, theirs) => panic!("{name}: nodata {ours:?}, GDAL {theirs:?}"),
    }
    assert_eq!(info.band_scale, band["scale"].as_f64().unwrap_or(1.0), "{name}");
    assert_eq!(info.band_offset, band["offset"].as_f64().unwrap_or(0.0), "{name}");
    let unit = band["unit"].as_str().unwrap_or_default();
    assert_eq!(info.vertical_unit.1, unit, "{name}");
    let wkt = json["coordinateSystem"]["wkt"].as_str().unwrap_or_default();
    if let Some(epsg) = info.geo.crs.epsg {
        assert!(wkt.contains(&format!("ID[\"EPSG\",{epsg}]")), "{name}: EPSG {epsg}, GDAL {wkt}");
    }
}

/// A small raster of each type: real heights, stretched over the range of the type.
fn base(kind: SampleType, folder: &Path) -> PathBuf {
    let range = match kind {
        SampleType::Int8 | SampleType::Uint8 => "0 255",
        SampleType::Int16 => "-32768 32767",
        SampleType::Uint16 => "0 65535",
        SampleType::Int32 => "-2147483000 2147483000",
        SampleType::Uint32 => "0 4294967000",
        SampleType::Float32 => "-123.456 8848.86",
        SampleType::Float64 => "-1e-3 1e7",
    };
    let path = folder.join(format!("base_{}.tif", kind.gdal_name()));
    let output = if kind == SampleType::Int8 { "Byte -co PIXELTYPE=SIGNEDBYTE" } else { kind.gdal_name() };
    let options = format!("-ot {output} -scale 2281 4261 {range} -a_nodata none");
    translate(&options, &fixture("rmnp_dem_uint16.tif"), &path);
    path
}

#[test]
fn every_type_layout_compression_and_byte_order() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let folder = folder.path();
    let blocks =
        ["-co TILED=YES -co BLOCKXSIZE=64 -co BLOCKYSIZE=48", "-co BLOCKYSIZE=7", "-co BLOCKYSIZE=187"];
    let packings = [
        "NONE 1",
        "LZW 1",
        "LZW 2",
        "LZW 3",
        "DEFLATE 1",
        "DEFLATE 2",
        "DEFLATE 3",
        "ZSTD 1",
        "ZSTD 2",
        "ZSTD 3",
        "PACKBITS 1",
    ];
    let orders =
        ["LITTLE -co BIGTIFF=NO", "BIG -co BIGTIFF=NO", "BIG -co BIGTIFF=YES", "LITTLE -co BIGTIFF=YES"];
    let mut turn = 0;
    for kind in SampleType::ALL {
        let base = base(kind, folder);
        let expected = dump(&base, "1", folder);
        compare(&base, Some(&expected), folder);
        for block in blocks {
            for packing in packings {
                let (method, predictor) = packing.split_once(' ').expect("two words");
                if predictor == "3" && !kind.is_float() {
                    continue;
                }
                // Byte orders and file sizes take turns, so that each meets each type, layout and
                // compression.
                turn += 1;
                let order = orders[(turn + turn / 4) % 4];
                let own = if predictor == "1" { String::new() } else { format!("-co PREDICTOR={predictor}") };
                let path = folder.join("variant.tif");
                translate(
                    &format!("{block} -co COMPRESS={method} {own} -co ENDIANNESS={order}"),
                    &base,
                    &path,
                );
                let source = open(&path);
                let (samples, mask) = sweep(source.as_ref());
                // GDAL 3.6 writes predictor 3 into big-endian files in a way that it does not read
                // back itself.
                let broken = predictor == "3" && order.starts_with("BIG");
                let expected = if broken { dump(&path, "1", folder) } else { expected.clone() };
                assert!(samples == expected, "{kind:?} {block} {packing} {order}: samples differ");
                assert_eq!(mask, None);
                assert_eq!(source.info().sample_type, kind, "{block} {packing} {order}");
            }
        }
    }
}

#[test]
fn many_bands_interleaved_either_way() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let folder = folder.path();
    let first = folder.join("first.tif");
    let second = folder.join("second.tif");
    translate("-ot Float32", &fixture("rmnp_dem_uint16.tif"), &first);
    translate("-ot Float32 -scale 2281 4261 9000 -9000", &fixture("rmnp_dem_uint16.tif"), &second);
    let stack = folder.join("stack.vrt");
    let names = [&stack, &first, &second, &first].map(|path| path.to_str().expect("path"));
    run("gdalbuildvrt", &[&["-q", "-separate"], names.as_slice()].concat());
    let expected = dump(&first, "1", folder);
    for interleave in ["PIXEL", "BAND"] {
        for tiled in ["NO", "YES -co BLOCKXSIZE=64 -co BLOCKYSIZE=64"] {
            for packing in ["NONE", "LZW -co PREDICTOR=2", "DEFLATE -co PREDICTOR=3", "ZSTD"] {
                for order in ["LITTLE", "BIG"] {
                    let path = folder.join("bands.tif");
                    let layout =
                        format!("-co INTERLEAVE={interleave} -co TILED={tiled} -co ENDIANNESS={order}");
                    translate(&format!("{layout} -co COMPRESS={packing}"), &stack, &path);
                    let broken = packing.ends_with('3') && order == "BIG";
                    compare(&path, (!broken).then_some(&expected), folder);
                }
            }
        }
    }
}

#[test]
fn sparse_blocks_are_nodata_or_zero() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let folder = folder.path();
    let holes = folder.join("holes.tif");
    // A window far larger than the raster: whole blocks of nothing.
    let options = "-srcwin -200 -200 700 700 -a_nodata 65535";
    translate(options, &fixture("rmnp_dem_uint16.tif"), &holes);
    for nodata in ["65535", "none"] {
        for packing in ["NONE", "LZW", "ZSTD"] {
            let path = folder.join("sparse.tif");
            let tiles = "-co TILED=YES -co BLOCKXSIZE=64 -co BLOCKYSIZE=64 -co SPARSE_OK=TRUE";
            translate(&format!("-a_nodata {nodata} {tiles} -co COMPRESS={packing}"), &holes, &path);
            compare(&path, None, folder);
        }
    }
    let zeros = folder.join("zeros.tif");
    translate("-a_nodata 0 -srcwin -200 -200 700 700", &fixture("rmnp_dem_uint16.tif"), &zeros);
    let path = folder.join("sparse.tif");
    translate("-a_nodata none -co TILED=YES -co SPARSE_OK=TRUE -co COMPRESS=DEFLATE", &zeros, &path);
    assert!(std::fs::metadata(&path).expect("file").len() < 200_000, "not sparse");
    compare(&path, None, folder);
}

#[test]
fn masks_inside_and_beside_withoverviews() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let folder = folder.path();
    let dem = folder.join("dem.tif");
    translate("-srcwin -20 -20 200 220 -a_nodata 65535", &fixture("rmnp_dem_uint16.tif"), &dem);
    for (inside, options) in [
        ("YES", "-co COMPRESS=DEFLATE"),
        ("YES", "-co TILED=YES -co BLOCKXSIZE=64 -co BLOCKYSIZE=64 -co COMPRESS=ZSTD"),
        ("YES", "-co COMPRESS=NONE -co ENDIANNESS=BIG"),
        ("NO", "-co COMPRESS=LZW"),
    ] {
        for overviews in [false, true] {
            let path = folder.join("masked.tif");
            let _ = std::fs::remove_file(folder.join("masked.tif.msk"));
            let all =
                format!("--config GDAL_TIFF_INTERNAL_MASK {inside} -mask mask -a_nodata none {options}");
            translate(&all, &folder.join("dem.tif"), &path);
            if overviews {
                let config = ["--config", "GDAL_TIFF_INTERNAL_MASK", inside];
                run(
                    "gdaladdo",
                    &[config.as_slice(), &["-q", path.to_str().expect("path"), "2", "4"]].concat(),
                );
            }
            compare(&path, None, folder);
            let expected = dump(&path, "mask", folder);
            let (_, mask) = sweep(open(&path).as_ref());
            let mask = mask.unwrap_or_else(|| panic!("no mask, inside {inside}, {options}"));
            let same = mask.iter().zip(&expected).all(|(&ours, &theirs)| (ours != 0) == (theirs != 0));
            assert!(same && mask.len() == expected.len(), "mask, inside {inside}, {options}");
            assert!(mask.contains(&0) && mask.iter().any(|&valid| valid != 0));
        }
    }
}

#[test]
fn georeference_nodata_scale_and_units() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let folder = folder.path();
    let from = fixture("rmnp_dem_uint16.tif");
    let rotated = folder.join("rotated.vrt");
    translate("-of VRT", &from, &rotated);
    let text = std::fs::read_to_string(&rotated).expect("VRT");
    let (before, rest) = text.split_once("<GeoTransform>").expect("geotransform");
    let (_, after) = rest.split_once("</GeoTransform>").expect("geotransform");
    let six = "500000, 10, 2.5, 4000000, -1.5, -12";
    std::fs::write(&rotated, format!("{before}<GeoTransform>{six}</GeoTransform>{after}")).expect("write");
    let path = folder.join("variant.tif");
    let cases: [&[&str]; 17] = [
        &["-a_srs", "EPSG:32613", "-a_ullr", "100.25", "900", "1000", "-7.5"],
        &["-a_srs", "EPSG:2263", "-a_ullr", "0", "1000", "1000", "0"],
        &["-a_srs", "EPSG:4267"],
        &["-a_srs", "EPSG:3857"],
        &["-a_srs", "EPSG:4326+5773"],
        &["-a_srs", "EPSG:4326+5773", "-a_scale", "0.1", "-a_offset", "5"],
        &["-a_srs", "EPSG:4269+6360"],
        &["-a_srs", "EPSG:4269+8228", "-ot", "Float32"],
        &["-a_srs", "EPSG:25832", "-a_scale", "0.1", "-a_offset", "-1000"],
        &["-ot", "Int16", "-a_nodata", "-32768", "-a_scale", "0.3048"],
        &["-ot", "Float32", "-a_nodata", "nan"],
        &["-ot", "Float32", "-a_nodata", "-3.4028234663852886e+38"],
        &["-ot", "Float32", "-a_nodata", "0.1"],
        &["-ot", "Float64", "-a_nodata", "0.1"],
        &["-ot", "Byte", "-scale", "-a_nodata", "-9999"],
        &["-co", "PROFILE=BASELINE"],
        &["-a_srs", "+proj=laea +lat_0=52 +lon_0=10 +units=us-ft"],
    ];
    for (turn, case) in cases.into_iter().enumerate() {
        for (point, source) in [(false, &from), (true, &rotated), (true, &from), (false, &rotated)] {
            // All four for the first case, two of them in turn for each other one.
            if turn > 0 && (point == (source == &from)) == (turn % 2 == 0) {
                continue;
            }
            let mut all = case.to_vec();
            if point {
                all.extend(["-mo", "AREA_OR_POINT=Point"]);
            }
            all.extend(["-q", source.to_str().expect("path"), path.to_str().expect("path")]);
            run("gdal_translate", &all);
            compare(&path, None, folder);
        }
    }
}

#[test]
fn unit_names_as_gdal_writes_them() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let folder = folder.path();
    for (unit, metres) in
        [("m", 1.0), ("ft", 0.3048), ("US survey foot", 1200.0 / 3937.0), ("cm & more", 1.0)]
    {
        let vrt = folder.join("unit.vrt");
        translate("-of VRT", &fixture("rmnp_dem_uint16.tif"), &vrt);
        let text = std::fs::read_to_string(&vrt).expect("VRT");
        let (before, after) = text.split_once("<ColorInterp>").expect("band");
        let unit = unit.replace('&', "&amp;");
        let text = format!(
            "{before}<UnitType>{unit}</UnitType><Offset>-10</Offset><Scale>0.5</Scale><ColorInterp>{after}"
        );
        std::fs::write(&vrt, text).expect("write");
        let path = folder.join("unit.tif");
        translate("-co COMPRESS=LZW", &vrt, &path);
        compare(&path, None, folder);
        let source = open(&path);
        assert_eq!(source.info().vertical_unit.0, metres, "{unit}");
        assert_eq!((source.info().band_scale, source.info().band_offset), (0.5, -10.0));
    }
}

#[test]
fn what_cannot_be_read_is_named() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let folder = folder.path();
    let dem = fixture("rmnp_dem_uint16.tif");
    let path = folder.join("variant.tif");
    for (options, name) in [
        ("-co COMPRESS=LERC", "LERC compression"),
        ("-co COMPRESS=LZMA", "LZMA compression"),
        ("-ot Byte -scale -co COMPRESS=JPEG", "JPEG compression"),
        ("-co NBITS=13", "13-bit unsigned samples"),
        ("-ot Float32 -co NBITS=16", "16-bit floating-point samples"),
        ("-ot Int64", "64-bit signed samples"),
        ("-ot CFloat32", "64-bit complex samples"),
        ("-ot CInt16", "32-bit complex samples"),
        ("-ot Byte -scale 0 65535 0 1 -co NBITS=1", "1-bit samples"),
    ] {
        translate(options, &dem, &path);
        let error =
            relevo::source::tiff::TiffSource::open(&path, &Limits::default()).err().expect("unsupported");
        assert!(matches!(error, relevo::Error::Unsupported { .. }), "{error}");
        let message = error.to_string();
        assert!(message.contains(name) && message.contains("variant.tif"), "{name}: {message}");
    }
}

#[test]
fn written_wkt_is_what_the_code_means() {
    for code in [4326_u16, 4269, 4258, 4979, 3857, 32601, 32660, 32733, 26910, 25832] {
        let (model, key) = if code > 4000 && code < 5000 { (2, 2048) } else { (1, 3072) };
        let directory = vec![1, 1, 0, 2, 1024, 0, 1, model, key, 0, 1, code];
        let crs = relevo::crs::geokeys::read(relevo::geo::GeoKeys { directory, ..Default::default() }).crs;
        assert_eq!(crs.epsg, Some(u32::from(code)));
        let srs = format!("EPSG:{code}");
        // What PROJ makes of the text as it stands, and of the code.
        let ours = run("gdalsrsinfo", &["-o", "proj4", &crs.wkt]);
        let theirs = run("gdalsrsinfo", &["-o", "proj4", &srs]);
        assert_eq!(ours.trim(), theirs.trim(), "{}", crs.wkt);
        assert!(run("gdalsrsinfo", &["-o", "epsg", &crs.wkt]).contains(&srs), "{}", crs.wkt);
    }
    let unknown = relevo::crs::geokeys::read(relevo::geo::GeoKeys::default()).crs;
    assert!(run("gdalsrsinfo", &["-o", "wkt2_2019", &unknown.wkt]).contains("ENGCRS"));
}

#[test]
fn fixtures_and_shared_rasters() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let mut paths: Vec<PathBuf> = Vec::new();
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    for from in [fixture(""), shared] {
        let Ok(entries) = std::fs::read_dir(&from) else {
            eprintln!("{} is not there: its rasters are not compared", from.display());
            continue;
        };
        paths.extend(entries.filter_map(|entry| Some(entry.ok()?.path())));
    }
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "tif"));
    paths.sort();
    assert!(!paths.is_empty());
    for path in paths {
        match source::open(&path, &Limits::default()) {
            Ok(_) => compare(&path, None, folder.path()),
            Err(error) => assert!(error.to_string().contains("JPEG compression"), "{error}"),
        }
    }
}

/// image-tiff #395: `tiff` 0.11.3 loses its way in long LZW tiles that GDAL writes; ours are
/// decoded by weezl 0.2.
#[test]
fn regress_image_tiff_395_large_lzw_with_predictor() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("large.tif");
    let size = "-ot Int16 -outsize 3001 3001 -r cubic -co TILED=YES -co BLOCKXSIZE=512 -co BLOCKYSIZE=512";
    let options = format!("{size} -co COMPRESS=LZW -co PREDICTOR=2");
    translate(&options, &fixture("co_elevation_float32_lzw.tif"), &path);
    compare(&path, None, folder.path());
}

#[cfg(feature = "gdal")]
mod through_gdal {
    use super::*;
    use relevo::source::gdal::GdalSource;
    use relevo::source::tiff::TiffSource;

    fn same(path: &Path) {
        let native = TiffSource::open(path, &Limits::default()).expect("native");
        let other = GdalSource::open(path, &Limits::default()).expect("GDAL");
        let (a, b) = (native.info(), other.info());
        assert_eq!((a.width, a.height, a.sample_type), (b.width, b.height, b.sample_type));
        assert_eq!((a.geo.transform, a.geo.pixel_is_point), (b.geo.transform, b.geo.pixel_is_point));
        assert_eq!((a.geo.crs.kind, a.geo.crs.epsg), (b.geo.crs.kind, b.geo.crs.epsg), "{}", path.display());
        assert_eq!(a.vertical_unit, b.vertical_unit);
        assert!(
            (a.geo.crs.unit / b.geo.crs.unit - 1.0).abs() < 1e-12,
            "{} {}",
            a.geo.crs.unit,
            b.geo.crs.unit
        );
        assert!((a.geo.crs.ellipsoid.a / b.geo.crs.ellipsoid.a - 1.0).abs() < 2e-4);
        let ((ours, our_mask), (theirs, their_mask)) = (sweep(&native), sweep(&other));
        assert!(ours == theirs, "{}", path.display());
        assert_eq!(our_mask.is_some(), their_mask.is_some(), "{}", path.display());
    }

    #[test]
    fn gives_what_the_native_reader_gives() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("variant.tif");
        same(&fixture("rmnp_dem_uint16.tif"));
        same(&fixture("co_elevation_float32_lzw.tif"));
        for srs in ["EPSG:32613", "EPSG:2263", "EPSG:4267+5703", "EPSG:4807", "EPSG:2256", "EPSG:4269+6360"] {
            translate(&format!("-a_srs {srs} -a_ullr 0 20 20 0"), &fixture("rmnp_dem_uint16.tif"), &path);
            same(&path);
        }
        for kind in SampleType::ALL {
            same(&base(kind, folder.path()));
        }
        translate(
            "--config GDAL_TIFF_INTERNAL_MASK YES -mask mask -a_nodata none",
            &fixture("rmnp_dem_uint16.tif"),
            &path,
        );
        same(&path);
    }

    /// Builds through the program, in a folder of its own, and checks every sample against the
    /// raster.
    fn builds(name: &str, more: &[&str]) -> String {
        let folder = tempfile::tempdir().expect("temporary folder");
        let mut arguments = vec!["build", name, "--verify"];
        arguments.extend(more);
        let relevo = |arguments: &[&str]| {
            let program = Command::new(env!("CARGO_BIN_EXE_relevo"))
                .args(arguments)
                .current_dir(folder.path())
                .output();
            let output = program.expect("the binary runs");
            let message = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(0), "{arguments:?}: {message}");
            String::from_utf8(output.stdout).expect("text")
        };
        relevo(&arguments);
        let entry =
            std::fs::read_dir(folder.path()).expect("folder").next().expect("a container").expect("entry");
        let container = entry.file_name().into_string().expect("text");
        format!("{container}\n{}", relevo(&["info", &container]))
    }

    #[test]
    fn every_shared_dem_builds_and_is_verified() {
        let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
        let Ok(entries) = std::fs::read_dir(&shared) else {
            eprintln!("{} is not there: its rasters are not built", shared.display());
            return;
        };
        let mut names: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
        let picture = |name: &str| name.contains("rgb") || name.starts_with("bmng") || name == "INDEX.md";
        names.retain(|path| {
            path.file_name().and_then(|name| name.to_str()).is_some_and(|name| !picture(name))
        });
        assert!(names.len() >= 20, "{} rasters", names.len());
        for path in names {
            builds(path.to_str().expect("path"), &[]);
        }
    }

    /// Makes a raster in a format of GDAL's, which Debian's GDAL has.
    fn made(driver: &str, options: &str, from: &Path, to: &Path) {
        let formats = run("gdalinfo", &["--formats"]);
        assert!(
            formats.contains(&format!(" {driver} -raster")),
            "this GDAL has no {driver}: apt-get install gdal-bin"
        );
        translate(&format!("-of {driver} {options}"), from, to);
    }

    #[test]
    fn formats_that_only_gdal_reads() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let dem = fixture("rmnp_dem_uint16.tif");
        for (driver, options, name) in [
            ("GTiff", "-co COMPRESS=LERC", "lerc.tif"),
            ("GTiff", "-ot Float32 -co COMPRESS=LERC -co MAX_Z_ERROR=0.01", "lerc_lossy.tif"),
            ("MRF", "-co COMPRESS=LERC -ot Float32", "lerc.mrf"),
            ("JP2OpenJPEG", "-co REVERSIBLE=YES -co QUALITY=100", "lossless.jp2"),
            ("netCDF", "-ot Int16", "plain.nc"),
            ("AAIGrid", "", "text.asc"),
            ("EHdr", "-ot Int16", "band.bil"),
            ("HFA", "", "imagine.img"),
        ] {
            let path = folder.path().join(name);
            made(driver, options, &dem, &path);
            let source = open(&path);
            assert!(source.info().description.contains("through GDAL"), "{name}");
            assert!(sweep(source.as_ref()).0 == dump(&path, "1", folder.path()), "{name}");
            builds(path.to_str().expect("path"), &[]);
        }
        // A raster within a file, by GDAL's name for it.
        let name = format!("NETCDF:\"{}\":Band1", folder.path().join("plain.nc").display());
        assert!(builds(&name, &[]).starts_with("plain_Band1.rlv"));
    }

    /// `zip` without a program of that name.
    fn zip(archive: &Path, files: &[&Path]) {
        let script = "import sys, zipfile, os\nz = zipfile.ZipFile(sys.argv[1], 'w', zipfile.ZIP_DEFLATED)\n\
                      [z.write(f, 'in/' + os.path.basename(f)) for f in sys.argv[2:]]\nz.close()";
        let mut arguments = vec!["-c", script, archive.to_str().expect("path")];
        arguments.extend(files.iter().map(|file| file.to_str().expect("path")));
        run("python3", &arguments);
    }

    #[test]
    fn rasters_in_archives() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let dem = fixture("rmnp_dem_uint16.tif");
        let archive = folder.path().join("data.zip");
        zip(&archive, &[&dem]);
        let name = format!("/vsizip/{}/in/rmnp_dem_uint16.tif", archive.display());
        let source = open(Path::new(&name));
        assert!(sweep(source.as_ref()).0 == dump(&dem, "1", folder.path()));
        assert!(builds(&name, &[]).starts_with("rmnp_dem_uint16.rlv"));
        assert!(builds(&name, &["--crs", "EPSG:32613"]).contains("EPSG:32613"));
        // It counts as changed as soon as its archive is.
        let before = source.fingerprint().expect("fingerprint");
        assert_eq!(before, open(Path::new(&name)).fingerprint().expect("fingerprint"));
        assert_eq!(before.files[0].name, "rmnp_dem_uint16.tif");
        zip(&archive, &[&dem, &fixture("co_elevation_float32_lzw.tif")]);
        assert_ne!(before, source.fingerprint().expect("fingerprint"));
        std::fs::remove_file(&archive).expect("remove");
        assert_ne!(Some(before), source.fingerprint().ok());
    }

    #[test]
    fn rasters_on_a_server() {
        use std::io::BufRead;
        let folder = tempfile::tempdir().expect("temporary folder");
        std::fs::copy(fixture("rmnp_dem_uint16.tif"), folder.path().join("far.tif")).expect("copy");
        let script = "import http.server, os, sys\nos.chdir(sys.argv[1])\n\
                      s = http.server.ThreadingHTTPServer(('127.0.0.1', 0), http.server.SimpleHTTPRequestHandler)\n\
                      print(s.server_port, flush=True)\ns.serve_forever()";
        let mut server = Command::new("python3")
            .args(["-c", script, folder.path().to_str().expect("path")])
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::null())
            .spawn()
            .expect("python3");
        let mut port = String::new();
        std::io::BufReader::new(server.stdout.take().expect("output")).read_line(&mut port).expect("port");
        let name = format!("/vsicurl/http://127.0.0.1:{}/far.tif", port.trim());
        let found = std::panic::catch_unwind(|| {
            let source = open(Path::new(&name));
            assert_eq!(source.fingerprint().expect("fingerprint").files[0].bytes, 54_538);
            assert!(sweep(source.as_ref()).0 == dump(&fixture("rmnp_dem_uint16.tif"), "1", folder.path()));
            builds(&name, &[])
        });
        server.kill().expect("stop the server");
        let _ = server.wait();
        assert!(found.expect("as above").starts_with("far.rlv"));
    }

    #[test]
    fn other_planets() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("planet.tif");
        let other = folder.path().join("planet.img");
        // Metres of the hundredth of a degree at the equator, by the ellipsoids of the IAU.
        for (a, b, east, north) in
            [(1_737_400.0, 1_737_400.0, 303.234, 303.234), (3_396_190.0, 3_376_200.0, 592.747, 585.790)]
        {
            for (srs, lattice) in [
                (format!("+proj=longlat +a={a} +b={b} +no_defs"), "0 0.2 0.2 0"),
                (format!("+proj=eqc +lon_0=180 +a={a} +b={b} +no_defs"), "0 4000 4000 0"),
            ] {
                run(
                    "gdal_translate",
                    &[
                        &["-q", "-a_srs", &srs, "-a_ullr"][..],
                        &lattice.split(' ').collect::<Vec<_>>(),
                        &["-outsize", "20", "20", fixture("rmnp_dem_uint16.tif").to_str().expect("path")],
                        &[path.to_str().expect("path")],
                    ]
                    .concat(),
                );
                translate("-of HFA", &path, &other);
                for path in [&path, &other] {
                    let source = open(path);
                    let info = source.info();
                    let ellipsoid = info.geo.crs.ellipsoid;
                    assert_eq!(ellipsoid.a, a, "{srs}: {}", path.display());
                    let polar = if ellipsoid.inverse_flattening == 0.0 {
                        a
                    } else {
                        a - a / ellipsoid.inverse_flattening
                    };
                    assert!((polar - b).abs() < 1e-3, "{srs}: {polar}");
                    assert_eq!(info.geo.crs.epsg, None, "{srs}");
                    let spacing = info.geo.spacing((0, 19), (0, 19));
                    let expected = if srs.contains("longlat") { (east, north) } else { (200.0, 200.0) };
                    assert!((spacing.dx - expected.0).abs() < 0.01, "{srs}: {spacing:?}");
                    assert!((spacing.dy - expected.1).abs() < 0.01, "{srs}: {spacing:?}");
                    builds(path.to_str().expect("path"), &[]);
                }
            }
        }
    }

    #[test]
    fn depths_and_turned_grids() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("depth.tif");
        let text = path.to_str().expect("path");
        translate("-a_srs EPSG:32611+5715 -a_ullr 0 20 20 0", &fixture("rmnp_dem_uint16.tif"), &path);
        for source in [
            Box::new(TiffSource::open(&path, &Limits::default()).expect("native")) as Box<dyn Source>,
            Box::new(GdalSource::open(&path, &Limits::default()).expect("GDAL")),
        ] {
            let crs = &source.info().geo.crs;
            assert!(crs.vertical_down && crs.vertical_epsg == Some(5715), "{crs:?}");
        }
        let info = builds(text, &[]);
        assert!(info.contains("EPSG:5715") && info.contains("positive down"), "{info}");
        let info = builds(text, &["--depth"]);
        assert!(!info.contains("EPSG:5715") && !info.contains("positive down"), "{info}");
        let info = builds(text, &["--depth", "--vertical-unit", "ft", "--resolution", "0.1"]);
        assert!(info.contains("unit       ft, 0.3048 m"), "{info}");
        // A survey of 25 m bins, 36.87 degrees off north, in no system at all; depths by the scale
        // of the file.
        let vrt = folder.path().join("survey.vrt");
        translate("-of VRT -a_nodata none", &fixture("rmnp_dem_uint16.tif"), &vrt);
        let plain = std::fs::read_to_string(&vrt).expect("VRT");
        let (before, rest) = plain.split_once("<SRS").expect("SRS");
        let (_, after) = rest.split_once("</GeoTransform>").expect("geotransform");
        let (bins, at_band) =
            ("<GeoTransform>500000, 20, 15, 4000000, 15, -20</GeoTransform>", "<ColorInterp>");
        let scaled = after.replace(at_band, &format!("<Offset>-100</Offset><Scale>-0.5</Scale>{at_band}"));
        std::fs::write(&vrt, format!("{before}{bins}{scaled}")).expect("write");
        translate("", &vrt, &path);
        builds(text, &[]);
        for source in [
            Box::new(TiffSource::open(&path, &Limits::default()).expect("native")) as Box<dyn Source>,
            Box::new(GdalSource::open(&vrt, &Limits::default()).expect("GDAL")),
        ] {
            let spacing = source.info().geo.spacing((0, 100), (0, 100));
            assert!((spacing.dx - 25.0).abs() < 1e-3 && (spacing.dy - 25.0).abs() < 1e-3, "{spacing:?}");
            assert_eq!((source.info().band_scale, source.info().band_offset), (-0.5, -100.0));
        }
    }

    #[test]
    fn opens_what_the_native_reader_refuses() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("lerc.tif");
        translate("-co COMPRESS=LERC", &fixture("rmnp_dem_uint16.tif"), &path);
        compare(&path, None, folder.path());
        assert!(open(&path).info().description.contains("GDAL"));
        translate("-ot CFloat32", &fixture("rmnp_dem_uint16.tif"), &path);
        let error = source::open(&path, &Limits::default()).err().expect("complex").to_string();
        assert!(error.contains("complex samples"), "{error}");
        let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
        for name in [
            "N44W072.hgt",
            "n44_w072.dt1",
            "SainteHelens.dem",
            "cairns_topobathy_int.asc",
            "georgia_pair.vrt",
        ] {
            if shared.join(name).exists() {
                let source = open(&shared.join(name));
                assert!(sweep(source.as_ref()).0 == dump(&shared.join(name), "1", folder.path()), "{name}");
            } else {
                eprintln!("{name} is not there: not compared");
            }
        }
    }
}
