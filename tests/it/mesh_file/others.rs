//! Readers of meshes that others wrote get back what is told.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use relevo::mesh_file::{Format, Up};

use super::{Given, corners};

/// Fails if another reader finds other vertices or triangles.
pub(super) fn check(given: &Given, path: &Path, stored: &[[f64; 3]]) {
    let z_up = |[x, y, z]: [f64; 3]| if given.content.up == Up::Y { [x, -z, y] } else { [x, y, z] };
    let (vertices, triangles) = match given.format {
        Format::Glb => glb(given, path),
        Format::Obj => obj(path),
        Format::Ply => ply(path),
        Format::Stl => stl(path),
    };
    let vertices: Vec<_> = vertices.into_iter().map(z_up).collect();
    // STL has no numbers of vertices, and tobj numbers them anew.
    if matches!(given.format, Format::Obj | Format::Stl) {
        assert_eq!(corners(&vertices, &triangles), corners(stored, &given.triangles));
    } else {
        assert_eq!(vertices, stored);
        assert_eq!(triangles, given.triangles);
    }
}

type Found = (Vec<[f64; 3]>, Vec<[u32; 3]>);

fn threes(indices: impl IntoIterator<Item = u32>) -> Vec<[u32; 3]> {
    indices.into_iter().collect::<Vec<_>>().chunks(3).map(|c| [c[0], c[1], c[2]]).collect()
}

/// Fails if bounds are not those of the positions.
fn check_bounds(positions: &[[f64; 3]], least: &serde_json::Value, most: &serde_json::Value) {
    for i in 0..3 {
        let of = |fold: fn(f64, f64) -> f64| positions.iter().map(|p| p[i]).reduce(fold);
        assert_eq!((least[i].as_f64(), most[i].as_f64()), (of(f64::min), of(f64::max)));
    }
}

/// The crate reads numbers of nodes as 32-bit floats: they are taken from the JSON.
fn glb(given: &Given, path: &Path) -> Found {
    let bytes = std::fs::read(path).expect("file");
    let length = u32::from_le_bytes(bytes[12..16].try_into().expect("length")) as usize;
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).expect("JSON");
    let gltf = gltf::Gltf::from_slice_without_validation(&bytes).expect("GLB");
    let blob = gltf.blob.as_deref().expect("chunk");
    let primitive = gltf.meshes().next().expect("mesh").primitives().next().expect("primitive");
    let reader = primitive.reader(|_| Some(blob));
    let accessor = primitive.get(&gltf::Semantic::Positions).expect("positions");
    let (least, most) = (accessor.min().expect("min"), accessor.max().expect("max"));
    let positions: Vec<[f64; 3]> = if accessor.data_type() == gltf::accessor::DataType::F32 {
        reader.read_positions().expect("positions").map(|p| p.map(f64::from)).collect()
    } else {
        let shorts = gltf::accessor::Iter::<[u16; 3]>::new(accessor, |_| Some(blob));
        shorts.expect("positions").map(|p| p.map(f64::from)).collect()
    };
    check_bounds(&positions, &least, &most);
    let node = &json["nodes"][0];
    let numbers = |name: &str| {
        let list = node[name].as_array()?;
        Some(list.iter().map(|v| v.as_f64().expect("number")).collect::<Vec<_>>())
    };
    let [x, y, z] = [0, 1, 2].map(|i| {
        if let Some(m) = numbers("matrix") {
            return [m[i], m[4 + i], m[8 + i], m[12 + i]];
        }
        let mut row = [0.0; 4];
        row[i] = numbers("scale").map_or(1.0, |scale| scale[i]);
        row[3] = numbers("translation").map_or(0.0, |offset| offset[i]);
        row
    });
    let determinant = x[0] * (y[1] * z[2] - z[1] * y[2]) - x[1] * (y[0] * z[2] - y[2] * z[0])
        + x[2] * (y[0] * z[1] - y[1] * z[0]);
    let place = |p: &[f64; 3]| [x, y, z].map(|r| r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + r[3]);
    if let Some(accessor) = primitive.get(&gltf::Semantic::Normals) {
        let kept: Vec<[f64; 3]> = if accessor.data_type() == gltf::accessor::DataType::F32 {
            reader.read_normals().expect("normals").map(|n| n.map(f64::from)).collect()
        } else {
            let bytes = gltf::accessor::Iter::<[i8; 3]>::new(accessor, |_| Some(blob)).expect("normals");
            bytes.map(|n| n.map(|v| f64::from(v) / 127.0)).collect()
        };
        // The inverse transposed: the cofactors, but for a factor.
        let cross = |a: [f64; 4], b: [f64; 4]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let cofactors = [cross(y, z), cross(z, x), cross(x, y)];
        for (vertex, kept) in given.vertices.iter().zip(kept) {
            let there = cofactors.map(|row| row.iter().zip(kept).map(|(a, b)| a * b).sum::<f64>());
            let length = there.iter().map(|v| v * v).sum::<f64>().sqrt() * determinant.signum();
            let [east, north, up] = vertex.normal.map(f64::from);
            let cosine = (there[0] * east + there[1] * up - there[2] * north) / length;
            assert!(cosine > 0.997, "{there:?} for {:?}", vertex.normal);
        }
    }
    let mut triangles = threes(reader.read_indices().expect("indices").into_u32());
    if determinant < 0.0 {
        for triangle in &mut triangles {
            triangle.swap(1, 2);
        }
    }
    (positions.iter().map(place).collect(), triangles)
}

fn obj(path: &Path) -> Found {
    let options = tobj::LoadOptions { single_index: false, ..tobj::LoadOptions::default() };
    let (models, materials) = tobj::load_obj(path, &options).expect("OBJ");
    let materials = materials.expect("materials");
    if let Some(material) = materials.first() {
        let picture = material.diffuse_texture.as_ref().expect("picture");
        assert!(path.with_file_name(picture).is_file());
        assert_eq!(models[0].mesh.material_id, Some(0));
    }
    let mesh = &models[0].mesh;
    let vertices = mesh.positions.chunks(3).map(|c| [c[0], c[1], c[2]]).collect();
    (vertices, threes(mesh.indices.iter().copied()))
}

fn ply(path: &Path) -> Found {
    use ply_rs_bw::ply::{DefaultElement, Property};
    let mut file = BufReader::new(File::open(path).expect("file"));
    let parser = ply_rs_bw::parser::Parser::<DefaultElement>::new();
    let ply = parser.read_ply(&mut file).expect("PLY");
    let double = |value: &Property| match value {
        Property::Double(value) => *value,
        other => panic!("{other:?}"),
    };
    let vertices = ply.payload["vertex"].iter().map(|v| ["x", "y", "z"].map(|axis| double(&v[axis])));
    let faces = ply.payload["face"].iter().flat_map(|face| match &face["vertex_indices"] {
        Property::ListInt(list) => list.iter().map(|index| *index as u32).collect::<Vec<_>>(),
        other => panic!("{other:?}"),
    });
    (vertices.collect(), threes(faces))
}

fn stl(path: &Path) -> Found {
    let mesh = stl_io::read_stl(&mut File::open(path).expect("file")).expect("STL");
    let vertices = mesh.vertices.iter().map(|v| v.0.map(f64::from)).collect();
    (vertices, threes(mesh.faces.iter().flat_map(|face| face.vertices.map(|index| index as u32))))
}
