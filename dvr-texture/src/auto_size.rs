//! How large a texture has to be to hold what the photographs show.

use dvr_core::mesh::Mesh;
use glam::Vec3;
use rayon::prelude::*;

use crate::photographs::Photograph;
use crate::texels::{blend, corners};

/// Faces that are looked at, about.
const PROBES: usize = 20_000;

/// Share of a texture that charts cover, about.
pub(crate) const COVER: f64 = 0.4;

/// Sizes that are chosen.
pub(crate) const LEAST: u32 = 256;
const MOST: u32 = 8192;

/// Largest size that is always rounded up: the padding of charts takes much of small textures.
const SMALL: f64 = 2048.0;

/// The power of two next to the size at which a texel is, in the mean, as large as a pixel of the photograph that shows
/// its place best, or as a cell where colours are taken from cells of several pixels: the larger one up to 2048, the nearer
/// one beyond. Finer texels would each show the few cells next to them, a weave of photographs that are not alike.
///
/// `None` where no photograph sees the mesh.
pub(crate) fn auto_size(mesh: &Mesh, normals: &[Vec3], photographs: &[Photograph]) -> Option<u32> {
    let every = mesh.faces.len().div_ceil(PROBES).max(1);
    let best = |face: usize| {
        let (points, directions) = corners(mesh, normals, face as u32);
        let third = [1.0 / 3.0; 3];
        let (point, normal) = (blend(points, third), blend(directions, third).normalize_or_zero());
        let sights = photographs.iter().filter_map(|photograph| {
            let cell = photograph.buffer.stride.pow(2) as f32;
            photograph.sight(point, normal).filter(|sight| photograph.is_open(sight)).map(|sight| sight.quality / cell)
        });
        let [a, b, c] = points;
        let area = f64::from(0.5 * (b - a).cross(c - a).length());
        (area, area * f64::from(sights.fold(0.0, f32::max)))
    };
    let probes: Vec<(f64, f64)> = (0..mesh.faces.len()).into_par_iter().step_by(every).map(best).collect();
    let area: f64 = (0..mesh.faces.len())
        .map(|face| {
            let [a, b, c] = mesh.triangle(face);
            f64::from(0.5 * (b - a).cross(c - a).length())
        })
        .sum();
    let (probed, pixels) =
        probes.iter().filter(|(_, pixels)| *pixels > 0.0).fold((0.0, 0.0), |(a, p), probe| (a + probe.0, p + probe.1));
    // What no photograph sees takes as many texels as the rest.
    let edge = (pixels / probed * area / COVER).sqrt();
    (probed > 0.0).then(|| power_of_two(edge))
}

/// The size for an edge of so many texels.
pub(crate) fn power_of_two(edge: f64) -> u32 {
    let larger = edge.log2().ceil().exp2();
    let size = if larger <= SMALL { larger } else { edge.log2().round().exp2() };
    size.clamp(LEAST.into(), MOST.into()) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_textures_are_rounded_up_and_large_ones_to_the_nearer_power() {
        assert_eq!([10.0, 300.0, 1030.0].map(power_of_two), [256, 512, 2048]);
        assert_eq!([2100.0, 2890.0, 2900.0, 1e6].map(power_of_two), [2048, 2048, 4096, 8192]);
    }
}
