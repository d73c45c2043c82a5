//! Fewer triangles for the same surface, by meshoptimizer's edge collapses (Garland and Heckbert's quadrics, 1997).

use meshopt::SimplifyOptions;

use super::manifold::separated;
use super::triangle_mesh::Mesh;
use super::weld::welded;

/// Fewest faces that a closed surface has: those of a tetrahedron.
pub const LEAST_FACES: usize = 4;

impl Mesh {
    /// The mesh with as few triangles as keep its surface within about `max_error` (in the mesh's units) of where it
    /// was. A closed mesh stays closed. Vertices that remain keep position, normal, colour and observation.
    #[must_use]
    pub fn simplified(&self, max_error: f32) -> Self {
        self.collapsed(0, max_error)
    }

    /// The mesh with at most `most` triangles, at least [`LEAST_FACES`]: the collapses that move the surface least come
    /// first. A mesh of no more faces is returned as it is.
    ///
    /// A closed mesh stays closed, and borders stay about where they are. Vertices that remain keep position, normal,
    /// colour and observation. Vertices at one place are one where that closes seams, those of texture coordinates, say;
    /// what was known of the first of them stays. A mesh of many pieces may keep more triangles: a piece has at least
    /// four where it is closed.
    #[must_use]
    pub fn within_faces(&self, most: usize) -> Self {
        let most = most.max(LEAST_FACES);
        if self.faces.len() <= most {
            return self.clone();
        }
        let mesh = welded(self);
        let mut target = most;
        let mut simple = mesh.collapsed(target, f32::MAX);
        // So few faces may be left that they cancel out.
        while simple.is_empty() && target < mesh.faces.len() {
            target *= 2;
            simple = mesh.collapsed(target, f32::MAX);
        }
        // Edges that were halved bring some faces more.
        while simple.faces.len() > most && target > LEAST_FACES {
            target = target.saturating_sub(simple.faces.len() - most).max(LEAST_FACES);
            let simpler = mesh.collapsed(target, f32::MAX);
            if simpler.is_empty() || simpler.faces.len() >= simple.faces.len() {
                break;
            }
            simple = simpler;
        }
        simple
    }

    /// After collapses down to so many faces, as far as none moves the surface by more than `max_error`.
    fn collapsed(&self, most: usize, max_error: f32) -> Self {
        let indices: Vec<u32> = self.faces.iter().flatten().copied().collect();
        let positions: Vec<[f32; 3]> = self.vertices.iter().map(|v| v.to_array()).collect();
        let options = SimplifyOptions::ErrorAbsolute;
        let kept = meshopt::simplify_decoder(&indices, &positions, 3 * most, max_error, options, None);
        separated(self, kept.as_chunks::<3>().0)
    }
}

#[cfg(test)]
mod tests;
