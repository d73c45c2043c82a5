use std::collections::HashMap;

use super::super::{Topology, shapes};
use super::*;
use crate::bvh::Bvh;
use glam::Vec3;

/// The farthest that a vertex of `of` that a face uses lies from the other's surface.
fn farthest(of: &Mesh, from: &Mesh) -> f64 {
    let surface = Bvh::new(from);
    let used = of.faces.iter().flatten().map(|&i| of.vertices[i as usize].as_dvec3());
    used.map(|place| surface.nearest(place).unwrap().distance).fold(0.0, f64::max)
}

/// Each face cut into four, again and again; vertices are shared as they were.
fn subdivided(mesh: &Mesh, times: usize) -> Mesh {
    let mut mesh = Mesh { normals: None, ..mesh.clone() };
    for _ in 0..times {
        let mut middles = HashMap::new();
        for [a, b, c] in std::mem::take(&mut mesh.faces) {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)]
                .map(|(a, b)| *middles.entry((a.min(b), a.max(b))).or_insert_with(|| mesh.push_middle(a, b)));
            mesh.faces.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
    }
    mesh
}

/// A square of so many cells, twice as many faces, in the plane z = 0.
fn plane(cells: u32) -> Mesh {
    let row = cells + 1;
    let vertices = (0..row * row).map(|i| Vec3::new((i % row) as f32, (i / row) as f32, 0.0) / cells as f32).collect();
    let corner = |i: u32| i / cells * row + i % cells;
    let faces = (0..cells * cells).map(corner).flat_map(|i| [[i, i + 1, i + row + 1], [i, i + row + 1, i + row]]);
    Mesh { vertices, faces: faces.collect(), ..Mesh::default() }
}

#[test]
fn a_fine_ball_loses_triangles_and_stays_a_closed_ball() {
    let mut ball = shapes::icosphere(5, 0.4);
    ball.colors = Some(vec![[0.2, 0.4, 0.6]; ball.vertices.len()]);
    let simple = ball.simplified(2e-3);
    assert!(simple.faces.len() * 5 < ball.faces.len(), "{} of {}", simple.faces.len(), ball.faces.len());
    assert_eq!(simple.colors.as_ref().unwrap().len(), simple.vertices.len());
    for face in 0..simple.faces.len() {
        // Middles of faces lie below the sphere, by no more than the error allows.
        let [a, b, c] = simple.triangle(face);
        assert!(((a + b + c) / 3.0).length() > 0.4 - 2.5 * 2e-3);
    }
    assert_eq!(Topology::of(&simple).handles(), Some(0), "closed");
}

#[test]
fn a_budget_of_faces_is_kept_and_faces_look_outward() {
    let ball = shapes::icosphere(5, 0.4);
    for most in [10_000, 1000, 200, 20] {
        let simple = ball.within_faces(most);
        assert!(simple.faces.len() <= most && 10 * simple.faces.len() > 8 * most, "{} of {most}", simple.faces.len());
        assert_eq!(Topology::of(&simple).handles(), Some(0), "{most}");
        for face in 0..simple.faces.len() {
            let [a, b, c] = simple.triangle(face);
            assert!((b - a).cross(c - a).dot(a + b + c) > 0.0, "{most}: face {face} looks inward");
        }
    }
    let torus = shapes::torus(1.0, 0.3, 64, 48).within_faces(300);
    assert_eq!((Topology::of(&torus).handles(), torus.faces.len() <= 300), (Some(1), true));
}

#[test]
fn a_closed_surface_stays_closed_however_few_faces_are_asked_for() {
    let (wire, plates) =
        (subdivided(&shapes::wire_cube(1.0, 0.05), 3), subdivided(&shapes::crossed_plates(1.0, 0.02), 3));
    let pieces = shapes::union((0..5).map(|i| {
        let mut ball = shapes::icosphere(3, 0.1);
        ball.vertices.iter_mut().for_each(|v| v.x += i as f32);
        ball
    }));
    for (name, mesh) in
        [("wire", wire), ("plates", plates), ("pieces", pieces), ("torus", shapes::torus(1.0, 0.05, 200, 9))]
    {
        assert_eq!(mesh.open_edges(), 0, "{name}");
        for most in [4, 5, 7, 12, 30, 61, 100, 300, 1000] {
            let simple = mesh.within_faces(most);
            assert!(!simple.is_empty() && simple.open_edges() == 0, "{name}, {most}");
        }
    }
}

#[test]
fn sharp_edges_keep_their_place() {
    let cube = shapes::cuboid(Vec3::splat(-0.3), Vec3::splat(0.3));
    let simple = subdivided(&cube, 5).within_faces(12);
    assert_eq!((simple.faces.len(), simple.vertices.len()), (12, 8), "twelve faces are enough for a cube");
    assert!(farthest(&cube, &simple) < 1e-6);
    let wire = shapes::wire_cube(1.0, 0.05);
    let fine = subdivided(&wire, 3);
    let simple = fine.within_faces(fine.faces.len() / 16);
    assert!(farthest(&wire, &simple) < 1e-5 && farthest(&simple, &wire) < 1e-5, "{}", farthest(&wire, &simple));
}

#[test]
fn a_flat_plane_needs_next_to_no_faces_and_keeps_its_border() {
    let fine = plane(40);
    let simple = fine.within_faces(10);
    assert!(simple.faces.len() <= 10);
    assert!(farthest(&fine, &simple) < 1e-6, "the corners are there: nothing is farther than before");
    assert!(simple.vertices.iter().all(|v| v.z == 0.0));
}

#[test]
fn the_border_of_an_open_surface_stays_about_where_it_was() {
    let mut bowl = shapes::icosphere(5, 0.4);
    let faces = std::mem::take(&mut bowl.faces);
    bowl.faces = faces.into_iter().filter(|face| face.iter().all(|&i| bowl.vertices[i as usize].z <= 0.1)).collect();
    let simple = bowl.within_faces(400);
    assert!(simple.faces.len() <= 400 && farthest(&bowl, &simple) < 0.015, "{}", farthest(&bowl, &simple));
    let topology = Topology::of(&simple);
    assert_eq!((topology.components, topology.euler_characteristic), (1, 1), "a disk");
}

#[test]
fn a_mesh_within_the_budget_stays_as_it_is() {
    let mut ball = shapes::icosphere(2, 0.4);
    ball.faces.pop();
    assert_eq!(ball.within_faces(ball.faces.len()), ball);
    assert_eq!(ball.within_faces(usize::MAX), ball);
    assert_eq!(Mesh::default().within_faces(4), Mesh::default());
    assert!(Mesh::default().simplified(1.0).is_empty(), "nothing to simplify is no error");
}

#[test]
fn the_same_faces_are_left_each_time() {
    let torus = shapes::torus(1.0, 0.3, 80, 60);
    assert_eq!(torus.within_faces(700), torus.within_faces(700));
}

#[test]
fn seams_of_texture_coordinates_are_no_borders() {
    let ball = shapes::icosphere(4, 0.4);
    // Each half has its own vertices.
    let half = |up: bool| {
        let faces = ball.faces.iter().copied().filter(|face| {
            let height: f32 = face.iter().map(|&i| ball.vertices[i as usize].z).sum();
            (height > 0.0) == up
        });
        Mesh { faces: faces.collect(), ..ball.clone() }
    };
    let split = shapes::union([half(true), half(false)]);
    assert!(split.open_edges() > 0);
    assert_eq!(split.within_faces(300).open_edges(), 0);
}

#[test]
fn what_is_no_manifold_is_simplified_all_the_same() {
    // A fin on a ball, faces twice, a face without area, and a vertex that is not finite.
    let mut odd = shapes::icosphere(4, 0.4);
    odd.normals = None;
    let count = odd.vertices.len() as u32;
    odd.vertices.extend([Vec3::splat(0.9), Vec3::NAN]);
    let [a, b, _] = odd.faces[0];
    let again = odd.faces[7];
    odd.faces.extend([[a, b, count], again, [a, a, b]]);
    let simple = odd.within_faces(500);
    assert!(!simple.is_empty() && simple.faces.len() <= 500);
    odd.faces.push([a, b, count + 1]);
    assert!(odd.within_faces(500).faces.len() <= odd.faces.len());
}
