//! Whole training steps against arrays of DVR's reference code, in single precision.

use std::collections::HashMap;

use burn::module::Module;
use burn::optim::{AdamConfig, GradientsParams};
use burn::tensor::{Device, Int, Tensor, TensorData};
use dvr_core::{Ray, UnitCube};
use dvr_render::{Field, Query, RootMethod, SlopeRule};
use dvr_tests::*;
use dvr_train::{
    LossWeights, MarchStage, OccupancyPoint, PixelBatch, StepNoise, Supervision, TrainConfig, losses, step_loss,
};
use glam::{DMat4, DVec3};

/// The value that the reference reads at a pixel location in [-1, 1]: nearest, `align_corners=False`, 0 outside the
/// image (fault 13: up to half a pixel off).
fn nearest(image: &[f64], size: usize, location: [f64; 2]) -> f64 {
    let index = |x: f64| {
        let i = (((x + 1.0) * size as f64 - 1.0) / 2.0) as f32;
        let rounded = i.round_ties_even();
        (rounded >= 0.0 && (rounded as usize) < size).then_some(rounded as usize)
    };
    match (index(location[0]), index(location[1])) {
        (Some(u), Some(v)) => image[v * size + u],
        _ => 0.0,
    }
}

fn matrices(values: &[f64]) -> Vec<DMat4> {
    values.chunks_exact(16).map(|m| DMat4::from_cols_slice(m).transpose()).collect()
}

/// A training step of the reference code, rebuilt from its arrays.
struct Step {
    batch: PixelBatch,
    noise: StepNoise,
    config: TrainConfig,
    images: usize,
    /// Background rays that miss the cube: we leave them out (fault 3), the reference asks for free space on them.
    outside: Vec<(i64, [f64; 3])>,
}

impl Step {
    fn rebuild(f: &mut Fixture, device: &Device) -> Self {
        let inverse = inverse_projections(f);
        let images = inverse.len();
        let locations: Vec<[f64; 2]> = f.numbers("p").chunks_exact(2).map(|p| [p[0], p[1]]).collect();
        let per_image = locations.len() / images;
        let ray = |(i, &[x, y]): (usize, &[f64; 2])| {
            let inverse = inverse[i / per_image];
            let origin = inverse.transform_point3(DVec3::ZERO);
            Ray { origin, direction: inverse.transform_point3(DVec3::new(x, y, 1.0)) - origin }
        };
        let rays: Vec<Ray> = locations.iter().enumerate().map(ray).collect();
        let pixels = Pixels::read(f, &locations, per_image);
        let (noise, outside) = noise(f, &rays, &pixels.object, per_image);
        let config = config(f);
        let color = rows(&pixels.color, 3, device);
        let patch = config.patch_size * config.patch_size;
        let mut batch = PixelBatch::new(&rays, color, pixels.object, pixels.z_depth, patch, None, device);
        batch.rays.object = Some(groups(rays.len(), images, device));
        Self { batch, noise, config, images, outside }
    }
}

/// From pixel locations and depth to object space, per image.
fn inverse_projections(f: &mut Fixture) -> Vec<DMat4> {
    let [camera, world, scale] = ["camera_mat", "world_mat", "scale_mat"].map(|name| matrices(&f.numbers(name)));
    (0..camera.len()).map(|i| (camera[i] * world[i] * scale[i]).inverse()).collect()
}

/// What the images show at the rays' pixels.
struct Pixels {
    color: Vec<f64>,
    object: Vec<bool>,
    z_depth: Vec<f32>,
}

impl Pixels {
    fn read(f: &mut Fixture, locations: &[[f64; 2]], per_image: usize) -> Self {
        let (image, mask, depth) = (f.numbers("img"), f.numbers("mask"), f.numbers("depth"));
        let plane = |values: &[f64], i: usize| values[i * 4096..(i + 1) * 4096].to_vec();
        let all = 0..locations.len();
        let color = all
            .clone()
            .flat_map(|i| (0..3).map(move |c| (i, c)))
            .map(|(i, c)| nearest(&plane(&image, 3 * (i / per_image) + c), 64, locations[i]))
            .collect();
        let object = all.clone().map(|i| nearest(&plane(&mask, i / per_image), 64, locations[i]) > 0.5).collect();
        let z_depth = all.map(|i| nearest(&plane(&depth, i / per_image), 64, locations[i]) as f32).collect();
        Self { color, object, z_depth }
    }
}

/// The random numbers of the step, and background rays outside the cube.
fn noise(f: &mut Fixture, rays: &[Ray], object: &[bool], per_image: usize) -> (StepNoise, Vec<(i64, [f64; 3])>) {
    let cube = UnitCube::default();
    let intervals: Vec<_> = rays.iter().map(|ray| cube.intersect(ray)).collect();
    let (free, occupied) = (f.points("p_freespace"), f.points("p_occupancy"));
    let along = (0..rays.len())
        .map(|i| {
            let (entry, exit) = intervals[i].unwrap_or((0.0, 1.0));
            let point = DVec3::from(if object[i] { occupied[i] } else { free[i] });
            let depth = (point - rays[i].origin).dot(rays[i].direction) / rays[i].direction.length_squared();
            ((depth - entry) / (exit - entry)) as f32
        })
        .collect();
    let outside = (0..rays.len())
        .filter(|&i| intervals[i].is_none() && !object[i])
        .map(|i| ((i / per_image) as i64, free[i]))
        .collect();
    let neighbor = f.points("u01").iter().map(|u| u.map(|u| u as f32)).collect();
    (StepNoise { jitter: None, along, neighbor }, outside)
}

/// The settings of the step.
fn config(f: &mut Fixture) -> TrainConfig {
    TrainConfig {
        march: vec![MarchStage { from_percent: 0, samples: f.number("n_steps") as usize }],
        jitter: false,
        root: RootMethod::Secant,
        root_steps: 8,
        slope: SlopeRule::CLASSIC,
        occupancy_point: OccupancyPoint::Random,
        patch_size: f.number("patch_size") as usize,
        losses: LossWeights {
            color: f.number("lambda_rgb"),
            detached_color: 0.0,
            image_gradient: f.number("lambda_image_gradients"),
            depth: f.number("lambda_depth"),
            depth_on_points: f.truths("depth_loss_on_world_points")[0],
            sparse_depth: 0.0,
            sparse_points: 0,
            free_space: f.number("lambda_freespace"),
            occupancy: f.number("lambda_occupied"),
            normal: f.number("lambda_normal"),
            normal_distance: 1e-3,
            normal_difference: 1e-3,
            normal_points: usize::MAX,
        },
        ..TrainConfig::new(Supervision::Rgb)
    }
}

#[test]
fn a_whole_training_step_has_the_reference_losses_gradients_and_adam_step() {
    let files = [("train_step_rgb_c0", 0), ("train_step_depth_c0", 0), ("train_step_all_c32", 32)];
    let device = Device::flex();
    for (file, code_dim) in files {
        for space in ["world", "cam"] {
            let mut f = Fixture::open(&format!("{file}_{space}"));
            let (_, decoder) = fixture_decoder(code_dim, &device.clone().autodiff());
            let codes = (code_dim > 0).then(|| Tensor::from_inner(rows(&f.numbers("c"), code_dim, &device)));
            let field = BoundDecoder::new(&decoder, codes);
            compare_step(&mut f, &field, &device, &format!("{file}_{space}"));
        }
    }
}

fn compare_step(f: &mut Fixture, field: &BoundDecoder, device: &Device, context: &str) {
    let step = Step::rebuild(f, device);
    let mut loss = step_loss(field, &field.valid(), &step.batch, &step.noise, &step.config, 0);
    // Theirs are sums over the rays divided by the images; ours are divided by the rays.
    let scale = step.batch.len() as f64 / step.images as f64;
    let (object, points): (Vec<i64>, Vec<[f64; 3]>) = step.outside.iter().copied().unzip();
    let object = Tensor::<1, Int>::from_data(TensorData::new(object, [points.len()]), device);
    let query = Query { object: Some(object), ..Query::new(tensor3(&points, device)) }.lifted();
    let outside = losses::free_space(field.occupancy_logit(&query)) / step.batch.len() as f64;
    loss.total = loss.total + outside.clone();
    loss.terms.push(("free_space", outside));
    let mut terms: HashMap<&str, f64> = HashMap::new();
    for (name, term) in &loss.terms {
        *terms.entry(name).or_default() += term.clone().into_scalar::<f64>() * scale;
    }
    terms.insert("total", loss.total.clone().into_scalar::<f64>() * scale);
    compare_terms(f, &terms, context);
    // Theirs is the mean over images; ours is that of all rays together, without rays that miss the cube.
    let hit = f.truths("mask_pred");
    let count = |both: bool| {
        let rays = (0..hit.len()).filter(|&i| step.batch.in_cube[i]);
        let object = &step.batch.object;
        rays.filter(|&i| if both { hit[i] && object[i] } else { hit[i] || object[i] }).count() as f64
    };
    assert!((loss.mask_iou - count(true) / count(false)).abs() < 1e-9, "{context}: the same rays hit");
    let gradients = GradientsParams::from_grads((loss.total * scale).backward(), field);
    compare_gradients(f, field, gradients, context);
}

fn compare_terms(f: &mut Fixture, terms: &HashMap<&str, f64>, context: &str) {
    let free_space: &[&str] = &["free_space", "free_space_missed", "free_space_entry"];
    for (key, names, tolerance) in [
        ("loss.loss_rgb", &["color"][..], 1e-4),
        ("loss.loss_image_gradient", &["image_gradient"], 1e-3),
        ("loss.loss_depth", &["depth"], 1e-4),
        ("loss.loss_freespace", free_space, 1e-4),
        ("loss.loss_occupied", &["occupancy"], 1e-4),
        ("loss.loss", &["total"], 1e-3),
    ] {
        if f.contains(key) {
            let value = names.iter().filter_map(|name| terms.get(name)).sum::<f64>();
            let truth = f.number(key);
            assert!((value - truth).abs() <= tolerance * truth.abs(), "{context} {key}: {value} {truth}");
        }
    }
}

fn compare_gradients(f: &mut Fixture, field: &BoundDecoder, gradients: GradientsParams, context: &str) {
    let mut visitor = GradientsByName { of: &gradients, path: Vec::new(), found: Vec::new() };
    field.visit(&mut visitor);
    for (name, ours) in &visitor.found {
        let key = match name.strip_prefix("decoder.") {
            Some(name) => format!("grad.{name}"),
            None => "grad_c".to_owned(),
        };
        let truth = f.numbers(&key);
        // The normal term divides single-precision differences by 1e-3.
        let difference = relative_difference(ours, &truth);
        assert!(difference < 5e-3, "{context} {key}: {difference}");
    }
    if f.contains("after_adam.fc_p.weight") {
        let mut adam = AdamConfig::new().with_epsilon(1e-8).init();
        let stepped = adam.step(1e-4, field.clone(), gradients);
        let moved = numbers(stepped.decoder.fc_p.weight.val().transpose());
        let difference = max_difference(&moved, &f.numbers("after_adam.fc_p.weight"));
        // Adam's first step is lr * sign(g): an entry with a gradient near 0 may go the other way.
        assert!(difference <= 2.1e-4, "{context}: {difference}");
    }
}

/// Gradients by parameter name, linear weights in PyTorch's layout.
struct GradientsByName<'a> {
    of: &'a GradientsParams,
    path: Vec<String>,
    found: Vec<(String, Vec<f64>)>,
}

impl burn::module::ModuleVisitor for GradientsByName<'_> {
    fn enter_module(&mut self, name: &str, _container: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _name: &str, _container: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &burn::module::Param<Tensor<D>>) {
        let name = self.path.join(".");
        let gradient: Tensor<D> = self.of.get(param.id).expect("every parameter has a gradient");
        let is_weight = D == 2 && name.ends_with("weight");
        self.found.push((name, numbers(if is_weight { gradient.transpose() } else { gradient })));
    }
}
