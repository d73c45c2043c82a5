use glam::{DVec3, Vec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::nearest::nearest_on_triangle;
use super::triangle::Shear;
use super::*;
use crate::mesh::{Mesh, shapes};
use crate::ray::Ray;

fn random_vector(rng: &mut ChaCha8Rng) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)))
}

/// Every triangle, one after the other.
fn closest_by_search(mesh: &Mesh, ray: &Ray) -> Option<RayHit> {
    let shear = Shear::new(ray)?;
    let hits = (0..mesh.faces.len()).filter_map(|f| shear.intersect(&mesh.triangle(f), f as u32));
    hits.filter(|h| h.ray_depth >= 0.0).min_by(|a, b| a.ray_depth.total_cmp(&b.ray_depth).then(a.face.cmp(&b.face)))
}

#[test]
fn the_tree_finds_what_a_search_of_all_triangles_finds() {
    let mesh = shapes::torus(0.6, 0.25, 40, 20);
    let bvh = Bvh::new(&mesh);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut hits = 0;
    for _ in 0..2000 {
        let ray = Ray { origin: random_vector(&mut rng), direction: random_vector(&mut rng) };
        let hit = bvh.closest_hit(&ray, 0.0, f64::INFINITY);
        assert_eq!(hit, closest_by_search(&mesh, &ray));
        assert_eq!(bvh.any_hit(&ray, 0.0, f64::INFINITY), hit.is_some());
        hits += usize::from(hit.is_some());
    }
    assert!(hits > 300, "{hits}");
}

#[test]
fn the_parts_of_a_tree_that_threads_build_apart_are_one_tree() {
    // More faces than one thread builds.
    let mesh = shapes::icosphere(6, 0.5);
    let bvh = Bvh::new(&mesh);
    let mut is_in_leaf = vec![false; mesh.faces.len()];
    let mut nodes = 1;
    let mut left = vec![0];
    while let Some(node) = left.pop() {
        let node = bvh.nodes[node];
        let places = node.first() as usize..(node.first() + node.count()) as usize;
        if places.is_empty() {
            left.extend([node.first() as usize, node.first() as usize + 1]);
            nodes += 2;
        }
        for place in places {
            let corners = bvh.triangles[place];
            assert!(corners.iter().all(|corner| corner.cmpge(node.low()).all() && corner.cmple(node.high()).all()));
            assert_eq!(corners, mesh.triangle(bvh.faces[place] as usize));
            assert!(!std::mem::replace(&mut is_in_leaf[bvh.faces[place] as usize], true), "a face twice");
        }
    }
    assert!(is_in_leaf.into_iter().all(|is_in_leaf| is_in_leaf) && nodes == bvh.nodes.len());
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    for _ in 0..30 {
        let ray = Ray { origin: 2.0 * random_vector(&mut rng).normalize(), direction: random_vector(&mut rng) };
        assert_eq!(bvh.closest_hit(&ray, 0.0, f64::INFINITY), closest_by_search(&mesh, &ray));
    }
}

#[test]
fn the_hit_lies_on_the_triangle_and_on_the_ray() {
    let mesh = shapes::icosphere(3, 0.5);
    let bvh = Bvh::new(&mesh);
    let ray = Ray { origin: DVec3::new(0.1, 0.2, -2.0), direction: DVec3::new(0.0, 0.0, 0.5) };
    let hit = bvh.closest_hit(&ray, 0.0, f64::INFINITY).unwrap();
    let corners = mesh.triangle(hit.face as usize);
    let point: DVec3 = corners.iter().zip(hit.barycentric).map(|(c, w)| c.as_dvec3() * w).sum();
    assert!((point - ray.at(hit.ray_depth)).length() < 1e-12 && hit.front);
    assert!((point.length() - 0.5).abs() < 0.01 && point.z < 0.0);
}

#[test]
fn no_ray_slips_through_an_edge_or_a_corner() {
    // From the centre of a closed surface every ray must hit, above all those through vertices and edges.
    let mesh = shapes::icosphere(2, 0.7);
    let bvh = Bvh::new(&mesh);
    let origin = DVec3::new(0.01, -0.02, 0.03);
    for face in 0..mesh.faces.len() {
        let [a, b, c] = mesh.triangle(face).map(Vec3::as_dvec3);
        for target in [a, b, c, 0.5 * (a + b), 0.25 * b + 0.75 * c, (a + b + c) / 3.0] {
            let ray = Ray { origin, direction: target - origin };
            let hit = bvh.closest_hit(&ray, 0.0, f64::INFINITY).expect("the surface is closed");
            assert!((hit.ray_depth - 1.0).abs() < 1e-9 && !hit.front);
        }
    }
}

#[test]
fn rays_along_the_axes_hit_a_box_also_in_the_plane_of_an_edge() {
    let bvh = Bvh::new(&shapes::cuboid(Vec3::splat(-1.0), Vec3::splat(1.0)));
    for axis in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z] {
        for side in [DVec3::ZERO, axis.any_orthonormal_vector()] {
            let ray = Ray { origin: side - 3.0 * axis, direction: axis };
            assert_eq!(bvh.closest_hit(&ray, 0.0, f64::INFINITY).unwrap().ray_depth, 2.0);
        }
        let beside = Ray { origin: 1.001 * axis.any_orthonormal_vector() - 3.0 * axis, direction: axis };
        assert_eq!(bvh.closest_hit(&beside, 0.0, f64::INFINITY), None);
    }
}

#[test]
fn the_range_of_depths_is_respected() {
    let bvh = Bvh::new(&shapes::cuboid(Vec3::splat(-1.0), Vec3::splat(1.0)));
    let ray = Ray { origin: DVec3::new(0.1, 0.2, -3.0), direction: DVec3::Z };
    assert_eq!(bvh.closest_hit(&ray, 0.0, 1.9), None);
    assert_eq!(bvh.closest_hit(&ray, 2.1, 10.0).unwrap().ray_depth, 4.0);
    assert!(!bvh.any_hit(&ray, 4.1, 10.0) && bvh.any_hit(&ray, 2.5, 4.5));
}

#[test]
fn nothing_and_degenerate_things_are_never_hit() {
    let ray = Ray { origin: DVec3::ZERO, direction: DVec3::Z };
    assert_eq!(Bvh::new(&Mesh::default()).closest_hit(&ray, 0.0, f64::INFINITY), None);
    // A thousand copies of one point: splitting must come to an end.
    let point = Mesh { vertices: vec![Vec3::Z; 3], faces: vec![[0, 1, 2]; 1000], ..Mesh::default() };
    assert_eq!(Bvh::new(&point).closest_hit(&ray, 0.0, f64::INFINITY), None);
    let sphere = Bvh::new(&shapes::icosphere(1, 1.0));
    for direction in [DVec3::ZERO, DVec3::NAN] {
        assert_eq!(sphere.closest_hit(&Ray { origin: DVec3::ZERO, direction }, 0.0, f64::INFINITY), None);
    }
}

/// Triangles of all sizes and directions, slivers, segments and single points among them.
fn random_mesh(rng: &mut ChaCha8Rng, faces: usize) -> Mesh {
    let mut mesh = Mesh::default();
    for face in 0..faces {
        let corner = random_vector(rng);
        let size = 10f64.powf(rng.random_range(-4.0..0.0));
        let (mut b, mut c) = (corner + size * random_vector(rng), corner + size * random_vector(rng));
        match face % 16 {
            0 => b = corner,
            1 => (b, c) = (corner, corner),
            2 => c = corner + 0.5 * (b - corner) + 1e-7 * random_vector(rng),
            _ => {}
        }
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend([corner, b, c].map(DVec3::as_vec3));
        mesh.faces.push([first, first + 1, first + 2]);
    }
    mesh
}

/// The distance to a triangle as the smallest over a fine lattice on it, which is never too small.
fn distance_by_lattice(point: DVec3, corners: [Vec3; 3], steps: u32) -> f64 {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    let share = |i: u32| f64::from(i) / f64::from(steps);
    let lattice = (0..=steps).flat_map(|i| (0..=steps - i).map(move |j| (i, j)));
    lattice.map(|(i, j)| (a + share(i) * (b - a) + share(j) * (c - a)).distance(point)).fold(f64::INFINITY, f64::min)
}

#[test]
fn the_nearest_point_of_a_triangle_is_that_of_a_fine_lattice_on_it() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mesh = random_mesh(&mut rng, 64);
    for face in 0..mesh.faces.len() {
        let corners = mesh.triangle(face);
        let longest = (0..3).map(|i| corners[i].distance(corners[(i + 1) % 3])).fold(0.0, f32::max);
        for _ in 0..8 {
            let point = corners[0].as_dvec3() + 2.0 * f64::from(longest) * random_vector(&mut rng);
            let exact = nearest_on_triangle(point, &corners).distance(point);
            let lattice = distance_by_lattice(point, corners, 100);
            let cell = f64::from(longest) / 100.0;
            assert!(exact <= lattice + 1e-9 && lattice <= exact + cell, "{corners:?} {point}: {exact} {lattice}");
        }
    }
}

#[test]
fn the_tree_finds_the_nearest_point_that_a_search_of_all_triangles_finds() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for mesh in [random_mesh(&mut rng, 700), shapes::torus(0.6, 0.25, 40, 20), shapes::icosphere(2, 0.8)] {
        let bvh = Bvh::new(&mesh);
        let mut queries: Vec<DVec3> = (0..500).map(|_| 1.5 * random_vector(&mut rng)).collect();
        queries.extend(mesh.vertices.iter().step_by(13).map(|v| v.as_dvec3()));
        for point in queries {
            let found = bvh.nearest(point).unwrap();
            let nearest = |face| nearest_on_triangle(point, &mesh.triangle(face)).distance(point);
            let slow = (0..mesh.faces.len()).map(nearest).fold(f64::INFINITY, f64::min);
            assert!((found.distance - slow).abs() <= 1e-15 + 1e-12 * slow, "{} {slow} at {point}", found.distance);
            assert_eq!(found.position.distance(point), found.distance);
            assert!((nearest(found.face as usize) - slow).abs() <= 1e-15);
        }
    }
}

#[test]
fn the_distance_is_that_to_a_face_and_not_to_a_vertex() {
    let mesh =
        Mesh { vertices: vec![Vec3::ZERO, 10.0 * Vec3::X, 10.0 * Vec3::Y], faces: vec![[0, 1, 2]], ..Mesh::default() };
    let bvh = Bvh::new(&mesh);
    let near = bvh.nearest(DVec3::new(3.0, 3.0, 0.25)).unwrap();
    assert_eq!((near.distance, near.position, near.face), (0.25, DVec3::new(3.0, 3.0, 0.0), 0));
    assert_eq!(bvh.nearest(DVec3::new(-3.0, 4.0, 0.0)).unwrap().distance, 3.0);
    assert_eq!(bvh.nearest(DVec3::new(-3.0, -4.0, 0.0)).unwrap().distance, 5.0);
}

#[test]
fn nothing_is_near_an_empty_mesh_or_a_point_that_is_nowhere() {
    assert_eq!(Bvh::new(&Mesh::default()).nearest(DVec3::ZERO), None);
    assert_eq!(Bvh::new(&shapes::icosphere(1, 1.0)).nearest(DVec3::NAN), None);
}

#[test]
fn boxes_in_single_precision_lose_no_hit_whatever_the_place_and_the_length_of_the_direction() {
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    for offset in [Vec3::ZERO, Vec3::new(3e4, -7e3, 1.0)] {
        // Its vertices and faces lie in planes of boxes.
        let corner = Vec3::new(0.5, 1.0, 1e-3);
        let mut mesh = shapes::union([shapes::cuboid(-corner, corner), shapes::icosphere(3, 0.7)]);
        mesh.vertices.iter_mut().for_each(|vertex| *vertex += offset);
        let bvh = Bvh::new(&mesh);
        let mut hits = 0;
        for i in 0..4000 {
            let vertex = mesh.vertices[rng.random_range(0..mesh.vertices.len())].as_dvec3();
            let axis = DVec3::AXES[i % 3] * if rng.random_bool(0.5) { 1.0 } else { -1.0 };
            // To a vertex, along an axis, almost so, and aslant, from near and from far.
            let direction = match i % 4 {
                0 => axis,
                1 => axis + 1e-9 * random_vector(&mut rng),
                2 => axis + 1e-25 * random_vector(&mut rng),
                _ => random_vector(&mut rng),
            };
            let length = [1.0, 1e-200, 1e-20, 1e-13, 1e40, 1e150][i % 6];
            let away = [1.0, 50.0, 1e6][i / 7 % 3] * rng.random_range(0.5..1.0);
            let ray = Ray { origin: vertex - direction * away, direction: length * direction };
            let hit = bvh.closest_hit(&ray, 0.0, f64::INFINITY);
            assert_eq!(hit, closest_by_search(&mesh, &ray), "{ray:?}");
            assert_eq!(bvh.closest_hit(&ray, f64::NEG_INFINITY, f64::INFINITY).is_some(), ray_meets(&mesh, &ray));
            if let Some(hit) = hit {
                // A range that ends, or begins, where it is.
                assert!(bvh.any_hit(&ray, 0.0, hit.ray_depth) && bvh.any_hit(&ray, hit.ray_depth, hit.ray_depth));
                hits += 1;
            }
        }
        assert!(hits > 2500, "{hits}");
    }
}

/// Whether the line of a ray meets a triangle anywhere.
fn ray_meets(mesh: &Mesh, ray: &Ray) -> bool {
    let shear = Shear::new(ray).unwrap();
    (0..mesh.faces.len()).any(|face| shear.intersect(&mesh.triangle(face), face as u32).is_some())
}

/// How many nodes lie above the deepest leaf, it counted.
fn depth(bvh: &Bvh, node: usize) -> usize {
    let node = &bvh.nodes[node];
    if node.count() > 0 || bvh.nodes.len() == 1 {
        return 1;
    }
    1 + (0..2).map(|child| depth(bvh, node.first() as usize + child)).max().unwrap()
}

#[test]
fn no_mesh_makes_a_tree_deeper_than_the_stack() {
    // Each half as far as the last along each axis, and very many at one place: splits by place find no end.
    let corner = |i: i32| 0.5f32.powi(i);
    let mut vertices: Vec<Vec3> = Vec::new();
    for i in 0..63 {
        let axis = Vec3::AXES[i % 3] * corner(i as i32 / 3);
        vertices.extend([axis, 1.001 * axis, axis + 1e-9 * Vec3::ONE]);
    }
    let mut faces: Vec<[u32; 3]> = (0..63).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    faces.extend(vec![[186, 187, 188]; 50_000]);
    let mesh = Mesh { vertices, faces, ..Mesh::default() };
    let bvh = Bvh::new(&mesh);
    let depth = depth(&bvh, 0);
    assert!((18..super::tree::STACK_SIZE).contains(&depth), "{depth}");
    let ray = Ray { origin: DVec3::new(0.3, 0.2, 2.0), direction: DVec3::new(-0.1, 0.05, -1.0) };
    assert_eq!(bvh.closest_hit(&ray, 0.0, f64::INFINITY), closest_by_search(&mesh, &ray));
}

#[test]
fn faces_that_are_nowhere_are_left_out_and_hide_no_other() {
    let ball = shapes::icosphere(3, 0.5);
    let mut spoiled = ball.clone();
    let first = spoiled.vertices.len() as u32;
    spoiled.vertices.extend([Vec3::NAN, Vec3::INFINITY, Vec3::new(0.1, f32::NEG_INFINITY, 0.0)]);
    spoiled.faces.extend([[first, 0, 1], [0, first + 1, 2], [3, 4, first + 2], [first, first + 1, first + 2]]);
    let (sound, bvh) = (Bvh::new(&ball), Bvh::new(&spoiled));
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..500 {
        let ray = Ray { origin: 2.0 * random_vector(&mut rng), direction: random_vector(&mut rng) };
        assert_eq!(bvh.closest_hit(&ray, 0.0, f64::INFINITY), sound.closest_hit(&ray, 0.0, f64::INFINITY));
        assert_eq!(bvh.nearest(ray.origin), sound.nearest(ray.origin));
    }
    let nowhere = Mesh { vertices: vec![Vec3::NAN; 3], faces: vec![[0, 1, 2]; 9], ..Mesh::default() };
    let ray = Ray { origin: DVec3::ZERO, direction: DVec3::X };
    assert_eq!(Bvh::new(&nowhere).closest_hit(&ray, 0.0, f64::INFINITY), None);
}

#[test]
fn trees_are_the_same_whatever_the_threads() {
    let mesh = shapes::icosphere(6, 0.5);
    let built = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let bvh = pool.install(|| Bvh::new(&mesh));
        (bvh.faces, format!("{:?}", bvh.nodes))
    };
    assert!(built(1) == built(3));
}
