//! How far a point is inside or outside the visual hull, without a grid.

use glam::{Mat3, Vec3};

use crate::camera::Camera;
use crate::distance_transform::signed_distance;
use crate::raster::Mask;

/// Masks are resampled so that their longer side has about as many cells: small ones gain the outline that their
/// antialiased pixels show, large ones cost no more than they are worth.
const CELLS: u32 = 512;

/// A mask as a signed distance, seen through its camera.
///
/// The distance of a point is that of its projection to the outline, times the size of a pixel at its depth. It is no
/// larger than the distance to the cone of the outline, and about equal close to it.
#[derive(Clone, Debug)]
pub struct MaskDistance {
    /// `K R` and `K t`, in cells of `distances`.
    projection: Mat3,
    offset: Vec3,
    /// Cells to object units, times depth.
    scale: f32,
    size: [usize; 2],
    distances: Vec<f32>,
    cells_per_pixel: f32,
}

impl MaskDistance {
    /// Measures a mask. Camera and points share one space, of any units.
    pub fn new(camera: &Camera, mask: &Mask) -> Self {
        let (width, height) = mask.size();
        let longer = width.max(height).max(1);
        let factor = if longer > CELLS {
            1.0 / f64::from(longer.div_ceil(CELLS))
        } else {
            f64::from((CELLS / longer).clamp(1, 4))
        };
        let cells = |pixels: u32| ((f64::from(pixels) * factor).round() as usize).max(1);
        let size = [cells(width), cells(height)];
        let inside: Vec<bool> = (0..size[0] * size[1])
            .map(|i| {
                let at = |cell: usize, cells: usize, pixels: u32| {
                    (cell as f64 + 0.5) * f64::from(pixels) / cells as f64 - 0.5
                };
                coverage(mask, at(i % size[0], size[0], width), at(i / size[0], size[1], height)) >= 0.5
            })
            .collect();
        let camera = camera.resized(size[0] as u32, size[1] as u32);
        let focal = 0.5 * (camera.intrinsics.x_axis.x.abs() + camera.intrinsics.y_axis.y.abs());
        Self {
            projection: (camera.intrinsics * camera.rotation).as_mat3(),
            offset: (camera.intrinsics * camera.translation).as_vec3(),
            scale: focal.recip() as f32,
            size,
            distances: signed_distance(&inside, size[0]),
            cells_per_pixel: factor as f32,
        }
    }

    /// Signed distance of a point to the cone of the outline, positive inside; `None` where the view knows nothing: out
    /// of the frame, or behind the camera.
    pub fn at(&self, point: Vec3) -> Option<f32> {
        let q = self.projection * point + self.offset;
        if q.z <= 0.0 {
            return None;
        }
        let [width, height] = self.size;
        let (u, v) = (q.x / q.z, q.y / q.z);
        if !(u >= 0.0 && v >= 0.0 && u < width as f32 && v < height as f32) {
            return None;
        }
        Some(self.sample(u - 0.5, v - 0.5) * self.scale * q.z)
    }

    /// `K R` and `K t`: from a point to cells times its depth, and its depth.
    pub fn projection(&self) -> (Mat3, Vec3) {
        (self.projection, self.offset)
    }

    /// Cells to object units, times depth.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// Columns and rows of cells, and their signed distances to the outline in cells, row by row, positive inside.
    pub fn cells(&self) -> ([usize; 2], &[f32]) {
        (self.size, &self.distances)
    }

    /// Signed distance of a pixel's centre to the outline, in pixels.
    pub fn of_pixel(&self, u: u32, v: u32) -> f32 {
        let k = self.cells_per_pixel;
        self.sample((u as f32 + 0.5) * k - 0.5, (v as f32 + 0.5) * k - 0.5) / k
    }

    /// Bilinear between cell centres, constant beyond the outermost.
    fn sample(&self, x: f32, y: f32) -> f32 {
        let [width, height] = self.size;
        let (x, y) = (x.clamp(0.0, (width - 1) as f32), y.clamp(0.0, (height - 1) as f32));
        let (left, top) = (x as usize, y as usize);
        let (right, below) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        let (s, t) = (x - left as f32, y - top as f32);
        let at = |x: usize, y: usize| self.distances[y * width + x];
        let lerp = |a: f32, b: f32, t: f32| if a == b { a } else { a + (b - a) * t };
        lerp(lerp(at(left, top), at(right, top), s), lerp(at(left, below), at(right, below), s), t)
    }
}

/// The mask's coverage in `[0, 1]`, bilinear between pixel centres; background beyond the frame's last centres is not
/// assumed: the border is repeated.
fn coverage(mask: &Mask, x: f64, y: f64) -> f64 {
    let (width, height) = mask.size();
    let (x, y) = (x.clamp(0.0, f64::from(width - 1)), y.clamp(0.0, f64::from(height - 1)));
    let (left, top) = (x as u32, y as u32);
    let (s, t) = (x - f64::from(left), y - f64::from(top));
    let at = |u: u32, v: u32| f64::from(mask.coverage.get_pixel(u.min(width - 1), v.min(height - 1)).0[0]) / 255.0;
    let lerp = |a: f64, b: f64, t: f64| a + (b - a) * t;
    lerp(lerp(at(left, top), at(left + 1, top), s), lerp(at(left, top + 1), at(left + 1, top + 1), s), t)
}

/// Signed distance of a point to the visual hull of some masks, positive inside, at most `reach` in size; points that
/// no view knows of are outside. The `disagreeing` most pessimistic views are not believed.
pub fn hull_distance(masks: &[MaskDistance], point: Vec3, reach: f32, disagreeing: usize) -> f32 {
    hull_distances(masks, &[point], reach, disagreeing)[0]
}

/// The same of many points, in their order: those that lie close together read the same places of a mask.
pub fn hull_distances(masks: &[MaskDistance], points: &[Vec3], reach: f32, disagreeing: usize) -> Vec<f32> {
    let rank = disagreeing.min(MAX_DISAGREEING);
    let mut distances = vec![-reach; points.len()];
    for (points, distances) in points.chunks(TOGETHER).zip(distances.chunks_mut(TOGETHER)) {
        // The least distances of each point, rising; which points may still be inside, and how many views know each.
        let mut least = [[f32::INFINITY; MAX_DISAGREEING + 1]; TOGETHER];
        let mut known = [0; TOGETHER];
        let mut left: Vec<usize> = (0..points.len()).collect();
        for mask in masks {
            left.retain(|&i| {
                let Some(mut value) = mask.at(points[i]) else { return true };
                known[i] += 1;
                for slot in &mut least[i][..=rank] {
                    if value < *slot {
                        std::mem::swap(slot, &mut value);
                    }
                }
                least[i][rank] > -reach
            });
        }
        for i in left.into_iter().filter(|&i| known[i] > rank) {
            distances[i] = least[i][rank].clamp(-reach, reach);
        }
    }
    distances
}

/// The most views that [`hull_distance`] disbelieves.
pub const MAX_DISAGREEING: usize = 15;

/// Points whose distances to one mask are found together.
const TOGETHER: usize = 64;

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use image::GrayImage;

    use super::*;

    /// A view of a ball of radius `radius` around the origin, antialiased.
    fn ball(eye: DVec3, pixels: u32, radius: f64) -> (Camera, Mask) {
        let camera =
            Camera::look_at(pixels, pixels, 1.2 * f64::from(pixels), eye, DVec3::ZERO, DVec3::new(0.1, 1.0, 0.3));
        let coverage = GrayImage::from_fn(pixels, pixels, |u, v| {
            let hits = (0..16)
                .filter(|i| {
                    let offset = glam::DVec2::new(f64::from(i % 4) + 0.5, f64::from(i / 4) + 0.5) / 4.0;
                    let ray = camera.ray(glam::DVec2::new(f64::from(u), f64::from(v)) + offset);
                    ray.at(-ray.origin.dot(ray.direction) / ray.direction.length_squared()).length() < radius
                })
                .count();
            image::Luma([(hits * 255 / 16) as u8])
        });
        (camera, Mask::from(coverage))
    }

    fn views(pixels: u32) -> Vec<MaskDistance> {
        let axes = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(1.0, 1.0, 1.0), DVec3::new(-1.0, 1.0, 1.0)];
        let eyes = axes.iter().flat_map(|a| [a.normalize() * 2.0, a.normalize() * -2.0]);
        eyes.map(|eye| ball(eye, pixels, 0.3)).map(|(camera, mask)| MaskDistance::new(&camera, &mask)).collect()
    }

    #[test]
    fn the_hull_of_a_ball_is_found_below_a_pixel() {
        let masks = views(64);
        // On the cone's rim seen from +x, whose radius at the origin's plane is slightly over that of the ball.
        for direction in [Vec3::Y, Vec3::Z, Vec3::new(0.0, 0.8, 0.6)] {
            let distance = |r: f32| hull_distance(&masks, direction * r, 0.1, 0);
            let pixel = 2.0 / (1.2 * 64.0);
            assert!((distance(0.3)).abs() < 0.3 * pixel, "{}", distance(0.3));
            assert!((distance(0.26) - 0.04).abs() < 0.4 * pixel, "{}", distance(0.26));
            assert!((distance(0.34) + 0.04).abs() < 0.4 * pixel, "{}", distance(0.34));
        }
        assert_eq!(hull_distance(&masks, Vec3::ZERO, 0.1, 0), 0.1);
    }

    #[test]
    fn views_that_do_not_see_a_point_say_nothing() {
        let (camera, mask) = ball(DVec3::Z * 2.0, 64, 0.3);
        let mask = MaskDistance::new(&camera, &mask);
        assert!(mask.at(Vec3::new(3.0, 0.0, 0.0)).is_none(), "out of the frame");
        assert!(mask.at(Vec3::Z * 5.0).is_none(), "behind");
        assert_eq!(hull_distance(&[mask], Vec3::Z * 5.0, 0.1, 0), -0.1, "known to nobody");
    }

    #[test]
    fn wrong_masks_are_outvoted() {
        let mut masks = views(64);
        let (camera, mut mask) = ball(DVec3::new(0.3, 0.2, 2.0), 64, 0.3);
        mask.coverage.fill(0);
        masks.push(MaskDistance::new(&camera, &mask));
        assert_eq!(hull_distance(&masks, Vec3::ZERO, 0.1, 0), -0.1);
        assert!(hull_distance(&masks, Vec3::ZERO, 0.1, 1) > 0.05);
    }

    #[test]
    fn many_points_have_the_distances_that_each_has_by_the_definition() {
        let masks = views(48);
        // On rows through the ball and beyond all frames, more than are worked on together.
        let point = |i: usize| Vec3::new(0.05 * (i % 30) as f32 - 0.75, 0.07 * (i / 30) as f32 - 0.5, 0.1);
        let points: Vec<Vec3> = (0..450).map(point).collect();
        for disagreeing in [0, 2, 40] {
            let by_definition = |point: &Vec3| {
                let mut all: Vec<f32> = masks.iter().filter_map(|mask| mask.at(*point)).collect();
                all.sort_by(f32::total_cmp);
                all.get(disagreeing.min(MAX_DISAGREEING)).map_or(-0.1, |found| found.clamp(-0.1, 0.1))
            };
            let expected: Vec<f32> = points.iter().map(by_definition).collect();
            assert_eq!(hull_distances(&masks, &points, 0.1, disagreeing), expected);
            let inside = expected.iter().filter(|&&distance| distance > 0.0).count();
            assert_eq!(inside > 10, disagreeing < 15, "{inside} inside");
        }
    }

    #[test]
    fn pixels_have_distances_in_pixels() {
        let (camera, mask) = ball(DVec3::Z * 2.0, 100, 0.3);
        let mask = MaskDistance::new(&camera, &mask);
        // The rim: 1.2 * 100 * 0.3 / sqrt(4 - 0.09) pixels from the middle.
        let radius = 120.0 * 0.3 / (4.0f32 - 0.09).sqrt();
        assert!((mask.of_pixel(50, 50) - radius).abs() < 1.0);
        assert!((mask.of_pixel(99, 50) - (radius - 49.5)).abs() < 0.3);
    }
}
