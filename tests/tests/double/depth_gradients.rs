//! The depth gradient against differences of the whole march, and the slope rules near the silhouette.

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Device, Tensor};
use dvr_core::{Ray, UnitCube};
use dvr_model::Decoder;
use dvr_render::{
    Differentiable, Field, FieldValues, Hits, MarchSettings, Marcher, Query, Rays, SlopeRule, Surface, TensorMarcher,
};
use dvr_tests::*;
use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// No damping: what the implicit function theorem says.
const EXACT: SlopeRule = SlopeRule::ScaleFree { epsilon: 0.0 };

/// Finite differences divide by this step: small enough that no ReLU changes sides, for the network is only piecewise
/// smooth; the march finds depths to 1e-15.
const STEP: f64 = 2e-8;

/// The same for rays, whose directions move fewer ReLUs: a larger step leaves less rounding.
const RAY_STEP: f64 = 1e-6;

fn settings() -> MarchSettings {
    MarchSettings { steps: 256, root_steps: 60, ..MarchSettings::default() }
}

/// Adds `step` times fixed random numbers to every parameter.
struct Perturb {
    rng: ChaCha8Rng,
    step: f64,
}

impl ModuleMapper for Perturb {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let rng = &mut self.rng;
        param.map(|tensor| {
            let direction = random(rng, tensor.dims().iter().product());
            let direction = tensor1(&direction, &tensor.device()).reshape(tensor.dims());
            tensor.detach() + direction * self.step
        })
    }
}

fn random(rng: &mut ChaCha8Rng, n: usize) -> Vec<f64> {
    (0..n).map(|_| rng.random_range(-1.0..1.0)).collect()
}

fn perturbed(decoder: &Decoder, step: f64) -> Decoder {
    decoder.clone().map(&mut Perturb { rng: ChaCha8Rng::seed_from_u64(7), step })
}

/// A scene with codes, and camera-like rays that hit it well away from grazing.
struct Setup {
    decoder: Decoder,
    codes: Tensor<2>,
    rays: Vec<Ray>,
    weights: Vec<f64>,
    device: Device,
}

impl Setup {
    fn new(device: &Device) -> Self {
        let (_, decoder) = fixture_decoder(32, device);
        let codes = Fixture::open("codes_c32").numbers("codes")[..32].to_vec();
        let codes = tensor1(&codes, device).reshape([1, 32]);
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let candidates: Vec<Ray> = (0..300)
            .map(|_| {
                let mut point = || DVec3::from_array([(); 3].map(|()| rng.random_range(-1.0..1.0)));
                let (eye, target) = (1.5 * point().normalize(), 0.2 * point());
                Ray { origin: eye, direction: (target - eye) * 0.8 }
            })
            .collect();
        let mut setup = Self { decoder, codes, rays: candidates, weights: Vec::new(), device: device.clone() };
        let hits = setup.march(&setup.decoder, &setup.codes, &setup.rays);
        let field = setup.decoder.with_codes(setup.codes.clone());
        let gradient = field.occupancy_gradient(&hits.query());
        let direction = hits.rays.direction.clone();
        let length = |v: Tensor<2>| v.square().sum_dim(1).sqrt().squeeze_dim::<1>(1);
        let cosine = dvr_render::dot(gradient.clone(), direction.clone()) / (length(gradient) * length(direction));
        let index: Vec<i64> = hits.index.into_data().iter::<i64>().collect();
        let good = index.iter().zip(numbers(cosine)).filter(|(_, c)| *c > 0.3).map(|(i, _)| *i as usize);
        setup.rays = good.map(|i| setup.rays[i]).take(60).collect();
        assert!(setup.rays.len() > 30, "enough rays hit");
        setup.weights = random(&mut rng, setup.rays.len());
        setup
    }

    fn march(&self, decoder: &Decoder, codes: &Tensor<2>, rays: &[Ray]) -> Hits {
        let rays = Rays::new(rays, UnitCube::default(), &self.device);
        let march = TensorMarcher::new(decoder.with_codes(codes.clone()), settings()).march(&rays, None);
        march.hits.expect("rays hit")
    }

    /// `sum weight * depth` by marching alone.
    fn value(&self, decoder: &Decoder, codes: &Tensor<2>, rays: &[Ray]) -> f64 {
        let hits = self.march(decoder, codes, rays);
        assert_eq!(hits.len(), self.rays.len(), "every ray hits");
        numbers(hits.depth).iter().zip(&self.weights).map(|(d, w)| d * w).sum()
    }
}

fn assert_close(analytic: f64, numeric: f64, context: &str) {
    let error = (analytic - numeric).abs() / numeric.abs();
    assert!(error < 1e-6, "{context}: analytic {analytic}, differences {numeric}, relative error {error:e}");
}

#[test]
fn the_gradient_for_parameters_and_code_equals_differences_of_the_whole_march() {
    let device = double_precision_device();
    let setup = Setup::new(&device);
    let hits = setup.march(&setup.decoder, &setup.codes, &setup.rays);

    // The derivative along a random direction: d/dt at t = 0 of the loss at parameters + t * direction.
    let t = Tensor::<1>::from_inner(Tensor::zeros([1], &device)).require_grad();
    let decoder = setup.decoder.clone().to_device(&device.clone().autodiff());
    let moved = decoder.map(&mut Along { rng: ChaCha8Rng::seed_from_u64(7), t: t.clone() });
    let codes = Tensor::from_inner(setup.codes.clone()).require_grad();
    let field = moved.with_codes(codes.clone());
    let frozen = setup.decoder.with_codes(setup.codes.clone());
    let depth = Surface::on_graph(&field, &frozen, &hits, EXACT).depth;
    let weights = tensor1(&setup.weights, &device.clone().autodiff());
    let gradients = (depth * weights).sum().backward();
    let analytic = numbers(t.grad(&gradients).unwrap())[0];
    let at = |step: f64| setup.value(&perturbed(&setup.decoder, step), &setup.codes, &setup.rays);
    assert_close(analytic, (at(STEP) - at(-STEP)) / (2.0 * STEP), "parameters");

    let direction = random(&mut ChaCha8Rng::seed_from_u64(11), 32);
    let of_code = numbers(codes.grad(&gradients).unwrap());
    let analytic: f64 = of_code.iter().zip(&direction).map(|(g, d)| g * d).sum();
    let direction = tensor1(&direction, &device).reshape([1, 32]);
    let at = |step: f64| setup.value(&setup.decoder, &(setup.codes.clone() + direction.clone() * step), &setup.rays);
    assert_close(analytic, (at(STEP) - at(-STEP)) / (2.0 * STEP), "code");
}

/// Adds `t` times the random numbers of [`Perturb`] on the graph.
struct Along {
    rng: ChaCha8Rng,
    t: Tensor<1>,
}

impl ModuleMapper for Along {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let (id, tensor, mapper) = param.consume();
        let direction = random(&mut self.rng, tensor.dims().iter().product());
        let direction = tensor1(&direction, &tensor.device());
        let moved = tensor.clone().detach() + (direction * self.t.clone()).reshape(tensor.dims());
        Param::from_mapped_value(id, moved, mapper)
    }
}

#[test]
fn the_gradient_for_ray_origin_and_direction_equals_differences_of_the_whole_march() {
    let device = double_precision_device();
    let setup = Setup::new(&device);
    let hits = setup.march(&setup.decoder, &setup.codes, &setup.rays);
    let frozen = setup.decoder.with_codes(setup.codes.clone());
    let gradient = frozen.occupancy_gradient(&hits.query());
    let inverse_slope = EXACT.inverse_slope(gradient, hits.rays.direction.clone());

    // Origin and direction on the graph: f is evaluated at r0 + d_hat w, d_hat held still.
    let origin = Tensor::<2>::from_inner(hits.rays.origin.clone()).require_grad();
    let direction = Tensor::<2>::from_inner(hits.rays.direction.clone()).require_grad();
    let fixed = Tensor::<1>::from_inner(hits.depth.clone());
    let points = origin.clone() + direction.clone() * fixed.clone().unsqueeze_dim(1);
    let decoder = setup.decoder.clone().to_device(&device.clone().autodiff());
    let logit = decoder.with_codes(Tensor::from_inner(setup.codes.clone())).occupancy_logit(&Query::new(points));
    let depth = dvr_render::implicit_depth(logit, fixed, Tensor::from_inner(inverse_slope));
    let weights = tensor1(&setup.weights, &device.clone().autodiff());
    let gradients = (depth * weights).sum().backward();

    let mut rng = ChaCha8Rng::seed_from_u64(13);
    let shift: Vec<DVec3> =
        (0..setup.rays.len()).map(|_| DVec3::from_array([(); 3].map(|()| rng.random_range(-1.0..1.0)))).collect();
    let dotted = |gradient: Tensor<2>| -> f64 {
        let flat: Vec<f64> = shift.iter().flat_map(|s| s.to_array()).collect();
        numbers(gradient).iter().zip(&flat).map(|(g, s)| g * s).sum()
    };
    let moved = |of_origin: f64, of_direction: f64| -> f64 {
        let rays: Vec<Ray> = setup
            .rays
            .iter()
            .zip(&shift)
            .map(|(ray, s)| Ray { origin: ray.origin + of_origin * s, direction: ray.direction + of_direction * s })
            .collect();
        setup.value(&setup.decoder, &setup.codes, &rays)
    };
    let numeric = (moved(RAY_STEP, 0.0) - moved(-RAY_STEP, 0.0)) / (2.0 * RAY_STEP);
    assert_close(dotted(origin.grad(&gradients).unwrap()), numeric, "origin");
    let numeric = (moved(0.0, RAY_STEP) - moved(0.0, -RAY_STEP)) / (2.0 * RAY_STEP);
    assert_close(dotted(direction.grad(&gradients).unwrap()), numeric, "direction");
}

/// A ball of radius 0.4 whose logit is `scale` times the signed distance.
struct Ball {
    scale: f64,
    device: Device,
}

impl Field for Ball {
    fn evaluate(&self, query: &Query) -> FieldValues {
        let distance = query.points.clone().square().sum_dim(1).sqrt().squeeze_dim::<1>(1);
        FieldValues { occupancy_logit: (distance.neg() + 0.4) * self.scale, color: query.points.clone() }
    }

    fn device(&self) -> Device {
        self.device.clone()
    }
}

impl Differentiable for Ball {
    fn occupancy_gradient(&self, query: &Query) -> Tensor<2> {
        query.points.clone() / query.points.clone().square().sum_dim(1).sqrt() * -self.scale
    }
}

/// `1/s` of both rules for a ray along z that passes the ball's centre at distance `impact`, on the near side.
fn inverse_slopes(impact: f64, scale: f64, length: f64, near_side: bool) -> [f64; 2] {
    let device = double_precision_device();
    let ball = Ball { scale, device: device.clone() };
    let z = (0.16 - impact * impact).sqrt() * if near_side { -1.0 } else { 1.0 };
    let gradient = ball.occupancy_gradient(&Query::new(tensor3(&[[impact, 0.0, z]], &device)));
    let direction = tensor3(&[[0.0, 0.0, length]], &device);
    [SlopeRule::default(), SlopeRule::CLASSIC]
        .map(|rule| numbers(rule.inverse_slope(gradient.clone(), direction.clone()))[0])
}

#[test]
fn towards_the_silhouette_the_scale_free_rule_stays_bounded_and_the_classic_one_explodes() {
    // Distance to the silhouette in the image: 1e-2 .. 1e-12 of the radius.
    for exponent in 2..=12 {
        let impact = 0.4 * (1.0 - 10f64.powi(-exponent));
        let exact = 0.4 / (0.16 - impact * impact).sqrt();
        let [scale_free, classic] = inverse_slopes(impact, 1.0, 1.0, true);
        assert!(scale_free > 0.0 && scale_free <= 0.5 / 0.05 + 1e-9, "bounded by 1/(2 epsilon): {scale_free}");
        if exact < 900.0 {
            assert!((classic - exact).abs() < 1e-6 * exact, "the classic rule is exact up to its clamp");
        } else {
            assert!((classic - 1000.0).abs() < 1e-6, "and 1/epsilon from there");
        }
        if exponent == 2 {
            assert!(
                (scale_free - exact).abs() < 0.2 * exact,
                "away from the silhouette both agree: {scale_free} {exact}"
            );
        }
    }
}

#[test]
fn the_scale_free_rule_follows_the_scale_of_the_field_and_of_the_ray_and_keeps_the_sign() {
    for impact in [0.1, 0.39, 0.399_999] {
        let [unit, _] = inverse_slopes(impact, 1.0, 1.0, true);
        for (scale, length) in [(1e-5, 1.0), (1e5, 1.0), (1.0, 1e-2), (1.0, 1e2)] {
            let [scaled, _] = inverse_slopes(impact, scale, length, true);
            assert!((scaled * scale * length - unit).abs() < 1e-9 * unit, "dd = -df/s does not know units");
        }
        let [far_side, classic_far] = inverse_slopes(impact, 1e-4, 1.0, false);
        assert!(far_side < 0.0, "on the far side the ray leaves the ball: the slope is negative");
        // Fault 9: the reference flips the sign of small negative slopes.
        assert!(classic_far > 0.0);
    }
}
