//! From a trained model to mesh, preview and figures.

pub(crate) mod bake;
pub(crate) mod components;
pub(crate) mod export_run;
pub(crate) mod mesh;
pub mod preview;
