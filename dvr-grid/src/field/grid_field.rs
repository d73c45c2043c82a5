//! A field on two grids, and what rays and points see of it.

use std::sync::Arc;

use dvr_core::Ray;
use dvr_core::voxel::VoxelGrid;
use dvr_render::extract::ScalarField;
use dvr_render::{Shaded, Shader};
use glam::Vec3;
use rayon::prelude::*;

use crate::bricks::{BrickOccupancy, BrickValues};
use crate::color::{self, CHANNELS, ColorSample};

/// Values at the nodes of a grid, the channels of a node side by side.
#[derive(Clone, Debug, PartialEq)]
pub struct GridValues {
    /// The nodes.
    pub grid: VoxelGrid,
    /// The values.
    pub values: Vec<f32>,
}

/// An object as two grids over the padded cube: the occupancy logit, in units of length (about the distance to the
/// surface, positive inside), and the colour, coarser, since fine colour would explain the pictures on a wrong surface.
///
/// Rays meet its surface exactly: see [`crate::OccupancyBitmask`].
/// A clone shares the values.
#[derive(Clone, Debug)]
pub struct GridField {
    shape: Arc<BrickValues<1>>,
    color: Arc<BrickValues<CHANNELS>>,
    occupancy: Arc<BrickOccupancy>,
}

impl GridField {
    /// A field from one shape value and three colour channels (sRGB in `[0, 1]`) per node.
    ///
    /// # Panics
    /// When the numbers of values and nodes do not agree.
    pub fn new(shape: GridValues, color: GridValues) -> Self {
        let shape = BrickValues::of_grid(&shape.grid, &shape.values);
        Self::of_bricks(shape, BrickValues::of_grid(&color.grid, &color.values))
    }

    /// A field of numbers in bricks.
    pub(crate) fn of_bricks(shape: BrickValues<1>, color: BrickValues<CHANNELS>) -> Self {
        let occupancy = BrickOccupancy::new(&shape);
        Self { shape: Arc::new(shape), color: Arc::new(color), occupancy: Arc::new(occupancy) }
    }

    /// The nodes of the occupancy.
    pub fn shape_grid(&self) -> &VoxelGrid {
        self.shape.grid()
    }

    /// The occupancy logit at a point.
    pub fn logit_at(&self, point: Vec3) -> f32 {
        self.shape.value(point)
    }

    /// The occupancy logit at a point and its gradient in space.
    pub fn logit_and_gradient_at(&self, point: Vec3) -> (f32, Vec3) {
        self.shape.value_and_gradient(point)
    }

    /// The occupancy at all nodes.
    pub fn dense_shape(&self) -> GridValues {
        GridValues { grid: *self.shape.grid(), values: self.shape.to_dense() }
    }

    /// The colour at all nodes.
    pub fn dense_color(&self) -> GridValues {
        GridValues { grid: *self.color.grid(), values: self.color.to_dense() }
    }

    /// Which cells may hold surface.
    pub(crate) fn occupancy(&self) -> &BrickOccupancy {
        &self.occupancy
    }

    /// The occupancy at the nodes.
    pub(crate) fn shape(&self) -> &BrickValues<1> {
        &self.shape
    }

    /// The colour at the nodes.
    pub(crate) fn color(&self) -> &BrickValues<CHANNELS> {
        &self.color
    }

    /// sRGB colour at a point that is seen along `direction` (a unit vector from the camera), or without a view.
    pub fn color_at(&self, point: Vec3, direction: Option<Vec3>) -> [f32; 3] {
        self.color_sample(point, Vec3::ZERO, direction).color.to_array().map(|c| c.clamp(0.0, 1.0))
    }

    fn color_sample(&self, point: Vec3, step: Vec3, direction: Option<Vec3>) -> ColorSample {
        color::sample(&self.color, &self.color.grid().locate(point), step, direction)
    }

    /// Colours at points; `directions` as in [`GridField::color_at`], one per point.
    pub(super) fn colors_at(&self, points: &[Vec3], directions: Option<&[Vec3]>) -> Vec<[f32; 3]> {
        let color = |i: usize| self.color_at(points[i], directions.map(|directions| directions[i]));
        (0..points.len()).into_par_iter().with_min_len(512).map(color).collect()
    }

    /// Derivative of the colour along `step`, seen along `direction`; zero where the colour is clamped.
    pub(super) fn color_slope(&self, point: Vec3, step: Vec3, direction: Option<Vec3>) -> [f32; 3] {
        let ColorSample { color, derivative } = self.color_sample(point, step, direction);
        std::array::from_fn(|c| if (0.0..=1.0).contains(&color[c]) { derivative[c] } else { 0.0 })
    }

    /// Depth between `from` and `to` at which a ray first meets the surface from outside; `None` where it does not, and
    /// where it starts inside.
    pub(super) fn first_crossing(&self, origin: Vec3, direction: Vec3, from: f32, to: f32) -> Option<f32> {
        self.occupancy.first_crossing(&self.shape, origin, direction, from, to)
    }

    fn shade_ray(&self, ray: &Ray) -> Option<Shaded> {
        let (origin, direction) = (ray.origin.as_vec3(), ray.direction.as_vec3());
        let depth = self.first_crossing(origin, direction, 0.0, f32::INFINITY)?;
        let point = origin + depth * direction;
        let (_, gradient) = self.shape.value_and_gradient(point);
        let color = self.color_at(point, Some(direction.normalize()));
        Some(Shaded { depth, color, normal: (-gradient).normalize_or_zero().to_array() })
    }
}

impl Shader for GridField {
    fn shade(&self, rays: &[Ray]) -> Vec<Option<Shaded>> {
        rays.par_iter().with_min_len(64).map(|ray| self.shade_ray(ray)).collect()
    }
}

impl ScalarField for GridField {
    fn logits(&self, points: &[Vec3]) -> Vec<f32> {
        let value = |p: &Vec3| self.shape.value(*p);
        points.par_iter().with_min_len(512).map(value).collect()
    }

    fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
        let gradient = |p: &Vec3| self.shape.value_and_gradient(*p).1;
        Some(points.par_iter().with_min_len(512).map(gradient).collect())
    }

    fn colors(&self, points: &[Vec3], _normals: &[Vec3], directions: Option<&[Vec3]>) -> Option<Vec<[f32; 3]>> {
        Some(self.colors_at(points, directions))
    }

    fn cells(&self) -> Option<usize> {
        Some(self.shape_grid().cells())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use dvr_core::Camera;
    use dvr_render::render_view;
    use glam::DVec3;

    use super::*;

    /// A ball of radius 0.3, coloured by position, with `nodes` nodes along an edge.
    pub(crate) fn ball(nodes: usize) -> GridField {
        let (fine, coarse) = (VoxelGrid::new(nodes, 0.55), VoxelGrid::new(17, 0.55));
        let shape = (0..fine.len()).map(|i| 0.3 - fine.position(i).length()).collect();
        let color = (0..coarse.len()).flat_map(|i| (coarse.position(i) + 0.5).to_array()).collect();
        GridField::new(GridValues { grid: fine, values: shape }, GridValues { grid: coarse, values: color })
    }

    #[test]
    fn a_ball_is_seen_where_it_is_in_its_colours() {
        let camera = Camera::look_at(32, 32, 50.0, DVec3::new(0.0, 0.0, -2.0), DVec3::ZERO, DVec3::Y);
        let field = ball(65);
        let picture = render_view(&field, &camera);
        assert!((picture.depth.get(16, 16) - 1.7).abs() < 1e-3);
        let normal = Vec3::from(picture.normal.get_pixel(16, 16).0);
        assert!((normal - Vec3::NEG_Z).length() < 0.1, "{normal}");
        let color = picture.color.get_pixel(16, 16).0;
        assert!((color[2] - 0.2).abs() < 1e-2 && (color[0] - 0.5).abs() < 2e-2, "{color:?}");
        assert!(!picture.mask.is_object(0, 0));
    }

    #[test]
    fn numbers_at_points_are_those_of_the_grid() {
        let field = ball(65);
        let points = [Vec3::new(0.1, 0.2, 0.05), Vec3::new(-0.3, 0.1, 0.2)];
        for ((point, logit), gradient) in
            points.iter().zip(field.logits(&points)).zip(field.gradients(&points).unwrap())
        {
            assert!((logit - (0.3 - point.length())).abs() < 1e-3);
            assert!((gradient + point.normalize()).length() < 0.1);
        }
    }
}
