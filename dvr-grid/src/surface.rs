//! The surface of a grid as rays of photographs meet it: where they do, how it is turned there, and who else sees it.

use dvr_core::voxel::{Cell, VoxelGrid};
use glam::Vec3;

use crate::bricks::{BrickOccupancy, BrickValues};
use crate::constants::{CLEARANCE, MIN_COSINE};
use crate::views::TrainingView;

/// The zero level of values at the nodes of a grid, positive inside.
#[derive(Clone, Copy)]
pub(crate) struct Surface<'a> {
    pub grid: &'a VoxelGrid,
    pub values: &'a BrickValues<1>,
    pub occupancy: &'a BrickOccupancy,
}

/// Where a ray meets the surface.
pub(crate) struct SurfacePoint {
    pub point: Vec3,
    pub cell: Cell,
    /// Derivative of the values there.
    pub gradient: Vec3,
    /// Unit normal, towards the inside.
    pub inward: Vec3,
}

impl<'a> Surface<'a> {
    /// That of values; `occupancy` is made of them.
    pub fn of(values: &'a BrickValues<1>, occupancy: &'a BrickOccupancy) -> Self {
        Self { grid: values.grid(), values, occupancy }
    }

    /// Where the ray of a pixel meets it first.
    pub fn hit(&self, view: &TrainingView, direction: Vec3) -> Option<SurfacePoint> {
        let origin = view.camera.center;
        Some(self.at(origin + self.depth(origin, direction)? * direction))
    }

    /// Ray depth of the first crossing from a camera on.
    pub fn depth(&self, origin: Vec3, direction: Vec3) -> Option<f32> {
        self.occupancy.first_crossing(self.values, origin, direction, 0.0, f32::INFINITY)
    }

    /// The surface at a point of it.
    pub fn at(&self, point: Vec3) -> SurfacePoint {
        let cell = self.grid.locate(point);
        let (_, gradient) = cell.value_and_gradient(&self.values.cell(&cell));
        let gradient = gradient / self.grid.spacing();
        SurfacePoint { point, cell, gradient, inward: gradient / gradient.length().max(1e-6) }
    }

    /// Whether a point of the surface faces a camera, and nothing hides it.
    pub fn is_seen_by(&self, at: &SurfacePoint, view: &TrainingView) -> bool {
        self.faces(at, view) && self.is_free_to(at, view)
    }

    /// Whether a point of the surface faces a camera.
    pub fn faces(&self, at: &SurfacePoint, view: &TrainingView) -> bool {
        let to_view = view.camera.center - at.point;
        -at.inward.dot(to_view) >= MIN_COSINE * to_view.length()
    }

    /// Whether nothing of the surface lies between a point of it and a camera.
    pub fn is_free_to(&self, at: &SurfacePoint, view: &TrainingView) -> bool {
        let to_view = view.camera.center - at.point;
        let clearance = CLEARANCE * self.grid.spacing() / to_view.length();
        self.occupancy.first_crossing(self.values, at.point, to_view, clearance, 1.0).is_none()
    }
}
