//! Points that are known to lie on the true surface: what a mesh of photographs can be measured by.

use glam::{DVec2, DVec3, Vec3};

use crate::camera::Camera;
use crate::scene::Scene;

/// Points that something other than the reconstruction has found on the surface: a scanner, or structure from motion
/// with matches that several views agree on.
///
/// They say how far a surface is where they are, and nothing of where they are not.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VerifiedPoints {
    /// Positions, in the world of the scene's files and in its units.
    pub points: Vec<DVec3>,
    /// For each point how many views triangulated it, where that is known.
    pub track_lengths: Option<Vec<usize>>,
    /// For each point its reprojection error in pixels, where that is known.
    pub errors_px: Option<Vec<f64>>,
    /// Which views triangulated each point, where that is known.
    pub tracks: Option<Tracks>,
}

/// The views that triangulated points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tracks {
    /// The cameras, in the world of the scene's files.
    pub cameras: Vec<Camera>,
    /// For each point the views that triangulated it.
    pub sights: Vec<Vec<TrackSight>>,
}

/// One view of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackSight {
    /// Which of the cameras.
    pub camera: usize,
    /// Where its picture shows the point, as `(x / z, y / z)` in camera space, where that is known.
    pub bearing: Option<DVec2>,
}

impl VerifiedPoints {
    /// The points that come with a scene, as [`Scene::sparse_points`] holds them: those on the object; `None` where
    /// there are none.
    pub fn of_scene(scene: &Scene) -> Option<Self> {
        let sparse = scene.sparse_points.as_ref()?;
        let in_world = |point: &Vec3| scene.object_to_world.transform_point(point.as_dvec3());
        let sights = sparse.visible_in.iter().enumerate().map(|(point, views)| {
            let bearing = |i: usize| sparse.bearings.as_ref().and_then(|all| all.get(point)?.get(i).copied());
            views.iter().enumerate().map(|(i, &camera)| TrackSight { camera, bearing: bearing(i) }).collect()
        });
        let has_tracks = sparse.has_tracks();
        Some(Self {
            points: sparse.cloud.points.iter().map(in_world).collect(),
            track_lengths: has_tracks.then(|| sparse.visible_in.iter().map(Vec::len).collect()),
            errors_px: sparse.errors_px.clone(),
            tracks: has_tracks.then(|| Tracks {
                sights: sights.collect(),
                cameras: scene.views.iter().map(|view| view.camera.into_world(&scene.object_to_world)).collect(),
            }),
        })
    }
}
