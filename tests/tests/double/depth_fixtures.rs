//! Marching and the depth gradient against DVR's reference code in double precision.

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, FloatDType, Int, Tensor, TensorData};
use dvr_core::{Ray, UnitCube};
use dvr_model::Decoder;
use dvr_render::{
    Differentiable, Field, MarchSettings, Marcher, Query, RayStatus, Rays, RootMethod, SlopeRule, TensorMarcher,
    implicit_depth,
};
use dvr_tests::*;

/// Kinds of rays in the fixtures.
mod label {
    pub const CAMERA: i64 = 0;
    pub const AWAY: i64 = 1;
    pub const MISSES_CUBE: i64 = 2;
    pub const AXIS_ALIGNED: i64 = 3;
    pub const INSIDE: i64 = 4;
    pub const NEAR_CENTER: i64 = 5;
    pub const THROUGH_EDGE: i64 = 6;
    pub const DIRECTION_LENGTH: i64 = 7;
}

const FILES: [(&str, usize); 8] = [
    ("rays_c0_h64", 0),
    ("rays_c0_h64_n16", 0),
    ("rays_c0_h64_bisection", 0),
    ("rays_c0_h64_flat", 0),
    ("rays_c0_h64_big", 0),
    ("rays_c32_h64", 32),
    ("rays_c32_h64_n16", 32),
    ("rays_c32_h64_bisection", 32),
];

/// A ray file with the decoder it was made with.
struct Case {
    name: &'static str,
    fixture: Fixture,
    decoder: Decoder,
    codes: Option<Tensor<2>>,
    rays: Vec<Ray>,
    object: Vec<i64>,
    labels: Vec<i64>,
    device: Device,
}

/// The reference scaled its parameters in single precision, and rounded.
fn scaled<const D: usize>(tensor: Tensor<D>, scale: f64) -> Tensor<D> {
    (tensor.detach().cast(FloatDType::F32) * scale).cast(FloatDType::F64)
}

impl Case {
    fn open(name: &'static str, code_dim: usize, device: &Device) -> Self {
        let mut fixture = Fixture::open(name);
        let (_, mut decoder) = fixture_decoder(code_dim, device);
        let scale = fixture.number("fc_out_scale");
        decoder.fc_out.weight = decoder.fc_out.weight.map(|t| scaled(t, scale));
        decoder.fc_out.bias = decoder.fc_out.bias.map(|bias| bias.map(|t| scaled(t, scale)));
        let scale = fixture.number("fc_p_weight_scale");
        decoder.fc_p.weight = decoder.fc_p.weight.map(|t| scaled(t, scale));
        let origin = fixture.points("ray0");
        let direction = fixture.points("ray_direction");
        let rays: Vec<_> =
            origin.iter().zip(&direction).map(|(&o, &d)| Ray { origin: o.into(), direction: d.into() }).collect();
        let batch = if code_dim == 0 { 2 } else { 3 };
        let a_row = rays.len() / batch;
        let object = (0..rays.len()).map(|i| (i / a_row) as i64).collect();
        let codes = (code_dim > 0).then(|| {
            let codes = fixture.numbers("c");
            Tensor::from_data(TensorData::new(codes, [batch, code_dim]), device)
        });
        let labels = fixture.numbers("ray_label").iter().map(|&l| l as i64).collect();
        Self { name, fixture, decoder, codes, rays, object, labels, device: device.clone() }
    }

    fn object_tensor(&self, device: &Device) -> Option<Tensor<1, Int>> {
        self.codes.as_ref()?;
        Some(Tensor::from_data(TensorData::new(self.object.clone(), [self.object.len()]), device))
    }

    /// The field on a device: with or without gradient tracking as `decoder` has it.
    fn logit(&self, decoder: &Decoder, query: &Query, codes: Option<Tensor<2>>) -> Tensor<1> {
        match codes {
            Some(codes) => decoder.with_codes(codes).occupancy_logit(query),
            None => decoder.occupancy_logit(query),
        }
    }

    /// Depth of each ray's first crossing by our marcher (`None`: no hit), and which rays start inside.
    fn march(&mut self) -> (Vec<Option<f64>>, Vec<bool>) {
        let bisection = self.name.ends_with("bisection");
        let settings = MarchSettings {
            steps: self.fixture.number("n_steps") as usize,
            root: if bisection { RootMethod::Bisection } else { RootMethod::Secant },
            root_steps: self.fixture.number("n_secant_steps") as usize,
            max_points: 8192,
        };
        let mut rays = Rays::new(&self.rays, UnitCube::default(), &self.device);
        rays.object = self.object_tensor(&self.device);
        let march = match &self.codes {
            Some(codes) => TensorMarcher::new(self.decoder.with_codes(codes.clone()), settings).march(&rays, None),
            None => TensorMarcher::new(&self.decoder, settings).march(&rays, None),
        };
        let mut depth = vec![None; self.rays.len()];
        let hits = march.hits.expect("some rays hit");
        let index: Vec<i64> = hits.index.into_data().iter::<i64>().collect();
        for (ray, value) in index.into_iter().zip(numbers(hits.depth)) {
            depth[ray as usize] = Some(value);
        }
        (depth, march.status.iter().map(|&status| status == RayStatus::StartsInside).collect())
    }

    /// First crossing by brute force: 2000 samples, then bisection, one ray at a time.
    fn brute_force(&self, ray: usize) -> Option<f64> {
        let (entry, exit) = UnitCube::default().intersect(&self.rays[ray])?;
        let logits = |depths: &[f64]| {
            let points: Vec<_> = depths.iter().map(|&d| self.rays[ray].at(d).to_array()).collect();
            let object = vec![self.object[ray]; depths.len()];
            let object =
                self.codes.as_ref().map(|_| Tensor::from_data(TensorData::new(object, [depths.len()]), &self.device));
            let query = Query { object, ..Query::new(tensor3(&points, &self.device)) };
            numbers(self.logit(&self.decoder, &query, self.codes.clone()))
        };
        let depths: Vec<f64> = (0..2000).map(|i| entry + (exit - entry) * f64::from(i) / 1999.0).collect();
        let values = logits(&depths);
        let first = values.iter().position(|&f| f >= 0.0).filter(|&i| i > 0)?;
        let (mut low, mut high) = (depths[first - 1], depths[first]);
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            if logits(&[middle])[0] < 0.0 { low = middle } else { high = middle }
        }
        Some(0.5 * (low + high))
    }
}

#[test]
fn marching_agrees_with_the_reference_code_or_with_brute_force_where_that_is_wrong() {
    let device = double_precision_device();
    for (name, code_dim) in FILES {
        let mut case = Case::open(name, code_dim, &device);
        let (ours, starts_inside) = case.march();
        let reference_depth = case.fixture.numbers("f64.d_pred");
        let reference_hit = case.fixture.truths("f64.mask");
        let reference_free = case.fixture.truths("f64.mask_0_not_occupied");
        // 16 steps are too few to tell brute force and marching apart only where both samplings see the surface.
        let dense = case.fixture.number("n_steps") >= 128.0;
        for ray in 0..ours.len() {
            let context = format!("{name} ray {ray} label {}", case.labels[ray]);
            let reference = reference_hit[ray].then_some(reference_depth[ray]);
            match case.labels[ray] {
                // The same samples, the same root search: the same depth to rounding.
                label::CAMERA | label::AWAY | label::AXIS_ALIGNED | label::DIRECTION_LENGTH => {
                    let in_cube = UnitCube::default().intersect(&case.rays[ray]).is_some();
                    if in_cube {
                        assert_eq!(ours[ray].is_some(), reference.is_some(), "{context}");
                        assert_eq!(starts_inside[ray], !reference_free[ray], "{context}");
                        if let (Some(ours), Some(reference)) = (ours[ray], reference) {
                            let scale = case.rays[ray].direction.length().recip().max(1.0);
                            assert!((ours - reference).abs() < 1e-7 * scale, "{context}: {ours} {reference}");
                        }
                    } else {
                        // Faults 2 and 3: the reference code marches rays that miss the cube, or pass it behind them.
                        assert_eq!(ours[ray], None, "{context}");
                    }
                }
                label::MISSES_CUBE => assert_eq!(ours[ray], None, "{context}"),
                // Fault 1: from inside the cube the reference code starts behind or before the first surface. Fault 3:
                // rays through an edge or a corner fall back to coarse samples. Truth is the brute force.
                label::INSIDE | label::NEAR_CENTER | label::THROUGH_EDGE => {
                    if !dense {
                        continue;
                    }
                    let truth = case.brute_force(ray);
                    assert_eq!(ours[ray].is_some(), truth.is_some(), "{context}");
                    if let (Some(ours), Some(truth)) = (ours[ray], truth) {
                        let scale = case.rays[ray].direction.length().recip().max(1.0);
                        // False position may stall (fault 8): compare within what its 8 steps promise.
                        assert!((ours - truth).abs() < 5e-3 * scale, "{context}: {ours} {truth}");
                    }
                }
                other => panic!("{context}: unknown label {other}"),
            }
        }
    }
}

/// Gradients of all parameters by name, those of linear weights in PyTorch's layout.
struct Gradients<'a> {
    of: &'a burn::tensor::Gradients,
    path: Vec<String>,
    found: Vec<(String, Vec<f64>)>,
}

impl ModuleVisitor for Gradients<'_> {
    fn enter_module(&mut self, name: &str, _container: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _name: &str, _container: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let gradient = param.val().grad(self.of).expect("every parameter has a gradient");
        let name = self.path.join(".");
        let gradient = if D == 2 { gradient.transpose() } else { gradient };
        self.found.push((name, numbers(gradient)));
    }
}

#[test]
fn the_analytic_gradient_equals_the_reference_for_parameters_and_codes() {
    let device = double_precision_device();
    for (name, code_dim) in FILES.into_iter().filter(|(n, _)| !n.ends_with("n16") && !n.ends_with("bisection")) {
        let mut case = Case::open(name, code_dim, &device);
        let autodiff = device.clone().autodiff();
        let keep: Vec<usize> =
            case.fixture.truths("f64.mask").iter().enumerate().filter(|(_, hit)| **hit).map(|(i, _)| i).collect();
        let pick3 = |values: &[[f64; 3]]| keep.iter().map(|&i| values[i]).collect::<Vec<_>>();
        let pick1 = |values: &[f64]| keep.iter().map(|&i| values[i]).collect::<Vec<_>>();
        let points = pick3(&case.fixture.points("f64.p_pred"));
        let depth = pick1(&case.fixture.numbers("f64.d_pred"));
        let weight = pick1(&case.fixture.numbers("w"));
        let directions: Vec<_> = keep.iter().map(|&i| case.rays[i].direction.to_array()).collect();
        let object: Vec<i64> = keep.iter().map(|&i| case.object[i]).collect();
        let object_on = |device: &Device| {
            case.codes.as_ref().map(|_| Tensor::from_data(TensorData::new(object.clone(), [keep.len()]), device))
        };

        // The slope by our forward-mode pass, and the reference's clamp.
        let query = Query { object: object_on(&device), ..Query::new(tensor3(&points, &device)) };
        let gradient = match &case.codes {
            Some(codes) => case.decoder.with_codes(codes.clone()).occupancy_gradient(&query),
            None => case.decoder.occupancy_gradient(&query),
        };
        let reference: Vec<f64> = pick3(&case.fixture.points("f64.grad_p")).into_iter().flatten().collect();
        assert!(relative_difference(&numbers(gradient.clone()), &reference) < 1e-9, "{name}: grad_p");
        let slope = dvr_render::dot(gradient.clone(), tensor3(&directions, &device));
        let reference = pick1(&case.fixture.numbers("f64.grad_p_dot_v"));
        assert!(relative_difference(&numbers(slope), &reference) < 1e-9, "{name}: slope");
        let inverse_slope = SlopeRule::CLASSIC.inverse_slope(gradient, tensor3(&directions, &device));

        let decoder = case.decoder.clone().to_device(&autodiff).train();
        let codes = case.codes.clone().map(|codes| Tensor::from_inner(codes).require_grad());
        let query = Query { object: object_on(&autodiff), ..Query::new(tensor3(&points, &autodiff)) };
        let logit = case.logit(&decoder, &query, codes.clone());
        let depth = implicit_depth(logit, tensor1(&depth, &autodiff), Tensor::from_inner(inverse_slope));
        let loss = (depth * tensor1(&weight, &autodiff)).sum();
        let reference = case.fixture.number("f64.loss");
        assert!((loss.clone().into_scalar::<f64>() - reference).abs() < 1e-9 * reference.abs(), "{name}: loss");

        let gradients = loss.backward();
        compare_parameters(&mut case, &decoder, &gradients, name);
        if let Some(codes) = codes {
            let ours = numbers(codes.grad(&gradients).expect("codes have a gradient"));
            let reference = case.fixture.numbers("f64.grad_c");
            assert!(relative_difference(&ours, &reference) < 1e-9, "{name}: code");
        }
    }
}

/// Compares the gradients of all parameters.
fn compare_parameters(case: &mut Case, decoder: &Decoder, gradients: &burn::tensor::Gradients, context: &str) {
    let mut visitor = Gradients { of: gradients, path: Vec::new(), found: Vec::new() };
    decoder.visit(&mut visitor);
    assert!(visitor.found.len() > 20);
    for (parameter, ours) in visitor.found {
        // The colour channels of the last layer have no part in depth; the files hold their zeros too.
        let reference = case.fixture.numbers(&format!("f64.grad.{parameter}"));
        let difference = max_difference(&ours, &reference);
        let size = largest(reference.iter().map(|value| value.abs()));
        assert!(difference <= 1e-9 * size.max(1e-12), "{context} {parameter}: {difference} of {size}");
    }
}
