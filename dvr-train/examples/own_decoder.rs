//! A decoder of one's own, trained through the public API: `cargo run --release -p dvr-train --example own_decoder`.
//!
//! All that a field must do is evaluate; slopes, normals and marching come with the traits. This one is a plain MLP on
//! random Fourier features, fitted to the project's demo scene for a minute and written as `own_decoder.ply`.

use burn::module::{Module, Param};
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::{sigmoid, softplus};
use burn::tensor::{Device, Distribution, Tensor};
use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::mesh::write_mesh;
use dvr_render::extract::FieldSurface;
use dvr_render::{Crossing, Differentiable, Field, FieldValues, Query};
use dvr_train::{
    HullUse, MeshOptions, Supervision, TrainConfig, Trainer, ViewSplit, carve_hull, hull_bound, object_mesh,
    warm_start, world_mesh,
};
use std::path::Path;
use std::sync::atomic::AtomicBool;

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
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes/mug/mug");
    let scene = read_scene(&folder, &ReadOptions::default())?;
    let steps: usize = std::env::args().nth(1).map_or(Ok(400), |n| n.parse())?;
    let base = TrainConfig::new(Supervision::Rgb);
    let hull_use = HullUse { warm_start_steps: steps.div_ceil(2), ..base.hull.clone() };
    let config = TrainConfig { steps, hull: hull_use, ..base };

    let device = Device::flex();
    device.seed(config.seed);
    let views = ViewSplit::new(&scene, config.hold_out_every)?;
    let hull = carve_hull(&views.train, config.hull.resolution)?;
    let field = FourierMlp::new(128, &device.clone().autodiff());
    let field = warm_start(field, &hull, &config, &device, &AtomicBool::new(false), |_| ());
    let mut trainer = Trainer::new(field, views, config, device).with_bound(hull_bound(&hull));
    while trainer.steps_done() < steps {
        let report = trainer.step()?;
        if report.step % 50 == 0 {
            println!("step {}: loss {:.4}, silhouette IoU {:.3}", report.step, report.loss, report.mask_iou);
        }
    }
    let field = trainer.frozen();
    let surface = FieldSurface::new(&field);
    let mesh = object_mesh(&surface, &MeshOptions::default(), &[], &trainer.views().train)?.mesh;
    write_mesh("own_decoder.ply", &world_mesh(&mesh, &scene.object_to_world))?;
    println!("wrote own_decoder.ply ({} faces)", mesh.faces.len());
    Ok(())
}
