//! What one ray teaches: losses and their gradients by hand, at most one point of the field a ray.

use dvr_core::View;
use dvr_kernels::rules::{CLEARANCE, MIN_COSINE};
use dvr_kernels::{Cell, Lattice, SignMap, Walk};
use dvr_render::SlopeRule;
use glam::Vec3;

use super::config::FastLosses;
use super::patch::Patch;
use super::views::{FastView, PixelRay, mix};

/// The gradient that a ray sends to the field, at one point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lesson {
    /// Where, in the shape lattice and in the colour lattice.
    pub shape_cell: Cell,
    pub color_cell: Cell,
    /// By the shape's value there.
    pub by_value: f32,
    /// By the colour there.
    pub by_color: Vec3,
}

/// Sums over the rays of a step, for logging.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Tally {
    pub color: f64,
    pub cross_view: f64,
    pub structure: f64,
    pub depth: f64,
    pub mask: f64,
    /// Rays that hit and show the object, that do either.
    pub intersection: usize,
    pub union: usize,
}

impl Tally {
    pub fn add(&mut self, other: &Self) {
        self.color += other.color;
        self.cross_view += other.cross_view;
        self.structure += other.structure;
        self.depth += other.depth;
        self.mask += other.mask;
        self.intersection += other.intersection;
        self.union += other.union;
    }
}

/// The field and the pictures, as rays see them during one step.
pub(super) struct Scene<'a> {
    pub views: &'a [FastView<'a>],
    pub shape: &'a Lattice,
    pub values: &'a [f32],
    pub active: &'a [bool],
    pub map: &'a SignMap,
    pub colors: &'a Lattice,
    pub color_values: &'a [f32],
    pub losses: &'a FastLosses,
    pub compared_views: usize,
}

impl Scene<'_> {
    /// What a pixel's ray teaches; `seed` chooses the views it is compared with.
    pub fn lesson(&self, pixel: &PixelRay, seed: u64, tally: &mut Tally) -> Option<Lesson> {
        let origin = self.views[pixel.view as usize].center;
        let hit = self.map.first_crossing(self.values, origin, pixel.direction, 0.0, f32::INFINITY);
        tally.union += usize::from(pixel.object || hit.is_some());
        tally.intersection += usize::from(pixel.object && hit.is_some());
        match (pixel.object, hit) {
            (true, Some(depth)) => Some(self.surface_lesson(pixel, origin, depth, seed, tally)),
            (true, None) => self.mask_lesson(pixel, origin, 0.0, -1.0, tally),
            (false, Some(depth)) => self.mask_lesson(pixel, origin, depth, 1.0, tally),
            (false, None) => None,
        }
    }

    /// An object pixel whose ray hits: colour, the same point in other views, depth.
    fn surface_lesson(&self, pixel: &PixelRay, origin: Vec3, depth: f32, seed: u64, tally: &mut Tally) -> Lesson {
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
        let mut by_depth = losses.color as f32 * sign.dot(along);
        let by_color = (losses.color + losses.texture) as f32 * sign;
        tally.color += f64::from(residual.abs().element_sum());

        if losses.cross_view > 0.0 || losses.structure > 0.0 {
            by_depth += self.cross_view(pixel, origin, point, gradient / steepness, seed, tally);
        }
        if losses.depth > 0.0 && pixel.z_depth.is_finite() {
            // Ray depth is z-depth; in space a step of it is as long as the direction.
            let error = depth - pixel.z_depth;
            let length = direction.length();
            by_depth += losses.depth as f32 * length * error.signum();
            tally.depth += f64::from(error.abs() * length);
        }

        // The implicit function theorem, scale-free at grazing rays.
        let inverse_slope =
            SlopeRule::default().inverse_slope_of(gradient.dot(direction), steepness * direction.length());
        Lesson { shape_cell, color_cell, by_value: -by_depth * inverse_slope, by_color }
    }

    /// How the disagreement with other views at `point` changes with the depth; mean over views.
    fn cross_view(
        &self,
        pixel: &PixelRay,
        origin: Vec3,
        point: Vec3,
        inward: Vec3,
        seed: u64,
        tally: &mut Tally,
    ) -> f32 {
        let own = &self.views[pixel.view as usize];
        let losses = self.losses;
        let patch = || Patch::on_plane(own, pixel.pixel, losses.structure_stride, origin, point, inward);
        let patch = if losses.structure > 0.0 && !own.neighbours.is_empty() { patch() } else { None };
        let mut by_depth = 0.0;
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
            if size < losses.cross_view_limit as f32 {
                tally.cross_view += f64::from(size);
                by_depth += losses.cross_view as f32 * residual.signum().dot(seen.derivative);
            }
            let structure = patch.as_ref().and_then(|patch| patch.compare(view));
            if let Some(structure) = structure.filter(|s| s.correlation > losses.structure_limit as f32) {
                tally.structure += f64::from(1.0 - structure.correlation);
                by_depth -= losses.structure as f32 * structure.derivative;
            }
        }
        by_depth / self.compared_views as f32
    }

    /// A ray that hits though its pixel shows background (`sign` 1), or misses though it shows the object (-1): the
    /// point of the largest value beyond `from` is pushed out, or in.
    fn mask_lesson(&self, pixel: &PixelRay, origin: Vec3, from: f32, sign: f32, tally: &mut Tally) -> Option<Lesson> {
        let (mut largest, mut at) = (f32::NEG_INFINITY, None);
        let plane = self.shape.nodes() * self.shape.nodes();
        for segment in Walk::new(self.shape, origin, pixel.direction, from, f32::INFINITY)? {
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
        tally.mask += f64::from(logit.max(0.0) + (-logit.abs()).exp().ln_1p());
        Some(Lesson {
            shape_cell: self.shape.locate(point),
            color_cell: self.colors.locate(point),
            by_value: self.losses.mask as f32 * sign * sharpness * probability,
            by_color: Vec3::ZERO,
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
pub(super) fn compared(neighbours: &[u32], count: usize, seed: u64) -> impl Iterator<Item = u32> {
    let first = mix(seed) as usize;
    (0..count.min(neighbours.len())).map(move |k| {
        // Different views: the second is so many places after the first.
        let step = if k == 0 { 0 } else { 1 + (mix(seed ^ k as u64) as usize) % (neighbours.len() - 1) };
        neighbours[(first + step) % neighbours.len()]
    })
}

/// Mean colour of the object's pixels, where colours start.
pub(super) fn mean_object_color(views: &[&View]) -> Vec3 {
    let (mut sum, mut count) = (glam::DVec3::ZERO, 0usize);
    for view in views {
        for (_, _, pixel) in view.image.enumerate_pixels().filter(|(u, v, _)| view.mask.is_object(*u, *v)) {
            sum += glam::DVec3::from(pixel.0.map(f64::from)) / 255.0;
            count += 1;
        }
    }
    (sum / count.max(1) as f64).as_vec3()
}

#[cfg(test)]
#[path = "rays_tests.rs"]
pub(super) mod tests;
