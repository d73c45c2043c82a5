//! Base colours and base colour textures of a glTF document.

use std::collections::HashMap;
use std::sync::Arc;

use ::gltf::Document;
use glam::Vec2;

use super::accessor::{GltfBuffers, percent_decoded, read_uri};
use super::texture_file::Textures;
use super::textured_mesh::Material;
use crate::srgb::linear_to_srgb;

/// The document's materials in order, and white, the specification's default material, as the last one.
pub(super) fn read_materials(document: &Document, buffers: &GltfBuffers, warnings: &mut Vec<String>) -> Vec<Material> {
    let (mut images, mut textures) = (HashMap::new(), Textures::default());
    let mut materials: Vec<Material> = document
        .materials()
        .map(|material| {
            let pbr = material.pbr_metallic_roughness();
            let [r, g, b, _] = pbr.base_color_factor();
            let source = pbr.base_color_texture().and_then(|info| info.texture().source());
            let texture = source.and_then(|image| {
                let index = image.index();
                images
                    .entry(index)
                    .or_insert_with(|| read_image(document, index, buffers, &mut textures, warnings))
                    .clone()
            });
            Material { base_color: [r, g, b].map(|c| linear_to_srgb(c.clamp(0.0, 1.0))), texture }
        })
        .collect();
    materials.push(Material::white());
    materials
}

fn read_image(
    document: &Document,
    index: usize,
    buffers: &GltfBuffers,
    textures: &mut Textures,
    warnings: &mut Vec<String>,
) -> Option<Arc<image::RgbaImage>> {
    let json = document.as_json().images.get(index)?;
    let bytes = match (&json.uri, json.buffer_view) {
        (Some(uri), _) if !uri.starts_with("data:") => {
            return textures.read(buffers.folder(), &percent_decoded(uri), warnings);
        }
        (Some(uri), _) => read_uri(buffers.folder(), uri),
        (None, Some(view)) => match document.views().nth(view.value()) {
            Some(view) => buffers.view(&view).map(<[u8]>::to_vec),
            None => Err("has no data".to_owned()),
        },
        (None, None) => Err("has no data".to_owned()),
    };
    textures.decode(&format!("{index}"), bytes, warnings)
}

/// How a material's texture coordinates are changed (`KHR_texture_transform`), and which set they are taken from.
#[derive(Clone, Copy)]
pub(super) struct UvTransform {
    /// `TEXCOORD_n`.
    pub set: u32,
    offset: Vec2,
    rotation: f32,
    scale: Vec2,
}

impl Default for UvTransform {
    fn default() -> Self {
        Self { set: 0, offset: Vec2::ZERO, rotation: 0.0, scale: Vec2::ONE }
    }
}

impl UvTransform {
    /// Translation * rotation * scale of a coordinate from the file; the rotation is the extension's, which is
    /// clockwise in a plane whose second axis points up.
    pub fn apply(&self, uv: Vec2) -> Vec2 {
        let (sin, cos) = self.rotation.sin_cos();
        let scaled = uv * self.scale;
        self.offset + Vec2::new(cos * scaled.x + sin * scaled.y, -sin * scaled.x + cos * scaled.y)
    }
}

/// The transform of a material's base colour texture.
pub(super) fn uv_transform(material: &::gltf::Material) -> UvTransform {
    let Some(info) = material.pbr_metallic_roughness().base_color_texture() else { return UvTransform::default() };
    let set = info.tex_coord();
    match info.texture_transform() {
        None => UvTransform { set, ..UvTransform::default() },
        Some(transform) => UvTransform {
            set: transform.tex_coord().unwrap_or(set),
            offset: transform.offset().into(),
            rotation: transform.rotation(),
            scale: transform.scale().into(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_is_the_one_of_the_extension() {
        // KHR_texture_transform's matrix for the rotation a is ((cos a, sin a), (-sin a, cos a)).
        let transform =
            UvTransform { rotation: std::f32::consts::FRAC_PI_2, scale: Vec2::splat(2.0), ..UvTransform::default() };
        assert!((transform.apply(Vec2::new(1.0, 0.0)) - Vec2::new(0.0, -2.0)).length() < 1e-6);
        assert!((transform.apply(Vec2::new(0.0, 1.0)) - Vec2::new(2.0, 0.0)).length() < 1e-6);
    }
}
