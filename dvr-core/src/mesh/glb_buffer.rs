//! The binary part of a GLB, and the container of both parts. (Sections 3.6 and 4 of the specification.)

use glam::{Vec2, Vec3, Vec4};
use serde_json::{Value, json};

use super::quantized::{Numbers, Placement};

// Names of the specification's numbers.
pub(super) const BYTE: u32 = 5120;
pub(super) const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
pub(super) const FLOAT: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// How views of the buffer are compressed.
pub(super) const MESHOPT: &str = "EXT_meshopt_compression";

/// The extension by which attributes may be whole numbers.
const QUANTIZATION: &str = "KHR_mesh_quantization";

/// The binary chunk and what describes it. Every offset is aligned to four bytes.
#[derive(Default)]
pub(super) struct GlbBuffer {
    pub bytes: Vec<u8>,
    pub views: Vec<Value>,
    pub accessors: Vec<Value>,
    compressed: Option<Compressed>,
}

/// What is known of numbers that are rounded and compressed.
#[derive(Default)]
struct Compressed {
    /// Bytes that the views have when they are not: of a buffer that is not there.
    length: usize,
    placement: Placement,
}

impl GlbBuffer {
    /// One whose numbers are rounded and compressed, where that is asked for.
    pub fn new(is_compressed: bool) -> Self {
        Self { compressed: is_compressed.then(Compressed::default), ..Self::default() }
    }

    /// A whole file, a picture say, as a view of the buffer.
    pub fn file(&mut self, bytes: impl Iterator<Item = u8>) -> usize {
        let view = self.range(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    /// Bytes at the end of the buffer.
    fn range(&mut self, bytes: impl Iterator<Item = u8>) -> Value {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        let length = self.bytes.len() - offset;
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        json!({ "buffer": 0, "byteOffset": offset, "byteLength": length })
    }

    /// A view whose `count` elements of `stride` bytes are compressed; `stored` are the bytes that hold them.
    fn compressed_view(&mut self, stored: Vec<u8>, stride: usize, count: usize, mode: &str) -> Value {
        let mut extension = self.range(stored.into_iter());
        extension["byteStride"] = stride.into();
        extension["count"] = count.into();
        extension["mode"] = mode.into();
        let length = self.compressed.as_mut().map(|compressed| &mut compressed.length);
        let offset =
            length.map_or(0, |length| std::mem::replace(length, (*length + stride * count).next_multiple_of(4)));
        json!({
            "buffer": 1,
            "byteOffset": offset,
            "byteLength": stride * count,
            "extensions": { MESHOPT: extension },
        })
    }

    /// An attribute of vertices, in the buffer's way.
    fn attribute(&mut self, numbers: &Numbers) -> usize {
        let mut view = if self.compressed.is_some() {
            let mut view = self.compressed_view(numbers.encoded(), numbers.stride, numbers.count(), "ATTRIBUTES");
            view["byteStride"] = numbers.stride.into();
            if let Some(filter) = numbers.filter {
                view["extensions"][MESHOPT]["filter"] = filter.name().into();
            }
            view
        } else {
            self.range(numbers.bytes.iter().copied())
        };
        view["target"] = ARRAY_BUFFER.into();
        self.views.push(view);
        let mut accessor = json!({
            "bufferView": self.views.len() - 1,
            "componentType": numbers.component,
            "count": numbers.count(),
            "type": numbers.kind,
        });
        if numbers.is_normalized {
            accessor["normalized"] = true.into();
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Places of vertices, with the box around them, as the specification wants it.
    pub fn positions(&mut self, vertices: &[Vec3]) -> usize {
        let (numbers, bounds) = match &mut self.compressed {
            Some(compressed) => {
                compressed.placement = Placement::of(vertices);
                let placed = compressed.placement.numbers(vertices);
                (Numbers::positions(&placed), json!(Placement::bounds(&placed)))
            }
            None => {
                let low = vertices.iter().copied().fold(Vec3::INFINITY, Vec3::min);
                let high = vertices.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
                let floats = vertices.iter().flat_map(Vec3::to_array);
                (Numbers::floats(floats, "VEC3"), json!([low.to_array(), high.to_array()]))
            }
        };
        let index = self.attribute(&numbers);
        self.accessors[index]["min"] = bounds[0].clone();
        self.accessors[index]["max"] = bounds[1].clone();
        index
    }

    /// Unit vectors.
    pub fn normals(&mut self, normals: &[Vec3]) -> usize {
        let numbers = match self.compressed {
            Some(_) => Numbers::directions(normals.iter().map(|normal| normal.extend(0.0)), "VEC3"),
            None => Numbers::floats(normals.iter().flat_map(Vec3::to_array), "VEC3"),
        };
        self.attribute(&numbers)
    }

    /// Tangents with their handedness.
    pub fn tangents(&mut self, tangents: &[Vec4]) -> usize {
        let numbers = match self.compressed {
            Some(_) => Numbers::directions(tangents.iter().copied(), "VEC4"),
            None => Numbers::floats(tangents.iter().flat_map(Vec4::to_array), "VEC4"),
        };
        self.attribute(&numbers)
    }

    /// Linear colours in `[0, 1]`.
    pub fn colors(&mut self, colors: &[[f32; 3]]) -> usize {
        let numbers = match self.compressed {
            Some(_) => Numbers::shares(colors.iter().copied(), "VEC3"),
            None => Numbers::floats(colors.as_flattened().iter().copied(), "VEC3"),
        };
        self.attribute(&numbers)
    }

    /// Texture coordinates whose origin is the picture's top left, as glTF has them.
    pub fn uvs(&mut self, uvs: &[Vec2]) -> usize {
        let is_within = uvs.iter().all(|uv| uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all());
        let uvs = uvs.iter().map(|uv| [uv.x, 1.0 - uv.y]);
        let numbers = match self.compressed {
            Some(_) if is_within => Numbers::shares(uvs, "VEC2"),
            // Where a texture repeats, steps in [0, 1] do not do.
            _ => Numbers::floats(uvs.flatten(), "VEC2"),
        };
        self.attribute(&numbers)
    }

    /// One number for each vertex.
    pub fn scalars(&mut self, values: impl Iterator<Item = f32>) -> usize {
        let numbers = match self.compressed {
            Some(_) => Numbers::rounded_floats(values),
            None => Numbers::floats(values, "SCALAR"),
        };
        self.attribute(&numbers)
    }

    pub fn indices(&mut self, faces: &[[u32; 3]], vertices: usize) -> usize {
        let corners = faces.as_flattened();
        let mut view = match self.compressed.is_some().then(|| meshopt::encode_index_buffer(corners, vertices)) {
            Some(Ok(stored)) => self.compressed_view(stored, 4, corners.len(), "TRIANGLES"),
            _ => self.range(corners.iter().flat_map(|i| i.to_le_bytes())),
        };
        view["target"] = ELEMENT_ARRAY_BUFFER.into();
        self.views.push(view);
        let view = self.views.len() - 1;
        let accessor =
            json!({ "bufferView": view, "componentType": UNSIGNED_INT, "count": corners.len(), "type": "SCALAR" });
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Puts what is in the buffer into a document, and what takes its places to those of the mesh into its node.
    pub fn describe(self, root: &mut Value) -> Vec<u8> {
        root["accessors"] = self.accessors.into();
        root["bufferViews"] = self.views.into();
        let mut buffers = vec![json!({ "byteLength": self.bytes.len() })];
        if let Some(Compressed { length, placement }) = self.compressed {
            buffers.push(json!({ "byteLength": length, "extensions": { MESHOPT: { "fallback": true } } }));
            root["nodes"][0]["translation"] = json!(placement.low.to_array());
            root["nodes"][0]["scale"] = Value::from([placement.step; 3].map(Value::from).to_vec());
            let required = [MESHOPT, QUANTIZATION];
            root["extensionsRequired"] = json!(required);
            let used = root["extensionsUsed"].as_array().cloned().unwrap_or_default();
            root["extensionsUsed"] = used.into_iter().chain(required.map(Value::from)).collect();
        }
        root["buffers"] = buffers.into();
        self.bytes
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
