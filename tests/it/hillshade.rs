//! Grey relief against `gdaldem hillshade`, on real terrain.

use std::path::Path;
use std::process::Command;

use relevo::hillshade::{Options, Style, hillshade, write_png};

/// Columns and rows of the fixture.
const SIZE: (usize, usize) = (1007, 633);

fn gdal(tool: &str, arguments: &[&str]) {
    let output = Command::new(tool).args(arguments).output();
    let output = output.unwrap_or_else(|error| {
        panic!("{tool} is needed to compare with ({error}); install gdal-bin, or run test.sh")
    });
    assert!(output.status.success(), "{tool} {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// The fixture as metres on a grid of 10 m x 8 m: its heights, and a TIFF of them for GDAL.
fn metric_grid(folder: &Path) -> (Vec<f32>, String) {
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/dem/co_elevation_float32_lzw.tif");
    let name = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (grid, raw) = (name("grid.tif"), name("grid.raw"));
    let corners = ["-a_ullr", "0", "5064", "10070", "0", "-a_srs", "EPSG:32613"];
    gdal("gdal_translate", &[&["-q"], &corners[..], &[source, &grid]].concat());
    gdal("gdal_translate", &["-q", "-of", "ENVI", &grid, &raw]);
    let bytes = std::fs::read(raw).unwrap();
    let heights: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect();
    assert_eq!(heights.len(), SIZE.0 * SIZE.1);
    (heights, grid)
}

#[test]
fn greys_are_those_of_gdaldem() {
    let folder = tempfile::tempdir().unwrap();
    let (heights, grid) = metric_grid(folder.path());
    let shade = folder.path().join("shade.raw").to_str().unwrap().to_owned();
    for (azimuth, altitude, exaggeration) in [(315.0, 45.0, 1.0), (200.0, 30.0, 2.5), (45.0, 80.0, 0.5)] {
        let numbers = [azimuth, altitude, exaggeration].map(|x: f64| x.to_string());
        let [az, alt, z] = &numbers;
        let how = ["-az", az, "-alt", alt, "-z", z, "-s", "1", "-of", "ENVI"];
        gdal("gdaldem", &[&["hillshade", "-q"], &how[..], &[&grid, &shade]].concat());
        let expected = std::fs::read(&shade).unwrap();

        let options =
            Options { azimuth, altitude, exaggeration, style: Style::Grey, ..Options::new(10.0, 8.0) };
        let picture = hillshade(&heights, SIZE.0, SIZE.1, &options).unwrap();
        let mut differ = 0;
        for y in 1..SIZE.1 - 1 {
            for x in 1..SIZE.0 - 1 {
                let (ours, theirs) = (picture[4 * (y * SIZE.0 + x)], expected[y * SIZE.0 + x]);
                assert!(ours.abs_diff(theirs) <= 1, "column {x}, row {y}: {ours}, gdaldem says {theirs}");
                differ += usize::from(ours != theirs);
            }
        }
        assert!(differ < SIZE.0 * SIZE.1 / 100, "{differ} samples differ by one grey");
    }
}

#[test]
fn a_relief_of_real_terrain_is_opaque_and_of_many_colours() {
    let folder = tempfile::tempdir().unwrap();
    let (heights, _) = metric_grid(folder.path());
    let picture = hillshade(&heights, SIZE.0, SIZE.1, &Options::new(8.0, 10.3)).unwrap();
    assert!(picture.chunks_exact(4).all(|pixel| pixel[3] == 255));
    let mut colours: Vec<&[u8]> = picture.chunks_exact(4).collect();
    colours.sort_unstable();
    colours.dedup();
    assert!(colours.len() > 2000, "{} colours", colours.len());
    // RELEVO_PICTURES=folder keeps the picture, for a look at it.
    let keep = std::env::var_os("RELEVO_PICTURES").map(std::path::PathBuf::from);
    let path = keep.as_deref().unwrap_or(folder.path()).join("co_elevation.png");
    write_png(&path, &picture, SIZE.0 as u32, SIZE.1 as u32).unwrap();
    assert!(path.metadata().unwrap().len() > 100_000);
}
