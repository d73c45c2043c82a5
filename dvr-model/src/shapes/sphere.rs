//! Shapes as deformed spheres.

use std::sync::LazyLock;

use burn::module::Module;
use burn::nn::{Initializer, Linear, LinearConfig};
use burn::tensor::activation::{relu, sigmoid, tanh};
use burn::tensor::{Device, Tensor, TensorData};
use dvr_core::UnitCube;
use dvr_core::mesh::Mesh;
use dvr_core::mesh::shapes::icosphere;

use super::points::for_relu;

/// 642 vertices and 1280 faces, half as large as the cube.
static SPHERE: LazyLock<Mesh> = LazyLock::new(|| icosphere(3, 0.5));

/// Deviation of the last layer's fresh weights: it starts at the sphere.
const LAST_DEVIATION: f64 = 1e-3;

/// A code as a sphere whose vertices are moved within their octants, and then with their origin (Liu et al. 2019, Soft
/// Rasterizer, section 5.1, after Kato et al. 2018). A shape has the faces of [`SphereDecoder::sphere`].
#[derive(Module, Debug)]
pub struct SphereDecoder {
    /// Hidden.
    pub fc0: Linear,
    /// Hidden.
    pub fc1: Linear,
    /// Moves of the vertices.
    pub moves: Linear,
    /// Place of the origin.
    pub origin: Linear,
}

impl SphereDecoder {
    /// What is deformed; its vertices are in units of the cube's half edge.
    pub fn sphere() -> &'static Mesh {
        &SPHERE
    }

    /// Random parameters, which make a sphere of every code.
    pub fn new(width: usize, code_dim: usize, device: &Device) -> Self {
        let linear = |input, output| LinearConfig::new(input, output).with_initializer(for_relu(input)).init(device);
        let last = |output| {
            let weights = Initializer::Normal { mean: 0.0, std: LAST_DEVIATION };
            let bias = Some(Initializer::Zeros.init([output], device));
            Linear { weight: weights.init([2 * width, output], device), bias }
        };
        Self {
            fc0: linear(code_dim, width),
            fc1: linear(width, 2 * width),
            moves: last(3 * SPHERE.vertices.len()),
            origin: last(3),
        }
    }

    /// Vertices `[b, 642, 3]` of codes `[b, code_dim]`, in object space.
    pub fn forward(&self, codes: Tensor<2>) -> Tensor<3> {
        let [objects, _] = codes.dims();
        let device = codes.device();
        let n = SPHERE.vertices.len();
        let constant = |of: fn(f32) -> f32| {
            let values: Vec<f32> = SPHERE.vertices.iter().flat_map(|p| p.to_array()).map(of).collect();
            Tensor::<3>::from_data(TensorData::new(values, [1, n, 3]), &device)
        };
        // Zero at the sphere's great circles, where a vertex may leave on neither side.
        let sign = constant(|p| if p.abs() < 1e-6 { 0.0 } else { p.signum() });
        let logit = constant(|p| {
            let p = p.abs().clamp(1e-3, 1.0 - 1e-3);
            (p / (1.0 - p)).ln()
        });
        let net = relu(self.fc1.forward(relu(self.fc0.forward(codes))));
        let moves = self.moves.forward(net.clone()).reshape([objects, n, 3]);
        let within = sigmoid(moves + logit) * sign;
        // The octants are stretched and squeezed so that the cube stays full.
        let origin = tanh(self.origin.forward(net)).unsqueeze_dim::<3>(1);
        let forward = relu(within.clone()) * (origin.clone().neg() + 1.0);
        let backward = relu(within.neg()) * (origin.clone() + 1.0);
        (forward - backward + origin) * UnitCube::default().half_extent()
    }
}
