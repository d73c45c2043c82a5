//! What keeps a deformed mesh from crumpling, whatever its vertices are pulled to.

use std::collections::{BTreeMap, BTreeSet};

use burn::tensor::{Int, Tensor, TensorData};
use dvr_core::mesh::Mesh;

/// Keeps lengths from being divided by zero.
const TINY: f64 = 1e-8;

/// How the faces of a mesh hang together: what the terms need of it.
pub(crate) struct Connections {
    vertices: usize,
    /// Rows of vertex pairs: each vertex with each of its neighbours.
    of: Vec<i64>,
    neighbours: Vec<i64>,
    /// One over the number of neighbours, per vertex.
    share: Vec<f32>,
    /// For each edge between two faces: its ends, and the third corner of either face.
    hinges: [Vec<i64>; 4],
}

impl Connections {
    /// Of a closed mesh.
    pub fn new(mesh: &Mesh) -> Self {
        let vertices = mesh.vertices.len();
        let mut neighbours = vec![BTreeSet::new(); vertices];
        let mut edges: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
        for face in &mesh.faces {
            for i in 0..3 {
                let [a, b, c] = [face[i], face[(i + 1) % 3], face[(i + 2) % 3]];
                neighbours[a as usize].extend([b, c]);
                edges.entry([a.min(b), a.max(b)]).or_default().push(c);
            }
        }
        let share = neighbours.iter().map(|near| 1.0 / near.len().max(1) as f32).collect();
        let pairs =
            neighbours.iter().enumerate().flat_map(|(v, near)| near.iter().map(move |&n| (v as i64, i64::from(n))));
        let (of, neighbours) = pairs.unzip();
        let mut hinges: [Vec<i64>; 4] = Default::default();
        for ([a, b], thirds) in edges {
            if let [c, d] = thirds[..] {
                for (list, vertex) in hinges.iter_mut().zip([a, b, c, d]) {
                    list.push(vertex.into());
                }
            }
        }
        Self { vertices, of, neighbours, share, hinges }
    }

    /// Squared distance of each vertex of `[b, v, 3]` from the mean of its neighbours, a sum over vertices and a mean over
    /// objects, `[1]` (Liu et al. 2019, Soft Rasterizer, equation 6).
    pub fn laplacian(&self, vertices: &Tensor<3>) -> Tensor<1> {
        self.laplacian_coordinates(vertices).square().sum() / vertices.dims()[0] as f64
    }

    /// From the mean of its neighbours to each vertex of `[b, v, 3]`.
    fn laplacian_coordinates(&self, vertices: &Tensor<3>) -> Tensor<3> {
        let [objects, n, _] = vertices.dims();
        debug_assert_eq!(n, self.vertices);
        let device = vertices.device();
        let rows = |list: &[i64]| Tensor::<1, Int>::from_data(TensorData::new(list.to_vec(), [list.len()]), &device);
        let near = vertices.clone().select(1, rows(&self.neighbours));
        let sums = Tensor::zeros([objects, n, 3], &device).select_assign(
            1,
            rows(&self.of),
            near,
            burn::tensor::IndexingUpdateOp::Add,
        );
        let share = Tensor::<3>::from_data(TensorData::new(self.share.clone(), [1, n, 1]), &device);
        vertices.clone() - sums * share
    }

    /// The squared change of Laplacian coordinates in a step of a deformation, a mean over vertices and objects, `[1]` (Wang et al.
    /// 2018, Pixel2Mesh, Laplacian regularisation).
    pub fn laplacian_change(&self, before: &Tensor<3>, after: &Tensor<3>) -> Tensor<1> {
        let [objects, n, _] = after.dims();
        let change = self.laplacian_coordinates(after) - self.laplacian_coordinates(before);
        change.square().sum() / (objects * n) as f64
    }

    /// The mean squared length of edges, and the mean of the cosine's absolute value between the edges of vertices and the normal
    /// of the surface that they lie on (the same, edge length regularisation and normal loss), `[1]` each; `normals` are
    /// `[b, v, 3]`.
    pub fn edges(&self, vertices: &Tensor<3>, normals: &Tensor<3>) -> (Tensor<1>, Tensor<1>) {
        let device = vertices.device();
        let rows = |list: &[i64]| Tensor::<1, Int>::from_data(TensorData::new(list.to_vec(), [list.len()]), &device);
        let edges = vertices.clone().select(1, rows(&self.neighbours)) - vertices.clone().select(1, rows(&self.of));
        let length = edges.clone().square().sum_dim(2).mean();
        let cosine = (unit(edges) * normals.clone().select(1, rows(&self.of))).sum_dim(2).abs().mean();
        (length, cosine)
    }

    /// `(cos a + 1)^2` of the angle `a` between the two faces at each edge, a sum over edges and a mean over objects, `[1]`:
    /// zero where they lie in a plane (Liu et al. 2019, equation 7).
    pub fn flatness(&self, vertices: &Tensor<3>) -> Tensor<1> {
        let [objects, ..] = vertices.dims();
        let device = vertices.device();
        let corners = |list: &[i64]| {
            let rows = Tensor::<1, Int>::from_data(TensorData::new(list.to_vec(), [list.len()]), &device);
            vertices.clone().select(1, rows)
        };
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| corners(&self.hinges[i]));
        let edge = unit(b - a.clone());
        // From the edge to either third corner, at right angles to it.
        let [to_c, to_d] = [c, d].map(|corner| {
            let side = corner - a.clone();
            let along = (side.clone() * edge.clone()).sum_dim(2);
            unit(side - edge.clone() * along)
        });
        let cosine = (to_c * to_d).sum_dim(2);
        (cosine + 1.0).square().sum() / objects as f64
    }
}

/// Rows scaled to unit length; a row of zeros stays.
fn unit(rows: Tensor<3>) -> Tensor<3> {
    let length = (rows.clone().square().sum_dim(2) + TINY * TINY).sqrt();
    rows / length
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use dvr_core::mesh::shapes::icosphere;

    use super::*;

    fn tensor(mesh: &Mesh, device: &Device) -> Tensor<3> {
        let flat: Vec<f32> = mesh.vertices.iter().flat_map(|v| v.to_array()).collect();
        Tensor::from_data(TensorData::new(flat, [1, mesh.vertices.len(), 3]), device)
    }

    #[test]
    fn a_crumpled_ball_costs_more_than_a_round_one_and_a_finer_ball_less() {
        let device = Device::flex();
        let ball = icosphere(2, 0.5);
        let connections = Connections::new(&ball);
        assert_eq!(connections.hinges[0].len(), ball.faces.len() * 3 / 2, "every edge has two faces");
        let mut crumpled = ball.clone();
        crumpled.vertices.iter_mut().enumerate().for_each(|(i, v)| *v *= 1.0 + 0.1 * (i % 3) as f32);
        for term in [Connections::laplacian, Connections::flatness] {
            let [round, crumpled] =
                [&ball, &crumpled].map(|mesh| term(&connections, &tensor(mesh, &device)).into_scalar::<f32>());
            assert!(round > 0.0 && crumpled > 3.0 * round, "{round} {crumpled}");
        }
        // Two faces in a plane, and the same folded by a right angle: cosines of -1 and 0.
        let fold = |up: f32| Mesh {
            vertices: [[0., 0., 0.], [0., 1., 0.], [1., 0., 0.], [-1. + up, 0., up]].map(glam::Vec3::from).to_vec(),
            faces: vec![[0, 2, 1], [0, 1, 3]],
            ..Mesh::default()
        };
        for (up, cost) in [(0.0, 0.0), (1.0, 1.0)] {
            let mesh = fold(up);
            let found = Connections::new(&mesh).flatness(&tensor(&mesh, &device)).into_scalar::<f32>();
            assert!((found - cost).abs() < 1e-5, "{up}: {found}");
        }
    }
}
