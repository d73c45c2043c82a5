//! Photographs at the size that segmentation works at.

use dvr_core::{Mask, Pinhole, View};
use glam::Vec2;
use image::imageops;

/// Longer side of the pictures that are worked on, pixels.
pub(crate) const WORKING_SIZE: u32 = 200;

/// Longer side of the pictures in which outlines are drawn at last, pixels.
pub(crate) const FINAL_SIZE: u32 = 800;

/// A photograph, shrunk by averaging.
pub(crate) struct Shrunk {
    pub camera: Pinhole,
    pub width: usize,
    pub height: usize,
    /// sRGB, row by row.
    pub colors: Vec<[u8; 3]>,
}

impl Shrunk {
    /// With a longer side of at most `longest` pixels; a smaller photograph keeps its size.
    pub fn new(view: &View, longest: u32) -> Self {
        let (width, height) = view.image.dimensions();
        let scale = (f64::from(longest) / f64::from(width.max(height))).min(1.0);
        let [width, height] = [width, height].map(|side| ((f64::from(side) * scale).round() as u32).max(1));
        let small = imageops::thumbnail(&view.image, width, height);
        Self {
            camera: Pinhole::new(&view.camera.resized(width, height)),
            width: width as usize,
            height: height as usize,
            colors: small.pixels().map(|pixel| pixel.0).collect(),
        }
    }

    pub fn len(&self) -> usize {
        self.colors.len()
    }

    /// The middle of a pixel, by its index.
    pub fn middle(&self, pixel: usize) -> Vec2 {
        Vec2::new((pixel % self.width) as f32 + 0.5, (pixel / self.width) as f32 + 0.5)
    }

    /// The pixel that a place lies in.
    pub fn pixel_at(&self, place: Vec2) -> Option<usize> {
        let inside = place.x >= 0.0 && place.y >= 0.0 && place.x < self.width as f32 && place.y < self.height as f32;
        inside.then(|| place.y as usize * self.width + place.x as usize)
    }

    /// Which pixels the mask of the view covers, which may have another size.
    pub fn covered_by(&self, mask: &Mask) -> Vec<bool> {
        let (width, height) = mask.coverage.dimensions();
        let scale = Vec2::new(width as f32 / self.width as f32, height as f32 / self.height as f32);
        let is_object = |pixel: usize| {
            let place = scale * self.middle(pixel);
            mask.is_object(place.x as u32, place.y as u32)
        };
        (0..self.len()).map(is_object).collect()
    }

    /// The pixels that are nearer to the frame than this, in pixels, and not nearer than `from`.
    pub fn border(&self, from: usize, to: usize) -> Vec<usize> {
        let depth = |at: usize, side: usize| at.min(side - 1 - at);
        let from_frame =
            |pixel: &usize| depth(pixel % self.width, self.width).min(depth(pixel / self.width, self.height));
        (0..self.len()).filter(|pixel| (from..to).contains(&from_frame(pixel))).collect()
    }

    /// Mean of the three channels, 0 to 255.
    pub fn gray(&self) -> Vec<f32> {
        self.colors.iter().map(|color| color.iter().map(|&channel| f32::from(channel)).sum::<f32>() / 3.0).collect()
    }
}
