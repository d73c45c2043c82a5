//! Posed photographs in, a textured mesh out: differentiable volumetric rendering as a library.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let (photographs, output) = (dvr::demo_scene(folder.path())?, folder.path().join("ball.ply"));
//! let scene = dvr::Scene::read(&photographs)?;
//! let mut options = dvr::Options::method("grid", dvr::Supervision::Rgb)?;
//! options.set(serde_json::json!({ "seed": 7, "steps": 10, "capacity": { "cells": 32 } }))?;
//! options.mesh = dvr::MeshOptions::with_resolution(32);
//!
//! let ball = dvr::reconstruct(&scene, &options)?;
//! let [vertices, faces] = ball.report.mesh.expect("the ball has a surface");
//! println!("{vertices} vertices, {faces} faces in {:.1} s", ball.report.training_seconds);
//! ball.report.warnings.iter().for_each(|warning| println!("note: {warning}"));
//! ball.save_mesh(&output)?;
//! # assert!(output.is_file());
//! # Ok(())
//! # }
//! ```
//!
//! [`reconstruct`] is the whole job with the defaults of `dvr train`; [`reconstruct_observed`] tells how it goes on and
//! can be interrupted. A field of one's own comes in as [`FieldMethod`]. What lies below is in the crates `dvr-core`
//! (scenes, meshes, metrics), `dvr-render` (fields, marching, extraction), `dvr-model` and `dvr-grid` (the fields that
//! come along) and `dvr-train` (training, run folders, evaluation).

#![warn(missing_docs)]

mod error;
mod options;
mod reconstruction;

pub use error::{Error, Result};
pub use options::Options;
pub use reconstruction::{Reconstruction, demo_scene, reconstruct, reconstruct_observed};

/// Where tensors live: `Device::flex()` is the CPU. [`Options::device`] takes one.
pub use burn::tensor::Device;
/// Ends a reconstruction early. [`reconstruct_observed`] takes one.
pub use dvr_core::Cancellation;
/// What the surface looks like in the end. [`Reconstruction::mesh`] is one.
pub use dvr_core::mesh::Mesh;
/// Photographs, masks and cameras. [`reconstruct`] takes one.
pub use dvr_core::{Scene, Supervision};
/// How a field is made a mesh. [`Options::mesh`] is one.
pub use dvr_train::{ColorSource, MeshOptions};
/// Ways to reconstruct: those that are known by name, one's own, and what they have in common.
pub use dvr_train::{FieldMethod, METHODS, Method, TrainConfig, method_by_name};
/// The figures, notes and warnings of [`Reconstruction::report`], and the field of [`Reconstruction::field`].
pub use dvr_train::{Observer, RunMetrics as Report, TrainedModel};
