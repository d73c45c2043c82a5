//! What views see of a surface.

use dvr_core::{Ray, View};
use dvr_render::{Shaded, Shader};
use glam::Vec3;

/// Points on the surface that object pixels of `views` see: seeds for the extraction.
pub fn surface_points(shader: &dyn Shader, views: &[&View], rays: usize) -> Vec<Vec3> {
    let masks = || views.iter().filter_map(|view| view.training_pair());
    let object = masks().flat_map(|(camera, mask)| {
        let (width, height) = mask.size();
        let pixels = (0..height).flat_map(move |v| (0..width).map(move |u| (camera, u, v)));
        pixels.filter(|(_, u, v)| mask.is_object(*u, *v))
    });
    let count: usize = masks().map(|(_, mask)| mask.object_pixels()).sum();
    let stride = count.div_ceil(rays.max(1)).max(1);
    let rays: Vec<Ray> = object.step_by(stride).map(|(camera, u, v)| camera.pixel_ray(u, v)).collect();
    let shaded = shader.shade(&rays);
    let point = |(ray, shaded): (&Ray, Option<Shaded>)| Some(ray.at(shaded?.depth.into()).as_vec3());
    rays.iter().zip(shaded).filter_map(point).collect()
}
