//! The ResNet-FC decoder of the fixtures, evaluated as plainly as can be.

use std::path::Path;

use dvr_render::extract::ScalarField;
use glam::Vec3;
use safetensors::SafeTensors;

/// `y = W x + b`.
struct Linear {
    /// `[inputs][outputs]`, i.e. transposed.
    weight: Vec<f32>,
    bias: Vec<f32>,
}

impl Linear {
    fn read(file: &SafeTensors, name: &str) -> Self {
        let floats = |name: &str| -> Vec<f32> {
            let bytes = file.tensor(name).unwrap().data();
            bytes.chunks_exact(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap())).collect()
        };
        let (stored, bias) = (floats(&format!("{name}.weight")), floats(&format!("{name}.bias")));
        let inputs = stored.len() / bias.len();
        let weight = (0..stored.len()).map(|k| stored[(k % bias.len()) * inputs + k / bias.len()]).collect();
        Self { weight, bias }
    }

    fn apply(&self, input: &[f32]) -> Vec<f32> {
        let mut output = self.bias.clone();
        for (row, &x) in self.weight.chunks_exact(self.bias.len()).zip(input) {
            output.iter_mut().zip(row).for_each(|(y, w)| *y += w * x);
        }
        output
    }
}

/// A decoder without latent code: occupancy logit, and the texture before the sigmoid.
pub struct Decoder {
    fc_p: Linear,
    blocks: Vec<[Linear; 2]>,
    fc_out: Linear,
}

impl Decoder {
    /// Reads a bare state dict.
    pub fn open(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let block = |i: usize| ["fc_0", "fc_1"].map(|layer| Linear::read(&file, &format!("blocks.{i}.{layer}")));
        Self {
            fc_p: Linear::read(&file, "fc_p"),
            blocks: (0..5).map(block).collect(),
            fc_out: Linear::read(&file, "fc_out"),
        }
    }

    /// All four outputs at a point.
    pub fn forward(&self, point: Vec3) -> [f32; 4] {
        let relu = |x: &[f32]| x.iter().map(|x| x.max(0.0)).collect::<Vec<_>>();
        let mut net = self.fc_p.apply(&point.to_array());
        for [fc_0, fc_1] in &self.blocks {
            let residual = fc_1.apply(&relu(&fc_0.apply(&relu(&net))));
            net.iter_mut().zip(residual).for_each(|(x, dx)| *x += dx);
        }
        self.fc_out.apply(&relu(&net)).try_into().unwrap()
    }
}

impl ScalarField for Decoder {
    fn logits(&self, points: &[Vec3]) -> Vec<f32> {
        points.iter().map(|&point| self.forward(point)[0]).collect()
    }

    fn colors(&self, points: &[Vec3], _: &[Vec3], _: Option<&[Vec3]>) -> Option<Vec<[f32; 3]>> {
        let sigmoid = |x: f32| 1.0 / (1.0 + (-x).exp());
        Some(points.iter().map(|&point| self.forward(point)).map(|[_, r, g, b]| [r, g, b].map(sigmoid)).collect())
    }
}
