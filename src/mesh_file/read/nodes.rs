//! The nodes of the default scene of a glTF, each with its place.

use serde_json::Value;

use crate::error::{Error, Result};
use crate::mesh_file::Affine;

/// A mesh at a place.
pub(super) struct Placed {
    pub(super) mesh: u64,
    pub(super) map: Affine,
}

const IDENTITY: Affine =
    Affine { matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], offset: [0.0; 3] };

/// The meshes of all nodes of the default scene, in the order of the file.
pub(super) fn placed(root: &Value) -> Result<Vec<Placed>> {
    let scene = root.get("scene").map_or(Some(0), Value::as_u64);
    let scene = scene.ok_or_else(|| Error::format("/scene", "the number of a scene", "another value"))?;
    let path = format!("/scenes/{scene}");
    let scene = root.pointer(&path).ok_or_else(|| Error::format(&path, "a scene", "none"))?;
    let nodes = root.get("nodes").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let mut is_seen = vec![false; nodes.len()];
    let mut found = Vec::new();
    let mut waiting = children(scene, "nodes", &path, &IDENTITY)?;
    while let Some((number, parent)) = waiting.pop() {
        let path = format!("/nodes/{number}");
        let index = usize::try_from(number).unwrap_or(usize::MAX);
        let node = nodes.get(index).ok_or_else(|| Error::format(&path, "a node", "none"))?;
        if std::mem::replace(&mut is_seen[index], true) {
            return Err(Error::format(&path, "a node of one parent", "several, or a circle"));
        }
        let map = joined(&parent, &own(node, &path)?);
        if let Some(mesh) = node.get("mesh") {
            if node.pointer("/extensions/EXT_mesh_gpu_instancing").is_some() {
                return Err(Error::unsupported("EXT_mesh_gpu_instancing", "save one node for each mesh"));
            }
            let mesh = mesh.as_u64();
            let mesh = mesh.ok_or_else(|| Error::format(&path, "the number of a mesh", "another value"))?;
            found.push(Placed { mesh, map });
        }
        waiting.extend(children(node, "children", &path, &map)?);
    }
    Ok(found)
}

/// The nodes that another names, last first, with the place of that.
fn children(of: &Value, name: &str, path: &str, map: &Affine) -> Result<Vec<(u64, Affine)>> {
    let Some(list) = of.get(name) else { return Ok(Vec::new()) };
    let numbers =
        list.as_array().map(|list| list.iter().rev().map(Value::as_u64).collect::<Option<Vec<_>>>());
    let numbers = numbers.flatten();
    let numbers = numbers
        .ok_or_else(|| Error::format(format!("{path}/{name}"), "numbers of nodes", "something else"))?;
    Ok(numbers.into_iter().map(|number| (number, *map)).collect())
}

/// `outer` after `inner`.
fn joined(outer: &Affine, inner: &Affine) -> Affine {
    // Nothing is rounded by what does nothing.
    if *outer == IDENTITY {
        return *inner;
    }
    let mut matrix = [[0.0; 3]; 3];
    for (i, row) in matrix.iter_mut().enumerate() {
        for (j, value) in row.iter_mut().enumerate() {
            *value = (0..3).map(|k| outer.matrix[i][k] * inner.matrix[k][j]).sum();
        }
    }
    Affine { matrix, offset: outer.apply(inner.offset) }
}

/// The place of a node in that of its parent.
fn own(node: &Value, path: &str) -> Result<Affine> {
    if let Some(m) = numbers::<16>(node, "matrix", path)? {
        let row = |i: usize| [m[i], m[4 + i], m[8 + i]];
        return Ok(Affine { matrix: [row(0), row(1), row(2)], offset: [m[12], m[13], m[14]] });
    }
    let offset = numbers::<3>(node, "translation", path)?.unwrap_or_default();
    let scale = numbers::<3>(node, "scale", path)?.unwrap_or([1.0; 3]);
    let [x, y, z, w] = numbers::<4>(node, "rotation", path)?.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let turned = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let matrix = turned.map(|[a, b, c]| [a * scale[0], b * scale[1], c * scale[2]]);
    Ok(Affine { matrix, offset })
}

/// Numbers of a node, if it has them.
fn numbers<const N: usize>(node: &Value, name: &str, path: &str) -> Result<Option<[f64; N]>> {
    let Some(list) = node.get(name) else { return Ok(None) };
    let list = list.as_array().filter(|list| list.len() == N);
    let mut numbers = [0.0; N];
    let is_sound = list.is_some_and(|list| {
        numbers.iter_mut().zip(list).all(|(number, value)| value.as_f64().map(|v| *number = v).is_some())
    });
    if is_sound {
        Ok(Some(numbers))
    } else {
        Err(Error::format(format!("{path}/{name}"), format!("{N} numbers"), "something else"))
    }
}
