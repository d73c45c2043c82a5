//! Visual hulls of training objects: what masks alone tell of the depth of a pixel.

use std::sync::Arc;

use dvr_core::dataset::ObjectDataset;
use dvr_core::hull::{HullSettings, VisualHull};
use dvr_core::{Ray, UnitCube, View};

use super::kept::Kept;
use crate::error::Result;

/// The hulls of a dataset's objects, each carved when it is first asked for.
pub(crate) struct Hulls {
    resolution: usize,
    kept: Kept<CoarseHull>,
}

impl Hulls {
    /// Hulls of so many voxels along an edge of the cube.
    pub fn new(resolution: usize) -> Self {
        Self { resolution, kept: Kept::default() }
    }

    /// The hull of all masks of an object.
    ///
    /// # Errors
    /// When one of its views cannot be read.
    pub fn of(&self, dataset: &ObjectDataset, object: usize) -> Result<Arc<CoarseHull>> {
        self.kept.of(object, CoarseHull::bytes, || self.carve(dataset, object))
    }

    fn carve(&self, dataset: &ObjectDataset, object: usize) -> Result<CoarseHull> {
        let views = (0..dataset.views(object)?).map(|view| dataset.read_view(object, view));
        let views = views.collect::<dvr_core::Result<Vec<View>>>()?;
        let masks: Vec<_> = views.iter().filter_map(View::training_pair).collect();
        // A voxel too much is depth too little: centres decide.
        let settings = HullSettings { conservative: false, ..HullSettings::default() };
        Ok(CoarseHull::new(&VisualHull::carve(&masks, UnitCube::default().into(), self.resolution, &settings)?))
    }
}

/// A visual hull in a bit a voxel.
pub(crate) struct CoarseHull {
    resolution: usize,
    occupied: Vec<u64>,
}

impl CoarseHull {
    fn new(hull: &VisualHull) -> Self {
        let n = hull.resolution();
        let mut occupied = vec![0u64; n.pow(3).div_ceil(64)];
        for index in (0..n.pow(3)).filter(|i| hull.voxel([i % n, i / n % n, i / (n * n)])) {
            occupied[index / 64] |= 1 << (index % 64);
        }
        Self { resolution: n, occupied }
    }

    fn bytes(&self) -> usize {
        8 * self.occupied.len()
    }

    /// Depth at which a ray enters the hull, to half a voxel, in units of its direction; infinite where it passes by.
    pub fn depth(&self, ray: &Ray) -> f32 {
        let cube = UnitCube::default();
        let Some((entry, exit)) = cube.intersect(ray) else { return f32::INFINITY };
        let n = self.resolution;
        let voxel = 2.0 * cube.half_extent() / n as f64;
        let step = 0.5 * voxel / ray.direction.length();
        let is_inside = |depth: f64| {
            let cell = (ray.at(depth) + cube.half_extent()) / voxel;
            let [x, y, z] = cell.as_uvec3().min(glam::UVec3::splat(n as u32 - 1)).to_array().map(|c| c as usize);
            let index = (z * n + y) * n + x;
            self.occupied[index / 64] >> (index % 64) & 1 == 1
        };
        let depths = (0..).map(|i| entry + (f64::from(i) + 0.5) * step).take_while(|depth| *depth < exit);
        depths.into_iter().find(|depth| is_inside(*depth)).map_or(f32::INFINITY, |depth| depth as f32)
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::{Camera, Mask};
    use glam::DVec3;
    use image::{GrayImage, Luma};

    use super::*;

    #[test]
    fn a_ray_enters_the_hull_where_the_masks_say_or_nowhere() {
        // Three pictures of the whole frame's middle: a block of half the frame's width.
        let is_object = |u, v| (16..48).contains(&u) && (16..48).contains(&v);
        let mask = Mask::from(GrayImage::from_fn(64, 64, |u, v| Luma([if is_object(u, v) { 255 } else { 0 }])));
        let camera = |eye: DVec3, up| Camera::look_at(64, 64, 230.0, eye, DVec3::ZERO, up);
        let cameras =
            [camera(DVec3::Z * 5.0, DVec3::Y), camera(DVec3::X * 5.0, DVec3::Y), camera(DVec3::Y * 5.0, DVec3::X)];
        let views: Vec<_> = cameras.iter().map(|camera| (camera, &mask)).collect();
        let hull = VisualHull::carve(&views, UnitCube::default().into(), 64, &HullSettings::default()).unwrap();
        let half = 5.0 * 16.0 / 230.0;
        let hull = CoarseHull::new(&hull);
        let depth = hull.depth(&cameras[0].pixel_ray(32, 32));
        assert!((f64::from(depth) - (5.0 - half)).abs() < 2.5 / 64.0, "{depth}");
        assert!(hull.depth(&cameras[0].pixel_ray(2, 32)).is_infinite());
    }
}
