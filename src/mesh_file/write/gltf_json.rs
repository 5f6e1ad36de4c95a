//! The JSON of a GLB.

use serde_json::{Map, Value, json};

use super::glb::has_byte_normals;
use super::{Content, Encoding};
use crate::mesh_file::Affine;

/// A run of bytes of the binary chunk.
pub(super) struct View {
    pub(super) offset: u64,
    pub(super) length: u64,
}

const FLOAT: u16 = 5126;
const BYTE: u16 = 5120;
const SHORT: u16 = 5123;
const INT: u16 = 5125;

/// Adds views and accessors, which are known by number.
struct Lists<'a> {
    views: &'a [View],
    view_list: Vec<Value>,
    accessors: Vec<Value>,
}

impl Lists<'_> {
    /// A view of the layout; returns its number.
    fn view(&mut self, view: usize, more: Value) -> usize {
        let View { offset, length } = self.views[view];
        let mut entry = json!({"buffer": 0, "byteOffset": offset, "byteLength": length});
        if let (Some(entry), Value::Object(more)) = (entry.as_object_mut(), more) {
            entry.extend(more);
        }
        self.view_list.push(entry);
        self.view_list.len() - 1
    }

    /// An attribute of vertices; returns the number of its accessor.
    fn attribute(&mut self, view: usize, count: u64, stride: u64, form: (u16, bool, &str)) -> usize {
        let (component, normalized, shape) = form;
        let view = self.view(view, json!({"byteStride": stride, "target": 34962}));
        let mut accessor =
            json!({"bufferView": view, "componentType": component, "count": count, "type": shape});
        if normalized {
            accessor["normalized"] = true.into();
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}

/// Numbers as they are in the file: integers without a point.
fn numbers(values: [f64; 3], integers: bool) -> Value {
    let is_whole = |v: &f64| integers && v.fract() == 0.0 && (0.0..=65535.0).contains(v);
    values.iter().map(|v| if is_whole(v) { json!(*v as u16) } else { json!(v) }).collect()
}

/// The text; `bounds` are of positions as they are kept.
pub(super) fn text(content: &Content, node: &Affine, views: &[View], bounds: ([f64; 3], [f64; 3])) -> String {
    let short = content.encoding != Encoding::Float;
    let mut lists = Lists { views, view_list: Vec::new(), accessors: Vec::new() };
    let count = content.vertices;
    let mut attributes = Map::new();
    let (stride, component) = if short { (8, SHORT) } else { (12, FLOAT) };
    let positions = lists.attribute(0, count, stride, (component, false, "VEC3"));
    lists.accessors[positions]["min"] = numbers(bounds.0, short);
    lists.accessors[positions]["max"] = numbers(bounds.1, short);
    attributes.insert("POSITION".to_owned(), positions.into());
    if content.has_normals {
        let bytes = has_byte_normals(content, node);
        let (stride, component) = if bytes { (4, BYTE) } else { (12, FLOAT) };
        let normals = lists.attribute(1, count, stride, (component, bytes, "VEC3"));
        attributes.insert("NORMAL".to_owned(), normals.into());
    }
    if content.picture.is_some() {
        let (stride, component) = if short { (4, SHORT) } else { (8, FLOAT) };
        let texels = lists.attribute(2, count, stride, (component, short, "VEC2"));
        attributes.insert("TEXCOORD_0".to_owned(), texels.into());
    }
    let view = lists.view(3, json!({"target": 34963}));
    let component = if count > 65535 { INT } else { SHORT };
    let indices = json!({"bufferView": view, "componentType": component, "count": content.triangles * 3, "type": "SCALAR"});
    lists.accessors.push(indices);
    let mut material =
        json!({"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 1}, "doubleSided": false});
    let image = content.picture.as_ref().map(|picture| {
        material["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": 0});
        json!([{"bufferView": lists.view(4, json!({})), "mimeType": picture.mime}])
    });
    let mut root = json!({
        "asset": {"version": "2.0", "generator": content.generator},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node_json(node)],
        "meshes": [{"primitives": [
            {"attributes": attributes, "indices": lists.accessors.len() - 1, "material": 0, "mode": 4}
        ]}],
        "materials": [material],
        "accessors": lists.accessors,
        "bufferViews": lists.view_list,
        "buffers": [{"byteLength": views.last().map_or(0, |view| view.offset + view.length)}],
    });
    if !content.about.is_null() {
        root["asset"]["extras"] = content.about.clone();
    }
    if short {
        let extensions = json!(["KHR_mesh_quantization"]);
        root["extensionsUsed"] = extensions.clone();
        root["extensionsRequired"] = extensions;
    }
    if let Some(image) = image {
        root["images"] = image;
        root["samplers"] = json!([{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}]);
        root["textures"] = json!([{"sampler": 0, "source": 0}]);
    }
    root.to_string()
}

/// The node: translation and scale if that is all, else a matrix, column by column.
fn node_json(node: &Affine) -> Value {
    let mut json = json!({"mesh": 0});
    let [[a, b, c], [d, e, f], [g, h, i]] = node.matrix;
    let scale = [a, e, i];
    if [b, c, d, f, g, h] != [0.0; 6] || scale.iter().any(|v| *v < 0.0) {
        let [x, y, z] = node.offset;
        json["matrix"] = json!([a, d, g, 0.0, b, e, h, 0.0, c, f, i, 0.0, x, y, z, 1.0]);
        return json;
    }
    if node.offset != [0.0; 3] {
        json["translation"] = json!(node.offset);
    }
    if scale != [1.0; 3] {
        json["scale"] = json!(scale);
    }
    json
}
