//! From a trained field to a mesh in the world of the files.

use dvr_core::Similarity;
use dvr_core::mesh::Mesh;
use dvr_render::Field;
use dvr_render::extract::{ExtractSettings, Extraction, FieldSurface, extract_mesh};
use glam::Vec3;

use crate::error::{Error, Result};

/// Extracts the mesh of a field, in object space, with vertex colours. `field` must not track gradients.
///
/// # Errors
/// When the field has no surface in the cube; the message says what to try.
pub fn object_mesh(field: &impl Field, settings: &ExtractSettings, seeds: &[Vec3]) -> Result<Extraction> {
    extract_mesh(&FieldSurface::new(field), settings, seeds).map_err(|e| Error::NoMesh(e.to_string()))
}

/// The mesh in the coordinates and units of the scene's own files.
pub fn world_mesh(mesh: &Mesh, object_to_world: &Similarity) -> Mesh {
    mesh.clone().transformed(object_to_world)
}
