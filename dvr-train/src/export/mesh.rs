//! From a trained field to a mesh in the world of the files.

use std::path::Path;

use dvr_core::mesh::{Mesh, MeshStyle, TexturedMesh, connected_components, write_mesh, write_textured_mesh};
use dvr_core::metrics::Simplification;
use dvr_core::{Camera, HalfSpace, Similarity, View, Visibility};
use dvr_render::extract::ExtractError;
use dvr_render::extract::{ExtractSettings, ScalarField, extract_mesh};
use dvr_texture::TextureSettings;
use glam::Vec3;

use crate::error::{Error, Result};
use crate::export::bake::bake_colors;
use crate::export::components::drop_unshown;
use crate::run::checkpoint::CheckpointHeader;

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
    /// Whether a field that lies on a grid gets no more than twice its cells, and no fewer than these: what is finer shows how
    /// it is interpolated, and nothing else, on four times the faces.
    pub follows_field: bool,
    /// Its colours.
    pub colors: ColorSource,
    /// How far, in object units, the surface may move to save triangles; 0 keeps them all.
    pub max_simplification: f32,
    /// How many faces the mesh may have, 4 at least; `None` keeps them all. Charts, texture and colours are those of the
    /// simple mesh.
    pub max_faces: Option<usize>,
    /// Whether the mesh gets triangles near equilateral ([`Mesh::remeshed`]), about as many as it may have, or has.
    pub remesh: bool,
    /// The half of object space that the mesh is cut to, before it is simplified and coloured; caps close the cut.
    pub cut: Option<HalfSpace>,
    /// How photographs become the texture of a run's mesh; `None` for none. Colours of the field
    /// ([`ColorSource::Field`]) have none either.
    pub texture: Option<TextureSettings>,
    /// Whether a simplified mesh with a texture gets a normal map of the full one.
    pub normal_map: bool,
    /// How the GLB is written.
    pub style: MeshStyle,
}

impl MeshOptions {
    /// The defaults for a mesh of so many cells along an edge of the object cube. A coarse grid of about 64 finds the
    /// cells that the surface crosses: fine enough for most parts, a 64th of the cost of 256.
    pub fn with_resolution(resolution: usize) -> Self {
        let extraction = at_resolution(&ExtractSettings::default(), resolution);
        Self { extraction, texture: Some(TextureSettings::default()), ..Self::default() }
    }

    /// The same with at most so many cells, or those of a field on a grid where it has more, and no more than such a field has
    /// something to show for.
    pub fn within_resolution(most: usize) -> Self {
        Self { follows_field: true, ..Self::with_resolution(most) }
    }

    /// The same for a field on a grid of at most so many cells; `None` of any other field.
    pub fn following(self, cells: Option<usize>) -> Self {
        let Some(cells) = cells.filter(|_| self.follows_field) else { return self };
        let resolution = self.extraction.resolution.max(cells).min(FIELD_CELLS * cells);
        Self { extraction: at_resolution(&self.extraction, resolution), ..self }
    }

    /// How the surface of this field is extracted.
    fn extraction_of(&self, field: &dyn ScalarField) -> ExtractSettings {
        self.clone().following(field.cells()).extraction
    }

    /// How these views become a texture; `None` where none is asked for, or there are no views.
    pub(crate) fn texture_from(&self, views: &[&View]) -> Option<TextureSettings> {
        self.texture.filter(|_| self.colors == ColorSource::Photos && !views.is_empty())
    }

    /// The same for a run, whose mesh is cut by what the object stands on where the run says so.
    pub fn of_run(self, header: &CheckpointHeader) -> Self {
        let to_object = header.object_to_world.inverse();
        let dropped = header.support.filter(|support| support.is_dropped);
        Self { cut: dropped.map(|support| support.plane.transformed(&to_object)), ..self }
    }

    /// The same with at most this many bytes for the texture.
    pub fn with_texture_within(self, max_bytes: u64) -> Self {
        Self { texture: self.texture.map(|texture| TextureSettings { max_bytes, ..texture }), ..self }
    }
}

/// Cells of a mesh, at most, for each cell of the field that it follows.
const FIELD_CELLS: usize = 2;

/// Settings for so many cells, with a coarse grid of about 64.
fn at_resolution(settings: &ExtractSettings, resolution: usize) -> ExtractSettings {
    let upsampling_steps = (resolution / 64).max(1).ilog2() as usize;
    ExtractSettings { resolution, upsampling_steps, ..settings.clone() }
}

/// The surface of a field.
#[derive(Clone, Debug)]
pub struct ObjectMesh {
    /// In object space.
    pub mesh: Mesh,
    /// How far simplification moved it, in object units; `None` where it was not simplified.
    pub simplification: Option<Simplification>,
    /// What it was simplified from, where a normal map is to be made of that.
    pub full: Option<Mesh>,
    /// What the user should know.
    pub warnings: Vec<String>,
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
) -> Result<ObjectMesh> {
    // Small pieces are dropped where no photograph shows them, which the field cannot know.
    let all = ExtractSettings { min_component_share: 0.0, ..options.extraction_of(field) };
    let cancellation = &options.extraction.cancellation;
    let extracted = extract_mesh(field, &all, seeds);
    let mut extracted = extracted.map_err(|error| match error {
        ExtractError::Cancelled(cancelled) => Error::Cancelled(cancelled),
        error => Error::NoMesh(error.to_string()),
    })?;
    if let Some(half) = &options.cut {
        extracted.mesh = extracted.mesh.cut_before(half);
        if extracted.mesh.is_empty() {
            return Err(Error::NoMesh(
                "nothing of the mesh is on the object's side of the plane that it stands on".into(),
            ));
        }
    }
    // After the cut, which may leave pieces of its own.
    extracted.dropped_components += drop_unshown(&mut extracted.mesh, options.extraction.min_component_share, views);
    let mut warnings: Vec<String> = extracted.warnings.iter().map(ToString::to_string).collect();
    if extracted.dropped_components > 0 {
        warnings.push(format!("{} small loose component(s) were dropped from the mesh", extracted.dropped_components));
    }
    cancellation.check()?;
    let (mut mesh, full, simplification) = simplified(extracted.mesh, options, &mut warnings);
    let full = full.filter(|_| options.normal_map && options.texture_from(views).is_some());
    cancellation.check()?;
    if views.is_empty() {
        return Ok(ObjectMesh { mesh, simplification, full, warnings });
    }
    if options.colors == ColorSource::Photos {
        bake_colors(&mut mesh, views, cancellation)?;
    } else {
        let cameras: Vec<&Camera> = views.iter().map(|view| &view.camera).collect();
        mesh.observations = Some(Visibility::new(&mesh).observe(&cameras));
    }
    Ok(ObjectMesh { mesh, simplification, full, warnings })
}

/// The mesh as simple as the options ask for, before photographs colour it; the full one, and how far it moved, where it was
/// simplified.
fn simplified(
    full: Mesh,
    options: &MeshOptions,
    warnings: &mut Vec<String>,
) -> (Mesh, Option<Mesh>, Option<Simplification>) {
    let within_distance = (options.max_simplification > 0.0).then(|| full.simplified(options.max_simplification));
    let before = within_distance.as_ref().unwrap_or(&full);
    let simple = with_faces(before, options.max_faces, options.remesh, warnings).or(within_distance);
    match simple {
        None => (full, None, None),
        Some(simple) => {
            let moved = Simplification::between(&full, &simple);
            (simple, Some(full), Some(moved))
        }
    }
}

/// The mesh with the triangles that are asked for: at most so many, or, remeshed, about so many of one size. `None` where it stays
/// as it is.
pub fn with_faces(mesh: &Mesh, most: Option<usize>, remesh: bool, warnings: &mut Vec<String>) -> Option<Mesh> {
    let all = mesh.faces.len();
    if remesh {
        return Some(mesh.remeshed(most.map_or(all, |most| most.min(all))));
    }
    let most = most.filter(|&most| all > most)?;
    let simple = mesh.within_faces(most);
    let faces = simple.faces.len();
    if faces > most {
        let components = connected_components(simple.vertices.len(), &simple.faces).1;
        warnings.push(format!(
            "the mesh has {faces} faces, more than {most}: its {components} component(s) cannot be simplified further"
        ));
    }
    Some(simple)
}

/// Writes a run's mesh by the path's extension: PLY with colours per vertex, GLB and OBJ with the texture where there is one.
///
/// # Errors
/// When the file cannot be written.
pub fn write_run_mesh(path: &Path, mesh: &Mesh, textured: Option<&TexturedMesh>, style: MeshStyle) -> Result<()> {
    Ok(match textured {
        _ if path.extension().is_some_and(|extension| extension == "ply") => write_mesh(path, mesh),
        Some(textured) => write_textured_mesh(path, textured, style),
        None => write_textured_mesh(path, &TexturedMesh::from(mesh.clone()), style),
    }?)
}

/// The mesh in the coordinates and units of the scene's own files.
pub fn world_mesh(mesh: &Mesh, object_to_world: &Similarity) -> Mesh {
    mesh.clone().transformed(object_to_world)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball that says that it lies on a grid of so many cells.
    struct Ball(Option<usize>);

    impl ScalarField for Ball {
        fn logits(&self, points: &[Vec3]) -> Vec<f32> {
            points.iter().map(|point| 0.3 - point.length()).collect()
        }

        fn cells(&self) -> Option<usize> {
            self.0
        }
    }

    #[test]
    fn a_mesh_has_twice_the_cells_of_its_field_unless_it_is_told_otherwise() {
        let faces = |options: MeshOptions, cells| {
            let colors = ColorSource::Field;
            object_mesh(&Ball(cells), &MeshOptions { colors, ..options }, &[], &[]).unwrap().mesh.faces.len()
        };
        let exactly = |resolution| faces(MeshOptions::with_resolution(resolution), Some(16));
        let within = |most, cells| faces(MeshOptions::within_resolution(most), cells);
        assert_eq!(within(64, Some(16)), exactly(32));
        assert_eq!(within(24, Some(16)), exactly(24), "never more than is asked for");
        assert_eq!(within(64, None), exactly(64), "a field on no grid");
        assert_eq!(within(8, Some(16)), exactly(16), "a field that is finer");
        assert!(exactly(64) > 3 * exactly(32));
    }
}
