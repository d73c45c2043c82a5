//! Smaller pictures by an integer factor: the box filter.

use std::ops::Deref;

use image::{GrayImage, ImageBuffer, Luma, Rgb, RgbImage};

use crate::camera::Camera;
use crate::pixels::stored;
use crate::raster::{DepthMap, Mask};
use crate::scene::{MaskSource, View};

impl View {
    /// The view with each `factor` x `factor` block of pixels as one: mean colours (of what is not transparent) and
    /// coverage, the depth nearest to the middle, the camera exactly; a rest at the right and lower edge is cut off.
    /// A factor of 0 counts as 1; pictures of fewer pixels become empty.
    pub fn downscaled(&self, factor: u32) -> Self {
        let factor = factor.max(1);
        let alpha = self.mask.as_ref().filter(|_| self.mask_source == MaskSource::Alpha);
        let smaller = |mask: &Option<Mask>| mask.as_ref().map(|mask| downscale_mask(mask, factor));
        Self {
            name: self.name.clone(),
            camera: downscale_camera(&self.camera, factor),
            image: stored(downscale_image(&self.image, alpha, factor)),
            mask: smaller(&self.mask),
            refined_mask: smaller(&self.refined_mask),
            mask_source: self.mask_source,
            depth: self.depth.as_ref().map(|depth| downscale_depth(depth, factor)),
            split: self.split,
            exposure: self.exposure,
        }
    }
}

/// The mean of each `factor` x `factor` block of sRGB values, each pixel weighing as much as its `weight`: what is
/// transparent has no colour. A block without any weight gets its plain mean.
pub(crate) fn downscale_image(
    image: &ImageBuffer<Rgb<u8>, impl Deref<Target = [u8]>>,
    weight: Option<&Mask>,
    factor: u32,
) -> RgbImage {
    RgbImage::from_fn(image.width() / factor, image.height() / factor, |u, v| {
        let mean = |weight_of: &dyn Fn(u32, u32) -> u64| {
            let (mut sum, mut total) = ([0u64; 3], 0);
            for (x, y) in block(u, v, factor) {
                let weight = weight_of(x, y);
                total += weight;
                for (sum, &value) in sum.iter_mut().zip(&image.get_pixel(x, y).0) {
                    *sum += weight * u64::from(value);
                }
            }
            (total > 0).then(|| Rgb(sum.map(|sum| ((sum + total / 2) / total) as u8)))
        };
        let weighted = weight.and_then(|mask| mean(&|x, y| u64::from(mask.coverage.get_pixel(x, y).0[0])));
        weighted.or_else(|| mean(&|_, _| 1)).unwrap_or(Rgb([0; 3]))
    })
}

/// The mean coverage of each block.
pub(crate) fn downscale_mask(mask: &Mask, factor: u32) -> Mask {
    let (width, height) = mask.size();
    let area = u64::from(factor) * u64::from(factor);
    let coverage = GrayImage::from_fn(width / factor, height / factor, |u, v| {
        let sum: u64 = block(u, v, factor).map(|(x, y)| u64::from(mask.coverage.get_pixel(x, y).0[0])).sum();
        Luma([((sum + area / 2) / area) as u8])
    });
    Mask::from(coverage)
}

/// The depth nearest to the middle of each block among those that are finite. Never a mean: between the object and
/// what is behind it there is nothing.
pub(crate) fn downscale_depth(depth: &DepthMap, factor: u32) -> DepthMap {
    let (width, height) = (depth.width / factor, depth.height / factor);
    // Twice the distance to the middle of the block, so that it is an integer.
    let off_middle = |x: u32| i64::from(2 * (x % factor) + 1) - i64::from(factor);
    let z_depth = (0..height)
        .flat_map(|v| (0..width).map(move |u| (u, v)))
        .map(|(u, v)| {
            block(u, v, factor)
                .map(|(x, y)| (off_middle(x).pow(2) + off_middle(y).pow(2), depth.get(x, y)))
                .filter(|(_, z)| z.is_finite())
                .min_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)))
                .map_or(f32::INFINITY, |(_, z)| z)
        })
        .collect();
    DepthMap { width, height, z_depth }
}

/// The camera of the smaller picture, exactly: a rest at the right and lower edge is cut off first.
pub(crate) fn downscale_camera(camera: &Camera, factor: u32) -> Camera {
    let (width, height) = (camera.width / factor, camera.height / factor);
    let cropped = Camera { width: width * factor, height: height * factor, ..camera.clone() };
    cropped.resized(width, height)
}

fn block(u: u32, v: u32, factor: u32) -> impl Iterator<Item = (u32, u32)> {
    (v * factor..(v + 1) * factor).flat_map(move |y| (u * factor..(u + 1) * factor).map(move |x| (x, y)))
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3};

    use super::*;

    #[test]
    fn colours_and_masks_are_averaged() {
        let image = RgbImage::from_fn(5, 4, |u, v| Rgb([(u * 40) as u8, (v * 10) as u8, 100]));
        let small = downscale_image(&image, None, 2);
        assert_eq!((small.dimensions(), small.get_pixel(1, 1)), ((2, 2), &Rgb([100, 25, 100])));
        let mask = Mask::from(GrayImage::from_fn(4, 4, |u, _| Luma([if u < 3 { 255 } else { 0 }])));
        let small = downscale_mask(&mask, 2).coverage;
        assert_eq!((small.get_pixel(0, 0).0[0], small.get_pixel(1, 0).0[0]), (255, 128));
    }

    #[test]
    fn what_is_transparent_has_no_colour() {
        let image = RgbImage::from_fn(2, 2, |u, _| Rgb(if u == 0 { [200; 3] } else { [0; 3] }));
        let alpha = Mask::from(GrayImage::from_fn(2, 2, |u, _| Luma([if u == 0 { 255 } else { 0 }])));
        assert_eq!(downscale_image(&image, Some(&alpha), 2).get_pixel(0, 0), &Rgb([200; 3]));
        let nothing = Mask::from(GrayImage::new(2, 2));
        assert_eq!(downscale_image(&image, Some(&nothing), 2).get_pixel(0, 0), &Rgb([100; 3]));
    }

    #[test]
    fn a_view_becomes_smaller_with_all_that_belongs_to_it() {
        let camera = Camera::look_at(5, 4, 6.0, DVec3::Z, DVec3::ZERO, DVec3::Y);
        let image = RgbImage::from_fn(5, 4, |u, _| Rgb(if u % 2 == 0 { [200; 3] } else { [0; 3] }));
        let alpha = Mask::from(GrayImage::from_fn(5, 4, |u, _| Luma([if u % 2 == 0 { 255 } else { 0 }])));
        let depth = DepthMap { width: 5, height: 4, z_depth: vec![1.5; 20] };
        let view = View { depth: Some(depth), ..View::new("a", camera, stored(image), alpha) };
        let small = view.downscaled(2);
        assert_eq!((small.camera.width, small.camera.height, small.image.dimensions()), (2, 2, (2, 2)));
        assert_eq!((small.image.get_pixel(0, 0).0, small.mask.as_ref().unwrap().size()), ([100; 3], (2, 2)));
        assert_eq!(small.depth.unwrap().z_depth, [1.5; 4]);
        let transparent = View { mask_source: MaskSource::Alpha, ..view };
        assert_eq!(transparent.downscaled(2).image.get_pixel(0, 0).0, [200; 3], "what is transparent has no colour");
        assert_eq!(transparent.downscaled(1).image, transparent.image);
    }

    #[test]
    fn depth_is_never_a_mean_and_background_only_where_all_is() {
        let far = f32::INFINITY;
        let z_depth = vec![far, 2.0, far, far, 3.0, 2.0, far, far];
        let small = downscale_depth(&DepthMap { width: 4, height: 2, z_depth }, 2);
        assert_eq!(small.z_depth, [2.0, far]);
        let mut z_depth = vec![5.0; 9];
        z_depth[4] = 1.0;
        assert_eq!(downscale_depth(&DepthMap { width: 3, height: 3, z_depth }, 3).z_depth, [1.0]);
    }

    #[test]
    fn the_camera_of_the_smaller_picture_sees_the_same_pixels() {
        let camera = Camera::look_at(101, 67, 90.0, DVec3::new(0.3, 0.8, -2.0), DVec3::ZERO, DVec3::Y);
        let small = downscale_camera(&camera, 4);
        assert_eq!((small.width, small.height), (25, 16));
        let point = DVec3::new(0.1, -0.2, 0.15);
        assert!((small.project(point).0 - camera.project(point).0 / 4.0).length() < 1e-12);
        assert!((small.ray(DVec2::new(0.0, 0.0)).direction - camera.ray(DVec2::ZERO).direction).length() < 1e-12);
    }
}
