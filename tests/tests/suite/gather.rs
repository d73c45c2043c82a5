//! Gathered rows have the values and gradients of burn's own `select`, on every device.

use burn::tensor::{Device, Int, Tensor, TensorData};
use dvr_render::{DistinctRows, gather_rows};
use dvr_tests::{gpu, max_difference, numbers, tensor1, test_with};
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const COLUMNS: usize = 5;

fn random(count: usize, seed: u64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| rng.random_range(-1.0..1.0)).collect()
}

fn index_tensor(index: &[i64], device: &Device) -> Tensor<1, Int> {
    Tensor::from_data(TensorData::new(index.to_vec(), [index.len()]), device)
}

/// Rows gathered from a random matrix, and the gradient of a random functional of them.
fn gathered(rows: usize, device: &Device, gather: impl Fn(Tensor<2>) -> Tensor<2>) -> [Vec<f64>; 2] {
    let device = device.clone().autodiff();
    let values = tensor1(&random(rows * COLUMNS, 1), &device).reshape([rows, COLUMNS]).detach().require_grad();
    let found = gather(values.clone());
    let weights = tensor1(&random(found.dims().iter().product(), 2), &device).reshape(found.dims());
    let gradients = (found.clone() * weights).sum().backward();
    [numbers(found), numbers(values.grad(&gradients).expect("a gradient"))]
}

/// The suite for the devices that `$devices` gives, each with a name.
macro_rules! suite {
    ($test:meta, $name:ident, $devices:expr) => {
        mod $name {
            use super::*;

            #[$test]
            fn repeated_rows_sum_their_gradients_and_rows_that_are_not_gathered_get_zero() {
                $devices.into_iter().for_each(|(name, device)| super::repeated_rows_sum(name, device));
            }

            #[$test]
            fn distinct_rows_in_any_order_pass_their_gradients_on_unchanged() {
                $devices.into_iter().for_each(|(name, device)| super::distinct_rows_pass_on(name, device));
            }

            #[$test]
            fn values_are_scattered_to_their_rows() {
                $devices.into_iter().for_each(|(name, device)| super::values_are_scattered(name, device));
            }
        }
    };
}

suite!(test, on_the_cpu, [("cpu", Device::flex())]);
suite!(test_with(gpu), on_a_gpu, [("gpu", gpu())]);

fn repeated_rows_sum(name: &str, device: Device) {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let index: Vec<i64> = (0..700).map(|_| rng.random_range(1..16)).collect();
    let at = index_tensor(&index, &device);
    let truth = gathered(17, &Device::flex(), |values| values.select(0, index_tensor(&index, &Device::flex())));
    let ours = gathered(17, &device, |values| gather_rows(values, at.clone()));
    assert_eq!(ours[0], truth[0], "{name}");
    assert!(max_difference(&ours[1], &truth[1]) < 1e-5, "{name}");
    assert!(ours[1][..COLUMNS].iter().all(|g| *g == 0.0), "{name}: row 0 was not gathered");
    assert_eq!(gathered(17, &device, |values| gather_rows(values, at.clone())), ours, "{name}: the same bits again");
}

fn distinct_rows_pass_on(name: &str, device: Device) {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut shuffled: Vec<i64> = (0..300).collect();
    shuffled.shuffle(&mut rng);
    for index in [&shuffled[..], &shuffled[..77], &shuffled[..1]] {
        let truth = gathered(300, &Device::flex(), |values| values.select(0, index_tensor(index, &Device::flex())));
        let rows = DistinctRows::new(index, 300, &device);
        assert_eq!(gathered(300, &device, |values| rows.gather(values)), truth, "{name}, {} rows", index.len());
        let column = |values: Tensor<2>| rows.gather_column(values.narrow(1, 2, 1).squeeze_dim(1)).unsqueeze_dim(1);
        let column_truth = gathered(300, &Device::flex(), |values| {
            values.narrow(1, 2, 1).select(0, index_tensor(index, &Device::flex()))
        });
        assert_eq!(gathered(300, &device, column), column_truth, "{name}, a column");
    }
}

fn values_are_scattered(name: &str, device: Device) {
    let rows = DistinctRows::new(&[3, 0], 5, &device);
    assert_eq!(numbers(rows.scatter(tensor1(&[1.5, 2.5], &device))), [2.5, 0.0, 0.0, 1.5, 0.0], "{name}");
}
