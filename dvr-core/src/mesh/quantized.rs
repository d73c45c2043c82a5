//! Attributes of vertices as bytes: in full, or as whole numbers that compress well (`KHR_mesh_quantization`, and the filters
//! of `EXT_meshopt_compression`).

use glam::{Vec3, Vec4};
use meshopt::EncodeExpMode;

use super::glb_buffer::{BYTE, FLOAT, UNSIGNED_SHORT};

/// Bits of each coordinate of a direction on an octahedron: it is off by about a degree at most.
const DIRECTION_BITS: i32 = 8;

/// Bits of a number that stays a float: whole numbers up to 16 384 are exact.
const FLOAT_BITS: i32 = 15;

/// What decoders do after decompression.
#[derive(Clone, Copy)]
pub(super) enum Filter {
    Octahedral,
    Exponential,
}

impl Filter {
    /// As the extension calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Octahedral => "OCTAHEDRAL",
            Self::Exponential => "EXPONENTIAL",
        }
    }
}

/// Elements of an accessor.
pub(super) struct Numbers {
    pub bytes: Vec<u8>,
    /// Bytes from one element to the next, a multiple of four.
    pub stride: usize,
    /// Name of the type of each number, and of each element.
    pub component: u32,
    pub kind: &'static str,
    pub is_normalized: bool,
    pub filter: Option<Filter>,
}

impl Numbers {
    /// In single precision.
    pub fn floats(values: impl Iterator<Item = f32>, kind: &'static str) -> Self {
        let stride = match kind {
            "VEC4" => 16,
            "VEC3" => 12,
            "VEC2" => 8,
            _ => 4,
        };
        let bytes = values.flat_map(f32::to_le_bytes).collect();
        Self { bytes, stride, component: FLOAT, kind, is_normalized: false, filter: None }
    }

    /// Places in steps of a [`Placement`].
    pub fn positions(places: &[[u16; 3]]) -> Self {
        let bytes = places.iter().flat_map(|&[x, y, z]| [x, y, z, 0]).flat_map(u16::to_le_bytes).collect();
        Self { bytes, stride: 8, component: UNSIGNED_SHORT, kind: "VEC3", is_normalized: false, filter: None }
    }

    /// Numbers in `[0, 1]` in steps of 1 / 65 535.
    pub fn shares<const N: usize>(elements: impl Iterator<Item = [f32; N]>, kind: &'static str) -> Self {
        let stride = (2 * N).next_multiple_of(4);
        let bytes = elements.flat_map(|element| {
            let steps = element.map(|share| (65535.0 * share.clamp(0.0, 1.0)).round() as u16);
            let mut bytes: Vec<u8> = steps.into_iter().flat_map(u16::to_le_bytes).collect();
            bytes.resize(stride, 0);
            bytes
        });
        let bytes = bytes.collect();
        Self { bytes, stride, component: UNSIGNED_SHORT, kind, is_normalized: true, filter: None }
    }

    /// Unit vectors with a sign.
    pub fn directions(directions: impl Iterator<Item = Vec4>, kind: &'static str) -> Self {
        let directions: Vec<[f32; 4]> = directions.map(|direction| direction.to_array()).collect();
        let rounded = meshopt::encode_filter_oct::<i8>(&directions, DIRECTION_BITS);
        let bytes = rounded.into_iter().flatten().map(i8::cast_unsigned).collect();
        Self { bytes, stride: 4, component: BYTE, kind, is_normalized: true, filter: Some(Filter::Octahedral) }
    }

    /// Floats of fewer digits, one for each vertex.
    pub fn rounded_floats(values: impl Iterator<Item = f32>) -> Self {
        let values: Vec<[f32; 1]> = values.map(|value| [value]).collect();
        let rounded = meshopt::encode_filter_exp(&values, FLOAT_BITS, EncodeExpMode::Separate);
        let bytes = rounded.into_iter().flatten().flat_map(u32::to_le_bytes).collect();
        let filter = Some(Filter::Exponential);
        Self { bytes, stride: 4, component: FLOAT, kind: "SCALAR", is_normalized: false, filter }
    }

    /// How many elements there are.
    pub fn count(&self) -> usize {
        self.bytes.len() / self.stride
    }

    /// Compressed, as version 0 of the codec has it.
    pub fn encoded(&self) -> Vec<u8> {
        let encoded = if self.stride == 4 {
            meshopt::encode_vertex_buffer_level(self.bytes.as_chunks::<4>().0, 2, Some(0))
        } else {
            meshopt::encode_vertex_buffer_level(self.bytes.as_chunks::<8>().0, 2, Some(0))
        };
        // It has no errors to give: the room that it asks for is there.
        encoded.unwrap_or_default()
    }
}

/// Steps along the edges of the box around a mesh.
#[derive(Clone, Copy, Default)]
pub(super) struct Placement {
    /// The box' least corner.
    pub low: Vec3,
    /// Length of a step: its longest edge has 65 535.
    pub step: f32,
}

impl Placement {
    pub fn of(vertices: &[Vec3]) -> Self {
        let low = vertices.iter().copied().reduce(Vec3::min).unwrap_or_default();
        let high = vertices.iter().copied().reduce(Vec3::max).unwrap_or_default();
        let edge = (high - low).max_element();
        Self { low, step: if edge > 0.0 { edge / 65535.0 } else { 1.0 } }
    }

    /// Places in steps.
    pub fn numbers(self, vertices: &[Vec3]) -> Vec<[u16; 3]> {
        let steps = |vertex: &Vec3| ((*vertex - self.low) / self.step).round().to_array().map(|step| step as u16);
        vertices.iter().map(steps).collect()
    }

    /// The least and largest of these.
    pub fn bounds(places: &[[u16; 3]]) -> [[u16; 3]; 2] {
        let extreme = |of: fn(u16, u16) -> u16| {
            let both = |a: [u16; 3], b: [u16; 3]| [0, 1, 2].map(|axis| of(a[axis], b[axis]));
            places.iter().copied().reduce(both).unwrap_or_default()
        };
        [extreme(u16::min), extreme(u16::max)]
    }
}
