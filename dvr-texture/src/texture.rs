//! From a mesh and photographs to a textured mesh.

use std::sync::Arc;

use dvr_core::mesh::{Material, Mesh, TexturedMesh, shapes};
use dvr_core::{Cancellation, View};
use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::atlas::Atlas;
use crate::auto_size::auto_size;
use crate::blend::blended;
use crate::error::TextureError;
use crate::fill::fill;
use crate::memory::TextureMemory;
use crate::photographs::Photograph;
use crate::settings::{TextureSettings, TextureSize};
use crate::solve::Samples;
use crate::texels::Texels;

/// Free texels around each chart, filled with its colours: mip levels that halve the texture twice mix no charts.
const PADDING: u32 = 4;

/// Share of the surface below which photographs do not show it: an open mesh that is turned around is seen at its outlines.
const LEAST_SEEN: f64 = 0.05;

/// The parts that [`texture_mesh`] tells of.
pub const PARTS: usize = 5;

/// A mesh with the texture that photographs gave it.
#[derive(Clone, Debug)]
pub struct Textured {
    /// The mesh without vertex colours; one material, with the texture.
    pub mesh: TexturedMesh,
    /// What the texture is.
    pub report: TextureReport,
}

/// What a texture is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TextureReport {
    /// Texels along its edge.
    pub size: u32,
    /// Charts that the surface was cut into.
    pub charts: usize,
    /// Share of the texture that they cover.
    pub cover: f64,
    /// Share of their texels that a photograph shows.
    pub seen: f64,
    /// Pixels along the edge of a cell of the photographs, of which each gave the texture a colour: 1 where every pixel did.
    #[serde(default = "every_pixel")]
    pub cell: u32,
    /// The normal map beside it; `None` where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normal_map: Option<NormalMapReport>,
}

/// What textures of earlier versions say nothing of.
fn every_pixel() -> u32 {
    1
}

/// What a normal map is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NormalMapReport {
    /// Texels along its edge.
    pub size: u32,
    /// Share of the surface's texels at which the line along the normal meets the full mesh.
    pub met: f64,
}

/// Gives a mesh a texture from the photographs that see it. The mesh is in the space of the views' cameras; its faces wind
/// counter-clockwise seen from outside.
///
/// Each texel takes the mean of the photographs that see it, weighted by how finely they show it, of those that agree
/// with their median; then least squares over all pixels make the texture give back the photographs. Surface that none
/// sees keeps the mesh's own colours, or takes those around. Views are taken at their mean exposure where that is known
/// to change ([`View::exposure`]). The result does not depend on the number of threads.
///
/// `progress` hears the number of parts that are done, of [`PARTS`], and what was done.
///
/// # Errors
/// [`TextureError`].
pub fn texture_mesh(
    mesh: &Mesh,
    views: &[&View],
    settings: &TextureSettings,
    cancellation: &Cancellation,
    mut progress: impl FnMut(usize, &str),
) -> Result<Textured, TextureError> {
    settings.check()?;
    if mesh.is_empty() {
        return Err(TextureError::NoFaces);
    }
    if is_inside_out(mesh) {
        return Err(TextureError::InsideOut);
    }
    let memory = TextureMemory::on_this_machine(views, settings);
    if let TextureSize::Texels(size) = settings.size {
        memory.check(size)?;
    }
    // The surface as it is: normals that a file brings may be those of a smoother one.
    let normals = shapes::vertex_normals(&mesh.vertices, &mesh.faces);
    let photographs = Photograph::all(mesh, views, memory.stride);
    cancellation.check()?;
    let automatic =
        auto_size(mesh, &normals, &photographs).ok_or(TextureError::Hidden { views: views.len(), seen: 0.0 })?;
    let size = settings.size_where(memory.fitting(automatic));
    memory.check(size)?;
    progress(1, "visibility");
    let atlas = Atlas::unwrap(mesh, size, PADDING, cancellation)?;
    let texels = Texels::draw(&atlas);
    progress(2, "atlas");
    let (mut colors, seen) = blended(mesh, &normals, &atlas, &texels, &photographs, cancellation)?;
    drop(texels);
    if seen < LEAST_SEEN {
        return Err(TextureError::Hidden { views: views.len(), seen });
    }
    fill(&mut colors, size);
    progress(3, "colours");
    let samples = Samples::gather(mesh, &normals, &atlas, &photographs, cancellation)?;
    progress(4, "pixels");
    samples.descend(&mut colors, settings.steps, cancellation)?;
    progress(5, "least squares");
    let (charts, cover, cell) = (atlas.charts, atlas.cover.into(), memory.stride);
    let report = TextureReport { size, charts, cover, seen, cell, normal_map: None };
    Ok(Textured { mesh: textured(mesh, &atlas, &colors), report })
}

/// Whether a closed mesh encloses a negative volume, by the tetrahedra of its faces and the origin.
fn is_inside_out(mesh: &Mesh) -> bool {
    let six_volumes = |face: usize| {
        let [a, b, c] = mesh.triangle(face).map(|corner| corner.as_dvec3());
        a.dot(b.cross(c))
    };
    let volume: f64 = (0..mesh.faces.len()).map(six_volumes).sum();
    volume < 0.0 && mesh.open_edges() == 0
}

fn textured(mesh: &Mesh, atlas: &Atlas, colors: &[Vec3]) -> TexturedMesh {
    let size = atlas.size;
    let picture = image::RgbaImage::from_fn(size, size, |u, v| {
        let [r, g, b] = (255.0 * colors[(v * size + u) as usize]).round().to_array().map(|channel| channel as u8);
        image::Rgba([r, g, b, 255])
    });
    let edge = size as f32;
    // Texture coordinates point up, rows of texels run down.
    let uv = |place: Vec2| Vec2::new(place.x / edge, 1.0 - place.y / edge);
    TexturedMesh {
        mesh: Mesh { colors: None, ..mesh.clone() },
        corner_uvs: atlas.corners.iter().map(|corners| corners.map(uv)).collect(),
        face_materials: Vec::new(),
        materials: vec![Material { base_color: [1.0; 3], texture: Some(Arc::new(picture)) }],
        normal_map: None,
    }
}
