//! A square around the object, for photographs in which it is small or off the middle.

use image::{GrayImage, Rgb, RgbImage};

use crate::files::Photo;
use crate::raster::Mask;

/// The square part of a picture around the object, which `margin` of its larger side surrounds on all sides; what of
/// the square lies outside the picture is background. `None` where the mask shows no object, or is of another size.
pub fn square_around(photo: &Photo, mask: &Mask, margin: f64) -> Option<Photo> {
    if mask.size() != photo.image.dimensions() {
        return None;
    }
    let (width, height) = mask.size();
    let object = || (0..height).flat_map(|v| (0..width).map(move |u| (u, v))).filter(|&(u, v)| mask.is_object(u, v));
    let (left, right) = (object().map(|p| p.0).min()?, object().map(|p| p.0).max()?);
    let (top, bottom) = (object().map(|p| p.1).min()?, object().map(|p| p.1).max()?);
    let extent = (right - left).max(bottom - top) + 1;
    let side = (f64::from(extent) * (1.0 + 2.0 * margin)).round().max(1.0) as u32;
    let corner = |low: u32, high: u32| (i64::from(low) + i64::from(high) + 1 - i64::from(side)).div_euclid(2);
    let (left, top) = (corner(left, right), corner(top, bottom));
    let source = |u: u32, v: u32| {
        let (x, y) = (u32::try_from(left + i64::from(u)).ok()?, u32::try_from(top + i64::from(v)).ok()?);
        (x < width && y < height).then_some((x, y))
    };
    let image =
        RgbImage::from_fn(side, side, |u, v| source(u, v).map_or(Rgb([255; 3]), |(x, y)| *photo.image.get_pixel(x, y)));
    let coverage = GrayImage::from_fn(side, side, |u, v| {
        source(u, v).map_or(image::Luma([0]), |(x, y)| *mask.coverage.get_pixel(x, y))
    });
    Some(Photo { image, alpha: Some(Mask::from(coverage)) })
}

#[cfg(test)]
mod tests {
    use image::Luma;

    use super::*;

    /// A picture whose pixels encode where they are, with the object in a box.
    fn boxed(us: std::ops::Range<u32>, vs: std::ops::Range<u32>) -> (Photo, Mask) {
        let image = RgbImage::from_fn(20, 10, |u, v| Rgb([u as u8, v as u8, 0]));
        let inside = |u, v| us.contains(&u) && vs.contains(&v);
        let coverage = GrayImage::from_fn(20, 10, |u, v| Luma([if inside(u, v) { 255 } else { 0 }]));
        (Photo { image, alpha: None }, Mask::from(coverage))
    }

    #[test]
    fn the_object_stands_in_the_middle_with_its_margin() {
        let (photo, mask) = boxed(8..12, 3..5);
        let square = square_around(&photo, &mask, 0.25).unwrap();
        assert_eq!(square.image.dimensions(), (6, 6));
        assert_eq!([square.image.get_pixel(0, 0).0, square.image.get_pixel(5, 5).0], [[7, 1, 0], [12, 6, 0]]);
        assert_eq!(square.alpha.unwrap().object_pixels(), 8);
    }

    #[test]
    fn what_lies_outside_the_picture_is_background() {
        let (photo, mask) = boxed(0..4, 0..10);
        let square = square_around(&photo, &mask, 0.0).unwrap();
        assert_eq!(square.image.dimensions(), (10, 10));
        assert_eq!(square.image.get_pixel(0, 5).0, [255; 3]);
        assert!(!square.alpha.as_ref().unwrap().is_object(2, 5));
        assert_eq!(square.alpha.unwrap().object_pixels(), 40);
    }

    #[test]
    fn without_an_object_there_is_no_square() {
        let (photo, mask) = boxed(0..0, 0..0);
        assert!(square_around(&photo, &mask, 0.1).is_none());
        let other = Mask::from(GrayImage::new(3, 3));
        assert!(square_around(&photo, &other, 0.1).is_none());
    }
}
