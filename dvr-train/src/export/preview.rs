//! The preview sheet: what went in and what came out, side by side.

use dvr_core::{Camera, DepthMap, View};
use dvr_render::{Rendering, Shader, render_view_supersampled};
use glam::{DQuat, DVec3};
use image::imageops::{FilterType, replace, resize};
use image::{Rgb, Rgb32FImage, RgbImage};

/// Gap between pictures, pixels.
const GAP: u32 = 4;

/// Distance of an orbit's camera from the object's middle, in edges of the unit cube.
const ORBIT_DISTANCE: f64 = 2.2;

/// Rays along the edge of a pixel of a picture that is smaller than its photograph.
const RAYS_PER_EDGE: u32 = 3;

/// A sheet with a row a view: input (background whitened by the mask), render, depth, normals; at most `max_width`
/// pixels a picture. Near is bright in depth; normals are in the camera's frame (x right, y up, z towards the viewer).
pub fn preview_sheet(shader: &dyn Shader, views: &[&View], max_width: u32) -> RgbImage {
    let rows: Vec<Vec<RgbImage>> = views.iter().map(|view| preview_row(shader, view, max_width)).collect();
    sheet(&rows)
}

/// One row of a [`preview_sheet`].
pub fn preview_row(shader: &dyn Shader, view: &View, max_width: u32) -> Vec<RgbImage> {
    let (camera, rendering) = render_limited(shader, &view.camera, max_width);
    let input = resize(&whitened(view), camera.width, camera.height, FilterType::Triangle);
    vec![input, to_rgb8(&rendering.color), depth_picture(&rendering.depth), normal_picture(&rendering, &camera)]
}

/// A camera on a circle around the object of the unit cube, all of which is in the square picture of `size` pixels.
///
/// `turn` and `elevation` are in degrees, `up` is the axis of the circle.
pub fn orbit_camera(size: u32, turn: f64, elevation: f64, up: DVec3) -> Camera {
    // The ball around the unit cube, of radius sqrt(3)/2, fits into the picture.
    let half_angle = (0.75f64.sqrt() / ORBIT_DISTANCE).asin();
    let focal = 0.5 * f64::from(size) / half_angle.tan();
    let level = DQuat::from_axis_angle(up, turn.to_radians()) * up.any_orthonormal_vector();
    let (sin, cos) = elevation.to_radians().sin_cos();
    Camera::look_at(size, size, focal, ORBIT_DISTANCE * (cos * level + sin * up), DVec3::ZERO, up)
}

/// A camera for a picture of at most `max_width` pixels.
pub fn limited(camera: &Camera, max_width: u32) -> Camera {
    if camera.width <= max_width {
        return camera.clone();
    }
    let height = (u64::from(camera.height) * u64::from(max_width) / u64::from(camera.width)).max(1) as u32;
    camera.resized(max_width, height)
}

/// What a camera sees in a picture of at most `max_width` pixels, and the camera of that picture. Where it is smaller than
/// the camera's own, colours are means over several rays per pixel, as those of a photograph that is shrunk are over its
/// pixels: fine texture would flicker, and figures would say so.
pub fn render_limited(shader: &dyn Shader, camera: &Camera, max_width: u32) -> (Camera, Rendering) {
    let small = limited(camera, max_width);
    let side = if small.width < camera.width { RAYS_PER_EDGE } else { 1 };
    let rendering = render_view_supersampled(shader, &small, side);
    (small, rendering)
}

/// The view's photograph with everything but the object white.
pub fn whitened(view: &View) -> RgbImage {
    RgbImage::from_fn(view.image.width(), view.image.height(), |u, v| {
        if view.is_object(u, v) { *view.image.get_pixel(u, v) } else { Rgb([255; 3]) }
    })
}

/// Colours in `[0, 1]` to bytes, rounded.
pub fn to_rgb8(image: &Rgb32FImage) -> RgbImage {
    RgbImage::from_fn(image.width(), image.height(), |u, v| {
        Rgb(image.get_pixel(u, v).0.map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8))
    })
}

/// Depth as grey, near bright, background white; a map of one depth is mid grey.
pub fn depth_picture(depth: &DepthMap) -> RgbImage {
    let finite = || depth.z_depth.iter().copied().filter(|z| z.is_finite());
    let (near, far) = (finite().fold(f32::INFINITY, f32::min), finite().fold(f32::NEG_INFINITY, f32::max));
    RgbImage::from_fn(depth.width, depth.height, |u, v| {
        let z = depth.get(u, v);
        if !z.is_finite() {
            return Rgb([255; 3]);
        }
        let share = if far > near { (far - z) / (far - near) } else { 0.5 };
        Rgb([(40.0 + 190.0 * share).round() as u8; 3])
    })
}

/// Normals as colours, `(n + 1) / 2` in the camera's frame with y up and z towards the viewer; background white.
pub fn normal_picture(rendering: &Rendering, camera: &Camera) -> RgbImage {
    RgbImage::from_fn(camera.width, camera.height, |u, v| {
        if !rendering.mask.is_object(u, v) {
            return Rgb([255; 3]);
        }
        let normal = glam::Vec3::from(rendering.normal.get_pixel(u, v).0).as_dvec3();
        let n = camera.rotation * normal;
        Rgb([n.x, -n.y, -n.z].map(|c| ((0.5 * c + 0.5).clamp(0.0, 1.0) * 255.0).round() as u8))
    })
}

/// Pictures in rows and columns on white.
pub fn sheet(rows: &[Vec<RgbImage>]) -> RgbImage {
    let width = rows.iter().map(|row| row.iter().map(|p| p.width() + GAP).sum::<u32>() + GAP).max().unwrap_or(1);
    let height = rows.iter().map(|row| row.iter().map(|p| p.height()).max().unwrap_or(0) + GAP).sum::<u32>() + GAP;
    let mut paper = RgbImage::from_pixel(width, height, Rgb([255; 3]));
    let mut y = GAP;
    for row in rows {
        let mut x = GAP;
        for picture in row {
            replace(&mut paper, picture, i64::from(x), i64::from(y));
            x += picture.width() + GAP;
        }
        y += row.iter().map(|p| p.height()).max().unwrap_or(0) + GAP;
    }
    paper
}
