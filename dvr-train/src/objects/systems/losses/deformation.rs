//! What a mesh that is deformed in stages learns from (Wang et al. 2018, Pixel2Mesh).

use burn::tensor::{Tensor, TensorData};
use dvr_core::PointCloud;
use dvr_model::Deformed;
use glam::Vec3;

use super::chamfer::matched;
use super::mesh_shape::Connections;
use crate::learners::objective::StepLoss;

/// The paper's weights beside that of the Chamfer distance, which is 1: of normals, of the Laplacian, of the lengths of edges.
const NORMALS: f64 = 1.6e-4;
const LAPLACIAN: f64 = 0.3;
const EDGES: f64 = 0.1;

/// The loss of the meshes of all stages against points of the true surfaces; `connections` are those of the
/// stages.
pub(crate) fn deformation_loss(stages: &[Deformed], truth: &[&PointCloud], connections: &[Connections]) -> StepLoss {
    let points: Vec<&[Vec3]> = truth.iter().map(|cloud| cloud.points.as_slice()).collect();
    let names = ["chamfer", "edges", "normals", "laplacian"];
    let mut sums: [Option<Tensor<1>>; 4] = Default::default();
    let mut add = |term: usize, value: Tensor<1>| {
        sums[term] = Some(match sums[term].take() {
            Some(sum) => sum + value,
            None => value,
        });
    };
    for (stage, (Deformed { before, vertices }, connections)) in stages.iter().zip(connections).enumerate() {
        let (chamfer, nearest) = matched(vertices, &points);
        let normals = normals_of(&nearest, truth, vertices);
        let (length, cosine) = connections.edges(vertices, &normals);
        add(0, chamfer);
        add(1, length * EDGES);
        add(2, cosine * NORMALS);
        // The first stage makes the shape of a ball: it must bend.
        if stage > 0 {
            add(3, connections.laplacian_change(before, vertices) * LAPLACIAN);
        }
    }
    let terms: Vec<_> = names.into_iter().zip(sums).filter_map(|(name, sum)| Some((name, sum?))).collect();
    let total = terms.iter().map(|(_, term)| term.clone()).reduce(|a, b| a + b);
    let total = total.unwrap_or_else(|| Tensor::zeros([1], &stages[0].vertices.device()));
    StepLoss { total, terms, mask_iou: f64::NAN }
}

/// The normal of the nearest true point of each vertex, `[b, v, 3]`; zero where it is not known.
fn normals_of(nearest: &[Vec<usize>], truth: &[&PointCloud], vertices: &Tensor<3>) -> Tensor<3> {
    let normal =
        |cloud: &PointCloud, i: usize| cloud.normals.as_ref().and_then(|all| all.get(i)).copied().unwrap_or_default();
    let all = nearest.iter().zip(truth).flat_map(|(nearest, cloud)| nearest.iter().map(|&i| normal(cloud, i)));
    let flat: Vec<f32> = all.flat_map(|normal| normal.to_array()).collect();
    Tensor::from_data(TensorData::new(flat, vertices.dims()), &vertices.device())
}
