//! Writing a mesh with a texture: GLB or USDZ with the picture inside, or OBJ with its material and picture beside it.

use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, RgbImage, RgbaImage};

use super::glb::{StoredNormals, encode, encode_textured};
use super::io::{extension, stem, write_mesh};
use super::obj;
use super::textured_mesh::TexturedMesh;
use super::usdz::{self, Cover, Picture};
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

/// How a mesh is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeshStyle {
    /// What viewers do with its colours.
    pub look: Look,
    /// Whether numbers of a GLB are rounded and compressed (`EXT_meshopt_compression`): a quarter of the bytes or less, and programs that
    /// do not know the extension cannot open the file.
    pub is_compressed: bool,
}

impl From<Look> for MeshStyle {
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
/// OBJ with an MTL and a PNG of the same name beside it, or USDZ with the texture inside as JPEG. A mesh without texture,
/// and a PLY, which has none, are written as [`write_mesh`] does, a GLB compressed where the style says so.
///
/// A normal map lies in a GLB as PNG, with its tangents, and in a USDZ without them. An OBJ has none: its files know no
/// tangents, and programs differ on whether `map_Bump` is a height or a direction.
///
/// Each file appears whole or not at all; of an OBJ, the file that names the others comes last. OBJ knows no unlit
/// material: `illum 0` says it of [`Look::Baked`]. Nor does USDZ: there the texture shines by itself.
///
/// # Errors
/// When the extension is none of these, or a file cannot be written.
pub fn write_textured_mesh(path: impl AsRef<Path>, textured: &TexturedMesh, style: MeshStyle) -> Result<()> {
    let path = path.as_ref();
    let texture = textured.materials.first().and_then(|material| material.texture.as_ref());
    match (extension(path).as_str(), texture) {
        ("glb", Some(texture)) => write_glb(path, textured, &opaque(texture), style),
        ("glb", None) if style.is_compressed => {
            write_bytes_atomically(path, &encode(&textured.mesh, &stem(path), true))
        }
        ("obj", Some(texture)) => write_obj(path, textured, &opaque(texture), style.look),
        ("usdz", Some(texture)) => write_usdz(path, textured, &opaque(texture), style.look),
        _ => write_mesh(path, &textured.mesh),
    }
}

fn write_glb(path: &Path, textured: &TexturedMesh, texture: &RgbImage, style: MeshStyle) -> Result<()> {
    let (texture, name) = (jpeg(path, texture)?, stem(path));
    let Some(map) = &textured.normal_map else {
        let split = UvVertices::of(textured);
        return write_bytes_atomically(path, &encode_textured(&split, &texture, None, style, &name));
    };
    let (split, tangents) = UvVertices::with_tangents(textured, &map.corner_tangents);
    let normals = StoredNormals { tangents: &tangents, texture: png(path, &map.texture)? };
    write_bytes_atomically(path, &encode_textured(&split, &texture, Some(&normals), style, &name))
}

fn write_obj(path: &Path, textured: &TexturedMesh, picture: &RgbImage, look: Look) -> Result<()> {
    let split = UvVertices::of(textured);
    let (library, texture) = (path.with_extension("mtl"), path.with_extension("png"));
    write_rgb_png(&texture, picture)?;
    let illumination = if look == Look::Baked { 0 } else { 1 };
    let material =
        format!("# dvr\nnewmtl {TEXTURED}\nKd 1 1 1\nillum {illumination}\nmap_Kd {}\n", file_name(&texture));
    write_bytes_atomically(&library, material.as_bytes())?;
    write_bytes_atomically(path, &obj::encode_textured(&textured.mesh, &split, &file_name(&library), TEXTURED))
}

fn write_usdz(path: &Path, textured: &TexturedMesh, texture: &RgbImage, look: Look) -> Result<()> {
    let texture = jpeg(path, texture)?;
    let map = textured.normal_map.as_ref().map(|map| png(path, &map.texture)).transpose()?;
    let split = UvVertices::of(textured);
    let cover = Cover::Texture {
        uvs: &split.uvs,
        color: Picture { stored: &texture, name: "textures/color.jpg" },
        normals: map.as_ref().map(|stored| Picture { stored, name: "textures/normals.png" }),
    };
    write_bytes_atomically(path, &usdz::encode(path, &split.mesh, &cover, look)?)
}

fn opaque(texture: &RgbaImage) -> RgbImage {
    RgbImage::from_fn(texture.width(), texture.height(), |u, v| {
        let [r, g, b, _] = texture.get_pixel(u, v).0;
        image::Rgb([r, g, b])
    })
}

/// The one material of a mesh with a texture.
pub(super) const TEXTURED: &str = "textured";

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Without loss: directions are no colours, and JPEG would blur them.
fn png(path: &Path, picture: &RgbImage) -> Result<StoredTexture> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Best, FilterType::Adaptive)
        .write_image(picture, picture.width(), picture.height(), ExtendedColorType::Rgb8)
        .map_err(|error| Error::io(path, std::io::Error::other(error)))?;
    Ok(StoredTexture { bytes, mime_type: "image/png" })
}

fn jpeg(path: &Path, picture: &RgbImage) -> Result<StoredTexture> {
    let bytes = encoded_jpeg(picture, JPEG_QUALITY, None);
    let bytes = bytes.map_err(|error| Error::io(path, std::io::Error::other(error)))?;
    Ok(StoredTexture { bytes, mime_type: "image/jpeg" })
}
