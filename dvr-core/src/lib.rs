//! What a scene is, and how it is read, checked, rendered and compared: cameras, rays, images, masks, depth maps, meshes,
//! datasets and metrics. No neural network, no GPU.
//!
//! - [`Scene::read`] reads posed photographs in five layouts ([`dataset`]); the object then lies in the unit cube. What
//!   masks leave out or have too much of, [`refine_masks`] corrects.
//! - [`hull`] carves visual hulls from masks, [`voxel`] has grids and the exact walk of a ray through them, [`Bvh`] finds
//!   where rays meet a mesh and how far points are from it, [`Visibility`] which views see it.
//! - [`mesh`] reads and writes meshes, [`synth`] renders them into datasets with depth maps and a true surface.
//! - [`metrics`] compares pictures and shapes.
//!
//! ```
//! use dvr_core::hull::{Bounds, HullSettings, VisualHull};
//! use dvr_core::mesh::{TexturedMesh, shapes};
//! use dvr_core::synth::{SynthConfig, render_dataset};
//! use dvr_core::{Scene, View};
//!
//! // Render a torus from twelve sides into a dataset, and read it like any other scene.
//! let folder = tempfile::tempdir()?;
//! let torus = TexturedMesh { mesh: shapes::torus(1.0, 0.3, 32, 16), ..TexturedMesh::default() };
//! let config = SynthConfig { views: 12, surface_points: 1000, occupancy_points: 1000, ..SynthConfig::default() };
//! render_dataset(&torus, "torus", "rings", folder.path(), &config, &|_, _| ())?;
//! let scene = Scene::read(folder.path().join("rings/torus"))?;
//!
//! // What no mask rules out contains the object.
//! let views: Vec<_> = scene.views.iter().filter_map(View::training_pair).collect();
//! let hull = VisualHull::carve(&views, Bounds::UNIT_CUBE, 32, &HullSettings::default())?;
//! println!("{} views; the hull fills {:.0} % of the cube", scene.views.len(), 100.0 * hull.volume());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![warn(missing_docs)]

mod advice;
mod agreed_similarity;
mod bilinear;
mod bvh;
mod camera;
mod cancellation;
pub mod dataset;
mod distance_transform;
mod downscale;
mod error;
mod exposure;
pub mod files;
mod flood;
mod folder_kind;
mod half_space;
mod hold_out;
pub mod hull;
pub mod inside;
pub mod lens;
mod machine_memory;
mod mask_refinement;
pub mod mat;
pub mod mesh;
pub mod metrics;
mod mirror;
pub mod npz;
pub mod number_range;
mod observation;
mod paged_images;
mod pinhole;
mod pixels;
mod points;
mod raster;
mod ray;
pub mod record;
mod region;
pub mod sampling;
mod scene;
mod scene_memory;
mod sharpness;
mod similarity_fit;
mod srgb;
mod stereo_cloud;
mod supervision;
pub mod synth;
mod triangulation;
mod verified_points;
mod view_split;
mod visibility;
pub mod voxel;
mod weighted_median;

pub use advice::{Advice, Orbit, Side, Topic, ViewFigure};
pub use agreed_similarity::AgreedSimilarity;
pub use bilinear::{Bilinear, Linear};
pub use bvh::{Bvh, NearestPoint, RayHit};
pub use camera::{Camera, Similarity};
pub use cancellation::{Cancellation, Cancelled, Shield};
pub use distance_transform::{signed_distance, signed_distance_at_nodes};
pub use error::{CameraError, ComparisonError, Error, LensError, NormalisationError, OutputError, Result};
pub use exposure::Exposure;
pub use flood::flood;
pub use half_space::HalfSpace;
pub use hold_out::{HOLD_OUT_EVERY, HeldOut};
pub use machine_memory::available_memory;
pub use mask_refinement::{MaskReport, RefinedView, refine_masks};
pub use mirror::MirrorAxis;
pub use observation::Observation;
pub use pinhole::Pinhole;
pub use pixels::{GrayPicture, Picture, PixelStore, stored};
pub use points::{OccupancySamples, PointCloud};
pub use raster::{DepthMap, Mask};
pub use ray::{Ray, UnitCube};
pub use region::{Region, RegionEvidence};
pub use scene::{GroundTruth, MaskSource, Scene, SparsePoints, Split, View, require_masks};
pub use sharpness::laplacian_variance;
pub use srgb::{linear_to_srgb, srgb_to_linear};
pub use stereo_cloud::stereo_cloud;
pub use supervision::Supervision;
pub use triangulation::{Sighting, Triangulated, triangulate};
pub use verified_points::{TrackSight, Tracks, VerifiedPoints};
pub use view_split::{ViewNames, ViewSplit, abbreviated};
pub use visibility::{MIN_COSINE, Sight, Visibility};
pub use weighted_median::weighted_median;
