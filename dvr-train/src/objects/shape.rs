//! A shape that was made of a picture, whatever it consists of.

use std::borrow::Cow;
use std::path::Path;

use dvr_core::inside::points_inside;
use dvr_core::mesh::shapes::vertex_normals;
use dvr_core::mesh::{Mesh, write_mesh};
use dvr_core::metrics::shape::SURFACE_SAMPLES;
use dvr_core::sampling::sample_surface;
use dvr_core::{GroundTruth, OccupancySamples, PointCloud};
use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};

use crate::error::Result;
use crate::evaluate::{ShapeEvaluation, evaluate_points};

/// Size of a point that is drawn, edges of the object cube.
const DRAWN_RADIUS: f32 = 0.015;

/// A shape in object space.
pub enum Shape {
    /// A surface; empty where the predictor sees none.
    Mesh(Mesh),
    /// Pieces of surface, which enclose nothing.
    OpenMesh(Mesh),
    /// Points, of which nothing but their places is known.
    Cloud(PointCloud),
    /// Another object, as its dataset describes it.
    Samples(GroundTruth),
}

impl Shape {
    /// The surface, where it is one.
    pub fn mesh(&self) -> Option<&Mesh> {
        match self {
            Self::Mesh(mesh) | Self::OpenMesh(mesh) => Some(mesh),
            Self::Cloud(_) | Self::Samples(_) => None,
        }
    }

    /// What can be drawn of it: the surface, or an octahedron at each point.
    pub fn drawn(&self) -> Cow<'_, Mesh> {
        let cloud = match self {
            Self::Mesh(mesh) | Self::OpenMesh(mesh) => return Cow::Borrowed(mesh),
            Self::Cloud(cloud) => cloud,
            Self::Samples(samples) => match &samples.surface {
                Some(cloud) => cloud,
                None => return Cow::Owned(Mesh::default()),
            },
        };
        let mut mesh = Mesh::default();
        for point in &cloud.points {
            let first = mesh.vertices.len() as u32;
            let corners = [Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
            mesh.vertices.extend(corners.map(|corner| *point + DRAWN_RADIUS * corner));
            for i in 0..4 {
                let (a, b) = (first + i, first + (i + 1) % 4);
                mesh.faces.extend([[a, b, first + 4], [b, a, first + 5]]);
            }
        }
        mesh.normals = Some(vertex_normals(&mesh.vertices, &mesh.faces));
        Cow::Owned(mesh)
    }

    /// Writes the shape as a mesh file: its surface, or points without faces.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let points = match self {
            Self::Mesh(mesh) | Self::OpenMesh(mesh) => return Ok(write_mesh(path, mesh)?),
            Self::Cloud(cloud) => &cloud.points[..],
            Self::Samples(samples) => samples.surface.as_ref().map_or(&[][..], |cloud| &cloud.points),
        };
        Ok(write_mesh(path, &Mesh { vertices: points.to_vec(), ..Mesh::default() })?)
    }

    /// Scores the shape against the truth: pieces of surface and points have no volume.
    ///
    /// # Errors
    /// When the truth, or the shape, has points that are not finite.
    pub fn evaluate(&self, truth: &GroundTruth, seed: u64) -> Result<ShapeEvaluation> {
        let without_volume = || GroundTruth { occupancy: None, ..truth.clone() };
        let sampled = |mesh: &Mesh| PointCloud::from(sample_surface(mesh, SURFACE_SAMPLES, seed));
        match self {
            Self::Mesh(mesh) => evaluate_points(|| sampled(mesh), |points| points_inside(mesh, points), truth, seed),
            Self::OpenMesh(mesh) => evaluate_points(|| sampled(mesh), |_| Vec::new(), &without_volume(), seed),
            Self::Cloud(cloud) => evaluate_points(|| cloud.clone(), |_| Vec::new(), &without_volume(), seed),
            Self::Samples(samples) => {
                let surface = || samples.surface.clone().unwrap_or_default();
                let inside = |points: &[Vec3]| inside_nearest(samples.occupancy.as_ref(), points);
                evaluate_points(surface, inside, truth, seed)
            }
        }
    }
}

/// Whether the nearest sample to each point is inside; false without samples.
fn inside_nearest(samples: Option<&OccupancySamples>, points: &[Vec3]) -> Vec<bool> {
    let nothing = || vec![false; points.len()];
    let Some(samples) = samples else { return nothing() };
    let positions: Vec<[f64; 3]> = samples.points.iter().map(|point| point.as_dvec3().to_array()).collect();
    let Ok(tree) = ImmutableKdTree::<f64, 3>::new_from_slice(&positions) else { return nothing() };
    points
        .iter()
        .map(|point| {
            let query = point.as_dvec3().to_array();
            samples.inside[tree.query(&query).nearest_one::<SquaredEuclidean<f64>>().execute().item as usize]
        })
        .collect()
}
