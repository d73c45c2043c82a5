//! A photograph as a smooth function of the pixel.

use dvr_core::{Bilinear, Picture};
use glam::{DVec2, Vec3};
use image::imageops;

/// A photograph, blurred, with its slopes.
#[derive(Clone, Debug)]
pub(super) struct SmoothPhotograph {
    width: u32,
    height: u32,
    blur: f32,
    colors: Vec<Vec3>,
}

/// A colour and its derivatives by the pixel's coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sampled {
    pub color: Vec3,
    pub by_x: Vec3,
    pub by_y: Vec3,
}

impl SmoothPhotograph {
    /// Blurs with a Gaussian of so many pixels; 0 for none.
    pub fn new(picture: &Picture, blur: f32) -> Self {
        let (width, height) = picture.dimensions();
        let as_float = image::ImageBuffer::from_fn(width, height, |u, v| {
            image::Rgb(picture.get_pixel(u, v).0.map(|channel| f32::from(channel) / 255.0))
        });
        let blurred = if blur > 0.0 { imageops::blur(&as_float, blur) } else { as_float };
        Self { width, height, blur, colors: blurred.pixels().map(|pixel| Vec3::from(pixel.0)).collect() }
    }

    /// How far a pixel is spread noticeably, in pixels.
    pub fn reach(&self) -> f32 {
        1.5 * self.blur
    }

    /// Bilinear between the centres of pixels; `None` beyond the outermost.
    pub fn sample(&self, pixel: DVec2) -> Option<Sampled> {
        let at = Bilinear::at(pixel, (self.width, self.height))?;
        let corners = at.pixels.map(|(u, v)| self.colors[v as usize * self.width as usize + u as usize]);
        let [by_x, by_y] = at.derivatives(corners);
        Some(Sampled { color: at.value(corners), by_x, by_y })
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::stored;
    use image::{Rgb, RgbImage};

    use super::*;

    #[test]
    fn a_ramp_has_its_colour_and_its_slope() {
        let ramp = stored(RgbImage::from_fn(20, 10, |u, v| Rgb([(10 * u) as u8, (20 * v) as u8, 0])));
        for blur in [0.0, 1.5] {
            let photograph = SmoothPhotograph::new(&ramp, blur);
            let found = photograph.sample(DVec2::new(9.25, 5.0)).unwrap();
            let expected = Vec3::new(10.0 * 8.75, 20.0 * 4.5, 0.0) / 255.0;
            assert!((found.color - expected).length() < 2e-3, "{found:?}");
            assert!((found.by_x.x - 10.0 / 255.0).abs() < 1e-3 && (found.by_y.y - 20.0 / 255.0).abs() < 1e-3);
        }
        let photograph = SmoothPhotograph::new(&ramp, 0.0);
        assert!(photograph.sample(DVec2::new(0.4, 5.0)).is_none());
        assert!(photograph.sample(DVec2::new(19.6, 5.0)).is_none());
    }
}
