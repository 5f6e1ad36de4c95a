//! Real DEMs, through the library: lossless, verified by brute force, and as small as promised.
//!
//! The two bundled DEMs always; the rasters of `../shared/data` where they are there.

use std::path::{Path, PathBuf};
use std::process::Command;

use relevo::container::{Metric, Reader};
use relevo::limits::Limits;
use relevo::pipeline::{self, BuildOptions, Silent};
use relevo::source;
use relevo::verify::{VerifyOptions, VerifyReport, verify};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A raster of the shared data, or `None`, said aloud.
fn shared(name: &str) -> Option<PathBuf> {
    let path = root().join("../shared/data").join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("{name} is not there: not tested");
    None
}

fn fixtures() -> [PathBuf; 2] {
    ["co_elevation_float32_lzw.tif", "rmnp_dem_uint16.tif"].map(|name| root().join("fixtures/dem").join(name))
}

/// Builds a DEM and checks the file against it, every error by brute force. Returns the report and
/// the file's length.
fn build(dem: &Path, options: &BuildOptions) -> (VerifyReport, u64) {
    checked(dem, options, true)
}

/// [`build`], by brute force only if `deep`.
fn checked(dem: &Path, options: &BuildOptions, deep: bool) -> (VerifyReport, u64) {
    let folder = tempfile::tempdir().expect("folder");
    let output = folder.path().join("out.rlv");
    let source = source::open(dem, &Limits::default()).expect("source");
    pipeline::build(&*source, &output, options, &Silent).expect("build");
    let reader = Reader::open(&output).expect("open");
    let how = VerifyOptions { deep, ..VerifyOptions::default() };
    let report = verify(&reader, Some(&*source), &how, &Silent).expect("verify");
    let problems: Vec<_> = report.checks.iter().flat_map(|check| &check.first).collect();
    assert!(report.is_good(), "{} with {options:?}: {problems:#?}", dem.display());
    (report, reader.file_len())
}

#[test]
fn bundled_dems_hold_every_promise_in_many_shapes() {
    for dem in fixtures() {
        for (tile, patch) in [(256, 64), (64, 64), (16, 4), (1024, 32), (128, 8)] {
            for metric in [Metric::Bound, Metric::Paper] {
                build(&dem, &BuildOptions { tile, patch, metric, ..BuildOptions::default() });
            }
        }
        build(&dem, &BuildOptions { precision_m: Some(0.01), ..BuildOptions::default() });
        build(&dem, &BuildOptions { precision_m: Some(5.0), tile: 64, ..BuildOptions::default() });
    }
}

/// Builds shared rasters, every error by brute force: none below the truth, and vertical ones near
/// it.
fn hold_every_promise(names: &[&str]) {
    for name in names {
        let Some(dem) = shared(name) else { continue };
        let (report, _) = build(&dem, &BuildOptions::default());
        for row in &report.tightness {
            let vertical = row.vertical.as_ref().expect("metric bound has ratios");
            assert!(vertical.median <= 1.05 && vertical.p99 <= 1.25, "{name}: {row:?}");
        }
    }
}

#[test]
fn shared_dems_hold_every_promise() {
    hold_every_promise(&[
        "mt_rainier_srtm3_int16_voids.tif",
        "N49W123_srtm3_int16_voids.tif",
        "bigtujunga_utm11_int16.tif",
        "exploradores_aster_float32_nodata.tif",
    ]);
}

#[test]
fn shared_dems_with_many_voids_hold_every_promise() {
    hold_every_promise(&[
        "everest_srtm3_int16_voids.tif",
        "N49W124_srtm3_int16_voids.tif",
        "nz_elev_float32_nan.tif",
    ]);
}

/// From pole to pole: without brute force, which takes minutes where every meridian ends in one
/// point.
#[test]
fn the_whole_earth_is_built_and_read() {
    let Some(dem) = shared("etopo20_world_bathymetry_float32.tif") else { return };
    checked(&dem, &BuildOptions::default(), false);
}

/// The same heights, stored in other ways.
#[test]
fn variants_of_one_dem_are_read_alike() {
    for name in [
        "rainier_var_bigendian_lzw.tif",
        "rainier_var_bigtiff_zstd.tif",
        "rainier_var_deflate_float32_pred3.tif",
        "rainier_var_lzw_pred2_tiled.tif",
        "rainier_var_uncompressed_strips.tif",
    ] {
        let Some(dem) = shared(name) else { continue };
        checked(&dem, &BuildOptions::default(), false);
    }
}

/// Bytes of GDAL's cloud-optimised GeoTIFF of a raster: zstd, predictor, overviews.
fn cog_bytes(dem: &Path, folder: &Path) -> u64 {
    let output = folder.join("cog.tif");
    let options = "-q -of COG -co COMPRESS=ZSTD -co PREDICTOR=YES -co OVERVIEW_RESAMPLING=NEAREST";
    let done = Command::new("gdal_translate").args(options.split(' ')).arg(dem).arg(&output).status();
    let done = done.expect("gdal_translate runs: install gdal-bin, as ./test.sh does");
    assert!(done.success());
    std::fs::metadata(&output).expect("COG").len()
}

#[test]
fn files_are_about_half_of_a_cog() {
    let folder = tempfile::tempdir().expect("folder");
    let co = fixtures()[0].clone();
    let precise = BuildOptions { precision_m: Some(0.01), ..BuildOptions::default() };
    let mut bars = vec![(co.clone(), BuildOptions::default(), 0.75), (co, precise, 0.40)];
    for name in [
        "mt_rainier_srtm3_int16_voids.tif",
        "everest_srtm3_int16_voids.tif",
        "bigtujunga_utm11_int16.tif",
        "N49W123_srtm3_int16_voids.tif",
    ] {
        bars.extend(shared(name).map(|dem| (dem, BuildOptions::default(), 0.55)));
    }
    if let Some(hgt) = shared("N44W072.hgt") {
        let dem = folder.path().join("N44W072.tif");
        let done = Command::new("gdal_translate").arg("-q").arg(hgt).arg(&dem).status();
        assert!(done.expect("gdal_translate runs").success());
        bars.push((dem, BuildOptions::default(), 0.55));
    }
    for (dem, options, bar) in bars {
        let (_, bytes) = checked(&dem, &options, false);
        let ratio = bytes as f64 / cog_bytes(&dem, folder.path()) as f64;
        println!("{}: {ratio:.3} of the COG", dem.display());
        assert!(ratio <= bar, "{}: {ratio:.3} of the COG, more than {bar}", dem.display());
    }
}
