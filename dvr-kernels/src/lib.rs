//! Hot loops on the CPU, behind plain functions of numbers: no tensors, no files, no policy.
//!
//! A [`Lattice`] is a cube of nodes whose values are interpolated trilinearly. Rays are intersected with the zero level
//! set of such values exactly ([`SignMap::first_crossing`]), levels of different resolution are summed into one lattice
//! ([`pyramid`]), [`interpolate`] evaluates and differentiates at many points at once, and [`adam`] moves parameters.
//! Every kernel has a slow twin in its tests.
//!
//! ```
//! use dvr_kernels::{Lattice, SignMap};
//! use glam::Vec3;
//!
//! // A ball of radius 0.3 at the nodes of a lattice, and a ray that meets it.
//! let lattice = Lattice::new(33, 0.55);
//! let values: Vec<f32> = (0..lattice.len()).map(|i| 0.3 - lattice.position(i).length()).collect();
//! let map = SignMap::new(&lattice, &values);
//! let hit = map.first_crossing(&values, Vec3::new(0.0, 0.01, -2.0), Vec3::Z, 0.0, f32::INFINITY).unwrap();
//! assert!((hit - 1.7).abs() < 2e-3);
//! ```

#![warn(missing_docs)]

mod active;
pub mod adam;
pub mod cubic;
pub mod interpolate;
mod lattice;
mod mlp;
pub mod pyramid;
mod roughness;
pub mod rules;
mod sign_map;
mod walk;

pub use active::ActiveNodes;
pub use lattice::{Cell, Lattice};
pub use mlp::{LinearWeights, ResidualMlp};
pub use roughness::Roughness;
pub use sign_map::SignMap;
pub use walk::{Segment, Walk};
