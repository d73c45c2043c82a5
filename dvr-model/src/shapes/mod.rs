//! Decoders that make a whole shape of a latent code at once: the representations that DVR is compared with (section 4.2).

mod graph;
mod patches;
mod points;
mod shape_model;
mod sphere;
#[cfg(test)]
mod tests;
mod voxels;

use burn::module::Module;
use burn::tensor::Device;
use dvr_core::number_range::{NumberRange, whole};
use serde::{Deserialize, Serialize};

pub use graph::{Deformed, GraphDecoder};
pub use patches::PatchDecoder;
pub use points::PointDecoder;
pub use shape_model::{ShapeModel, ShapeModelConfig};
pub use sphere::SphereDecoder;
pub use voxels::VoxelDecoder;

/// Configuration of a [`ShapeDecoder`]; in JSON its `kind` says which. `width` scales all of its layers: the papers' decoders
/// are about eight times as wide as the defaults.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum ShapeDecoderConfig {
    /// Occupancies of voxels, see [`VoxelDecoder`].
    Voxels {
        /// Channels of the finest hidden layer.
        #[serde(default = "voxel_width")]
        width: usize,
    },
    /// Points, see [`PointDecoder`].
    Points {
        /// Channels of the finest layer.
        #[serde(default = "point_width")]
        width: usize,
    },
    /// Pieces of surface, see [`PatchDecoder`].
    Patches {
        /// How many.
        #[serde(default = "patches")]
        patches: usize,
        /// Width of the first layer of each.
        #[serde(default = "patch_width")]
        width: usize,
    },
    /// A ball that is deformed by features of the picture, see [`GraphDecoder`]; for the encoder of kind `local`.
    Graph {
        /// Features of a vertex.
        #[serde(default = "graph_width")]
        width: usize,
    },
    /// A sphere that is deformed, see [`SphereDecoder`].
    Sphere {
        /// Width of the first hidden layer; the second has twice as much.
        #[serde(default = "sphere_width")]
        width: usize,
    },
}

fn voxel_width() -> usize {
    6
}

fn point_width() -> usize {
    16
}

fn patches() -> usize {
    25
}

fn patch_width() -> usize {
    128
}

fn graph_width() -> usize {
    64
}

fn sphere_width() -> usize {
    256
}

impl ShapeDecoderConfig {
    /// The range of every number of any kind.
    pub const RANGES: &[NumberRange] = &[whole("width", 4, 4096), whole("patches", 1, 1024)];

    /// How many numbers the decoder has at least: its first layer.
    pub fn parameters(&self, code_dim: usize) -> u64 {
        let first = match *self {
            Self::Voxels { width } => width.saturating_mul(VoxelDecoder::FIRST),
            Self::Points { width } => width.saturating_mul(PointDecoder::FIRST),
            Self::Patches { patches, width } => patches.saturating_mul(width),
            Self::Sphere { width } => width,
            // It takes no codes.
            Self::Graph { width } => return (width as u64).saturating_mul(width as u64),
        };
        (code_dim as u64).saturating_mul(first as u64)
    }

    /// A decoder of codes of length `code_dim`, or of so many features of a place in a picture, with fresh parameters.
    pub fn init(&self, code_dim: usize, channels: usize, device: &Device) -> ShapeDecoder {
        match *self {
            Self::Voxels { width } => ShapeDecoder::Voxels(VoxelDecoder::new(width, code_dim, device)),
            Self::Points { width } => ShapeDecoder::Points(PointDecoder::new(width, code_dim, device)),
            Self::Patches { patches, width } => {
                ShapeDecoder::Patches(PatchDecoder::new(patches, width, code_dim, device))
            }
            Self::Graph { width } => ShapeDecoder::Graph(GraphDecoder::new(width, channels, device)),
            Self::Sphere { width } => ShapeDecoder::Sphere(SphereDecoder::new(width, code_dim, device)),
        }
    }
}

/// Makes shapes of the latent codes of objects.
#[derive(Module, Debug)]
#[allow(clippy::large_enum_variant)] // there is one per model, and burn's modules take no box
pub enum ShapeDecoder {
    /// As voxels.
    Voxels(VoxelDecoder),
    /// As points.
    Points(PointDecoder),
    /// As pieces of surface.
    Patches(PatchDecoder),
    /// As a ball that is deformed by features of the picture.
    Graph(GraphDecoder),
    /// As a deformed sphere.
    Sphere(SphereDecoder),
}
