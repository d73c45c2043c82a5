//! From a trained field to a mesh in the world of the files.

use dvr_core::mesh::Mesh;
use dvr_core::{Camera, Similarity, View, Visibility};
use dvr_render::extract::ExtractError;
use dvr_render::extract::{ExtractSettings, Extraction, ScalarField, extract_mesh};
use dvr_texture::TextureSettings;
use glam::Vec3;

use crate::error::{Error, Result};
use crate::export::bake::bake_colors;
use crate::export::components::drop_unshown;

/// Where the vertex colours of a mesh come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColorSource {
    /// From the photographs that see the vertex, from the field where none does.
    #[default]
    Photos,
    /// From the field.
    Field,
}

/// How a field is made a mesh.
#[derive(Clone, Debug, Default)]
pub struct MeshOptions {
    /// The surface.
    pub extraction: ExtractSettings,
    /// Its colours.
    pub colors: ColorSource,
    /// How far, in object units, the surface may move to save triangles; 0 keeps them all.
    pub max_simplification: f32,
    /// How photographs become the texture of a run's mesh; `None` for none. Colours of the field
    /// ([`ColorSource::Field`]) have none either.
    pub texture: Option<TextureSettings>,
}

impl MeshOptions {
    /// The defaults for a mesh of so many cells along an edge of the object cube. A coarse grid of about 64 finds the
    /// cells that the surface crosses: fine enough for most parts, a 64th of the cost of 256.
    pub fn with_resolution(resolution: usize) -> Self {
        let upsampling_steps = (resolution / 64).max(1).ilog2() as usize;
        let extraction = ExtractSettings { resolution, upsampling_steps, ..ExtractSettings::default() };
        Self { extraction, texture: Some(TextureSettings::default()), ..Self::default() }
    }
}

/// Extracts the mesh of a field, in object space, with vertex colours and, where there are `views`, how well these see
/// its vertices; `seeds` are points near the surface, and `views` the photographs that may colour it. Pieces below the
/// settings' smallest share stay where photographs show them.
///
/// # Errors
/// When the field has no surface in the cube; the message says what to try. [`Error::Cancelled`] where the extraction's
/// token says so.
pub fn object_mesh(
    field: &dyn ScalarField,
    options: &MeshOptions,
    seeds: &[Vec3],
    views: &[&View],
) -> Result<Extraction> {
    // Small pieces are dropped where no photograph shows them, which the field cannot know.
    let all = ExtractSettings { min_component_share: 0.0, ..options.extraction.clone() };
    let cancellation = &options.extraction.cancellation;
    let extracted = extract_mesh(field, &all, seeds);
    let mut extracted = extracted.map_err(|error| match error {
        ExtractError::Cancelled(cancelled) => Error::Cancelled(cancelled),
        error => Error::NoMesh(error.to_string()),
    })?;
    let dropped = drop_unshown(&mut extracted.mesh, options.extraction.min_component_share, views);
    extracted.dropped_components += dropped;
    extracted.components -= dropped;
    cancellation.check()?;
    if options.max_simplification > 0.0 {
        extracted.mesh = extracted.mesh.simplified(options.max_simplification);
    }
    if views.is_empty() {
        return Ok(extracted);
    }
    if options.colors == ColorSource::Photos {
        bake_colors(&mut extracted.mesh, views, cancellation)?;
    } else {
        let cameras: Vec<&Camera> = views.iter().map(|view| &view.camera).collect();
        extracted.mesh.observations = Some(Visibility::new(&extracted.mesh).observe(&cameras));
    }
    Ok(extracted)
}

/// The mesh in the coordinates and units of the scene's own files.
pub fn world_mesh(mesh: &Mesh, object_to_world: &Similarity) -> Mesh {
    mesh.clone().transformed(object_to_world)
}
