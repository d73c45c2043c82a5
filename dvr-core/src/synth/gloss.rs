//! What a glossy surface mirrors: the metallic-roughness material of glTF 2.0 (appendix B).
//!
//! Microfacets with the GGX distribution (Walter et al., *Microfacet Models for Refraction*, 2007), Smith's masking and
//! shadowing, and Schlick's Fresnel term (1994). The integral over the lobe is the mean over visible normals (Heitz,
//! *Sampling the GGX Distribution of Visible Normals*, 2018), at points that are the same in every run.

use std::f64::consts::TAU;

use glam::{DMat3, DVec3, Vec3};

use super::config::{Gloss, Lighting};

/// Share of the light that a dielectric mirrors where it is seen from straight above: that of a refractive index of 1.5
/// (glTF 2.0).
const DIELECTRIC: f32 = 0.04;

/// Directions per sample of a pixel. With the 16 samples of a pixel, 512: a light of ten degrees at a roughness of a
/// half is off by less than a byte.
const DIRECTIONS: u32 = 32;

/// Steps of the two-dimensional low-discrepancy sequence that shifts the directions of each sample of a pixel (Roberts,
/// R2): powers of the inverse of the plastic number.
const SHIFT: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];

/// Share of the light from below the surface that leaves it again: what is neither mirrored nor swallowed by metal.
pub(super) fn diffuse_share(gloss: &Gloss) -> f32 {
    (1.0 - gloss.metallic) * (1.0 - DIELECTRIC)
}

/// Linear light that is mirrored towards the camera. Lights are discs, the ambient light is everywhere else; a
/// reflection never sees the object itself. `sample` is the number of the pixel's sample.
pub(super) fn mirrored(
    lighting: &Lighting,
    gloss: &Gloss,
    base_color: Vec3,
    normal: DVec3,
    to_camera: DVec3,
    sample: usize,
) -> Vec3 {
    let (x, y) = normal.any_orthonormal_pair();
    let to_world = DMat3::from_cols(x, y, normal);
    let view = to_world.transpose() * to_camera;
    // Interpolated normals may look away from the camera.
    let view = DVec3::new(view.x, view.y, view.z.max(1e-3)).normalize();
    let alpha = gloss.roughness * gloss.roughness;
    let head_on = Vec3::splat(DIELECTRIC).lerp(base_color, gloss.metallic);
    let mut light = Vec3::ZERO;
    for index in 0..DIRECTIONS {
        let facet = visible_facet(view, alpha, point(index, sample));
        let toward = 2.0 * view.dot(facet) * facet - view;
        if toward.z > 0.0 {
            let fresnel = head_on + (1.0 - head_on) * (1.0 - view.dot(facet).clamp(0.0, 1.0) as f32).powi(5);
            light += fresnel * smith(toward, alpha) as f32 * environment(lighting, gloss, to_world * toward);
        }
    }
    light / DIRECTIONS as f32
}

/// A point of the unit square: Hammersley's set, shifted for each sample of a pixel.
fn point(index: u32, sample: usize) -> [f64; 2] {
    let regular = [(f64::from(index) + 0.5) / f64::from(DIRECTIONS), f64::from(index.reverse_bits()) / 2f64.powi(32)];
    std::array::from_fn(|i| (regular[i] + SHIFT[i] * sample as f64).fract())
}

/// A normal of the GGX distribution as the viewer sees it (Heitz 2018, listing 1). `view` has length 1 in the frame
/// whose z axis is the surface's normal.
fn visible_facet(view: DVec3, alpha: f64, [first, second]: [f64; 2]) -> DVec3 {
    let stretched = DVec3::new(alpha * view.x, alpha * view.y, view.z).normalize();
    let right = DVec3::new(-stretched.y, stretched.x, 0.0).normalize_or(DVec3::X);
    let up = stretched.cross(right);
    let (sin, cos) = (TAU * second).sin_cos();
    let (radius, share) = (first.sqrt(), 0.5 * (1.0 + stretched.z));
    let across = radius * cos;
    let along = (1.0 - share) * (1.0 - across * across).max(0.0).sqrt() + share * radius * sin;
    let out = (1.0 - across * across - along * along).max(0.0).sqrt();
    let facet = across * right + along * up + out * stretched;
    DVec3::new(alpha * facet.x, alpha * facet.y, facet.z.max(1e-9)).normalize()
}

/// Smith's masking of a direction by the other facets (Walter et al. 2007, equation 34).
fn smith(direction: DVec3, alpha: f64) -> f64 {
    let cosine = direction.z * direction.z;
    2.0 / (1.0 + (1.0 + alpha * alpha * (1.0 - cosine) / cosine).sqrt())
}

/// Radiance from a direction: on a white surface that faces it, the disc of a light gives the light's intensity.
fn environment(lighting: &Lighting, gloss: &Gloss, direction: DVec3) -> f32 {
    let (sin, cos) = gloss.light_half_angle.to_radians().sin_cos();
    let is_in_disc = |toward: DVec3| toward.normalize_or_zero().dot(direction) > cos;
    let discs = lighting.lights.iter().filter(|light| is_in_disc(light.direction)).map(|light| light.intensity);
    lighting.ambient + discs.sum::<f32>() / (sin * sin) as f32
}

#[cfg(test)]
mod tests {
    use super::super::config::DirectionalLight;
    use super::*;

    fn lit_from(direction: DVec3, ambient: f32) -> Lighting {
        Lighting { ambient, lights: vec![DirectionalLight { direction, intensity: 0.5 }], ..Lighting::default() }
    }

    fn metal(roughness: f64) -> Gloss {
        Gloss { roughness, metallic: 1.0, light_half_angle: 20.0 }
    }

    /// The mean over the samples of a pixel: light from `angle` degrees beside the mirrored direction.
    fn at(gloss: &Gloss, lighting: &Lighting, view_angle: f64) -> f32 {
        let (sin, cos) = view_angle.to_radians().sin_cos();
        let view = DVec3::new(sin, 0.0, cos);
        (0..16).map(|sample| mirrored(lighting, gloss, Vec3::ONE, DVec3::Z, view, sample).x).sum::<f32>() / 16.0
    }

    #[test]
    fn a_smooth_metal_is_a_mirror() {
        let lighting = lit_from(DVec3::new(-1.0, 0.0, 1.0), 0.25);
        let disc = 0.25 + 0.5 / 20f32.to_radians().sin().powi(2);
        assert!((at(&metal(0.02), &lighting, 45.0) - disc).abs() < 0.01 * disc, "the light");
        for beside in [10.0, 70.0] {
            assert!((at(&metal(0.02), &lighting, beside) - 0.25).abs() < 0.01, "the ambient light");
        }
    }

    #[test]
    fn a_highlight_grows_wide_and_dim_with_the_roughness() {
        let lighting = lit_from(DVec3::new(-1.0, 0.0, 1.0), 0.0);
        let (middle, beside): (Vec<f32>, Vec<f32>) = [0.05, 0.3, 0.5]
            .map(|r| (at(&metal(r), &lighting, 45.0), at(&metal(r), &lighting, 15.0)))
            .into_iter()
            .unzip();
        assert!(middle[0] > middle[1] && middle[1] > middle[2] && middle[2] > 0.2, "{middle:?}");
        assert!(beside[0] < 1e-6 && beside[1] < beside[2] && beside[2] > 0.02, "{beside:?}");
    }

    #[test]
    fn no_light_is_made_and_a_smooth_surface_swallows_none() {
        let furnace = Lighting { ambient: 1.0, lights: Vec::new(), ..Lighting::default() };
        for view in [0.0, 45.0, 80.0] {
            for roughness in [0.05, 0.3, 1.0] {
                let light = at(&metal(roughness), &furnace, view);
                assert!(light <= 1.0 + 1e-5, "{light} at {roughness}");
                assert!(roughness > 0.3 || light > 0.85, "{light} at {roughness} from {view}");
            }
        }
        let dielectric = Gloss { metallic: 0.0, ..metal(0.1) };
        assert!((at(&dielectric, &furnace, 0.0) - DIELECTRIC).abs() < 1e-3, "from straight above");
        assert!(at(&dielectric, &furnace, 80.0) > 0.3, "Fresnel");
        assert_eq!((diffuse_share(&metal(0.1)), diffuse_share(&dielectric)), (0.0, 0.96));
    }

    #[test]
    fn visible_facets_are_distributed_as_ggx_seen_from_above() {
        // From straight above, the cosine of a facet has the distribution function sin^2 / (sin^2 + alpha^2 cos^2).
        let alpha = 0.25;
        let facets = (0..64).flat_map(|sample| (0..DIRECTIONS).map(move |index| point(index, sample)));
        let squares: Vec<f64> = facets.map(|place| visible_facet(DVec3::Z, alpha, place).z.powi(2)).collect();
        for bound in [0.8f64, 0.9, 0.95, 0.99] {
            let expected = (1.0 - bound) / (1.0 - bound + alpha * alpha * bound);
            let found = squares.iter().filter(|&&square| square > bound).count() as f64 / squares.len() as f64;
            assert!((found - expected).abs() < 0.01, "{found} of facets within {bound}, expected {expected}");
        }
    }
}
