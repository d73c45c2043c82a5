//! Of surfaces whose shape is known.

use super::*;
use crate::mesh::shapes;
use crate::metrics::Simplification;
use crate::observation::Observation;

/// Quality of each face: 1 where it is equilateral, 0 where it has no area (twice the ratio of the inner to the outer circle's
/// radius).
fn qualities(mesh: &Mesh) -> Vec<f32> {
    let of_face = |face| {
        let [a, b, c] = mesh.triangle(face);
        let [x, y, z] = [a.distance(b), b.distance(c), c.distance(a)];
        let half = (x + y + z) / 2.0;
        let area = normal([a, b, c]).length() / 2.0;
        8.0 * area * area / (half * x * y * z)
    };
    (0..mesh.faces.len()).map(of_face).collect()
}

/// Mean quality, and the share of faces below a half.
fn regularity(mesh: &Mesh) -> (f32, f32) {
    let qualities = qualities(mesh);
    let poor = qualities.iter().filter(|quality| **quality < 0.5).count();
    (qualities.iter().sum::<f32>() / qualities.len() as f32, poor as f32 / qualities.len() as f32)
}

/// Slivers and all: a torus whose faces are seven times as long as wide.
fn slivers() -> Mesh {
    shapes::torus(0.3, 0.1, 480, 24)
}

#[test]
fn triangles_are_near_equilateral_and_as_many_as_asked_for() {
    let before = slivers();
    assert!(regularity(&before).0 < 0.5);
    for faces in [1000, 4000, 16_000] {
        let found = before.remeshed(faces);
        let (mean, poor) = regularity(&found);
        assert!(mean > 0.93 && poor < 0.01, "{faces}: {mean}, {poor}");
        let ratio = found.faces.len() as f32 / faces as f32;
        assert!((0.85..1.15).contains(&ratio), "{faces}: {}", found.faces.len());
        assert_eq!(found.open_edges(), 0);
        assert_eq!(crate::mesh::Topology::of(&found).handles(), Some(1));
    }
}

#[test]
fn the_surface_stays_where_it_was() {
    let ball = shapes::icosphere(5, 0.4);
    let found = ball.remeshed(5000);
    let moved = Simplification::between(&ball, &found);
    // Flat triangles of this size leave a ball of this radius by as much.
    assert!(moved.max_distance < 1.5e-3 && moved.open_edges == 0, "{moved:?}");
    assert!(found.vertices.iter().all(|vertex| (vertex.length() - 0.4).abs() < 5e-4));
    assert_eq!(found, ball.remeshed(5000));
    let threads = |count| rayon::ThreadPoolBuilder::new().num_threads(count).build().unwrap();
    assert_eq!(threads(1).install(|| ball.remeshed(800)), threads(3).install(|| ball.remeshed(800)));
}

#[test]
fn sharp_edges_corners_and_borders_are_kept() {
    let cube = shapes::cuboid(Vec3::splat(-0.4), Vec3::splat(0.4));
    let found = cube.remeshed(3000);
    let moved = Simplification::between(&cube, &found);
    assert!(moved.max_distance < 1e-5 && moved.open_edges == 0, "{moved:?}");
    assert!(regularity(&found).0 > 0.85, "{:?}", regularity(&found));
    for corner in &cube.vertices {
        assert!(found.vertices.contains(corner), "{corner}");
    }
    // A square without a back.
    let square = Mesh {
        vertices: [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| Vec3::new(x, y, 0.0)).to_vec(),
        faces: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    for faces in [300, 500] {
        let found = square.remeshed(faces);
        let moved = Simplification::between(&square, &found);
        assert!(moved.max_distance < 1e-6, "{moved:?}");
        assert!(square.vertices.iter().all(|corner| found.vertices.contains(corner)), "{faces}");
        let ratio = found.faces.len() as f32 / faces as f32;
        assert!((0.7..1.3).contains(&ratio), "{faces}: {}", found.faces.len());
    }
}

#[test]
fn what_is_known_of_vertices_is_taken_from_the_nearest_place() {
    let mut ball = shapes::icosphere(4, 0.4);
    ball.normals = Some(ball.vertices.iter().map(|vertex| vertex.normalize()).collect());
    ball.colors = Some(ball.vertices.iter().map(|vertex| (*vertex + 0.5).to_array()).collect());
    let seen = |vertex: &Vec3| Observation { views: u16::from(vertex.z > 0.0), confidence: 0.5 };
    ball.observations = Some(ball.vertices.iter().map(seen).collect());
    let found = ball.remeshed(2000);
    let (normals, colors) = (found.normals.unwrap(), found.colors.unwrap());
    let observations = found.observations.unwrap();
    for (i, vertex) in found.vertices.iter().enumerate() {
        assert!(normals[i].dot(vertex.normalize()) > 0.999);
        assert!((Vec3::from(colors[i]) - 0.5).distance(*vertex) < 2e-3);
        assert!(vertex.z.abs() < 0.03 || observations[i].views == u16::from(vertex.z > 0.0));
    }
}

#[test]
fn meshes_without_area_are_returned_as_they_are() {
    let flat = Mesh { vertices: vec![Vec3::ZERO; 3], faces: vec![[0, 1, 2]], ..Mesh::default() };
    assert_eq!(flat.remeshed(100), flat);
    assert_eq!(Mesh::default().remeshed(100), Mesh::default());
    // Faces without area among others are nothing to stumble over.
    let mut ball = shapes::icosphere(3, 0.4);
    ball.faces.push([5, 5, 9]);
    ball.faces.push([7, 8, 7]);
    let found = ball.remeshed(1000);
    assert!(regularity(&found).0 > 0.9 && found.vertices.iter().all(|vertex| vertex.is_finite()));
    // Two boxes that touch in an edge, each closed.
    let touching = shapes::union([
        shapes::cuboid(Vec3::ZERO, Vec3::splat(0.3)),
        shapes::cuboid(Vec3::new(-0.3, -0.3, 0.0), Vec3::new(0.0, 0.0, 0.3)),
    ]);
    let found = touching.remeshed(1500);
    assert_eq!(found.open_edges(), 0);
    assert!(Simplification::between(&touching, &found).max_distance < 1e-5);
}
