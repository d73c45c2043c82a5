//! How deep pixels see into the visual hull: photographs compared at many depths behind it.
//!
//! Patches of pixels of every view are carried to planes at depths from where their rays enter the hull to where they
//! leave it (plane sweeping: Collins 1996; compared with the best of the other views alone, since some do not see in:
//! Kang, Szeliski and Chai 2001). Where one depth matches and no other does, the pixel has a depth.

use dvr_core::voxel::VoxelGrid;
use dvr_core::{Bilinear, Cancellation, Cancelled};
use glam::{Vec2, Vec3, Vec3A};
use rayon::prelude::*;

use crate::accelerator::Accelerator;
use crate::error::Result;
use crate::patch::CenteredPatch;
use crate::views::TrainingView;

/// Half the side of the patches that are compared, pixels of the shrunk pictures.
pub(super) const HALF: usize = 1;

/// Samples of a patch.
pub(super) const SAMPLES: usize = (2 * HALF + 1) * (2 * HALF + 1);

/// Numbers that a patch consists of.
pub(super) const VALUES: usize = 3 * SAMPLES;

/// Variance of colour below which a patch shows nothing to compare.
pub(super) const MIN_VARIANCE: f32 = 4e-4;

/// Correlation from which two patches show the same: low, since their plane is not that of the surface.
pub(super) const ALIKE: f32 = 0.5;

/// By how much the best depth must correlate better than all that are not beside it.
pub(super) const LEAD: f32 = 0.05;

/// Other views that a patch is looked for in.
pub(super) const LOOKED_IN: usize = 5;

/// A pixel that was looked at.
pub(super) struct SweptPixel {
    /// Of its ray, with a z of 1 in the camera's frame.
    pub direction: Vec3,
    /// Z-depth at which the ray enters the hull.
    pub near: f32,
    /// Z-depth of what the pixel shows, where it is known.
    pub depth: Option<f32>,
}

/// Photographs that are compared, and the hull that they are compared in.
pub(super) struct PlaneSweep<'a> {
    pub views: &'a [TrainingView<'a>],
    pub pictures: Vec<Shrunk>,
    pub grid: &'a VoxelGrid,
    cancellation: &'a Cancellation,
}

impl<'a> PlaneSweep<'a> {
    /// Shrinks the photographs to half the spacing of `grid`.
    pub fn new(views: &'a [TrainingView], grid: &'a VoxelGrid, cancellation: &'a Cancellation) -> Self {
        let pictures = views.par_iter().map(|view| Shrunk::new(view, 0.5 * grid.spacing())).collect();
        Self { views, pictures, grid, cancellation }
    }

    /// One pixel in this many by this many, so that about `pixels` are looked at.
    pub fn stride(&self, pixels: usize) -> usize {
        let objects: usize = self.pictures.iter().map(Shrunk::object_pixels).sum();
        ((objects as f64 / pixels.max(1) as f64).sqrt().ceil() as usize).max(1)
    }

    /// The pixels of every view whose rays enter the hull, one in `stride` by `stride`; `hull` holds the hull's distance
    /// at the nodes of the grid, positive inside. The accelerator looks at them, if it has room.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`] where somebody wants it to end, and when a GPU fails.
    pub fn depths(&self, hull: &[f32], stride: usize, accelerator: &mut Accelerator) -> Result<Vec<Vec<SweptPixel>>> {
        #[cfg(feature = "gpu")]
        {
            self.cancellation.check()?;
            if let Some(found) =
                accelerator.run("the plane sweep", |gpu| super::gpu::depths(gpu, self, hull, stride))?
            {
                return Ok(found);
            }
        }
        let _ = accelerator;
        let depths = (0..self.views.len()).into_par_iter().map(|view| self.depths_of(view, hull, stride));
        Ok(depths.collect::<std::result::Result<_, Cancelled>>()?)
    }

    fn depths_of(&self, view: usize, hull: &[f32], stride: usize) -> std::result::Result<Vec<SweptPixel>, Cancelled> {
        let mut found = Vec::new();
        for [x, y] in self.pixels(view, stride) {
            self.cancellation.check()?;
            found.extend(self.swept(view, hull, x, y));
        }
        Ok(found)
    }

    /// One pixel in `stride` by `stride` of a view's shrunk picture, where it shows the object.
    pub fn pixels(&self, view: usize, stride: usize) -> impl Iterator<Item = [usize; 2]> {
        let picture = &self.pictures[view];
        let along = move |side: usize| (0..side.div_ceil(stride)).map(move |i| (i * stride + stride / 2).min(side - 1));
        let all = along(picture.height).flat_map(move |y| along(picture.width).map(move |x| [x, y]));
        all.filter(|&[x, y]| !picture.colors[y * picture.width + x].is_nan())
    }

    /// A pixel; `None` where its ray misses the hull.
    fn swept(&self, view: usize, hull: &[f32], x: usize, y: usize) -> Option<SweptPixel> {
        let camera = &self.views[view].camera;
        let direction = camera.direction_through(self.pictures[view].middle(x, y));
        let step = self.step();
        let [near, far] = self.inside(hull, camera.center, direction, step)?;
        Some(SweptPixel { direction, near, depth: self.depth(view, x, y, near, far) })
    }

    /// The z-depth of a pixel, where one matches and no other.
    fn depth(&self, view: usize, x: usize, y: usize, near: f32, far: f32) -> Option<f32> {
        let (own, picture) = (&self.views[view], &self.pictures[view]);
        let patch = picture.patch(x, y).filter(|patch| patch.variance > MIN_VARIANCE)?;
        let step = self.step();
        let side = 2 * HALF + 1;
        let directions: [Vec3; SAMPLES] = std::array::from_fn(|i| {
            own.camera.direction_through(picture.middle(x + i % side - HALF, y + i / side - HALF))
        });
        let likeness: Vec<f32> = (0..=((far - near) / step) as usize)
            .map(|k| self.likeness(own, &patch, &directions, near + k as f32 * step))
            .collect();
        let best = (0..likeness.len()).max_by(|&a, &b| likeness[a].total_cmp(&likeness[b]))?;
        let is_beside = |k: usize| k.abs_diff(best) <= 2;
        let rival = (0..likeness.len()).filter(|&k| !is_beside(k)).map(|k| likeness[k]).fold(-1.0, f32::max);
        (likeness[best] > ALIKE && likeness[best] > rival + LEAD).then_some(near + best as f32 * step)
    }

    /// Where a ray enters the hull, and where it leaves it again.
    fn inside(&self, hull: &[f32], origin: Vec3, direction: Vec3, step: f32) -> Option<[f32; 2]> {
        let reach = self.reach();
        let toward = -origin.dot(direction) / direction.length_squared();
        let steps = self.steps();
        let depth = |k: usize| toward - reach / direction.length() + k as f32 * step;
        let is_inside = |k: &usize| {
            let point = origin + depth(*k) * direction;
            depth(*k) > 0.0 && point.abs().max_element() < self.grid.half_extent() && self.grid.value(hull, point) > 0.0
        };
        let enters = (0..steps).find(is_inside)?;
        let leaves = (enters..steps).find(|k| !is_inside(k)).unwrap_or(steps);
        Some([depth(enters), depth(leaves)])
    }

    /// From the cube's middle to its corner.
    pub fn reach(&self) -> f32 {
        self.grid.half_extent() * 3f32.sqrt()
    }

    /// Between the candidates of depth.
    pub fn step(&self) -> f32 {
        0.5 * self.grid.spacing()
    }

    /// Steps through the cube, from corner to corner.
    pub fn steps(&self) -> usize {
        (2.0 * self.reach() / self.step()) as usize
    }

    /// How well a patch on the plane at a depth matches what other views show there: the mean of the two best
    /// correlations, since most may not see in. -1 where fewer than two show it.
    fn likeness(&self, own: &TrainingView, patch: &ColorPatch, directions: &[Vec3; SAMPLES], depth: f32) -> f32 {
        let mut best = [-1f32; 2];
        for &other in own.neighbours.iter().take(LOOKED_IN) {
            let (view, picture) = (&self.views[other as usize], &self.pictures[other as usize]);
            let sample = |i: usize| picture.sample(view.camera.project(own.camera.center + depth * directions[i]).0);
            if sample(SAMPLES / 2).is_nan() {
                continue;
            }
            let Some(seen) = color_patch(sample) else { continue };
            let found = patch.correlation(&seen);
            if found > best[0] {
                best = [found, best[0]];
            } else {
                best[1] = best[1].max(found);
            }
        }
        if best[1] > -1.0 { 0.5 * (best[0] + best[1]) } else { -1.0 }
    }
}

/// A photograph in pixels about as large as candidates of depth are apart; no numbers off the object.
pub(super) struct Shrunk {
    pub width: usize,
    pub height: usize,
    /// Pixels of the photograph along the side of one of these.
    pub factor: usize,
    /// In vectors: they are interpolated at every depth.
    pub colors: Vec<Vec3A>,
}

impl Shrunk {
    fn new(view: &TrainingView, footprint: f32) -> Self {
        let factor = ((footprint / view.camera.footprint()) as usize).max(1);
        let [width, height] = view.size().map(|side| side as usize / factor);
        let mean = |x: usize, y: usize| {
            let pixels = (0..factor * factor).map(|i| (x * factor + i % factor, y * factor + i / factor));
            let sum = pixels.map(|(u, v)| view.object_color(u as u32, v as u32)).sum::<Option<Vec3>>();
            sum.map_or(Vec3A::NAN, |sum| (sum / (factor * factor) as f32).into())
        };
        let colors = (0..width * height).map(|i| mean(i % width, i / width)).collect();
        Self { width, height, factor, colors }
    }

    fn object_pixels(&self) -> usize {
        self.colors.iter().filter(|color| !color.is_nan()).count()
    }

    /// A pixel's middle in the photograph's own pixels.
    pub fn middle(&self, x: usize, y: usize) -> Vec2 {
        self.factor as f32 * Vec2::new(x as f32 + 0.5, y as f32 + 0.5)
    }

    /// Interpolated colour at a place in the photograph's own pixels; no numbers at the outline and beyond.
    #[inline]
    fn sample(&self, pixel: Vec2) -> Vec3A {
        let size = (self.width as u32, self.height as u32);
        match Bilinear::at_single(pixel / self.factor as f32, size) {
            Some(at) => at.value(at.pixels.map(|(x, y)| self.colors[y as usize * self.width + x as usize])),
            None => Vec3A::NAN,
        }
    }

    /// Colours around a pixel; `None` where not all of it is object.
    fn patch(&self, x: usize, y: usize) -> Option<ColorPatch> {
        if x < HALF || y < HALF || x + HALF >= self.width || y + HALF >= self.height {
            return None;
        }
        let side = 2 * HALF + 1;
        color_patch(|i| self.colors[(y + i / side - HALF) * self.width + x + i % side - HALF])
    }
}

/// Colours less the mean of each channel, side by side.
type ColorPatch = CenteredPatch<VALUES>;

/// `None` where one of the samples is no colour.
#[inline]
fn color_patch(sample: impl Fn(usize) -> Vec3A) -> Option<ColorPatch> {
    let mut colors = [Vec3A::ZERO; SAMPLES];
    for (i, color) in colors.iter_mut().enumerate() {
        *color = sample(i);
    }
    let mean = colors.iter().sum::<Vec3A>() / SAMPLES as f32;
    colors.iter_mut().for_each(|color| *color -= mean);
    let mut values = [0.0; VALUES];
    for (values, color) in values.as_chunks_mut::<3>().0.iter_mut().zip(colors) {
        *values = color.to_array();
    }
    let patch = CenteredPatch::of_centered(values);
    patch.variance.is_finite().then_some(patch)
}
