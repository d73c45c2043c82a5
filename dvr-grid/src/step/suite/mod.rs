//! What every step backend must pass: a new one adds its constructor to the tests at the end.
//!
//! Gradients are compared with differences of the losses, term by term, as the list of terms names them; whole steps with
//! those of the CPU. Tests on a GPU are ignored where no driver is installed; a software adapter
//! will do.

mod fixture;
#[cfg(feature = "gpu")]
mod gpu;

use dvr_render::SlopeRule;
use dvr_test_support::relative_difference;
use glam::Vec3;

use crate::clock::PartTimes;
use crate::color::CHANNELS;
use crate::losses::{GridLosses, LossSums};
use crate::multires::{Grids, MultiResGrid};
use crate::step::backend::StepBackend;
use crate::step::cpu::CpuBackend;
use crate::step::draw::draw;
use crate::step::record::RayRecord;
use fixture::SIZE;
pub(crate) use fixture::{Fixture, speckled_arc};

/// A backend that tests look into.
trait Inspected: StepBackend {
    /// What the rays of the next step say of the field. May carry out the step.
    fn records(&mut self, fixture: &Fixture) -> Vec<RayRecord>;

    /// The gradients that the last step left at the active nodes of shape and colour.
    fn gradients(&self) -> [Vec<f32>; 2];
}

/// Makes a backend that holds these grids.
type Make<'a> = &'a dyn Fn(&Fixture, Grids) -> Box<dyn Inspected>;

impl Inspected for CpuBackend {
    fn records(&mut self, fixture: &Fixture) -> Vec<RayRecord> {
        let mut times = PartTimes::default();
        let input = fixture.input(&mut times);
        let grid = *fixture.grids.shape.grid();
        let record = |ray: usize| {
            let drawn = draw(&fixture.order, fixture.config.seed, fixture.rays_drawn + ray as u64);
            let pixel = fixture.views[drawn.view as usize].pixel_ray(drawn.view, drawn.pixel);
            let mut sums = LossSums::default();
            let found = self.context(&input).ray_gradient(&pixel, drawn.seed, &mut sums);
            let at = |cell: dvr_core::voxel::Cell| grid.position(cell.node) + cell.at * grid.spacing();
            RayRecord {
                point: found.map_or(Vec3::ZERO, |found| at(found.shape_cell)).to_array(),
                grad_value: found.map_or(0.0, |found| found.grad_value),
                grad_color: found.map_or([0.0; CHANNELS], |found| found.grad_color),
                losses: sums.of_ray(),
                intersection: sums.intersection as f32,
                union: sums.union as f32,
            }
        };
        (0..fixture.config.rays).map(record).collect()
    }

    fn gradients(&self) -> [Vec<f32>; 2] {
        let mut grids = self.grids().unwrap().into_owned();
        fn taken<const C: usize>(grid: &mut MultiResGrid<C>) -> Vec<f32> {
            let active = grid.active().clone();
            let (values, gradient) = grid.values_and_gradient_mut();
            values.layout().of_rows(&active, gradient)
        }
        let (shape, color) = (taken(&mut grids.shape), taken(&mut grids.color));
        [shape, color]
    }
}

/// Carries out steps.
fn steps(backend: &mut dyn Inspected, fixture: &mut Fixture, steps: usize) -> Option<LossSums> {
    let mut sums = None;
    for _ in 0..steps {
        sums = backend.step(fixture.input(&mut PartTimes::default())).unwrap();
        fixture.rays_drawn += fixture.config.rays as u64;
    }
    sums
}

/// The loss of each ray, at weight one, for one term alone.
fn losses(fixture: &Fixture, grids: Grids, make: Make) -> Vec<f64> {
    let records = make(fixture, grids).records(fixture);
    let cross_view = |name: &str| GridLosses::CROSS_VIEW.contains(&name);
    let compared = |name: &str| if cross_view(name) { fixture.config.compared_views as f64 } else { 1.0 };
    let loss = |record: &RayRecord| -> f64 {
        record.losses.named().into_iter().map(|(name, value)| f64::from(value) / compared(name)).sum()
    };
    records.iter().map(loss).collect()
}

/// Whether a ray is far enough from grazing, where its gradient is damped on purpose.
fn is_in_the_middle(fixture: &Fixture, ray: usize) -> bool {
    let drawn = draw(&fixture.order, fixture.config.seed, ray as u64);
    let (u, v) = (drawn.pixel % SIZE, drawn.pixel / SIZE);
    u.abs_diff(SIZE / 2) < 12 && v.abs_diff(SIZE / 2) < 12
}

/// Each term's gradient is that of its differences.
fn gradients_are_those_of_differences(make: Make) {
    for (name, only, slack, is_detached) in GridLosses::each_ray_term() {
        let (mut compared, mut close, mut largest) = (0, 0, 0.0f64);
        // A ball that is too large hits where it should not, one that is too small misses.
        for radius in [0.31, 0.285] {
            let fixture = Fixture::ball(radius, only.clone());
            let records = make(&fixture, fixture.grids.clone()).records(&fixture);
            let step = 2e-4;
            let above = losses(&fixture, fixture.raised(step), make);
            let below = losses(&fixture, fixture.raised(-step), make);
            let mut pairs = Vec::new();
            for (ray, record) in records.iter().enumerate() {
                let is_compared = match name {
                    "mask" => record.losses.mask > 0.1,
                    _ => radius > 0.3 && is_in_the_middle(&fixture, ray),
                };
                if is_compared {
                    let difference = (above[ray] - below[ray]) / (2.0 * f64::from(step));
                    pairs.push((f64::from(record.grad_value), if is_detached { 0.0 } else { difference }));
                }
            }
            let scale = pairs.iter().fold(0.1, |most: f64, (gradient, _)| most.max(gradient.abs()));
            for (gradient, difference) in pairs {
                // Piecewise linear losses have kinks (a channel's sign, a pixel's border) that differences step over.
                let tolerance = 0.05 * (gradient.abs() + difference.abs()) + slack * scale;
                compared += 1;
                close += usize::from((gradient - difference).abs() < tolerance);
                largest = largest.max(difference.abs());
            }
        }
        println!("{name}: {close} of {compared} gradients are those of differences, the largest {largest:.3}");
        assert!(compared > 100 && 100 * close >= 85 * compared, "{name}: {close} of {compared}");
        assert!(is_detached || largest > 0.05, "{name} depends on the shape");
    }
}

/// The same for the gradient by the colour.
fn color_gradients_are_those_of_differences(make: Make) {
    for (name, only, ..) in GridLosses::each_ray_term() {
        let fixture = Fixture::ball(0.31, only);
        let records = make(&fixture, fixture.grids.clone()).records(&fixture);
        for channel in 0..CHANNELS {
            let step = 1e-3;
            let above = losses(&fixture, fixture.tinted(channel, step), make);
            let below = losses(&fixture, fixture.tinted(channel, -step), make);
            let differs = |ray: usize| {
                let difference = (above[ray] - below[ray]) / (2.0 * f64::from(step));
                (f64::from(records[ray].grad_color[channel]) - difference).abs() > 0.02
            };
            let apart = (0..records.len()).filter(|&ray| differs(ray)).count();
            assert!(100 * apart < 3 * records.len(), "{name}: {apart} of {}", records.len());
        }
    }
}

/// A record's numbers, by name.
fn numbers(record: &RayRecord) -> Vec<(String, f32)> {
    let mut numbers = vec![("grad_value".to_owned(), record.grad_value)];
    numbers.extend(record.point.iter().zip(["x", "y", "z"]).map(|(&number, axis)| (axis.to_owned(), number)));
    numbers.extend(record.grad_color.iter().enumerate().map(|(c, &number)| (format!("grad_color {c}"), number)));
    numbers.extend(record.losses.named().into_iter().map(|(name, number)| (name.to_owned(), number)));
    numbers.extend([("intersection".to_owned(), record.intersection), ("union".to_owned(), record.union)]);
    numbers
}

/// Rays of both say the same, up to rounding; returns how many lie on a border and do not.
fn compare_records(ours: &[RayRecord], truth: &[RayRecord]) -> usize {
    let truth: Vec<_> = truth.iter().map(numbers).collect();
    let mut largest = vec![0.0f32; truth[0].len()];
    for record in &truth {
        largest.iter_mut().zip(record).for_each(|(most, (_, number))| *most = most.max(number.abs()));
    }
    for ((name, _), most) in truth[0].iter().zip(&largest) {
        assert!(*most > 0.0, "{name} occurs");
    }
    let mut unlike = 0;
    for (ours, truth) in ours.iter().zip(&truth) {
        let ours = numbers(ours);
        let apart = |i: usize| (ours[i].1 - truth[i].1).abs() / largest[i];
        // Where something lies on a border to rounding, either side is right.
        let is_like = |i: usize| apart(i) <= 2e-4;
        if !(0..ours.len()).all(is_like) {
            println!("{ours:?}\n{truth:?}\n");
            unlike += 1;
        }
    }
    unlike
}

/// A step says and moves the same as on the CPU: on a smooth surface and a noisy one, by both slope rules, and where
/// light changes and patches that are brighter than others lose their pull.
fn a_step_is_that_of_the_cpu(make: Make) {
    let cases = [
        (0.0, SlopeRule::default(), false),
        (3.0, SlopeRule::default(), false),
        (0.0, SlopeRule::CLASSIC, false),
        (0.0, SlopeRule::default(), true),
    ];
    for (noise, slope_rule, is_exposed) in cases {
        let mut fixture = Fixture { slope_rule, ..Fixture::hull(noise, 600) };
        let as_given = fixture.views.clone();
        if is_exposed {
            fixture.expose();
            fixture.config.losses.patch_ncc.highlights = 1.0;
        }
        // Away from the start, where much is zero.
        let mut reference = CpuBackend::new(fixture.grids.clone());
        steps(&mut reference, &mut fixture, 3);
        fixture.grids = reference.grids().unwrap().into_owned();
        let state = |grids: &Grids| (grids.shape.state(), grids.color.state());
        // Made with the views as they are given, and told of their exposures afterwards.
        let exposed = std::mem::replace(&mut fixture.views, as_given);
        let mut backend = make(&fixture, fixture.grids.clone());
        backend.expose(&exposed).unwrap();
        fixture.views = exposed;
        assert!(state(&backend.grids().unwrap()) == state(&fixture.grids), "what is uploaded is there");

        if is_exposed {
            let pulls = |records: Vec<RayRecord>| records.iter().map(|record| record.grad_value).collect::<Vec<_>>();
            let without_highlights = pulls(reference.records(&fixture));
            fixture.config.losses.patch_ncc.highlights = 0.0;
            assert!(pulls(reference.records(&fixture)) != without_highlights, "there are highlights");
            fixture.config.losses.patch_ncc.highlights = 1.0;
        }
        let unlike =
            compare_records(&make(&fixture, fixture.grids.clone()).records(&fixture), &reference.records(&fixture));
        assert!(unlike <= fixture.config.rays / 100, "{unlike} rays");
        let ours = steps(&mut *backend, &mut fixture, 1).unwrap();
        fixture.rays_drawn -= fixture.config.rays as u64;
        let truth = steps(&mut reference, &mut fixture, 1).unwrap();
        println!("noise {noise}: {unlike} rays are unlike\n{ours:?}\n{truth:?}");
        let terms = |sums: &LossSums| fixture.config.losses.weighted(sums, fixture.config.rays, 3);
        for ((name, ours), (_, truth)) in terms(&ours).into_iter().zip(terms(&truth)) {
            assert!((ours - truth).abs() < 1e-2 * truth.abs(), "{name}: {ours} {truth}");
        }
        // A ray that lies on a border moves the sums by its own share, and nothing else does.
        let tolerance = 1e-3 + 0.1f64.min((2.0 * unlike as f64 / fixture.config.rays as f64).sqrt());
        let (gradients, expected) = (backend.gradients(), reference.gradients());
        let (moved, expected_state) = (state(&backend.grids().unwrap()), state(&reference.grids().unwrap()));
        let apart = [
            relative_difference(&gradients[0], &expected[0]),
            relative_difference(&gradients[1], &expected[1]),
            relative_difference(&moved.0, &expected_state.0),
            relative_difference(&moved.1, &expected_state.1),
        ];
        println!("gradients of shape and colour, their levels: {apart:?} apart");
        assert!(apart.iter().all(|&apart| apart < tolerance), "{apart:?}");
    }
}

/// What steps leave, to the bit.
fn bits_after_steps(backend: &mut dyn Inspected, fixture: &mut Fixture, count: usize) -> Vec<u32> {
    steps(backend, fixture, count);
    let grids = backend.grids().unwrap();
    [grids.shape.state(), grids.color.state()].concat().into_iter().map(f32::to_bits).collect()
}

/// Steps give the same bits twice, and after their grids were fetched and brought back.
fn steps_give_the_same_bits_twice_and_after_a_break(make: Make) {
    let after = |has_break: bool| {
        let mut fixture = Fixture::hull(0.0, 600);
        let mut backend = make(&fixture, fixture.grids.clone());
        steps(&mut *backend, &mut fixture, 3);
        if has_break {
            let grids = backend.grids().unwrap().into_owned();
            backend = make(&fixture, fixture.grids.clone());
            backend.upload(grids).unwrap();
        }
        bits_after_steps(&mut *backend, &mut fixture, 3)
    };
    let unbroken = after(false);
    assert!(unbroken == after(false), "twice");
    assert!(unbroken == after(true), "after a break");
}

/// Steps on grids of which only a band around the surface learns, on top of two such stages, are those of the CPU; and
/// what is asked for between steps is what the grids hold.
fn steps_in_a_band_are_those_of_the_cpu(make: Make) {
    let mut fixture = Fixture::hull(0.0, 600);
    fixture.refine(2);
    let mut reference = CpuBackend::new(fixture.grids.clone());
    let mut backend = make(&fixture, fixture.grids.clone());
    let at_first = backend.shape_values().unwrap().to_dense();
    assert!(at_first == fixture.grids.shape.values().to_dense(), "nothing has moved yet");
    let unlike =
        compare_records(&make(&fixture, fixture.grids.clone()).records(&fixture), &reference.records(&fixture));
    assert!(unlike <= fixture.config.rays / 100, "{unlike} rays");
    steps(&mut *backend, &mut fixture, 3);
    fixture.rays_drawn -= 3 * fixture.config.rays as u64;
    steps(&mut reference, &mut fixture, 3);
    let (asked, held) = (backend.shape_values().unwrap().to_dense(), backend.grids().unwrap());
    let largest = |a: &[f32], b: &[f32]| a.iter().zip(b).fold(0.0f32, |most, (a, b)| most.max((a - b).abs()));
    assert!(largest(&asked, &at_first) > 1e-4, "it moves");
    assert!(largest(&asked, &held.shape.values().to_dense()) < 1e-6);
    let apart = relative_difference(&asked, &reference.grids().unwrap().shape.values().to_dense());
    assert!(apart < 1e-3, "{apart}");
}

/// Steps on photographs that are shown later are those of a backend that is made with them.
fn photographs_of_another_size_are_taken_up(make: Make) {
    let mut fixture = Fixture::hull(0.0, 600);
    let mut backend = make(&fixture, fixture.grids.clone());
    steps(&mut *backend, &mut fixture, 2);
    fixture.grids = backend.grids().unwrap().into_owned();
    fixture.shrink();
    backend.show(&fixture.views).unwrap();
    let rays_drawn = fixture.rays_drawn;
    let shown = bits_after_steps(&mut *backend, &mut fixture, 2);
    fixture.rays_drawn = rays_drawn;
    let mut made = make(&fixture, fixture.grids.clone());
    assert!(shown == bits_after_steps(&mut *made, &mut fixture, 2));
}

/// The suite for one backend.
macro_rules! suite {
    ($test:meta, $name:ident, $make:expr) => {
        mod $name {
            use super::*;

            #[$test]
            fn gradients_are_those_of_differences() {
                $make(&super::gradients_are_those_of_differences);
            }

            #[$test]
            fn color_gradients_are_those_of_differences() {
                $make(&super::color_gradients_are_those_of_differences);
            }

            #[$test]
            fn a_step_is_that_of_the_cpu() {
                $make(&super::a_step_is_that_of_the_cpu);
            }

            #[$test]
            fn steps_give_the_same_bits_twice_and_after_a_break() {
                $make(&super::steps_give_the_same_bits_twice_and_after_a_break);
            }

            #[$test]
            fn steps_in_a_band_are_those_of_the_cpu() {
                $make(&super::steps_in_a_band_are_those_of_the_cpu);
            }

            #[$test]
            fn photographs_of_another_size_are_taken_up() {
                $make(&super::photographs_of_another_size_are_taken_up);
            }
        }
    };
}

suite!(test, cpu_backend, |check: &dyn Fn(Make)| check(&|_, grids| Box::new(CpuBackend::new(grids))));
#[cfg(feature = "gpu")]
suite!(dvr_test_support::test_with(gpu), gpu_backend, gpu::on_a_gpu);
