//! From a trained model to mesh, preview and figures.

mod appearance;
pub(crate) mod bake;
pub(crate) mod components;
mod laps;
mod measured;
pub(crate) mod mesh;
pub(crate) mod pictures;
pub mod preview;
pub(crate) mod real_size;
pub(crate) mod run_metrics;
pub(crate) mod run_results;
pub(crate) mod support;
pub(crate) mod texture;
pub(crate) mod views;
