//! Where concavities are that no outline shows: photographs compared at many depths behind the visual hull.
//!
//! Gradients of colour lead to a match that is a pixel or two away. The inside of a bowl, which the hull closes, lies ten
//! or twenty pixels behind its start. So before training, patches of some pixels of every view are carried to planes at
//! depths from where their rays enter the hull to where they leave it (plane sweeping: Collins 1996; compared with the
//! best of the other views alone, since some do not see in: Kang, Szeliski and Chai 2001). Where one depth matches and
//! no other does, what lies before it is empty. Nodes of a coarse grid that several views say this of are carved
//! away; training finds the surface from there.

use dvr_core::voxel::VoxelGrid;
use dvr_core::{Bilinear, Cancellation, Cancelled};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::patch::CenteredPatch;
use crate::views::TrainingView;

/// Half the side of the patches that are compared, pixels of the shrunk pictures.
const HALF: usize = 1;

/// Samples of a patch.
const SAMPLES: usize = (2 * HALF + 1) * (2 * HALF + 1);

/// Numbers that a patch consists of.
const VALUES: usize = 3 * SAMPLES;

/// Variance of colour below which a patch shows nothing to compare.
const MIN_VARIANCE: f32 = 4e-4;

/// Correlation from which two patches show the same: low, since their plane is not that of the surface.
const ALIKE: f32 = 0.5;

/// By how much the best depth must correlate better than all that are not beside it.
const LEAD: f32 = 0.05;

/// Other views that a patch is looked for in.
const LOOKED_IN: usize = 5;

/// Views that must see through a node, and how many times as many as see it solid: highlights match behind the surface
/// that they shine on.
const SEE_THROUGH: (usize, usize) = (2, 3);

/// Views below which two that match by chance are too many.
const MIN_VIEWS: usize = 6;

/// What is carved out of the hull, as a distance-like value at the nodes of a coarse grid: negative where nothing is.
pub(crate) struct SpaceCarving {
    grid: VoxelGrid,
    values: Vec<f32>,
}

impl SpaceCarving {
    /// Sweeps about this many pixels, spread evenly over the views; `hull` holds the hull's distance at the nodes of
    /// `grid`, positive inside. `None` where nothing is carved, and where there are few views.
    ///
    /// # Errors
    /// [`Cancelled`] where somebody wants it to end.
    pub fn sweep(
        views: &[TrainingView],
        grid: &VoxelGrid,
        hull: &[f32],
        pixels: usize,
        cancellation: &Cancellation,
    ) -> Result<Option<Self>, Cancelled> {
        if views.len() < MIN_VIEWS {
            return Ok(None);
        }
        let pictures: Vec<Shrunk> = views.par_iter().map(|view| Shrunk::new(view, 0.5 * grid.spacing())).collect();
        let objects: usize = pictures.iter().map(|picture| picture.object_pixels()).sum();
        let stride = ((objects as f64 / pixels.max(1) as f64).sqrt().ceil() as usize).max(1);
        cancellation.check()?;
        let sweep = Sweep { views, pictures: &pictures, grid, hull, cancellation };
        let depths: Vec<DepthGrid> = (0..views.len()).into_par_iter().map(|view| sweep.depths(view, stride)).collect();
        cancellation.check()?;
        let is_empty: Vec<bool> = (0..grid.len())
            .into_par_iter()
            .map(|node| hull[node] > 0.0 && sweep.is_seen_through(&depths, grid.position(node)))
            .collect();
        let carved = reachable(grid, hull, &is_empty);
        Ok(carved.contains(&true).then(|| Self { grid: *grid, values: smoothed(grid, &carved) }))
    }

    /// The value at a point; large where nothing is carved nearby.
    pub fn at(&self, point: Vec3) -> f32 {
        self.grid.value(&self.values, point)
    }
}

/// A photograph in pixels about as large as candidates of depth are apart; no numbers off the object.
struct Shrunk {
    width: usize,
    height: usize,
    /// Pixels of the photograph along the side of one of these.
    factor: usize,
    colors: Vec<Vec3>,
}

impl Shrunk {
    fn new(view: &TrainingView, footprint: f32) -> Self {
        let factor = ((footprint / view.camera.footprint()) as usize).max(1);
        let [width, height] = view.size().map(|side| side as usize / factor);
        let mean = |x: usize, y: usize| {
            let pixels = (0..factor * factor).map(|i| (x * factor + i % factor, y * factor + i / factor));
            let sum = pixels.map(|(u, v)| view.object_color(u as u32, v as u32)).sum::<Option<Vec3>>();
            sum.map_or(Vec3::NAN, |sum| sum / (factor * factor) as f32)
        };
        let colors = (0..width * height).map(|i| mean(i % width, i / width)).collect();
        Self { width, height, factor, colors }
    }

    fn object_pixels(&self) -> usize {
        self.colors.iter().filter(|color| !color.is_nan()).count()
    }

    /// A pixel's middle in the photograph's own pixels.
    fn middle(&self, x: usize, y: usize) -> Vec2 {
        self.factor as f32 * Vec2::new(x as f32 + 0.5, y as f32 + 0.5)
    }

    /// Interpolated colour at a place in the photograph's own pixels; no numbers at the outline and beyond.
    fn sample(&self, pixel: Vec2) -> Vec3 {
        let size = (self.width as u32, self.height as u32);
        match Bilinear::at_single(pixel / self.factor as f32, size) {
            Some(at) => at.value(at.pixels.map(|(x, y)| self.colors[y as usize * self.width + x as usize])),
            None => Vec3::NAN,
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
fn color_patch(sample: impl Fn(usize) -> Vec3) -> Option<ColorPatch> {
    let mut colors: [Vec3; SAMPLES] = std::array::from_fn(sample);
    let mean = colors.iter().sum::<Vec3>() / SAMPLES as f32;
    colors.iter_mut().for_each(|color| *color -= mean);
    let patch = CenteredPatch::of_centered(std::array::from_fn(|i| colors[i / 3][i % 3]));
    patch.variance.is_finite().then_some(patch)
}

/// Z-depths that a view is sure of, one in `stride` by `stride` pixels of its shrunk picture; no number elsewhere.
struct DepthGrid {
    width: usize,
    stride: usize,
    depths: Vec<f32>,
}

impl DepthGrid {
    /// The depth nearest to a place in the shrunk picture.
    fn near(&self, pixel: Vec2) -> Option<f32> {
        if !(pixel.x >= 0.0 && pixel.y >= 0.0) {
            return None;
        }
        let (x, y) = (pixel.x as usize / self.stride, pixel.y as usize / self.stride);
        if x >= self.width {
            return None;
        }
        self.depths.get(y * self.width + x).copied().filter(|depth| !depth.is_nan())
    }
}

struct Sweep<'a> {
    views: &'a [TrainingView<'a>],
    pictures: &'a [Shrunk],
    grid: &'a VoxelGrid,
    hull: &'a [f32],
    cancellation: &'a Cancellation,
}

impl Sweep<'_> {
    /// The depths that a view is sure of.
    fn depths(&self, view: usize, stride: usize) -> DepthGrid {
        let picture = &self.pictures[view];
        let (width, height) = (picture.width.div_ceil(stride), picture.height.div_ceil(stride));
        let middle = |i: usize, side: usize| (i * stride + stride / 2).min(side - 1);
        let depth = |i: usize| {
            let (x, y) = (middle(i % width, picture.width), middle(i / width, picture.height));
            self.depth(view, x, y).unwrap_or(f32::NAN)
        };
        DepthGrid { width, stride, depths: (0..width * height).map(depth).collect() }
    }

    /// The z-depth of a pixel, where one matches and no other.
    fn depth(&self, view: usize, x: usize, y: usize) -> Option<f32> {
        self.cancellation.check().ok()?;
        let (own, picture) = (&self.views[view], &self.pictures[view]);
        let patch = picture.patch(x, y).filter(|patch| patch.variance > MIN_VARIANCE)?;
        let step = 0.5 * self.grid.spacing();
        let [near, far] = self.inside(own.camera.center, own.camera.direction_through(picture.middle(x, y)), step)?;
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
    fn inside(&self, origin: Vec3, direction: Vec3, step: f32) -> Option<[f32; 2]> {
        let reach = self.grid.half_extent() * 3f32.sqrt();
        let toward = -origin.dot(direction) / direction.length_squared();
        let steps = (2.0 * reach / step) as usize;
        let depth = |k: usize| toward - reach / direction.length() + k as f32 * step;
        let is_inside = |k: &usize| {
            let point = origin + depth(*k) * direction;
            depth(*k) > 0.0
                && point.abs().max_element() < self.grid.half_extent()
                && self.grid.value(self.hull, point) > 0.0
        };
        let enters = (0..steps).find(is_inside)?;
        let leaves = (enters..steps).find(|k| !is_inside(k)).unwrap_or(steps);
        Some([depth(enters), depth(leaves)])
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
            let found = patch.correlation(&seen, 0.0);
            if found > best[0] {
                best = [found, best[0]];
            } else {
                best[1] = best[1].max(found);
            }
        }
        if best[1] > -1.0 { 0.5 * (best[0] + best[1]) } else { -1.0 }
    }

    /// Whether views are sure of something that lies behind a point, and few of something at it.
    fn is_seen_through(&self, depths: &[DepthGrid], point: Vec3) -> bool {
        let margin = self.grid.spacing();
        let (mut through, mut solid) = (0, 0);
        for ((view, picture), depths) in self.views.iter().zip(self.pictures).zip(depths) {
            let (pixel, z) = view.camera.project(point);
            let Some(depth) = depths.near(pixel / picture.factor as f32).filter(|_| z > 0.0) else { continue };
            through += usize::from(z < depth - margin);
            solid += usize::from((z - depth).abs() <= margin);
        }
        through >= SEE_THROUGH.0 && through > SEE_THROUGH.1 * solid
    }
}

/// The empty nodes of the hull that lead to the outside by others of their kind.
fn reachable(grid: &VoxelGrid, hull: &[f32], is_empty: &[bool]) -> Vec<bool> {
    let last = grid.nodes() - 1;
    let beside = |node: usize| {
        let at = grid.coordinates(node);
        (0..6).filter_map(move |i| {
            let mut next = at;
            next[i / 2] = if i % 2 == 0 { at[i / 2].checked_sub(1)? } else { at[i / 2] + 1 };
            (next[i / 2] <= last).then(|| grid.index(next))
        })
    };
    let mut carved = vec![false; grid.len()];
    let mut border: Vec<usize> =
        (0..grid.len()).filter(|&node| is_empty[node] && beside(node).any(|next| hull[next] <= 0.0)).collect();
    border.iter().for_each(|&node| carved[node] = true);
    while let Some(node) = border.pop() {
        for next in beside(node).filter(|&next| is_empty[next]) {
            if !std::mem::replace(&mut carved[next], true) {
                border.push(next);
            }
        }
    }
    carved
}

/// A value that passes through zero half way between what is carved and what is not, one spacing to both sides, and
/// is large farther in.
fn smoothed(grid: &VoxelGrid, carved: &[bool]) -> Vec<f32> {
    let (last, spacing) = (grid.nodes() - 1, grid.spacing());
    let around = |c: usize| c.saturating_sub(1)..=(c + 1).min(last);
    (0..grid.len())
        .into_par_iter()
        .map(|node| {
            let [x, y, z] = grid.coordinates(node);
            let (mut solid, mut all) = (0, 0);
            for (z, y) in around(z).flat_map(|z| around(y).map(move |y| (z, y))) {
                for x in around(x) {
                    solid += usize::from(!carved[grid.index([x, y, z])]);
                    all += 1;
                }
            }
            if solid == all { FAR * spacing } else { (2.0 * solid as f32 / all as f32 - 1.0) * spacing }
        })
        .collect()
}

/// Spacings that stand for far away from what is carved.
const FAR: f32 = 3.0;

#[cfg(test)]
mod tests {
    use dvr_core::dataset::{ReadOptions, read_scene};
    use dvr_stress::{axes, write_scene};
    use glam::{EulerRot, Quat};

    use crate::config::GridConfig;
    use crate::trainer::GridTrainer;

    use super::*;

    /// Values of the field that training starts from, in a bowl half as deep as wide: in its hollow, and in its floor.
    fn start(axis: &str, difficulty: f64, plane_sweep_pixels: usize) -> [f32; 2] {
        let case = axes().into_iter().find(|found| found.name == axis).and_then(|axis| axis.case(difficulty)).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let scene = write_scene(&case, "bowl", 0, folder.path()).unwrap();
        let scene = read_scene(&scene, &ReadOptions::default()).unwrap();
        let config = GridConfig { plane_sweep_pixels, ..GridConfig::default() };
        let trainer = GridTrainer::new(scene.views.iter().collect(), Vec::new(), config).unwrap();
        let field = trainer.field().unwrap();
        // The bowl's axis is y, turned like this; its rim is at .18, its floor between -.18 and -.1.
        let turn = Quat::from_euler(EulerRot::XYZ, 0.5, 0.3, 0.2);
        let shape = field.shape();
        [0.06, -0.15].map(|y| shape.grid.value(&shape.values, turn * Vec3::new(0.0, y, 0.0)))
    }

    #[test]
    fn the_inside_of_a_bowl_is_carved_where_photographs_show_it_and_nowhere_else() {
        let [hollow, floor] = start("texture-contrast", 1.0, 0);
        assert!(hollow > 0.0 && floor > 0.0, "the hull closes the bowl: {hollow}");
        let [hollow, floor] = start("texture-contrast", 1.0, 15_000);
        assert!(hollow < 0.0 && floor > 0.0, "{hollow} in the hollow, {floor} in the floor");
        let [hollow, _] = start("texture-contrast", 0.0, 15_000);
        assert!(hollow > 0.0, "without texture nothing is known: {hollow}");
    }
}
