//! Writing a mesh with a texture: GLB with the picture inside, or OBJ with its material and picture beside it.

use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, RgbImage};

use super::glb::{StoredNormals, encode, encode_textured};
use super::io::{extension, stem, unknown_format, write_mesh};
use super::obj;
use super::textured_mesh::TexturedMesh;
use super::uv_vertices::UvVertices;
use crate::error::{Error, Result};
use crate::files::{encoded_jpeg, write_bytes_atomically, write_rgb_png};

/// Quality of the JPEG inside a GLB, of 100.
const JPEG_QUALITY: u8 = 95;

/// What a viewer does with the colours of a texture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Look {
    /// Shows them as they are: the light of the photographs is in them (`KHR_materials_unlit`).
    #[default]
    Baked,
    /// Lights them, as a rough surface that is no metal.
    Material,
}

/// How a mesh is written as GLB.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GlbStyle {
    /// What viewers do with its colours.
    pub look: Look,
    /// Whether numbers are rounded and compressed (`EXT_meshopt_compression`): a quarter of the bytes or less, and programs that
    /// do not know the extension cannot open the file.
    pub is_compressed: bool,
}

impl From<Look> for GlbStyle {
    fn from(look: Look) -> Self {
        Self { look, is_compressed: false }
    }
}

/// A picture as it is stored inside a file.
pub(super) struct StoredTexture {
    pub bytes: Vec<u8>,
    pub mime_type: &'static str,
}

/// Writes a mesh with the texture of its first material, by the path's extension: GLB with the texture inside as JPEG,
/// or OBJ, with an MTL and a PNG of the same name beside it. A mesh without texture, and a PLY, which has none, are
/// written as [`write_mesh`] does, a GLB compressed where the style says so.
///
/// A normal map lies in a GLB as PNG, with its tangents. An OBJ has none: its files know no tangents, and programs differ
/// on whether `map_Bump` is a height or a direction.
///
/// Each file appears whole or not at all; of an OBJ, the file that names the others comes last. OBJ knows no unlit
/// material: `illum 0` says it of [`Look::Baked`].
///
/// # Errors
/// When the extension is none of these, or a file cannot be written.
pub fn write_textured_mesh(path: impl AsRef<Path>, textured: &TexturedMesh, style: impl Into<GlbStyle>) -> Result<()> {
    let (path, style) = (path.as_ref(), style.into());
    let texture = textured.materials.first().and_then(|material| material.texture.as_ref());
    let (Some(texture), "glb" | "obj") = (texture, extension(path).as_str()) else {
        if !["ply", "glb", "obj"].contains(&extension(path).as_str()) {
            return Err(unknown_format(path, &extension(path), "GLB, OBJ or PLY"));
        }
        if extension(path) == "glb" && style.is_compressed {
            return write_bytes_atomically(path, &encode(&textured.mesh, &stem(path), true));
        }
        return write_mesh(path, &textured.mesh);
    };
    let picture = RgbImage::from_fn(texture.width(), texture.height(), |u, v| {
        let [r, g, b, _] = texture.get_pixel(u, v).0;
        image::Rgb([r, g, b])
    });
    if extension(path) == "glb" {
        let texture = StoredTexture { bytes: jpeg(path, &picture)?, mime_type: "image/jpeg" };
        let name = stem(path);
        let Some(map) = &textured.normal_map else {
            return write_bytes_atomically(
                path,
                &encode_textured(&UvVertices::of(textured), &texture, None, style, &name),
            );
        };
        let (split, tangents) = UvVertices::with_tangents(textured, &map.corner_tangents);
        let stored = StoredTexture { bytes: png(path, &map.texture)?, mime_type: "image/png" };
        let normals = StoredNormals { tangents: &tangents, texture: stored };
        return write_bytes_atomically(path, &encode_textured(&split, &texture, Some(&normals), style, &name));
    }
    let split = UvVertices::of(textured);
    let (library, texture) = (path.with_extension("mtl"), path.with_extension("png"));
    write_rgb_png(&texture, &picture)?;
    let illumination = if style.look == Look::Baked { 0 } else { 1 };
    let material =
        format!("# dvr\nnewmtl {TEXTURED}\nKd 1 1 1\nillum {illumination}\nmap_Kd {}\n", file_name(&texture));
    write_bytes_atomically(&library, material.as_bytes())?;
    write_bytes_atomically(path, &obj::encode_textured(&textured.mesh, &split, &file_name(&library), TEXTURED))
}

/// The one material of a mesh with a texture.
pub(super) const TEXTURED: &str = "textured";

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Without loss: directions are no colours, and JPEG would blur them.
fn png(path: &Path, picture: &RgbImage) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Best, FilterType::Adaptive)
        .write_image(picture, picture.width(), picture.height(), ExtendedColorType::Rgb8)
        .map_err(|error| Error::io(path, std::io::Error::other(error)))?;
    Ok(bytes)
}

fn jpeg(path: &Path, picture: &RgbImage) -> Result<Vec<u8>> {
    encoded_jpeg(picture, JPEG_QUALITY, None).map_err(|error| Error::io(path, std::io::Error::other(error)))
}
