//! The normals of a full mesh as a texture of the simple one that was made of it (Cohen, Olano and Manocha,
//! Appearance-Preserving Simplification, SIGGRAPH 1998; baked along the normals, as xNormal and Blender do).

use std::sync::Arc;

use dvr_core::mesh::{Mesh, NormalMap, corner_tangents, shapes};
use dvr_core::{Bvh, Cancellation, Ray};
use glam::{DVec3, Mat3, Vec2, Vec3, Vec4};
use image::{Rgb, RgbImage};
use rayon::prelude::*;

use crate::error::TextureError;
use crate::fill::fill;
use crate::memory::TEXEL;
use crate::texels::{FREE, Texels, barycentric, blend};
use crate::texture::{NormalMapReport, Textured};

/// How far along the normal the full mesh is looked for, in the largest distance that simplification moved the surface:
/// that far it is along its own normal, and twice as far along one that leans by 60 degrees.
pub const REACH: f64 = 2.0;

/// Bytes of a texel of the map while it is made: its face, its direction, the levels of the filling, and the picture as it
/// is and as it is stored.
const MAP_TEXEL: u64 = (size_of::<u32>() + size_of::<Vec3>() + 4 * size_of::<Vec4>() / 3 + 2 * 3) as u64;

// A map has no more texels than the colours, which are finished: what these were granted is enough.
const _: () = assert!(MAP_TEXEL <= TEXEL);

/// Texels on the surface per vertex of the full mesh above which a map of half the size shows all that the mesh has.
const TEXELS_PER_VERTEX: f64 = 2.0;

/// Least cosine between a vertex normal and the normals of its faces: beyond, it is that of another surface.
const LEAST_COSINE: f32 = 0.1;

/// Least height of a direction over the surface: texels below it would be lit from behind.
const LEAST_HEIGHT: f32 = 0.05;

/// Gives a textured mesh, and its report, a normal map: the smooth normals of the `full` mesh, in the tangent space
/// (MikkTSpace) of the simple one that was made of it. Both are in the same space; `moved` is the largest distance between
/// them ([`dvr_core::metrics::Simplification::max_distance`]).
///
/// From the place of each texel, the full mesh is looked for along the normal, outward and inward, up to [`REACH`] times
/// `moved`: the nearest face counts that looks the same way. Where there is none, the nearest point of the full mesh counts,
/// and where that looks away, the surface stays as it is. Normals of the full mesh are its own, where it has them, or the
/// means of its faces; those of the simple one, which the file needs for its tangent space, likewise. The map has the size
/// of the colours, or half of it where that shows all vertices of the full mesh, and is filled between the charts, as the
/// colours are. It takes fewer bytes per texel than the colours did while they were made, and does not depend on the number
/// of threads.
///
/// # Errors
/// [`TextureError::NoFaces`] where one of the meshes has none; [`TextureError::Cancelled`].
pub fn bake_normals(
    textured: &mut Textured,
    full: &Mesh,
    moved: f64,
    cancellation: &Cancellation,
) -> Result<(), TextureError> {
    let mesh = &textured.mesh.mesh;
    if mesh.is_empty() || full.is_empty() {
        return Err(TextureError::NoFaces);
    }
    let size = size(textured, full.vertices.len());
    let edge = size as f32;
    let place = |uv: Vec2| Vec2::new(edge * uv.x, edge * (1.0 - uv.y));
    let places: Vec<[Vec2; 3]> = textured.mesh.corner_uvs.iter().map(|corners| corners.map(place)).collect();
    let texels = Texels::of_corners(size, &places);
    let normals = shading_normals(mesh);
    let tangents = corner_tangents(mesh, &normals, &textured.mesh.corner_uvs);
    let truth = FullMesh { bvh: Bvh::new(full), normals: shading_normals(full), mesh: full, reach: REACH * moved };
    cancellation.check()?;

    let mut directions = vec![Vec3::NAN; texels.face.len()];
    let rows = directions.par_chunks_exact_mut(size as usize).enumerate();
    let met: Vec<[u64; 2]> = rows
        .map(|(v, row)| {
            cancellation.check()?;
            let mut met = [0; 2];
            for (u, direction) in row.iter_mut().enumerate() {
                let face = texels.face[v * size as usize + u];
                if face == FREE {
                    continue;
                }
                let weights = barycentric(places[face as usize], (u as u32, v as u32));
                let corners = mesh.faces[face as usize].map(|i| normals[i as usize]);
                let point = blend(mesh.triangle(face as usize), weights);
                let normal = blend(corners, weights).normalize_or_zero();
                let (found, along) = truth.normal(point, normal);
                *direction = in_tangent_space(found, tangents[face as usize], normal, weights);
                met = [met[0] + u64::from(along), met[1] + 1];
            }
            Ok(met)
        })
        .collect::<Result<_, TextureError>>()?;
    drop(texels);
    let [met, all] = met.iter().fold([0; 2], |sum, row| [sum[0] + row[0], sum[1] + row[1]]);
    fill(&mut directions, size);
    let texture = RgbImage::from_fn(size, size, |u, v| {
        let direction = directions[v as usize * size as usize + u as usize];
        Rgb(NormalMap::texel(direction.normalize_or(Vec3::Z)))
    });
    textured.mesh.mesh.normals = Some(normals);
    textured.mesh.normal_map = Some(NormalMap { texture: Arc::new(texture), corner_tangents: tangents });
    textured.report.normal_map = Some(NormalMapReport { size, met: met as f64 / all.max(1) as f64 });
    Ok(())
}

/// The size of the map: that of the colours, or half of it where that is enough for so many vertices.
fn size(textured: &Textured, vertices: usize) -> u32 {
    let half = textured.report.size / 2;
    let texels = f64::from(half).powi(2) * textured.report.cover;
    if texels >= TEXELS_PER_VERTEX * vertices as f64 { half } else { textured.report.size }
}

/// Unit normals of the vertices: the mesh's own, and the mean of the faces where it has none, or one that leans away from a
/// face: simplification joins vertices, and keeps what one of them had.
fn shading_normals(mesh: &Mesh) -> Vec<Vec3> {
    let means = shapes::vertex_normals(&mesh.vertices, &mesh.faces);
    let Some(own) = &mesh.normals else { return means.into_iter().map(|n| n.normalize_or(Vec3::Y)).collect() };
    let mut leans: Vec<bool> = own.iter().map(|normal| normal.normalize_or_zero() == Vec3::ZERO).collect();
    for (face, corners) in mesh.faces.iter().enumerate() {
        let [a, b, c] = mesh.triangle(face);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        for &corner in corners {
            let cosine = own[corner as usize].normalize_or_zero().dot(normal);
            leans[corner as usize] |= normal != Vec3::ZERO && cosine < LEAST_COSINE;
        }
    }
    let chosen = own.iter().zip(means).zip(leans).map(|((own, mean), leans)| if leans { mean } else { *own });
    chosen.map(|normal| normal.normalize_or(Vec3::Y)).collect()
}

/// The mesh whose normals are wanted.
struct FullMesh<'a> {
    mesh: &'a Mesh,
    normals: Vec<Vec3>,
    bvh: Bvh,
    /// How far along a normal it is looked for.
    reach: f64,
}

impl FullMesh<'_> {
    /// The unit normal that belongs to a point near the mesh and its normal, and whether it was met along that.
    fn normal(&self, point: Vec3, normal: Vec3) -> (Vec3, bool) {
        let origin = point.as_dvec3();
        // Of a surface that looks the same way, a line outward meets the back first, and one inward the front. Behind a
        // face that looks the other way lies another part of the object.
        let hit = |direction: Vec3, front: bool| {
            let ray = Ray { origin, direction: direction.as_dvec3() };
            self.bvh.closest_hit(&ray, 0.0, self.reach).filter(|hit| hit.front == front)
        };
        let hits = [hit(normal, false), hit(-normal, true)];
        let nearest = hits.into_iter().flatten().min_by(|a, b| a.ray_depth.total_cmp(&b.ray_depth));
        let same_way = |found: Vec3| found.dot(normal) > 0.0;
        if let Some(hit) = nearest
            && let found = self.smooth(hit.face, hit.barycentric)
            && same_way(found)
        {
            return (found, true);
        }
        let nearest =
            self.bvh.nearest(origin).map(|near| self.smooth(near.face, self.weights(near.face, near.position)));
        (nearest.filter(|&found| same_way(found)).unwrap_or(normal), false)
    }

    /// The normal between those of a face's corners.
    fn smooth(&self, face: u32, weights: [f64; 3]) -> Vec3 {
        let corners = self.mesh.faces[face as usize].map(|i| self.normals[i as usize]);
        blend(corners, weights.map(|weight| weight as f32)).normalize_or_zero()
    }

    /// Barycentric coordinates of a point on a face.
    fn weights(&self, face: u32, point: DVec3) -> [f64; 3] {
        let [a, b, c] = self.mesh.triangle(face as usize).map(|corner| corner.as_dvec3());
        let normal = (b - a).cross(c - a);
        let squared = normal.length_squared();
        if squared == 0.0 {
            return [1.0 / 3.0; 3];
        }
        let beta = (point - a).cross(c - a).dot(normal) / squared;
        let gamma = (b - a).cross(point - a).dot(normal) / squared;
        [1.0 - beta - gamma, beta, gamma]
    }
}

/// A unit direction by the tangent, bitangent and normal at a point of a face, as renderers have them there: interpolated
/// and made unit vectors ([`NormalMap`]).
fn in_tangent_space(direction: Vec3, tangents: [Vec4; 3], normal: Vec3, weights: [f32; 3]) -> Vec3 {
    let tangent = blend(tangents.map(Vec4::truncate), weights).normalize_or_zero();
    let bitangent = tangents[0].w * normal.cross(tangent);
    let frame = Mat3::from_cols(tangent, bitangent, normal);
    // Where corners differ so much that nothing is left between them, every renderer shows something else.
    if frame.determinant().abs() < 1e-3 {
        return Vec3::Z;
    }
    let found = (frame.inverse() * direction).normalize_or(Vec3::Z);
    if found.z >= LEAST_HEIGHT { found } else { found.with_z(LEAST_HEIGHT).normalize() }
}

#[cfg(test)]
mod tests;
