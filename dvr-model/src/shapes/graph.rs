//! Shapes as meshes that are deformed by graph convolutions.

use std::sync::LazyLock;

use burn::module::Module;
use burn::nn::{Initializer, Linear, LinearConfig};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Int, Tensor, TensorData};
use dvr_core::mesh::Mesh;
use dvr_core::mesh::shapes::icosphere;

use super::points::for_relu;
use crate::pixel_aligned::PixelAligned;

/// Radius of the ball that is deformed.
const RADIUS: f32 = 0.25;

/// How many meshes there are, each four times as fine as the one before, and how often the first one is subdivided.
const STAGES: usize = 3;
const COARSEST: u32 = 1;

/// Residual blocks of a stage.
const BLOCKS: usize = 2;

/// Deviation of the last layers' fresh weights: every shape starts as the ball.
const LAST_DEVIATION: f64 = 1e-3;

/// The meshes of all stages: balls of 42, 162 and 642 vertices.
static MESHES: LazyLock<Vec<Mesh>> =
    LazyLock::new(|| (0..STAGES).map(|stage| icosphere(COARSEST + stage as u32, RADIUS)).collect());

/// Who is next to whom in each mesh.
static NEIGHBOURS: LazyLock<Vec<Neighbours>> = LazyLock::new(|| MESHES.iter().map(Neighbours::of).collect());

/// A ball that is deformed in three stages, from coarse to fine, by features of the picture where its vertices lie (Wang et al.
/// 2018, Pixel2Mesh). The paper starts from an ellipsoid in front of the camera, with 156, 618 and 2466 vertices, six
/// blocks a stage and features of a VGG-16.
#[derive(Module, Debug)]
pub struct GraphDecoder {
    /// One after the other.
    pub stages: Vec<GraphStage>,
}

/// The mesh of a stage, `[b, v, 3]`.
#[derive(Clone, Debug)]
pub struct Deformed {
    /// As the stage found it.
    pub before: Tensor<3>,
    /// As it left it.
    pub vertices: Tensor<3>,
}

/// Graph convolutions with shortcuts, from features of vertices to their moves.
#[derive(Module, Debug)]
pub struct GraphStage {
    /// From places, the picture's features and the last stage's.
    pub first: GraphConvolution,
    /// Two in each residual block.
    pub blocks: Vec<GraphConvolution>,
    /// To the moves.
    pub last: GraphConvolution,
}

/// `W0 x_p + W1 mean(x_q) + b`, `q` being the neighbours of `p` (the paper's graph convolution has their sum).
#[derive(Module, Debug)]
pub struct GraphConvolution {
    /// Of the vertex itself, with the bias.
    pub own: Linear,
    /// Of its neighbours.
    pub near: Linear,
}

/// The neighbours of all vertices of a mesh, as many for each; where there are fewer, the last ones count as nothing.
struct Neighbours {
    /// `[vertices * most]`.
    rows: Vec<i64>,
    /// Of each, one over the number of neighbours, or nothing.
    shares: Vec<f32>,
    most: usize,
    /// Of each vertex that the next coarser mesh does not have, the two between which it lies.
    parents: [Vec<i64>; 2],
}

impl GraphDecoder {
    /// The meshes of the stages; only places of vertices differ from shape to shape.
    pub fn meshes() -> &'static [Mesh] {
        &MESHES
    }

    /// Random parameters, `width` features a vertex, for `channels` features of pictures.
    pub fn new(width: usize, channels: usize, device: &Device) -> Self {
        let stage = |stage: usize| {
            let carried = if stage > 0 { width } else { 0 };
            GraphStage {
                first: GraphConvolution::new(6 + channels + carried, width, device),
                blocks: (0..2 * BLOCKS).map(|_| GraphConvolution::new(width, width, device)).collect(),
                last: GraphConvolution::last(width, 3, device),
            }
        };
        Self { stages: (0..STAGES).map(stage).collect() }
    }

    /// Vertices of all stages, in object space, of `objects` pictures' features.
    pub(crate) fn forward(&self, features: &PixelAligned, objects: usize, device: &Device) -> Vec<Deformed> {
        let flat: Vec<f32> = MESHES[0].vertices.iter().flat_map(|vertex| vertex.to_array()).collect();
        let ball = Tensor::<3>::from_data(TensorData::new(flat, [1, MESHES[0].vertices.len(), 3]), device);
        let mut vertices = ball.repeat_dim(0, objects);
        let mut carried: Option<Tensor<3>> = None;
        let mut all = Vec::with_capacity(STAGES);
        for (stage, neighbours) in self.stages.iter().zip(NEIGHBOURS.iter()) {
            if !all.is_empty() {
                vertices = neighbours.refine(vertices);
                carried = carried.map(|features| neighbours.refine(features));
            }
            let [_, n, _] = vertices.dims();
            let object: Vec<i64> = (0..objects * n).map(|i| (i / n) as i64).collect();
            let object = Tensor::<1, Int>::from_data(TensorData::new(object, [objects * n]), device);
            let points = vertices.clone().reshape([objects * n, 3]);
            let seen = features.at(&points, &object);
            let turned = features.in_camera_axes(&points, &object);
            let seen = Tensor::cat(vec![points, turned, seen], 1);
            let channels = seen.dims()[1];
            let mut net = seen.reshape([objects, n, channels]);
            if let Some(carried) = carried.take() {
                net = Tensor::cat(vec![net, carried], 2);
            }
            net = relu(stage.first.forward(net, neighbours));
            for block in stage.blocks.chunks(2) {
                let mut inner = net.clone();
                for convolution in block {
                    inner = relu(convolution.forward(inner, neighbours));
                }
                net = (net + inner) * 0.5;
            }
            let moved = vertices.clone() + stage.last.forward(net.clone(), neighbours);
            all.push(Deformed { before: vertices, vertices: moved.clone() });
            vertices = moved;
            carried = Some(net);
        }
        all
    }
}

impl GraphConvolution {
    fn new(input: usize, output: usize, device: &Device) -> Self {
        let linear = |bias: bool| {
            // Two sums of `input` numbers are added.
            LinearConfig::new(input, output).with_bias(bias).with_initializer(for_relu(2 * input)).init(device)
        };
        Self { own: linear(true), near: linear(false) }
    }

    fn last(input: usize, output: usize, device: &Device) -> Self {
        let weights = || Initializer::Normal { mean: 0.0, std: LAST_DEVIATION }.init([input, output], device);
        let bias = Some(Initializer::Zeros.init([output], device));
        Self { own: Linear { weight: weights(), bias }, near: Linear { weight: weights(), bias: None } }
    }

    fn forward(&self, net: Tensor<3>, neighbours: &Neighbours) -> Tensor<3> {
        // The mean of what is linear: with fewer channels behind the product than before it, the product goes first.
        let near = neighbours.mean(self.near.forward(net.clone()));
        self.own.forward(net) + near
    }
}

impl Neighbours {
    fn of(mesh: &Mesh) -> Self {
        let mut near = vec![Vec::new(); mesh.vertices.len()];
        for face in &mesh.faces {
            for i in 0..3 {
                // Every edge of a closed mesh is there once in either direction.
                near[face[i] as usize].push(i64::from(face[(i + 1) % 3]));
            }
        }
        let most = near.iter().map(Vec::len).max().unwrap_or(0);
        let padded = |of: &Vec<i64>| (0..most).map(|i| of.get(i).copied().unwrap_or(of[0])).collect::<Vec<_>>();
        let shares = |of: &Vec<i64>| {
            (0..most).map(|i| if i < of.len() { 1.0 / of.len() as f32 } else { 0.0 }).collect::<Vec<_>>()
        };
        // A closed mesh of n vertices came of one of (n + 6) / 4.
        let coarse = (near.len() + 6) / 4;
        let mut parents: [Vec<i64>; 2] = Default::default();
        for of in &near[coarse..] {
            let ends: Vec<i64> = of.iter().copied().filter(|&other| (other as usize) < coarse).collect();
            for (list, end) in parents.iter_mut().zip(ends) {
                list.push(end);
            }
        }
        Self {
            rows: near.iter().flat_map(padded).collect(),
            shares: near.iter().flat_map(shares).collect(),
            most,
            parents,
        }
    }

    /// The mean of the neighbours of each vertex, of `[b, v, c]`.
    fn mean(&self, values: Tensor<3>) -> Tensor<3> {
        let [objects, n, channels] = values.dims();
        let device = values.device();
        let rows = Tensor::<1, Int>::from_data(TensorData::new(self.rows.clone(), [self.rows.len()]), &device);
        let shares = Tensor::<4>::from_data(TensorData::new(self.shares.clone(), [1, n, self.most, 1]), &device);
        let near = values.select(1, rows).reshape([objects, n, self.most, channels]);
        (near * shares).sum_dim(2).squeeze_dim(2)
    }

    /// Values of the next coarser mesh's vertices, and between them their means: `[b, v, c]` (the paper's graph unpooling).
    fn refine(&self, values: Tensor<3>) -> Tensor<3> {
        let device = values.device();
        let [a, b] = self.parents.each_ref().map(|rows| {
            let rows = Tensor::<1, Int>::from_data(TensorData::new(rows.clone(), [rows.len()]), &device);
            values.clone().select(1, rows)
        });
        Tensor::cat(vec![values, (a + b) * 0.5], 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refined_ball_is_the_finer_one_but_for_its_roundness() {
        let device = Device::flex();
        let tensor = |mesh: &Mesh| {
            let flat: Vec<f32> = mesh.vertices.iter().flat_map(|v| v.to_array()).collect();
            Tensor::<3>::from_data(TensorData::new(flat, [1, mesh.vertices.len(), 3]), &device)
        };
        for stage in 1..STAGES {
            let refined = NEIGHBOURS[stage].refine(tensor(&MESHES[stage - 1]));
            let finer = tensor(&MESHES[stage]);
            assert_eq!(refined.dims(), finer.dims());
            let directions = |of: Tensor<3>| of.clone() / of.square().sum_dim(2).sqrt();
            let off = (directions(refined) - directions(finer)).abs().max().into_scalar::<f32>();
            assert!(off < 1e-6, "{off}");
        }
    }

    #[test]
    fn the_mean_of_neighbours_of_a_ball_lies_within_it() {
        let device = Device::flex();
        let mesh = &MESHES[0];
        let flat: Vec<f32> = mesh.vertices.iter().flat_map(|v| v.to_array()).collect();
        let values = Tensor::<3>::from_data(TensorData::new(flat, [1, mesh.vertices.len(), 3]), &device);
        let mean: Vec<f32> = NEIGHBOURS[0].mean(values).into_data().iter::<f32>().collect();
        for (vertex, mean) in mesh.vertices.iter().zip(mean.chunks(3)) {
            let mean = glam::Vec3::from_slice(mean);
            assert!(mean.length() < 0.95 * RADIUS && mean.normalize().dot(vertex.normalize()) > 0.99);
        }
    }
}
