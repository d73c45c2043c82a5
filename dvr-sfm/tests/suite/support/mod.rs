//! Photographs of a table with a ball on it, and their true cameras.

use std::path::Path;

use dvr_core::files::write_jpeg;
use dvr_core::{Camera, Ray};
use glam::{DVec2, DVec3};
use image::{Rgb, RgbImage};

/// Width, height and focal length in pixels.
pub const SIZE: (u32, u32) = (400, 300);
const FOCAL: f64 = 420.0;

/// A ball of radius 1 on a table of 8 by 8, both with a texture of many sizes, seen from a walk around it at two heights.
pub fn true_cameras(count: usize) -> Vec<Camera> {
    walk(count, |i| [0.45, 0.9][i % 2])
}

/// A camera that stands still, seen from the turntable before it.
pub fn cameras_of_turntable(count: usize) -> Vec<Camera> {
    walk(count, |_| 0.6)
}

fn walk(count: usize, height: impl Fn(usize) -> f64) -> Vec<Camera> {
    let eye = |i: usize| {
        let turn = std::f64::consts::TAU * i as f64 / count as f64;
        5.5 * DVec3::new(turn.cos(), height(i), turn.sin()).normalize()
    };
    (0..count).map(|i| Camera::look_at(SIZE.0, SIZE.1, FOCAL, eye(i), DVec3::new(0.0, -0.3, 0.0), DVec3::Y)).collect()
}

/// What a camera sees, four rays per pixel.
pub fn photograph(camera: &Camera) -> RgbImage {
    let shows = |p: DVec3| (p.x.abs() < 4.0 && p.z.abs() < 4.0).then(|| texture(p));
    picture(camera, &|_, ray| color(ray, &shows).unwrap_or(DVec3::splat(0.6)))
}

/// What a camera that stands still sees of the ball on a round turntable: the room behind it is the same in all pictures.
pub fn photograph_of_turntable(camera: &Camera) -> RgbImage {
    let shows = |p: DVec3| (p.x.hypot(p.z) < 1.7).then(|| texture(p));
    let room = |place: DVec2| texture(DVec3::new(place.x / 60.0, place.y / 60.0, 40.5));
    picture(camera, &|place, ray| color(ray, &shows).unwrap_or_else(|| room(place)))
}

/// A picture by the colours of four rays for each pixel, and of their places in it.
fn picture(camera: &Camera, color: &dyn Fn(DVec2, Ray) -> DVec3) -> RgbImage {
    RgbImage::from_fn(camera.width, camera.height, |u, v| {
        let mut sum = DVec3::ZERO;
        for (s, t) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
            let place = DVec2::new(f64::from(u) + s, f64::from(v) + t);
            sum += color(place, camera.ray(place));
        }
        Rgb((sum / 4.0).to_array().map(|c| (255.0 * c).round().clamp(0.0, 255.0) as u8))
    })
}

/// Writes the photographs of cameras as `0000.jpg`, `0001.jpg`, ...
pub fn write_photographs(folder: &Path, cameras: &[Camera], photograph: fn(&Camera) -> RgbImage) {
    std::fs::create_dir_all(folder).unwrap();
    for (i, camera) in cameras.iter().enumerate() {
        write_jpeg(&folder.join(format!("{i:04}.jpg")), &photograph(camera), 95, None).unwrap();
    }
}

/// The ball's colour, or what the table shows at the place of it that a ray meets; `None` where it meets nothing.
fn color(ray: Ray, table: &dyn Fn(DVec3) -> Option<DVec3>) -> Option<DVec3> {
    let (origin, d) = (ray.origin, ray.direction.normalize());
    let (b, c) = (origin.dot(d), origin.length_squared() - 1.0);
    let root = b * b - c;
    if root > 0.0 && -b - root.sqrt() > 0.0 {
        let p = origin + (-b - root.sqrt()) * d;
        return Some(texture(p * 1.3 + 17.0) * DVec3::new(1.0, 0.7, 0.6));
    }
    let t = (-1.0 - origin.y) / d.y;
    (t > 0.0).then(|| table(origin + t * d)).flatten()
}

/// Noise of five octaves.
fn texture(p: DVec3) -> DVec3 {
    let octave = |i: i32| (noise(p * 2f64.powi(i), i) - 0.5) * 0.75f64.powi(i);
    let sum: f64 = (0..5).map(octave).sum();
    let hue = noise(p * 1.7, 9);
    DVec3::splat((0.5 + 0.75 * sum).clamp(0.0, 1.0)) * DVec3::new(0.7 + 0.3 * hue, 0.9, 1.0 - 0.3 * hue)
}

/// Values at the corners of a lattice, interpolated.
fn noise(p: DVec3, seed: i32) -> f64 {
    let (cell, t) = (p.floor(), p - p.floor());
    let t = t * t * (3.0 - 2.0 * t);
    let corner = |i: usize| {
        let offset = DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64);
        let weight = offset * t + (1.0 - offset) * (1.0 - t);
        weight.x * weight.y * weight.z * hash(cell + offset, seed)
    };
    (0..8).map(corner).sum()
}

fn hash(p: DVec3, seed: i32) -> f64 {
    let mut h = seed as u64 ^ 0x9e37_79b9_7f4a_7c15;
    for x in p.to_array() {
        h = (h ^ (x as i64 as u64)).wrapping_mul(0xff51_afd7_ed55_8ccd);
        h ^= h >> 33;
    }
    (h >> 11) as f64 / (1u64 << 53) as f64
}
