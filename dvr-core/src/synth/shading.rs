//! What colour a point of a textured mesh has, and what light it sends to the camera.

use std::sync::LazyLock;

use glam::{DVec3, Vec2, Vec3};

use super::config::Lighting;
use crate::bilinear::Bilinear;
use crate::bvh::{Bvh, RayHit};
use crate::mesh::{Material, TexturedMesh};
use crate::ray::Ray;
use crate::srgb::srgb_to_linear;

/// Linear light of an sRGB byte.
static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0)));

/// How far a shadow ray starts above the surface, in object units: more than rounding, less than any detail.
const SHADOW_OFFSET: f64 = 1e-4;

/// Linear light that leaves the surface at a hit towards the ray's origin: Lambert, and Blinn's highlights.
///
/// Both sides of a face are lit alike: open meshes have no inside.
pub(super) fn radiance(textured: &TexturedMesh, bvh: &Bvh, lighting: &Lighting, ray: &Ray, hit: &RayHit) -> Vec3 {
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
    diffuse * albedo(textured, hit) + highlight
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

/// Linear base colour at a hit: material, texture and vertex colours multiplied. Alpha is passed over: the picture has
/// to show the geometry that the ground truth is taken from.
pub(super) fn albedo(textured: &TexturedMesh, hit: &RayHit) -> Vec3 {
    let face = hit.face as usize;
    let weights = hit.barycentric.map(|w| w as f32);
    let material = textured.face_materials.get(face).map_or(0, |&m| m as usize);
    let default = Material::default();
    let material = textured.materials.get(material).unwrap_or(&default);
    let mut color = linear(material.base_color);
    if let (Some(texture), Some(uvs)) = (&material.texture, textured.corner_uvs.get(face)) {
        color *= bilinear(texture, uvs.iter().zip(weights).map(|(&uv, w)| w * uv).sum());
    }
    if let Some(colors) = &textured.mesh.colors {
        let corners = textured.mesh.faces[face].map(|i| linear(colors[i as usize]));
        color *= corners.iter().zip(weights).map(|(&c, w)| w * c).sum::<Vec3>();
    }
    color
}

fn linear(srgb: [f32; 3]) -> Vec3 {
    Vec3::from(srgb.map(|c| srgb_to_linear(c.clamp(0.0, 1.0))))
}

/// The texture's linear colour, interpolated between the centres of its texels; it repeats beyond its edges.
fn bilinear(texture: &image::RgbaImage, uv: Vec2) -> Vec3 {
    let (width, height) = texture.dimensions();
    let uv = if uv.is_finite() { uv } else { Vec2::ZERO };
    // v points up, rows run down.
    let x = (uv.x - uv.x.floor()) * width as f32;
    let y = (1.0 - (uv.y - uv.y.floor())) * height as f32;
    let at = Bilinear::repeating(Vec2::new(x, y), (width, height));
    let [a, b, c, d] = at.pixels.map(|(u, v)| {
        let [r, g, b, _] = texture.get_pixel(u, v).0;
        Vec3::from([r, g, b].map(|byte| LINEAR[usize::from(byte)]))
    });
    // Not `Bilinear::value`, which rounds otherwise: the same seed makes the same pictures, bit for bit.
    let [s, t] = at.fraction;
    a.lerp(b, s).lerp(c.lerp(d, s), t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_texture_counts_from_its_bottom_left_corner_and_repeats() {
        let mut texture = image::RgbaImage::from_pixel(2, 2, image::Rgba([0, 0, 0, 255]));
        texture.put_pixel(0, 0, image::Rgba([255, 255, 255, 0])); // top left; its alpha does not matter
        let at = |u: f32, v: f32| bilinear(&texture, Vec2::new(u, v));
        assert_eq!(at(0.25, 0.75), Vec3::ONE);
        assert_eq!(at(0.25, 0.25), Vec3::ZERO);
        assert_eq!(at(1.25, -0.25), Vec3::ONE);
        assert_eq!(at(0.5, 0.75), Vec3::splat(0.5), "light is interpolated, not sRGB values");
        assert!(at(f32::NAN, 0.0).is_finite());
    }
}
