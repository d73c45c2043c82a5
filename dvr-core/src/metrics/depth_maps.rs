//! Depth maps that stereo estimated, against what is known of the surface: how far off they are before anything is made
//! of them.

use glam::{DVec3, Vec2};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::points::{DistanceSummary, PointsSettings, quantile};
use super::seen::discs;
use crate::bilinear::Bilinear;
use crate::bvh::Bvh;
use crate::mesh::Mesh;
use crate::pinhole::Pinhole;
use crate::points::PointCloud;
use crate::raster::DepthMap;
use crate::ray::Ray;
use crate::scene::Scene;
use crate::verified_points::VerifiedPoints;

/// Distances along rays below which pixels are counted where the true surface is known, edges of the object cube.
const SURFACE_THRESHOLDS: [f64; 4] = [0.001, 0.002, 0.005, 0.01];

/// Disparities below which pixels are counted.
const DISPARITY_THRESHOLDS: [f64; 4] = [0.25, 0.5, 1.0, 2.0];

/// Pixels of all maps together that are held against a true surface, about.
const SURFACE_PIXELS: usize = 60_000;

/// Sides of a pixel that depths of one surface differ by, at most, from pixel to pixel.
pub(crate) const MAX_STEP: f32 = 6.0;

/// The depths that stereo found in a view.
#[derive(Clone, Debug)]
pub struct StereoDepth {
    /// The view's name.
    pub name: String,
    /// The camera of the map's pixels, in object space.
    pub camera: Pinhole,
    /// Z-depths in object units, no number where none is known.
    pub depth: DepthMap,
    /// Pixels that show the object, by its mask.
    pub object_pixels: usize,
    /// Pixels of the photograph along the side of one of the map's.
    pub shrunk_by: usize,
    /// The views that it was matched with, as places in the list of all maps, best first.
    pub neighbours: Vec<usize>,
}

/// Depths against a surface that is known at some of their pixels. Lengths are in the unit of what they are held
/// against: edges of the object cube, or that of the files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DepthScore {
    /// Lines of sight from views to places of the true surface that they see.
    pub sights: usize,
    /// Share of these at which a depth is known.
    pub known: f64,
    /// How far the known depths are off, along the lines of sight.
    pub distance: DistanceSummary,
    /// The median of the same with its sign, positive where the depth is too large.
    pub median_behind: f64,
    /// How far they are off where the nearest view that they were matched with shows them, pixels of the photographs.
    pub disparity_px: DistanceSummary,
}

/// One line of sight with a known depth.
struct Difference {
    /// Depth less true depth, as a length along the ray.
    behind: f64,
    disparity_px: Option<f64>,
}

impl StereoDepth {
    /// Pixels with a depth.
    pub fn known_pixels(&self) -> usize {
        self.depth.z_depth.iter().filter(|depth| depth.is_finite()).count()
    }

    /// The depth at a place in the map, between pixels where these lie on one surface.
    fn at(&self, place: Vec2) -> Option<f32> {
        let (width, height) = (self.depth.width, self.depth.height);
        let inside = place.x >= 0.0 && place.y >= 0.0 && place.x < width as f32 && place.y < height as f32;
        let nearest = inside.then(|| self.depth.get(place.x as u32, place.y as u32)).filter(|depth| depth.is_finite());
        let between = Bilinear::at_single(place, (width, height)).and_then(|at| {
            let depths = at.pixels.map(|(u, v)| self.depth.get(u, v));
            let [low, high] = [f32::min, f32::max].map(|of| depths.iter().copied().fold(depths[0], of));
            let limit = MAX_STEP * self.camera.to_direction.x_axis.length() * low;
            (depths.iter().all(|depth| depth.is_finite()) && high - low < limit).then(|| at.value(depths))
        });
        between.or(nearest)
    }

    /// What a place of the surface, in object space, is off; `scale` takes lengths to the units that are reported.
    fn difference(&self, all: &[Self], point: DVec3, scale: f64) -> Option<Difference> {
        let (place, true_depth) = self.camera.project(point.as_vec3());
        let depth = self.at(place)?;
        let direction = self.camera.direction_through(place);
        let neighbour = self.neighbours.first().and_then(|&other| all.get(other));
        let disparity_px = neighbour.map(|other| {
            let [seen, expected] =
                [depth, true_depth].map(|depth| other.camera.project(self.camera.center + depth * direction).0);
            f64::from(seen.distance(expected)) * other.shrunk_by as f64
        });
        let behind = f64::from(depth - true_depth) * f64::from(direction.length()) * scale;
        Some(Difference { behind, disparity_px: disparity_px.filter(|disparity| disparity.is_finite()) })
    }

    /// Whether a point in object space is ahead and in the frame.
    fn shows(&self, point: DVec3) -> bool {
        let (place, z) = self.camera.project(point.as_vec3());
        let size = Vec2::new(self.depth.width as f32, self.depth.height as f32);
        z > 0.0 && place.cmpge(Vec2::ZERO).all() && place.cmplt(size).all()
    }
}

impl DepthScore {
    /// Sums up what is known of each line of sight; `None` of none.
    fn new(sights: &[Option<Difference>], thresholds: &[f64]) -> Option<Self> {
        let known: Vec<&Difference> = sights.iter().flatten().collect();
        let mut behind: Vec<f64> = known.iter().map(|difference| difference.behind).collect();
        behind.sort_unstable_by(f64::total_cmp);
        let disparities = known.iter().filter_map(|difference| difference.disparity_px).collect();
        (!sights.is_empty()).then(|| Self {
            sights: sights.len(),
            known: known.len() as f64 / sights.len() as f64,
            median_behind: quantile(&behind, 0.5),
            distance: DistanceSummary::new(behind.iter().map(|behind| behind.abs()).collect(), thresholds),
            disparity_px: DistanceSummary::new(disparities, &DISPARITY_THRESHOLDS),
        })
    }

    /// Depths against points of the true surface with normals, in object space: each stands for a disc, which rays of
    /// an even subset of the pixels meet. Lengths are in edges of the object cube. `None` where there are no normals, or
    /// no ray meets the surface.
    pub fn by_surface(maps: &[StereoDepth], truth: &PointCloud) -> Option<Self> {
        let (discs, _) = discs(truth)?;
        let bvh = Bvh::new(&discs);
        let pixels: usize = maps.iter().map(|map| map.depth.z_depth.len()).sum();
        let stride = pixels.div_ceil(SURFACE_PIXELS).max(1);
        let of_map = |map: &StereoDepth| -> Vec<Option<Difference>> {
            let origin = map.camera.center.as_dvec3();
            let sight = |pixel: usize| {
                let (x, y) = (pixel % map.depth.width as usize, pixel / map.depth.width as usize);
                let place = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let direction = map.camera.direction_through(place).as_dvec3();
                let hit = bvh.closest_hit(&Ray { origin, direction }, 0.0, f64::INFINITY)?;
                Some(map.difference(maps, origin + hit.ray_depth * direction, 1.0))
            };
            (0..map.depth.z_depth.len()).step_by(stride).filter_map(sight).collect()
        };
        let sights: Vec<Option<Difference>> = maps.par_iter().flat_map_iter(of_map).collect();
        Self::new(&sights, &SURFACE_THRESHOLDS)
    }

    /// Depths of views of `scene` against verified points, each in the views that triangulated it; where these are not
    /// known, in those that have it in their frame and from which `mesh`, in the coordinates of the files, does not hide
    /// it. Lengths are in the units of the files. `None` where no view sees a point.
    pub fn by_points(
        maps: &[StereoDepth],
        verified: &VerifiedPoints,
        scene: &Scene,
        mesh: &Mesh,
        settings: &PointsSettings,
    ) -> Option<Self> {
        let (to_object, scale) = (scene.object_to_world.inverse(), scene.object_to_world.scale);
        let bvh = Bvh::new(mesh);
        let (thresholds, margin) = settings.for_points(&verified.points);
        let view_of = |map: &StereoDepth| scene.views.iter().position(|view| view.name == map.name);
        let views: Vec<Option<usize>> = maps.iter().map(view_of).collect();
        let sights: Vec<Option<Difference>> = (verified.points.par_iter().enumerate())
            .flat_map_iter(|(index, &in_world)| {
                let point = to_object.transform_point(in_world);
                let sees = |map: usize| match &verified.tracks {
                    Some(tracks) => {
                        views[map].is_some_and(|view| tracks.sights[index].iter().any(|sight| sight.camera == view))
                    }
                    None => {
                        let center = maps[map].camera.center.as_dvec3();
                        !is_hidden(&bvh, scene.object_to_world.transform_point(center), in_world, margin.unwrap_or(0.0))
                    }
                };
                let of_map = |map: usize| maps[map].difference(maps, point, scale);
                let seeing: Vec<usize> = (0..maps.len()).filter(|&map| maps[map].shows(point) && sees(map)).collect();
                seeing.into_iter().map(of_map).collect::<Vec<_>>()
            })
            .collect();
        Self::new(&sights, &thresholds)
    }
}

/// Whether the mesh stands between a camera and a point, more than `margin` before it.
fn is_hidden(bvh: &Bvh, origin: DVec3, point: DVec3, margin: f64) -> bool {
    let ray = Ray { origin, direction: point - origin };
    bvh.any_hit(&ray, 0.0, 1.0 - margin / ray.direction.length())
}

/// A ball, and what stereo finds of it.
#[cfg(test)]
pub(crate) mod ball {
    use glam::DVec3;

    use super::*;
    use crate::camera::Camera;

    pub(crate) const RADIUS: f64 = 0.4;

    /// Depth maps of a ball whose depths are longer by `factor` than the true ones, of two views in one row.
    pub(crate) fn depth_maps(factor: f64) -> Vec<StereoDepth> {
        let of_view = |i: usize| {
            let eye = DVec3::new(0.4 * i as f64, 0.0, 2.0);
            let camera = Camera::look_at(64, 64, 80.0, eye, DVec3::ZERO, DVec3::Y);
            let pinhole = Pinhole::new(&camera);
            let z_depth = |pixel: usize| {
                let place = Vec2::new((pixel % 64) as f32 + 0.5, (pixel / 64) as f32 + 0.5);
                let direction = pinhole.direction_through(place).as_dvec3();
                let (a, b) = (direction.length_squared(), eye.dot(direction));
                let under = b * b - a * (eye.length_squared() - RADIUS * RADIUS);
                // Nothing is known in the upper half.
                let depth = if under < 0.0 || pixel < 32 * 64 { f64::NAN } else { (-b - under.sqrt()) / a };
                (factor * depth) as f32
            };
            let depth = DepthMap { width: 64, height: 64, z_depth: (0..64 * 64).map(z_depth).collect() };
            let (name, neighbours) = (i.to_string(), vec![1 - i]);
            StereoDepth { name, camera: pinhole, depth, object_pixels: 800, shrunk_by: 2, neighbours }
        };
        (0..2).map(of_view).collect()
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::ball::{RADIUS, depth_maps};
    use super::*;
    use crate::camera::Similarity;
    use crate::mesh::shapes;
    use crate::sampling::sample_surface;

    #[test]
    fn depths_of_a_ball_are_off_by_what_was_added_to_them_and_half_of_them_are_missing() {
        let truth = PointCloud::from(sample_surface(&shapes::icosphere(6, RADIUS as f32), 40_000, 1));
        let exact = DepthScore::by_surface(&depth_maps(1.0), &truth).unwrap();
        assert!((exact.known - 0.5).abs() < 0.02, "{}", exact.known);
        // The discs stand off a ball, and out at its outline.
        assert!(exact.distance.median < 3e-4 && exact.disparity_px.median < 0.02, "{exact:?}");
        let longer = DepthScore::by_surface(&depth_maps(1.01), &truth).unwrap();
        // From 1.6 on the axis to 1.96 at the outline.
        assert!((0.016..0.0185).contains(&longer.median_behind), "{}", longer.median_behind);
        assert!((longer.distance.median - longer.median_behind).abs() < 1e-3);
        // A point .017 behind moves by 80 / 1.7 * .017 * sin(.2) or so pixels of the map, each two of the photograph.
        assert!((0.2..0.45).contains(&longer.disparity_px.median), "{}", longer.disparity_px.median);
        let shorter = DepthScore::by_surface(&depth_maps(0.99), &truth).unwrap();
        assert!(shorter.median_behind < -0.015, "{}", shorter.median_behind);
    }

    #[test]
    fn points_count_in_the_views_that_see_them_and_lengths_are_those_of_the_files() {
        let object_to_world =
            Similarity { scale: 10.0, translation: DVec3::new(1.0, 2.0, 3.0), ..Similarity::default() };
        let ball = shapes::icosphere(6, RADIUS as f32);
        let in_world = |point: glam::Vec3| object_to_world.transform_point(point.as_dvec3());
        let points: Vec<DVec3> = sample_surface(&ball, 2000, 3).points.into_iter().map(in_world).collect();
        let mesh =
            Mesh { vertices: ball.vertices.iter().map(|&vertex| in_world(vertex).as_vec3()).collect(), ..ball.clone() };
        let scene = Scene {
            name: String::new(),
            source: std::path::PathBuf::new(),
            format: "",
            views: Vec::new(),
            object_to_world,
            region: crate::Region::default(),
            sparse_points: None,
            ground_truth: crate::GroundTruth::default(),
            warnings: Vec::new(),
        };
        let verified = VerifiedPoints { points, ..VerifiedPoints::default() };
        let settings = PointsSettings { thresholds: vec![0.1, 1.0], margin: Some(0.05) };
        let score = DepthScore::by_points(&depth_maps(1.01), &verified, &scene, &mesh, &settings).unwrap();
        // Two views see two fifths of the ball each.
        assert!((1300..2000).contains(&score.sights) && (score.known - 0.5).abs() < 0.05, "{score:?}");
        assert!((0.16..0.19).contains(&score.distance.median), "{}", score.distance.median);
        assert!(score.distance.below[0].share < 0.1, "{:?}", score.distance.below);
        assert!(score.distance.below[1].share > 0.99, "{:?}", score.distance.below);
    }
}
