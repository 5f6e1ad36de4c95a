//! The GeoTIFF writer against GDAL: what `gdalinfo` and `gdal_translate` read back is what was
//! written.

use std::path::{Path, PathBuf};
use std::process::Command;

use rayon::prelude::*;
use relevo::error::Error;
use relevo::geo::{Crs, CrsKind, Geo, GeoKeys};
use relevo::geotiff_write::{Compression, GeotiffSpec, GeotiffWriter};
use relevo::sample::SampleType;
use relevo::source::Samples;
use serde_json::Value;

/// A GDAL tool's standard output; fails with what to install if the tool is missing.
fn gdal(tool: &str, arguments: &[&str]) -> String {
    let output = Command::new(tool).args(arguments).output();
    let output = output.unwrap_or_else(|error| {
        panic!("{tool} is needed to read the files back ({error}); install gdal-bin, or run test.sh")
    });
    let errors = String::from_utf8_lossy(&output.stderr);
    // PROJ complains that a local system has no ellipsoid; that is as it should be.
    let complaint = errors.lines().find(|line| !line.contains("PROJ: "));
    assert!(output.status.success() && complaint.is_none(), "{tool} {arguments:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

fn info(path: &Path) -> Value {
    serde_json::from_str(&gdal("gdalinfo", &["-json", path.to_str().unwrap()])).unwrap()
}

/// GDAL's geotransform to the last bit, which gdalinfo rounds and a VRT has.
fn geotransform(path: &Path) -> [f64; 6] {
    let vrt = path.with_extension("vrt");
    gdal("gdal_translate", &["-q", "-of", "VRT", path.to_str().unwrap(), vrt.to_str().unwrap()]);
    let vrt = std::fs::read_to_string(vrt).unwrap();
    let numbers = vrt.split("<GeoTransform>").nth(1).unwrap().split("</GeoTransform>").next().unwrap();
    let numbers: Vec<f64> = numbers.split(',').map(|number| number.trim().parse().unwrap()).collect();
    numbers.try_into().unwrap()
}

/// Samples as GDAL decodes them, as little-endian bytes.
fn pixels(path: &Path, sample_type: SampleType) -> Vec<u8> {
    let raw = path.with_extension("raw");
    let (path, raw_path) = (path.to_str().unwrap(), raw.to_str().unwrap());
    if sample_type == SampleType::Int8 {
        // ENVI has no signed bytes, and GDAL before 3.7 takes them for unsigned: the low byte is
        // theirs either way.
        gdal("gdal_translate", &["-q", "-of", "ENVI", "-ot", "Int16", path, raw_path]);
        return std::fs::read(raw).unwrap().into_iter().step_by(2).collect();
    }
    gdal("gdal_translate", &["-q", "-of", "ENVI", path, raw_path]);
    let mut bytes = std::fs::read(raw).unwrap();
    // GDAL begins an ENVI file with two zero bytes: they are there even if the raster has one.
    if bytes.len() == 2 && sample_type == SampleType::Uint8 {
        bytes.pop();
    }
    bytes
}

/// Terrain-like noise over the whole range of the type, extremes and special values included.
fn samples(sample_type: SampleType, count: usize) -> Samples {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut height = 0_i64;
    let mut next = move |i: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        height += (state >> 60) as i64 - 7;
        if i.is_multiple_of(97) { state as i64 } else { height }
    };
    let float = |i: usize, bits: i64| if i % 89 == 5 { f64::INFINITY } else { bits as f64 / 7.0 };
    let range = 0..count;
    match sample_type {
        SampleType::Int8 => Samples::Int8(range.map(|i| next(i) as i8).collect()),
        SampleType::Uint8 => Samples::Uint8(range.map(|i| next(i) as u8).collect()),
        SampleType::Int16 => Samples::Int16(range.map(|i| next(i) as i16).collect()),
        SampleType::Uint16 => Samples::Uint16(range.map(|i| next(i) as u16).collect()),
        SampleType::Int32 => Samples::Int32(range.map(|i| next(i) as i32).collect()),
        SampleType::Uint32 => Samples::Uint32(range.map(|i| next(i) as u32).collect()),
        SampleType::Float32 => Samples::Float32(range.map(|i| float(i, next(i)) as f32).collect()),
        SampleType::Float64 => Samples::Float64(range.map(|i| float(i, next(i))).collect()),
    }
}

/// A part of some samples, and all of them as little-endian bytes.
macro_rules! for_each_type {
    ($samples:expr, $v:ident, $variant:ident => $result:expr) => {
        match $samples {
            Samples::Int8($v) => {
                use Samples::Int8 as $variant;
                $result
            }
            Samples::Uint8($v) => {
                use Samples::Uint8 as $variant;
                $result
            }
            Samples::Int16($v) => {
                use Samples::Int16 as $variant;
                $result
            }
            Samples::Uint16($v) => {
                use Samples::Uint16 as $variant;
                $result
            }
            Samples::Int32($v) => {
                use Samples::Int32 as $variant;
                $result
            }
            Samples::Uint32($v) => {
                use Samples::Uint32 as $variant;
                $result
            }
            Samples::Float32($v) => {
                use Samples::Float32 as $variant;
                $result
            }
            Samples::Float64($v) => {
                use Samples::Float64 as $variant;
                $result
            }
        }
    };
}

fn part(samples: &Samples, range: std::ops::Range<usize>) -> Samples {
    for_each_type!(samples, v, Variant => Variant(v[range].to_vec()))
}

fn bytes(samples: &Samples) -> Vec<u8> {
    #[allow(unused_imports, reason = "the variant is of use to `part` alone")]
    let bytes = for_each_type!(samples, v, Variant => v.iter().flat_map(|x| x.to_le_bytes()).collect());
    bytes
}

/// Writes all samples in pieces of `rows` rows.
fn write(path: &Path, spec: &GeotiffSpec, samples: &Samples, rows: usize) -> u64 {
    let (width, count) = (spec.width as usize, spec.width as usize * spec.height as usize);
    let mut writer = GeotiffWriter::create(path, spec).unwrap();
    for start in (0..count).step_by(rows * width) {
        writer.write_rows(&part(samples, start..(start + rows * width).min(count))).unwrap();
    }
    writer.finish().unwrap()
}

fn utm() -> Geo {
    Geo {
        transform: Some([500_000.5, 30.0, 0.0, 5_100_000.25, 0.0, -30.0]),
        pixel_is_point: false,
        crs: Crs { kind: CrsKind::Projected, epsg: Some(32632), ..Crs::default() },
    }
}

fn in_folder(name: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    (folder, path)
}

#[test]
fn every_type_compression_and_shape_reads_back_the_same() {
    SampleType::ALL.into_par_iter().for_each(|sample_type| {
        for compression in [Compression::None, Compression::Deflate, Compression::Zstd] {
            for (width, height, tile) in
                [(1, 1, None), (1197, 643, None), (300, 643, Some(128)), (5, 40, Some(16))]
            {
                reads_back_the_same(sample_type, compression, (width, height), tile);
            }
        }
    });
}

fn reads_back_the_same(
    sample_type: SampleType,
    compression: Compression,
    (width, height): (u32, u32),
    tile: Option<u32>,
) {
    let (_folder, path) = in_folder("a.tif");
    let geo = utm();
    let samples = samples(sample_type, (width * height) as usize);
    let spec = GeotiffSpec { compression, tile, ..GeotiffSpec::new(width, height, sample_type, &geo) };
    write(&path, &spec, &samples, 100);
    let what = format!("{sample_type:?} {compression:?} {width} x {height} tile {tile:?}");
    let (read, written) = (pixels(&path, sample_type), bytes(&samples));
    let differ = read.iter().zip(&written).position(|(a, b)| a != b);
    assert!(read == written, "{what}: {} bytes for {}, {differ:?}", read.len(), written.len());
    if height != 643 {
        return;
    }
    let info = info(&path);
    assert_eq!(info["size"], serde_json::json!([width, height]), "{what}");
    let scheme = match compression {
        Compression::None => Value::Null,
        Compression::Deflate => "DEFLATE".into(),
        Compression::Zstd => "ZSTD".into(),
    };
    assert_eq!(info["metadata"]["IMAGE_STRUCTURE"]["COMPRESSION"], scheme, "{what}");
    let side = tile.unwrap_or(width);
    assert_eq!(info["bands"][0]["block"][0], side, "{what}");
    let kind = info["bands"][0]["type"].as_str().unwrap();
    // GDAL before 3.7 knows signed bytes by a mark beside the type alone.
    assert!(kind == sample_type.gdal_name() || sample_type == SampleType::Int8, "{what}: {kind}");
}

#[test]
fn bigtiff_is_the_same_raster() {
    let (_folder, path) = in_folder("big.tif");
    let geo = utm();
    let samples = samples(SampleType::Float32, 300 * 700);
    for tile in [None, Some(64)] {
        let spec = GeotiffSpec {
            bigtiff: Some(true),
            tile,
            nodata: Some(-9999.0),
            force: true,
            ..GeotiffSpec::new(300, 700, SampleType::Float32, &geo)
        };
        write(&path, &spec, &samples, 64);
        assert_eq!(std::fs::read(&path).unwrap()[..4], *b"II\x2b\0");
        assert!(pixels(&path, SampleType::Float32) == bytes(&samples));
        assert_eq!(geotransform(&path), geo.transform.unwrap());
    }
}

#[test]
fn bytes_depend_neither_on_threads_nor_on_how_the_rows_come() {
    let (_folder, path) = in_folder("a.tif");
    let geo = utm();
    let samples = samples(SampleType::Int32, 1700 * 1300);
    // More than one batch of rows.
    let compression = Compression::Zstd;
    let spec =
        GeotiffSpec { compression, force: true, ..GeotiffSpec::new(1700, 1300, SampleType::Int32, &geo) };
    let mut files = Vec::new();
    for (threads, rows) in [(1, 1300), (4, 1300), (4, 1), (2, 333)] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| write(&path, &spec, &samples, rows));
        files.push(std::fs::read(&path).unwrap());
    }
    assert!(files.iter().all(|file| *file == files[0]));
    assert!(pixels(&path, SampleType::Int32) == bytes(&samples));
}

#[test]
fn geotransforms_read_back_bit_for_bit() {
    let (_folder, path) = in_folder("a.tif");
    let transforms = [
        [500_000.5, 30.0, 0.0, 5_100_000.25, 0.0, -30.0],
        [-123.000_416_666_666_67, 1.0 / 1200.0, 0.0, 50.000_416_666_666_7, 0.0, -1.0 / 1200.0],
        [300_000.0, 8.66, 5.0, 4_000_000.0, 5.0, -8.66],
        [10.0, 2.0, 0.0, 20.0, 0.0, 2.0],
        [0.1, -0.3, 0.0, 0.7, 0.0, -0.3],
    ];
    for transform in transforms {
        for pixel_is_point in [false, true] {
            let geo = Geo { transform: Some(transform), pixel_is_point, ..utm() };
            let spec = GeotiffSpec { force: true, ..GeotiffSpec::new(3, 2, SampleType::Int16, &geo) };
            write(&path, &spec, &samples(SampleType::Int16, 6), 1);
            assert_eq!(geotransform(&path), transform, "point: {pixel_is_point}");
            let expected = if pixel_is_point { "Point" } else { "Area" };
            assert_eq!(info(&path)["metadata"][""]["AREA_OR_POINT"], expected);
        }
    }
}

/// Authority and code at the end of GDAL's WKT 2, as `"EPSG",32632`.
fn ends_with_id(info: &Value, id: &str) -> bool {
    let wkt = info["coordinateSystem"]["wkt"].as_str().unwrap_or_default();
    wkt.replace(['\n', ' '], "").ends_with(&format!("ID[{id}]]"))
}

#[test]
fn coordinate_systems_read_back() {
    let (_folder, path) = in_folder("a.tif");
    let written = |crs: Crs| {
        let geo = Geo { crs, ..utm() };
        let spec = GeotiffSpec { force: true, ..GeotiffSpec::new(3, 2, SampleType::Int16, &geo) };
        write(&path, &spec, &samples(SampleType::Int16, 6), 2);
        info(&path)
    };
    let wkt = |info: &Value| info["coordinateSystem"]["wkt"].as_str().unwrap_or_default().to_owned();

    assert!(ends_with_id(&written(utm().crs), "\"EPSG\",32632"));
    let degrees = Crs {
        kind: CrsKind::Geographic,
        epsg: Some(4269),
        unit: 1_f64.to_radians(),
        vertical_epsg: Some(5703),
        ..Crs::default()
    };
    let compound = wkt(&written(degrees.clone()));
    assert!(compound.starts_with("COMPOUNDCRS") && compound.contains("\"EPSG\",5703"), "{compound}");
    assert!(ends_with_id(&written(Crs { vertical_epsg: None, ..degrees.clone() }), "\"EPSG\",4269"));

    let sphere = relevo::geo::Ellipsoid { a: 1_737_400.0, inverse_flattening: 0.0 };
    let moon = wkt(&written(Crs {
        epsg: None,
        vertical_epsg: None,
        ellipsoid: sphere,
        name: "Moon | 2000".to_owned(),
        ..degrees
    }));
    assert!(moon.contains("GEOGCRS") && moon.contains("1737400,0"), "{moon}");
    assert!(moon.contains("Moon _ 2000"), "{moon}");

    // Nothing known, and a name alone.
    assert_eq!(wkt(&written(Crs::default())), "");
    let named = wkt(&written(Crs { name: "Quarry grid".to_owned(), ..Crs::default() }));
    assert!(named.contains("ENGCRS") && named.contains("Quarry grid"), "{named}");
}

#[test]
fn a_projected_crs_without_code_travels_as_its_text() {
    let (_folder, path) = in_folder("a.tif");
    let proj = "+proj=tmerc +lat_0=49 +lon_0=8.5 +k=0.99995 +x_0=500000 +y_0=0 +ellps=bessel +units=m";
    let text = gdal("gdalsrsinfo", &["-o", "wkt2", "--single-line", proj]);
    let crs = Crs {
        kind: CrsKind::Projected,
        name: "unknown".to_owned(),
        wkt: text.trim().to_owned(),
        ..Crs::default()
    };
    let geo = Geo { crs, ..utm() };
    let spec = GeotiffSpec::new(3, 2, SampleType::Int16, &geo);
    write(&path, &spec, &samples(SampleType::Int16, 6), 2);
    let read = gdal("gdalsrsinfo", &["-o", "proj4", path.to_str().unwrap()]);
    for parameter in ["+proj=tmerc", "+lat_0=49", "+lon_0=8.5", "+k=0.99995", "+x_0=500000", "+ellps=bessel"]
    {
        assert!(read.contains(parameter), "{parameter} is not in {read}");
    }
}

#[test]
fn geokeys_are_written_back_as_they_were() {
    let (_folder, path) = in_folder("a.tif");
    // User-defined Albers on NAD83, PixelIsPoint, as GDAL writes it.
    let keys = GeoKeys {
        directory: vec![
            1, 1, 0, 15, 1024, 0, 1, 1, 1025, 0, 1, 2, 1026, 34737, 11, 0, 2048, 0, 1, 4269, 2054, 0, 1,
            9102, 3072, 0, 1, 32767, 3074, 0, 1, 32767, 3075, 0, 1, 11, 3076, 0, 1, 9001, 3078, 34736, 1, 0,
            3079, 34736, 1, 1, 3080, 34736, 1, 2, 3081, 34736, 1, 3, 3082, 34736, 1, 4, 3083, 34736, 1, 5,
        ],
        doubles: vec![29.5, 45.5, -96.0, 23.0, 1000.0, 2000.0],
        ascii: "My Albers!|".to_owned(),
    };
    // The keys say point, so point it is, whatever the other field says.
    let geo = Geo { crs: Crs { kind: CrsKind::Projected, keys: Some(keys), ..Crs::default() }, ..utm() };
    let spec = GeotiffSpec::new(3, 2, SampleType::Int16, &geo);
    write(&path, &spec, &samples(SampleType::Int16, 6), 2);
    let info = info(&path);
    assert_eq!(geotransform(&path), geo.transform.unwrap());
    assert_eq!(info["metadata"][""]["AREA_OR_POINT"], "Point");
    let read = gdal("gdalsrsinfo", &["-o", "proj4", path.to_str().unwrap()]);
    for parameter in
        ["+proj=aea", "+lat_1=29.5", "+lat_2=45.5", "+lat_0=23", "+lon_0=-96", "+x_0=1000", "+y_0=2000"]
    {
        assert!(read.contains(parameter), "{parameter} is not in {read}");
    }
    assert!(info["coordinateSystem"]["wkt"].as_str().unwrap().contains("My Albers!"));
}

#[test]
fn nothing_known_is_nothing_written() {
    let (_folder, path) = in_folder("a.tif");
    let geo = Geo::default();
    write(&path, &GeotiffSpec::new(3, 2, SampleType::Uint8, &geo), &samples(SampleType::Uint8, 6), 2);
    let info = info(&path);
    assert!(info.get("geoTransform").is_none());
    let band = &info["bands"][0];
    assert!(["noDataValue", "scale", "offset", "unit"].iter().all(|key| band.get(key).is_none()), "{band}");
}

#[test]
fn nodata_scale_offset_and_unit_read_back() {
    let (_folder, path) = in_folder("a.tif");
    let geo = utm();
    let lowest = f64::from(f32::MIN);
    for (sample_type, nodata) in [
        (SampleType::Int16, -32768.0),
        (SampleType::Uint16, 65535.0),
        (SampleType::Float32, -9999.0),
        (SampleType::Float32, lowest),
        (SampleType::Float64, -1.0e-7),
        (SampleType::Float32, f64::NAN),
    ] {
        let spec = GeotiffSpec {
            nodata: Some(nodata),
            band_scale: 0.1,
            band_offset: -500.25,
            unit: "ft <US> & \"more\"",
            force: true,
            ..GeotiffSpec::new(3, 2, sample_type, &geo)
        };
        write(&path, &spec, &samples(sample_type, 6), 2);
        let band = info(&path)["bands"][0].clone();
        match &band["noDataValue"] {
            Value::String(text) => assert!(text == "NaN" && nodata.is_nan(), "{text}"),
            // gdalinfo prints a float32's nodata with seven digits.
            number => {
                assert!((number.as_f64().unwrap() / nodata - 1.0).abs() < 1e-6, "{number} for {nodata}");
            }
        }
        assert_eq!(band["scale"].as_f64(), Some(0.1));
        assert_eq!(band["offset"].as_f64(), Some(-500.25));
        assert_eq!(band["unit"], "ft <US> & \"more\"");
    }
}

#[test]
fn an_unfinished_file_leaves_nothing_and_a_finished_one_is_not_overwritten() {
    let (folder, path) = in_folder("a.tif");
    let geo = utm();
    let spec = GeotiffSpec::new(4, 4, SampleType::Int16, &geo);
    let left = || std::fs::read_dir(folder.path()).unwrap().count();

    let mut writer = GeotiffWriter::create(&path, &spec).unwrap();
    writer.write_rows(&Samples::Int16(vec![1; 12])).unwrap();
    assert_eq!(left(), 1);
    assert!(matches!(writer.finish(), Err(Error::Usage { .. })));
    assert_eq!(left(), 0);

    write(&path, &spec, &Samples::Int16(vec![7; 16]), 4);
    let before = std::fs::read(&path).unwrap();
    assert!(matches!(GeotiffWriter::create(&path, &spec), Err(Error::Exists { .. })));
    drop(GeotiffWriter::create(&path, &GeotiffSpec { force: true, ..spec.clone() }).unwrap());
    assert_eq!((left(), std::fs::read(&path).unwrap()), (1, before));
    write(&path, &GeotiffSpec { force: true, ..spec }, &Samples::Int16(vec![9; 16]), 4);
    assert_eq!(pixels(&path, SampleType::Int16), [9, 0].repeat(16));
}

#[test]
fn a_target_that_comes_into_being_meanwhile_is_kept() {
    let (folder, path) = in_folder("a.tif");
    let geo = utm();
    let mut writer = GeotiffWriter::create(&path, &GeotiffSpec::new(2, 1, SampleType::Uint8, &geo)).unwrap();
    writer.write_rows(&Samples::Uint8(vec![1, 2])).unwrap();
    std::fs::write(&path, "somebody else's").unwrap();
    assert!(matches!(writer.finish(), Err(Error::Exists { .. })));
    assert_eq!(std::fs::read(&path).unwrap(), b"somebody else's");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn what_makes_no_sense_is_refused() {
    let (_folder, path) = in_folder("a.tif");
    let geo = utm();
    let spec = GeotiffSpec::new(4, 2, SampleType::Int16, &geo);
    for wrong in [
        GeotiffSpec { width: 0, ..spec.clone() },
        GeotiffSpec { height: 0, ..spec.clone() },
        GeotiffSpec { tile: Some(0), ..spec.clone() },
        GeotiffSpec { tile: Some(100), ..spec.clone() },
    ] {
        assert!(matches!(GeotiffWriter::create(&path, &wrong), Err(Error::Usage { .. })), "{wrong:?}");
    }
    for huge in [
        GeotiffSpec { tile: Some(1 << 20), ..spec.clone() },
        GeotiffSpec { width: u32::MAX, ..spec.clone() },
        GeotiffSpec { tile: Some(u32::MAX - 15), width: u32::MAX, height: u32::MAX, ..spec.clone() },
    ] {
        assert!(matches!(GeotiffWriter::create(&path, &huge), Err(Error::Limit { .. })), "{huge:?}");
    }
    let mut writer = GeotiffWriter::create(&path, &spec).unwrap();
    for wrong in [Samples::Uint16(vec![0; 4]), Samples::Int16(vec![0; 5]), Samples::Int16(vec![0; 12])] {
        assert!(matches!(writer.write_rows(&wrong), Err(Error::Usage { .. })), "{wrong:?}");
    }
    let nowhere = Path::new("no-such-folder").join("a.tif");
    assert!(matches!(GeotiffWriter::create(nowhere, &spec), Err(Error::Io { .. })));
}

#[test]
fn the_tiff_crate_reads_every_type() {
    use tiff::decoder::{Decoder, DecodingResult as R};
    let (_folder, path) = in_folder("a.tif");
    let geo = utm();
    for sample_type in SampleType::ALL {
        let samples = samples(sample_type, 301 * 207);
        let spec = GeotiffSpec { force: true, ..GeotiffSpec::new(301, 207, sample_type, &geo) };
        write(&path, &spec, &samples, 20);
        let file = std::io::BufReader::new(std::fs::File::open(&path).unwrap());
        let read = match Decoder::new(file).unwrap().read_image().unwrap() {
            R::I8(v) => Samples::Int8(v),
            R::U8(v) => Samples::Uint8(v),
            R::I16(v) => Samples::Int16(v),
            R::U16(v) => Samples::Uint16(v),
            R::I32(v) => Samples::Int32(v),
            R::U32(v) => Samples::Uint32(v),
            R::F32(v) => Samples::Float32(v),
            R::F64(v) => Samples::Float64(v),
            _ => panic!("another type"),
        };
        assert!(read == samples, "{sample_type:?}");
    }
}
