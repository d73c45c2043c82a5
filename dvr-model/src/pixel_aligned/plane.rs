//! The plane of one picture on the host: what is looked up there point by point.

use std::sync::Arc;

use glam::Vec3;

use super::NEAREST;
use crate::mlp::PointFeatures;

/// Where a place lies among the columns and rows of a plane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    /// Column and row before it.
    first: [usize; 2],
    /// From the middle of these to that of the next, from 0 to 1.
    share: [f32; 2],
    /// How both change along each axis of space.
    slopes: [Vec3; 2],
}

/// From points in space to places in a plane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Projection {
    /// Rows of a 3x4 matrix.
    rows: [[f32; 4]; 3],
    /// Columns and rows of the plane.
    side: usize,
}

impl Projection {
    /// Of a matrix, rows one after the other.
    pub fn new(matrix: &[f32], side: usize) -> Self {
        Self { rows: [0, 1, 2].map(|row| [0, 1, 2, 3].map(|column| matrix[4 * row + column])), side }
    }

    /// As [`super::PixelAligned`] projects them: beyond the plane is its edge, and nothing is nearer than [`NEAREST`].
    pub fn cell(&self, point: Vec3) -> Cell {
        let last = (self.side - 1) as f32;
        let left = |row: usize| Vec3::from_slice(&self.rows[row][..3]);
        let [x, y, own_depth] = [0, 1, 2].map(|row| left(row).dot(point) + self.rows[row][3]);
        let depth = own_depth.max(NEAREST as f32);
        let along_depth = if own_depth > NEAREST as f32 { left(2) } else { Vec3::ZERO };
        let along = |axis: usize, at: f32| {
            let free = (left(axis) - at * along_depth) / depth;
            if at > 0.0 && at < last { free } else { Vec3::ZERO }
        };
        let at = [x / depth, y / depth];
        // A place that is no number is at the first: `max` hands out the other of the two.
        let within = at.map(|at| at.max(0.0).min(last));
        let first = within.map(|at| (at as usize).min(self.side.saturating_sub(2)));
        Cell {
            first,
            share: [0, 1].map(|axis| within[axis] - first[axis] as f32),
            slopes: [along(0, at[0]), along(1, at[1])],
        }
    }
}

impl Cell {
    /// The four places around it, by their numbers in the plane, and how much each counts.
    pub fn around(&self, side: usize) -> [(usize, f32); 4] {
        let ([column, row], [x, y]) = (self.first, self.share);
        let next = |at: usize| (at + 1).min(side - 1);
        [
            (row * side + column, (1.0 - x) * (1.0 - y)),
            (row * side + next(column), x * (1.0 - y)),
            (next(row) * side + column, (1.0 - x) * y),
            (next(row) * side + next(column), x * y),
        ]
    }

    /// How these weights change along an axis of space.
    fn weights_along(&self, axis: usize) -> [f32; 4] {
        let [x, y] = self.share;
        let [dx, dy] = self.slopes.map(|slope| slope[axis]);
        [-dx * (1.0 - y) - dy * (1.0 - x), dx * (1.0 - y) - dy * x, -dx * y + dy * (1.0 - x), dx * y + dy * x]
    }
}

/// The features of one picture's places, and its camera: what [`super::PixelAligned`] has of one object, off the tensors.
#[derive(Clone, Debug)]
pub(crate) struct PicturePlane {
    /// `[side * side, channels]`.
    pub(super) features: Arc<[f32]>,
    pub(super) channels: usize,
    pub(super) projection: Projection,
    /// The camera's axes.
    pub(super) axes: [Vec3; 3],
}

impl PointFeatures for PicturePlane {
    /// Features of the place, and the point in the camera's axes.
    fn count(&self) -> usize {
        self.channels + 3
    }

    fn write(&self, points: &[Vec3], width: usize, rows: &mut [f32]) {
        for (lane, point) in points.iter().enumerate() {
            let around = self.projection.cell(*point).around(self.projection.side);
            self.write_lane(around, lane, width, rows);
            for (axis, row) in self.axes.iter().enumerate() {
                rows[(self.channels + axis) * width + lane] = row.dot(*point);
            }
        }
    }

    fn write_tangents(&self, points: &[Vec3], axis: usize, width: usize, rows: &mut [f32]) {
        for (lane, point) in points.iter().enumerate() {
            let cell = self.projection.cell(*point);
            let (mut around, along) = (cell.around(self.projection.side), cell.weights_along(axis));
            around.iter_mut().zip(along).for_each(|((_, weight), along)| *weight = along);
            self.write_lane(around, lane, width, rows);
            for (row, of_camera) in self.axes.iter().enumerate() {
                rows[(self.channels + row) * width + lane] = of_camera[axis];
            }
        }
    }
}

impl PicturePlane {
    /// The weighted sum of four places, in the rows of one point.
    fn write_lane(&self, around: [(usize, f32); 4], lane: usize, width: usize, rows: &mut [f32]) {
        let [a, b, c, d] = around.map(|(place, _)| &self.features[place * self.channels..][..self.channels]);
        let [wa, wb, wc, wd] = around.map(|(_, weight)| weight);
        for (channel, (((a, b), c), d)) in a.iter().zip(b).zip(c).zip(d).enumerate() {
            rows[channel * width + lane] = wa * a + wb * b + wc * c + wd * d;
        }
    }
}
