//! `export` gives the source back: GDAL reads the same samples, size, place and voids from both.

use std::path::{Path, PathBuf};
use std::process::Command;

use relevo::container::Reader;
use relevo::export::{self, GeotiffOptions};
use relevo::geotiff_write::Compression;
use relevo::limits::Limits;
use relevo::pipeline::{self, BuildOptions, Silent};
use relevo::source;
use serde_json::Value;

fn rasters() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut all: Vec<PathBuf> = ["co_elevation_float32_lzw.tif", "rmnp_dem_uint16.tif", "tiny_3x2.tif"]
        .iter()
        .map(|name| root.join("fixtures/dem").join(name))
        .collect();
    for name in [
        "everest_srtm3_int16_voids.tif",
        "N49W123_srtm3_int16_voids.tif",
        "bigtujunga_utm11_int16.tif",
        "nz_elev_float32_nan.tif",
        "exploradores_aster_float32_nodata.tif",
        "etopo20_world_bathymetry_float32.tif",
    ] {
        let path = root.join("../shared/data").join(name);
        if path.exists() {
            all.push(path);
        } else {
            eprintln!("{name} is not there: not tested");
        }
    }
    all
}

fn gdal(program: &str, arguments: &[&str]) -> Vec<u8> {
    let output = Command::new(program).args(arguments).output();
    let output =
        output.unwrap_or_else(|_| panic!("{program} is missing: install gdal-bin, as ./test.sh does"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

fn text(path: &Path) -> &str {
    path.to_str().expect("utf-8 path")
}

/// Samples as GDAL reads them, and its description.
fn as_gdal_reads(path: &Path, folder: &Path) -> (Vec<u8>, Value) {
    let raw = folder.join("raw");
    gdal("gdal_translate", &["-q", "-of", "ENVI", text(path), text(&raw)]);
    let info = serde_json::from_slice(&gdal("gdalinfo", &["-json", text(path)])).expect("JSON");
    (std::fs::read(raw).expect("raw samples"), info)
}

#[test]
fn the_leaf_level_is_the_source() {
    let folder = tempfile::tempdir().expect("folder");
    let (rlv, tif) = (folder.path().join("x.rlv"), folder.path().join("x.tif"));
    for dem in rasters() {
        let source = source::open(&dem, &Limits::default()).expect("source");
        let options = BuildOptions { tile: 128, patch: 32, force: true, ..BuildOptions::default() };
        pipeline::build(&*source, &rlv, &options, &Silent).expect("build");
        let reader = Reader::open(&rlv).expect("open");
        let levels = reader.header().levels;
        let options = GeotiffOptions { level: levels, compression: Compression::Deflate, force: true };
        export::geotiff(&reader, &tif, options).expect("export");
        let (ours, info) = as_gdal_reads(&tif, folder.path());
        let (theirs, wanted) = as_gdal_reads(&dem, folder.path());
        for member in ["size", "geoTransform"] {
            assert_eq!(info[member], wanted[member], "{} {member}", dem.display());
        }
        assert_eq!(info["stac"]["proj:epsg"], wanted["stac"]["proj:epsg"], "{}", dem.display());
        // NaN has many bit patterns: the DEM with NaN voids is compared by value.
        if info["bands"][0]["type"] == "Float32" {
            let floats = |bytes: &[u8]| -> Vec<f32> {
                bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
            };
            let same =
                floats(&ours).iter().zip(&floats(&theirs)).all(|(a, b)| a == b || a.is_nan() && b.is_nan());
            assert!(same, "{}", dem.display());
        } else {
            assert!(ours == theirs, "{}", dem.display());
            let nodata = &wanted["bands"][0]["noDataValue"];
            assert!(nodata.is_null() || *nodata == info["bands"][0]["noDataValue"], "{}", dem.display());
        }
    }
}

#[test]
fn a_coarser_level_is_every_second_sample_in_its_place() {
    let folder = tempfile::tempdir().expect("folder");
    let (rlv, tif) = (folder.path().join("x.rlv"), folder.path().join("x.tif"));
    let dem = &rasters()[1];
    let source = source::open(dem, &Limits::default()).expect("source");
    let options = BuildOptions { tile: 16, patch: 8, ..BuildOptions::default() };
    pipeline::build(&*source, &rlv, &options, &Silent).expect("build");
    let reader = Reader::open(&rlv).expect("open");
    let (all, wanted) = as_gdal_reads(dem, folder.path());
    let width = 152;
    let sample = |bytes: &[u8], i: usize| u16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]);
    for level in 0..reader.header().levels {
        let options = GeotiffOptions { level, compression: Compression::None, force: true };
        let (columns, rows) = export::geotiff(&reader, &tif, options).expect("export");
        let (ours, info) = as_gdal_reads(&tif, folder.path());
        let step = 1_usize << (reader.header().levels - level);
        assert_eq!((columns as usize, rows as usize), (152_usize.div_ceil(step), 187_usize.div_ceil(step)));
        for row in 0..rows as usize {
            for column in 0..columns as usize {
                let there = sample(&all, row * step * width + column * step);
                assert_eq!(sample(&ours, row * columns as usize + column), there);
            }
        }
        // The first sample of both stands at the same place.
        let number = |info: &Value, i: usize| info["geoTransform"][i].as_f64().expect("number");
        for axis in [0, 3] {
            let centre =
                |info: &Value| number(info, axis) + 0.5 * (number(info, axis + 1) + number(info, axis + 2));
            assert!((centre(&info) - centre(&wanted)).abs() < 1e-9);
        }
    }
}
