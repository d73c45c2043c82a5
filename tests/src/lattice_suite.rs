//! What must be true of the lattice decoder on any device, in any precision.

use burn::tensor::{Device, Tensor};
use dvr_kernels::Lattice;
use dvr_model::{LatticeDecoder, LatticeField, LatticeValues};
use dvr_render::{Field, FieldValues, Query};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::plain_lattice::PlainCells;
use crate::{numbers, relative_difference, tensor1};

/// More than one chunk of the kernels.
const POINTS: usize = 2500;

/// Random numbers between two.
fn random(count: usize, seed: u64, low: f64, high: f64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| rng.random_range(low..high)).collect()
}

/// A decoder with random values; some colours leave `[0, 1]`.
fn decoder(device: &Device) -> LatticeDecoder {
    let part = |nodes, channels: usize, seed, low, high| {
        let lattice = Lattice::new(nodes, 0.55);
        let values = random(channels * lattice.len(), seed, low, high).into_iter().map(|x| x as f32).collect();
        LatticeValues { lattice, values }
    };
    let field = LatticeField::new(part(8, 1, 0, -1.0, 1.0), part(5, 3, 1, -0.2, 1.2));
    LatticeDecoder::from_field(&field, device)
}

fn rows(seed: u64, low: f64, high: f64, columns: usize, device: &Device) -> Tensor<2> {
    tensor1(&random(columns * POINTS, seed, low, high), device).reshape([POINTS, columns])
}

/// Logits and colours, and their derivatives along directions, in plain tensors.
fn plain(decoder: &LatticeDecoder, points: &Tensor<2>, directions: &Tensor<2>) -> [FieldValues; 2] {
    let shape = PlainCells::new(decoder.shape_lattice(), points.clone());
    let color = PlainCells::new(decoder.color_lattice(), points.clone());
    let unclamped = color.value(&decoder.color.val());
    let clamped = unclamped.clone().lower_elem(0.0).bool_or(unclamped.clone().greater_elem(1.0));
    let change = color.derivative(&decoder.color.val(), directions.clone()).mask_fill(clamped, 0.0);
    [
        FieldValues {
            occupancy_logit: shape.value(&decoder.shape.val()).squeeze_dim(1),
            color: unclamped.clamp(0.0, 1.0),
        },
        FieldValues {
            occupancy_logit: shape.derivative(&decoder.shape.val(), directions.clone()).squeeze_dim(1),
            color: change,
        },
    ]
}

/// Everything that can be asked agrees with plain tensors, up to relative errors of `tolerance` in the Euclidean norm:
/// values, forward-mode derivatives, and the gradients of both by parameters, points and directions.
pub fn agrees_with_plain_tensors(device: &Device, tolerance: f64) {
    let device = device.clone().autodiff();
    let decoder = decoder(&device);
    // A tenth of the coordinates lies outside the cube.
    let points = rows(2, -0.6, 0.6, 3, &device).require_grad();
    let directions = rows(3, -1.0, 1.0, 3, &device).require_grad();
    let query = Query::new(points.clone());
    let compare = |what: &str, found: &Tensor<2>, expected: &Tensor<2>| {
        let error = relative_difference(&numbers(found.clone()), &numbers(expected.clone()));
        assert!(error < tolerance, "{what}: {error:.1e}");
    };
    let column = |tensor: &Tensor<1>| tensor.clone().unsqueeze_dim::<2>(1);

    let jet = decoder.jet(&query, directions.clone());
    let [value, derivative] = plain(&decoder, &points, &directions);
    for (what, found, expected) in [("value", &jet.value, &value), ("derivative", &jet.derivative, &derivative)] {
        compare(what, &column(&found.occupancy_logit), &column(&expected.occupancy_logit));
        compare(what, &found.color, &expected.color);
    }
    let evaluated = decoder.evaluate(&query);
    compare("value alone", &column(&evaluated.occupancy_logit), &column(&value.occupancy_logit));
    compare("value alone", &evaluated.color, &value.color);
    let gradient = (0..3).map(|axis| {
        let direction = dvr_render::axis_direction(&query, axis);
        PlainCells::new(decoder.shape_lattice(), points.clone()).derivative(&decoder.shape.val(), direction)
    });
    compare("gradient", &decoder.occupancy_gradient(&query), &Tensor::cat(gradient.collect(), 1));

    // Random functionals of the answers, so that no two errors can cancel.
    let weights = [1, 3, 1, 3].map(|columns| rows(4 + columns as u64, -1.0, 1.0, columns, &device));
    let loss = |parts: [&FieldValues; 2]| {
        let terms = parts.into_iter().zip(weights.as_chunks::<2>().0).map(|(part, [by_logit, by_color])| {
            (column(&part.occupancy_logit) * by_logit.clone()).sum() + (part.color.clone() * by_color.clone()).sum()
        });
        terms.reduce(|a, b| a + b).expect("two parts")
    };
    let nothing = || {
        let zeros = Tensor::zeros([POINTS, 4], &device);
        FieldValues { occupancy_logit: zeros.clone().narrow(1, 0, 1).squeeze_dim(1), color: zeros.narrow(1, 0, 3) }
    };
    for what in ["value", "jet"] {
        // A graph can be gone through once: everything is computed anew.
        let found = match what {
            "value" => loss([&decoder.evaluate(&query), &nothing()]),
            _ => {
                let jet = decoder.jet(&query, directions.clone());
                loss([&jet.value, &jet.derivative])
            }
        };
        let [value, derivative] = plain(&decoder, &points, &directions);
        let expected = if what == "value" { loss([&value, &nothing()]) } else { loss([&value, &derivative]) };
        let (found, expected) = (found.backward(), expected.backward());
        for (by, tensor) in [
            ("shape", decoder.shape.val()),
            ("color", decoder.color.val()),
            ("points", points.clone()),
            ("directions", directions.clone()),
        ] {
            match [&found, &expected].map(|gradients| tensor.grad(gradients)) {
                [Some(found), Some(expected)] => compare(&format!("{what} by {by}"), &found, &expected),
                [None, None] => assert_eq!((what, by), ("value", "directions")),
                _ => panic!("{what} by {by}: only one of them has a gradient"),
            }
        }
    }
}
