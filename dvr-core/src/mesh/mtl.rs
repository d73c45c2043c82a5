//! Materials of Wavefront OBJ files: the base colour and its texture; everything else in a library is about looks that
//! a Lambert surface does not have.

use std::path::Path;

use glam::Vec2;

use super::texture_file::Textures;
use super::textured_mesh::Material;

/// A material, and how its `map_Kd` options change the texture coordinates: `uv * uv_scale + uv_offset`.
pub(super) struct ObjMaterial {
    pub material: Material,
    pub uv_scale: Vec2,
    pub uv_offset: Vec2,
}

impl Default for ObjMaterial {
    fn default() -> Self {
        Self { material: Material::default(), uv_scale: Vec2::ONE, uv_offset: Vec2::ZERO }
    }
}

/// The materials of a library with their names, in order. Lines that make no sense are passed over.
pub(super) fn read(
    folder: &Path,
    bytes: &[u8],
    textures: &mut Textures,
    warnings: &mut Vec<String>,
) -> Vec<(String, ObjMaterial)> {
    let mut materials: Vec<(String, ObjMaterial)> = Vec::new();
    for line in String::from_utf8_lossy(bytes).lines() {
        let line = line.trim();
        let keyword = line.split_whitespace().next().unwrap_or_default();
        let rest = line[keyword.len()..].trim();
        if keyword == "newmtl" {
            materials.push((rest.to_owned(), ObjMaterial::default()));
        }
        let Some((_, current)) = materials.last_mut() else { continue };
        match keyword {
            "Kd" => {
                if let Some(color) = base_color(rest) {
                    current.material.base_color = color;
                }
            }
            "map_Kd" | "map_kd" => texture(current, folder, rest, textures, warnings),
            _ => {}
        }
    }
    for (_, material) in &mut materials {
        // Exporters write black where the texture alone gives the colour; multiplied, it would hide the texture.
        if material.material.texture.is_some() && material.material.base_color == [0.0; 3] {
            material.material.base_color = [1.0; 3];
        }
    }
    materials
}

/// `r g b`, or one value for all three. Spectral curves and CIE XYZ are not read.
fn base_color(values: &str) -> Option<[f32; 3]> {
    let values: Vec<f32> = values.split_whitespace().map_while(|w| w.parse().ok()).collect();
    let color = match values[..] {
        [r, g, b, ..] => [r, g, b],
        [grey, ..] => [grey; 3],
        [] => return None,
    };
    Some(color.map(|c| if c.is_finite() { c.clamp(0.0, 1.0) } else { 0.0 }))
}

/// `[-option values]... file name`, where the file name may hold spaces.
fn texture(
    material: &mut ObjMaterial,
    folder: &Path,
    statement: &str,
    textures: &mut Textures,
    warnings: &mut Vec<String>,
) {
    let mut rest = statement;
    while let Some(option) = rest.strip_prefix('-').and_then(|r| r.split_whitespace().next()) {
        rest = rest[1 + option.len()..].trim_start();
        let values: Vec<f32> = rest.split_whitespace().map_while(|w| w.parse().ok()).take(3).collect();
        let count = match option {
            "o" | "s" | "t" => values.len(),
            "mm" => 2,
            _ => 1,
        };
        match (option, &values[..]) {
            ("o", [u, others @ ..]) => material.uv_offset = Vec2::new(*u, others.first().copied().unwrap_or(0.0)),
            ("s", [u, others @ ..]) => material.uv_scale = Vec2::new(*u, others.first().copied().unwrap_or(1.0)),
            _ => {}
        }
        for _ in 0..count {
            rest = rest.split_once(char::is_whitespace).map_or("", |(_, after)| after.trim_start());
        }
    }
    if !rest.is_empty() {
        material.material.texture = textures.read(folder, rest, warnings);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder_with_texture(name: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        image::RgbaImage::from_pixel(2, 1, image::Rgba([9, 8, 7, 255])).save(folder.path().join(name)).unwrap();
        folder
    }

    #[test]
    fn options_of_a_texture_are_not_part_of_its_name() {
        let folder = folder_with_texture("two words.png");
        let mut warnings = Vec::new();
        let text = b"newmtl a\nKd 0.5\nmap_Kd -s 2 3 1 -blendu on -o 0.25 -mm 0 1 two words.png\n";
        let (name, material) = read(folder.path(), text, &mut Textures::default(), &mut warnings).remove(0);
        assert_eq!((name.as_str(), warnings.len()), ("a", 0));
        assert_eq!(material.material.base_color, [0.5; 3]);
        assert_eq!((material.uv_scale, material.uv_offset), (Vec2::new(2.0, 3.0), Vec2::new(0.25, 0.0)));
        assert_eq!(material.material.texture.unwrap().get_pixel(1, 0).0, [9, 8, 7, 255]);
    }

    #[test]
    fn a_texture_is_found_by_its_name_when_the_path_is_of_another_machine() {
        let folder = folder_with_texture("Wood.png");
        let text = br"newmtl a
            map_Kd C:\Users\someone\textures\wood.PNG";
        let mut warnings = Vec::new();
        let materials = read(folder.path(), text, &mut Textures::default(), &mut warnings);
        assert!(materials[0].1.material.texture.is_some(), "{warnings:?}");
    }

    #[test]
    fn a_missing_texture_is_told_and_the_colour_stays() {
        let folder = tempfile::tempdir().unwrap();
        let mut warnings = Vec::new();
        let materials =
            read(folder.path(), b"newmtl a\nmap_Kd none.png\nKd 0 1 0\n", &mut Textures::default(), &mut warnings);
        assert_eq!(materials[0].1.material, Material { base_color: [0.0, 1.0, 0.0], texture: None });
        assert!(warnings[0].contains("none.png"));
    }

    #[test]
    fn a_black_colour_does_not_hide_the_texture() {
        let folder = folder_with_texture("t.png");
        let materials =
            read(folder.path(), b"newmtl a\nKd 0 0 0\nmap_Kd t.png\n", &mut Textures::default(), &mut Vec::new());
        assert_eq!(materials[0].1.material.base_color, [1.0; 3]);
    }

    #[test]
    fn nonsense_is_passed_over() {
        let text = b"Kd 1 1 1\nnewmtl a\nKd spectral red.rfl\nmap_Kd -s\nmap_Kd\n\xff\xfe\n";
        let materials = read(Path::new("."), text, &mut Textures::default(), &mut Vec::new());
        assert_eq!(materials[0].1.material, Material::default());
    }
}
