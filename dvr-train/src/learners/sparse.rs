//! Sparse points from structure from motion as depth targets: rays that are known to end somewhere.

use dvr_core::{Ray, Scene, View};
use rand::Rng;

/// Rays through the projections of sparse points into the views that see them, with the points' depths.
#[derive(Clone, Debug, Default)]
pub struct SparseTargets {
    targets: Vec<(Ray, f32)>,
}

impl SparseTargets {
    /// Every point in every training view that sees it; empty where the scene has no sparse points.
    pub fn new(scene: &Scene, train: &[&View]) -> Self {
        let Some(sparse) = &scene.sparse_points else { return Self::default() };
        let is_trained = |view: &View| train.iter().any(|other| other.name == view.name);
        let trained: Vec<bool> = scene.views.iter().map(is_trained).collect();
        let pairs = sparse.cloud.points.iter().zip(&sparse.visible_in);
        let targets = pairs.flat_map(|(point, seen_in)| {
            let views = seen_in.iter().filter(|&&view| trained.get(view) == Some(&true));
            views.filter_map(|&view| {
                let camera = &scene.views[view].camera;
                let (pixel, z_depth) = camera.project(point.as_dvec3());
                (z_depth > 0.0 && camera.sees(pixel)).then(|| (camera.ray(pixel), z_depth as f32))
            })
        });
        Self { targets: targets.collect() }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.targets.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.targets.is_empty()
    }

    /// Draws rays and their z-depths, which are ray depths too; nothing where there is nothing to draw from.
    pub fn draw(&self, count: usize, rng: &mut impl Rng) -> (Vec<Ray>, Vec<f32>) {
        let count = if self.is_empty() { 0 } else { count };
        (0..count).map(|_| self.targets[rng.random_range(0..self.targets.len())]).unzip()
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::{Camera, GroundTruth, Mask, PointCloud, Similarity, SparsePoints, stored};
    use glam::{DVec3, Vec3};
    use rand::SeedableRng;

    use super::*;

    fn view(name: &str, eye: DVec3) -> View {
        let camera = Camera::look_at(20, 20, 25.0, eye, DVec3::ZERO, DVec3::Y);
        let mask = Mask::from(image::GrayImage::new(20, 20));
        View::new(name, camera, stored(image::RgbImage::new(20, 20)), mask)
    }

    fn scene() -> Scene {
        let cloud = PointCloud { points: vec![Vec3::new(0.1, -0.2, 0.3), Vec3::ZERO], ..PointCloud::default() };
        Scene {
            name: "points".into(),
            source: "points".into(),
            format: "test",
            views: vec![view("a", DVec3::Z * 2.0), view("b", DVec3::X * 2.0)],
            object_to_world: Similarity::default(),
            region: dvr_core::Region::default(),
            sparse_points: Some(SparsePoints {
                cloud,
                visible_in: vec![vec![0, 1], vec![1]],
                ..SparsePoints::default()
            }),
            ground_truth: GroundTruth::default(),
            warnings: Vec::new(),
        }
    }

    #[test]
    fn a_target_ray_ends_at_its_point() {
        let scene = scene();
        let targets = SparseTargets::new(&scene, &[&scene.views[0], &scene.views[1]]);
        assert_eq!(targets.len(), 3, "one for each view that sees a point");
        let (rays, depths) = targets.draw(20, &mut rand_chacha::ChaCha8Rng::seed_from_u64(1));
        for (ray, depth) in rays.iter().zip(depths) {
            let end = ray.at(f64::from(depth)).as_vec3();
            assert!(end.distance(Vec3::new(0.1, -0.2, 0.3)) < 1e-6 || end.length() < 1e-6, "{end}");
        }
    }

    #[test]
    fn views_that_are_not_trained_on_and_scenes_without_points_give_no_targets() {
        let mut scene = scene();
        assert_eq!(SparseTargets::new(&scene, &[&scene.views[0]]).len(), 1);
        scene.sparse_points = None;
        assert!(SparseTargets::new(&scene, &[&scene.views[0]]).is_empty());
    }
}
