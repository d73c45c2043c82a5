//! Decoder, losses and whole training steps against arrays of DVR's reference code, in single precision.

use std::collections::HashMap;

use burn::module::Module;
use burn::optim::{AdamConfig, GradientsParams};
use burn::tensor::{Device, Int, Tensor, TensorData};
use dvr_core::{Ray, UnitCube};
use dvr_model::{Conditioned, Decoder};
use dvr_render::{Crossing, Differentiable, Field, FieldJet, FieldValues, Query, RootMethod, SlopeRule};
use dvr_tests::*;
use dvr_train::{
    LossWeights, MarchStage, OccupancyPoint, PixelBatch, StepNoise, Supervision, TrainConfig, losses, step_loss,
};
use glam::{DMat4, DVec3};

fn rows(values: &[f64], width: usize, device: &Device) -> Tensor<2> {
    Tensor::from_data(TensorData::new(values.to_vec(), [values.len() / width, width]), device)
}

/// Object index of each of `n` points in `batch` equal groups.
fn groups(n: usize, batch: usize, device: &Device) -> Tensor<1, Int> {
    let index: Vec<i64> = (0..n).map(|i| (i / (n / batch)) as i64).collect();
    Tensor::from_data(TensorData::new(index, [n]), device)
}

#[test]
fn the_decoder_gives_the_reference_values_with_and_without_code() {
    for (name, device) in devices() {
        for code_dim in [0, 32] {
            let Some(mut fixture) = Fixture::open(&format!("decoder_eval_c{code_dim}_h64")) else { return };
            let Some((_, decoder)) = fixture_decoder(code_dim, &device) else { return };
            let points_name = if fixture.contains("p") { "p" } else { "points" };
            let points = fixture.points(points_name);
            let truth = fixture.numbers("out");
            let code = (code_dim > 0).then(|| {
                let codes = fixture.numbers("c");
                let batch = codes.len() / code_dim;
                rows(&codes, code_dim, &device).select(0, groups(points.len(), batch, &device))
            });
            let out = numbers(decoder.forward(tensor3(&points, &device), code));
            assert!(max_difference(&out, &truth) < 2e-5, "{name} c{code_dim}: {}", max_difference(&out, &truth));
        }
    }
}

#[test]
fn the_codes_file_holds_the_codes_of_the_ray_files() {
    let (Some(mut codes), Some(mut rays)) = (Fixture::open("codes_c32"), Fixture::open("rays_c32_h64")) else { return };
    assert_eq!(codes.numbers("codes"), rays.numbers("c"));
}

/// Value and gradient with respect to the prediction.
fn value_and_gradient<const D: usize>(prediction: Tensor<D>, loss: impl Fn(Tensor<D>) -> Tensor<1>) -> (f64, Vec<f64>) {
    let prediction = Tensor::<D>::from_inner(prediction).require_grad();
    let value = loss(prediction.clone());
    let gradients = value.backward();
    (value.into_scalar::<f64>(), numbers(prediction.grad(&gradients).unwrap()))
}

/// Scatters gradients of the kept rows back among zeros.
fn scattered(gradient: &[f64], keep: &[bool], width: usize) -> Vec<f64> {
    let mut rows = gradient.chunks_exact(width);
    keep.iter().flat_map(|&k| if k { rows.next().unwrap().to_vec() } else { vec![0.0; width] }).collect()
}

fn close(ours: f64, truth: f64, tolerance: f64, context: &str) {
    assert!((ours - truth).abs() <= tolerance * truth.abs().max(1.0), "{context}: {ours} instead of {truth}");
}

#[test]
fn colour_and_image_gradient_losses_are_those_of_the_reference() {
    let Some(mut f) = Fixture::open("losses") else { return };
    let (predicted, truth, mask) = (f.numbers("rgb_pred"), f.numbers("rgb_gt"), f.truths("rgb_mask"));
    let kept = |values: &[f64], keep: &[bool]| -> Vec<f64> {
        values.chunks_exact(3).zip(keep).filter(|(_, k)| **k).flat_map(|(v, _)| v.to_vec()).collect()
    };
    for (name, device) in devices() {
        let truth_on = |keep: &[bool]| Tensor::<2>::from_inner(rows(&kept(&truth, keep), 3, &device));
        let (sum, gradient) =
            value_and_gradient(rows(&kept(&predicted, &mask), 3, &device), |p| losses::color_l1(p, truth_on(&mask)));
        let count = mask.iter().filter(|m| **m).count() as f64;
        close(sum, f.number("rgb_l1.sum"), 1e-5, name);
        close(sum / count, f.number("rgb_l1.mean"), 1e-5, name);
        let gradient = scattered(&gradient, &mask, 3);
        assert!(max_difference(&gradient, &f.numbers("rgb_l1.sum.grad_pred")) < 1e-6);
        let mean: Vec<f64> = gradient.iter().map(|g| g / count).collect();
        assert!(max_difference(&mean, &f.numbers("rgb_l1.mean.grad_pred")) < 1e-6);

        for size in [2usize, 3] {
            let pixels = size * size;
            let keep: Vec<bool> = mask.chunks_exact(pixels).flat_map(|p| vec![p.iter().all(|m| *m); pixels]).collect();
            let patches = (keep.iter().filter(|k| **k).count() / pixels) as f64;
            let (sum, gradient) = value_and_gradient(rows(&kept(&predicted, &keep), 3, &device), |p| {
                losses::image_gradient(p, truth_on(&keep), size)
            });
            close(sum, f.number(&format!("image_gradient.ps{size}.sum")), 1e-5, name);
            close(sum / patches, f.number(&format!("image_gradient.ps{size}.mean")), 1e-5, name);
            let gradient = scattered(&gradient, &keep, 3);
            let reference = f.numbers(&format!("image_gradient.ps{size}.sum.grad_pred"));
            assert!(max_difference(&gradient, &reference) < 1e-5, "{name}");
            let mean: Vec<f64> = gradient.iter().map(|g| g / patches).collect();
            assert!(max_difference(&mean, &f.numbers(&format!("image_gradient.ps{size}.mean.grad_pred"))) < 1e-5);
        }
    }
}

#[test]
fn occupancy_free_space_and_depth_losses_are_those_of_the_reference() {
    let Some(mut f) = Fixture::open("losses") else { return };
    for (name, device) in devices() {
        let logits = f.numbers("logits");
        let n = logits.len() as f64;
        for (key, loss) in
            [("freespace", losses::free_space as fn(Tensor<1>) -> Tensor<1>), ("occupancy", losses::occupancy)]
        {
            let (sum, gradient) = value_and_gradient(tensor1(&logits, &device), loss);
            close(sum, f.number(&format!("{key}.sum")), 1e-5, key);
            close(sum / n, f.number(&format!("{key}.mean")), 1e-5, key);
            assert!(max_difference(&gradient, &f.numbers(&format!("{key}.sum.grad"))) < 1e-5, "{name} {key}");
            let mean: Vec<f64> = gradient.iter().map(|g| g / n).collect();
            assert!(max_difference(&mean, &f.numbers(&format!("{key}.mean.grad"))) < 1e-5, "{name} {key}");
        }
        // The weighted form is one term a point times its weight: what our sum is made of.
        let weights = f.numbers("logit_weights");
        let weighted: f64 =
            logits.iter().zip(&weights).map(|(&l, &w)| w * numbers(losses::occupancy(tensor1(&[l], &device)))[0]).sum();
        close(weighted, f.number("occupancy_weighted.sum"), 1e-4, name);
        close(weighted / n, f.number("occupancy_weighted.mean"), 1e-4, name);

        let (p, t) = (f.numbers("depth_pred"), f.numbers("depth_gt"));
        let (sum, gradient) =
            value_and_gradient(tensor1(&p, &device), |p| losses::depth_l1(p, Tensor::from_inner(tensor1(&t, &device))));
        close(sum, f.number("depth_l1.sum"), 1e-5, name);
        close(sum / p.len() as f64, f.number("depth_l1.mean"), 1e-5, name);
        assert!(max_difference(&gradient, &f.numbers("depth_l1.sum.grad_pred")) < 1e-6);
        let mean: Vec<f64> = gradient.iter().map(|g| g / p.len() as f64).collect();
        assert!(max_difference(&mean, &f.numbers("depth_l1.mean.grad_pred")) < 1e-6);

        let (p, t) = (f.numbers("world_pred"), f.numbers("world_gt"));
        let (sum, gradient) = value_and_gradient(rows(&p, 3, &device), |p| {
            losses::point_distance(p, Tensor::from_inner(rows(&t, 3, &device)))
        });
        close(sum, f.number("depth_l2_world.sum"), 1e-5, name);
        close(sum * 3.0 / p.len() as f64, f.number("depth_l2_world.mean"), 1e-5, name);
        assert!(max_difference(&gradient, &f.numbers("depth_l2_world.sum.grad_pred")) < 1e-5);
        let mean: Vec<f64> = gradient.iter().map(|g| g * 3.0 / p.len() as f64).collect();
        assert!(max_difference(&mean, &f.numbers("depth_l2_world.mean.grad_pred")) < 1e-5);
    }
}

#[test]
fn normals_by_differences_and_their_smoothness_are_those_of_the_reference() {
    let Some(mut f) = Fixture::open("losses") else { return };
    let device = Device::flex();
    for code_dim in [0usize, 32] {
        let key = |name: &str| format!("normal_c{code_dim}.{name}");
        let Some((_, decoder)) = fixture_decoder(code_dim, &device) else { return };
        let (points, mask) = (f.points(&key("points")), f.truths(&key("mask")));
        let batch = if code_dim == 0 { 1 } else { 3 };
        let keep: Vec<usize> = (0..points.len()).filter(|&i| mask[i]).collect();
        let picked: Vec<_> = keep.iter().map(|&i| points[i]).collect();
        let objects = groups(points.len(), batch, &device).select(
            0,
            Tensor::from_data(TensorData::new(keep.iter().map(|&i| i as i64).collect(), [keep.len()]), &device),
        );
        let shift: Vec<[f64; 3]> = f.points(&key("u01")).iter().map(|u| u.map(|u| (u - 0.5) * 1e-3)).collect();
        let at = tensor3(&picked, &device);
        let field = BoundDecoder::new(&decoder, (code_dim > 0).then(|| rows(&f.numbers(&key("c")), 32, &device)));
        let there = at.clone() + tensor3(&shift, &device);
        let differences = |points: &Tensor<2>| {
            let along = (0..3).map(|axis| {
                let logit = |side: f64| {
                    let query = Query { object: Some(objects.clone()), ..Query::new(points.clone()) };
                    let points = points.clone() + dvr_render::axis_direction(&query, axis) * (side * 0.5e-3);
                    field.occupancy_logit(&Query { points, ..query })
                };
                (logit(1.0) - logit(-1.0)).unsqueeze_dim::<2>(1)
            });
            let gradient = Tensor::<2>::cat(along.collect(), 1);
            gradient.clone() / gradient.square().sum_dim(1).sqrt()
        };
        for (points, name) in [(&at, "n"), (&there, "n_neighbor")] {
            let difference = relative_difference(&numbers(differences(points)), &f.numbers(&key(name)));
            // Single precision: 1e-6 of rounding over 1e-3.
            assert!(difference < 2e-3, "c{code_dim} {name}: {difference}");
        }
        let (n, n_neighbor) = (f.numbers(&key("n")), f.numbers(&key("n_neighbor")));
        let from_arrays =
            losses::normal_smoothness(rows(&n, 3, &device), rows(&n_neighbor, 3, &device)).into_scalar::<f64>();
        let reference = f.number(&key("loss_sum_over_batch")) / f.number(&key("lambda_normal")) * batch as f64;
        assert!((from_arrays - reference).abs() < 2e-3 * reference, "c{code_dim}: {from_arrays} {reference}");
    }
}

/// A decoder with or without codes as one type.
#[derive(Module, Debug)]
struct BoundDecoder {
    decoder: Decoder,
    codes: Option<burn::module::Param<Tensor<2>>>,
}

impl BoundDecoder {
    fn new(decoder: &Decoder, codes: Option<Tensor<2>>) -> Self {
        Self { decoder: decoder.clone(), codes: codes.map(burn::module::Param::from_tensor) }
    }

    fn bound(&self) -> Option<Conditioned> {
        Some(self.decoder.with_codes(self.codes.as_ref()?.val()))
    }
}

impl Field for BoundDecoder {
    fn evaluate(&self, query: &Query) -> FieldValues {
        self.bound().map_or_else(|| self.decoder.evaluate(query), |bound| bound.evaluate(query))
    }

    fn device(&self) -> Device {
        self.decoder.device()
    }
}

impl Differentiable for BoundDecoder {
    fn jet(&self, query: &Query, direction: Tensor<2>) -> FieldJet {
        match self.bound() {
            Some(bound) => bound.jet(query, direction),
            None => self.decoder.jet(query, direction),
        }
    }

    fn occupancy_gradient(&self, query: &Query) -> Tensor<2> {
        self.bound().map_or_else(|| self.decoder.occupancy_gradient(query), |bound| bound.occupancy_gradient(query))
    }
}

impl Crossing for BoundDecoder {}

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
        let (image, mask, depth) = (f.numbers("img"), f.numbers("mask"), f.numbers("depth"));
        let inverse: Vec<DMat4> = {
            let (c, w, s) = (
                matrices(&f.numbers("camera_mat")),
                matrices(&f.numbers("world_mat")),
                matrices(&f.numbers("scale_mat")),
            );
            (0..c.len()).map(|i| (c[i] * w[i] * s[i]).inverse()).collect()
        };
        let images = inverse.len();
        let locations: Vec<[f64; 2]> = f.numbers("p").chunks_exact(2).map(|p| [p[0], p[1]]).collect();
        let a_image = locations.len() / images;
        let rays: Vec<Ray> = locations
            .iter()
            .enumerate()
            .map(|(i, &[x, y])| {
                let inverse = inverse[i / a_image];
                let origin = inverse.transform_point3(DVec3::ZERO);
                Ray { origin, direction: inverse.transform_point3(DVec3::new(x, y, 1.0)) - origin }
            })
            .collect();
        let plane = |values: &[f64], i: usize| values[i * 4096..(i + 1) * 4096].to_vec();
        let color: Vec<f64> = (0..locations.len())
            .flat_map(|i| (0..3).map(move |c| (i, c)))
            .map(|(i, c)| nearest(&plane(&image, 3 * (i / a_image) + c), 64, locations[i]))
            .collect();
        let object: Vec<bool> =
            (0..locations.len()).map(|i| nearest(&plane(&mask, i / a_image), 64, locations[i]) > 0.5).collect();
        let z_depth: Vec<f32> =
            (0..locations.len()).map(|i| nearest(&plane(&depth, i / a_image), 64, locations[i]) as f32).collect();
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
            .map(|i| ((i / a_image) as i64, free[i]))
            .collect();
        let neighbor = f.points("u01").iter().map(|u| u.map(|u| u as f32)).collect();
        let patch_size = f.number("patch_size") as usize;
        let color = rows(&color, 3, device);
        let mut batch = PixelBatch::new(&rays, color, object, z_depth, patch_size * patch_size, None, device);
        batch.rays.object = Some(groups(rays.len(), images, device));
        let config = TrainConfig {
            march: vec![MarchStage { from_percent: 0, samples: f.number("n_steps") as usize }],
            jitter: false,
            root: RootMethod::Secant,
            root_steps: 8,
            slope: SlopeRule::CLASSIC,
            occupancy_point: OccupancyPoint::Random,
            patch_size,
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
        };
        Self { batch, noise: StepNoise { jitter: None, along, neighbor }, config, images, outside }
    }
}

#[test]
fn a_whole_training_step_has_the_reference_losses_gradients_and_adam_step() {
    let files = [("train_step_rgb_c0", 0), ("train_step_depth_c0", 0), ("train_step_all_c32", 32)];
    for (device_name, device) in devices() {
        for (file, code_dim) in files {
            for space in ["world", "cam"] {
                let Some(mut f) = Fixture::open(&format!("{file}_{space}")) else { return };
                let Some((_, decoder)) = fixture_decoder(code_dim, &device.clone().autodiff()) else { return };
                let context = format!("{device_name} {file}_{space}");
                let codes = (code_dim > 0).then(|| Tensor::from_inner(rows(&f.numbers("c"), code_dim, &device)));
                let field = BoundDecoder::new(&decoder, codes);
                let step = Step::rebuild(&mut f, &device);
                let mut loss = step_loss(&field, &field.valid(), &step.batch, &step.noise, &step.config, 0);

                // Theirs are sums over the rays divided by the images; ours are divided by the rays.
                let scale = step.batch.len() as f64 / step.images as f64;
                let (object, points): (Vec<i64>, Vec<[f64; 3]>) = step.outside.iter().copied().unzip();
                let object = Tensor::<1, Int>::from_data(TensorData::new(object, [points.len()]), &device);
                let query = Query { object: Some(object), ..Query::new(tensor3(&points, &device)) }.lifted();
                let outside = losses::free_space(field.occupancy_logit(&query)) / step.batch.len() as f64;
                loss.total = loss.total + outside.clone();
                loss.terms.push(("free_space", outside));
                let mut terms: HashMap<&str, f64> = HashMap::new();
                for (name, term) in &loss.terms {
                    *terms.entry(name).or_default() += term.clone().into_scalar::<f64>() * scale;
                }
                let ours = |names: &[&str]| names.iter().filter_map(|n| terms.get(n)).sum::<f64>();
                let check = |f: &mut Fixture, key: &str, value: f64, tolerance: f64| {
                    if f.contains(key) {
                        let truth = f.number(key);
                        assert!((value - truth).abs() <= tolerance * truth.abs(), "{context} {key}: {value} {truth}");
                    }
                };
                check(&mut f, "loss.loss_rgb", ours(&["color"]), 1e-4);
                check(&mut f, "loss.loss_image_gradient", ours(&["image_gradient"]), 1e-3);
                check(&mut f, "loss.loss_depth", ours(&["depth"]), 1e-4);
                check(
                    &mut f,
                    "loss.loss_freespace",
                    ours(&["free_space", "free_space_missed", "free_space_entry"]),
                    1e-4,
                );
                check(&mut f, "loss.loss_occupied", ours(&["occupancy"]), 1e-4);
                let total = loss.total.clone().into_scalar::<f64>() * scale;
                check(&mut f, "loss.loss", total, 1e-3);
                // Theirs is the mean over images; ours is that of all rays together, those that miss the cube left out.
                let hit = f.truths("mask_pred");
                let count = |both: bool| {
                    let rays = (0..hit.len()).filter(|&i| step.batch.in_cube[i]);
                    rays.filter(|&i| if both { hit[i] && step.batch.object[i] } else { hit[i] || step.batch.object[i] })
                        .count() as f64
                };
                assert!((loss.mask_iou - count(true) / count(false)).abs() < 1e-9, "{context}: the same rays hit");

                let gradients = GradientsParams::from_grads((loss.total * scale).backward(), &field);
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
        }
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
