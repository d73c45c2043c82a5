//! Textures: with and without information about where the surface is.

use std::f64::consts::TAU;
use std::sync::Arc;

use dvr_core::mesh::{Material, Mesh, TexturedMesh};
use glam::{Vec2, Vec3};
use image::{Rgba, RgbaImage};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::axis::usual_footprint;

/// Texels per object unit: about seven per pixel of the usual views.
const TEXELS: u32 = 256;

/// Cells of noise per object unit: one per two and a half pixels.
const NOISE_CELLS: usize = 15;

/// Cells per object unit of the noise that tells plain patches: one per nine pixels, which is a patch.
const PATCH_CELLS: usize = 4;

/// Points on each edge of a face by whose area the share of plain patches is measured.
const AREA_POINTS: usize = 4;

/// A texture.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Paint {
    /// Coloured noise with this share of the largest amplitude; 0 is a flat grey.
    Noise(f32),
    /// The same, of the largest amplitude, with plain grey patches on this share of the surface.
    Patches(f64),
    /// A repeated wave with this period in pixels of the usual views.
    Waves(f64),
    /// Black and white squares of this many pixels, projected along a direction: they cross edges without a break.
    Squares(f64, Vec3),
}

impl Paint {
    /// A texture that shows where a surface is.
    pub(crate) const CLEAR: Self = Self::Noise(1.0);
}

/// A mesh with a texture on all of it.
pub(crate) fn painted(mesh: Mesh, paint: Paint) -> TexturedMesh {
    let uv: Box<dyn Fn(Vec3, Vec3) -> Vec2> = match paint {
        Paint::Squares(_, direction) => {
            let (right, up) = direction.any_orthonormal_pair();
            Box::new(move |place, _| Vec2::new(place.dot(right), place.dot(up)))
        }
        _ => Box::new(boxed),
    };
    let scale = match paint {
        Paint::Noise(_) | Paint::Patches(_) => 1.0,
        // A tile is one period: a wave, or two squares.
        Paint::Waves(pixels) => (1.0 / (pixels * usual_footprint())) as f32,
        Paint::Squares(pixels, _) => (1.0 / (2.0 * pixels * usual_footprint())) as f32,
    };
    let corner_uvs: Vec<[Vec2; 3]> = (0..mesh.faces.len())
        .map(|face| {
            let corners = mesh.triangle(face);
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            corners.map(|corner| scale * uv(corner, normal))
        })
        .collect();
    let texture = match paint {
        Paint::Patches(share) => patched(&mesh, &corner_uvs, share),
        _ => texture(paint),
    };
    let material = Material { base_color: [1.0; 3], texture: Some(Arc::new(texture)) };
    TexturedMesh { mesh, corner_uvs, materials: vec![material], ..TexturedMesh::default() }
}

/// Projects along the dominant axis of the face's normal; each axis has its own part of the texture.
fn boxed(place: Vec3, normal: Vec3) -> Vec2 {
    let size = normal.abs();
    if size.x >= size.y && size.x >= size.z {
        Vec2::new(place.y + 0.13, place.z + 0.71)
    } else if size.y >= size.z {
        Vec2::new(place.z + 0.37, place.x + 0.29)
    } else {
        Vec2::new(place.x + 0.83, place.y + 0.53)
    }
}

fn texture(paint: Paint) -> RgbaImage {
    let byte = |value: f64| (255.0 * value.clamp(0.0, 1.0)).round() as u8;
    let unit = |texel: u32| (f64::from(texel) + 0.5) / f64::from(TEXELS);
    match paint {
        Paint::Noise(contrast) => noise(contrast.into()),
        Paint::Patches(_) => noise(1.0),
        Paint::Waves(_) => RgbaImage::from_fn(TEXELS, TEXELS, |u, v| {
            let wave = |phase: f64| 0.5 + 0.4 * (TAU * unit(u) + phase).sin() * (TAU * unit(v) + 2.0 * phase).sin();
            let [r, g, b] = [0.0, 1.0, 2.0].map(|phase| byte(wave(phase)));
            Rgba([r, g, b, 255])
        }),
        Paint::Squares(..) => RgbaImage::from_fn(TEXELS, TEXELS, |u, v| {
            let value = if (unit(u) < 0.5) == (unit(v) < 0.5) { 0.9 } else { 0.15 };
            Rgba([byte(value), byte(value), byte(value), 255])
        }),
    }
}

/// Coloured noise around a middle grey.
fn noise(contrast: f64) -> RgbaImage {
    let noise = SmoothNoise::new(NOISE_CELLS, 11);
    RgbaImage::from_fn(TEXELS, TEXELS, |u, v| {
        let [u, v] = [u, v].map(|texel| (f64::from(texel) + 0.5) / f64::from(TEXELS));
        let byte = |value: f64| (255.0 * (0.5 + contrast * 0.9 * (value - 0.5)).clamp(0.0, 1.0)).round() as u8;
        let [r, g, b] = noise.at(u, v).map(byte);
        Rgba([r, g, b, 255])
    })
}

/// Coloured noise with plain patches that cover a share of the surface of a mesh.
fn patched(mesh: &Mesh, corner_uvs: &[[Vec2; 3]], share: f64) -> RgbaImage {
    let patches = SmoothNoise::new(PATCH_CELLS, 12);
    let height = |u: f64, v: f64| patches.at(u, v)[0];
    let highest_plain = quantile(mesh, corner_uvs, share, &height);
    let mut texture = noise(1.0);
    for (u, v, texel) in texture.enumerate_pixels_mut() {
        let [u, v] = [u, v].map(|texel| (f64::from(texel) + 0.5) / f64::from(TEXELS));
        // Rows of a picture run from the top, texture coordinates from the bottom.
        if height(u, 1.0 - v) <= highest_plain {
            *texel = Rgba([128, 128, 128, 255]);
        }
    }
    texture
}

/// The value that a function of texture coordinates does not exceed on a share of a mesh's area.
fn quantile(mesh: &Mesh, corner_uvs: &[[Vec2; 3]], share: f64, function: &dyn Fn(f64, f64) -> f64) -> f64 {
    let mut places: Vec<(f64, f64)> = Vec::new();
    for (face, uvs) in corner_uvs.iter().enumerate() {
        let [a, b, c] = mesh.triangle(face);
        let area = f64::from((b - a).cross(c - a).length());
        for i in 0..AREA_POINTS {
            for j in 0..AREA_POINTS {
                // A point of the unit square, folded onto the triangle.
                let [x, y] = [i, j].map(|k| (k as f32 + 0.5) / AREA_POINTS as f32);
                let (x, y) = if x + y > 1.0 { (1.0 - x, 1.0 - y) } else { (x, y) };
                let uv = uvs[0] + x * (uvs[1] - uvs[0]) + y * (uvs[2] - uvs[0]);
                places.push((function(uv.x.into(), uv.y.into()), area));
            }
        }
    }
    places.sort_by(|a, b| a.0.total_cmp(&b.0));
    let below = share * places.iter().map(|place| place.1).sum::<f64>();
    let mut sum = 0.0;
    let is_below = |place: &&(f64, f64)| {
        sum += place.1;
        sum <= below
    };
    places.iter().take_while(is_below).last().map_or(f64::NEG_INFINITY, |place| place.0)
}

/// Smooth noise that repeats after a unit: random values of three channels on a grid, interpolated.
struct SmoothNoise {
    cells: usize,
    grid: Vec<[f64; 3]>,
}

impl SmoothNoise {
    fn new(cells: usize, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        Self { cells, grid: (0..cells * cells).map(|_| rng.random()).collect() }
    }

    /// The values at texture coordinates, in `[0, 1]`.
    fn at(&self, u: f64, v: f64) -> [f64; 3] {
        let cells = self.cells;
        let [x, y] = [u, v].map(|place| place.rem_euclid(1.0) * cells as f64);
        let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
        let (s, t) = (smooth(x.fract()), smooth(y.fract()));
        let (i, j) = (x as usize, y as usize);
        let node = |i: usize, j: usize| self.grid[(j % cells) * cells + i % cells];
        std::array::from_fn(|c| {
            let row = |j: usize| node(i, j)[c] * (1.0 - s) + node(i + 1, j)[c] * s;
            row(j) * (1.0 - t) + row(j + 1) * t
        })
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::shapes::cuboid;

    use super::*;

    fn spread(texture: &RgbaImage) -> u8 {
        let values = || texture.pixels().map(|pixel| pixel.0[0]);
        values().max().unwrap() - values().min().unwrap()
    }

    #[test]
    fn noise_has_its_contrast() {
        assert_eq!(spread(&texture(Paint::Noise(0.0))), 0);
        let (weak, strong) = (spread(&texture(Paint::Noise(0.1))), spread(&texture(Paint::Noise(1.0))));
        assert!((15..=23).contains(&weak) && strong > 200, "{weak} {strong}");
    }

    #[test]
    fn a_pattern_repeats_with_its_period() {
        let mesh = cuboid(Vec3::splat(-0.3), Vec3::splat(0.3));
        for (paint, period) in [(Paint::Waves(8.0), 8.0), (Paint::Squares(4.0, Vec3::Z), 8.0)] {
            let painted = painted(mesh.clone(), paint);
            // Edges of length 0.6 run along one axis of the texture each.
            let longest = painted.corner_uvs.iter().map(|[a, b, _]| (*a - *b).abs().max_element()).fold(0.0, f32::max);
            assert!((f64::from(longest) * period * usual_footprint() - 0.6).abs() < 1e-5, "{longest}");
        }
    }
}
