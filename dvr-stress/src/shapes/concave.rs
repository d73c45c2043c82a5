//! Concavities that silhouettes do not show: the inside of bowls, and of tunnels.

use std::f32::consts::TAU;

use dvr_core::mesh::Mesh;
use dvr_core::mesh::shapes::{Frame, loft, revolve};
use glam::{Vec2, Vec3};

use super::placement::{faceted, tilted};

/// Vertices of a circle.
const AROUND: u32 = 72;

/// Wall and bottom of a bowl, object units: three pixels.
const WALL: f32 = 0.08;

/// A round bowl with upright walls. `depth` is its depth as a multiple of the width of its opening.
pub(crate) fn bowl(depth: f64) -> Mesh {
    let depth = depth as f32;
    let inner = (0.36 - WALL).min((0.75 - WALL) / (2.0 * depth));
    let (outer, low) = (inner + WALL, -(0.5 * (2.0 * inner * depth + WALL)));
    let profile = [(0.0, low), (outer, low), (outer, -low), (inner, -low), (inner, low + WALL), (0.0, low + WALL)]
        .map(Vec2::from);
    tilted(faceted(revolve(&profile, AROUND)))
}

/// A thick pipe. `length` is the length of its bore as a multiple of the bore's width.
pub(crate) fn tunnel(length: f64) -> Mesh {
    let length = length as f32;
    let inner = 0.22f32.min(0.35 / length);
    let (outer, half) = (0.34f32.min(inner + 0.2), inner * length);
    let frames: Vec<Frame> = (0..AROUND)
        .map(|i| {
            let (sin, cos) = (TAU * i as f32 / AROUND as f32).sin_cos();
            let out = Vec3::new(cos, 0.0, sin);
            Frame { center: 0.5 * (inner + outer) * out, x: 0.5 * (outer - inner) * out, y: half * Vec3::Y }
        })
        .collect();
    let square = [(1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)].map(Vec2::from);
    tilted(faceted(loft(&frames, &square, true)))
}

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

    use dvr_core::mesh::Topology;

    use super::*;
    use crate::shapes::measures::volume;

    #[test]
    fn a_bowl_is_closed_and_its_volume_follows_its_depth() {
        for depth in [0.25f32, 1.0, 2.0] {
            let mesh = bowl(depth.into());
            let topology = Topology::of(&mesh);
            assert_eq!(topology.handles(), Some(0), "{topology:?}");
            let inner = (0.36 - WALL).min((0.75 - WALL) / (2.0 * depth));
            let cavity = PI * inner * inner * 2.0 * inner * depth;
            let full = PI * (inner + WALL).powi(2) * (2.0 * inner * depth + WALL);
            assert!((volume(&mesh) / (full - cavity) - 1.0).abs() < 0.01, "{depth}");
        }
    }

    #[test]
    fn a_tunnel_goes_through() {
        for length in [0.5, 2.0, 8.0] {
            let mesh = tunnel(length);
            assert_eq!(Topology::of(&mesh).handles(), Some(1));
            assert!(volume(&mesh) > 0.0);
            let reach = mesh.vertices.iter().map(|v| v.length()).fold(0.0, f32::max);
            assert!(reach < 0.5, "{reach}");
        }
    }
}
