//! Triangles near equilateral for the same surface, by isotropic remeshing: long edges are split, short ones collapsed,
//! valences made even by flips, and vertices moved along the surface (Botsch and Kobbelt, *A remeshing approach to
//! multiresolution modeling*, 2004).

mod dynamic_mesh;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::simplify::LEAST_FACES;
use super::triangle_mesh::Mesh;
use super::weld::welded;
use crate::bvh::Bvh;
use dynamic_mesh::{DynamicMesh, normal};

/// How often all edges are looked at.
const ROUNDS: usize = 8;

/// Edges are split above, and collapsed below, so many target lengths: neither undoes what the other did.
const LONG: f32 = 4.0 / 3.0;
const SHORT: f32 = 4.0 / 5.0;

impl Mesh {
    /// The same surface with about `faces` triangles, at least [`LEAST_FACES`], all about the same size and near equilateral, as
    /// simulation wants them: isotropic remeshing.
    ///
    /// A closed mesh stays closed. Vertices within smooth parts lie on the surface that was. Borders, and edges where it turns
    /// by more than 40 degrees, are kept, as chords of what they were where they bend; so are their corners. What is known
    /// of vertices is taken from the nearest place. Vertices at one place are one where that closes seams.
    #[must_use]
    pub fn remeshed(&self, faces: usize) -> Self {
        let mesh = welded(self);
        let area: f64 = (0..mesh.faces.len()).map(|face| 0.5 * f64::from(normal(mesh.triangle(face)).length())).sum();
        if !(area > 0.0 && area.is_finite()) {
            return self.clone();
        }
        let equilateral = area / faces.max(LEAST_FACES) as f64;
        let target = (4.0 * equilateral / 3f64.sqrt()).sqrt() as f32;
        let surface = Bvh::new(&mesh);
        let mut dynamic = DynamicMesh::new(&mesh);
        for _ in 0..ROUNDS {
            dynamic.split(LONG * target);
            dynamic.collapse(SHORT * target, LONG * target);
            dynamic.flip();
            let moved: Vec<Option<Vec3>> = (0..dynamic.vertices() as u32)
                .into_par_iter()
                .map(|vertex| {
                    let nearest = surface.nearest(dynamic.relaxed(vertex)?.as_dvec3())?;
                    Some(nearest.position.as_vec3())
                })
                .collect();
            (0..).zip(moved).for_each(|(vertex, to)| {
                if let Some(to) = to {
                    dynamic.move_to(vertex, to);
                }
            });
        }
        let (vertices, faces) = dynamic.finished();
        known_from(&mesh, &surface, vertices, faces)
    }
}

/// The mesh of these vertices and faces, with what is known of the nearest places of another.
fn known_from(mesh: &Mesh, surface: &Bvh, vertices: Vec<Vec3>, faces: Vec<[u32; 3]>) -> Mesh {
    let of_vertex = |vertex: &Vec3| {
        let found = surface.nearest(vertex.as_dvec3());
        let face = found.map_or(0, |nearest| nearest.face as usize);
        (mesh.faces[face], shares(mesh.triangle(face), *vertex))
    };
    let places: Vec<([u32; 3], [f32; 3])> = vertices.par_iter().map(of_vertex).collect();
    let mean = |values: &[Vec3]| -> Vec<Vec3> {
        let of_place = |(corners, shares): &([u32; 3], [f32; 3])| {
            corners.iter().zip(shares).map(|(corner, share)| *share * values[*corner as usize]).sum()
        };
        places.iter().map(of_place).collect()
    };
    let normals = mesh.normals.as_ref().map(|normals| {
        let mean = mean(normals).into_iter().zip(&places);
        mean.map(|(normal, (corners, _))| normal.normalize_or(normals[corners[0] as usize])).collect()
    });
    let colors = mesh.colors.as_ref().map(|colors| {
        let colors: Vec<Vec3> = colors.iter().map(|color| Vec3::from(*color)).collect();
        mean(&colors).into_iter().map(Vec3::into).collect()
    });
    let observations = mesh.observations.as_ref().map(|observations| {
        let nearest = |(corners, shares): &([u32; 3], [f32; 3])| {
            let most = (0..3).reduce(|a, b| if shares[b] > shares[a] { b } else { a }).unwrap_or_default();
            observations[corners[most] as usize]
        };
        places.iter().map(nearest).collect()
    });
    Mesh { vertices, faces, normals, colors, observations }
}

/// How much each corner of a triangle counts at a point of it: barycentric coordinates, none negative.
fn shares([a, b, c]: [Vec3; 3], point: Vec3) -> [f32; 3] {
    let (u, v, to) = (b - a, c - a, point - a);
    let normal = u.cross(v);
    let twice = normal.length_squared();
    if twice <= f32::MIN_POSITIVE {
        return [1.0, 0.0, 0.0];
    }
    let by = Vec2::new(to.cross(v).dot(normal), u.cross(to).dot(normal)) / twice;
    let shares = [1.0 - by.x - by.y, by.x, by.y].map(|share| share.clamp(0.0, 1.0));
    let sum: f32 = shares.iter().sum();
    shares.map(|share| share / sum)
}

#[cfg(test)]
mod tests;
