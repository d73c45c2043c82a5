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

/// Rays that are shaded together, about: a large picture is rendered in bands of rows, so that its rays take little
/// memory beside it.
const BAND_RAYS: u32 = 1 << 20;

/// Bytes of a pixel of a rendering, and of the pictures that are made of it.
const PIXEL_BYTES: u64 = 48;

/// Bytes of a ray and what it shows.
const RAY_BYTES: u64 = 160;

/// Bytes that rendering what `camera` sees takes at most, about.
pub fn rendering_bytes(camera: &Camera) -> u64 {
    let pixels = u64::from(camera.width) * u64::from(camera.height);
    pixels * PIXEL_BYTES + pixels.min(u64::from(BAND_RAYS.max(camera.width))) * RAY_BYTES
}

/// Renders what `camera` sees.
pub fn render_view(shader: &dyn Shader, camera: &Camera) -> Rendering {
    let (width, height) = (camera.width, camera.height);
    let mut rendering = Rendering {
        color: Rgb32FImage::from_pixel(width, height, image::Rgb([1.0; 3])),
        mask: Mask::from(GrayImage::new(width, height)),
        depth: DepthMap { width, height, z_depth: vec![f32::INFINITY; width as usize * height as usize] },
        normal: Rgb32FImage::new(width, height),
    };
    let rows = (BAND_RAYS / width.max(1)).max(1);
    for top in (0..height).step_by(rows as usize) {
        let bottom = height.min(top + rows);
        let pixels = || (top..bottom).flat_map(|v| (0..width).map(move |u| (u, v)));
        let rays: Vec<Ray> = pixels().map(|(u, v)| camera.pixel_ray(u, v)).collect();
        for ((u, v), shaded) in pixels().zip(shader.shade(&rays)) {
            let Some(shaded) = shaded else { continue };
            rendering.color.put_pixel(u, v, image::Rgb(shaded.color));
            rendering.normal.put_pixel(u, v, image::Rgb(shaded.normal));
            rendering.mask.coverage.put_pixel(u, v, image::Luma([255]));
            rendering.depth.z_depth[v as usize * width as usize + u as usize] = shaded.depth;
        }
    }
    rendering
}
