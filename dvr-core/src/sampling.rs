//! Random points: on a mesh's surface, and in the cube.

use glam::Vec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::mesh::Mesh;
use crate::points::PointCloud;
use crate::ray::UnitCube;

/// Points on a mesh, one entry a point in each of the lists.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceSamples {
    /// Positions.
    pub points: Vec<Vec3>,
    /// Unit normals of the faces that the points lie on.
    pub normals: Vec<Vec3>,
    /// The faces that the points lie on.
    pub faces: Vec<u32>,
}

impl From<SurfaceSamples> for PointCloud {
    fn from(samples: SurfaceSamples) -> Self {
        Self { points: samples.points, normals: Some(samples.normals), colors: None }
    }
}

/// `count` points that are uniform on the surface: each face is drawn in proportion to its area.
///
/// A mesh without area (no faces, or only degenerate ones) gives no points. Faces with a corner that is not finite are
/// left out.
pub fn sample_surface(mesh: &Mesh, count: usize, seed: u64) -> SurfaceSamples {
    let mut total = 0.0;
    let cumulative_areas: Vec<f64> = (0..mesh.faces.len())
        .map(|face| {
            let area = twice_area_vector(mesh.triangle(face)).length();
            total += if area.is_finite() { area } else { 0.0 };
            total
        })
        .collect();
    let mut samples = SurfaceSamples::default();
    if total <= 0.0 {
        return samples;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for _ in 0..count {
        let draw = rng.random::<f64>() * total;
        // The first face whose cumulative area exceeds the draw: never one without area.
        let face = cumulative_areas.partition_point(|&area| area <= draw).min(mesh.faces.len() - 1);
        let corners = mesh.triangle(face);
        let [a, b, c] = corners.map(|corner| corner.as_dvec3());
        // Folding the unit square along its diagonal keeps the points uniform in the triangle.
        let (s, t) = (rng.random::<f64>(), rng.random::<f64>());
        let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
        samples.points.push((a + s * (b - a) + t * (c - a)).as_vec3());
        samples.normals.push(twice_area_vector(corners).normalize().as_vec3());
        samples.faces.push(face as u32);
    }
    samples
}

/// `count` points that are uniform in the cube.
pub fn sample_cube(cube: UnitCube, count: usize, seed: u64) -> Vec<Vec3> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let edge = 2.0 * cube.half_extent() as f32;
    (0..count).map(|_| edge * (Vec3::from_array(rng.random()) - 0.5)).collect()
}

/// The normal of a triangle, twice as long as its area.
fn twice_area_vector(corners: [Vec3; 3]) -> glam::DVec3 {
    let [a, b, c] = corners.map(|corner| corner.as_dvec3());
    (b - a).cross(c - a)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles in z = 0, the second of three times the area of the first, and a degenerate one.
    fn mesh() -> Mesh {
        let vertices = [[0., 0.], [1., 0.], [0., 1.], [4., 0.], [0., 0.], [1., 1.]];
        Mesh {
            vertices: vertices.iter().map(|v| Vec3::new(v[0], v[1], 0.0)).collect(),
            faces: vec![[0, 1, 4], [0, 1, 2], [1, 3, 5]],
            ..Mesh::default()
        }
    }

    #[test]
    fn faces_are_drawn_by_area_and_points_lie_on_them() {
        let mesh = mesh();
        let samples = sample_surface(&mesh, 4000, 1);
        let count = |face| samples.faces.iter().filter(|&&f| f == face).count();
        assert_eq!(count(0), 0, "no area");
        assert!((count(1) as f64 / 1000.0 - 1.0).abs() < 0.1);
        assert!(samples.normals.iter().all(|n| (*n - Vec3::Z).length() < 1e-6));
        for (point, &face) in samples.points.iter().zip(&samples.faces) {
            let [a, b, c] = mesh.triangle(face as usize);
            let inside = |p: Vec3, q: Vec3| (q - p).cross(*point - p).z >= -1e-6;
            assert!(point.z == 0.0 && inside(a, b) && inside(b, c) && inside(c, a));
        }
        let mean: Vec3 = samples.points.iter().filter(|p| p.x + p.y < 1.0).sum::<Vec3>() / count(1) as f32;
        assert!((mean - Vec3::new(1.0 / 3.0, 1.0 / 3.0, 0.0)).length() < 0.03, "{mean}");
    }

    #[test]
    fn a_mesh_without_area_gives_no_points() {
        assert_eq!(sample_surface(&Mesh::default(), 10, 0), SurfaceSamples::default());
        let line = Mesh { faces: vec![[0, 1, 3]], ..mesh() };
        assert!(sample_surface(&line, 10, 0).points.is_empty());
        let mut broken = mesh();
        broken.vertices[5] = Vec3::NAN;
        assert!(sample_surface(&broken, 100, 0).faces.iter().all(|&face| face == 1));
    }

    #[test]
    fn the_seed_decides() {
        assert_eq!(sample_surface(&mesh(), 50, 3), sample_surface(&mesh(), 50, 3));
        assert_ne!(sample_surface(&mesh(), 50, 3), sample_surface(&mesh(), 50, 4));
        assert_ne!(sample_cube(UnitCube::default(), 5, 0), sample_cube(UnitCube::default(), 5, 1));
    }

    #[test]
    fn points_of_the_cube_fill_it_and_no_more() {
        let points = sample_cube(UnitCube { padding: 0.1 }, 10_000, 7);
        assert!(points.iter().all(|p| UnitCube { padding: 0.1 }.contains(p.as_dvec3())));
        let unpadded = points.iter().filter(|p| p.abs().max_element() <= 0.5).count() as f64 / 10_000.0;
        assert!((unpadded - 1.1f64.powi(-3)).abs() < 0.02, "{unpadded}");
    }
}
