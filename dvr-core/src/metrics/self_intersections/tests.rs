use glam::{DMat3, DVec3, Quat, Vec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::mesh::shapes::{cuboid, icosphere, torus, union};

fn count(mesh: &Mesh) -> usize {
    self_intersections(mesh, &Cancellation::default()).unwrap()
}

/// Whether a segment meets a triangle, by solving for the point and its barycentric coordinates: no sign of a determinant
/// in common with what is tested.
fn segment_meets(p: DVec3, q: DVec3, [a, b, c]: [DVec3; 3]) -> bool {
    let system = DMat3::from_cols(b - a, c - a, p - q);
    if system.determinant().abs() < 1e-12 {
        return false;
    }
    let DVec3 { x: beta, y: gamma, z: along } = system.inverse() * (p - a);
    beta >= 0.0 && gamma >= 0.0 && beta + gamma <= 1.0 && (0.0..=1.0).contains(&along)
}

fn meet_slowly(first: [DVec3; 3], second: [DVec3; 3]) -> bool {
    let edges = |t: [DVec3; 3]| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])];
    edges(first).iter().any(|&(p, q)| segment_meets(p, q, second))
        || edges(second).iter().any(|&(p, q)| segment_meets(p, q, first))
}

/// All pairs, one after the other.
fn count_slowly(mesh: &Mesh) -> usize {
    let corners = |face: usize| mesh.triangle(face).map(|corner| corner.as_dvec3());
    let pairs = (0..mesh.faces.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
    let are_apart = |&(a, b): &(usize, usize)| !mesh.triangle(a).iter().any(|corner| mesh.triangle(b).contains(corner));
    pairs.filter(are_apart).filter(|&(a, b)| meet_slowly(corners(a), corners(b))).count()
}

fn soup(seed: u64, faces: usize, size: f32) -> Mesh {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut point = || Vec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
    let mut mesh = Mesh::default();
    for face in 0..faces as u32 {
        let middle = point();
        mesh.vertices.extend([0; 3].map(|_| middle + size * point()));
        mesh.faces.push([3 * face, 3 * face + 1, 3 * face + 2]);
    }
    mesh
}

#[test]
fn triangles_at_random_meet_as_often_as_a_search_of_all_pairs_finds() {
    for (seed, faces, size) in [(1, 300, 0.5), (2, 600, 0.2), (3, 1500, 0.08), (4, 200, 2.0)] {
        let mesh = soup(seed, faces, size);
        let slow = count_slowly(&mesh);
        assert!(slow > 50, "{slow}");
        assert_eq!(count(&mesh), slow, "{seed}");
    }
}

#[test]
fn the_number_depends_neither_on_the_order_of_faces_and_corners_nor_on_threads() {
    let mesh = soup(5, 800, 0.2);
    let mut turned = mesh.clone();
    turned.faces.reverse();
    turned.faces.iter_mut().step_by(2).for_each(|face| face.rotate_left(1));
    turned.faces.iter_mut().step_by(3).for_each(|face| face.swap(0, 1));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!([count(&turned), pool.install(|| count(&mesh))], [count(&mesh); 2]);
}

#[test]
fn closed_surfaces_do_not_meet_themselves() {
    for mesh in [icosphere(4, 1.0), torus(1.0, 0.3, 40, 24), cuboid(Vec3::ZERO, Vec3::ONE), Mesh::default()] {
        assert_eq!(count(&mesh), 0);
    }
    // Doubled vertices, as along the seams of a texture: neighbours touch, and are neighbours all the same.
    let ball = icosphere(3, 1.0);
    let vertices = (0..ball.faces.len()).flat_map(|face| ball.triangle(face)).collect();
    let faces = (0..ball.faces.len() as u32).map(|face| [3 * face, 3 * face + 1, 3 * face + 2]).collect();
    assert_eq!(count(&Mesh { vertices, faces, ..Mesh::default() }), 0);
}

#[test]
fn cubes_that_cross_meet_along_the_faces_that_their_edges_go_through() {
    let cube = cuboid(Vec3::splat(-1.0), Vec3::splat(1.0));
    let turn = Quat::from_axis_angle(Vec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
    let moved = |by: Vec3| {
        let vertices = cube.vertices.iter().map(|&v| turn * v + by).collect();
        union([cube.clone(), Mesh { vertices, normals: None, ..cube.clone() }])
    };
    let crossing = moved(Vec3::new(1.1, 0.4, 0.3));
    let found = count(&crossing);
    assert!(found >= 6 && found == count_slowly(&crossing), "{found}");
    assert_eq!(count(&moved(Vec3::new(4.0, 0.0, 0.0))), 0);
    let small = cuboid(Vec3::splat(-0.4), Vec3::splat(0.4));
    assert_eq!(count(&union([cube.clone(), small])), 0, "one inside the other");
}

#[test]
fn touching_counts_where_no_corner_is_shared_and_so_does_lying_on_each_other() {
    let pair = |second: [[f32; 3]; 3]| {
        let first = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
        let vertices = first.into_iter().chain(second).map(Vec3::from).collect();
        count(&Mesh { vertices, faces: vec![[0, 1, 2], [3, 4, 5]], ..Mesh::default() })
    };
    let cases = [
        ("through it", [[1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [9.0, 9.0, 0.5]], 1),
        ("beside it", [[3.0, 3.0, -1.0], [3.0, 3.0, 1.0], [9.0, 9.0, 0.5]], 0),
        ("above it", [[1.0, 1.0, 0.1], [2.0, 1.0, 0.1], [1.0, 2.0, 0.3]], 0),
        ("a tip on it", [[1.0, 1.0, 0.0], [2.0, 1.0, 1.0], [1.0, 2.0, 1.0]], 1),
        ("an edge on it", [[1.0, 1.0, 0.0], [2.0, 1.0, 0.0], [1.0, 2.0, 1.0]], 1),
        ("an edge across its rim", [[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 2.0, 1.0]], 1),
        ("an edge across all of it", [[-1.0, 1.0, 0.0], [9.0, 1.0, 0.0], [0.0, 2.0, 1.0]], 1),
        ("a tip in its plane, beside it", [[5.0, 1.0, 0.0], [6.0, 1.0, 1.0], [5.0, 2.0, 1.0]], 0),
        ("an edge in its plane, beside it", [[3.0, 2.0, 0.0], [9.0, 1.0, 0.0], [5.0, 2.0, 1.0]], 0),
        ("inside it, flat", [[1.0, 1.0, 0.0], [1.5, 1.0, 0.0], [1.0, 1.5, 0.0]], 1),
        ("around it, flat", [[-1.0, -1.0, 0.0], [20.0, -1.0, 0.0], [-1.0, 20.0, 0.0]], 1),
        ("across it, flat", [[-1.0, 1.0, 0.0], [5.0, 1.0, 0.0], [-1.0, 1.5, 0.0]], 1),
        ("beside it, flat", [[3.0, 3.0, 0.0], [5.0, 3.0, 0.0], [3.0, 5.0, 0.0]], 0),
        ("a corner in common", [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.0, 1.0, -1.0]], 0),
        ("without area", [[1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 3.0]], 0),
        ("nowhere", [[1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [f32::NAN, 1.0, 3.0]], 0),
    ];
    for (name, second, expected) in cases {
        assert_eq!(pair(second), expected, "{name}");
        let [a, b, c] = second;
        assert_eq!(pair([c, b, a]), expected, "{name}, turned around");
    }
}

#[test]
fn work_that_is_ended_says_so() {
    let ended = Cancellation::default();
    ended.cancel();
    assert_eq!(self_intersections(&icosphere(1, 1.0), &ended), Err(Cancelled));
}
