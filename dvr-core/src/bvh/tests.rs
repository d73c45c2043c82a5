use glam::{DVec3, Vec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

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
