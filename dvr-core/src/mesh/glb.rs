//! Writing binary glTF 2.0. (`registry.khronos.org/glTF/specs/2.0/glTF-2.0.html`; reading is in `gltf.rs`.)

use glam::Vec3;
use serde_json::{Value, json};

use super::triangle_mesh::Mesh;
use crate::srgb::srgb_to_linear;

// Names of the specification's numbers.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// The mesh as a GLB with one rough, two-sided material; vertex colours are stored linear, as glTF defines `COLOR_0`.
///
/// Observations become the application-specific attributes `_CONFIDENCE` and `_VIEWS` (section 3.7.2.1). The number of
/// views is a float as well: unsigned integers of 32 bits are for indices alone, and shorter ones would break the
/// alignment to four bytes.
///
/// A mesh without faces gives a valid file without a scene.
pub(super) fn encode(mesh: &Mesh) -> Vec<u8> {
    let mut file = GlbBuffer::default();
    let mut root = json!({ "asset": { "version": "2.0", "generator": "dvr" } });
    if !mesh.is_empty() {
        let mut attributes = json!({ "POSITION": file.positions(&mesh.vertices) });
        if let Some(normals) = &mesh.normals {
            // The specification wants unit length, also where a vertex has no normal.
            let unit = normals.iter().flat_map(|n| n.normalize_or(Vec3::Y).to_array());
            attributes["NORMAL"] = file.vectors(unit, normals.len()).into();
        }
        if let Some(colors) = &mesh.colors {
            let linear = colors.iter().flatten().map(|&c| srgb_to_linear(c.clamp(0.0, 1.0)));
            attributes["COLOR_0"] = file.vectors(linear, colors.len()).into();
        }
        if let Some(observations) = &mesh.observations {
            let confidence = observations.iter().map(|observation| observation.confidence);
            attributes["_CONFIDENCE"] = file.scalars(confidence, observations.len()).into();
            let views = observations.iter().map(|observation| f32::from(observation.views));
            attributes["_VIEWS"] = file.scalars(views, observations.len()).into();
        }
        let indices = file.indices(&mesh.faces);
        root["scene"] = 0.into();
        root["scenes"] = json!([{ "nodes": [0] }]);
        root["nodes"] = json!([{ "mesh": 0 }]);
        root["meshes"] = json!([{ "primitives": [{ "attributes": attributes, "indices": indices, "material": 0 }] }]);
        root["materials"] = json!([{
            "doubleSided": true,
            "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 },
        }]);
        root["accessors"] = file.accessors.into();
        root["bufferViews"] = file.views.into();
        root["buffers"] = json!([{ "byteLength": file.bytes.len() }]);
    }
    container(root.to_string().into_bytes(), file.bytes)
}

/// The binary chunk and what describes it. Every element is four bytes long, so every offset is aligned.
#[derive(Default)]
struct GlbBuffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl GlbBuffer {
    fn view(&mut self, bytes: impl Iterator<Item = u8>, target: u32) -> usize {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        let length = self.bytes.len() - offset;
        self.views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": length, "target": target }));
        self.views.len() - 1
    }

    fn vectors(&mut self, values: impl Iterator<Item = f32>, count: usize) -> usize {
        self.floats(values, count, "VEC3")
    }

    fn scalars(&mut self, values: impl Iterator<Item = f32>, count: usize) -> usize {
        self.floats(values, count, "SCALAR")
    }

    fn floats(&mut self, values: impl Iterator<Item = f32>, count: usize, kind: &str) -> usize {
        let view = self.view(values.flat_map(f32::to_le_bytes), ARRAY_BUFFER);
        self.accessors.push(json!({ "bufferView": view, "componentType": FLOAT, "count": count, "type": kind }));
        self.accessors.len() - 1
    }

    fn positions(&mut self, vertices: &[Vec3]) -> usize {
        let index = self.vectors(vertices.iter().flat_map(Vec3::to_array), vertices.len());
        let low = vertices.iter().copied().fold(Vec3::INFINITY, Vec3::min);
        let high = vertices.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
        self.accessors[index]["min"] = json!(low.to_array());
        self.accessors[index]["max"] = json!(high.to_array());
        index
    }

    fn indices(&mut self, faces: &[[u32; 3]]) -> usize {
        let view = self.view(faces.iter().flatten().flat_map(|i| i.to_le_bytes()), ELEMENT_ARRAY_BUFFER);
        let count = 3 * faces.len();
        let accessor = json!({ "bufferView": view, "componentType": UNSIGNED_INT, "count": count, "type": "SCALAR" });
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}

/// Header and chunks (section 4 of the specification), padded to four bytes: JSON with spaces, data with zeros.
fn container(mut json: Vec<u8>, mut data: Vec<u8>) -> Vec<u8> {
    json.resize(json.len().next_multiple_of(4), b' ');
    data.resize(data.len().next_multiple_of(4), 0);
    let data_chunk = if data.is_empty() { 0 } else { 8 + data.len() };
    let mut bytes = Vec::with_capacity(20 + json.len() + data_chunk);
    bytes.extend(b"glTF");
    bytes.extend(2u32.to_le_bytes());
    bytes.extend(((20 + json.len() + data_chunk) as u32).to_le_bytes());
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend(b"JSON");
    bytes.extend(&json);
    if !data.is_empty() {
        bytes.extend((data.len() as u32).to_le_bytes());
        bytes.extend(b"BIN\0");
        bytes.extend(&data);
    }
    bytes
}
