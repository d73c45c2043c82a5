//! What a mesh that is deformed in stages learns from (Wang et al. 2018, Pixel2Mesh, section 3.3).

use burn::tensor::{Tensor, TensorData};
use dvr_core::PointCloud;
use dvr_model::Deformed;
use glam::Vec3;

use super::chamfer::matched;
use super::mesh_shape::Connections;
use crate::learners::objective::StepLoss;

/// The paper's weights beside that of the Chamfer distance, which is 1: of normals, of what bends, of the lengths of edges.
const NORMALS: f64 = 1.6e-4;
const BENDING: f64 = 0.3;
const EDGES: f64 = 0.1;

/// The loss of the meshes of all stages against points of the true surfaces; `connections` are those of the
/// stages.
pub(crate) fn deformation_loss(stages: &[Deformed], truth: &[&PointCloud], connections: &[Connections]) -> StepLoss {
    let points: Vec<&[Vec3]> = truth.iter().map(|cloud| cloud.points.as_slice()).collect();
    let names = ["chamfer", "edges", "normals", "bending"];
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
        let (length, cosine) = connections.edges(vertices, normals.as_ref());
        add(0, chamfer);
        add(1, length * EDGES);
        if let Some(cosine) = cosine {
            add(2, cosine * NORMALS);
        }
        // The first stage finds a ball: that it bends is what it is for.
        if stage > 0 {
            add(3, connections.bending(before, vertices) * BENDING);
        }
    }
    let terms: Vec<_> = names.into_iter().zip(sums).filter_map(|(name, sum)| Some((name, sum?))).collect();
    let total = terms.iter().map(|(_, term)| term.clone()).reduce(|a, b| a + b);
    let total = total.unwrap_or_else(|| Tensor::zeros([1], &stages[0].vertices.device()));
    StepLoss { total, terms, mask_iou: f64::NAN }
}

/// The normal of the nearest true point of each vertex, `[b, v, 3]`; `None` where an object has none.
fn normals_of(nearest: &[Vec<usize>], truth: &[&PointCloud], vertices: &Tensor<3>) -> Option<Tensor<3>> {
    let mut flat = Vec::with_capacity(vertices.dims().iter().product());
    for (nearest, cloud) in nearest.iter().zip(truth) {
        let normals = cloud.normals.as_ref()?;
        flat.extend(nearest.iter().flat_map(|&i| normals[i].to_array()));
    }
    Some(Tensor::from_data(TensorData::new(flat, vertices.dims()), &vertices.device()))
}
