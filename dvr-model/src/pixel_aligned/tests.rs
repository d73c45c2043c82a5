//! Against what cameras say, differences, and each other.

use dvr_test_support::{largest, max_difference};
use glam::{DVec3, Vec3};

use super::*;
use crate::mlp::PointFeatures;

const SIDE: usize = 9;

/// Two planes that are linear in columns and rows, so that interpolation is exact; their cameras look from two sides.
fn features() -> (PixelAligned, Vec<Camera>) {
    let cameras = [DVec3::new(0.3, 0.4, -2.0), DVec3::new(-1.5, 0.2, 1.0)]
        .map(|eye| Camera::look_at(64, 64, 60.0, eye, DVec3::ZERO, DVec3::Y))
        .to_vec();
    let value = |plane: usize, channel: usize, row: usize, column: usize| match (plane, channel) {
        (0, 0) | (1, 1) => column as f32,
        (0, _) => row as f32,
        _ => 10.0 + row as f32 - column as f32,
    };
    let at = |i: usize| value(i / (2 * SIDE * SIDE), i / (SIDE * SIDE) % 2, i / SIDE % SIDE, i % SIDE);
    let values: Vec<f32> = (0..4 * SIDE * SIDE).map(at).collect();
    let device = Device::flex();
    let plane = Tensor::<4>::from_data(TensorData::new(values, [2, 2, SIDE, SIDE]), &device);
    (PixelAligned::new(plane, [SIDE as f64, -0.5], &cameras, &device), cameras)
}

fn points() -> (Tensor<2>, Tensor<1, Int>) {
    let device = Device::flex();
    let points = Tensor::from_floats([[0.1, 0.2, -0.1], [-0.2, 0.05, 0.3], [0.3, -0.3, 0.2]], &device);
    (points, Tensor::from_ints([0, 1, 0], &device))
}

fn rows(tensor: Tensor<2>) -> Vec<Vec<f32>> {
    let columns = tensor.dims()[1];
    tensor.into_data().iter::<f32>().collect::<Vec<_>>().chunks(columns).map(<[f32]>::to_vec).collect()
}

#[test]
fn features_are_those_of_the_place_where_the_camera_sees_the_point() {
    let (features, cameras) = features();
    let (points, object) = points();
    let found = rows(features.at(&points, &object));
    for ((point, object), found) in rows(points).iter().zip([0, 1, 0]).zip(found) {
        let point = DVec3::new(point[0].into(), point[1].into(), point[2].into());
        let place = cameras[object].project(point).0 / 64.0 * SIDE as f64 - 0.5;
        let [column, row] = [place.x as f32, place.y as f32];
        let expected = if object == 0 { [column, row] } else { [10.0 + row - column, column] };
        assert!(
            (found[0] - expected[0]).abs() < 1e-4 && (found[1] - expected[1]).abs() < 1e-4,
            "{found:?} {expected:?}"
        );
    }
}

/// In the picture, beyond each of its edges, and behind the camera.
fn many_points() -> Vec<f32> {
    (0..600).map(|i: usize| 1.5 * (1.7 * i as f32).sin()).chain([0.3, 0.4, -2.5]).collect()
}

#[test]
fn looked_up_by_hand_features_and_their_gradients_are_those_of_burns_operations() {
    let (features, _) = features();
    let count = many_points().len() / 3;
    let owner: Vec<i64> = (0..count as i64).map(|i| i * i % 2).collect();
    let points = Tensor::<2>::from_data(TensorData::new(many_points(), [count, 3]), &Device::flex());
    let weights = Tensor::from_inner(points.clone().narrow(1, 0, 2) + 0.3);
    let (points, object) = (
        Tensor::from_inner(points),
        Tensor::from_inner(Tensor::<1, Int>::from_data(TensorData::new(owner, [count]), &Device::flex())),
    );
    let on_graph = PixelAligned {
        rows: Tensor::from_inner(features.rows).require_grad(),
        projections: Tensor::from_inner(features.projections),
        axes: Tensor::from_inner(features.axes),
        ..features
    };
    let found = |values: Tensor<2>| {
        let gradients = (values.clone() * weights.clone()).sum().backward();
        let by_rows = on_graph.rows.grad(&gradients).expect("a gradient");
        [rows(values).concat(), rows(by_rows).concat()]
    };
    let by_hand = found(on_graph.at_constants(&points, &object));
    let expected = found(on_graph.at(&points, &object));
    for (by_hand, expected) in by_hand.iter().zip(&expected) {
        let apart = max_difference(by_hand, expected);
        assert!(apart < 1e-4 * largest(expected.iter().map(|value| value.abs())), "{apart}");
        assert!(expected.iter().any(|value| *value != 0.0));
    }
}

#[test]
fn gradients_are_the_same_bits_whatever_the_threads() {
    let (features, _) = features();
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let tracked = Tensor::from_inner(features.rows.clone()).require_grad();
            let aligned = PixelAligned { rows: tracked.clone(), ..features.clone() };
            let count = many_points().len() / 3;
            let points = Tensor::<2>::from_data(TensorData::new(many_points(), [count, 3]), &Device::flex());
            let object = Tensor::<1, Int>::zeros([count], &Device::flex());
            let values = aligned.at_constants(&points, &object);
            let gradients = values.square().sum().backward();
            rows(tracked.grad(&gradients).expect("a gradient"))
        })
    };
    assert!(with(1) == with(3));
}

#[test]
fn off_the_tensors_features_and_derivatives_are_the_same() {
    let (features, _) = features();
    let device = Device::flex();
    let flat = many_points();
    let count = flat.len() / 3;
    let points: Vec<Vec3> = flat.as_chunks().0.iter().map(|point| Vec3::from_array(*point)).collect();
    let at = Tensor::<2>::from_data(TensorData::new(flat, [count, 3]), &device);
    for (row, plane) in features.picture_planes().into_iter().enumerate() {
        let object = Tensor::<1, Int>::full([count], row as i64, &device);
        let written = |write: &dyn Fn(&mut [f32])| -> Vec<f32> {
            let mut rows = vec![0.0; plane.count() * count];
            write(&mut rows);
            (0..count).flat_map(|lane| rows.iter().skip(lane).step_by(count).copied().collect::<Vec<_>>()).collect()
        };
        let expected = |found: Tensor<2>, turned: &Tensor<2>| -> Vec<f32> {
            rows(Tensor::cat(vec![found, features.in_camera_axes(turned, &object)], 1)).concat()
        };
        let values = written(&|rows: &mut [f32]| plane.write(&points, count, rows));
        assert!(max_difference(&values, &expected(features.at(&at, &object), &at)) < 1e-4);
        for axis in 0..3 {
            let mut direction = [0.0f32; 3];
            direction[axis] = 1.0;
            let direction = Tensor::<2>::from_floats([direction], &device).repeat_dim(0, count);
            let (_, mut along) = features.tangents(&at, &object, std::slice::from_ref(&direction));
            let slopes = written(&|rows: &mut [f32]| plane.write_tangents(&points, axis, count, rows));
            let truth = expected(along.remove(0), &direction);
            let off = slopes.iter().zip(&truth).map(|(a, b)| (a - b).abs() / b.abs().max(1.0));
            let off = largest(off);
            assert!(off < 1e-3, "{row}, {axis}: {off}");
        }
    }
}

#[test]
fn derivatives_are_those_of_differences() {
    let (features, _) = features();
    let (points, object) = points();
    let direction = Tensor::from_floats([[1.0, 0.5, -0.3], [0.2, -1.0, 0.4], [0.0, 0.0, 1.0]], &Device::flex());
    let (value, tangents) = features.tangents(&points, &object, std::slice::from_ref(&direction));
    assert_eq!(rows(value), rows(features.at(&points, &object)));
    let step = 1e-2;
    let at = |shift: f64| features.at(&(points.clone() + direction.clone() * shift), &object);
    let differences = rows((at(step) - at(-step)) / (2.0 * step));
    for (found, expected) in rows(tangents[0].clone()).iter().flatten().zip(differences.iter().flatten()) {
        assert!((found - expected).abs() < 2e-3 * expected.abs().max(1.0), "{found} {expected}");
    }
}

#[test]
fn beyond_the_picture_features_are_those_of_its_edge_and_do_not_change() {
    let (features, _) = features();
    let device = Device::flex();
    let far = Tensor::from_floats([[5.0, 0.0, 0.0]], &device);
    let object = Tensor::from_ints([0], &device);
    let direction = Tensor::from_floats([[1.0, 0.0, 0.0]], &device);
    let (value, tangents) = features.tangents(&far, &object, &[direction]);
    let column = rows(value)[0][0];
    assert!(column == 0.0 || column == (SIDE - 1) as f32, "{column}");
    assert_eq!(rows(tangents[0].clone())[0][0], 0.0);
}

#[test]
fn a_point_behind_the_camera_has_features_and_finite_derivatives() {
    let (features, _) = features();
    let device = Device::flex();
    let (point, object) = (Tensor::from_floats([[0.3, 0.4, -2.5]], &device), Tensor::from_ints([0], &device));
    let direction = Tensor::from_floats([[0.0, 1e-6, 1e-6]], &device);
    let (value, tangents) = features.tangents(&point, &object, &[direction]);
    assert!(rows(value).concat().iter().chain(&rows(tangents[0].clone()).concat()).all(|number| number.is_finite()));
}

#[test]
fn points_turn_into_the_axes_of_their_camera() {
    let (features, cameras) = features();
    let (points, object) = points();
    let found = rows(features.in_camera_axes(&points, &object));
    let expected = cameras[1].rotation * DVec3::new(-0.2, 0.05, 0.3);
    for (found, expected) in found[1].iter().zip(expected.to_array()) {
        assert!((f64::from(*found) - expected).abs() < 1e-6);
    }
}
