//! Shapes as pieces of surface.

use burn::module::{Module, Param};
use burn::nn::Initializer;
use burn::tensor::activation::{relu, tanh};
use burn::tensor::{Device, Tensor};
use dvr_core::UnitCube;

use super::points::for_relu;

/// A code as pieces of surface: a network each takes the square to space (Groueix et al. 2018, AtlasNet, section 4.2). Its
/// layers are as wide as `width`, half, and a quarter of it; there is no batch normalisation.
#[derive(Module, Debug)]
pub struct PatchDecoder {
    /// Code to the first layer, `[patches, code_dim, width]`.
    pub code: Param<Tensor<3>>,
    /// Place in the square to the first layer, `[patches, 2, width]`.
    pub place: Param<Tensor<3>>,
    /// First to second layer, `[patches, width, width / 2]`.
    pub fc1: Param<Tensor<3>>,
    /// Second to third layer, `[patches, width / 2, width / 4]`.
    pub fc2: Param<Tensor<3>>,
    /// Third layer to space, `[patches, width / 4, 3]`.
    pub out: Param<Tensor<3>>,
    /// Of the first layer, `[patches, 1, width]`.
    pub bias0: Param<Tensor<3>>,
    /// Of the second layer.
    pub bias1: Param<Tensor<3>>,
    /// Of the third layer.
    pub bias2: Param<Tensor<3>>,
    /// Of the last, `[patches, 1, 3]`.
    pub bias_out: Param<Tensor<3>>,
}

impl PatchDecoder {
    /// Random parameters.
    pub fn new(patches: usize, width: usize, code_dim: usize, device: &Device) -> Self {
        let weight = |input, output| for_relu(input).init([patches, input, output], device);
        let bias = |output| Initializer::Zeros.init([patches, 1, output], device);
        let out_bound = (1.0 / (width / 4) as f64).sqrt();
        let place = Initializer::Uniform { min: -1.0, max: 1.0 };
        Self {
            code: weight(code_dim, width),
            place: place.init([patches, 2, width], device),
            fc1: weight(width, width / 2),
            fc2: weight(width / 2, width / 4),
            out: Initializer::Uniform { min: -out_bound, max: out_bound }.init([patches, width / 4, 3], device),
            bias0: bias(width),
            bias1: bias(width / 2),
            bias2: bias(width / 4),
            bias_out: bias(3),
        }
    }

    /// How many pieces there are.
    pub fn patches(&self) -> usize {
        self.code.dims()[0]
    }

    /// Points `[b, patches * n, 3]` of codes `[b, code_dim]`, in object space, at places `[patches, n, 2]` in the unit squares
    /// of the pieces: those of the first piece first.
    pub fn forward(&self, codes: Tensor<2>, places: Tensor<3>) -> Tensor<3> {
        let [patches, n, _] = places.dims();
        let [objects, code_dim] = codes.dims();
        let codes = codes.unsqueeze_dim::<3>(0).expand([patches, objects, code_dim]);
        let of_code = (codes.matmul(self.code.val()) + self.bias0.val()).unsqueeze_dim::<4>(2);
        // Around the middle of the square.
        let of_place = (places * 2.0 - 1.0).matmul(self.place.val()).unsqueeze_dim::<4>(1);
        let net = relu((of_code + of_place).flatten::<3>(1, 2));
        let net = relu(net.matmul(self.fc1.val()) + self.bias1.val());
        let net = relu(net.matmul(self.fc2.val()) + self.bias2.val());
        let net = tanh(net.matmul(self.out.val()) + self.bias_out.val()) * UnitCube::default().half_extent();
        net.reshape([patches, objects, n, 3]).swap_dims(0, 1).reshape([objects, patches * n, 3])
    }
}
