//! From an implicit field to pictures and meshes: ray marching, root finding, the differentiable depth, rendering, and
//! mesh extraction.
//!
//! A field is known through three traits: [`Field`] samples it, and is all that must be written; [`Differentiable`]
//! differentiates it, by default with central differences; [`Crossing`] finds where rays first meet its surface, by default
//! by marching. [`FieldShader`] renders any field, [`Surface`] puts what rays hit on the autodiff graph, and
//! [`extract::extract_mesh`] makes a mesh of it.
//!
//! ```
//! use burn::tensor::{Device, Tensor};
//! use dvr_core::Camera;
//! use dvr_render::extract::{ExtractSettings, FieldSurface, extract_mesh};
//! use dvr_render::{
//!     Crossing, Differentiable, Field, FieldShader, FieldValues, Query, RenderSettings, render_view,
//! };
//! use glam::DVec3;
//!
//! /// A ball of radius 0.3, coloured by position.
//! struct Ball;
//!
//! impl Field for Ball {
//!     fn evaluate(&self, query: &Query) -> FieldValues {
//!         let radius = query.points.clone().square().sum_dim(1).sqrt().squeeze_dim::<1>(1);
//!         FieldValues { occupancy_logit: radius.neg() + 0.3, color: query.points.clone() + 0.5 }
//!     }
//!
//!     fn device(&self) -> Device {
//!         Device::flex()
//!     }
//! }
//! // Slopes by central differences, crossings by marching.
//! impl Differentiable for Ball {}
//! impl Crossing for Ball {}
//!
//! // What a camera two units away sees.
//! let camera = Camera::look_at(32, 32, 50.0, DVec3::new(0.0, 0.0, -2.0), DVec3::ZERO, DVec3::Y);
//! let picture = render_view(&FieldShader::new(&Ball, RenderSettings::default(), None), &camera);
//! assert!((picture.depth.get(16, 16) - 1.7).abs() < 1e-3);
//!
//! // The same surface as a watertight mesh.
//! let settings = ExtractSettings { resolution: 32, upsampling_steps: 1, ..ExtractSettings::default() };
//! let mesh = extract_mesh(&FieldSurface::new(&Ball), &settings, &[])?.mesh;
//! assert!(mesh.vertices.iter().all(|v| (v.length() - 0.3).abs() < 1e-3));
//! # Ok::<(), dvr_render::extract::ExtractError>(())
//! ```

#![warn(missing_docs)]

mod chunks;
pub mod extract;
mod field;
mod gather;
mod implicit_depth;
mod march;
mod shade;
mod silhouette;
mod skip;
mod slope_rule;
mod surface;
mod view;
mod view_color;
mod view_metrics;

pub use chunks::{is_gpu, memory_excess};
pub use field::{Crossing, Differentiable, Field, FieldJet, FieldValues, Query, Snapshot, axis_direction};
pub use gather::{DistinctRows, gather_rows};
pub use implicit_depth::implicit_depth;
pub use march::{
    Bracket, Hits, HostRays, March, MarchSettings, Marcher, RayStatus, Rays, RootMethod, SnapshotMarcher, TensorMarcher,
};
pub use shade::{FieldShader, MeshShader, RenderSettings, Shaded, Shader};
pub use silhouette::{FittedField, SilhouetteFit, silhouette_overlap};
pub use skip::SkipGrid;
pub use slope_rule::{SlopeRule, dot};
pub use surface::Surface;
pub use view::{Rendering, render_view, render_view_supersampled, rendering_bytes};
pub use view_color::{ViewColor, ViewColorError};
pub use view_metrics::{ViewMetrics, view_metrics, view_metrics_at_own_exposure};
