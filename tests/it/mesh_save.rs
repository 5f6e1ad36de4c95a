//! The promise: what a mesh file says that it is off by at most, held against its terrain by
//! `mesh::check`, after the file has been read again.

use proptest::prelude::*;
use relevo::Error;
use relevo::container::Reader;
use relevo::geo::{Crs, CrsKind, WGS84};
use relevo::mesh::check::{Allowed, Options, Raster as Truth, check};
use relevo::mesh::{Frame, MeshOptions, Method, save};
use relevo::mesh_file;
use relevo::pipeline::{self, BuildOptions, Silent};
use serde_json::Value;

use crate::mesh_nested::terrain;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

/// Columns, rows and metres of coordinates, by what the file says of itself.
fn places(vertices: &[[f64; 3]], about: &Value) -> Vec<[f64; 3]> {
    let matrix: Vec<Vec<f64>> = about["to_frame"]["matrix"].as_array().unwrap().iter().map(numbers).collect();
    let offset = numbers(&about["to_frame"]["offset"]);
    let ([a, b], [d, e]) = ([matrix[0][0], matrix[0][1]], [matrix[1][0], matrix[1][1]]);
    let area = a * e - b * d;
    let back = |&[x, y, z]: &[f64; 3]| {
        let (x, y) = (x - offset[0], y - offset[1]);
        // Far from the origin the way back rounds by some 1e-10.
        let near_half =
            |v: f64| if ((2.0 * v).round() / 2.0 - v).abs() < 1e-8 { (2.0 * v).round() / 2.0 } else { v };
        [near_half((e * x - b * y) / area), near_half((a * y - d * x) / area), z]
    };
    vertices.iter().map(back).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn a_mesh_keeps_what_its_file_promises(
        (mut raster, extent, error) in terrain(), format in 0_usize..4, place in 0_usize..3,
        quantise: bool, precision in 0_usize..3, paper: bool, in_crs: bool, free: Option<bool>,
    ) {
        let folder = tempfile::tempdir().unwrap();
        raster.info.geo.transform = match place {
            0 => None,
            1 => Some([402_000.0, 10.0, 0.0, 4_800_000.0, 0.0, -10.0]),
            _ => Some([6.9, 0.000_8, 0.0, 51.2, 0.0, -0.000_8]),
        };
        if place == 2 {
            raster.info.geo.crs = Crs { kind: CrsKind::Geographic, ellipsoid: WGS84, unit: 1_f64.to_radians(), ..Crs::default() };
        }
        let built = folder.path().join("terrain.rlv");
        let options = BuildOptions {
            tile: 16,
            patch: 4,
            precision_m: [None, Some(0.5), Some(2.0)][precision],
            metric: if paper { relevo::container::layout::Metric::Paper } else { relevo::container::layout::Metric::Bound },
            ..BuildOptions::default()
        };
        pipeline::build(&raster, &built, &options, &Silent).unwrap();
        let reader = Reader::open(&built).unwrap();
        let output = folder.path().join(["m.glb", "m.ply", "m.obj", "m.stl"][format]);
        let options = MeshOptions {
            window: Some(extent.rect()),
            quantise: quantise && format == 0,
            method: free.map_or(Method::Nested, |any| Method::Free(if any { 0.0 } else { 5.0 })),
            frame: if in_crs && format != 3 && place > 0 { Frame::Crs } else { Frame::Local },
            ..MeshOptions::new(error)
        };
        let report = match save(&reader, &output, &options, &Silent) {
            Ok(report) => report,
            // An error below what the file or the format rounds, or nothing to draw.
            Err(Error::Usage { .. }) => return Ok(()),
            Err(error) => panic!("{error}"),
        };
        prop_assert!(report.promised_m <= error + 1e-9, "{} m is promised", report.promised_m);
        let mesh = mesh_file::read(&output, None).unwrap();
        prop_assert_eq!(mesh.triangles.len() as u64, report.triangles);
        prop_assert_eq!(mesh.vertices.len() as u64, report.vertices);
        let mut about = mesh.about["relevo"].clone();
        if format == 3 {
            // STL has no room: the same mesh as PLY says where it stands.
            let other = folder.path().join("other.ply");
            save(&reader, &other, &options, &Silent).unwrap();
            about = mesh_file::read(&other, None).unwrap().about["relevo"].clone();
        } else {
            prop_assert_eq!(about["max_error_m"].as_f64().unwrap(), report.promised_m);
        }
        let vertices = places(&mesh.vertices, &about);
        let near = if matches!(format, 0 | 3) { 1e-3 } else { 1e-6 };
        let options = Options { window: Some(extent.rect()), near, ..Options::default() };
        // In coordinates of columns and rows that run south the sense is the other one.
        let truth = check(&vertices, &mesh.triangles, &Truth(&raster), &options, &Silent).unwrap();
        prop_assert!(truth.keeps(report.promised_m + 1e-9), "{:?} {truth:?}", report);
        // With a few samples on the border alone, rounding can leave none to compare.
        prop_assert!(truth.is_sound(Allowed::default()) || truth.compared == 0, "{truth:?}");
    }
}
