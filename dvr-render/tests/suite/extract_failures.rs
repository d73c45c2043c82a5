//! Fields that have no mesh, and how they are refused.

use std::cell::RefCell;

use dvr_core::UnitCube;
use dvr_render::extract::{ExtractError, ExtractSettings, ScalarField, extract_mesh};
use glam::Vec3;

fn small() -> ExtractSettings {
    ExtractSettings { resolution: 16, upsampling_steps: 2, ..Default::default() }
}

fn error(field: impl Fn(&[Vec3]) -> Vec<f32>) -> ExtractError {
    extract_mesh(&field, &small(), &[]).unwrap_err()
}

#[test]
fn a_field_that_is_outside_everywhere_says_so_after_looking_at_every_node() {
    let error = error(|points| points.iter().map(|p| -1.0 - p.length()).collect());
    let ExtractError::NoSurface { inside: false, max, resolution: 16, evaluations, .. } = error else {
        panic!("{error}")
    };
    assert_eq!((max, evaluations), (-1.0, 17 * 17 * 17));
    assert!(error.to_string().contains("below the level 0 (from -1.9"), "{error}");
}

#[test]
fn a_field_that_is_inside_everywhere_is_no_cube() {
    for logit in [0.0, 3.5] {
        let error = error(|points| vec![logit; points.len()]);
        assert!(matches!(error, ExtractError::NoSurface { inside: true, min, .. } if min == logit), "{error}");
        assert!(error.to_string().contains("raise the level"), "{error}");
    }
}

#[test]
fn seeds_in_empty_space_do_not_make_a_surface() {
    let empty = |points: &[Vec3]| vec![-1.0; points.len()];
    let error = extract_mesh(&empty, &small(), &[Vec3::ZERO, Vec3::splat(0.55)]).unwrap_err();
    assert!(matches!(error, ExtractError::NoSurface { inside: false, .. }));
}

#[test]
fn nan_logits_are_counted_and_placed() {
    let error = error(|points| points.iter().map(|p| if p.x > 0.54 { f32::NAN } else { 0.3 - p.length() }).collect());
    let ExtractError::NotANumber { what: "logits", count, first, .. } = error else { panic!("{error}") };
    assert_eq!(count, 25, "one face of the coarse grid of 5^3 nodes");
    assert!((first.x - 0.55).abs() < 1e-6);
}

#[test]
fn nan_colors_and_gradients_are_refused() {
    struct Sick {
        gradients: bool,
    }
    impl ScalarField for Sick {
        fn logits(&self, points: &[Vec3]) -> Vec<f32> {
            points.iter().map(|p| 0.3 - p.length()).collect()
        }
        fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
            self.gradients.then(|| vec![Vec3::NAN; points.len()])
        }
        fn colors(&self, points: &[Vec3], _: &[Vec3], _: Option<&[Vec3]>) -> Option<Vec<[f32; 3]>> {
            Some(vec![[0.0, f32::INFINITY, 0.0]; points.len()])
        }
    }
    for (gradients, expected) in [(true, "gradients"), (false, "colors")] {
        let error = extract_mesh(&Sick { gradients }, &small(), &[]).unwrap_err();
        assert!(matches!(error, ExtractError::NotANumber { what, .. } if what == expected), "{error}");
    }
}

#[test]
fn a_field_that_forgets_answers_is_refused() {
    let error = error(|points| vec![1.0; points.len() - 1]);
    assert_eq!(error, ExtractError::AnswerLength { what: "logits", points: 125, answers: 124 });
}

#[test]
fn infinite_logits_are_no_obstacle() {
    let hard = |points: &[Vec3]| -> Vec<f32> {
        points.iter().map(|p| if p.length() < 0.3 { f32::INFINITY } else { f32::NEG_INFINITY }).collect()
    };
    let mesh = extract_mesh(&hard, &ExtractSettings { refinement_steps: 12, ..small() }, &[]).unwrap().mesh;
    assert!(mesh.vertices.iter().all(|v| (v.length() - 0.3).abs() < 1e-3));
}

#[test]
fn batches_are_never_longer_than_asked() {
    let longest = RefCell::new(0);
    let field = |points: &[Vec3]| -> Vec<f32> {
        longest.replace_with(|&mut n| n.max(points.len()));
        points.iter().map(|p| 0.3 - p.length()).collect()
    };
    let settings = ExtractSettings { max_points: 37, ..small() };
    let in_small_batches = extract_mesh(&field, &settings, &[]).unwrap();
    assert_eq!(*longest.borrow(), 37);
    let in_large_batches = extract_mesh(&field, &small(), &[]).unwrap();
    assert_eq!(in_small_batches.mesh, in_large_batches.mesh);
    assert_eq!(in_small_batches.evaluations, in_large_batches.evaluations);
}

#[test]
fn settings_that_make_no_sense_are_named() {
    let cases = [
        ("resolution", ExtractSettings { resolution: 0, ..small() }),
        ("resolution", ExtractSettings { resolution: 2049, ..small() }),
        ("upsampling_steps", ExtractSettings { upsampling_steps: 5, ..small() }),
        ("upsampling_steps", ExtractSettings { upsampling_steps: usize::MAX, ..small() }),
        ("cube.padding", ExtractSettings { cube: UnitCube { padding: -1.0 }, ..small() }),
        ("level", ExtractSettings { level: f32::NAN, ..small() }),
        ("min_component_share", ExtractSettings { min_component_share: 1.5, ..small() }),
        ("max_points", ExtractSettings { max_points: 0, ..small() }),
    ];
    for (expected, settings) in cases {
        let error = extract_mesh(&|points: &[Vec3]| vec![1.0; points.len()], &settings, &[]).unwrap_err();
        assert!(matches!(&error, ExtractError::Setting(wrong) if wrong.key == expected), "{error}");
    }
}

#[test]
fn one_batch_for_everything_is_fine() {
    let field = |points: &[Vec3]| -> Vec<f32> { points.iter().map(|p| 0.01 - p.distance(Vec3::splat(0.1))).collect() };
    let settings = ExtractSettings { max_points: usize::MAX, resolution: 64, ..small() };
    assert_eq!(extract_mesh(&field, &settings, &[]).unwrap().components, 1);
}
