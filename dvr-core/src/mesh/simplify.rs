//! Fewer triangles for the same surface, by meshoptimizer's edge collapses (Garland and Heckbert's quadrics, 1997).

use meshopt::SimplifyOptions;

use super::triangle_mesh::Mesh;

impl Mesh {
    /// The mesh with as few triangles as keep its surface within about `max_error` (in the mesh's units) of where it
    /// was. Topology is kept: a closed mesh stays closed. Vertices that remain keep position, normal, colour and
    /// observation.
    #[must_use]
    pub fn simplified(&self, max_error: f32) -> Self {
        let indices: Vec<u32> = self.faces.iter().flatten().copied().collect();
        let positions: Vec<[f32; 3]> = self.vertices.iter().map(|v| v.to_array()).collect();
        let options = SimplifyOptions::ErrorAbsolute;
        let kept = meshopt::simplify_decoder(&indices, &positions, 0, max_error, options, None);
        self.with_faces(kept.as_chunks::<3>().0.to_vec())
    }

    /// Other faces over the same vertices; those that none of them uses are dropped.
    fn with_faces(&self, mut faces: Vec<[u32; 3]>) -> Self {
        let mut new_index = vec![u32::MAX; self.vertices.len()];
        let mut used = Vec::new();
        for index in faces.iter_mut().flatten() {
            let old = *index as usize;
            if new_index[old] == u32::MAX {
                new_index[old] = used.len() as u32;
                used.push(old);
            }
            *index = new_index[old];
        }
        self.with_vertices(&used, faces)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::super::shapes;
    use super::*;

    #[test]
    fn a_fine_ball_loses_triangles_and_stays_a_closed_ball() {
        let mut ball = shapes::icosphere(5, 0.4);
        ball.colors = Some(vec![[0.2, 0.4, 0.6]; ball.vertices.len()]);
        let simple = ball.simplified(2e-3);
        assert!(simple.faces.len() * 5 < ball.faces.len(), "{} of {}", simple.faces.len(), ball.faces.len());
        assert_eq!(simple.colors.as_ref().unwrap().len(), simple.vertices.len());
        let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
        for face in &simple.faces {
            (0..3).for_each(|k| *edges.entry((face[k], face[(k + 1) % 3])).or_default() += 1);
            // Middles of faces lie below the sphere, by no more than the error allows.
            let [a, b, c] = face.map(|i| simple.vertices[i as usize]);
            assert!(((a + b + c) / 3.0).length() > 0.4 - 2.5 * 2e-3);
        }
        assert!(edges.iter().all(|(&(a, b), &n)| n == 1 && edges.get(&(b, a)) == Some(&1)), "closed");
    }

    #[test]
    fn nothing_to_simplify_is_no_error() {
        assert!(Mesh::default().simplified(1.0).is_empty());
    }
}
