//! From a located surface to vertices, triangles and normals, by either kind of contouring.

use glam::Vec3;

use super::components::{compact, retain_large, select};
use super::dual::DualMesh;
use super::error::Result;
use super::extraction::Evaluations;
use super::grid::SparseGrid;
use super::normals::{face_normals, field_normals};
use super::refine::refine_crossings;
use super::sampler::Sampler;
use super::settings::{Contour, ExtractSettings, NormalSource};
use super::surface::{Crossing, triangulate};
use crate::field::scalar::ScalarField;

/// Step of the central differences at vertices, in cells: about the detail that the mesh has.
const VERTEX_STEP: f64 = 0.25;

/// Step of the central differences at crossings, in cells: short, as one that reaches over a crease blurs it.
const CROSSING_STEP: f64 = 0.05;

/// A mesh without colours, and what is known about it.
pub(super) struct Contoured {
    pub vertices: Vec<Vec3>,
    pub faces: Vec<[u32; 3]>,
    /// Outward unit normals.
    pub normals: Vec<Vec3>,
    /// Connected components, and how many were too small to stay.
    pub components: usize,
    pub dropped_components: usize,
    /// Vertices that lie on the border of the cube.
    pub cut: usize,
}

/// Contours the surface of a grid; `evaluations` takes in what the crossings and the normals cost.
pub(super) fn contour<F: ScalarField + ?Sized>(
    sampler: &mut Sampler<F>,
    grid: SparseGrid,
    settings: &ExtractSettings,
    evaluations: &mut Evaluations,
) -> Result<Contoured> {
    match settings.contour {
        Contour::MarchingCubes => marching_cubes(sampler, grid, settings, evaluations),
        Contour::Dual => dual_contouring(sampler, grid, settings, evaluations),
    }
}

fn marching_cubes<F: ScalarField + ?Sized>(
    sampler: &mut Sampler<F>,
    grid: SparseGrid,
    settings: &ExtractSettings,
    evaluations: &mut Evaluations,
) -> Result<Contoured> {
    let geometry = grid.geometry;
    let (mut crossings, mut faces) = triangulate(&grid);
    drop(grid);
    let positions = |crossings: &[Crossing]| crossings.iter().map(|c| c.position(&geometry)).collect::<Vec<_>>();
    // Small components go before anything is spent on them.
    let (components, dropped_components) =
        retain_large(&positions(&crossings), &mut faces, settings.min_component_share);
    let kept = compact(&mut faces, crossings.len());
    crossings = select(&crossings, &kept);
    let cut = crossings.iter().filter(|crossing| crossing.is_on_border(&geometry)).count();

    refine_crossings(sampler, &geometry, &mut crossings, settings.refinement_steps)?;
    evaluations.refinement = std::mem::take(&mut sampler.evaluations);

    let vertices = positions(&crossings);
    let mut normals = face_normals(&vertices, &faces);
    if settings.normals == NormalSource::Field {
        let step = (VERTEX_STEP * geometry.cell_size()) as f32;
        normals = field_normals(sampler, &vertices, step, &normals)?;
        evaluations.normals = std::mem::take(&mut sampler.evaluations);
    }
    Ok(Contoured { vertices, faces, normals, components, dropped_components, cut })
}

fn dual_contouring<F: ScalarField + ?Sized>(
    sampler: &mut Sampler<F>,
    grid: SparseGrid,
    settings: &ExtractSettings,
    evaluations: &mut Evaluations,
) -> Result<Contoured> {
    let geometry = grid.geometry;
    let mut dual = DualMesh::of(&grid);
    drop(grid);
    refine_crossings(sampler, &geometry, &mut dual.crossings, settings.refinement_steps)?;
    evaluations.refinement = std::mem::take(&mut sampler.evaluations);

    // On the border of the cube the surface is the cube's own.
    let mut normals: Vec<Vec3> = dual.crossings.iter().map(Crossing::outward).collect();
    let within: Vec<u32> =
        (0..).zip(&dual.crossings).filter(|(_, c)| !c.is_on_border(&geometry)).map(|(index, _)| index).collect();
    let points: Vec<Vec3> = within.iter().map(|&index| dual.crossings[index as usize].position(&geometry)).collect();
    let step = (CROSSING_STEP * geometry.cell_size()) as f32;
    let of_field = field_normals(sampler, &points, step, &select(&normals, &within))?;
    within.iter().zip(of_field).for_each(|(&index, normal)| normals[index as usize] = normal);
    evaluations.normals = std::mem::take(&mut sampler.evaluations);

    let mut vertices = dual.vertices(&geometry, &normals);
    let mut normals = dual.vertex_normals(&normals);
    let mut faces = dual.triangles(&vertices, &normals);
    let (components, dropped_components) = retain_large(&vertices, &mut faces, settings.min_component_share);
    let kept = compact(&mut faces, vertices.len());
    vertices = select(&vertices, &kept);
    let of_faces = face_normals(&vertices, &faces);
    normals = match settings.normals {
        NormalSource::Faces => of_faces,
        NormalSource::Field => {
            let means = select(&normals, &kept).into_iter().zip(of_faces);
            means.map(|(mean, of_faces)| if mean == Vec3::ZERO { of_faces } else { mean }).collect()
        }
    };
    let cut = kept.iter().filter(|&&vertex| dual.is_on_border(&geometry, vertex)).count();
    Ok(Contoured { vertices, faces, normals, components, dropped_components, cut })
}
