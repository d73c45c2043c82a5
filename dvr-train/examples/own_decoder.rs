//! A decoder of one's own, trained through the public API: `cargo run --release -p dvr-train --example own_decoder`.
//!
//! All that a field must do is evaluate; slopes, normals and marching come with the traits. This one is a plain MLP on
//! random Fourier features, fitted to the project's demo scene for a minute: a whole run in the folder `own_decoder`, with
//! checkpoints, validation, mesh and figures, stopped and resumed on the way.

use burn::module::{Module, Param};
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::{sigmoid, softplus};
use burn::tensor::{Device, Distribution, Tensor};
use dvr_core::Scene;
use dvr_render::{Crossing, Differentiable, Field, FieldValues, Query};
use dvr_train::{
    Checkpoint, FieldMethod, HullConfig, MeshOptions, RunFolder, RunOptions, Supervision, TrainConfig, finish, train,
};
use std::path::Path;
use std::time::Duration;

/// Random Fourier features (Tancik et al. 2020), then two hidden layers.
#[derive(Module, Debug)]
struct FourierMlp {
    frequencies: Param<Tensor<2>>,
    layers: Vec<Linear>,
    out: Linear,
}

impl FourierMlp {
    fn new(width: usize, device: &Device) -> Self {
        let frequencies = Tensor::random([3, width / 2], Distribution::Normal(0.0, 5.0), device);
        Self {
            frequencies: Param::from_tensor(frequencies).set_require_grad(false),
            layers: (0..2).map(|_| LinearConfig::new(width, width).init(device)).collect(),
            out: LinearConfig::new(width, 4).init(device),
        }
    }
}

impl Field for FourierMlp {
    fn evaluate(&self, query: &Query) -> FieldValues {
        let phase = query.points.clone().matmul(self.frequencies.val());
        let mut hidden = Tensor::cat(vec![phase.clone().sin(), phase.cos()], 1);
        for layer in &self.layers {
            hidden = softplus(layer.forward(hidden), 10.0);
        }
        let out = self.out.forward(hidden); // [n, 4]
        FieldValues { occupancy_logit: out.clone().narrow(1, 0, 1).squeeze_dim(1), color: sigmoid(out.narrow(1, 1, 3)) }
    }

    fn device(&self) -> Device {
        self.frequencies.val().device()
    }
}

impl Differentiable for FourierMlp {}
impl Crossing for FourierMlp {}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut scene = Scene::read(root.join("../assets/scenes/mug/mug"))?;
    let steps: usize = std::env::args().nth(1).map_or(Ok(400), |n| n.parse())?;
    let base = TrainConfig::new(Supervision::Rgb);
    let hull = HullConfig { warm_start_steps: steps.div_ceil(2), ..base.hull.clone() };
    let method =
        FieldMethod::new("fourier", TrainConfig { steps, hull, ..base }, |_, device| FourierMlp::new(128, device));

    // A run in a folder: first for a second, then to its end from the checkpoint.
    let folder = RunFolder::new("own_decoder");
    let _writing = folder.replace()?;
    let options = RunOptions::new(folder.clone(), Device::flex());
    let brief =
        RunOptions { time_limit: Some(Duration::from_secs(1)), ..RunOptions::new(folder.clone(), Device::flex()) };
    let first = train(&mut scene, &method, None, &brief, &mut ())?;
    println!("stopped after step {}", first.outcome.steps);
    let last = Checkpoint::load(&folder.last())?;
    let trained = train(&mut scene, &method, Some(&last), &options, &mut ())?;

    let results = finish(&scene, &method, &trained, &folder, &MeshOptions::with_resolution(128), &mut ())?;
    println!("{} steps, test views: {:?}", results.metrics.steps, results.metrics.test_mesh);
    println!("wrote {}", folder.mesh_ply().display());
    Ok(())
}
