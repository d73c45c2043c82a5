//! What colour a point of a textured mesh has.

use std::sync::LazyLock;

use glam::{Vec2, Vec3};

use super::textured_mesh::{Material, TexturedMesh};
use crate::bilinear::Bilinear;
use crate::srgb::srgb_to_linear;

/// Linear light of an sRGB byte.
static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0)));

impl TexturedMesh {
    /// The material of a face; `None` where it is colourless: neither textured nor tinted.
    pub fn material(&self, face: usize) -> Option<&Material> {
        let index = self.face_materials.get(face).map_or(0, |&index| index as usize);
        self.materials
            .get(index)
            .filter(|material| **material != Material::white() && **material != Material::default())
    }

    /// Linear base colour of a face at the point with these barycentric coordinates: material, texture and vertex
    /// colours multiplied. Alpha is passed over: a picture has to show the geometry that ground truth is taken from.
    pub fn base_color(&self, face: usize, barycentric: [f64; 3]) -> Vec3 {
        let weights = barycentric.map(|weight| weight as f32);
        let index = self.face_materials.get(face).map_or(0, |&index| index as usize);
        let default = Material::default();
        let material = self.materials.get(index).unwrap_or(&default);
        let mut color = linear(material.base_color);
        if let (Some(texture), Some(uvs)) = (&material.texture, self.corner_uvs.get(face)) {
            color *= texel(texture, uvs.iter().zip(weights).map(|(&uv, w)| w * uv).sum());
        }
        if let Some(colors) = &self.mesh.colors {
            let corners = self.mesh.faces[face].map(|i| linear(colors[i as usize]));
            color *= corners.iter().zip(weights).map(|(&c, w)| w * c).sum::<Vec3>();
        }
        color
    }
}

fn linear(srgb: [f32; 3]) -> Vec3 {
    Vec3::from(srgb.map(|c| srgb_to_linear(c.clamp(0.0, 1.0))))
}

/// The texture's linear colour, interpolated between the centres of its texels; it repeats beyond its edges.
fn texel(texture: &image::RgbaImage, uv: Vec2) -> Vec3 {
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
        let at = |u: f32, v: f32| texel(&texture, Vec2::new(u, v));
        assert_eq!(at(0.25, 0.75), Vec3::ONE);
        assert_eq!(at(0.25, 0.25), Vec3::ZERO);
        assert_eq!(at(1.25, -0.25), Vec3::ONE);
        assert_eq!(at(0.5, 0.75), Vec3::splat(0.5), "light is interpolated, not sRGB values");
        assert!(at(f32::NAN, 0.0).is_finite());
    }
}
