//! What every field promises, whatever it is made of: one suite for networks, grids and closed forms.

use burn::tensor::{Device, Tensor, TensorData};
use dvr_core::{Camera, Ray, UnitCube};
use dvr_render::extract::{FieldSurface, ScalarField};
use dvr_render::{
    Crossing, Differentiable, Field, FieldJet, FieldShader, FieldValues, March, MarchSettings, Marcher, Query,
    RayStatus, Rays, RenderSettings, Shader, TensorMarcher, axis_direction,
};
use glam::{DVec3, Vec3};

/// Share of points, or of rays, that must agree. The others lie where a field has a kink, or rays graze it.
const MOST: f64 = 0.95;

/// Runs the whole suite on a field of one object, of which a camera at `(0.3, 0.4, -1.6)` sees the outside.
///
/// # Panics
/// At the first promise that is broken.
pub fn check_field(name: &str, field: &impl Crossing) {
    let suite = Suite { name, field, points: points(600), directions: directions(600) };
    suite.samples_are_finite_and_do_not_depend_on_how_they_are_asked();
    suite.derivatives_are_those_of_the_values();
    suite.numbers_on_the_cpu_are_those_of_the_tensors();
    suite.crossings_are_those_of_dense_marching();
    suite.a_ray_that_starts_inside_hits_nothing();
    suite.rays_see_what_marching_tensors_shows();
}

struct Suite<'a, F> {
    name: &'a str,
    field: &'a F,
    points: Vec<Vec3>,
    directions: Vec<Vec3>,
}

/// A field without its own ways to cross it.
struct Plain<'a, F>(&'a F);

impl<F: Field> Field for Plain<'_, F> {
    fn evaluate(&self, query: &Query) -> FieldValues {
        self.0.evaluate(query)
    }

    fn device(&self) -> Device {
        self.0.device()
    }
}

impl<F: Differentiable> Differentiable for Plain<'_, F> {
    fn jet(&self, query: &Query, direction: Tensor<2>) -> FieldJet {
        self.0.jet(query, direction)
    }

    fn occupancy_gradient(&self, query: &Query) -> Tensor<2> {
        self.0.occupancy_gradient(query)
    }
}

impl<F: Differentiable> Crossing for Plain<'_, F> {}

impl<F: Crossing> Suite<'_, F> {
    fn tensor(&self, vectors: &[Vec3]) -> Tensor<2> {
        let flat: Vec<f32> = vectors.iter().flat_map(Vec3::to_array).collect();
        Tensor::from_data(TensorData::new(flat, [vectors.len(), 3]), &self.field.device())
    }

    fn query(&self) -> Query {
        Query::new(self.tensor(&self.points))
    }

    fn seen(&self) -> Query {
        Query { directions: Some(self.tensor(&self.directions)), ..self.query() }
    }

    fn samples_are_finite_and_do_not_depend_on_how_they_are_asked(&self) {
        let name = self.name;
        let without = self.field.evaluate(&self.query());
        let seen = self.field.evaluate(&self.seen());
        let logits = numbers(without.occupancy_logit);
        assert!(logits.iter().any(|&l| l > 0.0) && logits.iter().any(|&l| l < 0.0), "{name}: a surface in the cube");
        assert_close(name, "logits with a view", &numbers(seen.occupancy_logit), &logits, 0.0);
        let alone = numbers(self.field.occupancy_logit(&self.query()));
        assert_close(name, "logits alone", &alone, &logits, 1e-5);
        for colors in [&without.color, &seen.color] {
            let colors = numbers(colors.clone());
            assert!(colors.iter().all(|c| (0.0..=1.0).contains(c)), "{name}: colours in [0, 1]");
        }
        let part = self.field.evaluate(&self.seen().narrow(100, 50));
        assert_close(name, "some of the logits", &numbers(part.occupancy_logit), &logits[100..150], 1e-5);
        assert_close(name, "some of the colours", &numbers(part.color), &numbers(seen.color)[300..450], 1e-5);
    }

    fn derivatives_are_those_of_the_values(&self) {
        let name = self.name;
        let query = self.seen();
        let along: Vec<Vec3> = directions(self.points.len() + 7).split_off(7).iter().map(|d| *d * 1.3).collect();
        let along = self.tensor(&along);
        let jet = self.field.jet(&query, along.clone());
        let value = self.field.evaluate(&query);
        assert_close(
            name,
            "logits of jets",
            &numbers(jet.value.occupancy_logit),
            &numbers(value.occupancy_logit),
            1e-5,
        );
        assert_close(name, "colours of jets", &numbers(jet.value.color), &numbers(value.color), 1e-5);

        let step = 1e-3;
        let at = |t: f32| self.field.evaluate(&query.moved_to(query.points.clone() + along.clone() * t));
        let (above, below) = (at(step), at(-step));
        let slope = (above.occupancy_logit - below.occupancy_logit) / (2.0 * step);
        assert_mostly(name, "slopes", &numbers(jet.derivative.occupancy_logit), &numbers(slope), 0.03);
        let slope = (above.color - below.color) / (2.0 * step);
        assert_mostly(name, "slopes of colours", &numbers(jet.derivative.color), &numbers(slope), 0.03);

        let gradient = numbers(self.field.occupancy_gradient(&query));
        for axis in 0..3 {
            let jet = self.field.jet(&query, axis_direction(&query, axis));
            let part: Vec<f32> = gradient.iter().skip(axis).step_by(3).copied().collect();
            assert_mostly(name, "gradients", &part, &numbers(jet.derivative.occupancy_logit), 1e-3);
        }
    }

    fn numbers_on_the_cpu_are_those_of_the_tensors(&self) {
        let name = self.name;
        let surface = FieldSurface::new(self.field);
        let (without, seen) = (self.field.evaluate(&self.query()), self.field.evaluate(&self.seen()));
        assert_close(name, "logits", &surface.logits(&self.points), &numbers(without.occupancy_logit), 1e-4);
        let gradients = surface.gradients(&self.points).expect("a field has gradients");
        let gradients: Vec<f32> = gradients.iter().flat_map(Vec3::to_array).collect();
        let expected = numbers(self.field.occupancy_gradient(&self.query()));
        assert_mostly(name, "gradients", &gradients, &expected, 1e-3);
        let normals = vec![Vec3::Z; self.points.len()];
        for (directions, expected) in [(None, without.color), (Some(self.directions.as_slice()), seen.color)] {
            let colors = surface.colors(&self.points, &normals, directions).expect("a field has colours");
            assert_close(name, "colours", colors.as_flattened(), &numbers(expected), 1e-4);
        }
    }

    fn crossings_are_those_of_dense_marching(&self) {
        let name = self.name;
        let rays = Rays::new(&camera_rays(), UnitCube::default(), &self.field.device());
        let truth = TensorMarcher::new(self.field, MarchSettings { steps: 512, ..MarchSettings::default() });
        let truth = Found::new(&truth.march(&rays, None));
        let settings = MarchSettings { steps: 256, ..MarchSettings::default() };
        let surface = FieldSurface::new(self.field);
        let half = Tensor::full([rays.len()], 0.5, &self.field.device());
        for jitter in [None, Some(half)] {
            let march = surface.marcher(settings).march(&rays, jitter);
            let found = Found::new(&march);
            let hits = found.depth.iter().filter(|depth| depth.is_some()).count();
            assert!(hits > 40, "{name}: {hits} rays hit");
            assert_share(name, "statuses", found.status.iter().zip(&truth.status).map(|(a, b)| a == b));
            let both = found.depth.iter().zip(&truth.depth).filter_map(|(a, b)| Some((*a)?.to_bits()).zip(*b));
            let both = both.map(|(a, b)| (f32::from_bits(a), b));
            assert_share(name, "depths", both.map(|(a, b)| (a - b).abs() < 1e-3));

            let missing = found.status.iter().map(|&status| status == RayStatus::Misses);
            let pairs = found.max_logit_depth.iter().zip(&truth.max_logit_depth).zip(missing);
            let far = pairs.filter(|(_, misses)| *misses).map(|((a, b), _)| (a - b).abs() < 0.05);
            assert_share(name, "depths of the largest logit", far);

            let at = march.hits.expect("rays hit").query();
            let gradient = rows(self.field.occupancy_gradient(&at));
            let directions = rows(at.directions.clone().expect("hits are seen from somewhere"));
            assert!(directions.iter().all(|d| (d.length() - 1.0).abs() < 1e-5), "{name}: unit directions");
            let facing = gradient.iter().zip(&directions).map(|(g, d)| g.dot(*d) >= 0.0);
            assert_share(name, "normals face the camera", facing);
            let logits = numbers(self.field.occupancy_logit(&at));
            let on_surface = logits.iter().zip(&gradient).map(|(logit, g)| logit.abs() <= 1e-3 * g.length() + 1e-6);
            assert_share(name, "logits at hits", on_surface);
        }
    }

    fn a_ray_that_starts_inside_hits_nothing(&self) {
        let logits = numbers(self.field.occupancy_logit(&self.query()));
        let inside = self.points.iter().zip(&logits).filter(|(_, logit)| **logit > 0.0);
        let deepest = inside.max_by(|a, b| a.1.total_cmp(b.1)).expect("a point inside").0;
        let rays: Vec<Ray> = self.directions[..20]
            .iter()
            .map(|direction| Ray { origin: deepest.as_dvec3(), direction: direction.as_dvec3() })
            .collect();
        let batch = Rays::new(&rays, UnitCube::default(), &self.field.device());
        let march = FieldSurface::new(self.field).marcher(MarchSettings::default()).march(&batch, None);
        assert!(march.hits.is_none() && march.status.iter().all(|&s| s == RayStatus::StartsInside), "{}", self.name);
        let shaded = FieldShader::new(self.field, RenderSettings::default(), None).shade(&rays);
        assert!(shaded.iter().all(Option::is_none), "{}: seen from inside", self.name);
    }

    fn rays_see_what_marching_tensors_shows(&self) {
        let name = self.name;
        let march = MarchSettings { steps: 256, ..MarchSettings::default() };
        let settings = RenderSettings { march, ..RenderSettings::default() };
        let rays = camera_rays();
        let ours = FieldShader::new(self.field, settings, None).shade(&rays);
        let truth = FieldShader::new(&Plain(self.field), settings, None).shade(&rays);
        assert_share(name, "seen", ours.iter().zip(&truth).map(|(a, b)| a.is_some() == b.is_some()));
        let both: Vec<_> = ours.iter().zip(&truth).filter_map(|(a, b)| (*a).zip(*b)).collect();
        let near = |a: [f32; 3], b: [f32; 3], by: f32| Vec3::from(a).distance(Vec3::from(b)) < by;
        assert_share(name, "depths seen", both.iter().map(|(a, b)| (a.depth - b.depth).abs() < 1e-3));
        assert_share(name, "colours seen", both.iter().map(|(a, b)| near(a.color, b.color, 1e-2)));
        assert_share(name, "normals seen", both.iter().map(|(a, b)| near(a.normal, b.normal, 2e-2)));
    }
}

/// A march as numbers, one per ray.
struct Found {
    status: Vec<RayStatus>,
    depth: Vec<Option<f32>>,
    max_logit_depth: Vec<f32>,
}

impl Found {
    fn new(march: &March) -> Self {
        let mut depth = vec![None; march.status.len()];
        if let Some(hits) = &march.hits {
            let index = hits.index.clone().into_data();
            let depths = hits.depth.clone().into_data();
            index.iter::<i64>().zip(depths.iter::<f32>()).for_each(|(ray, d)| depth[ray as usize] = Some(d));
        }
        Self { status: march.status.clone(), depth, max_logit_depth: numbers(march.max_logit_depth.clone()) }
    }
}

/// What the suite's camera sends out.
fn camera_rays() -> Vec<Ray> {
    let camera = Camera::look_at(24, 24, 40.0, DVec3::new(0.3, 0.4, -1.6), DVec3::ZERO, DVec3::Y);
    (0..24 * 24).map(|i| camera.pixel_ray(i % 24, i / 24)).collect()
}

/// Points spread over the cube `[-0.5, 0.5]^3` (a Kronecker sequence).
fn points(count: usize) -> Vec<Vec3> {
    let spread = |i: usize, by: f64| (0.5 + i as f64 * by).fract() - 0.5;
    let point = |i| DVec3::new(spread(i, 0.819_173), spread(i, 0.671_044), spread(i, 0.549_700)).as_vec3();
    (0..count).map(point).collect()
}

/// Unit vectors spread over the sphere.
fn directions(count: usize) -> Vec<Vec3> {
    let direction = |i: usize| {
        let (height, turn) = (2.0 * (i as f64 * 0.618_034).fract() - 1.0, i as f64 * 0.754_878 * std::f64::consts::TAU);
        let around = (1.0 - height * height).sqrt();
        DVec3::new(around * turn.cos(), around * turn.sin(), height).as_vec3()
    };
    (0..count).map(direction).collect()
}

fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    let numbers: Vec<f32> = tensor.into_data().iter::<f32>().collect();
    assert!(numbers.iter().all(|x| x.is_finite()), "numbers of a field are finite");
    numbers
}

fn rows(tensor: Tensor<2>) -> Vec<Vec3> {
    numbers(tensor).as_chunks().0.iter().map(|&row| Vec3::from_array(row)).collect()
}

/// The largest number, at least 1e-3: what tolerances are relative to.
fn scale(values: &[f32]) -> f32 {
    values.iter().fold(1e-3, |largest: f32, x| largest.max(x.abs()))
}

fn assert_close(name: &str, what: &str, found: &[f32], expected: &[f32], tolerance: f32) {
    assert_eq!(found.len(), expected.len(), "{name}: {what}");
    let allowed = tolerance * scale(expected);
    let close = |(a, b): (&f32, &f32)| (a - b).abs() <= allowed;
    assert!(found.iter().zip(expected).all(close), "{name}: {what} agree to {tolerance}");
}

fn assert_mostly(name: &str, what: &str, found: &[f32], expected: &[f32], tolerance: f32) {
    assert_eq!(found.len(), expected.len(), "{name}: {what}");
    let allowed = tolerance * scale(expected);
    assert_share(name, what, found.iter().zip(expected).map(|(a, b)| (a - b).abs() <= allowed));
}

fn assert_share(name: &str, what: &str, agree: impl Iterator<Item = bool>) {
    let agree: Vec<bool> = agree.collect();
    let share = agree.iter().filter(|&&agrees| agrees).count() as f64 / agree.len().max(1) as f64;
    assert!(agree.is_empty() || share >= MOST, "{name}: {what}: {share:.3} of {} agree", agree.len());
}
