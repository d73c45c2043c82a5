//! The picture that an image encoder sees: the object on white, square, of the encoder's size.

use glam::{DMat3, DVec2};
use image::imageops::{FilterType, flip_horizontal, overlay, resize};
use image::{GrayImage, ImageBuffer, Luma, Pixel, Rgb, RgbImage};

use crate::camera::Camera;
use crate::files::Photo;
use crate::mirror::MirrorAxis;
use crate::raster::Mask;

/// What an image encoder sees of an object.
#[derive(Clone, Debug)]
pub struct InputPicture {
    /// The object on white, square.
    pub image: RgbImage,
    /// Its camera in object space, where it is known.
    pub camera: Option<Camera>,
    /// How much of each of its pixels shows the object, where that is known.
    pub mask: Option<Mask>,
}

impl InputPicture {
    /// The picture of the mirrored object: flipped from left to right.
    #[must_use]
    pub fn mirrored(&self, axis: MirrorAxis) -> Self {
        Self {
            image: flip_horizontal(&self.image),
            camera: self.camera.as_ref().map(|camera| axis.mirrored_camera(camera)),
            mask: self.mask.as_ref().map(|mask| Mask::from(flip_horizontal(&mask.coverage))),
        }
    }
}

/// Puts the object on white by its alpha channel, or else by `mask`, pads to a square with white, and scales to `size`
/// pixels.
///
/// Every picture that is given to an encoder goes through here, in training and in prediction alike. A mask of another
/// size than the picture is left out.
pub fn input_picture(photo: &Photo, mask: Option<&Mask>, size: u32) -> RgbImage {
    let mut image = photo.image.clone();
    if let Some(mask) = mask_of(photo, mask) {
        for (pixel, coverage) in image.pixels_mut().zip(mask.coverage.pixels()) {
            *pixel = over_white(*pixel, coverage.0[0]);
        }
    }
    squared(image, Rgb([255; 3]), size)
}

/// The mask of what [`input_picture`] makes of a picture; `None` where there is none of its size.
pub(super) fn input_mask(photo: &Photo, mask: Option<&Mask>, size: u32) -> Option<Mask> {
    let coverage = &mask_of(photo, mask)?.coverage;
    let coverage = GrayImage::from_raw(coverage.width(), coverage.height(), coverage.to_vec())?;
    Some(Mask::from(squared(coverage, Luma([0]), size)))
}

/// The alpha channel, or else the mask, of the picture's size.
fn mask_of<'a>(photo: &'a Photo, mask: Option<&'a Mask>) -> Option<&'a Mask> {
    photo.alpha.as_ref().or(mask).filter(|mask| mask.size() == photo.image.dimensions())
}

/// Padded to a square and scaled to `size` pixels.
fn squared<P: Pixel<Subpixel = u8> + 'static>(
    image: ImageBuffer<P, Vec<u8>>,
    around: P,
    size: u32,
) -> ImageBuffer<P, Vec<u8>> {
    let (width, height) = image.dimensions();
    let edge = width.max(height);
    let square = if width == height {
        image
    } else {
        let mut square = ImageBuffer::from_pixel(edge, edge, around);
        overlay(&mut square, &image, i64::from((edge - width) / 2), i64::from((edge - height) / 2));
        square
    };
    if edge == size { square } else { resize(&square, size, size, FilterType::Triangle) }
}

/// The camera of what [`input_picture`] makes of a picture with this camera.
pub(super) fn input_camera(camera: &Camera, size: u32) -> Camera {
    let edge = camera.width.max(camera.height);
    let padding = DVec2::new(f64::from((edge - camera.width) / 2), f64::from((edge - camera.height) / 2));
    let scale = f64::from(size) / f64::from(edge);
    let into_square = DMat3::from_scale(DVec2::splat(scale)) * DMat3::from_translation(padding);
    Camera { width: size, height: size, intrinsics: into_square * camera.intrinsics, ..camera.clone() }
}

/// A colour that covers `coverage` of 255 of a white pixel.
fn over_white(color: Rgb<u8>, coverage: u8) -> Rgb<u8> {
    let share = u32::from(coverage);
    Rgb(color.0.map(|c| ((u32::from(c) * share + 255 * (255 - share) + 127) / 255) as u8))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use image::{GrayImage, Luma};

    use super::*;

    fn left_half(width: u32, height: u32) -> Mask {
        Mask::from(GrayImage::from_fn(width, height, |u, _| Luma([if 2 * u < width { 255 } else { 0 }])))
    }

    #[test]
    fn the_object_stands_on_white_in_a_square() {
        let photo = Photo { image: RgbImage::from_pixel(8, 4, Rgb([10, 20, 30])), alpha: Some(left_half(8, 4)) };
        let picture = input_picture(&photo, None, 8);
        assert_eq!(picture.dimensions(), (8, 8));
        let at = |u, v| picture.get_pixel(u, v).0;
        assert_eq!([at(0, 0), at(1, 3), at(6, 3), at(1, 7)], [[255; 3], [10, 20, 30], [255; 3], [255; 3]]);
    }

    #[test]
    fn alpha_goes_before_the_mask_and_a_mask_of_another_size_is_left_out() {
        let image = RgbImage::from_pixel(4, 4, Rgb([0; 3]));
        let empty = Mask::from(GrayImage::new(4, 4));
        let with_alpha = Photo { image: image.clone(), alpha: Some(left_half(4, 4)) };
        assert_eq!(input_picture(&with_alpha, Some(&empty), 4).get_pixel(0, 0).0, [0; 3]);
        let plain = Photo { image, alpha: None };
        assert_eq!(input_picture(&plain, Some(&empty), 4).get_pixel(0, 0).0, [255; 3]);
        let other = Mask::from(GrayImage::new(5, 5));
        assert_eq!(input_picture(&plain, Some(&other), 4).get_pixel(0, 0).0, [0; 3]);
    }

    #[test]
    fn the_camera_follows_padding_and_scale() {
        let camera = Camera::look_at(80, 40, 90.0, DVec3::new(0.4, 0.3, -2.0), DVec3::ZERO, DVec3::Y);
        let of_input = input_camera(&camera, 32);
        let point = DVec3::new(0.1, 0.2, -0.1);
        let (pixel, depth) = camera.project(point);
        let (found, same) = of_input.project(point);
        assert!((found - (pixel + DVec2::new(0.0, 20.0)) * 0.4).length() < 1e-9 && depth == same, "{found} {pixel}");
    }

    #[test]
    fn coverage_in_between_mixes() {
        assert_eq!(over_white(Rgb([0, 100, 255]), 128).0, [127, 177, 255]);
    }
}
