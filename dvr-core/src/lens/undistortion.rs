//! A photograph resampled to what a pinhole would have taken.

use glam::{DMat3, DVec2, DVec3};
use image::{GrayImage, Luma, Rgb, RgbImage};

use super::Lens;
use crate::camera::Camera;
use crate::error::LensError;
use crate::raster::Mask;

/// A pinhole's picture reaches at most this far from the principal point, in units of what the lens shows on that side: a
/// fisheye's would have no end, and its borders are stretched.
const LARGEST: f64 = 1.5;

/// Less than this of the picture's width or height is left where a model is no lens.
const LEAST: f64 = 0.2;

/// Places along each border that are followed. Distortions are smooth: the borders between them lie within a hundredth
/// of a pixel.
const PLACES: u32 = 64;

/// How far beyond its own border a picture is asked for, in pixels, before a model counts as none.
const SLACK: f64 = 2.0;

/// The pinhole's picture of a [`Lens`]: the focal lengths are kept, and the frame is the largest with the lens's own
/// proportions in which nothing is missing, as `colmap image_undistorter` with `blank_pixels = 0` has it.
#[derive(Clone, Debug)]
pub struct Undistortion {
    lens: Lens,
    focal: DVec2,
    principal_point: DVec2,
    size: (u32, u32),
}

impl Undistortion {
    pub(super) fn new(lens: Lens) -> Result<Self, LensError> {
        let (width, height) = (f64::from(lens.size.0), f64::from(lens.size.1));
        let c = lens.principal_point;
        // Where the pinhole shows what the lens shows at a pixel; nothing for what lies beside or behind the camera.
        let ideal = |x: f64, y: f64| lens.direction_of(DVec2::new(x, y)).map(|d| d * lens.focal + c);
        let steps = || (0..=PLACES).map(|i| f64::from(i) / f64::from(PLACES));
        let (mut left, mut right, mut top, mut bottom) = (f64::MIN, f64::MAX, f64::MIN, f64::MAX);
        for t in steps() {
            left = ideal(0.0, t * height).map_or(left, |p| left.max(p.x));
            right = ideal(width, t * height).map_or(right, |p| right.min(p.x));
            top = ideal(t * width, 0.0).map_or(top, |p| top.max(p.y));
            bottom = ideal(t * width, height).map_or(bottom, |p| bottom.min(p.y));
        }
        let farthest = |side: f64, center: f64| center + LARGEST * (side - center);
        let corner = DVec2::new(left.max(farthest(0.0, c.x)), top.max(farthest(0.0, c.y)));
        let end = DVec2::new(right.min(farthest(width, c.x)), bottom.min(farthest(height, c.y)));
        // A whole number of pixels, with what a border of rounded numbers lacks.
        let size = (end - corner + 1e-6).floor();
        if !(size.x >= (LEAST * width).max(1.0) && size.y >= (LEAST * height).max(1.0)) {
            return Err(LensError::CannotBeUndone);
        }
        let (focal, principal_point) = (lens.focal, c - corner);
        let undistortion = Self { lens, focal, principal_point, size: (size.x as u32, size.y as u32) };
        if !undistortion.is_within() {
            return Err(LensError::CannotBeUndone);
        }
        Ok(undistortion)
    }

    /// The same for a pinhole that somebody else chose, as `colmap image_undistorter` does: for what belongs to pictures
    /// that are undistorted already. What the lens does not show repeats the border of its picture.
    pub fn onto(lens: Lens, pinhole: &Camera) -> Self {
        let k = pinhole.intrinsics;
        let (focal, principal_point) = (DVec2::new(k.x_axis.x, k.y_axis.y), k.z_axis.truncate());
        Self { lens, focal, principal_point, size: (pinhole.width, pinhole.height) }
    }

    /// Whether the lens shows all of the new picture.
    fn is_within(&self) -> bool {
        let (width, height) = (f64::from(self.lens.size.0), f64::from(self.lens.size.1));
        let places = (0..=PLACES).flat_map(|i| (0..=PLACES).map(move |j| (i, j)));
        places.into_iter().all(|(i, j)| {
            let share = DVec2::new(f64::from(i), f64::from(j)) / f64::from(PLACES);
            let source = self.source(share * DVec2::new(f64::from(self.size.0), f64::from(self.size.1)));
            source.is_some_and(|p| {
                let (low, high) = (p.cmpge(DVec2::splat(-SLACK)), p.cmple(DVec2::new(width, height) + SLACK));
                low.all() && high.all()
            })
        })
    }

    /// Width and height of the pinhole's picture.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// The matrix `K` of the pinhole.
    pub fn intrinsics(&self) -> DMat3 {
        let (x, y) = (DVec3::new(self.focal.x, 0.0, 0.0), DVec3::new(0.0, self.focal.y, 0.0));
        DMat3::from_cols(x, y, self.principal_point.extend(1.0))
    }

    /// The pinhole where the lens's camera stands.
    pub fn camera(&self, camera: &Camera) -> Camera {
        Camera { width: self.size.0, height: self.size.1, intrinsics: self.intrinsics(), ..camera.clone() }
    }

    /// The lens's pixel at a place of the pinhole's picture.
    fn source(&self, place: DVec2) -> Option<DVec2> {
        self.lens.pixel_of((place - self.principal_point) / self.focal)
    }

    /// The photograph as the pinhole would have taken it, by cubic interpolation (Keys 1981, a = -1/2). It must have the
    /// size of the lens; where it has not, the result has no meaning.
    pub fn picture(&self, photograph: &RgbImage) -> RgbImage {
        let at = |u: i64, v: i64| photograph.get_pixel(clamped(u, photograph.width()), clamped(v, photograph.height()));
        RgbImage::from_fn(self.size.0, self.size.1, |u, v| {
            let (u0, v0, weights_u, weights_v) = self.neighbours(u, v);
            let mut sum = [0.0; 3];
            for (j, weight_v) in weights_v.iter().enumerate() {
                for (i, weight_u) in weights_u.iter().enumerate() {
                    let pixel = at(u0 + i as i64 - 1, v0 + j as i64 - 1);
                    let weight = weight_u * weight_v;
                    sum.iter_mut().zip(pixel.0).for_each(|(sum, channel)| *sum += weight * f64::from(channel));
                }
            }
            Rgb(sum.map(|sum| sum.round().clamp(0.0, 255.0) as u8))
        })
    }

    /// The mask of [`Undistortion::picture`], by linear interpolation.
    pub fn mask(&self, mask: &Mask) -> Mask {
        let (width, height) = mask.size();
        let at = |u: i64, v: i64| f64::from(mask.coverage.get_pixel(clamped(u, width), clamped(v, height)).0[0]);
        Mask::from(GrayImage::from_fn(self.size.0, self.size.1, |u, v| {
            let (place, u0, v0) = self.place(u, v);
            let (s, t) = (place.x - u0 as f64, place.y - v0 as f64);
            let upper = (1.0 - s) * at(u0, v0) + s * at(u0 + 1, v0);
            let lower = (1.0 - s) * at(u0, v0 + 1) + s * at(u0 + 1, v0 + 1);
            Luma([((1.0 - t) * upper + t * lower).round() as u8])
        }))
    }

    /// Where a pixel of the new picture comes from, in units of pixels between their centres, and the pixel before it.
    fn place(&self, u: u32, v: u32) -> (DVec2, i64, i64) {
        let center = DVec2::new(f64::from(u) + 0.5, f64::from(v) + 0.5);
        let place = self.source(center).unwrap_or_default() - 0.5;
        (place, place.x.floor() as i64, place.y.floor() as i64)
    }

    /// [`Undistortion::place`] with the weights of four pixels in each direction, from the one before.
    fn neighbours(&self, u: u32, v: u32) -> (i64, i64, [f64; 4], [f64; 4]) {
        let (place, u0, v0) = self.place(u, v);
        (u0, v0, cubic_weights(place.x - u0 as f64), cubic_weights(place.y - v0 as f64))
    }
}

/// Keys' weights of the samples at -1, 0, 1 and 2 for a place from 0 to 1.
fn cubic_weights(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (-t3 + 2.0 * t2 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (-3.0 * t3 + 4.0 * t2 + t), 0.5 * (t3 - t2)]
}

/// The nearest index of a row or column of that many pixels.
fn clamped(index: i64, count: u32) -> u32 {
    index.clamp(0, i64::from(count) - 1) as u32
}

#[cfg(test)]
mod tests {
    use super::super::tests::every_model;
    use super::*;

    /// A smooth pattern over directions.
    fn pattern(direction: DVec2) -> f64 {
        127.0 + 60.0 * (9.0 * direction.x).sin() + 60.0 * (7.0 * direction.y + 1.0).cos()
    }

    #[test]
    fn every_lens_gives_the_picture_of_a_pinhole() {
        for lens in every_model() {
            let lens = lens.resized(160, 120);
            let photograph = RgbImage::from_fn(160, 120, |u, v| {
                let direction = lens.direction_of(DVec2::new(f64::from(u) + 0.5, f64::from(v) + 0.5)).unwrap();
                Rgb([pattern(direction).round() as u8; 3])
            });
            let undistortion = lens.undistortion().unwrap();
            let (picture, k) = (undistortion.picture(&photograph), undistortion.intrinsics().inverse());
            assert_eq!(picture.dimensions(), undistortion.size());
            let mut worst = 0.0f64;
            for (u, v, pixel) in picture.enumerate_pixels() {
                let direction = k * DVec2::new(f64::from(u) + 0.5, f64::from(v) + 0.5).extend(1.0);
                worst = worst.max((pattern(direction.truncate()) - f64::from(pixel.0[0])).abs());
            }
            assert!(worst < 3.0, "{lens:?}: {worst}");
            let share = f64::from(picture.width() * picture.height()) / (160.0 * 120.0);
            assert!((0.8..2.25).contains(&share), "{lens:?}: {share}");
        }
    }

    #[test]
    fn a_mask_follows_a_pinhole_that_another_program_chose() {
        let lens = Lens::from_colmap("SIMPLE_RADIAL", 64, 48, &[60.0, 32.0, 24.0, -0.2]).unwrap();
        let own = lens.undistortion().unwrap();
        let mask = Mask::from(GrayImage::from_fn(64, 48, |u, v| Luma([if u > 20 && v < 30 { 255 } else { 0 }])));
        let pose = Camera::look_at(64, 48, 60.0, glam::DVec3::Z, glam::DVec3::ZERO, glam::DVec3::Y);
        assert_eq!(Undistortion::onto(lens, &own.camera(&pose)).mask(&mask), own.mask(&mask));
    }

    #[test]
    fn a_pinhole_stays_as_it_is_to_the_byte() {
        let lens = Lens::from_colmap("PINHOLE", 31, 23, &[40.0, 41.0, 15.3, 11.9]).unwrap();
        let photograph = RgbImage::from_fn(31, 23, |u, v| Rgb([u as u8 * 7, v as u8 * 9, (u * v) as u8]));
        let mask = Mask::from(GrayImage::from_fn(31, 23, |u, v| Luma([(u * 8 + v) as u8])));
        let undistortion = lens.undistortion().unwrap();
        assert_eq!(undistortion.picture(&photograph), photograph);
        assert_eq!(undistortion.mask(&mask), mask);
        assert!((undistortion.intrinsics() - lens.intrinsics()).to_cols_array().iter().all(|x| x.abs() < 1e-9));
    }

    #[test]
    fn a_model_that_folds_the_picture_over_is_no_lens() {
        let folded = Lens::from_colmap("SIMPLE_RADIAL", 64, 48, &[20.0, 32.0, 24.0, -0.9]).unwrap();
        assert!(matches!(folded.undistortion(), Err(LensError::CannotBeUndone)));
    }
}
