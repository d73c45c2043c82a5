//! No image at all: a learned code for each training object (an auto-decoder; Park et al. 2019, DeepSDF, section 4).

use burn::module::{Module, Param};
use burn::nn::Initializer;
use burn::tensor::{Device, Int, Tensor};

/// Deviation of fresh codes, as in DeepSDF.
const DEVIATION: f64 = 0.01;

/// The codes of all training objects.
///
/// It has the parameter name of the encoder `idx` of DVR's reference code, a PyTorch embedding: `encoder.weight`.
#[derive(Module, Debug)]
pub struct Codes {
    /// One row per object, `[objects, code_dim]`.
    pub weight: Param<Tensor<2>>,
}

impl Codes {
    /// Codes from a normal distribution of deviation 0.01.
    pub fn new(objects: usize, code_dim: usize, device: &Device) -> Self {
        Self { weight: Initializer::Normal { mean: 0.0, std: DEVIATION }.init([objects, code_dim], device) }
    }

    /// The codes `[b, code_dim]` of some objects `[b]`.
    pub fn forward(&self, objects: Tensor<1, Int>) -> Tensor<2> {
        self.weight.val().select(0, objects)
    }
}
