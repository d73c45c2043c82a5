//! Decoder and losses against arrays of DVR's reference code, in single precision.

use burn::tensor::{Device, Tensor, TensorData};
use dvr_render::{Field, Query};
use dvr_tests::*;
use dvr_train::losses;

#[test]
fn the_decoder_gives_the_reference_values_with_and_without_code() {
    let device = Device::flex();
    for code_dim in [0, 32] {
        let mut fixture = Fixture::open(&format!("decoder_eval_c{code_dim}_h64"));
        let (_, decoder) = fixture_decoder(code_dim, &device);
        let points_name = if fixture.contains("p") { "p" } else { "points" };
        let points = fixture.points(points_name);
        let truth = fixture.numbers("out");
        let code = (code_dim > 0).then(|| {
            let codes = fixture.numbers("c");
            let batch = codes.len() / code_dim;
            rows(&codes, code_dim, &device).select(0, groups(points.len(), batch, &device))
        });
        let out = numbers(decoder.forward(tensor3(&points, &device), code));
        assert!(max_difference(&out, &truth) < 2e-5, "c{code_dim}: {}", max_difference(&out, &truth));
    }
}

#[test]
fn the_codes_file_holds_the_codes_of_the_ray_files() {
    let (mut codes, mut rays) = (Fixture::open("codes_c32"), Fixture::open("rays_c32_h64"));
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
    let mut f = Fixture::open("losses");
    let (predicted, truth, mask) = (f.numbers("rgb_pred"), f.numbers("rgb_gt"), f.truths("rgb_mask"));
    let kept = |values: &[f64], keep: &[bool]| -> Vec<f64> {
        values.chunks_exact(3).zip(keep).filter(|(_, k)| **k).flat_map(|(v, _)| v.to_vec()).collect()
    };
    let device = Device::flex();
    let truth_on = |keep: &[bool]| Tensor::<2>::from_inner(rows(&kept(&truth, keep), 3, &device));
    let (sum, gradient) =
        value_and_gradient(rows(&kept(&predicted, &mask), 3, &device), |p| losses::color_l1(p, truth_on(&mask)));
    let count = mask.iter().filter(|m| **m).count() as f64;
    close(sum, f.number("rgb_l1.sum"), 1e-5, "rgb_l1.sum");
    close(sum / count, f.number("rgb_l1.mean"), 1e-5, "rgb_l1.mean");
    let gradient = scattered(&gradient, &mask, 3);
    assert!(max_difference(&gradient, &f.numbers("rgb_l1.sum.grad_pred")) < 1e-6);
    let mean: Vec<f64> = gradient.iter().map(|g| g / count).collect();
    assert!(max_difference(&mean, &f.numbers("rgb_l1.mean.grad_pred")) < 1e-6);

    for size in [2usize, 3] {
        let (pixels, context) = (size * size, format!("image gradients of patches of {size}"));
        let keep: Vec<bool> = mask.chunks_exact(pixels).flat_map(|p| vec![p.iter().all(|m| *m); pixels]).collect();
        let patches = (keep.iter().filter(|k| **k).count() / pixels) as f64;
        let (sum, gradient) = value_and_gradient(rows(&kept(&predicted, &keep), 3, &device), |p| {
            losses::image_gradient(p, truth_on(&keep), size)
        });
        close(sum, f.number(&format!("image_gradient.ps{size}.sum")), 1e-5, &context);
        close(sum / patches, f.number(&format!("image_gradient.ps{size}.mean")), 1e-5, &context);
        let gradient = scattered(&gradient, &keep, 3);
        let reference = f.numbers(&format!("image_gradient.ps{size}.sum.grad_pred"));
        assert!(max_difference(&gradient, &reference) < 1e-5, "{context}");
        let mean: Vec<f64> = gradient.iter().map(|g| g / patches).collect();
        assert!(max_difference(&mean, &f.numbers(&format!("image_gradient.ps{size}.mean.grad_pred"))) < 1e-5);
    }
}

#[test]
fn occupancy_free_space_and_depth_losses_are_those_of_the_reference() {
    let mut f = Fixture::open("losses");
    let device = Device::flex();
    let logits = f.numbers("logits");
    let n = logits.len() as f64;
    for (key, loss) in
        [("freespace", losses::free_space as fn(Tensor<1>) -> Tensor<1>), ("occupancy", losses::occupancy)]
    {
        let (sum, gradient) = value_and_gradient(tensor1(&logits, &device), loss);
        close(sum, f.number(&format!("{key}.sum")), 1e-5, key);
        close(sum / n, f.number(&format!("{key}.mean")), 1e-5, key);
        assert!(max_difference(&gradient, &f.numbers(&format!("{key}.sum.grad"))) < 1e-5, "{key}");
        let mean: Vec<f64> = gradient.iter().map(|g| g / n).collect();
        assert!(max_difference(&mean, &f.numbers(&format!("{key}.mean.grad"))) < 1e-5, "{key}");
    }
    // The weighted form is one term a point times its weight: what our sum is made of.
    let weights = f.numbers("logit_weights");
    let weighted: f64 =
        logits.iter().zip(&weights).map(|(&l, &w)| w * numbers(losses::occupancy(tensor1(&[l], &device)))[0]).sum();
    close(weighted, f.number("occupancy_weighted.sum"), 1e-4, "occupancy_weighted.sum");
    close(weighted / n, f.number("occupancy_weighted.mean"), 1e-4, "occupancy_weighted.mean");

    let (p, t) = (f.numbers("depth_pred"), f.numbers("depth_gt"));
    let (sum, gradient) =
        value_and_gradient(tensor1(&p, &device), |p| losses::depth_l1(p, Tensor::from_inner(tensor1(&t, &device))));
    close(sum, f.number("depth_l1.sum"), 1e-5, "depth_l1.sum");
    close(sum / p.len() as f64, f.number("depth_l1.mean"), 1e-5, "depth_l1.mean");
    assert!(max_difference(&gradient, &f.numbers("depth_l1.sum.grad_pred")) < 1e-6);
    let mean: Vec<f64> = gradient.iter().map(|g| g / p.len() as f64).collect();
    assert!(max_difference(&mean, &f.numbers("depth_l1.mean.grad_pred")) < 1e-6);

    let (p, t) = (f.numbers("world_pred"), f.numbers("world_gt"));
    let (sum, gradient) = value_and_gradient(rows(&p, 3, &device), |p| {
        losses::point_distance(p, Tensor::from_inner(rows(&t, 3, &device)))
    });
    close(sum, f.number("depth_l2_world.sum"), 1e-5, "depth_l2_world.sum");
    close(sum * 3.0 / p.len() as f64, f.number("depth_l2_world.mean"), 1e-5, "depth_l2_world.mean");
    assert!(max_difference(&gradient, &f.numbers("depth_l2_world.sum.grad_pred")) < 1e-5);
    let mean: Vec<f64> = gradient.iter().map(|g| g * 3.0 / p.len() as f64).collect();
    assert!(max_difference(&mean, &f.numbers("depth_l2_world.mean.grad_pred")) < 1e-5);
}

#[test]
fn normals_by_differences_and_their_smoothness_are_those_of_the_reference() {
    let mut f = Fixture::open("losses");
    let device = Device::flex();
    for code_dim in [0usize, 32] {
        let key = |name: &str| format!("normal_c{code_dim}.{name}");
        let (_, decoder) = fixture_decoder(code_dim, &device);
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
