//! What is measured of a run's mesh, whatever photographs make of it.

use std::time::Instant;

use dvr_core::mesh::Mesh;
use dvr_core::metrics::depth_maps::StereoDepth;
use dvr_core::metrics::points::PointsSettings;
use dvr_core::metrics::self_intersections;
use dvr_core::{Camera, Cancellation, Scene, Similarity, VerifiedPoints};

use crate::error::Result;
use crate::evaluate::{DepthMapsEvaluation, PointsEvaluation, ShapeEvaluation, evaluate_shape};
use crate::export::mesh::world_mesh;

/// What a mesh is measured with.
pub(super) struct Measuring<'a> {
    /// Its truth, verified points and cameras.
    pub scene: &'a Scene,
    /// From object space to the coordinates of the scene's files.
    pub object_to_world: &'a Similarity,
    /// Whether the sparse points of the scene shaped it.
    pub trained_on_points: bool,
    /// Depth maps that training started from.
    pub stereo_depths: &'a [StereoDepth],
    /// Of the surface samples.
    pub seed: u64,
    pub cancellation: &'a Cancellation,
}

/// The figures of a mesh.
pub(super) struct Measured {
    /// Pairs of faces that intersect; `None` without a mesh.
    pub self_intersections: Option<usize>,
    pub shape: ShapeEvaluation,
    pub points: Option<PointsEvaluation>,
    pub depth_maps: Option<DepthMapsEvaluation>,
    /// The mesh in the coordinates of the scene's files.
    pub in_world: Option<Mesh>,
    /// What it took.
    pub seconds: f64,
}

impl Measuring<'_> {
    /// Measures a mesh in object space.
    ///
    /// # Errors
    /// When the scene's truth is broken; [`crate::Error::Cancelled`] where somebody wants it to end.
    pub fn of(self, mesh: Option<&Mesh>) -> Result<Measured> {
        let clock = Instant::now();
        let Self { scene, cancellation, .. } = self;
        let empty = Mesh::default();
        let cameras: Vec<&Camera> = scene.views.iter().map(|view| &view.camera).collect();
        let shape = evaluate_shape(mesh.unwrap_or(&empty), &scene.ground_truth, &cameras, self.seed)?;
        cancellation.check()?;
        let self_intersections = mesh.map(|mesh| self_intersections(mesh, cancellation)).transpose()?;
        let in_world = mesh.map(|mesh| world_mesh(mesh, self.object_to_world));
        let settings = PointsSettings::default();
        let points = match &in_world {
            Some(mesh) => PointsEvaluation::of_scene(mesh, scene, self.trained_on_points, &settings)?,
            None => None,
        };
        cancellation.check()?;
        let depth_maps = DepthMapsEvaluation::new(
            self.stereo_depths,
            scene,
            VerifiedPoints::of_scene(scene).as_ref(),
            in_world.as_ref().unwrap_or(&empty),
            &settings,
        );
        let seconds = clock.elapsed().as_secs_f64();
        Ok(Measured { self_intersections, shape, points, depth_maps, in_world, seconds })
    }
}
