//! Directions that are evenly spread over the sphere.

use std::f64::consts::PI;

use glam::DVec3;

/// So many unit vectors, evenly spread: each turned by the golden angle from the last (Vogel 1979).
pub(super) fn even_directions(count: usize) -> impl Iterator<Item = DVec3> {
    let golden_angle = PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |i| {
        let height = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let (radius, angle) = ((1.0 - height * height).max(0.0).sqrt(), golden_angle * i as f64);
        DVec3::new(radius * angle.cos(), height, radius * angle.sin())
    })
}
