//! The coefficients that photographs tell: ridge regression over their pixels, by conjugate gradients.
//!
//! `min over a of sum over pixels |r - sum w_n Y_k a_nk|^2 + RIDGE |a|^2`, with `r` what a photograph shows beside the
//! colour that the surface has for all directions. The ridge is what makes it mean something where few directions see
//! the surface: the least change that explains them.

use dvr_core::voxel::VoxelGrid;
use dvr_core::{Cancellation, Cancelled, Mask, UnitCube, View};
use glam::Vec3;
use rayon::prelude::*;

use super::harmonics::{TERMS, harmonics};
use super::{NONE, ViewColor};
use crate::shade::Shader;

/// Cells along an edge of the grid.
const CELLS: usize = 32;

/// Pixels of all photographs together, at most about.
const PIXELS: usize = 200_000;

/// How many pixels the wish for no change counts as.
const RIDGE: f32 = 1.5;

/// Steps of conjugate gradients: what more of them change is below the levels of a pixel.
const STEPS: usize = 25;

/// Parts of the pixels that are summed one after the other: their number must not depend on that of the threads.
const PARTS: usize = 16;

/// Rays that are shaded before anybody is asked whether to go on.
const BATCH: usize = 1 << 15;

/// One pixel.
struct Sample {
    /// The nodes around its point, at first as the grid counts them, then by their coefficients.
    corners: [u32; 8],
    weights: [f32; 8],
    terms: [f32; TERMS],
    /// What the photograph shows beside the colour of the surface.
    change: Vec3,
}

/// A number of each channel for each coefficient.
type Coefficients = Vec<[Vec3; TERMS]>;

impl ViewColor {
    /// Fits what `shader` shows to photographs, at the mean exposure of the scene. `None` where they do not show the
    /// surface.
    ///
    /// # Errors
    /// [`Cancelled`] where somebody wants it to end.
    pub fn fit(shader: &dyn Shader, views: &[&View], cancellation: &Cancellation) -> Result<Option<Self>, Cancelled> {
        let grid = grid();
        let mut samples = samples(shader, views, &grid, cancellation)?;
        if samples.is_empty() {
            return Ok(None);
        }
        let mut slots = vec![NONE; grid.len()];
        samples.iter().flat_map(|sample| sample.corners).for_each(|node| slots[node as usize] = 0);
        let nodes: Vec<u32> = (0..grid.len() as u32).filter(|&node| slots[node as usize] != NONE).collect();
        (0..).zip(&nodes).for_each(|(slot, &node)| slots[node as usize] = slot);
        samples.iter_mut().flat_map(|sample| &mut sample.corners).for_each(|corner| *corner = slots[*corner as usize]);
        let coefficients = solve(&samples, nodes.len(), cancellation)?;
        Ok(Some(Self::new(grid, nodes, coefficients)))
    }
}

/// The nodes of the coefficients.
pub(super) fn grid() -> VoxelGrid {
    VoxelGrid::new(CELLS + 1, UnitCube::default().half_extent() as f32)
}

/// Pixels of the object and not of its outline, evenly spread over all photographs, that meet the surface.
fn samples<'v>(
    shader: &dyn Shader,
    views: &[&'v View],
    grid: &VoxelGrid,
    cancellation: &Cancellation,
) -> Result<Vec<Sample>, Cancelled> {
    let count: usize = views.par_iter().filter_map(|view| view.training_mask()).map(Mask::object_pixels).sum();
    // Odd, so that they do not all fall on a few columns.
    let stride = count.div_ceil(PIXELS).max(1) | 1;
    let of_view = |view: &&'v View| -> Vec<(&'v View, u32, u32)> {
        let (view, (width, height)) = (*view, view.image.dimensions());
        let shown = move |u: u32, v: u32| view.is_training_object(u, v);
        let inner = move |&(u, v): &(u32, u32)| (v - 1..=v + 1).all(|v| (u - 1..=u + 1).all(|u| shown(u, v)));
        let pixels = (1..height.saturating_sub(1)).flat_map(|v| (1..width.saturating_sub(1)).map(move |u| (u, v)));
        let spread = pixels.filter(|&(u, v)| shown(u, v)).step_by(stride);
        spread.filter(inner).map(|(u, v)| (view, u, v)).collect()
    };
    let pixels: Vec<_> = views.par_iter().map(of_view).collect::<Vec<_>>().concat();
    let mut samples = Vec::with_capacity(pixels.len());
    for pixels in pixels.chunks(BATCH) {
        cancellation.check()?;
        let rays: Vec<_> = pixels.iter().map(|&(view, u, v)| view.camera.pixel_ray(u, v)).collect();
        let shaded = shader.shade(&rays);
        for ((&(view, u, v), ray), shaded) in pixels.iter().zip(&rays).zip(shaded) {
            let Some(shaded) = shaded else { continue };
            let shown = Vec3::from(view.image.get_pixel(u, v).0.map(f32::from)) / 255.0;
            let cell = grid.locate(ray.at(f64::from(shaded.depth)).as_vec3());
            samples.push(Sample {
                corners: grid.corner_offsets().map(|offset| (cell.node + offset) as u32),
                weights: cell.weights(),
                terms: harmonics(ray.direction.normalize().as_vec3()),
                change: view.exposure.unwrap_or_default().corrected(shown) - Vec3::from(shaded.color),
            });
        }
    }
    Ok(samples)
}

/// Conjugate gradients (Hestenes and Stiefel 1952) on the normal equations, each channel with steps of its own.
fn solve(samples: &[Sample], nodes: usize, cancellation: &Cancellation) -> Result<Coefficients, Cancelled> {
    let mut found = vec![[Vec3::ZERO; TERMS]; nodes];
    let mut rest = gathered(samples, nodes, |sample| sample.change);
    let mut along = rest.clone();
    let mut size = dot(&rest, &rest);
    for _ in 0..STEPS {
        cancellation.check()?;
        let mut image = gathered(samples, nodes, |sample| sample.value(&along));
        plus(&mut image, Vec3::splat(RIDGE), &along);
        let step = ratio(size, dot(&along, &image));
        plus(&mut found, step, &along);
        plus(&mut rest, -step, &image);
        let before = std::mem::replace(&mut size, dot(&rest, &rest));
        let share = ratio(size, before);
        along.as_flattened_mut().iter_mut().zip(rest.as_flattened()).for_each(|(along, rest)| {
            *along = *rest + share * *along;
        });
    }
    Ok(found)
}

impl Sample {
    /// What these coefficients make of the pixel.
    fn value(&self, coefficients: &Coefficients) -> Vec3 {
        let of_corner = |(&corner, &weight): (&u32, &f32)| {
            let by_term = self.terms.iter().zip(&coefficients[corner as usize]);
            weight * by_term.map(|(term, by)| *term * *by).sum::<Vec3>()
        };
        self.corners.iter().zip(&self.weights).map(of_corner).sum()
    }
}

/// The sum over pixels of what each has, times its share in each coefficient.
fn gathered(samples: &[Sample], nodes: usize, of: impl Fn(&Sample) -> Vec3 + Sync) -> Coefficients {
    let of_part = |samples: &[Sample]| {
        let mut sums = vec![[Vec3::ZERO; TERMS]; nodes];
        for sample in samples {
            let value = of(sample);
            let by_term = sample.terms.map(|term| term * value);
            for (&corner, &weight) in sample.corners.iter().zip(&sample.weights) {
                sums[corner as usize].iter_mut().zip(by_term).for_each(|(sum, term)| *sum += weight * term);
            }
        }
        sums
    };
    let parts: Vec<Coefficients> = samples.par_chunks(samples.len().div_ceil(PARTS).max(1)).map(of_part).collect();
    parts.into_iter().fold(vec![[Vec3::ZERO; TERMS]; nodes], |mut sums, part| {
        plus(&mut sums, Vec3::ONE, &part);
        sums
    })
}

fn plus(to: &mut Coefficients, times: Vec3, other: &Coefficients) {
    to.as_flattened_mut().iter_mut().zip(other.as_flattened()).for_each(|(to, other)| *to += times * *other);
}

fn dot(a: &Coefficients, b: &Coefficients) -> Vec3 {
    a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| *a * *b).sum()
}

/// Zero where there is nothing left to divide.
fn ratio(above: Vec3, below: Vec3) -> Vec3 {
    Vec3::select(below.cmpgt(Vec3::splat(f32::MIN_POSITIVE)), above / below, Vec3::ZERO)
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::shapes;
    use dvr_core::{Camera, Exposure, Ray, stored};
    use glam::DVec3;
    use image::{GrayImage, Luma, Rgb, RgbImage};

    use super::*;
    use crate::{MeshShader, Shaded, view_metrics};

    /// A mesh whose colour follows from the unit vectors along which it is seen, and to which it is turned.
    struct Painted<'a>(MeshShader<'a>, fn(Vec3, Vec3) -> [f32; 3]);

    impl Shader for Painted<'_> {
        fn shade(&self, rays: &[Ray]) -> Vec<Option<Shaded>> {
            let painted = |(shaded, ray): (Option<Shaded>, &Ray)| {
                let direction = ray.direction.normalize().as_vec3();
                shaded.map(|shaded| Shaded { color: self.1(direction, shaded.normal.into()), ..shaded })
            };
            self.0.shade(rays).into_iter().zip(rays).map(painted).collect()
        }
    }

    /// Brighter where it is seen head-on, in one channel, and in another where it is seen from the right.
    fn shiny(direction: Vec3, normal: Vec3) -> [f32; 3] {
        [0.3 + 0.5 * direction.dot(normal).powi(2), 0.5 + 0.3 * direction.x, 0.4]
    }

    /// With a narrow stripe that turns with the camera.
    fn striped(direction: Vec3, normal: Vec3) -> [f32; 3] {
        let aside = direction.cross(Vec3::Y).normalize_or_zero().dot(normal);
        [0.3 + 0.5 * (-(aside / 0.15).powi(2)).exp(), 0.5, 0.4]
    }

    /// Photographs of what a shader shows, from all around.
    fn photographs(shader: &dyn Shader, turns: impl Iterator<Item = f64>, exposure: Exposure) -> Vec<View> {
        let view = |(i, turn): (usize, f64)| {
            let eye = 1.6 * DVec3::new(turn.sin(), 0.5 * (2.0 * turn).cos(), turn.cos());
            let camera = Camera::look_at(64, 64, 100.0, eye, DVec3::ZERO, DVec3::Y);
            let (mut image, mut mask) = (RgbImage::new(64, 64), GrayImage::new(64, 64));
            for (v, u) in (0..64).flat_map(|v| (0..64).map(move |u| (v, u))) {
                if let Some(shaded) = shader.shade(&[camera.pixel_ray(u, v)])[0] {
                    let shown = exposure.photographed(shaded.color);
                    image.put_pixel(u, v, Rgb(shown.map(|c| (255.0 * c).round() as u8)));
                    mask.put_pixel(u, v, Luma([255]));
                }
            }
            View { exposure: Some(exposure), ..View::new(format!("{i}"), camera, stored(image), Mask::from(mask)) }
        };
        turns.enumerate().map(view).collect()
    }

    #[test]
    fn what_depends_on_the_direction_is_found_also_for_directions_that_no_photograph_has() {
        let mut ball = shapes::icosphere(4, 0.3);
        ball.colors = Some(vec![[0.5; 3]; ball.vertices.len()]);
        let (plain, shining) = (MeshShader::new(&ball), Painted(MeshShader::new(&ball), shiny));
        let exposure = Exposure::from_logs([0.1, -0.1, 0.05]);
        let train = photographs(&shining, (0..16).map(|i| 0.39 * f64::from(i)), exposure);
        let test = photographs(&shining, (0..4).map(|i| 0.2 + 1.5 * f64::from(i)), Exposure::default());
        let (train, test): (Vec<&View>, Vec<&View>) = (train.iter().collect(), test.iter().collect());
        let of_threads = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| ViewColor::fit(&plain, &train, &Cancellation::default())).unwrap().unwrap()
        };
        let found = of_threads(1);
        assert_eq!(found, of_threads(3));
        let psnr = |shader: &dyn Shader| view_metrics(shader, &test, 20_000).unwrap().psnr;
        let (before, after) = (psnr(&plain), psnr(&found.on(&plain)));
        assert!(before < 25.0 && after > before + 6.0, "{before} dB and {after} dB");
        // Stored, it says the same but for rounding, and beyond the surface nothing.
        let stored = ViewColor::from_bytes(&found.to_bytes("").unwrap()).unwrap();
        let (point, direction) = (Vec3::new(0.0, 0.1, 0.28), Vec3::new(0.1, 0.2, -1.0));
        let color = Vec3::splat(0.5);
        assert!((stored.at(point, direction, color) - found.at(point, direction, color)).abs().max_element() < 1e-3);
        assert_eq!(found.at(Vec3::splat(0.5), direction, color), color);
        assert_eq!(found.at(Vec3::ZERO, direction, color), color);
    }

    #[test]
    fn what_changes_fast_with_the_direction_is_blended_from_photographs_nearby() {
        let mut ball = shapes::icosphere(4, 0.3);
        ball.colors = Some(vec![[0.5; 3]; ball.vertices.len()]);
        let (plain, stripes) = (MeshShader::new(&ball), Painted(MeshShader::new(&ball), striped));
        let exposure = Exposure::from_logs([0.1, -0.1, 0.05]);
        let train = photographs(&stripes, (0..32).map(|i| 0.196 * f64::from(i)), exposure);
        let test = photographs(&stripes, (0..4).map(|i| 0.1 + 1.568 * f64::from(i)), Exposure::default());
        let (seen, test): (Vec<&View>, Vec<&View>) = (train.iter().collect(), test.iter().collect());
        let cancellation = Cancellation::default();
        let slow = ViewColor::fit(&plain, &seen, &cancellation).unwrap().unwrap();
        let of_threads = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| slow.with_photographs(&plain, &seen, &cancellation)).unwrap().unwrap()
        };
        let found = of_threads(1);
        assert!(found == of_threads(3));
        assert!(
            found.with_photographs(&plain, &seen, &cancellation).unwrap() == Some(found.clone()),
            "in place of its own"
        );
        let psnr = |views: &[&View], color: &ViewColor| view_metrics(&color.on(&plain), views, 20_000).unwrap().psnr;
        let (before, after) = (psnr(&test, &slow), psnr(&test, &found));
        assert!(after > before + 3.0, "{before} dB and {after} dB");
        let stored = ViewColor::from_bytes(&found.to_bytes("").unwrap()).unwrap();
        assert!((psnr(&test, &stored) - after).abs() < 0.01);

        // Photographs from one side say nothing of the other.
        let front: Vec<&View> = seen[..4].to_vec();
        let one_sided = ViewColor::none().with_photographs(&plain, &front, &cancellation).unwrap().unwrap();
        let color = Vec3::splat(0.5);
        assert_eq!(one_sided.at(Vec3::new(0.0, 0.0, -0.3), Vec3::new(0.0, 0.1, -1.0), color), color);
        assert!(matches!(ViewColor::none().with_photographs(&plain, &[], &cancellation), Ok(None)));
        cancellation.cancel();
        assert!(slow.with_photographs(&plain, &seen, &cancellation).is_err());
    }

    #[test]
    fn where_photographs_do_not_show_the_surface_nothing_is_found() {
        let ball = shapes::icosphere(2, 0.3);
        let shader = MeshShader::new(&ball);
        let cancellation = Cancellation::default();
        assert!(matches!(ViewColor::fit(&shader, &[], &cancellation), Ok(None)));
        let camera = Camera::look_at(64, 64, 100.0, DVec3::Z, 2.0 * DVec3::Z, DVec3::Y);
        let mask = Mask::from(GrayImage::from_pixel(64, 64, Luma([255])));
        let away = View::new("away", camera, stored(RgbImage::new(64, 64)), mask);
        assert!(matches!(ViewColor::fit(&shader, &[&away], &cancellation), Ok(None)));
        assert!(matches!(ViewColor::none().with_photographs(&shader, &[&away], &cancellation), Ok(None)));
        cancellation.cancel();
        assert!(ViewColor::fit(&shader, &[&away], &cancellation).is_err());
    }
}
