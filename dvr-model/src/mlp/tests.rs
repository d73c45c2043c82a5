use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

/// A network as numbers, evaluated one point at a time in double precision: the reference implementation.
struct Plain {
    layers: Vec<(Vec<f32>, Vec<f32>)>,
    octaves: usize,
    leak: f32,
}

impl Plain {
    /// Random layers: the input, two per block, the output.
    fn random(hidden: usize, blocks: usize, outputs: usize, octaves: usize, leak: f32) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut shapes = vec![(feature_count(octaves), hidden)];
        shapes.extend(vec![(hidden, hidden); 2 * blocks]);
        shapes.push((hidden, outputs));
        let mut layer = |(inputs, outputs): (usize, usize)| {
            let scale = (inputs as f32).sqrt().recip();
            let weight = (0..inputs * outputs).map(|_| rng.random_range(-scale..scale)).collect();
            (weight, (0..outputs).map(|_| rng.random_range(-0.3..0.3)).collect())
        };
        Self { layers: shapes.into_iter().map(&mut layer).collect(), octaves, leak }
    }

    fn packed(&self) -> ResidualMlp {
        let layers: Vec<LinearWeights> = (self.layers.iter())
            .map(|(weight, bias)| LinearWeights { weight, bias, inputs: weight.len() / bias.len() })
            .collect();
        let (input, output) = (layers[0], layers[layers.len() - 1]);
        let blocks: Vec<_> = layers[1..layers.len() - 1].chunks(2).map(|pair| [pair[0], pair[1]]).collect();
        ResidualMlp::new(input, &blocks, output, self.octaves, self.leak)
    }

    fn linear(&self, layer: usize, input: &[f64]) -> Vec<f64> {
        let (weight, bias) = &self.layers[layer];
        let sum =
            |o: usize| input.iter().enumerate().map(|(i, x)| x * f64::from(weight[i * bias.len() + o])).sum::<f64>();
        bias.iter().enumerate().map(|(o, b)| f64::from(*b) + sum(o)).collect()
    }

    /// Before each block the first half of its condition is added, after the second, plus one, has multiplied; a condition
    /// that is as wide as the layer is added alone.
    fn evaluate(&self, point: DVec3, conditions: &[&[f32]]) -> Vec<f64> {
        let point = point.to_array();
        let mut features = point.to_vec();
        for k in 0..self.octaves {
            let phase = |x: f64| std::f64::consts::PI * f64::from(1 << k) * x;
            features.extend(point.map(|x| phase(x).sin()));
            features.extend(point.map(|x| phase(x).cos()));
        }
        let relu =
            |values: &[f64], leak: f64| values.iter().map(|&v| if v > 0.0 { v } else { leak * v }).collect::<Vec<_>>();
        let add = |a: &mut Vec<f64>, b: &[f64]| a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        let mut net = self.linear(0, &features);
        for block in 0..(self.layers.len() - 2) / 2 {
            if let Some(condition) = conditions.get(block) {
                let (shift, scale) = condition.split_at(net.len());
                net.iter_mut().zip(scale).for_each(|(net, &scale)| *net *= 1.0 + f64::from(scale));
                add(&mut net, &shift.iter().map(|&s| f64::from(s)).collect::<Vec<_>>());
            }
            let inner = self.linear(1 + 2 * block, &relu(&net, 0.0));
            add(&mut net, &self.linear(2 + 2 * block, &relu(&inner, 0.0)));
        }
        self.linear(self.layers.len() - 1, &relu(&net, f64::from(self.leak)))
    }
}

fn points(n: usize) -> Vec<Vec3> {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    (0..n).map(|_| Vec3::from_array([0; 3].map(|_| rng.random_range(-0.55..0.55)))).collect()
}

/// Widths that fill no block, one block and a half, and the paper's; with and without encoding, leak and blocks.
const SHAPES: [(usize, usize, usize, usize, f32); 5] =
    [(5, 2, 1, 0, 0.0), (12, 1, 4, 3, 0.2), (128, 5, 4, 0, 0.0), (128, 5, 4, 4, 0.0), (24, 0, 3, 1, 0.2)];

#[test]
fn tiles_give_what_the_layers_give_one_point_at_a_time() {
    for (hidden, blocks, outputs, octaves, leak) in SHAPES {
        let plain = Plain::random(hidden, blocks, outputs, octaves, leak);
        let points = points(211);
        for channels in [1, outputs] {
            let mut values = vec![f32::NAN; points.len() * channels];
            plain.packed().evaluate(&points, channels, &mut values);
            for (point, values) in points.iter().zip(values.chunks(channels)) {
                for (value, expected) in values.iter().zip(plain.evaluate(point.as_dvec3(), &[])) {
                    assert!((f64::from(*value) - expected).abs() < 2e-5, "{hidden} wide: {value} for {expected}");
                }
            }
        }
    }
}

#[test]
fn a_condition_is_added_before_its_block_and_one_twice_as_long_scales_too() {
    let plain = Plain::random(20, 3, 4, 2, 0.0);
    for numbers in [20, 40] {
        let condition = |i: usize| -> Vec<f32> { (0..numbers).map(|j| ((i * numbers + j) as f32).sin()).collect() };
        let conditions: Vec<Vec<f32>> = (0..3).map(condition).collect();
        let conditions: Vec<&[f32]> = conditions.iter().map(Vec::as_slice).collect();
        let (network, points) = (plain.packed().conditioned(&conditions), points(10));
        let mut values = vec![0.0; 4 * points.len()];
        network.evaluate(&points, 4, &mut values);
        let slopes = network.value_and_gradient(&points);
        for ((point, values), (value, gradient)) in points.iter().zip(values.chunks(4)).zip(slopes) {
            let point = point.as_dvec3();
            let expected = plain.evaluate(point, &conditions);
            for (value, expected) in values.iter().zip(&expected) {
                assert!((f64::from(*value) - expected).abs() < 5e-5 * expected.abs().max(1.0), "{value} {expected}");
            }
            assert!((value - values[0]).abs() < 1e-4 * value.abs().max(1.0));
            for axis in 0..3 {
                let at = |step: f64| plain.evaluate(point + step * DVec3::AXES[axis], &conditions)[0];
                let expected = (at(1e-7) - at(-1e-7)) / 2e-7;
                assert!((f64::from(gradient[axis]) - expected).abs() < 1e-3 * expected.abs().max(1.0), "{expected}");
            }
        }
    }
}

#[test]
fn gradients_are_those_of_differences() {
    for (hidden, blocks, outputs, octaves, leak) in SHAPES {
        let plain = Plain::random(hidden, blocks, outputs, octaves, leak);
        let points = points(60);
        let mut far_off = 0;
        for (point, (value, gradient)) in points.iter().zip(plain.packed().value_and_gradient(&points)) {
            assert!((f64::from(value) - plain.evaluate(point.as_dvec3(), &[])[0]).abs() < 2e-5);
            for axis in 0..3 {
                let step = DVec3::AXES[axis] * 1e-7;
                let [above, below] = [step, -step].map(|step| plain.evaluate(point.as_dvec3() + step, &[])[0]);
                let expected = (above - below) / 2e-7;
                let error = (f64::from(gradient[axis]) - expected).abs();
                // Where a ReLU switches between the points, or is at zero in single precision, there is no derivative.
                far_off += usize::from(error > 1e-3 * expected.abs().max(1.0));
            }
        }
        assert!(far_off <= 6, "{hidden} wide: {far_off} of 180");
    }
}

#[test]
fn no_points_have_no_values() {
    let network = Plain::random(8, 1, 1, 0, 0.0).packed();
    network.evaluate(&[], 1, &mut []);
    assert!(network.value_and_gradient(&[]).is_empty());
}
