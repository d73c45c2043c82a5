//! What stereo found before training, against what is known of the surface.

use dvr_core::mesh::Mesh;
use dvr_core::metrics::depth_maps::{DepthScore, StereoDepth};
use dvr_core::metrics::points::PointsSettings;
use dvr_core::{Scene, VerifiedPoints};
use serde::{Deserialize, Serialize};

/// The depth maps that a run started from, as far as other views confirm them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DepthMapsEvaluation {
    /// Views with a map.
    pub views: usize,
    /// Pixels of the maps that show the object.
    pub pixels: usize,
    /// Share of these with a depth.
    pub known: f64,
    /// Against the true surface, in edges of the object cube; `None` where that is not known.
    pub surface: Option<DepthScore>,
    /// Against verified points, in the units of the files; `None` where there are none.
    pub points: Option<DepthScore>,
}

impl DepthMapsEvaluation {
    /// Measures the maps of views of a scene. Of points without tracks, `mesh`, in the coordinates of the scene's files,
    /// tells which views see them. `None` where there are no maps.
    pub fn new(
        maps: &[StereoDepth],
        scene: &Scene,
        points: Option<&VerifiedPoints>,
        mesh: &Mesh,
        settings: &PointsSettings,
    ) -> Option<Self> {
        let pixels: usize = maps.iter().map(|map| map.object_pixels).sum();
        let known: usize = maps.iter().map(StereoDepth::known_pixels).sum();
        let truth = scene.ground_truth.surface.as_ref();
        (!maps.is_empty()).then(|| Self {
            views: maps.len(),
            pixels,
            known: known as f64 / pixels.max(1) as f64,
            surface: truth.and_then(|truth| DepthScore::by_surface(maps, truth)),
            points: points.and_then(|points| DepthScore::by_points(maps, points, scene, mesh, settings)),
        })
    }
}
