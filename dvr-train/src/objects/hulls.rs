//! Visual hulls of training objects: what masks, and depth maps where they are given, tell of space.

use std::sync::Arc;

use dvr_core::dataset::ObjectDataset;
use dvr_core::hull::{HullSettings, VisualHull};
use dvr_core::{Camera, Mask, MirrorAxis, Ray, UnitCube, View};
use glam::{DVec3, UVec3, Vec3};
use rand::Rng;

use super::kept::Kept;
use crate::error::Result;

/// The hulls of a dataset's objects, each carved when it is first asked for.
pub(crate) struct Hulls {
    resolution: usize,
    /// Whether depth maps carve too.
    by_depth: bool,
    /// Whether masks are right to the pixel.
    exact: bool,
    kept: Kept<CoarseHull>,
}

impl Hulls {
    /// Hulls of so many voxels along an edge of the cube. With `by_depth`, what lies before the surface of a depth map is none.
    /// With `exact`, masks are right to the pixel but for parts of which nothing would be left; without it to half a pixel.
    pub fn new(resolution: usize, by_depth: bool, exact: bool) -> Self {
        Self { resolution, by_depth, exact, kept: Kept::default() }
    }

    /// The hull of all masks, and depth maps, of an object.
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
        let carve = |margin: f64| -> Result<CoarseHull> {
            let settings = HullSettings { conservative: false, margin, ..HullSettings::default() };
            let hull = VisualHull::carve(&masks, UnitCube::default().into(), self.resolution, &settings)?;
            Ok(CoarseHull::new(self.resolution, |voxel| hull.voxel(voxel)))
        };
        let wide = carve(PIXEL_MARGIN)?;
        let carved = if self.exact { carve(0.0)?.completed(&wide, &masks) } else { wide };
        if !self.by_depth {
            return Ok(carved);
        }
        let is_behind = |voxel: [usize; 3]| {
            let center = carved.center(voxel).as_dvec3();
            // Sheets without thickness hold no voxel's centre: half a voxel before a surface still belongs to it.
            views.iter().all(|view| is_behind_depth(view, center, 0.5 * carved.voxel()))
        };
        Ok(CoarseHull::new(self.resolution, |voxel| carved.holds(voxel) && is_behind(voxel)))
    }
}

/// Pixels by which masks may be wrong: they are known at the centres of their pixels.
const PIXEL_MARGIN: f64 = 0.5;

/// Whether a view's depth map leaves open what is at a point: it lies behind the nearest surface of the four pixels around, or
/// before it by no more than `tolerance`, or these see none.
fn is_behind_depth(view: &View, point: DVec3, tolerance: f64) -> bool {
    let Some(depth) = &view.depth else { return true };
    let (place, z_depth) = view.camera.project(point);
    if !view.camera.sees(place) {
        return true;
    }
    // Pixel centres lie at halves. One depth alone would carve surfaces that are seen at an angle.
    let around = |place: f64, size: u32| {
        let first = (place - 0.5).floor().max(0.0) as u32;
        [first, (first + 1).min(size - 1)]
    };
    let (columns, rows) = (around(place.x, depth.width), around(place.y, depth.height));
    let nearest = rows.into_iter().flat_map(|v| columns.map(|u| depth.get(u, v))).fold(f32::INFINITY, f32::min);
    !nearest.is_finite() || z_depth + tolerance >= f64::from(nearest)
}

/// Voxels by which points lie apart from the hull's border, at most, along each axis. A network that is asked nearer than it can
/// know from one picture learns little but to doubt.
const REACH: usize = 3;

/// Voxels that are looked at, at most, to find one at the hull's border.
const NEAR_TRIES: usize = 1000;

/// A visual hull in a bit a voxel.
pub(crate) struct CoarseHull {
    resolution: usize,
    occupied: Vec<u64>,
    /// Where its border is: the hull and a voxel around it.
    border: VoxelBox,
}

impl CoarseHull {
    fn new(resolution: usize, is_hull: impl Fn([usize; 3]) -> bool) -> Self {
        let n = resolution;
        let mut occupied = vec![0u64; n.pow(3).div_ceil(64)];
        let mut border = VoxelBox { first: [n - 1; 3], last: [0; 3] };
        for index in 0..n.pow(3) {
            let voxel = [index % n, index / n % n, index / (n * n)];
            if is_hull(voxel) {
                occupied[index / 64] |= 1 << (index % 64);
                border.first = [0, 1, 2].map(|axis| border.first[axis].min(voxel[axis].saturating_sub(1)));
                border.last = [0, 1, 2].map(|axis| border.last[axis].max((voxel[axis] + 1).min(n - 1)));
            }
        }
        if border.first[0] > border.last[0] {
            border = VoxelBox { first: [0; 3], last: [0; 3] };
        }
        Self { resolution: n, occupied, border }
    }

    /// With what a wider hull has along rays of object pixels that meet nothing of this one: parts thinner than a pixel, which
    /// some view always misses.
    fn completed(&self, wider: &Self, masks: &[(&Camera, &Mask)]) -> Self {
        let n = self.resolution;
        let mut occupied = self.occupied.clone();
        for (camera, mask) in masks {
            let (width, height) = mask.size();
            // Of large pictures, some pixels for each voxel are enough.
            let stride = (width.max(height) as usize / (2 * n)).max(1);
            let pixels = (0..height).step_by(stride).flat_map(|v| (0..width).step_by(stride).map(move |u| (u, v)));
            for (u, v) in pixels.filter(|(u, v)| mask.is_object(*u, *v)) {
                let ray = camera.pixel_ray(u, v);
                if self.along(&ray).any(|(_, voxel)| self.holds(voxel)) {
                    continue;
                }
                for [x, y, z] in self.along(&ray).map(|(_, voxel)| voxel).filter(|voxel| wider.holds(*voxel)) {
                    let index = (z * n + y) * n + x;
                    occupied[index / 64] |= 1 << (index % 64);
                }
            }
        }
        let completed = Self { occupied, ..*self };
        Self::new(n, |voxel| completed.holds(voxel))
    }

    fn bytes(&self) -> usize {
        8 * self.occupied.len()
    }

    /// Depth at which a ray enters the hull, to half a voxel, in units of its direction; infinite where it passes by.
    pub fn depth(&self, ray: &Ray) -> f32 {
        let hit = self.along(ray).find(|(_, voxel)| self.holds(*voxel));
        hit.map_or(f32::INFINITY, |(depth, _)| depth as f32)
    }

    /// Depths along a ray, half a voxel apart, and the voxel at each; none where it passes by the cube.
    fn along(&self, ray: &Ray) -> impl Iterator<Item = (f64, [usize; 3])> {
        let (entry, exit) = UnitCube::default().intersect(ray).unwrap_or((0.0, 0.0));
        let step = 0.5 * self.voxel() / ray.direction.length();
        let depths = (0..).map(move |i| entry + (f64::from(i) + 0.5) * step).take_while(move |depth| *depth < exit);
        depths.map(|depth| (depth, self.voxel_of(ray.at(depth))))
    }

    /// Centres of voxels, and whether they are hull: `near` of them drawn around where the hull ends, up to [`REACH`] voxels away
    /// along each axis, and `anywhere` in the whole cube.
    pub fn draw_points(&self, near: usize, anywhere: usize, rng: &mut impl Rng) -> Vec<(Vec3, bool)> {
        let at = |voxel: [usize; 3]| (self.center(voxel), self.holds(voxel));
        let mut points = Vec::with_capacity(near + anywhere);
        for _ in 0..near {
            let drawn = (0..NEAR_TRIES).map(|_| self.border.draw(rng)).find(|voxel| self.is_border(*voxel));
            let mut shift = || rng.random_range(0..=2 * REACH);
            let shifted = |place: usize, shift: usize| (place + shift).saturating_sub(REACH).min(self.resolution - 1);
            points.extend(drawn.map(|[x, y, z]| at([shifted(x, shift()), shifted(y, shift()), shifted(z, shift())])));
        }
        let whole = VoxelBox { first: [0; 3], last: [self.resolution - 1; 3] };
        // Where little of the border was found, or none, more of the cube.
        points.extend((points.len()..near + anywhere).map(|_| at(whole.draw(rng))));
        points
    }

    /// Intersection over union with its mirror image; `None` where there is no hull.
    pub fn mirror_iou(&self, axis: MirrorAxis) -> Option<f64> {
        let (mut both, mut either) = (0usize, 0usize);
        let n = self.resolution;
        for index in 0..n.pow(3) {
            let voxel = [index % n, index / n % n, index / (n * n)];
            let mut mirrored = voxel;
            mirrored[axis.index()] = n - 1 - voxel[axis.index()];
            let (here, there) = (self.holds(voxel), self.holds(mirrored));
            both += usize::from(here && there);
            either += usize::from(here || there);
        }
        (either > 0).then(|| both as f64 / either as f64)
    }

    /// The share of it whose mirror image lies within a voxel of it; `None` where there is no hull. Of what is its own mirror image,
    /// that is nearly all, however thin it is.
    pub fn mirrored_share(&self, axis: MirrorAxis) -> Option<f64> {
        let (mut own, mut met) = (0usize, 0usize);
        let n = self.resolution;
        let around = |place: usize| place.saturating_sub(1)..(place + 2).min(n);
        for index in 0..n.pow(3) {
            let voxel = [index % n, index / n % n, index / (n * n)];
            if self.holds(voxel) {
                let mut mirrored = voxel;
                mirrored[axis.index()] = n - 1 - voxel[axis.index()];
                let [x, y, z] = mirrored.map(around);
                let is_met = z.into_iter().any(|z| y.clone().any(|y| x.clone().any(|x| self.holds([x, y, z]))));
                (own, met) = (own + 1, met + usize::from(is_met));
            }
        }
        (own > 0).then(|| met as f64 / own as f64)
    }

    /// Edge of a voxel.
    fn voxel(&self) -> f64 {
        2.0 * UnitCube::default().half_extent() / self.resolution as f64
    }

    fn center(&self, voxel: [usize; 3]) -> Vec3 {
        let corner = DVec3::from_array(voxel.map(|place| place as f64 + 0.5)) * self.voxel();
        (corner - UnitCube::default().half_extent()).as_vec3()
    }

    fn voxel_of(&self, point: DVec3) -> [usize; 3] {
        let cell = (point + UnitCube::default().half_extent()) / self.voxel();
        cell.as_uvec3().min(UVec3::splat(self.resolution as u32 - 1)).to_array().map(|place| place as usize)
    }

    fn holds(&self, [x, y, z]: [usize; 3]) -> bool {
        let index = (z * self.resolution + y) * self.resolution + x;
        self.occupied[index / 64] >> (index % 64) & 1 == 1
    }

    /// Whether a neighbour of a voxel, across faces, edges or corners, is hull and it is not, or the other way around.
    fn is_border(&self, voxel: [usize; 3]) -> bool {
        let around = voxel.map(|place| place.saturating_sub(1)..=(place + 1).min(self.resolution - 1));
        let [xs, ys, zs] = around;
        let here = self.holds(voxel);
        zs.into_iter().any(|z| ys.clone().any(|y| xs.clone().any(|x| self.holds([x, y, z]) != here)))
    }
}

/// Voxels between two corners, both among them.
#[derive(Clone, Copy)]
struct VoxelBox {
    first: [usize; 3],
    last: [usize; 3],
}

impl VoxelBox {
    fn draw(&self, rng: &mut impl Rng) -> [usize; 3] {
        [0, 1, 2].map(|axis| rng.random_range(self.first[axis]..=self.last[axis]))
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::{DepthMap, stored};
    use glam::DVec3;
    use image::{GrayImage, Luma, RgbImage};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

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
        let hull = CoarseHull::new(64, |voxel| hull.voxel(voxel));
        let depth = hull.depth(&cameras[0].pixel_ray(32, 32));
        assert!((f64::from(depth) - (5.0 - half)).abs() < 2.5 / 64.0, "{depth}");
        assert!(hull.depth(&cameras[0].pixel_ray(2, 32)).is_infinite());
    }

    /// A block of voxels, from `first` to `last`.
    fn block(first: [usize; 3], last: [usize; 3]) -> CoarseHull {
        CoarseHull::new(32, |voxel| (0..3).all(|axis| (first[axis]..=last[axis]).contains(&voxel[axis])))
    }

    #[test]
    fn points_lie_in_the_middle_of_voxels_and_as_many_as_asked_where_the_hull_ends() {
        let hull = block([4, 10, 20], [9, 11, 30]);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let points = hull.draw_points(1000, 300, &mut rng);
        assert_eq!(points.len(), 1300);
        let inside = |point: &Vec3| {
            let voxel = hull.voxel_of(point.as_dvec3());
            assert!((hull.center(voxel) - *point).length() < 1e-6);
            (4..=9).contains(&voxel[0]) && (10..=11).contains(&voxel[1]) && (20..=30).contains(&voxel[2])
        };
        assert!(points.iter().all(|(point, is_inside)| inside(point) == *is_inside));
        let near = |(point, _): &(Vec3, bool)| {
            let [x, y, z] = hull.voxel_of(point.as_dvec3());
            // A block of two voxels' height has nothing but its border.
            (0..=13).contains(&x) && (6..=15).contains(&y) && (16..=31).contains(&z)
        };
        assert!(points[..1000].iter().all(near) && points[1000..].iter().filter(|point| near(point)).count() < 30);
        assert!(points[..1000].iter().filter(|(_, inside)| *inside).count() > 50);
        assert!(points[..1000].iter().filter(|(_, inside)| !*inside).count() > 50);
    }

    #[test]
    fn thin_parts_come_from_the_wider_hull_and_nothing_else_does() {
        let rod = |[x, y, z]: [usize; 3]| x == 15 && y == 15 && (22..=30).contains(&z);
        let thick = block([10; 3], [20; 3]);
        let true_shape = CoarseHull::new(32, |voxel| thick.holds(voxel) || rod(voxel));
        let skin = block([9; 3], [21; 3]);
        let wider = CoarseHull::new(32, |voxel| skin.holds(voxel) || rod(voxel));
        let seen = |eye: DVec3, up: DVec3| {
            let camera = Camera::look_at(128, 128, 250.0, eye, DVec3::ZERO, up);
            let mask = GrayImage::from_fn(128, 128, |u, v| {
                Luma([if true_shape.depth(&camera.pixel_ray(u, v)).is_finite() { 255 } else { 0 }])
            });
            (camera, Mask::from(mask))
        };
        let views = [seen(DVec3::X * 3.0, DVec3::Y), seen(DVec3::Y * 3.0, DVec3::X)];
        let masks: Vec<_> = views.iter().map(|(camera, mask)| (camera, mask)).collect();
        let completed = thick.completed(&wider, &masks);
        let all = (0..32usize.pow(3)).map(|i| [i % 32, i / 32 % 32, i / 1024]);
        let added: Vec<_> = all.filter(|voxel| completed.holds(*voxel) && !thick.holds(*voxel)).collect();
        assert!(added.iter().filter(|voxel| rod(**voxel)).count() >= 8, "{added:?}");
        assert!(added.iter().all(|voxel| rod(*voxel) || voxel[2] == 21), "{added:?}");
    }

    #[test]
    fn an_empty_hull_has_points_all_the_same_and_none_is_inside() {
        let hull = CoarseHull::new(8, |_| false);
        let points = hull.draw_points(5, 5, &mut ChaCha8Rng::seed_from_u64(1));
        assert!(points.len() == 10 && points.iter().all(|(_, inside)| !inside));
        assert_eq!(hull.mirror_iou(MirrorAxis::X), None);
    }

    #[test]
    fn what_is_alike_in_a_mirror_is_told_axis_by_axis() {
        // In the middle of x, at the end of y, and half beyond the middle of z.
        let hull = block([10, 0, 12], [21, 3, 23]);
        let found = MirrorAxis::ALL.map(|axis| hull.mirror_iou(axis).unwrap());
        assert_eq!(found, [1.0, 0.0, 8.0 / 16.0]);
        // Nine of twelve layers along z lie within a voxel of the mirror image.
        let found = MirrorAxis::ALL.map(|axis| hull.mirrored_share(axis).unwrap());
        assert_eq!(found, [1.0, 0.0, 9.0 / 12.0]);
    }

    #[test]
    fn depth_maps_take_away_what_lies_before_them() {
        let mask = Mask::from(GrayImage::from_pixel(64, 64, Luma([255])));
        let camera = Camera::look_at(64, 64, 100.0, DVec3::Z * 3.0, DVec3::ZERO, DVec3::Y);
        // A wall at z = 0.1, which the left half of the picture sees; the right half sees nothing.
        let z_depth = (0..64 * 64).map(|i| if i % 64 < 32 { 2.9 } else { f32::INFINITY }).collect();
        let mut view = View::new("left", camera.clone(), stored(RgbImage::new(64, 64)), mask);
        view.depth = Some(DepthMap { width: 64, height: 64, z_depth });
        for (point, expected) in [
            (DVec3::new(-0.2, 0.0, 0.3), camera.project(DVec3::new(-0.2, 0.0, 0.3)).0.x > 33.0),
            (DVec3::new(0.2, 0.0, 0.3), camera.project(DVec3::new(0.2, 0.0, 0.3)).0.x > 33.0),
            (DVec3::new(-0.2, 0.0, 0.0), true),
            // Before the wall by less than the tolerance.
            (DVec3::new(-0.2, 0.0, 0.12), true),
            (DVec3::new(0.2, 0.0, 0.0), true),
            // Beyond the frame.
            (DVec3::new(-3.0, 0.0, 0.3), true),
        ] {
            assert_eq!(is_behind_depth(&view, point, 0.05), expected, "{point}");
        }
    }
}
