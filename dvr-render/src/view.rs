//! Images: what a camera would see.

use dvr_core::{Camera, DepthMap, Mask, Ray};
use image::{GrayImage, Rgb32FImage};

use crate::shade::Shader;

/// What a camera sees.
#[derive(Clone, Debug)]
pub struct Rendering {
    /// sRGB colours in `[0, 1]`; white where nothing is hit.
    pub color: Rgb32FImage,
    /// 255 where the object is hit.
    pub mask: Mask,
    /// z-depth in object units; `+inf` where nothing is hit.
    pub depth: DepthMap,
    /// Outward unit normals in object space; 0 where nothing is hit.
    pub normal: Rgb32FImage,
}

/// Renders what `camera` sees.
pub fn render_view(shader: &dyn Shader, camera: &Camera) -> Rendering {
    let (width, height) = (camera.width, camera.height);
    let rays: Vec<Ray> =
        (0..height).flat_map(|v| (0..width).map(move |u| (u, v))).map(|(u, v)| camera.pixel_ray(u, v)).collect();
    let shaded = shader.shade(&rays);
    let mut rendering = Rendering {
        color: Rgb32FImage::from_pixel(width, height, image::Rgb([1.0; 3])),
        mask: Mask::from(GrayImage::new(width, height)),
        depth: DepthMap { width, height, z_depth: vec![f32::INFINITY; rays.len()] },
        normal: Rgb32FImage::new(width, height),
    };
    for (i, shaded) in shaded.into_iter().enumerate() {
        if let Some(shaded) = shaded {
            let (u, v) = (i as u32 % width, i as u32 / width);
            rendering.color.put_pixel(u, v, image::Rgb(shaded.color));
            rendering.normal.put_pixel(u, v, image::Rgb(shaded.normal));
            rendering.mask.coverage.put_pixel(u, v, image::Luma([255]));
            rendering.depth.z_depth[i] = shaded.depth;
        }
    }
    rendering
}
