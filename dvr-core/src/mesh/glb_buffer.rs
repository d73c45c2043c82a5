//! The binary part of a GLB, and the container of both parts. (Sections 3.6 and 4 of the specification.)

use glam::{Vec2, Vec3, Vec4};
use serde_json::{Value, json};

// Names of the specification's numbers.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// The binary chunk and what describes it. Every offset is aligned to four bytes.
#[derive(Default)]
pub(super) struct GlbBuffer {
    pub bytes: Vec<u8>,
    pub views: Vec<Value>,
    pub accessors: Vec<Value>,
}

impl GlbBuffer {
    fn view(&mut self, bytes: impl Iterator<Item = u8>, target: u32) -> usize {
        let index = self.file(bytes);
        self.views[index]["target"] = target.into();
        index
    }

    /// A whole file, a picture say, as a view of the buffer.
    pub fn file(&mut self, bytes: impl Iterator<Item = u8>) -> usize {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        let length = self.bytes.len() - offset;
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": length }));
        self.views.len() - 1
    }

    pub fn vectors(&mut self, values: impl Iterator<Item = f32>, count: usize) -> usize {
        self.floats(values, count, "VEC3")
    }

    /// Texture coordinates whose origin is the picture's top left, as glTF has them.
    pub fn uvs(&mut self, uvs: &[Vec2]) -> usize {
        self.floats(uvs.iter().flat_map(|uv| [uv.x, 1.0 - uv.y]), uvs.len(), "VEC2")
    }

    /// Tangents with their handedness.
    pub fn tangents(&mut self, tangents: &[Vec4]) -> usize {
        self.floats(tangents.iter().flat_map(Vec4::to_array), tangents.len(), "VEC4")
    }

    pub fn scalars(&mut self, values: impl Iterator<Item = f32>, count: usize) -> usize {
        self.floats(values, count, "SCALAR")
    }

    fn floats(&mut self, values: impl Iterator<Item = f32>, count: usize, kind: &str) -> usize {
        let view = self.view(values.flat_map(f32::to_le_bytes), ARRAY_BUFFER);
        self.accessors.push(json!({ "bufferView": view, "componentType": FLOAT, "count": count, "type": kind }));
        self.accessors.len() - 1
    }

    pub fn positions(&mut self, vertices: &[Vec3]) -> usize {
        let index = self.vectors(vertices.iter().flat_map(Vec3::to_array), vertices.len());
        let low = vertices.iter().copied().fold(Vec3::INFINITY, Vec3::min);
        let high = vertices.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
        self.accessors[index]["min"] = json!(low.to_array());
        self.accessors[index]["max"] = json!(high.to_array());
        index
    }

    pub fn indices(&mut self, faces: &[[u32; 3]]) -> usize {
        let view = self.view(faces.iter().flatten().flat_map(|i| i.to_le_bytes()), ELEMENT_ARRAY_BUFFER);
        let count = 3 * faces.len();
        let accessor = json!({ "bufferView": view, "componentType": UNSIGNED_INT, "count": count, "type": "SCALAR" });
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}

/// Header and chunks (section 4 of the specification), padded to four bytes: JSON with spaces, data with zeros.
pub(super) fn container(mut json: Vec<u8>, mut data: Vec<u8>) -> Vec<u8> {
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
