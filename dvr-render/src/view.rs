//! Images: what a camera would see.

use dvr_core::{Camera, DepthMap, Mask, Ray};
use glam::Vec3;
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
    render_view_supersampled(shader, camera, 1)
}

/// The same with colours that are means over `side` x `side` rays of each pixel (supersampling), as the pixels of a
/// photograph that is shrunk are. Where the surface is, and what it is turned to, is what the ray in the middle of these
/// meets.
pub fn render_view_supersampled(shader: &dyn Shader, camera: &Camera, side: u32) -> Rendering {
    let (width, height) = (camera.width, camera.height);
    let mut rendering = Rendering {
        color: Rgb32FImage::from_pixel(width, height, image::Rgb([1.0; 3])),
        mask: Mask::from(GrayImage::new(width, height)),
        depth: DepthMap { width, height, z_depth: vec![f32::INFINITY; width as usize * height as usize] },
        normal: Rgb32FImage::new(width, height),
    };
    let side = side.max(1);
    let fine = camera.resized(width * side, height * side);
    let per_pixel = side * side;
    let rows = (BAND_RAYS / (width * per_pixel).max(1)).max(1);
    for top in (0..height).step_by(rows as usize) {
        let bottom = height.min(top + rows);
        let pixels = || (top..bottom).flat_map(|v| (0..width).map(move |u| (u, v)));
        let rays_of = |(u, v)| (0..per_pixel).map(move |k| (side * u + k % side, side * v + k / side));
        let rays: Vec<Ray> = pixels().flat_map(rays_of).map(|(u, v)| fine.pixel_ray(u, v)).collect();
        for ((u, v), shaded) in pixels().zip(shader.shade(&rays).chunks(per_pixel as usize)) {
            let colors = shaded.iter().map(|shaded| shaded.map_or(Vec3::ONE, |shaded| shaded.color.into()));
            let color = colors.sum::<Vec3>() / per_pixel as f32;
            rendering.color.put_pixel(u, v, image::Rgb(color.to_array()));
            let Some(middle) = shaded[shaded.len() / 2] else { continue };
            rendering.normal.put_pixel(u, v, image::Rgb(middle.normal));
            rendering.mask.coverage.put_pixel(u, v, image::Luma([255]));
            rendering.depth.z_depth[v as usize * width as usize + u as usize] = middle.depth;
        }
    }
    rendering
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::shade::Shaded;

    /// A wall that fills the left half of the picture and has stripes along its height, white and black, one per row of
    /// a picture of 12 rows.
    struct Stripes;

    impl Shader for Stripes {
        fn shade(&self, rays: &[Ray]) -> Vec<Option<Shaded>> {
            let stripe = |ray: &Ray| {
                let [x, y] = [ray.direction.x, ray.direction.y].map(|c| c / ray.direction.z);
                let row = ((y + 0.5) * 12.0).floor() as i64;
                let color = if row.rem_euclid(2) == 0 { [1.0; 3] } else { [0.0; 3] };
                (x < 0.0).then_some(Shaded { depth: 2.0, color, normal: [0.0, 0.0, -1.0] })
            };
            rays.iter().map(stripe).collect()
        }
    }

    #[test]
    fn colours_of_a_pixel_are_means_and_all_else_is_that_of_its_middle() {
        // Four rows of three stripes each: a single ray sees one stripe, nine rays see all three of them.
        let camera = Camera::look_at(4, 4, 4.0, DVec3::ZERO, DVec3::Z, -DVec3::Y);
        let one = render_view(&Stripes, &camera);
        let nine = render_view_supersampled(&Stripes, &camera, 3);
        for v in 0..4 {
            let of = |rendering: &Rendering, u| rendering.color.get_pixel(u, v).0[0];
            let is_black = v % 2 == 0;
            assert_eq!(of(&one, 0), if is_black { 0.0 } else { 1.0 }, "row {v}");
            let mean = if is_black { 2.0 / 3.0 } else { 1.0 / 3.0 };
            assert!((of(&nine, 0) - mean).abs() < 1e-6, "row {v}: {}", of(&nine, 0));
            assert_eq!((of(&one, 3), of(&nine, 3)), (1.0, 1.0), "background");
        }
        assert!(one.mask.object_pixels() == 8 && one.mask == nine.mask);
        assert!(one.depth == nine.depth && one.normal == nine.normal);
    }
}
