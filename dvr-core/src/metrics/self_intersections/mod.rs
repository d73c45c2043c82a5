//! How often a surface goes through itself.

mod triangles;

use rayon::prelude::*;

use self::triangles::triangles_meet;
use crate::bvh::Bvh;
use crate::cancellation::{Cancellation, Cancelled};
use crate::mesh::Mesh;

/// The number of pairs of faces that have a point in common though they have no corner in common: none where a mesh bounds
/// a solid, as programs that print, simulate or cut solids want it.
///
/// Corners are in common that lie at one place: vertices that are doubled along the seams of a texture do not count. Faces
/// without area, and with corners that are not finite, meet nothing. The test is exact but for what rounding in double
/// precision cannot tell from touching, and touching counts. The time is about that of building a [`Bvh`] and asking it
/// once per face, with no more than the faces around it to look at; where very many faces lie in one place, it is the
/// number of their pairs.
///
/// # Errors
/// [`Cancelled`] where the token says so.
pub fn self_intersections(mesh: &Mesh, cancellation: &Cancellation) -> Result<usize, Cancelled> {
    let has_area = |face: usize| {
        let [a, b, c] = mesh.triangle(face).map(|corner| corner.as_dvec3());
        let squared = (b - a).cross(c - a).length_squared();
        squared.is_finite() && squared > 0.0
    };
    let sound: Vec<[u32; 3]> =
        (0..mesh.faces.len()).into_par_iter().filter(|&face| has_area(face)).map(|face| mesh.faces[face]).collect();
    let sound = Mesh { vertices: mesh.vertices.clone(), faces: sound, ..Mesh::default() };
    cancellation.check()?;
    let meet = |a: u32, b: u32| {
        let (first, second) = (sound.triangle(a as usize), sound.triangle(b as usize));
        let is_shared = first.iter().any(|corner| second.contains(corner));
        !is_shared && triangles_meet(first.map(|corner| corner.as_dvec3()), second.map(|corner| corner.as_dvec3()))
    };
    Bvh::new(&sound).count_pairs(meet, cancellation)
}

#[cfg(test)]
mod tests;
