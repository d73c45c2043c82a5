//! Texels that together give back the photographs: weighted least squares over all pixels.
//!
//! A pixel sees four texels through bilinear weights `b`; the texture `T` minimises
//! `sum over pixels of w |sum_k b_k T_k - c|^2`. Where pixels are fewer than texels the minimum is not unique: steps
//! begin at colours that are blended already and change only what pixels see. A step is that of Landweber with the
//! diagonal as a preconditioner (SIRT; Gilbert 1972); few of them are a regularisation.

use dvr_core::mesh::Mesh;
use dvr_core::{Cancellation, Cancelled};
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::atlas::Atlas;
use crate::photographs::Photograph;
use crate::texels::{blend, corners};
use crate::view_buffer::NOTHING;

/// Rows of texels that are summed one after the other: bands do not depend on the number of threads.
const BAND: u32 = 32;

/// One pixel on the texture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// The texel up and left of the place.
    texel: u32,
    /// How far the place is from it, to the right and down.
    fraction: [f32; 2],
    color: Vec3,
    weight: f32,
}

impl Sample {
    /// The four texels and their weights.
    #[inline]
    fn corners(&self, size: u32) -> ([usize; 4], [f32; 4]) {
        let (first, size) = (self.texel as usize, size as usize);
        let [s, t] = self.fraction;
        let weights = [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t];
        ([first, first + 1, first + size, first + size + 1], weights)
    }

    fn value(&self, colors: &[Vec3], size: u32) -> Vec3 {
        let (texels, weights) = self.corners(size);
        (0..4).map(|k| weights[k] * colors[texels[k]]).sum()
    }
}

/// Samples in the order of the bands that they begin in, and in each band in that of photographs and pixels.
#[derive(Clone)]
pub(crate) struct Samples {
    size: u32,
    bands: Vec<Vec<Sample>>,
}

impl Samples {
    /// Where the pixels of all photographs that see the surface lie on the texture.
    pub fn gather(
        mesh: &Mesh,
        normals: &[Vec3],
        atlas: &Atlas,
        photographs: &[Photograph],
        cancellation: &Cancellation,
    ) -> Result<Self, Cancelled> {
        let of_view = |photograph: &Photograph| {
            cancellation.check()?;
            Ok(samples_of(mesh, normals, atlas, photograph))
        };
        let by_view: Vec<Vec<Sample>> = photographs.par_iter().map(of_view).collect::<Result<_, Cancelled>>()?;
        let mut bands = vec![Vec::new(); atlas.size.div_ceil(BAND) as usize];
        for samples in by_view {
            samples.into_iter().for_each(|sample| bands[(sample.texel / atlas.size / BAND) as usize].push(sample));
        }
        Ok(Self { size: atlas.size, bands })
    }

    /// Takes steps towards the least squares.
    pub fn descend(&self, colors: &mut [Vec3], steps: usize, cancellation: &Cancellation) -> Result<(), Cancelled> {
        for _ in 0..steps {
            cancellation.check()?;
            let moves = smoothed(&self.moves(colors), self.size as usize);
            colors.par_iter_mut().zip(&moves).for_each(|(color, step)| {
                if step.w > 1e-12 {
                    *color = (*color + RELAXATION * step.truncate() / step.w).clamp(Vec3::ZERO, Vec3::ONE);
                }
            });
        }
        Ok(())
    }

    /// For each texel the weighted sum of what its pixels lack, and the sum of the weights.
    fn moves(&self, colors: &[Vec3]) -> Vec<Vec4> {
        let row = self.size as usize;
        let rows = BAND as usize * row;
        let mut moves = vec![Vec4::ZERO; colors.len()];
        // A band reaches into the first row of the next one: even bands first, then odd ones, each with a row more.
        for parity in 0..2 {
            let mut rest = moves.as_mut_slice();
            let mut parts = Vec::new();
            if parity == 1 {
                rest = rest.get_mut(rows..).unwrap_or_default();
            }
            let mut band = parity;
            while band < self.bands.len() {
                let length = rest.len().min(2 * rows);
                let (part, after) = rest.split_at_mut(length);
                parts.push((band, part));
                rest = after;
                band += 2;
            }
            parts.into_par_iter().for_each(|(band, part)| {
                let first = band * rows;
                for sample in &self.bands[band] {
                    let lack = sample.color - sample.value(colors, self.size);
                    let (texels, weights) = sample.corners(self.size);
                    for (texel, weight) in texels.into_iter().zip(weights) {
                        part[texel - first] += sample.weight * weight * lack.extend(1.0);
                    }
                }
            });
        }
        moves
    }
}

/// The share of a step that is taken; SIRT converges below 2.
const RELAXATION: f32 = 1.5;

/// Means with the neighbours' by the binomial `1 2 1`, in both directions: a texel between pixels moves with them.
fn smoothed(moves: &[Vec4], size: usize) -> Vec<Vec4> {
    let along = |moves: &[Vec4], stride: usize, position: fn(usize, usize) -> usize| -> Vec<Vec4> {
        let at = |i: usize| {
            let place = position(i, size);
            let before = if place > 0 { moves[i - stride] } else { Vec4::ZERO };
            let after = if place + 1 < size { moves[i + stride] } else { Vec4::ZERO };
            before + 2.0 * moves[i] + after
        };
        (0..moves.len()).into_par_iter().map(at).collect()
    };
    let across = along(moves, 1, |i, size| i % size);
    along(&across, size, |i, size| i / size)
}

fn samples_of(mesh: &Mesh, normals: &[Vec3], atlas: &Atlas, photograph: &Photograph) -> Vec<Sample> {
    let buffer = &photograph.buffer;
    let mut samples = Vec::new();
    for v in 0..buffer.height {
        for u in 0..buffer.width {
            let face = buffer.face(u, v);
            if face != NOTHING {
                samples.extend(sample_at(mesh, normals, atlas, photograph, face, buffer.pixel(u, v)));
            }
        }
    }
    samples
}

fn sample_at(
    mesh: &Mesh,
    normals: &[Vec3],
    atlas: &Atlas,
    photograph: &Photograph,
    face: u32,
    pixel: Vec2,
) -> Option<Sample> {
    let (points, directions) = corners(mesh, normals, face);
    let weights = photograph.buffer.barycentric(pixel, points)?;
    let (point, normal) = (blend(points, weights), blend(directions, weights).normalize_or_zero());
    let sight = photograph.sight(point, normal)?;
    if !photograph.is_open(&sight) {
        return None;
    }
    let color = photograph.color(pixel)?;
    let [a, b, c] = atlas.corners[face as usize];
    let place = a * weights[0] + b * weights[1] + c * weights[2];
    let at = dvr_core::Bilinear::at_single(place, (atlas.size, atlas.size))?;
    let (u, v) = at.pixels[0];
    let texel = v * atlas.size + u;
    Some(Sample { texel, fraction: at.fraction, color, weight: sight.quality })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels on a texture of 80x80 texels whose colours are linear in the place.
    fn samples() -> Samples {
        let mut bands = vec![Vec::new(); 3];
        for i in 0..20_000u32 {
            // Two irrational steps cover the square evenly.
            let place = Vec2::new((i as f32 * 0.618_034).fract(), (i as f32 * 0.754_878).fract()) * 78.0 + 0.5;
            let at = dvr_core::Bilinear::at_single(place, (80, 80)).unwrap();
            let (u, v) = at.pixels[0];
            let color = Vec3::new(place.x, place.y, 40.0) / 80.0;
            bands[(v / BAND) as usize].push(Sample { texel: v * 80 + u, fraction: at.fraction, color, weight: 1.0 });
        }
        Samples { size: 80, bands }
    }

    fn error(samples: &Samples, colors: &[Vec3]) -> f32 {
        let of = |sample: &Sample| sample.value(colors, 80).distance_squared(sample.color);
        samples.bands.iter().flatten().map(of).sum()
    }

    #[test]
    fn steps_come_to_texels_that_give_back_the_pixels() {
        let samples = samples();
        let mut colors = vec![Vec3::splat(0.5); 80 * 80];
        let before = error(&samples, &colors);
        samples.descend(&mut colors, 1, &Cancellation::default()).unwrap();
        let once = error(&samples, &colors);
        samples.descend(&mut colors, 20, &Cancellation::default()).unwrap();
        let after = error(&samples, &colors);
        assert!(once < 0.3 * before && after < 1e-3 * before, "{before} {once} {after}");
    }

    #[test]
    fn the_number_of_threads_does_not_change_a_bit() {
        let of_threads = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut colors = vec![Vec3::splat(0.5); 80 * 80];
            pool.install(|| samples().descend(&mut colors, 3, &Cancellation::default())).unwrap();
            colors
        };
        assert_eq!(of_threads(1), of_threads(5));
    }
}
