//! One picture of a textured mesh: image, mask and depth.

use glam::{DVec2, Vec3};
use image::{GrayImage, Rgb, RgbImage};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::config::{EdgeColor, SynthConfig};
use super::shading::radiance;
use crate::bvh::{Bvh, RayHit};
use crate::camera::Camera;
use crate::mesh::TexturedMesh;
use crate::raster::{DepthMap, Mask};
use crate::ray::Ray;
use crate::srgb::{linear_to_srgb, srgb_to_linear};

/// A rendered picture, as a dataset holds it.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderedView {
    /// sRGB image.
    pub image: RgbImage,
    /// 255 where the object fills at least half of the pixel, else 0.
    pub mask: Mask,
    /// z at the *centre* of each pixel, in the units of the mesh; `+inf` where that ray misses. On silhouettes it may
    /// say otherwise than the mask, which speaks of the whole pixel.
    pub depth: DepthMap,
}

/// Draws one mesh from anywhere by casting rays.
pub struct MeshRenderer<'a> {
    textured: &'a TexturedMesh,
    config: &'a SynthConfig,
    bvh: Bvh,
    /// Where in the pixel the samples lie.
    offsets: Vec<DVec2>,
}

/// Where the random numbers of the views' white balance begin, behind those of exposure and noise.
const WHITE_BALANCE: u64 = 1 << 32;

/// What the samples of a pixel add up to.
struct Pixel {
    /// Mean linear light of the samples that hit, times `coverage`.
    light: Vec3,
    /// Share of the samples that hit.
    coverage: f32,
    /// z at the centre.
    z_depth: f32,
}

impl<'a> MeshRenderer<'a> {
    /// Prepares a mesh; its size, light and samples are the configuration's.
    pub fn new(textured: &'a TexturedMesh, config: &'a SynthConfig) -> Self {
        Self { textured, config, bvh: Bvh::new(&textured.mesh), offsets: sample_offsets(config.samples_per_axis) }
    }

    /// The picture that a camera in the mesh's space takes. Noise, exposure and white balance depend on the seed and on `view`.
    pub fn render(&self, camera: &Camera, view: u64) -> RenderedView {
        let (width, height) = (camera.width, camera.height);
        let pixels: Vec<Pixel> =
            (0..height).into_par_iter().flat_map_iter(|v| (0..width).map(move |u| self.pixel(camera, u, v))).collect();
        let coverage = pixels.iter().map(|p| if p.coverage >= 0.5 { 255 } else { 0 }).collect();
        RenderedView {
            image: self.develop(width, height, &pixels, view),
            mask: Mask::from(GrayImage::from_raw(width, height, coverage).unwrap_or_default()),
            depth: DepthMap { width, height, z_depth: pixels.iter().map(|p| p.z_depth).collect() },
        }
    }

    fn closest_hit(&self, ray: &Ray) -> Option<RayHit> {
        self.bvh.closest_hit(ray, 0.0, f64::INFINITY)
    }

    fn pixel(&self, camera: &Camera, u: u32, v: u32) -> Pixel {
        let corner = DVec2::new(f64::from(u), f64::from(v));
        let (mut light, mut hits) = (Vec3::ZERO, 0.0);
        for (sample, &offset) in self.offsets.iter().enumerate() {
            let ray = camera.ray(corner + offset);
            if let Some(hit) = self.closest_hit(&ray) {
                light += radiance(self.textured, &self.bvh, &self.config.lighting, &ray, &hit, sample);
                hits += 1.0;
            }
        }
        let count = self.offsets.len() as f32;
        let center = self.closest_hit(&camera.pixel_ray(u, v));
        let z_depth = center.map_or(f32::INFINITY, |hit| hit.ray_depth as f32);
        Pixel { light: light / count, coverage: hits / count, z_depth }
    }

    /// The gains of the channels of a view; that of green is 1.
    fn white_balance(&self, view: u64) -> Vec3 {
        let mut rng = ChaCha8Rng::seed_from_u64(self.config.seed);
        // Beside the numbers of exposure and noise, which stay what they are without it.
        rng.set_stream(view + WHITE_BALANCE);
        let mut gain = || (self.config.white_balance_jitter * standard_normal(&mut rng)).exp2();
        Vec3::new(gain(), 1.0, gain())
    }

    /// Light to bytes: silhouettes, exposure and white balance, the sRGB curve, noise.
    fn develop(&self, width: u32, height: u32, pixels: &[Pixel], view: u64) -> RgbImage {
        let mut rng = ChaCha8Rng::seed_from_u64(self.config.seed);
        rng.set_stream(view + 1);
        let gain = (self.config.exposure_jitter * standard_normal(&mut rng)).exp2() * self.white_balance(view);
        let background = Vec3::from(self.config.background.map(srgb_to_linear));
        let mut image = RgbImage::new(width, height);
        for (target, pixel) in image.pixels_mut().zip(pixels) {
            let light = match self.config.edge_color {
                EdgeColor::Mixed => pixel.light + (1.0 - pixel.coverage) * background,
                EdgeColor::Object if pixel.coverage >= 0.5 => pixel.light / pixel.coverage,
                EdgeColor::Object => background,
            };
            *target = Rgb((gain * light).to_array().map(|linear| {
                let mut value = linear_to_srgb(linear.clamp(0.0, 1.0));
                if self.config.noise > 0.0 {
                    value += self.config.noise * standard_normal(&mut rng);
                }
                (value.clamp(0.0, 1.0) * 255.0).round() as u8
            }));
        }
        image
    }
}

/// `n * n` places in the unit square, one in each cell of a grid, no two in a row or column of the finer one: edges
/// along the axes get `n^2 + 1` shades (the canonical arrangement of Kensler's multi-jittered sampling, 2013).
fn sample_offsets(n: u32) -> Vec<DVec2> {
    let fine = f64::from(n * n);
    (0..n)
        .flat_map(|j| (0..n).map(move |i| DVec2::new(f64::from(i * n + j) + 0.5, f64::from(j * n + i) + 0.5) / fine))
        .collect()
}

/// A sample of the standard normal distribution (Box and Muller 1958).
fn standard_normal(rng: &mut ChaCha8Rng) -> f32 {
    let (u, v): (f64, f64) = (rng.random(), rng.random());
    // 1 - u is never 0.
    ((-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_fill_the_pixel_evenly() {
        for n in 1..6 {
            let offsets = sample_offsets(n);
            let mean = offsets.iter().sum::<DVec2>() / offsets.len() as f64;
            assert!((mean - 0.5).length() < 1e-12);
            let mut columns: Vec<u32> = offsets.iter().map(|o| (o.x * f64::from(n * n)) as u32).collect();
            columns.sort_unstable();
            assert_eq!(columns, (0..n * n).collect::<Vec<_>>());
        }
    }

    #[test]
    fn normal_samples_have_mean_zero_and_variance_one() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let samples: Vec<f32> = (0..20_000).map(|_| standard_normal(&mut rng)).collect();
        let mean = samples.iter().sum::<f32>() / 20_000.0;
        let variance = samples.iter().map(|s| s * s).sum::<f32>() / 20_000.0;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.05, "{mean} {variance}");
    }
}
