//! Masks and depth maps. Reading and writing them is in [`crate::files`].

use image::GrayImage;

use crate::pixels::{GrayPicture, stored};

/// Which pixels show the object. Coverage 0 to 255, as an alpha channel gives it.
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    /// Coverage per pixel, 255 where the object fills it.
    pub coverage: GrayPicture,
}

impl Mask {
    /// Image size in pixels, `(width, height)`.
    pub fn size(&self) -> (u32, u32) {
        self.coverage.dimensions()
    }

    /// Whether at least half of pixel `(u, v)` shows the object.
    #[inline]
    pub fn is_object(&self, u: u32, v: u32) -> bool {
        self.coverage.get_pixel(u, v).0[0] >= 128
    }

    /// How many pixels show the object.
    pub fn object_pixels(&self) -> usize {
        self.coverage.pixels().filter(|p| p.0[0] >= 128).count()
    }
}

impl From<GrayImage> for Mask {
    fn from(coverage: GrayImage) -> Self {
        Self { coverage: stored(coverage) }
    }
}

/// Depth in camera z, in the units of the space its camera lives in; `+inf` where there is only background.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `z_depth[v * width + u]`, row by row.
    pub z_depth: Vec<f32>,
}

impl DepthMap {
    /// z-depth of pixel `(u, v)`; `+inf` for background.
    pub fn get(&self, u: u32, v: u32) -> f32 {
        self.z_depth[v as usize * self.width as usize + u as usize]
    }

    /// Every depth multiplied by `factor`: a change of units.
    pub fn scaled(mut self, factor: f32) -> Self {
        self.z_depth.iter_mut().for_each(|z| *z *= factor);
        self
    }
}
