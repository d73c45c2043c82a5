//! The colour of a texel from the photographs that see it.

use dvr_core::mesh::Mesh;
use dvr_core::{Cancellation, Cancelled, weighted_median};
use glam::Vec3;
use rayon::prelude::*;

use crate::atlas::Atlas;
use crate::photographs::Photograph;
use crate::texels::{FREE, Texels, barycentric, blend, corners};

/// Difference of colours, sRGB in `[0, 1]`, beyond which a photograph does not agree with the others.
const AGREEMENT: f32 = 0.15;

/// What one photograph shows at a texel.
#[derive(Clone, Copy, Debug)]
struct Shown {
    color: Vec3,
    weight: f32,
}

/// Colours of all texels and the share of the surface's texels that photographs show. Others take the mesh's own colour
/// where it has one; `NaN` is what is known of no colour.
pub(crate) fn blended(
    mesh: &Mesh,
    normals: &[Vec3],
    atlas: &Atlas,
    texels: &Texels,
    photographs: &[Photograph],
    cancellation: &Cancellation,
) -> Result<(Vec<Vec3>, f64), Cancelled> {
    let size = texels.size;
    let mut colors = vec![Vec3::NAN; texels.face.len()];
    let rows = colors.par_chunks_mut(size as usize).enumerate().map(|(v, row)| {
        cancellation.check()?;
        let (mut seen, mut all) = (0, 0);
        let mut shown = Vec::with_capacity(photographs.len());
        for (u, color) in row.iter_mut().enumerate() {
            let face = texels.face[v * size as usize + u];
            if face == FREE {
                continue;
            }
            let weights = barycentric(atlas.corners[face as usize], (u as u32, v as u32));
            let (points, directions) = corners(mesh, normals, face);
            let (point, normal) = (blend(points, weights), blend(directions, weights).normalize_or_zero());
            shown.clear();
            shown.extend(photographs.iter().filter_map(|photograph| shown_by(photograph, point, normal)));
            all += 1;
            seen += usize::from(!shown.is_empty());
            if !shown.is_empty() {
                *color = agreed(&mut shown);
            } else if let Some(own) = &mesh.colors {
                *color = blend(mesh.faces[face as usize].map(|i| own[i as usize].into()), within(weights));
            }
        }
        Ok([seen, all])
    });
    let counts: Vec<[usize; 2]> = rows.collect::<Result<_, Cancelled>>()?;
    let sum = |k: usize| counts.iter().map(|count| count[k]).sum::<usize>();
    Ok((colors, sum(0) as f64 / sum(1).max(1) as f64))
}

/// Weights of the nearest point of the face: colours are not carried on beyond it.
fn within(weights: [f32; 3]) -> [f32; 3] {
    let inside = weights.map(|weight| weight.max(0.0));
    let sum: f32 = inside.iter().sum();
    inside.map(|weight| weight / sum)
}

fn shown_by(photograph: &Photograph, point: Vec3, normal: Vec3) -> Option<Shown> {
    let sight = photograph.sight(point, normal)?;
    if !photograph.is_open(&sight) {
        return None;
    }
    Some(Shown { color: photograph.color(sight.pixel)?, weight: sight.quality })
}

/// The weighted mean of what agrees with the weighted median: highlights, occluders and wrong masks in some photographs
/// do not count (after Waechter, Moehrle and Goesele, Let There Be Color!, ECCV 2014, section 4.1.2; a weight that falls
/// off in place of their mean shift).
fn agreed(shown: &mut [Shown]) -> Vec3 {
    let middle = Vec3::from([0, 1, 2].map(|channel| weighted_median(shown, |each| (each.color[channel], each.weight))));
    let (mut sum, mut total) = (Vec3::ZERO, 0.0);
    for each in shown {
        let off = each.color.distance_squared(middle) / (AGREEMENT * AGREEMENT);
        let weight = each.weight / (1.0 + off).powi(2);
        sum += weight * each.color;
        total += weight;
    }
    sum / total
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(colors: &[(f32, f32)]) -> Vec<Shown> {
        colors.iter().map(|&(grey, weight)| Shown { color: Vec3::splat(grey), weight }).collect()
    }

    #[test]
    fn what_agrees_is_averaged_and_a_highlight_hardly_counts() {
        let alike = agreed(&mut shown(&[(0.40, 1.0), (0.44, 1.0), (0.42, 2.0)]));
        assert!((alike.x - 0.42).abs() < 1e-3, "{alike}");
        let glaring = agreed(&mut shown(&[(0.40, 1.0), (0.44, 1.0), (0.42, 2.0), (1.0, 2.0)]));
        assert!((glaring.x - 0.42).abs() < 0.02, "{glaring}");
        assert_eq!(agreed(&mut shown(&[(0.3, 5.0)])).x, 0.3);
    }
}
