//! Photographs as stereo reads them: grey, at the size that the fused field can show.

use dvr_core::Pinhole;
use glam::{Vec2, Vec3};

use crate::views::TrainingView;

/// A photograph in grey.
pub(super) struct Picture {
    pub camera: Pinhole,
    pub width: usize,
    pub height: usize,
    /// Pixels of the photograph along the side of one of these.
    pub factor: usize,
    /// `NaN` off the object.
    pub grey: Vec<f32>,
}

impl Picture {
    /// Shrinks a photograph until its pixels are about `footprint` large at the object, object units.
    pub fn new(view: &TrainingView, footprint: f32) -> Self {
        let factor = ((footprint / view.camera.footprint()).round() as usize).max(1);
        let [width, height] = view.size().map(|side| side as usize / factor);
        let mean = |x: usize, y: usize| {
            let pixels = (0..factor * factor).map(|i| (x * factor + i % factor, y * factor + i / factor));
            let (sum, count) = (pixels.filter_map(|(u, v)| view.brightness(u as u32, v as u32)))
                .fold((0.0, 0), |(sum, count), grey| (sum + grey, count + 1));
            if 2 * count >= factor * factor { sum / count as f32 } else { f32::NAN }
        };
        let grey = (0..width * height).map(|i| mean(i % width, i / width)).collect();
        Self { camera: view.camera.shrunk(factor), width, height, factor, grey }
    }

    /// Whether a pixel shows the object.
    pub fn is_object(&self, pixel: usize) -> bool {
        !self.grey[pixel].is_nan()
    }

    /// The ray through the middle of a pixel, of unit z-depth.
    pub fn direction(&self, pixel: usize) -> Vec3 {
        let (x, y) = (pixel % self.width, pixel / self.width);
        self.camera.direction_through(Vec2::new(x as f32 + 0.5, y as f32 + 0.5))
    }

    /// The pixel that a place lies in.
    pub fn pixel_at(&self, place: Vec2) -> Option<usize> {
        let inside = place.x >= 0.0 && place.y >= 0.0 && place.x < self.width as f32 && place.y < self.height as f32;
        inside.then(|| place.y as usize * self.width + place.x as usize)
    }
}
