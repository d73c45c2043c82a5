//! The mesh of a run as a page shows it: with what is known of its vertices, and with its texture where it has one.

use std::sync::Arc;

use dvr_core::Similarity;
use dvr_core::mesh::{Mesh, TexturedMesh, read_mesh};
use dvr_train::RunFolder;
use image::imageops::{FilterType, resize};
use image::{Rgb, RgbImage, RgbaImage};

use crate::error::Result;
use crate::pictures::jpeg;

/// Largest distance, as a share of the largest coordinate, of corners that are the same in two files.
const SAME: f32 = 1e-6;

/// The mesh of a run's folder, which `to_export` took from object space, in object space again: vertices as `mesh.ply` has them, and the texture of `mesh.glb` in place of
/// their colours, where it has one and the faces are the same. Empty where the run has no mesh.
///
/// # Errors
/// When a file is damaged.
pub fn read_run_mesh(folder: &RunFolder, to_export: &Similarity) -> Result<TexturedMesh> {
    let (ply, glb) = (folder.mesh_ply(), folder.mesh_glb());
    if !ply.is_file() {
        return Ok(TexturedMesh::default());
    }
    let mesh = read_mesh(ply)?.mesh;
    let textured = if glb.is_file() { read_mesh(glb)? } else { TexturedMesh::default() };
    let shown = match texture_of(&textured) {
        Some(_) if has_same_faces(&mesh, &textured.mesh) => {
            TexturedMesh { mesh: Mesh { colors: None, ..mesh }, ..textured }
        }
        _ => TexturedMesh { mesh, ..TexturedMesh::default() },
    };
    Ok(shown.transformed(&to_export.inverse()))
}

/// The texture of a mesh whose faces all have it.
pub fn texture_of(mesh: &TexturedMesh) -> Option<&Arc<RgbaImage>> {
    // Readers may give materials that no face has.
    let shown = mesh.face_materials.first().copied().unwrap_or(0);
    let is_one = !mesh.corner_uvs.is_empty() && mesh.face_materials.iter().all(|&material| material == shown);
    mesh.materials.get(shown as usize).filter(|_| is_one)?.texture.as_ref()
}

/// A texture as a `data:` address, with at most so many texels along an edge.
///
/// # Errors
/// When it cannot be encoded.
pub fn page_texture(texture: &RgbaImage, most: u32) -> Result<String> {
    let (width, height) = texture.dimensions();
    let opaque = RgbImage::from_fn(width, height, |u, v| {
        let [r, g, b, _] = texture.get_pixel(u, v).0;
        Rgb([r, g, b])
    });
    let largest = width.max(height);
    if largest <= most {
        return jpeg(&opaque);
    }
    let [width, height] =
        [width, height].map(|side| (u64::from(side) * u64::from(most)).div_ceil(largest.into()) as u32);
    jpeg(&resize(&opaque, width, height, FilterType::Triangle))
}

/// Whether two meshes have the same faces in the same order, however their vertices are numbered.
fn has_same_faces(a: &Mesh, b: &Mesh) -> bool {
    let Some((low, high)) = a.bounds() else { return b.is_empty() };
    let most = SAME * low.abs().max(high.abs()).max_element();
    let is_same = |face: usize| {
        let (a, b) = (a.triangle(face), b.triangle(face));
        (0..3).all(|k| (a[k] - b[k]).abs().max_element() <= most)
    };
    a.faces.len() == b.faces.len() && (0..a.faces.len()).all(is_same)
}

#[cfg(test)]
mod tests {
    use base64::Engine;
    use base64::engine::general_purpose::STANDARD;
    use dvr_core::mesh::{Look, Material, shapes, write_mesh, write_textured_mesh};
    use glam::{DVec3, Vec2};
    use image::Rgba;

    use super::*;

    /// A ball whose faces have a texture that is red on the left and green on the right.
    fn ball() -> TexturedMesh {
        let mesh = Mesh { colors: None, ..shapes::icosphere(1, 0.4) };
        let side = |face: usize| Vec2::new(if face.is_multiple_of(2) { 0.25 } else { 0.75 }, 0.5);
        let picture =
            RgbaImage::from_fn(64, 32, |u, _| if u < 32 { Rgba([255, 0, 0, 255]) } else { Rgba([0, 255, 0, 255]) });
        TexturedMesh {
            corner_uvs: (0..mesh.faces.len()).map(|face| [side(face); 3]).collect(),
            mesh,
            materials: vec![Material { base_color: [1.0; 3], texture: Some(Arc::new(picture)) }],
            ..TexturedMesh::default()
        }
    }

    #[test]
    fn the_texture_is_that_of_the_glb_where_both_files_have_the_same_faces() {
        let directory = tempfile::tempdir().unwrap();
        let folder = RunFolder::new(directory.path());
        let to_world = Similarity { scale: 2.0, translation: DVec3::X, ..Similarity::default() };
        assert!(read_run_mesh(&folder, &to_world).unwrap().mesh.is_empty());

        let ball = ball();
        let mut mesh = ball.mesh.clone();
        mesh.colors = Some(vec![[0.5; 3]; mesh.vertices.len()]);
        write_mesh(folder.mesh_ply(), &mesh.clone().transformed(&to_world)).unwrap();
        let read = read_run_mesh(&folder, &to_world).unwrap();
        assert!(texture_of(&read).is_none() && read.mesh.colors.is_some());

        write_textured_mesh(folder.mesh_glb(), &ball.clone().transformed(&to_world), Look::Baked.into()).unwrap();
        let read = read_run_mesh(&folder, &to_world).unwrap();
        assert!(texture_of(&read).is_some() && read.mesh.colors.is_none(), "colours of vertices would multiply");
        assert_eq!(read.corner_uvs.len(), ball.corner_uvs.len());
        assert!((read.corner_uvs[1][2] - ball.corner_uvs[1][2]).length() < 1e-6);
        assert!(has_same_faces(&read.mesh, &ball.mesh));

        let other = TexturedMesh {
            mesh: Mesh { vertices: ball.mesh.vertices.iter().map(|v| 1.1 * *v).collect(), ..ball.mesh.clone() },
            ..ball
        };
        write_textured_mesh(folder.mesh_glb(), &other, Look::Baked.into()).unwrap();
        assert!(texture_of(&read_run_mesh(&folder, &to_world).unwrap()).is_none(), "that of another mesh");
    }

    #[test]
    fn a_texture_is_shrunk_to_what_a_page_has_room_for() {
        let ball = ball();
        let texture = texture_of(&ball).unwrap();
        let size = |most: u32| {
            let address = page_texture(texture, most).unwrap();
            let bytes = STANDARD.decode(address.strip_prefix("data:image/jpeg;base64,").unwrap()).unwrap();
            image::load_from_memory(&bytes).unwrap().into_rgb8().dimensions()
        };
        assert_eq!([64, 2048, 32, 16].map(size), [(64, 32), (64, 32), (32, 16), (16, 8)]);
    }
}
