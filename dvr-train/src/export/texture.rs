//! The texture of a run's mesh.

use dvr_core::View;
use dvr_texture::{TextureError, Textured, bake_normals, texture_mesh};

use crate::error::Result;
use crate::export::mesh::{MeshOptions, ObjectMesh};

/// The mesh, in object space, with a texture from the photographs, where the options ask for one, and with a normal map,
/// where it was simplified. What stands against it becomes a warning: the mesh has the photographs' colours in its vertices
/// all the same.
///
/// # Errors
/// [`crate::Error::Cancelled`] where the token of the options says so.
pub fn photo_texture(
    extracted: &ObjectMesh,
    views: &[&View],
    options: &MeshOptions,
    warnings: &mut Vec<String>,
) -> Result<Option<Textured>> {
    let Some(settings) = options.texture_from(views) else { return Ok(None) };
    let cancellation = &options.extraction.cancellation;
    let mut textured = match texture_mesh(&extracted.mesh, views, &settings, cancellation, |_, _| ()) {
        Ok(textured) => textured,
        Err(TextureError::Cancelled(cancelled)) => return Err(cancelled.into()),
        Err(error) => {
            warnings.push(format!("the mesh has no texture, only colours of its vertices: {error}"));
            return Ok(None);
        }
    };
    if let (Some(full), Some(moved)) = (&extracted.full, &extracted.simplification) {
        match bake_normals(&mut textured, full, moved.max_distance, cancellation) {
            Ok(()) => {}
            Err(TextureError::Cancelled(cancelled)) => return Err(cancelled.into()),
            Err(error) => warnings.push(format!("the mesh has no normal map: {error}")),
        }
    }
    Ok(Some(textured))
}
