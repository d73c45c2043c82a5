//! Shapes by their logits, and their extraction.

use dvr_render::extract::{ExtractSettings, Extraction, extract_mesh};
use glam::{Mat3, Vec3};

use super::topology::assert_watertight;

/// A grid of `resolution` cells per edge, after `upsampling_steps` refinements.
pub fn settings(resolution: usize, upsampling_steps: usize) -> ExtractSettings {
    ExtractSettings { resolution, upsampling_steps, ..Default::default() }
}

/// A field from its logit at a point.
pub fn field(logit: impl Fn(Vec3) -> f32) -> impl Fn(&[Vec3]) -> Vec<f32> {
    move |points| points.iter().map(|&p| logit(p)).collect()
}

/// The mesh of a logit, which is checked to be watertight.
pub fn extract(logit: impl Fn(Vec3) -> f32, settings: &ExtractSettings) -> Extraction {
    let extraction = extract_mesh(&field(logit), settings, &[]).unwrap();
    assert_watertight(&extraction.mesh);
    extraction
}

/// A ball.
pub fn sphere(center: Vec3, radius: f32) -> impl Fn(Vec3) -> f32 + Copy {
    move |p| radius - p.distance(center)
}

/// A torus of radii 0.3 and 0.1, a little off the middle.
pub fn torus(p: Vec3) -> f32 {
    let p = p - Vec3::new(0.013, -0.007, 0.021);
    0.1 - glam::Vec2::new(glam::Vec2::new(p.x, p.z).length() - 0.3, p.y).length()
}

/// A minimal surface, as a thick sheet.
pub fn gyroid(p: Vec3) -> f32 {
    let q = p * 9.0 + 0.3;
    (q.x.sin() * q.y.cos() + q.y.sin() * q.z.cos() + q.z.sin() * q.x.cos()).abs().mul_add(-1.0, 0.5)
}

/// A plate of the given thickness, turned out of the grid's axes.
pub fn tilted_plate(thickness: f32) -> impl Fn(Vec3) -> f32 + Copy {
    let turn = Mat3::from_euler(glam::EulerRot::XYZ, 0.3, 0.2, 0.1);
    move |p| {
        let q = (turn * p).abs() - Vec3::new(0.35, 0.3, 0.5 * thickness);
        -q.max_element()
    }
}

/// Random signs on a grid: a hash of the node's index; every fourth node is exactly at the level.
/// About `share` of the other nodes are inside.
pub fn noise(seed: u32, cells: f32, share: f32) -> impl Fn(Vec3) -> f32 {
    move |p: Vec3| {
        let node = ((p / 1.1 + 0.5) * cells).round().as_uvec3();
        let mut hash = (node.x * 73_856_093) ^ (node.y * 19_349_663) ^ (node.z * 83_492_791) ^ (seed * 40_503);
        for _ in 0..3 {
            hash = (hash ^ hash >> 15).wrapping_mul(0x2c1b_3c6d);
        }
        if hash.is_multiple_of(4) { 0.0 } else { (hash >> 8) as f32 / (1 << 24) as f32 + share - 1.0 }
    }
}
