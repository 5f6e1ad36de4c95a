//! Files as others write them.

use std::path::PathBuf;

use relevo::mesh_file::{Mesh, Up, read};
use serde_json::json;

/// The mesh of bytes under a name, or what is said of them.
pub(super) fn read_bytes(name: &str, bytes: &[u8]) -> Result<Mesh, String> {
    let folder = tempfile::tempdir().expect("folder");
    let path: PathBuf = folder.path().join(name);
    std::fs::write(&path, bytes).expect("write");
    read(&path, Some(if name.ends_with("glb") { Up::Y } else { Up::Z })).map_err(|error| error.to_string())
}

/// A GLB of some JSON and bytes.
pub(super) fn glb(json: &serde_json::Value, bin: &[u8]) -> Vec<u8> {
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bin = bin.to_vec();
    bin.resize(bin.len().next_multiple_of(4), 0);
    let mut out = b"glTF".to_vec();
    let words = |values: &[u32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>();
    out.extend(words(&[2, (28 + text.len() + bin.len()) as u32, text.len() as u32, 0x4e4f_534a]));
    out.extend(text);
    out.extend(words(&[bin.len() as u32, 0x004e_4942]));
    out.extend(bin);
    out
}

#[test]
fn obj_in_all_its_ways() {
    let text =
        b"# made by hand\nmtllib a.mtl\no thing\nv 0 0 0 1 0 0\nv 1 0 0 \\\n 0.5\r\nv 1 1 0\nv 0 1e0 -2.5\n\
        vt 0 0\nvn 0 0 1\nf 1 2/1 3//1 4/1/1 # four\nf -4 -3 -2\ng x\ns off\nl 1 2\n";
    let mesh = read_bytes("a.OBJ", text).expect("OBJ");
    assert_eq!(mesh.vertices, [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, -2.5]]);
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2]]);
    for (bad, said) in [
        ("v 0 0 nan\n", "line 1: expected a finite coordinate"),
        ("v 0 0\n", "line 1: expected a number"),
        ("v 0 0 0\nf 1 1 2\n", "line 2: expected one of the 1 vertices"),
        ("v 0 0 0\nf 1 0 1\n", "line 2: expected the number of a vertex"),
        ("v 0 0 0\nf 1 1 -2\n", "line 2: expected the number of a vertex"),
        ("v 0 0 0\nf 1 1\n", "line 2: expected 3 corners"),
    ] {
        let error = read_bytes("a.obj", bad.as_bytes()).expect_err(bad);
        assert!(error.contains(said) && error.contains("a.obj"), "{error}");
    }
}

/// One square of all types, in text and in both orders of bytes.
#[test]
fn ply_in_all_its_ways() {
    let types = ["char", "uint8", "short", "uint16", "int", "uint32", "float", "double"];
    for kind in types {
        let header = |format: &str| {
            format!(
                "ply\r\nformat {format} 1.0\r\ncomment x\nobj_info y\nelement junk 2\nproperty list uchar {kind} a\n\
                property {kind} b\nelement vertex 4\nproperty {kind} z\nproperty uchar red\nproperty {kind} x\n\
                property {kind} y\nelement face 1\nproperty list uchar uint vertex_index\nproperty uchar flag\nend_header\n"
            )
        };
        let text = header("ascii") + "2 7 7 1\n0\n9\n5 255 0 0\n5 1 1 0\n5 1 1 1 5 1 0 1\n4 0 1 2 3 6\n";
        let expected = vec![[0.0, 0.0, 5.0], [1.0, 0.0, 5.0], [1.0, 1.0, 5.0], [0.0, 1.0, 5.0]];
        let mesh = read_bytes("a.ply", text.as_bytes()).expect(kind);
        assert_eq!((&mesh.vertices, &mesh.triangles), (&expected, &vec![[0, 1, 2], [0, 2, 3]]));
        for (format, big) in [("binary_little_endian", false), ("binary_big_endian", true)] {
            let value = |v: u8| -> Vec<u8> {
                let mut bytes = match kind {
                    "char" | "uint8" => vec![v],
                    "short" | "uint16" => u16::from(v).to_le_bytes().to_vec(),
                    "int" | "uint32" => u32::from(v).to_le_bytes().to_vec(),
                    "float" => f32::from(v).to_le_bytes().to_vec(),
                    _ => f64::from(v).to_le_bytes().to_vec(),
                };
                if big {
                    bytes.reverse();
                }
                bytes
            };
            let mut file = header(format).into_bytes();
            file.extend([vec![2], value(7), value(7), value(1), vec![0], value(9)].concat());
            for [x, y] in [[0, 0], [1, 0], [1, 1], [0, 1]] {
                file.extend([value(5), vec![200], value(x), value(y)].concat());
            }
            file.push(4);
            let index = |i: u32| if big { i.to_be_bytes() } else { i.to_le_bytes() };
            file.extend((0..4).flat_map(index));
            file.push(1);
            let mesh = read_bytes("a.ply", &file).expect(kind);
            assert_eq!((&mesh.vertices, &mesh.triangles), (&expected, &vec![[0, 1, 2], [0, 2, 3]]));
        }
    }
}

#[test]
fn stl_is_told_by_its_size() {
    let text = b"solid a name of solid vertex\n facet normal 0 0 1e-3\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n\
        vertex 1 1 0\n  endloop\n endfacet\nfacet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 1 0 vertex 0 1 0 endloop\n\
        endfacet\nendsolid\n";
    let mesh = read_bytes("a.stl", text).expect("text");
    assert_eq!((mesh.vertices.len(), &mesh.triangles), (4, &vec![[0, 1, 2], [0, 2, 3]]));
    // Bytes with a header that begins as text does.
    let mut bytes = b"solid".to_vec();
    bytes.resize(80, b' ');
    bytes.extend(1_u32.to_le_bytes());
    bytes.extend(
        [0.0_f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.5].map(f32::to_le_bytes).concat(),
    );
    bytes.extend([0, 0]);
    assert_eq!(read_bytes("a.stl", &bytes).expect("bytes").vertices[2], [1.0, 1.0, 0.5]);
    bytes[84 + 12..84 + 16].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(read_bytes("a.stl", &bytes).expect_err("NaN").contains("byte 96"));
    assert!(read_bytes("a.stl", &bytes[..100]).is_err());
}

/// Nodes in nodes, modes, types of indices, normalised positions.
#[test]
fn glb_in_its_ways() {
    let mut bin: Vec<u8> = Vec::new();
    for p in [[0_i16, 0, 0], [32767, 0, 0], [32767, 0, -32768], [0, 0, -32767]] {
        bin.extend(p.iter().flat_map(|v| v.to_le_bytes()));
        bin.extend([0, 0]);
    }
    bin.extend([0_u8, 1, 2, 3]);
    let json = |mode: u64, matrix: serde_json::Value| {
        json!({
            "asset": {"version": "2.0"}, "scenes": [{"nodes": [1]}],
            "nodes": [{"mesh": 0, "scale": [2, 1, 3]}, {"children": [0], "matrix": matrix}, {"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": mode}]}],
            "accessors": [
                {"bufferView": 0, "componentType": 5122, "normalized": true, "count": 4, "type": "VEC3"},
                {"bufferView": 1, "componentType": 5121, "count": 4, "type": "SCALAR"}],
            "bufferViews": [{"buffer": 0, "byteLength": 32, "byteStride": 8}, {"buffer": 0, "byteOffset": 32, "byteLength": 4}],
            "buffers": [{"byteLength": 36}], "extensionsRequired": ["KHR_mesh_quantization"],
        })
    };
    let moved = json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 10, 20, 30, 1]);
    let mesh = read_bytes("a.glb", &glb(&json(6, moved.clone()), &bin)).expect("fan");
    // (x, y, z) of glTF is (x, -z, y) here.
    assert_eq!(
        mesh.vertices,
        [[10.0, -30.0, 20.0], [12.0, -30.0, 20.0], [12.0, -27.0, 20.0], [10.0, -27.0, 20.0]]
    );
    assert_eq!(mesh.triangles, [[1, 2, 0], [2, 3, 0]]);
    let mesh = read_bytes("a.glb", &glb(&json(5, moved.clone()), &bin)).expect("strip");
    assert_eq!(mesh.triangles, [[0, 1, 2], [1, 3, 2]]);
    let mirrored = json!([-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
    let mesh = read_bytes("a.glb", &glb(&json(6, mirrored), &bin)).expect("mirrored");
    assert_eq!(mesh.triangles, [[1, 0, 2], [2, 0, 3]]);
    let bad = |change: fn(&mut serde_json::Value), said: &str| {
        let mut json = json(6, json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]));
        change(&mut json);
        let error = read_bytes("a.glb", &glb(&json, &bin)).expect_err(said);
        assert!(error.contains(said), "{error}");
    };
    bad(|json| json["accessors"][0]["sparse"] = json!({}), "sparse");
    bad(|json| json["accessors"][0]["count"] = json!(5), "5 elements");
    bad(|json| json["accessors"][0]["count"] = json!(u64::MAX), "elements");
    bad(|json| json["accessors"][1]["count"] = json!(u64::MAX), "elements");
    bad(|json| json["nodes"][0]["children"] = json!([1]), "a circle");
    bad(|json| json["extensionsRequired"] = json!(["EXT_meshopt_compression"]), "EXT_meshopt_compression");
    bad(|json| json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]), "KHR_draco");
    bad(
        |json| json["nodes"][0] = json!({"mesh": 0, "scale": [1e308, 1, 1], "translation": [1e308, 0, 0]}),
        "a finite coordinate",
    );
}
