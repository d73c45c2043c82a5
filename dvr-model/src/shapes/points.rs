//! Shapes as sets of points.

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig, ConvTranspose2d, ConvTranspose2dConfig};
use burn::nn::{Initializer, Linear, LinearConfig, PaddingConfig2d};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

/// Rows and columns of the coarsest layer of the second branch.
const COARSEST: [usize; 2] = [3, 4];

/// Points of the first branch.
const FREE_POINTS: usize = 256;

/// A code as 1024 points: 256 from fully connected layers, which find single parts, and 24x32 from transposed convolutions,
/// which find smooth surfaces (the two-branch version of Fan et al. 2017, section 4.2).
#[derive(Module, Debug)]
pub struct PointDecoder {
    /// First branch, hidden.
    pub fc0: Linear,
    /// First branch, hidden.
    pub fc1: Linear,
    /// First branch, its points.
    pub fc_out: Linear,
    /// Second branch, code to 3x4.
    pub fc_map: Linear,
    /// To 6x8.
    pub up0: ConvTranspose2d,
    /// To 12x16.
    pub up1: ConvTranspose2d,
    /// To 24x32.
    pub up2: ConvTranspose2d,
    /// To the points.
    pub out: Conv2d,
}

impl PointDecoder {
    /// How many points a shape has.
    pub const POINTS: usize = FREE_POINTS + 64 * COARSEST[0] * COARSEST[1];

    /// Numbers of the second branch's coarsest layer for each channel of its finest.
    pub(super) const FIRST: usize = 8 * COARSEST[0] * COARSEST[1];

    /// Random parameters; the finest layer has `width` channels, each coarser one twice as many.
    pub fn new(width: usize, code_dim: usize, device: &Device) -> Self {
        let hidden = 16 * width;
        let linear = |input, output| LinearConfig::new(input, output).with_initializer(for_relu(input)).init(device);
        let up = |input, output| {
            ConvTranspose2dConfig::new([input, output], [4; 2])
                .with_stride([2; 2])
                .with_padding([1; 2])
                .with_initializer(for_relu(4 * input))
                .init(device)
        };
        let out = Conv2dConfig::new([width, 3], [3; 2]).with_padding(PaddingConfig2d::Explicit(1, 1, 1, 1));
        Self {
            fc0: linear(code_dim, hidden),
            fc1: linear(hidden, hidden),
            fc_out: LinearConfig::new(hidden, 3 * FREE_POINTS).init(device),
            fc_map: linear(code_dim, Self::FIRST * width),
            up0: up(8 * width, 4 * width),
            up1: up(4 * width, 2 * width),
            up2: up(2 * width, width),
            out: out.init(device),
        }
    }

    /// Points `[b, 1024, 3]` of codes `[b, code_dim]`, in object space.
    pub fn forward(&self, codes: Tensor<2>) -> Tensor<3> {
        let [objects, _] = codes.dims();
        let free = relu(self.fc1.forward(relu(self.fc0.forward(codes.clone()))));
        let free = self.fc_out.forward(free).reshape([objects, FREE_POINTS, 3]);
        let [rows, columns] = COARSEST;
        let mut net = relu(self.fc_map.forward(codes)).reshape([objects, self.up0.channels[0], rows, columns]);
        for up in [&self.up0, &self.up1, &self.up2] {
            net = relu(up.forward(net));
        }
        let map = self.out.forward(net).flatten::<3>(2, 3).swap_dims(1, 2);
        Tensor::cat(vec![free, map], 1)
    }
}

/// Keeps the variance of what this many ReLUs add up to (He et al. 2015).
pub(super) fn for_relu(inputs: usize) -> Initializer {
    let bound = (6.0 / inputs as f64).sqrt();
    Initializer::Uniform { min: -bound, max: bound }
}
