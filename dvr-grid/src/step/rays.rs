//! What one ray teaches: losses and their gradients by hand, at most one point of the field a ray.

use crate::constants::{CLEARANCE, MIN_COSINE};
use crate::occupancy::OccupancyBitmask;
use dvr_core::View;
use dvr_core::voxel::{Cell, VoxelGrid, VoxelTraversal};
use dvr_render::SlopeRule;
use glam::Vec3;

use crate::config::GridLosses;
use crate::losses::patch::Patch;
use crate::views::{PixelRay, TrainingView, mix};

/// The gradient that a ray sends to the field, at one point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayGradient {
    /// Where, in the shape grid and in the colour grid.
    pub shape_cell: Cell,
    pub color_cell: Cell,
    /// By the shape's value there.
    pub grad_value: f32,
    /// By the colour there.
    pub grad_color: Vec3,
}

/// Sums over the rays of a step, for logging.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct LossSums {
    pub color: f64,
    pub photo_consistency: f64,
    pub patch_ncc: f64,
    pub depth: f64,
    pub mask: f64,
    /// Rays that hit and show the object, that do either.
    pub intersection: usize,
    pub union: usize,
}

impl LossSums {
    pub fn add(&mut self, other: &Self) {
        self.color += other.color;
        self.photo_consistency += other.photo_consistency;
        self.patch_ncc += other.patch_ncc;
        self.depth += other.depth;
        self.mask += other.mask;
        self.intersection += other.intersection;
        self.union += other.union;
    }
}

/// The field and the pictures, as rays see them during one step.
pub(crate) struct Scene<'a> {
    pub views: &'a [TrainingView<'a>],
    pub shape: &'a VoxelGrid,
    pub values: &'a [f32],
    pub active: &'a [bool],
    pub map: &'a OccupancyBitmask,
    pub colors: &'a VoxelGrid,
    pub color_values: &'a [f32],
    pub losses: &'a GridLosses,
    pub compared_views: usize,
}

impl Scene<'_> {
    /// What a pixel's ray teaches; `seed` chooses the views it is compared with.
    pub fn ray_gradient(&self, pixel: &PixelRay, seed: u64, sums: &mut LossSums) -> Option<RayGradient> {
        let origin = self.views[pixel.view as usize].center;
        let hit = self.map.first_crossing(self.values, origin, pixel.direction, 0.0, f32::INFINITY);
        sums.union += usize::from(pixel.object || hit.is_some());
        sums.intersection += usize::from(pixel.object && hit.is_some());
        match (pixel.object, hit) {
            (true, Some(depth)) => Some(self.surface_gradient(pixel, origin, depth, seed, sums)),
            (true, None) => self.mask_gradient(pixel, origin, 0.0, -1.0, sums),
            (false, Some(depth)) => self.mask_gradient(pixel, origin, depth, 1.0, sums),
            (false, None) => None,
        }
    }

    /// An object pixel whose ray hits: colour, the same point in other views, depth.
    fn surface_gradient(
        &self,
        pixel: &PixelRay,
        origin: Vec3,
        depth: f32,
        seed: u64,
        sums: &mut LossSums,
    ) -> RayGradient {
        let direction = pixel.direction;
        let point = origin + depth * direction;
        let shape_cell = self.shape.locate(point);
        let (_, gradient) = shape_cell.value_and_gradient(&self.shape.corners(self.values, shape_cell.node));
        let gradient = gradient / self.shape.spacing();
        let steepness = gradient.length().max(1e-6);
        let losses = self.losses;

        let color_cell = self.colors.locate(point);
        let (color, along) = self.color_and_derivative(&color_cell, direction);
        let residual = color - pixel.color;
        let sign = residual.signum();
        let mut grad_depth = losses.color as f32 * sign.dot(along);
        let grad_color = (losses.color + losses.texture) as f32 * sign;
        sums.color += f64::from(residual.abs().element_sum());

        if losses.photo_consistency > 0.0 || losses.patch_ncc > 0.0 {
            grad_depth += self.photo_consistency(pixel, origin, point, gradient / steepness, seed, sums);
        }
        if losses.depth > 0.0 && pixel.z_depth.is_finite() {
            // Ray depth is z-depth; in space a step of it is as long as the direction.
            let error = depth - pixel.z_depth;
            let length = direction.length();
            grad_depth += losses.depth as f32 * length * error.signum();
            sums.depth += f64::from(error.abs() * length);
        }

        // The implicit function theorem, scale-free at grazing rays.
        let inverse_slope =
            SlopeRule::default().inverse_slope_of(gradient.dot(direction), steepness * direction.length());
        RayGradient { shape_cell, color_cell, grad_value: -grad_depth * inverse_slope, grad_color }
    }

    /// How the disagreement with other views at `point` changes with the depth; mean over views.
    fn photo_consistency(
        &self,
        pixel: &PixelRay,
        origin: Vec3,
        point: Vec3,
        inward: Vec3,
        seed: u64,
        sums: &mut LossSums,
    ) -> f32 {
        let own = &self.views[pixel.view as usize];
        let losses = self.losses;
        let patch = || Patch::on_plane(own, pixel.pixel, losses.patch_stride, origin, point, inward);
        let patch = if losses.patch_ncc > 0.0 && !own.neighbours.is_empty() { patch() } else { None };
        let mut grad_depth = 0.0;
        for view in compared(&own.neighbours, self.compared_views, seed) {
            let view = &self.views[view as usize];
            let to_view = view.center - point;
            let distance = to_view.length();
            if -inward.dot(to_view) < MIN_COSINE * distance {
                continue;
            }
            let Some(seen) = view.reproject(point, pixel.direction) else { continue };
            let clearance = CLEARANCE * self.shape.spacing() / distance;
            if self.map.first_crossing(self.values, point, to_view, clearance, 1.0).is_some() {
                continue;
            }
            let residual = seen.color - pixel.color;
            let size = residual.abs().element_sum();
            if size < losses.photo_consistency_limit as f32 {
                sums.photo_consistency += f64::from(size);
                grad_depth += losses.photo_consistency as f32 * residual.signum().dot(seen.derivative);
            }
            let patch_ncc = patch.as_ref().and_then(|patch| patch.compare(view));
            if let Some(patch_ncc) = patch_ncc.filter(|s| s.correlation > losses.patch_ncc_min as f32) {
                sums.patch_ncc += f64::from(1.0 - patch_ncc.correlation);
                grad_depth -= losses.patch_ncc as f32 * patch_ncc.derivative;
            }
        }
        grad_depth / self.compared_views as f32
    }

    /// A ray that hits though its pixel shows background (`sign` 1), or misses though it shows the object (-1): the
    /// point of the largest value beyond `from` is pushed out, or in.
    fn mask_gradient(
        &self,
        pixel: &PixelRay,
        origin: Vec3,
        from: f32,
        sign: f32,
        sums: &mut LossSums,
    ) -> Option<RayGradient> {
        let (mut largest, mut at) = (f32::NEG_INFINITY, None);
        let plane = self.shape.nodes() * self.shape.nodes();
        for segment in VoxelTraversal::new(self.shape, origin, pixel.direction, from, f32::INFINITY)? {
            let [x, y, z] = segment.cell;
            let node = z * plane + y * self.shape.nodes() + x;
            if !self.active[node] {
                continue;
            }
            let point = origin + 0.5 * (segment.enter + segment.leave) * pixel.direction;
            let value = self.shape.value(self.values, point);
            if value > largest {
                (largest, at) = (value, Some(point));
            }
        }
        let point = at?;
        let sharpness = self.losses.sharpness as f32;
        let logit = sign * sharpness * largest;
        // softplus(logit) and its derivative.
        let probability = 1.0 / (1.0 + (-logit).exp());
        sums.mask += f64::from(logit.max(0.0) + (-logit.abs()).exp().ln_1p());
        Some(RayGradient {
            shape_cell: self.shape.locate(point),
            color_cell: self.colors.locate(point),
            grad_value: self.losses.mask as f32 * sign * sharpness * probability,
            grad_color: Vec3::ZERO,
        })
    }

    /// Colour in a cell, and its derivative along a direction in space.
    fn color_and_derivative(&self, cell: &Cell, direction: Vec3) -> (Vec3, Vec3) {
        let slopes = cell.gradient_weights(direction / self.colors.spacing());
        let (mut color, mut along) = (Vec3::ZERO, Vec3::ZERO);
        for ((weight, slope), offset) in cell.weights().into_iter().zip(slopes).zip(self.colors.corner_offsets()) {
            let node = Vec3::from_slice(&self.color_values[3 * (cell.node + offset)..]);
            color += weight * node;
            along += slope * node;
        }
        (color, along)
    }
}

/// The views that a ray is compared with: at most `count` of the neighbours, as `seed` chooses.
pub(crate) fn compared(neighbours: &[u32], count: usize, seed: u64) -> impl Iterator<Item = u32> {
    let first = mix(seed) as usize;
    (0..count.min(neighbours.len())).map(move |k| {
        // Different views: the second is so many places after the first.
        let step = if k == 0 { 0 } else { 1 + (mix(seed ^ k as u64) as usize) % (neighbours.len() - 1) };
        neighbours[(first + step) % neighbours.len()]
    })
}

/// Mean colour of the object's pixels, where colours start.
pub(crate) fn mean_object_color(views: &[&View]) -> Vec3 {
    let (mut sum, mut count) = (glam::DVec3::ZERO, 0usize);
    for view in views {
        for (_, _, pixel) in view.image.enumerate_pixels().filter(|(u, v, _)| view.is_training_object(*u, *v)) {
            sum += glam::DVec3::from(pixel.0.map(f64::from)) / 255.0;
            count += 1;
        }
    }
    (sum / count.max(1) as f64).as_vec3()
}

#[cfg(test)]
#[path = "rays_tests.rs"]
pub(crate) mod tests;
