//! Parts that become thinner than a pixel.

use dvr_core::mesh::Mesh;
use dvr_core::mesh::shapes::{Frame, cuboid, loft, torus};
use glam::{Vec2, Vec3};

use super::placement::{faceted, tilted};

/// A round rod of this radius, bent to a ring: it has no ends, and runs in all directions of a plane.
pub(crate) fn ring(radius: f64) -> Mesh {
    let radius = radius as f32;
    tilted(torus(0.42 - radius, radius, 192, 24))
}

/// A flat plate of this thickness.
pub(crate) fn plate(thickness: f64) -> Mesh {
    let half = Vec3::new(0.35, 0.5 * thickness as f32, 0.35);
    tilted(cuboid(-half, half))
}

/// A blade whose two sides meet at this angle, in degrees. Its back is a flat face.
pub(crate) fn wedge(degrees: f64) -> Mesh {
    let half_angle = 0.5 * degrees.to_radians() as f32;
    let side = 0.55;
    let (depth, half_back) = (side * half_angle.cos(), side * half_angle.sin());
    // Around its centroid, a third of the way from the back to the edge.
    let outline =
        [Vec2::new(2.0 / 3.0 * depth, 0.0), Vec2::new(-depth / 3.0, half_back), Vec2::new(-depth / 3.0, -half_back)];
    let frames = [-0.25, 0.25].map(|z| Frame { center: Vec3::Z * z, x: Vec3::X, y: Vec3::Y });
    tilted(faceted(merged(loft(&frames, &outline, false))))
}

/// Lids of a sweep share the vertices of its mantle: edges are hard without normals, and the surface is closed by
/// number.
fn merged(mesh: Mesh) -> Mesh {
    let mut kept: Vec<Vec3> = Vec::new();
    let place = |vertex: &Vec3, kept: &mut Vec<Vec3>| match kept.iter().position(|other| other == vertex) {
        Some(index) => index as u32,
        None => {
            kept.push(*vertex);
            (kept.len() - 1) as u32
        }
    };
    let numbers: Vec<u32> = mesh.vertices.iter().map(|vertex| place(vertex, &mut kept)).collect();
    let faces = mesh.faces.iter().map(|face| face.map(|i| numbers[i as usize])).collect();
    Mesh { vertices: kept, faces, ..Mesh::default() }
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::Topology;

    use std::f32::consts::TAU;

    use super::*;
    use crate::shapes::measures::{extent, volume};

    #[test]
    fn a_ring_has_the_volume_of_a_rod_of_its_radius() {
        for radius in [0.1f32, 0.01, 0.002] {
            let mesh = ring(radius.into());
            let expected = TAU * (0.42 - radius) * std::f32::consts::PI * radius * radius;
            assert!((volume(&mesh) / expected - 1.0).abs() < 0.03, "{radius}");
            assert_eq!(Topology::of(&mesh).handles(), Some(1));
        }
    }

    #[test]
    fn a_plate_is_as_thick_as_it_says() {
        let mesh = plate(0.013);
        assert!((volume(&mesh) - 0.49 * 0.013).abs() < 1e-5);
        let normal = (mesh.vertices[2] - mesh.vertices[0]).normalize();
        assert!((extent(&mesh, normal) - 0.013).abs() < 1e-5);
        assert!(Topology::of(&mesh).closed);
    }

    #[test]
    fn a_wedge_has_its_angle() {
        for degrees in [90.0f64, 20.0, 4.0] {
            let mesh = wedge(degrees);
            assert_eq!(Topology::of(&mesh).handles(), Some(0));
            // Of the sides at the edge: the outline's first corner is the edge, the others are the back's.
            let [edge, left, right] = [0, 1, 2].map(|i| mesh.vertices[i]);
            let angle = (left - edge).angle_between(right - edge).to_degrees();
            assert!((f64::from(angle) - degrees).abs() < 0.01, "{angle} {degrees}");
        }
    }
}
