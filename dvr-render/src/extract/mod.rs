//! From an implicit function to a watertight, coloured mesh.
//!
//! [`extract_mesh`] finds the level set of a [`ScalarField`] in the padded unit cube by multi-resolution isosurface
//! extraction and marching cubes or, to keep sharp edges, dual contouring ([`Contour`]). The mesh is a closed,
//! consistently oriented manifold whatever the field; a surface that leaves the cube is closed there. It may hold
//! self-intersections where the field is finer than the grid (dual contouring: see [`Contour::Dual`]), and parts that
//! no node of the coarse grid hits, and no seed leads to, are missed.
//!
//! ```
//! use dvr_render::extract::{ExtractSettings, extract_mesh};
//! use glam::Vec3;
//!
//! let ball = |points: &[Vec3]| -> Vec<f32> { points.iter().map(|p| 0.3 - p.length()).collect() };
//! let settings = ExtractSettings { resolution: 32, upsampling_steps: 2, ..Default::default() };
//! let extraction = extract_mesh(&ball, &settings, &[])?;
//! assert!(extraction.mesh.vertices.iter().all(|v| (v.length() - 0.3).abs() < 1e-4));
//! println!("{} faces from {} evaluations", extraction.mesh.faces.len(), extraction.evaluations.total());
//! # Ok::<(), dvr_render::extract::ExtractError>(())
//! ```

mod components;
mod contour;
mod dual;
mod error;
mod field;
mod field_surface;
mod grid;
mod marching_cubes;
mod mise;
mod normals;
mod qef;
mod refine;
mod settings;
mod surface;

use dvr_core::mesh::Mesh;
use glam::Vec3;

pub use components::{count_components, drop_small_components};
pub use error::{ExtractError, Result};
pub use field::ScalarField;
pub use field_surface::FieldSurface;
pub use settings::{Contour, ExtractSettings, NormalSource};

use contour::Contoured;
use field::{Sampler, check};
use grid::GridGeometry;

/// A mesh and how it came about.
#[derive(Clone, Debug)]
pub struct Extraction {
    /// The level set, in object space, with normals, and with colours if the field has any. Never empty.
    pub mesh: Mesh,
    /// Cells along an edge of the final grid.
    pub resolution: usize,
    /// What it cost.
    pub evaluations: Evaluations,
    /// Connected pieces of the mesh.
    pub components: usize,
    /// Pieces that were too small to stay.
    pub dropped_components: usize,
    /// What the user should know about this mesh.
    pub warnings: Vec<ExtractWarning>,
}

/// How many points the field was evaluated at, by purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Evaluations {
    /// At the nodes of the grids.
    pub grid: usize,
    /// On edges, to refine the crossings.
    pub refinement: usize,
    /// For the normals: one a vertex (of dual contouring: a crossing) if the field has gradients, else six.
    pub normals: usize,
}

impl Evaluations {
    /// All together.
    pub fn total(&self) -> usize {
        self.grid + self.refinement + self.normals
    }
}

/// A reason to look at a mesh twice.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ExtractWarning {
    /// The object sticks out of the cube.
    #[error(
        "the surface is cut by the border of the cube ({vertices} vertices lie there): \
         raise `padding`, or check the scene's bounds"
    )]
    CutByCube {
        /// Vertices on the border.
        vertices: usize,
    },
    /// The coarse grid, and the seeds, saw nothing.
    #[error("the surface was only seen on a grid of {resolution}^3 cells: use fewer upsampling steps")]
    TooCoarse {
        /// Cells an edge of the coarsest grid that met the surface.
        resolution: usize,
    },
}

/// Extracts the level set of a field.
///
/// `seeds` are points on or within a cell of the surface, from ray marching, say: they lead to parts that fall between
/// the nodes of the coarse grid. Seeds outside the cube are ignored.
///
/// # Errors
/// If there is no surface ([`ExtractError::NoSurface`] says on which side of it the field is), if the field's answers
/// are NaN or too few or too many, or if a setting cannot be used.
pub fn extract_mesh<F: ScalarField + ?Sized>(
    field: &F,
    settings: &ExtractSettings,
    seeds: &[Vec3],
) -> Result<Extraction> {
    settings.check()?;
    let half_extent = settings.cube.half_extent();
    let seeds: Vec<Vec3> = seeds.iter().copied().filter(|seed| settings.cube.contains(seed.as_dvec3())).collect();
    let mut sampler = Sampler::new(field, settings.level, settings.max_points);
    let mut evaluations = Evaluations::default();
    let mut warnings = Vec::new();

    let coarse = GridGeometry { cells: settings.coarse_resolution() as u32, half_extent };
    let located = mise::locate_surface(&mut sampler, coarse, settings.upsampling_steps, &seeds)?;
    warnings.extend(located.first_seen_at.map(|resolution| ExtractWarning::TooCoarse { resolution }));
    evaluations.grid = std::mem::take(&mut sampler.evaluations);

    let resolution = located.grid.geometry.cells as usize;
    let contoured = contour::contour(&mut sampler, located.grid, settings, &mut evaluations)?;
    let Contoured { vertices, faces, normals, components, dropped_components, cut } = contoured;
    if cut > 0 {
        warnings.push(ExtractWarning::CutByCube { vertices: cut });
    }
    let colors = vertex_colors(field, &vertices, &normals, settings.max_points)?;
    let mesh = Mesh { vertices, faces, normals: Some(normals), colors, observations: None };
    Ok(Extraction { mesh, resolution, evaluations, components, dropped_components, warnings })
}

/// The field's colours at the vertices, if it has colours.
fn vertex_colors<F: ScalarField + ?Sized>(
    field: &F,
    vertices: &[Vec3],
    normals: &[Vec3],
    max_points: usize,
) -> Result<Option<Vec<[f32; 3]>>> {
    let mut colors = Vec::with_capacity(vertices.len());
    for (points, normals) in vertices.chunks(max_points).zip(normals.chunks(max_points)) {
        let Some(batch) = field.colors(points, normals) else { return Ok(None) };
        check("colors", points, &batch, |color| color.iter().all(|channel| channel.is_finite()))?;
        colors.extend(batch.into_iter().map(|color| color.map(|channel| channel.clamp(0.0, 1.0))));
    }
    Ok(Some(colors))
}
