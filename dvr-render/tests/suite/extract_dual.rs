//! Dual contouring: sharp where the shape is, and as closed as marching cubes.

use std::f64::consts::PI;

use crate::support::shapes::{extract, field, gyroid, settings, sphere, tilted_plate, torus};
use crate::support::topology::{assert_watertight, euler_characteristic, volume};
use dvr_core::mesh::Mesh;
use dvr_core::{Bvh, Ray};
use dvr_render::extract::{Contour, ExtractSettings, Extraction, NormalSource, count_components, extract_mesh};
use glam::{DVec3, Mat3, Vec3};

fn dual(resolution: usize, upsampling_steps: usize) -> ExtractSettings {
    ExtractSettings { contour: Contour::Dual, ..settings(resolution, upsampling_steps) }
}

/// Half the edges of a box.
const BOX: Vec3 = Vec3::new(0.31, 0.22, 0.26);

/// A turn out of the grid's axes, from object space to the box's own axes.
fn turn(angle: f32) -> Mat3 {
    Mat3::from_euler(glam::EulerRot::XYZ, angle, 0.8 * angle, 0.6 * angle)
}

fn turned_box(turn: Mat3) -> impl Fn(Vec3) -> f32 + Copy {
    move |p| -((turn * p).abs() - BOX).max_element()
}

/// How far the mesh stays away from points of the box along the way in, on average: `[corners, edges, faces]`.
fn distances(mesh: &Mesh, turn: Mat3) -> [f64; 3] {
    let bvh = Bvh::new(mesh);
    let mut sums = [(0.0, 0); 3];
    // Each coordinate at either end or within: 8 corners, points of the 12 edges, points of the 6 faces.
    let places = [-1.0, -0.77, -0.41, -0.05, 0.26, 0.58, 0.83, 1.0];
    for [x, y, z] in (0..512).map(|i| [i % 8, i / 8 % 8, i / 64].map(|i: usize| places[i])) {
        let place = Vec3::new(x, y, z);
        let outward = place.trunc();
        let free = outward.to_array().iter().filter(|&&c| c == 0.0).count();
        if free < 3 {
            let to_object = |v: Vec3| (turn.transpose() * v).as_dvec3();
            let (point, outward) = (to_object(place * BOX), to_object(outward.normalize()));
            let ray = Ray { origin: point + 0.1 * outward, direction: -outward };
            let hit = bvh.closest_hit(&ray, 0.0, f64::INFINITY).expect("the way in leads through the surface");
            sums[free].0 += (hit.ray_depth - 0.1).abs();
            sums[free].1 += 1;
        }
    }
    sums.map(|(sum, count)| sum / f64::from(count))
}

#[test]
fn corners_and_edges_of_a_turned_box_are_kept() {
    for (angle, resolution) in [(0.2, 24), (0.5, 24), (0.9, 32), (0.4, 48)] {
        let logit = turned_box(turn(angle));
        let in_cells = |settings: &ExtractSettings| {
            distances(&extract(logit, settings).mesh, turn(angle)).map(|d| d * resolution as f64 / 1.1)
        };
        let [cubes, sharp] = [settings(resolution, 1), dual(resolution, 1)].map(|settings| in_cells(&settings));
        println!("{angle} rad, {resolution}^3, off in cells at corners, edges, faces: {cubes:.4?}, dual {sharp:.4?}");
        assert!(cubes[0] > 2.5 * sharp[0] && cubes[1] > 8.0 * sharp[1] && sharp[2] < 0.01);
    }
}

#[test]
fn a_box_along_the_axes_is_exact() {
    let (low, high) = (DVec3::new(-0.31, -0.21, -0.4), DVec3::new(0.27, 0.34, 0.12));
    let logit = |p: Vec3| (p - low.as_vec3()).min(high.as_vec3() - p).min_element();
    let mesh = extract(logit, &dual(40, 1)).mesh;
    assert!((volume(&mesh) / (high - low).element_product() - 1.0).abs() < 1e-4);
    let (found_low, found_high) = mesh.bounds().unwrap();
    assert!(found_low.as_dvec3().distance(low) < 1e-4 && found_high.as_dvec3().distance(high) < 1e-4);
}

#[test]
fn smooth_shapes_have_their_euler_characteristic_and_their_volume() {
    let ball = sphere(Vec3::new(0.03, -0.02, 0.01), 0.37);
    let shapes: [(&dyn Fn(Vec3) -> f32, _, _); 2] =
        [(&ball, 2, 4.0 / 3.0 * PI * 0.37f64.powi(3)), (&torus, 0, 2.0 * PI * PI * 0.3 * 0.01)];
    for (shape, euler, true_volume) in shapes {
        let errors = [32, 64].map(|resolution| {
            let mesh = extract(shape, &dual(resolution, 1)).mesh;
            assert_eq!(euler_characteristic(&mesh), euler);
            (volume(&mesh) / true_volume - 1.0).abs()
        });
        println!("relative errors of the volume: {errors:?}");
        assert!(errors[1] < 0.4 * errors[0] && errors[1] < 0.005);
    }
}

#[test]
fn two_balls_that_touch_are_two_closed_surfaces_or_one_but_never_pinched() {
    // They touch at a node, within a cell, or overlap by less than a cell.
    for center in [0.0, 0.004, 0.013] {
        for overlap in [0.0, 1e-4, 0.01, 0.03] {
            let touch = Vec3::new(center, 0.0, center);
            let apart = Vec3::new(1.0, 0.7, 0.3).normalize() * (0.2 - 0.5 * overlap);
            let logit = |p| sphere(touch - apart, 0.2)(p).max(sphere(touch + apart, 0.2)(p));
            let mesh = extract(logit, &dual(44, 1)).mesh;
            let components = count_components(&mesh) as i64;
            assert!(
                (1..=2).contains(&components) && euler_characteristic(&mesh) == 2 * components,
                "{center} {overlap}"
            );
        }
    }
}

#[test]
fn two_nodes_across_a_face_do_not_hang_together_by_a_doubled_side() {
    // Both cells that share the face join the two nodes: if it were not parted, one side would have four
    // quadrilaterals.
    let cell = 1.1 / 8.0;
    for across in [Vec3::new(1.0, 1.0, 0.0), Vec3::new(0.0, -1.0, 1.0), Vec3::new(1.0, 0.0, 1.0)] {
        let two = |p: Vec3| 0.4 * cell - p.length().min(p.distance(cell * across));
        let extraction = extract(two, &ExtractSettings { refinement_steps: 0, ..dual(8, 0) });
        assert_eq!((extraction.components, euler_characteristic(&extraction.mesh)), (2, 4));
    }
}

#[test]
fn a_refined_grid_gives_the_mesh_of_a_dense_one() {
    let shapes: [(&str, &dyn Fn(Vec3) -> f32); 3] =
        [("torus", &torus), ("gyroid", &gyroid), ("plate", &tilted_plate(0.02))];
    for (name, shape) in shapes {
        let [dense, refined] = [0, 3].map(|steps| extract(shape, &dual(80, steps)));
        assert_eq!(refined.mesh, dense.mesh, "{name}");
        assert!(refined.evaluations.grid < dense.evaluations.grid);
    }
}

#[test]
fn normals_are_those_of_the_faces_away_from_creases() {
    let turn = turn(0.5);
    let Extraction { mesh, evaluations, .. } = extract(turned_box(turn), &dual(32, 1));
    for (vertex, normal) in mesh.vertices.iter().zip(mesh.normals.unwrap()) {
        let (vertex, normal) = (turn * *vertex, turn * normal);
        assert!((normal.length() - 1.0).abs() < 1e-5);
        let depth = BOX - vertex.abs();
        let creased = depth.to_array().iter().filter(|&&d| d < 0.05).count() > 1;
        assert!(creased || normal[depth.min_position()].abs() > 0.999, "{normal} at {vertex}");
        assert!(normal.dot(vertex) > 0.0);
    }
    assert!(evaluations.normals > 4 * mesh.vertices.len(), "six differences a crossing");
    let of_faces = extract(turned_box(turn), &ExtractSettings { normals: NormalSource::Faces, ..dual(32, 1) });
    assert_eq!(of_faces.mesh.vertices, mesh.vertices);
}

/// How many edges of a mesh pass through one of its faces.
fn piercing_edges(mesh: &Mesh) -> usize {
    let bvh = Bvh::new(mesh);
    let edges = mesh.faces.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).filter(|[a, b]| a < b);
    let rays = edges.map(|ends| ends.map(|vertex| mesh.vertices[vertex as usize].as_dvec3()));
    rays.filter(|&[a, b]| bvh.any_hit(&Ray { origin: a, direction: b - a }, 1e-3, 1.0 - 1e-3)).count()
}

#[test]
fn shapes_that_the_grid_resolves_do_not_intersect_themselves() {
    let turned = turned_box(turn(0.5));
    let shapes: [(&str, &dyn Fn(Vec3) -> f32); 4] =
        [("box", &turned), ("torus", &torus), ("gyroid", &gyroid), ("plate", &tilted_plate(0.05))];
    for (name, shape) in shapes {
        assert_eq!(piercing_edges(&extract(shape, &dual(48, 1)).mesh), 0, "{name}");
    }
}

#[test]
fn floaters_are_dropped_on_request_and_the_rest_stays_closed() {
    let shape = |p| sphere(Vec3::new(-0.2, 0.0, 0.0), 0.2)(p).max(sphere(Vec3::new(0.3, 0.3, 0.3), 0.05)(p));
    let settings = ExtractSettings { min_component_share: 0.1, ..dual(64, 1) };
    let clean = extract_mesh(&field(shape), &settings, &[]).unwrap();
    assert_watertight(&clean.mesh);
    assert_eq!((clean.components, clean.dropped_components, count_components(&clean.mesh)), (1, 1, 1));
    assert_eq!(clean.mesh.normals.unwrap().len(), clean.mesh.vertices.len());
}
