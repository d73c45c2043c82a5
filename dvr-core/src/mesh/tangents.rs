//! Tangents along a texture, as Blender and the baking programs compute them: MikkTSpace (Mikkelsen, Simulation of Wrinkled
//! Surfaces Revisited, 2008; `mikktspace.com`), which glTF 2.0 names in section 3.7.2.1.

use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use glam::{Vec2, Vec3, Vec4};

use super::triangle_mesh::Mesh;

/// Tangents of each face's three corners: a unit vector in the surface along which the first texture coordinate grows, and
/// the handedness `w`, so that the second grows along `w (normal x tangent)`. It is 1 where the texture lies on the outside
/// as it is, and -1 where it is mirrored.
///
/// `normals` are unit vectors, one per vertex; `corner_uvs` have their origin at the texture's bottom left corner. Corners
/// whose faces have no area on the texture, and no neighbours to follow, get any direction in the surface.
///
/// # Panics
/// When there are fewer normals than vertices, or fewer texture coordinates than faces.
pub fn corner_tangents(mesh: &Mesh, normals: &[Vec3], corner_uvs: &[[Vec2; 3]]) -> Vec<[Vec4; 3]> {
    let mut surface = Surface { mesh, normals, corner_uvs, tangents: vec![[Vec4::ZERO; 3]; mesh.faces.len()] };
    // It has no error, and reserves the right to have one: corners then get any direction.
    let _ = generate_tangents(&mut surface);
    let normal = |face: usize, k: usize| surface.normals[mesh.faces[face][k] as usize];
    let sound = |tangent: Vec4, normal: Vec3| {
        let along = tangent.truncate();
        // What a degenerate face gets may be any vector, or none.
        let is_sound = along.is_finite() && along.reject_from(normal).length_squared() > 1e-4;
        let along = if is_sound { along.normalize() } else { normal.any_orthonormal_vector() };
        along.extend(if tangent.w < 0.0 { -1.0 } else { 1.0 })
    };
    (surface.tangents.iter().enumerate())
        .map(|(face, tangents)| [0, 1, 2].map(|k| sound(tangents[k], normal(face, k).normalize_or(Vec3::Y))))
        .collect()
}

/// What MikkTSpace asks for, and what it answers.
struct Surface<'a> {
    mesh: &'a Mesh,
    normals: &'a [Vec3],
    corner_uvs: &'a [[Vec2; 3]],
    tangents: Vec<[Vec4; 3]>,
}

impl Geometry for Surface<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.faces.len()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.vertices[self.mesh.faces[face][corner] as usize].to_array()
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        self.normals[self.mesh.faces[face][corner] as usize].to_array()
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        self.corner_uvs[face][corner].to_array()
    }

    fn set_tangent(&mut self, tangent: Option<TangentSpace>, face: usize, corner: usize) {
        self.tangents[face][corner] = tangent.map_or(Vec4::ZERO, |tangent| Vec4::from(tangent.tangent_encoded()));
    }
}

#[cfg(test)]
mod tests {
    use super::super::shapes;
    use super::*;

    /// A square of two faces in the plane z = 0, seen from +z.
    fn square() -> Mesh {
        let vertices = vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
        Mesh { vertices, faces: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() }
    }

    fn tangents(uv: impl Fn(Vec3) -> Vec2) -> Vec<[Vec4; 3]> {
        let mesh = square();
        let uvs: Vec<[Vec2; 3]> = (0..2).map(|face| mesh.triangle(face).map(&uv)).collect();
        corner_tangents(&mesh, &[Vec3::Z; 4], &uvs)
    }

    #[test]
    fn a_texture_that_is_mirrored_has_the_other_handedness() {
        for (uv, along, w) in [
            ((|p| Vec2::new(p.x, p.y)) as fn(Vec3) -> Vec2, Vec3::X, 1.0),
            (|p| Vec2::new(1.0 - p.x, p.y), Vec3::NEG_X, -1.0),
            (|p| Vec2::new(p.x, 1.0 - p.y), Vec3::X, -1.0),
            (|p| Vec2::new(p.y, 1.0 - p.x), Vec3::Y, 1.0),
        ] {
            for tangent in tangents(uv).into_iter().flatten() {
                assert!((tangent.truncate() - along).length() < 1e-6 && tangent.w == w, "{tangent} {along} {w}");
                // The second coordinate grows along the bitangent.
                let up = w * Vec3::Z.cross(along);
                assert!((uv(up) - uv(Vec3::ZERO)).y > 0.9);
            }
        }
    }

    #[test]
    fn faces_without_texture_coordinates_and_without_area_get_unit_tangents() {
        let flat = tangents(|_| Vec2::splat(0.5));
        let mut ball = shapes::icosphere(1, 1.0);
        ball.vertices[3] = ball.vertices[7];
        ball.faces.push([2, 2, 2]);
        let normals = vec![Vec3::X; ball.vertices.len()];
        let uvs = vec![[Vec2::ZERO, Vec2::X, Vec2::new(f32::NAN, 1.0)]; ball.faces.len()];
        for tangent in flat.into_iter().chain(corner_tangents(&ball, &normals, &uvs)).flatten() {
            assert!((tangent.truncate().length() - 1.0).abs() < 1e-5 && tangent.w.abs() == 1.0, "{tangent}");
        }
    }
}
