//! Mesh files: what is written is what any reader gets, and what anyone wrote is read.

mod damage;
mod foreign;
mod others;
mod refused;
mod validator;

use std::path::{Path, PathBuf};

use proptest::prelude::*;
use relevo::mesh_file::{Affine, Content, Encoding, Format, Picture, Up, Vertex, Writer, read};

/// The smallest PNG that a decoder takes: one pixel.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x08\0\0\0\0\x3a\x7e\x9b\x55\0\0\0\nIDAT\x78\x9c\x63\x60\0\0\0\x02\0\x01\x48\xaf\xa4\x71\0\0\0\0IEND\xae\x42\x60\x82";

/// A mesh to write.
#[derive(Clone, Debug)]
struct Given {
    format: Format,
    content: Content,
    vertices: Vec<Vertex>,
    triangles: Vec<[u32; 3]>,
}

/// A grid of 5 x 4 places, with heights from `seed`, and a content for them.
fn grid(format: Format, map: Affine, short: bool, seed: u64) -> Given {
    let (mut vertices, mut state) = (Vec::new(), seed | 1);
    for row in 0..4 {
        for column in 0..5 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let height = (state >> 40) as f64 / 1000.0 - 3000.0;
            let normal = [0.6 * (state >> 33 & 1) as f32, 0.0, 1.0];
            let length = normal.iter().map(|v| v * v).sum::<f32>().sqrt();
            vertices.push(Vertex {
                place: [f64::from(column) - 2.0, f64::from(row) * 3.0, height],
                normal: normal.map(|v| v / length),
                error: state as f32,
                level: column as u8,
            });
        }
    }
    let mut triangles = Vec::new();
    for row in 0..3 {
        for column in 0..4 {
            let (a, c) = (row * 5 + column, row * 5 + column + 5);
            triangles.extend([[a, c, c + 1], [a, c + 1, a + 1]]);
        }
    }
    let of = |fold: fn(f64, f64) -> f64| {
        [0, 1, 2].map(|i| vertices.iter().map(|v| v.place[i]).reduce(fold).expect("vertices"))
    };
    let bounds = (of(f64::min), of(f64::max));
    let least = (bounds.1[2] - bounds.0[2]) / 65535.0;
    // Steps of metres are like those across, and then normals are bytes.
    let step = [
        1.0,
        1.0,
        if seed.is_multiple_of(3) { least.max(map.matrix[0][0].hypot(map.matrix[1][0])) } else { least },
    ];
    let encoding = if short { Encoding::Short { origin: bounds.0, step } } else { Encoding::Float };
    let content = Content {
        vertices: vertices.len() as u64,
        triangles: triangles.len() as u64,
        map,
        encoding,
        up: if format == Format::Glb { Up::Y } else { Up::Z },
        has_normals: false,
        has_errors: false,
        picture: None,
        bounds,
        about: serde_json::Value::Null,
        generator: "relevo test".to_owned(),
    };
    Given { format, content, vertices, triangles }
}

/// Adds all that the format can hold.
fn adorned(mut given: Given) -> Given {
    let content = &mut given.content;
    content.has_normals = given.format != Format::Stl;
    content.has_errors = given.format == Format::Ply;
    if given.format != Format::Stl {
        let uv = [[0.2, 0.0, 0.4], [0.0, 0.1, 0.0]];
        content.picture = Some(Picture { bytes: PNG.to_vec(), mime: "image/png", uv });
    }
    content.about = serde_json::json!({"max_error_m": 2.5, "crs": "Zürich \u{1f30d}\n", "n": [1, null]});
    given
}

/// Metres of a lattice whose rows run south.
fn usual() -> Affine {
    let matrix = [[27.3, 0.0, 0.0], [0.0, -30.1, 0.0], [0.0, 0.0, 1.0]];
    Affine { matrix, offset: [-1234.5678, 0.1, 1500.25] }
}

/// Writes a mesh; returns its path and what is told of its vertices.
fn write(given: &Given, folder: &Path) -> (PathBuf, Vec<[f64; 3]>) {
    let path = folder.join(format!("a mesh.{}", given.format.name()));
    let mut writer = Writer::create(&path, given.format, given.content.clone(), true).expect("writer");
    let stored = given.vertices.iter().map(|vertex| writer.stored(vertex.place)).collect();
    for some in given.vertices.chunks(7) {
        writer.vertices(some).expect("vertices");
    }
    for some in given.triangles.chunks(5) {
        writer.triangles(some).expect("triangles");
    }
    let bytes = writer.finish().expect("finish");
    assert_eq!(bytes, std::fs::metadata(&path).expect("file").len());
    (path, stored)
}

/// Triangles by coordinates: STL has no others.
fn corners(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<[[f64; 3]; 3]> {
    triangles.iter().map(|t| t.map(|index| vertices[index as usize])).collect()
}

/// Maps that scale, turn, shear or mirror, all with heights upward.
fn maps() -> impl Strategy<Value = Affine> {
    let number = || -1000.0..1000.0_f64;
    let offset = [number(), number(), number()];
    let turned = |angle: f64, size: f64| {
        let (s, c) = angle.sin_cos();
        [[c * size, s * size, 0.0], [s * size, -c * size, 0.0], [0.0, 0.0, 1.0]]
    };
    let matrix = prop_oneof![
        (0.1..100.0, 0.1..100.0).prop_map(|(x, y): (f64, f64)| [
            [x, 0.0, 0.0],
            [0.0, -y, 0.0],
            [0.0, 0.0, 1.0]
        ]),
        (0.1..100.0, 0.1..100.0).prop_map(|(x, y): (f64, f64)| [
            [x, 0.0, 0.0],
            [0.0, y, 0.0],
            [0.0, 0.0, 1.0]
        ]),
        (0.0..6.0, 0.1..100.0).prop_map(move |(angle, size)| turned(angle, size)),
        (0.1..9.0, 0.1..9.0).prop_map(|(x, y): (f64, f64)| [
            [x, 0.3, 0.1],
            [0.2, -y - 1.0, 0.2],
            [0.3, 0.1, 1.0]
        ]),
    ];
    (matrix, offset).prop_map(|(matrix, offset)| Affine { matrix, offset })
}

/// Any mesh to write.
fn meshes() -> impl Strategy<Value = Given> {
    let formats = prop::sample::select(vec![Format::Glb, Format::Obj, Format::Ply, Format::Stl]);
    (formats, maps(), any::<(bool, bool, bool, u64)>()).prop_map(|(format, map, (short, full, y, seed))| {
        // A node cannot shear, and 16 bits are for nodes.
        let shears = map.matrix[2][0] != 0.0;
        let mut given = grid(format, map, short && format == Format::Glb && !shears, seed);
        if y {
            given.content.up = Up::Y;
        }
        if full { adorned(given) } else { given }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn what_is_read_is_what_was_told(given in meshes()) {
        let folder = tempfile::tempdir().expect("folder");
        let (path, stored) = write(&given, folder.path());
        let mesh = read(&path, Some(given.content.up)).expect("read");
        if given.format == Format::Stl {
            prop_assert_eq!(corners(&mesh.vertices, &mesh.triangles), corners(&stored, &given.triangles));
        } else {
            prop_assert_eq!(&mesh.vertices, &stored);
            prop_assert_eq!(&mesh.about, &given.content.about);
            prop_assert_eq!(&mesh.triangles, &given.triangles);
        }
        others::check(&given, &path, &stored);
        // What is kept is near what was given.
        let step = match given.content.encoding {
            Encoding::Float => 0.02,
            Encoding::Short { step, .. } => step[2],
        };
        for (vertex, there) in given.vertices.iter().zip(&stored) {
            let exact = given.content.map.apply(vertex.place);
            for (a, b) in exact.iter().zip(there) {
                prop_assert!((a - b).abs() <= 0.501 * step.max(0.02), "{exact:?} {there:?}");
            }
        }
    }
}

#[test]
fn lattice_columns_and_rows_are_exact() {
    for short in [false, true] {
        let folder = tempfile::tempdir().expect("folder");
        let given = grid(Format::Glb, usual(), short, 5);
        let (_, stored) = write(&given, folder.path());
        for (vertex, there) in given.vertices.iter().zip(stored) {
            let exact = usual().apply(vertex.place);
            for i in 0..2 {
                assert!(
                    (there[i] - exact[i]).abs() <= 1e-12 * exact[i].abs().max(1.0),
                    "{there:?} {exact:?}"
                );
            }
        }
    }
}

#[test]
fn more_vertices_than_16_bits_number() {
    for count in [65535_u32, 65536] {
        let folder = tempfile::tempdir().expect("folder");
        let mut given = grid(Format::Glb, usual(), false, 1);
        given.vertices = (0..count)
            .map(|i| Vertex { place: [i.into(), (i % 2).into(), 0.0], ..Vertex::default() })
            .collect();
        given.triangles = (0..count - 2).map(|i| [i, i + 1, i + 2]).collect();
        (given.content.vertices, given.content.triangles) = (count.into(), u64::from(count) - 2);
        given.content.bounds = ([0.0; 3], [f64::from(count - 1), 1.0, 0.0]);
        let (path, stored) = write(&given, folder.path());
        let mesh = read(&path, None).expect("read");
        assert_eq!((&mesh.vertices, &mesh.triangles), (&stored, &given.triangles));
        others::check(&given, &path, &stored);
    }
}

#[test]
fn a_size_is_told_before() {
    for format in [Format::Glb, Format::Ply, Format::Stl, Format::Obj] {
        for full in [false, true] {
            let folder = tempfile::tempdir().expect("folder");
            let given = grid(format, usual(), false, 9);
            let given = if full { adorned(given) } else { given };
            let (path, _) = write(&given, folder.path());
            let bytes = std::fs::metadata(&path).expect("file").len();
            let told = relevo::mesh_file::size(format, &given.content).expect("size");
            let name = if full && format == Format::Ply { "a_mesh.PNG".len() as u64 } else { 0 };
            assert!(
                told + name == bytes || format == Format::Obj && told >= bytes,
                "{format:?}: {told} {bytes}"
            );
        }
    }
}
