//! Test views as a page shows them: the photograph, the render of the mesh, depth, normals, and their difference.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use dvr_core::View;
use dvr_core::files::encoded_jpeg;
use dvr_core::metrics::picture::{mask_iou, psnr, ssim};
use dvr_core::{DepthMap, Mask};
use dvr_render::Shader;
use dvr_train::preview::{normal_picture, render_limited, to_rgb8, whitened};
use image::codecs::webp::WebPEncoder;
use image::imageops::{FilterType, resize};
use image::{ExtendedColorType, GrayImage, Rgb, RgbImage, Rgba, RgbaImage};

use crate::error::Result;

/// Quality of photographs and renders, of 100.
const QUALITY: u8 = 86;

/// Difference, as a share of the full range, from which the error map has its last colour.
pub const LARGEST_ERROR: f32 = 0.25;

/// One view; pictures are `data:` addresses.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewPictures {
    /// The view's name.
    pub name: String,
    /// Size of the pictures in pixels.
    pub size: (u32, u32),
    /// The photograph, white around the object.
    pub photo: String,
    /// The render, on white.
    pub render: String,
    /// Depth in colours, near bright, clear around the object.
    pub depth: String,
    /// Nearest and farthest z-depth, in object units; `None` where nothing is hit.
    pub depth_range: Option<[f32; 2]>,
    /// Normals in the camera's frame as colours, clear around the object.
    pub normal: String,
    /// Mean difference of the channels, up to a quarter of the range, clear where there is none.
    pub error: String,
    /// PSNR of these pictures, dB.
    pub psnr: f64,
    /// SSIM of these pictures.
    pub ssim: f64,
    /// Intersection over union of the silhouettes in these pictures.
    pub mask_iou: Option<f64>,
}

/// Shades a view in at most `max_width` pixels and compares.
///
/// # Errors
/// When a picture cannot be encoded.
pub fn view_pictures(shader: &dyn Shader, view: &View, max_width: u32) -> Result<ViewPictures> {
    let (camera, rendering) = render_limited(shader, &view.camera, max_width);
    let (width, height) = (camera.width, camera.height);
    let render = to_rgb8(&rendering.color);
    let photo = whitened(view);
    let photo =
        if photo.dimensions() == (width, height) { photo } else { resize(&photo, width, height, FilterType::Triangle) };
    let mask = view.mask.as_ref().map(|mask| {
        let coverage = GrayImage::from_fn(mask.size().0, mask.size().1, |u, v| *mask.coverage.get_pixel(u, v));
        Mask::from(resize(&coverage, width, height, FilterType::Triangle))
    });
    let normal = normal_picture(&rendering, &camera);
    let silhouette = &rendering.mask;
    let clear = |picture: &dyn Fn(u32, u32) -> Rgb<u8>| {
        RgbaImage::from_fn(width, height, |u, v| {
            let Rgb([r, g, b]) = picture(u, v);
            if silhouette.is_object(u, v) { Rgba([r, g, b, 255]) } else { Rgba([0; 4]) }
        })
    };
    let depth_range = range(&rendering.depth);
    Ok(ViewPictures {
        name: view.name.clone(),
        size: (width, height),
        depth: webp(&clear(&|u, v| depth_color(rendering.depth.get(u, v), depth_range)))?,
        depth_range,
        normal: webp(&clear(&|u, v| *normal.get_pixel(u, v)))?,
        error: webp(&error_map(&photo, &render))?,
        psnr: psnr(&render, &photo, None)?,
        ssim: ssim(&render, &photo)?,
        mask_iou: mask.map(|mask| mask_iou(silhouette, &mask)).transpose()?,
        photo: jpeg(&photo)?,
        render: jpeg(&render)?,
    })
}

/// A picture as a `data:` address, as JPEG.
///
/// # Errors
/// When it cannot be encoded.
pub fn jpeg(picture: &RgbImage) -> Result<String> {
    Ok(format!("data:image/jpeg;base64,{}", STANDARD.encode(encoded_jpeg(picture, QUALITY, None)?)))
}

/// A picture as a `data:` address, without loss, as WebP.
fn webp(picture: &RgbaImage) -> Result<String> {
    let mut bytes = Vec::new();
    let encoder = WebPEncoder::new_lossless(&mut bytes);
    encoder.encode(picture, picture.width(), picture.height(), ExtendedColorType::Rgba8)?;
    Ok(format!("data:image/webp;base64,{}", STANDARD.encode(bytes)))
}

/// Nearest and farthest depth.
fn range(depth: &DepthMap) -> Option<[f32; 2]> {
    let hits = depth.z_depth.iter().copied().filter(|z| z.is_finite());
    hits.fold(None, |range, z| Some(range.map_or([z, z], |[near, far]: [f32; 2]| [near.min(z), far.max(z)])))
}

/// A depth on a scale from dark blue (far) to yellow (near).
fn depth_color(z: f32, range: Option<[f32; 2]>) -> Rgb<u8> {
    let share = range.map_or(0.5, |[near, far]| if far > near { (far - z) / (far - near) } else { 0.5 });
    // Viridis at six places.
    const SCALE: [[f32; 3]; 6] = [
        [68.0, 1.0, 84.0],
        [65.0, 68.0, 135.0],
        [42.0, 120.0, 142.0],
        [34.0, 168.0, 132.0],
        [122.0, 209.0, 81.0],
        [253.0, 231.0, 37.0],
    ];
    blend(&SCALE, share)
}

/// Mean difference over the channels as colour: clear, yellow, red, dark red.
fn error_map(photo: &RgbImage, render: &RgbImage) -> RgbaImage {
    const SCALE: [[f32; 3]; 4] = [[253.0, 224.0, 130.0], [250.0, 140.0, 60.0], [214.0, 40.0, 50.0], [110.0, 5.0, 60.0]];
    RgbaImage::from_fn(photo.width(), photo.height(), |u, v| {
        let (a, b) = (photo.get_pixel(u, v).0, render.get_pixel(u, v).0);
        let difference = (0..3).map(|c| f32::from(a[c].abs_diff(b[c]))).sum::<f32>() / (3.0 * 255.0);
        let share = (difference / LARGEST_ERROR).min(1.0);
        // Sixteen steps look the same and take a tenth of the bytes.
        let share = (share * 16.0).round() / 16.0;
        let Rgb([r, g, b]) = blend(&SCALE, share);
        Rgba([r, g, b, (255.0 * (share * 5.0).min(1.0)) as u8])
    })
}

/// A colour on a scale, from 0 to 1.
fn blend(scale: &[[f32; 3]], share: f32) -> Rgb<u8> {
    let at = share.clamp(0.0, 1.0) * (scale.len() - 1) as f32;
    let (below, rest) = ((at as usize).min(scale.len() - 2), at);
    let rest = rest - below as f32;
    Rgb([0, 1, 2].map(|c| ((1.0 - rest) * scale[below][c] + rest * scale[below + 1][c]).round() as u8))
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::shapes;
    use dvr_core::metrics::picture::MAX_PSNR;
    use dvr_core::{Camera, stored};
    use dvr_render::{MeshShader, render_view};
    use glam::DVec3;

    use super::*;

    #[test]
    fn a_right_mesh_differs_nowhere_and_a_wrong_photograph_is_seen() {
        let mesh = shapes::icosphere(4, 0.4);
        let shader = MeshShader::new(&mesh);
        let camera = Camera::look_at(48, 36, 50.0, 2.0 * DVec3::Z, DVec3::ZERO, DVec3::Y);
        let silhouette = render_view(&shader, &camera).mask;
        let view = |image: RgbImage| View::new("front", camera.clone(), stored(image), silhouette.clone());
        let right = view_pictures(&shader, &view(RgbImage::from_pixel(48, 36, Rgb([255; 3]))), 480).unwrap();
        assert_eq!((right.size, right.mask_iou), ((48, 36), Some(1.0)));
        assert!(right.psnr == MAX_PSNR && right.photo.starts_with("data:image/jpeg;base64,"));
        let [near, far] = right.depth_range.unwrap();
        assert!((near - 1.6).abs() < 0.02 && far < 2.0, "{near} {far}");
        let wrong = view_pictures(&shader, &view(RgbImage::from_pixel(48, 36, Rgb([0; 3]))), 24).unwrap();
        assert_eq!(wrong.size, (24, 18));
        assert!(wrong.psnr < 12.0 && wrong.error != right.error);
    }
}
