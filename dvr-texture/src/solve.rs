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

/// One pixel on the texture. There are as many as all photographs have together: fractions and colours take 16 bits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// The texel up and left of the place.
    texel: u32,
    weight: f32,
    /// How far the place is from it, to the right and down, in parts of [`u16::MAX`].
    fraction: [u16; 2],
    /// The colour, in parts of [`u16::MAX`].
    color: [u16; 3],
}

/// A number in `[0, 1]` as its nearest of 16 bits.
fn to_bits(value: f32) -> u16 {
    (value * f32::from(u16::MAX)).round() as u16
}

fn from_bits(bits: u16) -> f32 {
    f32::from(bits) / f32::from(u16::MAX)
}

impl Sample {
    fn new(texel: u32, fraction: [f32; 2], color: Vec3, weight: f32) -> Self {
        Self { texel, weight, fraction: fraction.map(to_bits), color: color.to_array().map(to_bits) }
    }

    fn color(&self) -> Vec3 {
        self.color.map(from_bits).into()
    }

    /// The four texels and their weights.
    #[inline]
    fn corners(&self, size: u32) -> ([usize; 4], [f32; 4]) {
        let (first, size) = (self.texel as usize, size as usize);
        let [s, t] = self.fraction.map(from_bits);
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
    photographs: Vec<BandedSamples>,
}

/// The samples of a photograph, those of the first band first.
#[derive(Clone)]
struct BandedSamples {
    samples: Vec<Sample>,
    /// Where each band begins, and where the last one ends.
    starts: Vec<usize>,
}

impl BandedSamples {
    /// Orders samples of a texture of this size by band; in each they stay in their order.
    fn new(samples: &[Sample], size: u32) -> Self {
        let band = |sample: &Sample| (sample.texel / size / BAND) as usize;
        let mut starts = vec![0; size.div_ceil(BAND) as usize + 1];
        samples.iter().for_each(|sample| starts[band(sample) + 1] += 1);
        (1..starts.len()).for_each(|i| starts[i] += starts[i - 1]);
        let Some(&first) = samples.first() else { return Self { samples: Vec::new(), starts } };
        let (mut ordered, mut next) = (vec![first; samples.len()], starts.clone());
        for sample in samples {
            let place = &mut next[band(sample)];
            ordered[*place] = *sample;
            *place += 1;
        }
        Self { samples: ordered, starts }
    }

    fn of_band(&self, band: usize) -> &[Sample] {
        &self.samples[self.starts[band]..self.starts[band + 1]]
    }
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
            Ok(BandedSamples::new(&samples_of(mesh, normals, atlas, photograph), atlas.size))
        };
        let photographs = photographs.par_iter().map(of_view).collect::<Result<_, Cancelled>>()?;
        Ok(Self { size: atlas.size, photographs })
    }

    /// Takes steps towards the least squares.
    pub fn descend(&self, colors: &mut [Vec3], steps: usize, cancellation: &Cancellation) -> Result<(), Cancelled> {
        let mut moves = vec![Vec4::ZERO; colors.len()];
        for _ in 0..steps {
            cancellation.check()?;
            self.find_moves(colors, &mut moves);
            smooth(&mut moves, self.size as usize);
            colors.par_iter_mut().zip(&moves).for_each(|(color, step)| {
                if step.w > 1e-12 {
                    *color = (*color + RELAXATION * step.truncate() / step.w).clamp(Vec3::ZERO, Vec3::ONE);
                }
            });
        }
        Ok(())
    }

    /// Finds for each texel the weighted sum of what its pixels lack, and the sum of the weights.
    fn find_moves(&self, colors: &[Vec3], moves: &mut [Vec4]) {
        let row = self.size as usize;
        let rows = BAND as usize * row;
        moves.par_iter_mut().for_each(|step| *step = Vec4::ZERO);
        // A band reaches into the first row of the next one: even bands first, then odd ones, each with a row more.
        for parity in 0..2 {
            let mut rest = &mut *moves;
            let mut parts = Vec::new();
            if parity == 1 {
                rest = rest.get_mut(rows..).unwrap_or_default();
            }
            let mut band = parity;
            while band < self.size.div_ceil(BAND) as usize {
                let length = rest.len().min(2 * rows);
                let (part, after) = rest.split_at_mut(length);
                parts.push((band, part));
                rest = after;
                band += 2;
            }
            parts.into_par_iter().for_each(|(band, part)| {
                let first = band * rows;
                for sample in self.photographs.iter().flat_map(|samples| samples.of_band(band)) {
                    let lack = sample.color() - sample.value(colors, self.size);
                    let (texels, weights) = sample.corners(self.size);
                    for (texel, weight) in texels.into_iter().zip(weights) {
                        part[texel - first] += sample.weight * weight * lack.extend(1.0);
                    }
                }
            });
        }
    }
}

/// The share of a step that is taken; SIRT converges below 2.
const RELAXATION: f32 = 1.5;

/// Sums with the neighbours' by the binomial `1 2 1`, in both directions: a texel between pixels moves with them. In
/// place, since a texture may take most of what memory there is.
fn smooth(moves: &mut [Vec4], size: usize) {
    moves.par_chunks_mut(size).for_each(|row| {
        let mut before = Vec4::ZERO;
        for i in 0..size {
            let (own, after) = (row[i], row.get(i + 1).copied().unwrap_or_default());
            row[i] = before + 2.0 * own + after;
            before = own;
        }
    });
    // Bands of rows, with copies of the rows beside them as they were.
    let rows = BAND as usize * size;
    let beside = |at: Option<usize>| {
        let row = at.and_then(|at| moves.get(at..at + size));
        row.map_or_else(|| vec![Vec4::ZERO; size], <[Vec4]>::to_vec)
    };
    let starts = (0..moves.len()).step_by(rows.max(1));
    let rims: Vec<[Vec<Vec4>; 2]> =
        starts.map(|start| [beside(start.checked_sub(size)), beside(Some(start + rows))]).collect();
    moves.par_chunks_mut(rows).zip(rims).for_each(|(band, [mut before, below])| {
        for start in (0..band.len()).step_by(size) {
            for (i, before) in before.iter_mut().enumerate() {
                let (own, after) = (band[start + i], band.get(start + size + i).copied().unwrap_or(below[i]));
                band[start + i] = *before + 2.0 * own + after;
                *before = own;
            }
        }
    });
}

fn samples_of(mesh: &Mesh, normals: &[Vec3], atlas: &Atlas, photograph: &Photograph) -> Vec<Sample> {
    let buffer = &photograph.buffer;
    let mut samples = Vec::with_capacity(buffer.seen_cells());
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
    Some(Sample::new(texel, at.fraction, color, sight.quality))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels on a texture of 80x80 texels whose colours are linear in the place.
    fn pixels() -> Vec<Sample> {
        let sample = |i: u32| {
            // Two irrational steps cover the square evenly.
            let place = Vec2::new((i as f32 * 0.618_034).fract(), (i as f32 * 0.754_878).fract()) * 78.0 + 0.5;
            let at = dvr_core::Bilinear::at_single(place, (80, 80)).unwrap();
            let (u, v) = at.pixels[0];
            let color = Vec3::new(place.x, place.y, 40.0) / 80.0;
            Sample::new(v * 80 + u, at.fraction, color, 1.0)
        };
        (0..20_000).map(sample).collect()
    }

    /// The same of three photographs, one of which shows nothing.
    fn samples() -> Samples {
        let all = pixels();
        let photographs = [&all[..12_000], &[], &all[12_000..]];
        Samples { size: 80, photographs: photographs.map(|samples| BandedSamples::new(samples, 80)).into() }
    }

    fn error(samples: &Samples, colors: &[Vec3]) -> f32 {
        let of = |sample: &Sample| sample.value(colors, 80).distance_squared(sample.color());
        samples.photographs.iter().flat_map(|banded| &banded.samples).map(of).sum()
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
    fn bands_have_their_pixels_in_the_order_of_the_photograph() {
        let all = pixels();
        let banded = BandedSamples::new(&all, 80);
        for band in 0..3 {
            let expected: Vec<&Sample> = all.iter().filter(|sample| sample.texel / 80 / BAND == band).collect();
            let found = banded.of_band(band as usize);
            let is_same = |(a, b): (&Sample, &&Sample)| a.texel == b.texel && a.fraction == b.fraction;
            assert!(found.len() == expected.len() && found.iter().zip(&expected).all(is_same), "band {band}");
            assert!(found.len() > 1000);
        }
        assert_eq!(banded.samples.len(), all.len());
    }

    #[test]
    fn smoothing_in_place_sums_nine_neighbours() {
        // More rows than a band has, and not a whole number of bands.
        let size = 80;
        let moves: Vec<Vec4> = (0..size * size).map(|i| Vec4::splat(((i * 7919) % 101) as f32)).collect();
        let mut smoothed = moves.clone();
        smooth(&mut smoothed, size);
        let at = |u: i32, v: i32| {
            let inside = (0..size as i32).contains(&u) && (0..size as i32).contains(&v);
            if inside { moves[v as usize * size + u as usize] } else { Vec4::ZERO }
        };
        for (i, found) in smoothed.iter().enumerate() {
            let (u, v) = ((i % size) as i32, (i / size) as i32);
            let binomial = [(-1, 1.0), (0, 2.0), (1, 1.0)];
            let along = |v: i32| -> Vec4 { binomial.iter().map(|&(k, weight)| weight * at(u + k, v)).sum() };
            let expected: Vec4 = binomial.iter().map(|&(k, weight)| weight * along(v + k)).sum();
            assert_eq!(*found, expected, "texel {u}, {v}");
        }
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
