//! What one ray says of the field: losses and their analytic gradients, at one point of the field at most.

use dvr_core::voxel::{Cell, VoxelTraversal};
use dvr_render::SlopeRule;
use glam::Vec3;

use crate::bricks::BrickValues;
use crate::color::{self, CHANNELS};
use crate::losses::term::{Comparison, SurfaceGradient, SurfaceHit};
use crate::losses::{GridLosses, LossSums};
use crate::step::draw::compared;
use crate::surface::{Surface, SurfacePoint};
use crate::views::{PixelRay, TrainingView};

/// The gradient that a ray sends to the field, at one point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayGradient {
    /// Where, in the shape grid and in the colour grid.
    pub shape_cell: Cell,
    pub color_cell: Cell,
    /// By the shape's value there.
    pub grad_value: f32,
    /// By the numbers of the colour there.
    pub grad_color: [f32; CHANNELS],
}

/// The field and the photographs, as rays see them during one step.
pub(crate) struct RayContext<'a> {
    pub views: &'a [TrainingView<'a>],
    pub surface: Surface<'a>,
    pub colors: &'a BrickValues<CHANNELS>,
    pub losses: &'a GridLosses,
    pub compared_views: usize,
    pub slope_rule: SlopeRule,
}

impl<'a> RayContext<'a> {
    /// The gradient of a pixel's ray; `seed` chooses the views that it is compared with.
    pub fn ray_gradient(&self, pixel: &PixelRay, seed: u64, sums: &mut LossSums) -> Option<RayGradient> {
        let origin = self.views[pixel.view as usize].camera.center;
        let hit = self.surface.depth(origin, pixel.direction);
        sums.union += usize::from(pixel.object || hit.is_some());
        sums.intersection += usize::from(pixel.object && hit.is_some());
        match (pixel.object, hit) {
            (true, Some(depth)) => Some(self.surface_gradient(pixel, origin, depth, seed, sums)),
            (true, None) => self.silhouette_gradient(pixel, origin, 0.0, -1.0, sums),
            (false, Some(depth)) => self.silhouette_gradient(pixel, origin, depth, 1.0, sums),
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
        let at = self.surface.at(point);
        let color_cell = self.colors.grid().locate(point);
        let viewing = Some(direction.normalize());
        let color = color::sample(self.colors, &color_cell, direction, viewing);
        let hit = SurfaceHit { pixel, origin, depth, point, inward: at.inward, color };

        let mut found = SurfaceGradient::default();
        self.losses.appearance(&hit, &mut found, sums);
        if self.losses.has_cross_view() {
            let own = &self.views[pixel.view as usize];
            let sum = self.losses.cross_view(own, &hit, self.comparisons(own, &at, direction, seed), sums);
            found.grad_depth += sum / self.compared_views as f32;
        }
        self.losses.geometry(&hit, &mut found, sums);

        // The implicit function theorem: how the depth of the hit depends on the value there.
        let scale = at.gradient.length().max(1e-6) * direction.length();
        let inverse_slope = self.slope_rule.inverse_slope_of(at.gradient.dot(direction), scale);
        let grad_color = color::channel_gradient(found.grad_color, viewing);
        RayGradient { shape_cell: at.cell, color_cell, grad_value: -found.grad_depth * inverse_slope, grad_color }
    }

    /// The other views of a hit that face its surface and see it.
    fn comparisons(
        &self,
        own: &'a TrainingView<'a>,
        at: &SurfacePoint,
        direction: Vec3,
        seed: u64,
    ) -> impl Iterator<Item = Comparison<'a>> {
        compared(&own.neighbours, self.compared_views, seed).filter_map(move |view| {
            let view = &self.views[view as usize];
            let seen = view.reproject(at.point, direction).filter(|_| self.surface.faces(at, view))?;
            self.surface.is_free_to(at, view).then_some(Comparison { view, seen })
        })
    }

    /// A ray that hits though its pixel shows background (`sign` 1), or misses though it shows the object (-1): the
    /// point of the largest value beyond `from` is pushed out, or in.
    fn silhouette_gradient(
        &self,
        pixel: &PixelRay,
        origin: Vec3,
        from: f32,
        sign: f32,
        sums: &mut LossSums,
    ) -> Option<RayGradient> {
        let (mut largest, mut at) = (f32::NEG_INFINITY, None);
        let Surface { grid, values, .. } = self.surface;
        for segment in VoxelTraversal::new(grid, origin, pixel.direction, from, f32::INFINITY)? {
            if values.layout().active_slot(segment.cell).is_none() {
                continue;
            }
            let point = origin + 0.5 * (segment.enter + segment.leave) * pixel.direction;
            let value = values.value(point);
            if value > largest {
                (largest, at) = (value, Some(point));
            }
        }
        let point = at?;
        Some(RayGradient {
            shape_cell: grid.locate(point),
            color_cell: self.colors.grid().locate(point),
            grad_value: self.losses.silhouette(largest, sign, sums),
            grad_color: [0.0; CHANNELS],
        })
    }
}
