//! The kernel against a reference implementation in plain Rust: the same network, the same march, one number after the other.

use burn::tensor::{Device, Int, Tensor, TensorData};
use dvr_gpu::{Gpu, PackedDecoder, RaySearch, Root, march_decoder};
use dvr_test_support::test_with;

/// Uniform numbers in `[-1, 1)` (Knuth's linear congruence).
struct Random(u64);

impl Random {
    fn draw(&mut self, n: usize) -> Vec<f32> {
        let mut next = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 40) as f32 / (1u64 << 23) as f32 - 1.0
        };
        (0..n).map(|_| next()).collect()
    }
}

/// A network as it is packed for the kernel.
struct Network {
    hidden: usize,
    blocks: usize,
    octaves: usize,
    leak: f32,
    weights: Vec<f32>,
    /// `[blocks][objects][hidden]`; empty without codes.
    conditions: Vec<f32>,
    objects: usize,
}

impl Network {
    fn new(hidden: usize, blocks: usize, octaves: usize, leak: f32, objects: usize) -> Self {
        let mut random = Random(7);
        let features = 3 + 6 * octaves;
        let mut weights = Vec::new();
        let mut layer = |inputs: usize, outputs: usize| {
            let scale = (2.0 / inputs as f32).sqrt();
            weights.extend(random.draw(inputs * outputs).iter().map(|w| w * scale));
            weights.extend(random.draw(outputs).iter().map(|b| b * 0.1));
        };
        layer(features, hidden);
        (0..2 * blocks).for_each(|_| layer(hidden, hidden));
        layer(hidden, 1);
        let conditions = random.draw(blocks * objects * hidden).iter().map(|c| 0.2 * c).collect();
        let mut network = Self { hidden, blocks, octaves, leak, weights, conditions, objects };
        // The mean logit becomes that of a point that half of the cube is denser than.
        let middle: f32 =
            (0..200).map(|_| network.logit([0.0; 3].map(|_: f32| 0.5 * random.draw(1)[0]), 0)).sum::<f32>() / 200.0;
        if let Some(bias) = network.weights.last_mut() {
            *bias -= middle;
        }
        network
    }

    fn logit(&self, point: [f32; 3], object: usize) -> f32 {
        let mut features = point.to_vec();
        for octave in 0..self.octaves {
            let phase = point.map(|x| x * std::f32::consts::PI * (1u32 << octave) as f32);
            features.extend(phase.map(f32::sin));
            features.extend(phase.map(f32::cos));
        }
        let mut at = 0;
        let mut linear = |inputs: &[f32], outputs: usize| -> Vec<f32> {
            let weights = &self.weights[at..at + inputs.len() * outputs];
            let bias = &self.weights[at + inputs.len() * outputs..][..outputs];
            at += (inputs.len() + 1) * outputs;
            let sum = |j: usize| inputs.iter().enumerate().map(|(k, x)| x * weights[k * outputs + j]).sum::<f32>();
            (0..outputs).map(|j| sum(j) + bias[j]).collect()
        };
        let relu = |values: &[f32], leak: f32| -> Vec<f32> { values.iter().map(|&x| x.max(leak * x)).collect() };
        let mut net = linear(&features, self.hidden);
        for block in 0..self.blocks {
            if self.objects > 0 {
                let row = &self.conditions[(block * self.objects + object) * self.hidden..][..self.hidden];
                net.iter_mut().zip(row).for_each(|(x, c)| *x += c);
            }
            let inner = linear(&relu(&net, 0.0), self.hidden);
            let inner = linear(&relu(&inner, 0.0), self.hidden);
            net.iter_mut().zip(inner).for_each(|(x, y)| *x += y);
        }
        linear(&relu(&net, self.leak), 1)[0]
    }

    fn packed(&self, device: &Device) -> PackedDecoder {
        let rows = self.blocks * self.objects;
        let conditions = TensorData::new(self.conditions.clone(), [rows, self.hidden]);
        PackedDecoder {
            weights: Tensor::from_floats(self.weights.as_slice(), device),
            conditions: (self.objects > 0).then(|| Tensor::from_data(conditions, device)),
            hidden: self.hidden,
            blocks: self.blocks,
            octaves: self.octaves,
            leak: self.leak,
        }
    }
}

struct Ray {
    origin: [f32; 3],
    direction: [f32; 3],
    interval: [f32; 2],
    jitter: f32,
    object: usize,
}

impl Ray {
    fn at(&self, depth: f32) -> [f32; 3] {
        [0, 1, 2].map(|i| self.origin[i] + self.direction[i] * depth)
    }
}

fn rays(n: usize, objects: usize) -> Vec<Ray> {
    let mut random = Random(11);
    (0..n)
        .map(|i| {
            let numbers = random.draw(7);
            let interval = if i % 17 == 5 { [0.0, -1.0] } else { [0.0, 1.2 + 0.2 * numbers[6]] };
            Ray {
                origin: [0, 1, 2].map(|k| 0.5 * numbers[k]),
                direction: [3, 4, 5].map(|k| 0.8 * numbers[k]),
                interval,
                jitter: 0.5 + 0.499 * numbers[0],
                object: if objects > 0 { i % objects } else { 0 },
            }
        })
        .collect()
}

/// RayStatus, depth between the samples of whose logits the signs differ, depth of the largest logit.
fn march(network: &Network, ray: &Ray, steps: usize, jittered: bool) -> (u8, [f32; 2], f32) {
    let [entry, exit] = ray.interval;
    let depth = |k: usize| {
        let share = if jittered { (k as f32 + ray.jitter) / steps as f32 } else { k as f32 / (steps - 1) as f32 };
        entry + (exit - entry) * share
    };
    let (mut max_logit, mut max_logit_depth) = (f32::NEG_INFINITY, entry);
    if exit < entry {
        return (0, [0.0; 2], entry);
    }
    for k in 0..steps {
        let logit = network.logit(ray.at(depth(k)), ray.object);
        if logit > max_logit {
            (max_logit, max_logit_depth) = (logit, depth(k));
        }
        if logit >= 0.0 {
            let before = k.saturating_sub(1);
            return (if k == 0 { 2 } else { 1 }, [depth(before), depth(k)], max_logit_depth);
        }
    }
    (0, [0.0; 2], max_logit_depth)
}

fn on_device(network: &Network, rays: &[Ray], search: (usize, Root, usize, bool), device: &Device) -> Vec<[f32; 3]> {
    let (steps, root, root_steps, jittered) = search;
    let vectors = |part: fn(&Ray) -> [f32; 3]| {
        let values: Vec<f32> = rays.iter().flat_map(part).collect();
        Tensor::<2>::from_data(TensorData::new(values, [rays.len(), 3]), device)
    };
    let numbers =
        |part: fn(&Ray) -> f32| Tensor::<1>::from_floats(rays.iter().map(part).collect::<Vec<_>>().as_slice(), device);
    let objects: Vec<i32> = rays.iter().map(|ray| ray.object as i32).collect();
    let search = RaySearch {
        origin: vectors(|ray| ray.origin),
        direction: vectors(|ray| ray.direction),
        interval: [numbers(|ray| ray.interval[0]), numbers(|ray| ray.interval[1])],
        jitter: jittered.then(|| numbers(|ray| ray.jitter)),
        object: (network.objects > 0).then(|| Tensor::<1, Int>::from_ints(objects.as_slice(), device)),
        steps,
        root,
        root_steps,
    };
    let found = march_decoder(&network.packed(device), &search).expect("a device that runs the kernel");
    let values: Vec<f32> = found.into_data().iter::<f32>().collect();
    values.as_chunks().0.to_vec()
}

#[test_with(gpu)]
fn the_kernel_finds_what_the_reference_implementation_finds() {
    let Gpu { device, .. } = dvr_test_support::gpu(dvr_gpu::open(0));
    for (network, search) in [
        (Network::new(32, 2, 0, 0.0, 0), (17, Root::Chandrupatla, 8, false)),
        (Network::new(40, 1, 2, 0.2, 0), (32, Root::Secant, 12, true)),
        (Network::new(300, 1, 1, 0.0, 3), (9, Root::Bisection, 14, true)),
        (Network::new(64, 2, 3, 0.0, 2), (25, Root::Chandrupatla, 10, false)),
    ] {
        let context = format!("width {}, {:?}", network.hidden, search.1);
        let rays = rays(150, network.objects);
        let found = on_device(&network, &rays, search, &device);
        let (mut statuses, mut unlike) = ([0; 3], 0);
        for (ray, [status, depth, max_logit_depth]) in rays.iter().zip(found) {
            let (expected, [before, behind], expected_depth) = march(&network, ray, search.0, search.3);
            statuses[usize::from(expected)] += 1;
            // Where a sample lies on the surface to rounding, either side is right.
            if status != f32::from(expected) {
                unlike += 1;
                continue;
            }
            match expected {
                1 => {
                    assert!(depth >= before && depth <= behind, "{context}: {depth} is not in [{before}, {behind}]");
                    let logit = network.logit(ray.at(depth), ray.object);
                    assert!(logit.abs() < 2e-3, "{context}: the logit at the crossing is {logit}");
                }
                0 => assert!(
                    (max_logit_depth - expected_depth).abs() < 1e-5,
                    "{context}: {max_logit_depth}, not {expected_depth}"
                ),
                _ => {}
            }
        }
        println!("{context}: {statuses:?} rays miss, hit, start inside; {unlike} unlike");
        assert!(unlike <= 1 && statuses.iter().all(|&count| count > 8), "{context}: {statuses:?}, {unlike} unlike");
        let again = on_device(&network, &rays, search, &device);
        let bits = |found: &[[f32; 3]]| found.iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(
            bits(&again),
            bits(&on_device(&network, &rays, search, &device)),
            "{context}: the same bits each time"
        );
    }
}
