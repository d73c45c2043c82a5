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
        if let Some(mask) = self.view.training_mask()
            && !at.pixels.iter().all(|&(u, v)| mask.is_object(u, v))
        {
            return None;
        }
        let corners = at.pixels.map(|(u, v)| {
            let [r, g, b] = self.view.image.get_pixel(u, v).0;
            Vec3::new(f32::from(r), f32::from(g), f32::from(b))
        });
        let color = at.value(corners) / 255.0;
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

/// How a photograph would show a point, were nothing in between.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sight {
    pub pixel: Vec2,
    pub z_depth: f32,
    pub cosine: f32,
    /// Square pixels of the photograph per square unit of the surface.
    pub quality: f32,
}
