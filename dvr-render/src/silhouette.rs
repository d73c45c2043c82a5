//! A field made to fit the silhouette that one picture shows, and how well one fits it.

use dvr_core::{Bilinear, Camera, Mask, UnitCube};
use glam::{Vec2, Vec3};

use crate::field::scalar::ScalarField;

/// Samples of a ray in the cube.
const SAMPLES: usize = 128;

/// The same where silhouettes are only compared, and the most pixels along an edge that are looked at.
const OVERLAP_SAMPLES: usize = 48;
const OVERLAP_SIDE: u32 = 32;

/// Coverage, of 255, from which a pixel shows the object: a pixel that a thin part crosses is not full of it.
const SHOWN: u8 = 90;

/// How far below the surface's logit a ray ends up that meets nothing.
const CLEARANCE: f32 = 0.05;

/// Depth below which a point is no longer in front of the camera.
const NEAREST: f32 = 1e-3;

/// What is added to a field's logits along the ray of each pixel of a picture, so that the field has the picture's silhouette:
/// between the pixels, bilinear. A ray of the object that meets nothing is raised until as much of it is inside as a pixel is wide,
/// where the field is likeliest to be; one of the background that meets something is lowered until it does not. All others stay as
/// they are.
#[derive(Clone, Debug)]
pub struct SilhouetteFit {
    camera: Camera,
    /// By pixel, rows one after the other.
    shift: Vec<f32>,
    /// Points that were raised.
    raised: Vec<Vec3>,
}

/// The ray of a pixel that is either full of the object or without it.
struct PixelRay {
    /// Place of the pixel.
    index: usize,
    shown: bool,
    /// Where it is looked at, from the camera on.
    points: Vec<Vec3>,
    /// Width of a pixel, in distances of these points, at the distance one from the camera.
    pixel: f64,
}

impl SilhouetteFit {
    /// Of a field, to the silhouette that a camera sees; a pixel that is neither full of the object nor without it stays as it is.
    /// `None` where mask and camera are not of one size.
    pub fn new(field: &(impl ScalarField + ?Sized), camera: &Camera, mask: &Mask) -> Option<Self> {
        let (width, height) = mask.size();
        if (width, height) != (camera.width, camera.height) {
            return None;
        }
        let mut fit =
            Self { camera: camera.clone(), shift: vec![0.0; width as usize * height as usize], raised: Vec::new() };
        // Row by row, which is enough for all cores and little memory.
        for v in 0..height {
            let rays: Vec<PixelRay> = (0..width).filter_map(|u| PixelRay::new(camera, mask, u, v, SAMPLES)).collect();
            let points: Vec<Vec3> = rays.iter().flat_map(|ray| &ray.points).copied().collect();
            for (ray, logits) in rays.iter().zip(field.logits(&points).chunks(SAMPLES)) {
                fit.fit(ray, logits);
            }
        }
        Some(fit)
    }

    /// Fits the ray of a pixel, given the field's logits at its points.
    fn fit(&mut self, ray: &PixelRay, logits: &[f32]) {
        let mut order: Vec<usize> = (0..logits.len()).filter(|i| logits[*i].is_finite()).collect();
        order.sort_by(|a, b| logits[*b].total_cmp(&logits[*a]));
        let Some(&likeliest) = order.first() else { return };
        let largest = logits[likeliest];
        if !ray.shown {
            self.shift[ray.index] = if largest > 0.0 { -largest - CLEARANCE } else { 0.0 };
        } else if largest <= 0.0 {
            let at = ray.points[likeliest];
            let inside = (ray.pixel * self.camera.project(at.as_dvec3()).1).ceil().max(1.0) as usize;
            self.shift[ray.index] = -logits[order[inside.min(order.len()) - 1]];
            self.raised.push(at);
        }
    }

    /// Points near the surface of what was raised, which may be too thin to be found.
    pub fn raised(&self) -> &[Vec3] {
        &self.raised
    }

    /// What is added at a point, and how that changes along the axes of space.
    fn at(&self, point: Vec3) -> (f32, Vec3) {
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let seen = self.camera.rotation.as_mat3() * point + self.camera.translation.as_vec3();
        if seen.z <= NEAREST {
            return (0.0, Vec3::ZERO);
        }
        let intrinsics = self.camera.intrinsics.as_mat3();
        let projected = intrinsics * seen;
        let pixel = Vec2::new(projected.x, projected.y) / projected.z;
        // Beyond the outermost centres, the value there.
        let place = pixel - 0.5;
        let last = Vec2::new((width - 1) as f32, (height - 1) as f32);
        let within = place.clamp(Vec2::ZERO, last);
        let (u, v) = (within.x as u32, within.y as u32);
        let next = |at: u32, count: usize| (at + 1).min(count as u32 - 1);
        let between = Bilinear {
            pixels: [(u, v), (next(u, width), v), (u, next(v, height)), (next(u, width), next(v, height))],
            fraction: within.fract().to_array(),
        };
        let shifts = between.pixels.map(|(u, v)| self.shift[v as usize * width + u as usize]);
        let value = between.value(shifts);
        let [by_column, by_row] = between.derivatives(shifts);
        let by_column = if place.x == within.x { by_column } else { 0.0 };
        let by_row = if place.y == within.y { by_row } else { 0.0 };
        // d pixel / d seen, of intrinsics without projective part.
        let rows = intrinsics * self.camera.rotation.as_mat3();
        let along = |axis: usize| {
            let moved = rows.col(axis);
            let of_pixel = (Vec2::new(moved.x, moved.y) - pixel * moved.z) / projected.z;
            by_column * of_pixel.x + by_row * of_pixel.y
        };
        (value, Vec3::new(along(0), along(1), along(2)))
    }
}

impl PixelRay {
    /// `None` where the pixel is neither, or its ray misses the cube.
    fn new(camera: &Camera, mask: &Mask, u: u32, v: u32, samples: usize) -> Option<Self> {
        let coverage = mask.coverage.get_pixel(u, v).0[0];
        let shown = coverage >= SHOWN;
        let ray = camera.pixel_ray(u, v);
        let (entry, exit) = UnitCube::default().intersect(&ray).filter(|_| shown || coverage == 0)?;
        let step = (exit - entry) / samples as f64;
        Some(Self {
            index: v as usize * camera.width as usize + u as usize,
            shown,
            points: (0..samples).map(|i| ray.at(entry + (i as f64 + 0.5) * step).as_vec3()).collect(),
            pixel: 1.0 / (camera.intrinsics.x_axis.x.abs() * step * ray.direction.length()).max(1e-9),
        })
    }
}

/// How well a field has the silhouette that a camera sees: intersection over union, of some of the pixels that are either full of the
/// object or without it. `None` where mask and camera are not of one size, or nothing is to be seen of either.
pub fn silhouette_overlap(field: &(impl ScalarField + ?Sized), camera: &Camera, mask: &Mask) -> Option<f64> {
    let (width, height) = mask.size();
    if (width, height) != (camera.width, camera.height) {
        return None;
    }
    let stride = width.max(height).div_ceil(OVERLAP_SIDE).max(1) as usize;
    let (mut both, mut either) = (0usize, 0usize);
    for v in (0..height).step_by(stride) {
        let rays = (0..width).step_by(stride).filter_map(|u| PixelRay::new(camera, mask, u, v, OVERLAP_SAMPLES));
        let rays: Vec<PixelRay> = rays.collect();
        let points: Vec<Vec3> = rays.iter().flat_map(|ray| &ray.points).copied().collect();
        for (ray, logits) in rays.iter().zip(field.logits(&points).chunks(OVERLAP_SAMPLES)) {
            let is_met = logits.iter().any(|logit| *logit > 0.0);
            both += usize::from(ray.shown && is_met);
            either += usize::from(ray.shown || is_met);
        }
    }
    (either > 0).then(|| both as f64 / either as f64)
}

/// A field with the silhouette of a picture.
pub struct FittedField<'a, F: ?Sized> {
    /// As it was.
    pub field: &'a F,
    /// What is added to it.
    pub fit: &'a SilhouetteFit,
}

impl<F: ScalarField + ?Sized> ScalarField for FittedField<'_, F> {
    fn logits(&self, points: &[Vec3]) -> Vec<f32> {
        let mut logits = self.field.logits(points);
        logits.iter_mut().zip(points).for_each(|(logit, point)| *logit += self.fit.at(*point).0);
        logits
    }

    fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
        let mut gradients = self.field.gradients(points)?;
        gradients.iter_mut().zip(points).for_each(|(gradient, point)| *gradient += self.fit.at(*point).1);
        Some(gradients)
    }

    fn colors(&self, points: &[Vec3], normals: &[Vec3], directions: Option<&[Vec3]>) -> Option<Vec<[f32; 3]>> {
        self.field.colors(points, normals, directions)
    }

    fn cells(&self) -> Option<usize> {
        self.field.cells()
    }
}

#[cfg(test)]
mod tests {
    use dvr_test_support::largest;
    use glam::{DVec2, DVec3};
    use image::{GrayImage, Luma};

    use super::*;

    const SIZE: u32 = 48;

    fn camera() -> Camera {
        Camera::look_at(SIZE, SIZE, 60.0, DVec3::new(0.4, 0.3, -1.8), DVec3::ZERO, DVec3::Y)
    }

    /// A ball; a post that is nowhere more likely inside than not; and mist that is not there.
    fn field(points: &[Vec3]) -> Vec<f32> {
        let of = |p: &Vec3| {
            let ball = 8.0 * (0.2 - p.distance(Vec3::new(0.0, 0.2, 0.0)));
            let post = -0.3 - 8.0 * Vec2::new(p.x, p.z).length();
            let ghost = 6.0 * (0.1 - p.distance(Vec3::new(0.35, 0.3, 0.0)));
            ball.max(post).max(ghost).max(-2.0)
        };
        points.iter().map(of).collect()
    }

    /// What the object is: the ball on a thin post.
    fn is_object(point: Vec3) -> bool {
        point.distance(Vec3::new(0.0, 0.2, 0.0)) < 0.2
            || Vec2::new(point.x, point.z).length() < 0.02 && point.y < 0.2 && point.y > -0.4
    }

    fn hits(ray: &dvr_core::Ray, inside: impl Fn(Vec3) -> bool) -> bool {
        (0..800).any(|i| inside(ray.at(1.0 + f64::from(i) * 0.002).as_vec3()))
    }

    fn mask() -> Mask {
        let camera = camera();
        let coverage = |u: u32, v: u32| {
            let part = |i: u32| {
                let pixel = DVec2::new(
                    f64::from(u) + (f64::from(i % 4) + 0.5) / 4.0,
                    f64::from(v) + (f64::from(i / 4) + 0.5) / 4.0,
                );
                hits(&camera.ray(pixel), is_object)
            };
            ((0..16).filter(|i| part(*i)).count() * 255 / 16) as u8
        };
        Mask::from(GrayImage::from_fn(SIZE, SIZE, |u, v| Luma([coverage(u, v)])))
    }

    #[test]
    fn the_field_has_the_silhouette_of_the_picture() {
        let (mask, camera) = (mask(), camera());
        let fit = SilhouetteFit::new(&field, &camera, &mask).unwrap();
        let fitted = FittedField { field: &field, fit: &fit };
        assert!(!fit.raised().is_empty());
        let (mut posts, mut ghosts) = (0, 0);
        for (u, v) in (0..SIZE * SIZE).map(|i| (i % SIZE, i / SIZE)) {
            let (ray, coverage) = (camera.pixel_ray(u, v), mask.coverage.get_pixel(u, v).0[0]);
            let before = hits(&ray, |point| field(&[point])[0] > 0.0);
            let after = hits(&ray, |point| fitted.logits(&[point])[0] >= -1e-4);
            match coverage {
                0 => {
                    assert!(!after, "({u}, {v}) shows nothing");
                    ghosts += usize::from(before);
                }
                SHOWN.. => {
                    assert!(after, "({u}, {v}) shows the object");
                    posts += usize::from(!before);
                }
                _ => {}
            }
        }
        assert!(posts > 5 && ghosts > 5, "{posts} {ghosts}");
        // The post, below the ball, is where it is likeliest, not all along the rays.
        let post = || fit.raised().iter().filter(|point| point.y < -0.05);
        let off = largest(post().map(|point| Vec2::new(point.x, point.z).length()));
        assert!(post().count() > 5 && off < 0.04, "{off}");
    }

    #[test]
    fn slopes_are_those_of_differences() {
        let fit = SilhouetteFit::new(&field, &camera(), &mask()).unwrap();
        let step = 1e-3;
        let mut compared = 0;
        for i in 0..400 {
            let at = |k: f32| 0.5 * (k * i as f32).sin();
            let point = Vec3::new(at(1.7), at(2.3), at(3.1));
            let slopes = fit.at(point).1;
            for axis in Vec3::AXES {
                let [before, here, after] = [-step, 0.0, step].map(|step| fit.at(point + step * axis).0);
                let (left, right) = ((here - before) / step, (after - here) / step);
                // Not where a pixel ends.
                if (left - right).abs() < 0.05 * left.abs().max(0.1) {
                    assert!((slopes.dot(axis) - left).abs() < 0.05 * left.abs().max(1.0), "{point}: {slopes} {left}");
                    compared += usize::from(left != 0.0);
                }
            }
        }
        assert!(compared > 50, "{compared}");
    }

    #[test]
    fn what_has_more_of_the_silhouette_overlaps_more() {
        let (camera, mask) = (camera(), mask());
        let overlap = |field: &dyn Fn(&[Vec3]) -> Vec<f32>| silhouette_overlap(&field, &camera, &mask).unwrap();
        let of = |points: &[Vec3]| -> Vec<f32> {
            points.iter().map(|point| if is_object(*point) { 1.0 } else { -1.0 }).collect()
        };
        let moved = |points: &[Vec3]| of(&points.iter().map(|point| *point + 0.2 * Vec3::X).collect::<Vec<_>>());
        let (whole, part, aside) = (overlap(&of), overlap(&field), overlap(&moved));
        // The post is thinner than samples are apart: it is met here and there.
        assert!(whole > 0.9 && part < whole && aside < 0.6, "{whole} {part} {aside}");
        assert_eq!(overlap(&|points| vec![-1.0; points.len()]), 0.0);
    }

    #[test]
    fn a_mask_of_another_size_fits_nothing() {
        let other = Mask::from(GrayImage::new(SIZE + 1, SIZE));
        assert!(SilhouetteFit::new(&field, &camera(), &other).is_none());
        assert!(silhouette_overlap(&field, &camera(), &other).is_none());
    }
}
