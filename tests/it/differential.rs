//! What Relevo takes a raster for, against GDAL's reading of it: `tests/differential.py`, some
//! hundred rasters.

use std::path::Path;
use std::process::Command;

/// A Python that has GDAL's bindings: the first of the path may be another than Debian's, which has
/// them.
fn python() -> &'static str {
    let has = |name: &&str| {
        Command::new(name)
            .args(["-c", "import numpy; from osgeo import gdal"])
            .output()
            .is_ok_and(|o| o.status.success())
    };
    ["python3", "/usr/bin/python3"].into_iter().find(has).expect(
        "a python3 with GDAL's bindings and numpy (Debian: apt-get install python3-gdal python3-numpy)",
    )
}

#[test]
fn rasters_mean_what_gdal_takes_them_for() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/differential.py");
    let output = Command::new(python())
        .arg(script)
        .args(["--relevo", env!("CARGO_BIN_EXE_relevo"), "--count", "400", "--seed", "1"])
        .args(cfg!(feature = "gdal").then_some("--gdal"))
        .output()
        .expect("python3");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}\n{}", String::from_utf8_lossy(&output.stderr));
}
