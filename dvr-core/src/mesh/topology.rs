//! Whether a mesh is a surface that encloses something, and how many handles it has.

use super::components::connected_components;
use super::triangle_mesh::Mesh;

/// What the faces of a mesh say about its shape, whatever its vertices' places. Vertices that lie at one place are two.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Topology {
    /// Every edge belongs to exactly two faces, which run along it in opposite directions: the surface is watertight.
    /// A mesh without faces is not.
    pub closed: bool,
    /// Edges that are not shared so.
    pub open_edges: usize,
    /// Connected components.
    pub components: usize,
    /// `V - E + F` of the vertices that faces use: 2 for each sphere, 0 for each torus.
    pub euler_characteristic: i64,
}

impl Topology {
    /// Of a mesh.
    pub fn of(mesh: &Mesh) -> Self {
        // Each edge once from each side: sorted by its ends, the two lie together and go opposite ways.
        let side = |a: u32, b: u32| (a.min(b), a.max(b), a < b);
        let mut sides: Vec<(u32, u32, bool)> =
            mesh.faces.iter().flat_map(|&[a, b, c]| [side(a, b), side(b, c), side(c, a)]).collect();
        sides.sort_unstable();
        let (mut edges, mut open_edges) = (0, 0);
        for sides in sides.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            edges += 1;
            open_edges += usize::from(!matches!(sides, [(.., false), (.., true)]));
        }
        let mut used = vec![false; mesh.vertices.len()];
        mesh.faces.iter().flatten().for_each(|&vertex| used[vertex as usize] = true);
        let vertices = used.iter().filter(|&&used| used).count();
        Self {
            closed: !mesh.faces.is_empty() && open_edges == 0,
            open_edges,
            components: connected_components(mesh.vertices.len(), &mesh.faces).1,
            euler_characteristic: vertices as i64 - edges + mesh.faces.len() as i64,
        }
    }

    /// Handles of all components together (the genus of a single one); `None` where the surface is not closed.
    pub fn handles(&self) -> Option<i64> {
        self.closed.then(|| self.components as i64 - self.euler_characteristic / 2)
    }
}

impl Mesh {
    /// Edges that are not shared by exactly two faces that wind the same way; a watertight mesh has none.
    pub fn open_edges(&self) -> usize {
        Topology::of(self).open_edges
    }
}

#[cfg(test)]
mod tests {
    use super::super::shapes;
    use super::*;

    #[test]
    fn a_ball_has_no_handle_and_a_torus_has_one() {
        let ball = Topology::of(&shapes::icosphere(1, 1.0));
        assert_eq!((ball.closed, ball.components, ball.handles()), (true, 1, Some(0)));
        let torus = shapes::torus(1.0, 0.3, 8, 6);
        assert_eq!(Topology::of(&torus).handles(), Some(1));
        let both = Topology::of(&shapes::union([torus, shapes::icosphere(0, 1.0)]));
        assert_eq!((both.components, both.handles()), (2, Some(1)));
    }

    #[test]
    fn a_surface_with_a_hole_or_without_faces_is_not_closed() {
        let mut ball = shapes::icosphere(1, 1.0);
        ball.faces.pop();
        assert_eq!(Topology::of(&ball).handles(), None);
        assert!(!Topology::of(&Mesh::default()).closed);
    }

    #[test]
    fn a_closed_mesh_has_no_open_edge_and_one_with_a_hole_has_those_around_it() {
        let mut ball = shapes::icosphere(2, 1.0);
        assert_eq!(ball.open_edges(), 0);
        ball.faces.pop();
        assert_eq!(ball.open_edges(), 3);
        let turned = ball.faces[0];
        ball.faces[0] = [turned[0], turned[2], turned[1]];
        assert_eq!(ball.open_edges(), 6, "a face that winds the other way has no neighbours");
    }
}
