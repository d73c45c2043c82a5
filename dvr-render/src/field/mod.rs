//! What is learned: an implicit scene, known through three traits that build on each other.
//!
//! * [`Field`] is sampling: occupancy and colour at points. It is all that must be written.
//! * [`Differentiable`] is differentiation: derivatives of both by the point. The defaults are central differences; a
//!   field that can do better overrides them.
//! * [`Crossing`] is where rays first meet the surface. The default marches tensors; a field with a faster way (an
//!   exact crossing, a kernel of a GPU, an evaluation on the CPU without tensors) names it here.
//!
//! Generic code asks for the least that it needs; `F: Crossing` means all three. Through [`FieldSurface`] a field is
//! marched and extracted, through [`FieldShader`] it is seen.
//!
//! ```
//! use burn::tensor::{Device, Tensor};
//! use dvr_render::{Crossing, Differentiable, Field, FieldValues, Query};
//!
//! /// A ball of radius 0.3, brighter where it is seen from above.
//! struct Ball;
//!
//! impl Field for Ball {
//!     fn evaluate(&self, query: &Query) -> FieldValues {
//!         let radius = query.points.clone().square().sum_dim(1).sqrt();
//!         let color = match &query.directions {
//!             Some(directions) => directions.clone().narrow(1, 1, 1) * 0.5 + 0.5,
//!             None => Tensor::full_like(&radius, 0.5),
//!         };
//!         FieldValues { occupancy_logit: radius.neg().squeeze_dim(1) + 0.3, color: color.repeat_dim(1, 3) }
//!     }
//!
//!     fn device(&self) -> Device {
//!         Device::flex()
//!     }
//! }
//! impl Differentiable for Ball {}
//! impl Crossing for Ball {}
//!
//! let query = Query::new(Tensor::from_floats([[0.3, 0.0, 0.0]], &Device::flex()));
//! let gradient: Vec<f32> = Ball.occupancy_gradient(&query).into_data().iter::<f32>().collect();
//! assert!((gradient[0] + 1.0).abs() < 1e-3);
//! ```
//!
//! [`FieldSurface`]: crate::extract::FieldSurface
//! [`FieldShader`]: crate::FieldShader

pub(crate) mod crossing;
pub(crate) mod differentiation;
pub(crate) mod query;
pub(crate) mod sampling;
pub(crate) mod scalar;

pub use crossing::{Crossing, Snapshot};
pub use differentiation::{Differentiable, FieldJet, axis_direction};
pub use query::Query;
pub use sampling::{Field, FieldValues};
