//! A mesh against points that are known to lie on the surface.

use std::path::Path;

use dvr_core::mesh::Mesh;
use dvr_core::metrics::points::{PointsScore, PointsSettings, score_points};
use dvr_core::{Camera, Scene, VerifiedPoints};
use serde::{Deserialize, Serialize};

use crate::error::Result;

/// A mesh against verified points, and what the points are worth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointsEvaluation {
    /// Where the points come from, in plain words or as the file's name.
    pub source: String,
    /// Why the points are no independent judge of the mesh; `None` where they are one.
    pub not_independent: Option<String>,
    /// The figures, in the units of the files.
    #[serde(flatten)]
    pub score: PointsScore,
}

impl PointsEvaluation {
    /// Measures a mesh, in the coordinates of the scene's files, by the points that come with the scene; `trained_on`
    /// says whether the mesh was learned from these. `None` where there are no points or the mesh is empty.
    ///
    /// # Errors
    /// When a point is not finite.
    pub fn of_scene(mesh: &Mesh, scene: &Scene, trained_on: bool, settings: &PointsSettings) -> Result<Option<Self>> {
        let Some(verified) = VerifiedPoints::of_scene(scene).filter(|_| !mesh.is_empty()) else { return Ok(None) };
        let source = format!("sparse points of the scene ({})", scene.format);
        Self::new(mesh, &verified, Some(scene), source, trained_on, settings).map(Some)
    }

    /// Measures a mesh, in the coordinates of the scene's files, by the points of a file. Where these have no tracks,
    /// the views of `scene` tell what the mesh hides. `trained_on` says whether the mesh was learned from the scene's
    /// sparse points: a file of the scene's own folder is not independent then.
    ///
    /// # Errors
    /// When the file cannot be read ([`VerifiedPoints::read`]) or the mesh is empty.
    pub fn of_file(
        mesh: &Mesh,
        file: &Path,
        scene: Option<&Scene>,
        trained_on: bool,
        settings: &PointsSettings,
    ) -> Result<Self> {
        let verified = VerifiedPoints::read(file)?;
        let whole = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let is_own = scene.is_some_and(|scene| whole(file).starts_with(whole(&scene.source)));
        Self::new(mesh, &verified, scene, file.display().to_string(), trained_on && is_own, settings)
    }

    fn new(
        mesh: &Mesh,
        verified: &VerifiedPoints,
        scene: Option<&Scene>,
        source: String,
        trained_on: bool,
        settings: &PointsSettings,
    ) -> Result<Self> {
        let in_world = |scene: &Scene| -> Vec<Camera> {
            scene.views.iter().map(|view| view.camera.into_world(&scene.object_to_world)).collect()
        };
        let cameras = scene.map(in_world).unwrap_or_default();
        let score = score_points(mesh, verified, &cameras.iter().collect::<Vec<_>>(), settings)?;
        let not_independent = trained_on.then(|| "the mesh was trained on them".to_owned());
        Ok(Self { source, not_independent, score })
    }
}
