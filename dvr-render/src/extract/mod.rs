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
mod extraction;
mod field_surface;
mod grid;
mod marching_cubes;
mod mise;
mod normals;
mod qef;
mod refine;
mod sampler;
mod settings;
mod surface;

use dvr_core::mesh::Mesh;
use glam::Vec3;

pub use crate::field::scalar::ScalarField;
pub use components::{count_components, drop_small_components};
pub use error::{ExtractError, Result};
pub use extraction::{Evaluations, ExtractWarning, Extraction};
pub use field_surface::FieldSurface;
pub use settings::{Contour, ExtractSettings, NormalSource};

use contour::Contoured;
use grid::GridGeometry;
use sampler::{Sampler, check};

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
    let mut sampler = Sampler::new(field, settings.level, settings.max_points, settings.cancellation.clone());
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
    let colors = vertex_colors(field, &vertices, &normals, settings)?;
    let mesh = Mesh { vertices, faces, normals: Some(normals), colors, observations: None };
    Ok(Extraction { mesh, resolution, evaluations, components, dropped_components, warnings })
}

/// The field's colours at the vertices, if it has colours.
fn vertex_colors<F: ScalarField + ?Sized>(
    field: &F,
    vertices: &[Vec3],
    normals: &[Vec3],
    settings: &ExtractSettings,
) -> Result<Option<Vec<[f32; 3]>>> {
    let max_points = settings.max_points;
    let mut colors = Vec::with_capacity(vertices.len());
    for (points, normals) in vertices.chunks(max_points).zip(normals.chunks(max_points)) {
        settings.cancellation.check()?;
        let Some(batch) = field.colors(points, normals, None) else { return Ok(None) };
        check("colors", points, &batch, |color| color.iter().all(|channel| channel.is_finite()))?;
        colors.extend(batch.into_iter().map(|color| color.map(|channel| channel.clamp(0.0, 1.0))));
    }
    Ok(Some(colors))
}
