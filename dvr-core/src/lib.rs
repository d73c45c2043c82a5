//! What a scene is: cameras, rays, images, masks, depth maps, meshes, datasets and metrics. No neural network.

#![warn(missing_docs)]

mod bvh;
mod camera;
pub mod dataset;
mod error;
pub mod files;
pub mod hull;
pub mod inside;
pub mod mesh;
pub mod metrics;
pub mod npz;
mod points;
mod raster;
mod ray;
pub mod sampling;
mod scene;
mod srgb;
pub mod synth;

pub use bvh::{Bvh, RayHit};
pub use camera::{Camera, Similarity};
pub use error::{Error, Result};
pub use points::{OccupancySamples, PointCloud};
pub use raster::{DepthMap, Mask};
pub use ray::{Ray, UnitCube};
pub use scene::{GroundTruth, Scene, SparsePoints, Split, View};
pub use srgb::{linear_to_srgb, srgb_to_linear};
