//! The texture of a run's mesh.

use dvr_core::View;
use dvr_core::mesh::Mesh;
use dvr_texture::{TextureError, Textured, texture_mesh};

use crate::error::Result;
use crate::export::mesh::MeshOptions;

/// The mesh, in object space, with a texture from the photographs, where the options ask for one. What stands against it
/// becomes a warning: the mesh has the photographs' colours in its vertices all the same.
///
/// # Errors
/// [`crate::Error::Cancelled`] where the token of the options says so.
pub fn photo_texture(
    mesh: &Mesh,
    views: &[&View],
    options: &MeshOptions,
    warnings: &mut Vec<String>,
) -> Result<Option<Textured>> {
    let Some(settings) = options.texture_from(views) else { return Ok(None) };
    match texture_mesh(mesh, views, &settings, &options.extraction.cancellation, |_, _| ()) {
        Ok(textured) => Ok(Some(textured)),
        Err(TextureError::Cancelled(cancelled)) => Err(cancelled.into()),
        Err(error) => {
            warnings.push(format!("the mesh has no texture, only colours of its vertices: {error}"));
            Ok(None)
        }
    }
}
