//! What light a point of a textured mesh sends to the camera.

use glam::{DVec3, Vec3};

use super::config::Lighting;
use super::gloss::{diffuse_share, mirrored};
use crate::bvh::{Bvh, RayHit};
use crate::mesh::TexturedMesh;
use crate::ray::Ray;

/// How far a shadow ray starts above the surface, in object units: more than rounding, less than any detail.
const SHADOW_OFFSET: f64 = 1e-4;

/// Linear light that leaves the surface at a hit towards the ray's origin: Lambert, Blinn's highlights, and what a glossy
/// surface mirrors. `sample` is the number of the pixel's sample.
///
/// Both sides of a face are lit alike: open meshes have no inside.
pub(super) fn radiance(
    textured: &TexturedMesh,
    bvh: &Bvh,
    lighting: &Lighting,
    ray: &Ray,
    hit: &RayHit,
    sample: usize,
) -> Vec3 {
    let to_camera = -ray.direction.normalize();
    let (face_normal, normal) = normals(textured, hit, to_camera);
    let mut diffuse = lighting.ambient + lighting.headlight * normal.dot(to_camera).max(0.0) as f32;
    let mut highlight = lighting.specular * lighting.headlight * blinn(normal, to_camera, to_camera, lighting);
    for light in &lighting.lights {
        let to_light = light.direction.normalize_or_zero();
        let cosine = normal.dot(to_light);
        if cosine <= 0.0 {
            continue;
        }
        let start = ray.at(hit.ray_depth) + SHADOW_OFFSET * face_normal;
        if lighting.shadows && bvh.any_hit(&Ray { origin: start, direction: to_light }, 0.0, f64::INFINITY) {
            continue;
        }
        diffuse += light.intensity * cosine as f32;
        highlight += lighting.specular * light.intensity * blinn(normal, to_light, to_camera, lighting);
    }
    let base_color = textured.base_color(hit.face as usize, hit.barycentric);
    match &lighting.gloss {
        None => diffuse * base_color + highlight,
        Some(gloss) => {
            diffuse_share(gloss) * diffuse * base_color
                + highlight
                + mirrored(lighting, gloss, base_color, normal, to_camera, sample)
        }
    }
}

/// `(n . h)^s` with the half vector `h` (Blinn 1977).
fn blinn(normal: DVec3, to_light: DVec3, to_camera: DVec3, lighting: &Lighting) -> f32 {
    (normal.dot((to_light + to_camera).normalize_or_zero()).max(0.0) as f32).powf(lighting.shininess)
}

/// The face's normal and the interpolated one, both turned to the side that the camera sees.
fn normals(textured: &TexturedMesh, hit: &RayHit, to_camera: DVec3) -> (DVec3, DVec3) {
    let mesh = &textured.mesh;
    let [a, b, c] = mesh.triangle(hit.face as usize).map(Vec3::as_dvec3);
    let face_normal = (b - a).cross(c - a).normalize_or_zero();
    let face_normal = if face_normal.dot(to_camera) < 0.0 { -face_normal } else { face_normal };
    let smooth = mesh.normals.as_ref().map(|normals| {
        let corners = mesh.faces[hit.face as usize].map(|i| normals[i as usize].as_dvec3());
        corners.iter().zip(hit.barycentric).map(|(&n, w)| w * n).sum::<DVec3>()
    });
    let normal = smooth.unwrap_or(face_normal).normalize_or(face_normal);
    (face_normal, if normal.dot(face_normal) < 0.0 { -normal } else { normal })
}
