//! Photographs as sources of colour: where they show the object, at the mean exposure of their scene.

use dvr_core::mesh::Mesh;
use dvr_core::{Bilinear, Exposure, MIN_COSINE, View};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::view_buffer::ViewBuffer;

/// A photograph that colours can be taken from, and what it sees of the mesh.
#[derive(Debug)]
pub(crate) struct Photograph<'a> {
    view: &'a View,
    exposure: Exposure,
    /// Whether colours have to be corrected.
    is_exposed: bool,
    pub buffer: ViewBuffer,
}

impl<'a> Photograph<'a> {
    /// The photographs of a mesh in the space of the views' cameras. Views whose exposure is not known, while that of
    /// others is, say nothing of colour and are left out. What they see is kept in cells of `stride` pixels.
    pub fn all(mesh: &Mesh, views: &[&'a View], stride: u32) -> Vec<Self> {
        let of = |view: &&'a View| {
            let exposure = view.exposure?;
            let buffer = ViewBuffer::draw(mesh, &view.camera, stride);
            Some(Self { view, exposure, is_exposed: exposure != Exposure::default(), buffer })
        };
        views.par_iter().filter_map(of).collect()
    }

    /// The bilinear colour at pixel coordinates, sRGB in `[0, 1]`; `None` where one of the four pixels is not the
    /// object's by the mask that training uses. A view without a mask shows the object wherever the mesh is.
    #[inline]
    pub fn color(&self, pixel: Vec2) -> Option<Vec3> {
        let at = Bilinear::at_single(pixel, self.buffer.picture)?;
        let (u, v) = at.pixels[0];
        let width = self.buffer.picture.0 as usize;
        let above = v as usize * width + u as usize;
        let places = [above, above + 1, above + width, above + width + 1];
        if let Some(mask) = self.view.training_mask() {
            let coverage = mask.coverage.as_raw();
            if !is_object(places.map(|place| coverage[place])) {
                return None;
            }
        }
        let colors = self.view.image.as_raw().as_chunks::<3>().0;
        let color = at.value(places.map(|place| Vec3::from(colors[place].map(f32::from)))) / 255.0;
        Some(if self.is_exposed { self.exposure.corrected(color).clamp(Vec3::ZERO, Vec3::ONE) } else { color })
    }

    /// How well this photograph would show a piece of surface at a point: pixels per unit of its length, foreshortened,
    /// squared. `None` where it is turned away, out of the frame, or too slanting.
    #[inline]
    pub fn sight(&self, point: Vec3, normal: Vec3) -> Option<Sight> {
        let camera = &self.buffer.camera;
        let to_camera = camera.center - point;
        let cosine = normal.dot(to_camera) / to_camera.length();
        if cosine < MIN_COSINE as f32 {
            return None;
        }
        let (pixel, z_depth) = camera.project(point);
        let (width, height) = self.buffer.picture;
        let is_inside =
            pixel.x >= 0.5 && pixel.y >= 0.5 && pixel.x < width as f32 - 0.5 && pixel.y < height as f32 - 0.5;
        (z_depth > 0.0 && is_inside).then(|| {
            let quality = (cosine * camera.focal / z_depth).powi(2);
            Sight { pixel, z_depth, cosine, quality }
        })
    }

    /// Whether nothing stands between the camera and what it would see.
    #[inline]
    pub fn is_open(&self, sight: &Sight) -> bool {
        self.buffer.is_open(sight.pixel, sight.z_depth, sight.cosine)
    }
}

/// Whether pixels of these coverages show the object: at least half of each does.
#[inline]
fn is_object(coverages: [u8; 4]) -> bool {
    coverages.into_iter().fold(u8::MAX, |common, coverage| common & coverage) >= 128
}

/// How a photograph would show a point, were nothing in between.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sight {
    pub pixel: Vec2,
    pub z_depth: f32,
    pub cosine: f32,
    /// Square pixels of the photograph per square unit of the surface.
    pub quality: f32,
}
