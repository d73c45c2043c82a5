//! The paper's decoder: a ResNet of fully connected blocks for occupancy and texture together.

use burn::config::Config;
use burn::module::Module;
use burn::nn::{Initializer, Linear, LinearConfig};
use burn::tensor::activation::{leaky_relu, relu};
use burn::tensor::{Device, Int, Tensor};
use dvr_core::number_range::{NumberRange, whole};
use dvr_render::gather_rows;

use crate::aligned_features::AlignedFeatures;
use crate::encoding;

/// Configuration of a [`Decoder`]. The defaults are those of DVR's reference code, but for the width.
#[derive(Config, Debug, PartialEq)]
pub struct DecoderConfig {
    /// Length of the latent code `c` of an object; 0 for one scene without a code.
    #[config(default = 0)]
    pub code_dim: usize,
    /// Width of the hidden layers. The paper uses 512 for datasets of objects.
    #[config(default = 128)]
    pub hidden: usize,
    /// Number of residual blocks.
    #[config(default = 5)]
    pub blocks: usize,
    /// Whether the last activation is a leaky ReLU (slope 0.2) instead of a ReLU.
    #[config(default = false)]
    pub leaky: bool,
    /// Octaves of sines and cosines given to the network beside the coordinates; with 0, as in the paper, there are none.
    #[config(default = 0)]
    pub octaves: usize,
    /// Whether a code scales the hidden layers too, and does not only shift them: feature-wise linear modulation (Perez et al.
    /// 2018), which Occupancy Networks have with a normalisation before it.
    #[config(default = false)]
    pub film: bool,
}

impl DecoderConfig {
    /// The range of every number.
    pub const RANGES: &[NumberRange] =
        &[whole("code_dim", 0, 4096), whole("hidden", 1, 4096), whole("blocks", 0, 64), whole("octaves", 0, 16)];

    /// How many numbers the decoder has; no layer counts as none, so that a file of few bytes has few layers.
    pub fn parameters(&self) -> u64 {
        let hidden = self.hidden.max(1) as u64;
        let linear = |input: u64, output: u64| input.saturating_add(1).saturating_mul(output);
        let first = linear((self.octaves as u64).saturating_mul(6).saturating_add(3), hidden);
        let given = if self.film { hidden.saturating_mul(2) } else { hidden };
        let code = if self.code_dim > 0 { linear(self.code_dim as u64, given) } else { 0 };
        let block = linear(hidden, hidden).saturating_mul(2).saturating_add(code);
        let blocks = block.saturating_mul(self.blocks as u64);
        first.saturating_add(blocks).saturating_add(linear(hidden, 4))
    }

    /// Fresh parameters. The second layer of each block starts at zero, so that every block starts as the identity.
    pub fn init(&self, device: &Device) -> Decoder {
        let linear = |input, output| LinearConfig::new(input, output).init(device);
        let blocks = (0..self.blocks).map(|_| ResnetBlock {
            fc_0: linear(self.hidden, self.hidden),
            fc_1: Linear {
                weight: Initializer::Zeros.init([self.hidden, self.hidden], device),
                ..linear(self.hidden, self.hidden)
            },
        });
        let codes = if self.code_dim > 0 { self.blocks } else { 0 };
        let given = if self.film { 2 * self.hidden } else { self.hidden };
        Decoder {
            fc_p: linear(3 + 6 * self.octaves, self.hidden),
            fc_c: (0..codes).map(|_| linear(self.code_dim, given)).collect(),
            blocks: blocks.collect(),
            fc_out: linear(self.hidden, 4),
            leaky: self.leaky,
            octaves: self.octaves,
        }
    }
}

/// Occupancy logit and colour from a point and a latent code (DVR, section 4.1 and its supplement, figure 1).
///
/// `net = fc_p(p)`; before each block `net += fc_c(c)`; a block is `x + fc_1(relu(fc_0(relu(x))))`;
/// `out = fc_out(relu(net))`: channel 0 is the occupancy logit, the sigmoid of channels 1 to 3 is the colour. With
/// [`DecoderConfig::film`], `net = net (1 + scale) + shift` before each block, where `(shift, scale) = fc_c(c)`.
/// Parameter names are those of the reference code's checkpoints.
#[derive(Module, Debug)]
pub struct Decoder {
    /// Points (and their encoding) to hidden, `[3 + 6 octaves, hidden]`.
    pub fc_p: Linear,
    /// Code to hidden, one per block, `[code_dim, hidden]`, twice as wide with [`DecoderConfig::film`]; empty without a code.
    pub fc_c: Vec<Linear>,
    /// The residual blocks.
    pub blocks: Vec<ResnetBlock>,
    /// Hidden to logit and raw colour, `[hidden, 4]`.
    pub fc_out: Linear,
    /// Whether the last activation is leaky.
    pub leaky: bool,
    /// Octaves of the encoding of points.
    pub octaves: usize,
}

/// `x + fc_1(relu(fc_0(relu(x))))`.
#[derive(Module, Debug)]
pub struct ResnetBlock {
    /// First layer, `[hidden, hidden]`.
    pub fc_0: Linear,
    /// Second layer, `[hidden, hidden]`; starts at zero.
    pub fc_1: Linear,
}

/// Slope of the leaky ReLU for negative values, as in the reference code.
pub(crate) const LEAK: f64 = 0.2;

impl Decoder {
    /// Raw outputs, `[n, 4]`: occupancy logit, then the colour before the sigmoid.
    ///
    /// `points` is `[n, 3]`; `code` holds one latent code per point, `[n, code_dim]`, or is `None`.
    pub fn forward(&self, points: Tensor<2>, code: Option<Tensor<2>>) -> Tensor<2> {
        self.outputs(points, &self.conditions(code), None, None)
    }

    /// What the codes `[m, code_dim]` make of the layer before each block: one `[m, hidden]` per block that is added, or one
    /// `[m, 2 hidden]` that shifts and then scales; none without codes.
    pub(crate) fn conditions(&self, codes: Option<Tensor<2>>) -> Vec<Tensor<2>> {
        codes.map_or_else(Vec::new, |codes| self.fc_c.iter().map(|fc_c| fc_c.forward(codes.clone())).collect())
    }

    /// As [`Decoder::forward`], with the codes already projected; `object` picks the row of each point, see [`given`].
    /// `aligned` are features of the objects' pictures, which are added to the first layer.
    pub(crate) fn outputs(
        &self,
        points: Tensor<2>,
        conditions: &[Tensor<2>],
        object: Option<&Tensor<1, Int>>,
        aligned: Option<&AlignedFeatures>,
    ) -> Tensor<2> {
        let mut net = self.fc_p.forward(encoding::encode(points.clone(), self.octaves));
        if let Some(aligned) = aligned {
            net = net + aligned.at(&points, object);
        }
        for (i, block) in self.blocks.iter().enumerate() {
            net = given(net, conditions.get(i).map(|condition| of_points(condition, object)));
            let inner = relu(block.fc_0.forward(relu(net.clone())));
            net = net + block.fc_1.forward(inner);
        }
        self.fc_out.forward(if self.leaky { leaky_relu(net, LEAK) } else { relu(net) })
    }

    /// Raw outputs `[n, 4]` and, for each of several directions `[n, 3]`, their derivative along it, `[n, 4]`.
    ///
    /// One forward-mode pass: the value is carried once, each tangent costs as much again. ReLUs pass a tangent where
    /// their input is positive.
    pub fn forward_mode(
        &self,
        points: Tensor<2>,
        code: Option<Tensor<2>>,
        directions: Vec<Tensor<2>>,
    ) -> (Tensor<2>, Vec<Tensor<2>>) {
        self.tangents(points, &self.conditions(code), None, None, directions)
    }

    /// As [`Decoder::forward_mode`], with the codes already projected.
    pub(crate) fn tangents(
        &self,
        points: Tensor<2>,
        conditions: &[Tensor<2>],
        object: Option<&Tensor<1, Int>>,
        aligned: Option<&AlignedFeatures>,
        directions: Vec<Tensor<2>>,
    ) -> (Tensor<2>, Vec<Tensor<2>>) {
        let mut tangents: Vec<_> = directions
            .iter()
            .map(|direction| {
                let encoded = encoding::encode_tangent(points.clone(), direction.clone(), self.octaves);
                encoded.matmul(self.fc_p.weight.val())
            })
            .collect();
        let mut net = self.fc_p.forward(encoding::encode(points.clone(), self.octaves));
        if let Some(aligned) = aligned {
            let (features, along) = aligned.tangents(&points, object, &directions);
            net = net + features;
            tangents = tangents.into_iter().zip(along).map(|(tangent, along)| tangent + along).collect();
        }
        for (i, block) in self.blocks.iter().enumerate() {
            let condition = conditions.get(i).map(|condition| of_points(condition, object));
            if let Some(factor) = condition.as_ref().and_then(|condition| factor(&net, condition)) {
                tangents = tangents.into_iter().map(|tangent| tangent * factor.clone()).collect();
            }
            net = given(net, condition);
            let off = net.clone().lower_equal_elem(0.0);
            let inner = block.fc_0.forward(relu(net.clone()));
            let inner_off = inner.clone().lower_equal_elem(0.0);
            net = net + block.fc_1.forward(relu(inner));
            for tangent in &mut tangents {
                let through = tangent.clone().mask_fill(off.clone(), 0.0).matmul(block.fc_0.weight.val());
                let through = through.mask_fill(inner_off.clone(), 0.0).matmul(block.fc_1.weight.val());
                *tangent = tangent.clone() + through;
            }
        }
        let off = net.clone().lower_equal_elem(0.0);
        let slope_below = if self.leaky { LEAK } else { 0.0 };
        let out_tangents = tangents.into_iter().map(|tangent| {
            let below = tangent.clone() * slope_below;
            tangent.mask_where(off.clone(), below).matmul(self.fc_out.weight.val())
        });
        let out_tangents = out_tangents.collect();
        let out = self.fc_out.forward(if self.leaky { leaky_relu(net, LEAK) } else { relu(net) });
        (out, out_tangents)
    }
}

/// What the codes make of a layer, for each point: the row of `condition` that `object` `[n]` picks, or without `object` a row
/// per point, or the only row for all of them.
fn of_points(condition: &Tensor<2>, object: Option<&Tensor<1, Int>>) -> Tensor<2> {
    match object {
        Some(object) => gather_rows(condition.clone(), object.clone()),
        None => condition.clone(),
    }
}

/// What a condition multiplies a layer `[n, hidden]` by, where it does: it is then twice as wide.
fn factor(net: &Tensor<2>, condition: &Tensor<2>) -> Option<Tensor<2>> {
    let hidden = net.dims()[1];
    (condition.dims()[1] == 2 * hidden).then(|| condition.clone().narrow(1, hidden, hidden) + 1.0)
}

/// A layer `[n, hidden]` under the condition of its points' codes.
fn given(net: Tensor<2>, condition: Option<Tensor<2>>) -> Tensor<2> {
    let Some(condition) = condition else { return net };
    let hidden = net.dims()[1];
    match factor(&net, &condition) {
        Some(factor) => net * factor + condition.narrow(1, 0, hidden),
        None => net + condition,
    }
}
