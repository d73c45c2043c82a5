//! Extraction of shapes whose topology, volume and area are known.

use std::f64::consts::PI;

use crate::support::shapes::{extract, field, gyroid, noise, settings, sphere, tilted_plate, torus};
use crate::support::topology::{area, assert_watertight, euler_characteristic, volume};
use dvr_core::UnitCube;
use dvr_render::extract::{
    Contour, ExtractSettings, ExtractWarning, NormalSource, ScalarField, count_components, extract_mesh,
};
use dvr_test_support::largest;
use glam::Vec3;

#[test]
fn a_sphere_and_a_torus_have_their_euler_characteristic() {
    let ball = extract(sphere(Vec3::new(0.03, -0.02, 0.01), 0.37), &settings(64, 2));
    assert_eq!((euler_characteristic(&ball.mesh), ball.components), (2, 1));
    assert_eq!(euler_characteristic(&extract(torus, &settings(64, 2)).mesh), 0);
}

#[test]
fn volume_and_area_converge_with_the_square_of_the_cell() {
    let radius = 0.37f64;
    let ball = sphere(Vec3::new(0.03, -0.02, 0.01), radius as f32);
    let shapes: [(&dyn Fn(Vec3) -> f32, _); 2] = [
        (&ball, [4.0 / 3.0 * PI * radius.powi(3), 4.0 * PI * radius * radius]),
        (&torus, [2.0 * PI * PI * 0.3 * 0.01, 4.0 * PI * PI * 0.3 * 0.1]),
    ];
    for (shape, [true_volume, true_area]) in shapes {
        let errors = |resolution: usize| {
            let mesh = extract(shape, &settings(resolution, 1)).mesh;
            [true_volume - volume(&mesh), true_area - area(&mesh)]
        };
        let (coarse, fine) = (errors(32), errors(64));
        for (coarse, fine) in coarse.into_iter().zip(fine) {
            assert!((3.3..5.0).contains(&(coarse / fine)), "{coarse} -> {fine}");
        }
        assert!(fine[0].abs() < 0.01 * true_volume && fine[1].abs() < 0.01 * true_area);
    }
}

#[test]
fn a_box_keeps_its_volume() {
    let (low, high) = (Vec3::new(-0.31, -0.22, -0.4), Vec3::new(0.27, 0.33, 0.12));
    let mesh = extract(|p| (p - low).min(high - p).min_element(), &settings(128, 2)).mesh;
    let true_volume = f64::from((high - low).element_product());
    assert!((volume(&mesh) / true_volume - 1.0).abs() < 2e-3);
    assert_eq!(euler_characteristic(&mesh), 2);
}

#[test]
fn refining_gives_the_mesh_that_a_dense_grid_gives() {
    let two = |p| sphere(Vec3::splat(-0.25), 0.15)(p).max(sphere(Vec3::new(0.3, 0.2, 0.3), 0.12)(p));
    let shapes: [(&str, &dyn Fn(Vec3) -> f32); 4] =
        [("two spheres", &two), ("torus", &torus), ("gyroid", &gyroid), ("plate", &tilted_plate(0.02))];
    for (name, shape) in shapes {
        let dense = extract(shape, &settings(80, 0));
        let refined = extract(shape, &settings(80, 3));
        assert_eq!(refined.mesh, dense.mesh, "{name}");
        let (few, all) = (refined.evaluations.grid, dense.evaluations.grid);
        println!("{name}: {few} of {all} nodes evaluated, {} vertices", dense.mesh.vertices.len());
        assert_eq!(all, 81 * 81 * 81);
        assert!(few < all);
    }
}

#[test]
fn the_cost_follows_the_surface() {
    let ball = sphere(Vec3::new(0.03, -0.02, 0.01), 0.37);
    let cost = |resolution, steps| extract(ball, &settings(resolution, steps)).evaluations.grid;
    let (small, large) = (cost(64, 1), cost(128, 2));
    println!("64^3: {small} evaluations, 128^3: {large}");
    assert!(large < 129 * 129 * 129 / 10);
    assert!(large - small < 5 * 64 * 64 * 4, "the last level costs a few evaluations per cell on the surface");
}

#[test]
fn a_plate_thinner_than_the_coarse_cells_is_followed_to_its_rim() {
    let thickness = 0.012;
    let extraction = extract(tilted_plate(thickness), &settings(192, 3));
    let true_volume = 0.7 * 0.6 * f64::from(thickness);
    assert_eq!((extraction.components, euler_characteristic(&extraction.mesh)), (1, 2));
    assert!((volume(&extraction.mesh) / true_volume - 1.0).abs() < 0.03);
}

#[test]
fn what_the_coarse_grid_misses_altogether_is_found_by_finer_search() {
    // Between two nodes of the 16^3 grid, whose cells measure 0.069.
    let extraction = extract(sphere(Vec3::splat(0.5 * 1.1 / 16.0), 0.02), &settings(128, 3));
    assert_eq!((extraction.components, euler_characteristic(&extraction.mesh)), (1, 2));
    assert_eq!(extraction.warnings, [ExtractWarning::TooCoarse { resolution: 32 }]);
}

#[test]
fn a_cavity_that_the_coarse_grid_misses_is_found_with_the_shell_around_it() {
    let extraction = extract(|p| p.distance(Vec3::splat(0.034)) - 0.02, &settings(128, 3));
    assert_eq!((extraction.components, euler_characteristic(&extraction.mesh)), (2, 4));
    assert!((volume(&extraction.mesh) - 1.1f64.powi(3)).abs() < 1e-3);
}

#[test]
fn seeds_lead_to_a_small_part_beside_a_large_one() {
    let (center, radius) = (Vec3::new(0.45, 0.45, 0.03), 0.012);
    let shape = |p| sphere(Vec3::new(-0.1, 0.0, 0.0), 0.3)(p).max(sphere(center, radius)(p));
    let without = extract(shape, &settings(128, 3));
    assert_eq!(without.components, 1, "the small sphere lies between the coarse nodes");
    let nearby = center + Vec3::new(0.0, 0.0, radius + 0.002);
    let seeds = [nearby, Vec3::splat(f32::NAN), Vec3::splat(7.0)];
    let with = extract_mesh(&field(shape), &settings(128, 3), &seeds).unwrap();
    assert_watertight(&with.mesh);
    assert_eq!((with.components, with.mesh.clone()), (2, extract(shape, &settings(128, 0)).mesh));
    assert!(with.evaluations.grid < without.evaluations.grid + 2000);
}

#[test]
fn seeds_alone_lead_to_a_part_that_no_coarse_node_sees() {
    let center = Vec3::splat(0.5 * 1.1 / 16.0);
    let seed = center + Vec3::X * 0.02;
    let extraction = extract_mesh(&field(sphere(center, 0.02)), &settings(128, 3), &[seed]).unwrap();
    assert_eq!((extraction.components, extraction.warnings), (1, vec![]));
    assert!(extraction.evaluations.grid < 12_000, "no search");
}

#[test]
fn a_surface_cut_by_the_cube_is_closed_at_its_border() {
    let ball = sphere(Vec3::new(0.5, 0.0, 0.0), 0.3);
    for (steps, contour) in [(0, Contour::MarchingCubes), (2, Contour::MarchingCubes), (2, Contour::Dual)] {
        let extraction = extract(ball, &ExtractSettings { contour, ..settings(64, steps) });
        assert!(matches!(extraction.warnings[..], [ExtractWarning::CutByCube { vertices }] if vertices > 100));
        let (low, high) = extraction.mesh.bounds().unwrap();
        assert!((high.x - 0.55).abs() < 1e-4 && (low.x - 0.2).abs() < 1e-2);
    }
    let open = ExtractSettings { cube: UnitCube { padding: 0.8 }, ..settings(64, 2) };
    assert_eq!(extract(ball, &open).warnings, []);
}

#[test]
fn any_signs_whatever_give_a_closed_manifold() {
    for contour in [Contour::MarchingCubes, Contour::Dual] {
        for (seed, share) in [(0, 0.4), (1, 0.4), (2, 0.0), (3, 0.0), (4, 0.1), (5, 0.7), (6, 0.9), (7, 0.25)] {
            let normals = if seed % 2 == 0 { NormalSource::Faces } else { NormalSource::Field };
            let settings = ExtractSettings { contour, refinement_steps: 0, normals, ..settings(14, 0) };
            let mesh = extract(noise(seed, 14.0, share), &settings).mesh;
            assert!(mesh.faces.len() > 2000 && volume(&mesh) > 0.0);
        }
    }
}

#[test]
fn refinement_puts_vertices_on_a_surface_whose_logit_is_sharp_and_bent() {
    let sharp = |p: Vec3| (150.0 * (0.37 - p.length())).exp() - 1.0;
    let error = |refinement_steps| {
        let extraction = extract(sharp, &ExtractSettings { refinement_steps, ..settings(32, 1) });
        let worst = largest(extraction.mesh.vertices.iter().map(|v| (v.length() - 0.37).abs()));
        println!("{refinement_steps} steps: {worst:.1e}, {} evaluations", extraction.evaluations.refinement);
        worst
    };
    assert!(error(0) > 0.4 * 1.1 / 32.0);
    assert!(error(2) < 0.1 * 1.1 / 32.0);
    assert!(error(8) < 1e-3 * 1.1 / 32.0);
}

#[test]
fn refinement_stops_where_the_field_is_straight() {
    let extraction = extract(|p| 0.1 - p.x, &ExtractSettings { refinement_steps: 9, ..settings(16, 0) });
    let interior = 17 * 17;
    assert_eq!(extraction.evaluations.refinement, interior, "one look each, none at the border");
}

#[test]
fn normals_point_outwards_from_gradients_differences_or_faces() {
    struct Ball;
    impl ScalarField for Ball {
        fn logits(&self, points: &[Vec3]) -> Vec<f32> {
            points.iter().map(|p| 3.0 * (0.1 - p.length_squared())).collect()
        }
        fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
            Some(points.iter().map(|&p| -6.0 * p).collect())
        }
    }
    let closure = |points: &[Vec3]| Ball.logits(points);
    let from_faces = ExtractSettings { normals: NormalSource::Faces, ..settings(64, 2) };
    let by_gradient = extract_mesh(&Ball, &settings(64, 2), &[]).unwrap();
    let by_difference = extract_mesh(&closure, &settings(64, 2), &[]).unwrap();
    let by_faces = extract_mesh(&Ball, &from_faces, &[]).unwrap();
    let vertices = by_gradient.mesh.vertices.len();
    assert_eq!([&by_gradient, &by_difference, &by_faces].map(|e| e.evaluations.normals), [vertices, 6 * vertices, 0]);
    for (extraction, tolerance) in [(by_gradient, 1e-5), (by_difference, 1e-3), (by_faces, 0.15)] {
        for (vertex, normal) in extraction.mesh.vertices.iter().zip(extraction.mesh.normals.unwrap()) {
            assert!(normal.distance(vertex.normalize()) < tolerance);
            assert!((normal.length() - 1.0).abs() < 1e-5);
        }
    }
}

#[test]
fn colors_come_from_the_field_at_the_vertices() {
    struct Painted;
    impl ScalarField for Painted {
        fn logits(&self, points: &[Vec3]) -> Vec<f32> {
            points.iter().map(|p| 0.3 - p.length()).collect()
        }
        fn colors(&self, points: &[Vec3], normals: &[Vec3], _: Option<&[Vec3]>) -> Option<Vec<[f32; 3]>> {
            Some(points.iter().zip(normals).map(|(p, n)| [p.x + 0.5, 0.5 + 0.5 * n.y, 7.0]).collect())
        }
    }
    let mesh = extract_mesh(&Painted, &ExtractSettings { max_points: 100, ..settings(32, 1) }, &[]).unwrap().mesh;
    let colors = mesh.colors.unwrap();
    assert_eq!(colors.len(), mesh.vertices.len());
    for ((vertex, normal), color) in mesh.vertices.iter().zip(mesh.normals.unwrap()).zip(colors) {
        assert_eq!(color, [vertex.x + 0.5, 0.5 + 0.5 * normal.y, 1.0], "clamped to [0, 1]");
    }
}

#[test]
fn floaters_are_dropped_on_request_and_the_rest_stays_closed() {
    let shape = |p| sphere(Vec3::new(-0.2, 0.0, 0.0), 0.2)(p).max(sphere(Vec3::new(0.3, 0.3, 0.3), 0.05)(p));
    let all = extract(shape, &settings(64, 1));
    assert_eq!((all.components, all.dropped_components, count_components(&all.mesh)), (2, 0, 2));
    let clean = extract(shape, &ExtractSettings { min_component_share: 0.1, ..settings(64, 1) });
    assert_eq!((clean.components, clean.dropped_components, count_components(&clean.mesh)), (1, 1, 1));
    assert!(clean.mesh.bounds().unwrap().1.x < 0.05);
}

#[test]
fn the_level_moves_the_surface() {
    let mesh = extract(sphere(Vec3::ZERO, 0.3), &ExtractSettings { level: 0.1, ..settings(32, 1) }).mesh;
    assert!(mesh.vertices.iter().all(|v| (v.length() - 0.2).abs() < 1e-4));
}

#[test]
fn a_resolution_that_does_not_halve_evenly_is_rounded_up() {
    assert_eq!(extract(sphere(Vec3::ZERO, 0.3), &settings(50, 2)).resolution, 52);
}
