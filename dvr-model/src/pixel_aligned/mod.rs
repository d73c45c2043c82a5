//! Features of pictures at points in space: where each point lies in the picture of its object.

mod looked_up;
mod plane;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use burn::tensor::{Device, Int, Tensor, TensorData};
use dvr_core::Camera;
use glam::Vec3;

use crate::host_function::is_on_host;
pub(crate) use plane::PicturePlane;

/// Depth below which a point is no longer in front of a camera.
const NEAREST: f64 = 1e-3;

/// Planes of features of pictures of some objects, and the cameras of these pictures.
#[derive(Clone, Debug)]
pub(crate) struct PixelAligned {
    /// The planes' features, `[b * n * n, c]`, rows before columns.
    rows: Tensor<2>,
    /// Rows and columns of a plane, `n`.
    side: usize,
    /// Of each object: from points to places in its plane, a 3x4 matrix, rows one after the other, `[b, 12]`.
    projections: Tensor<2>,
    /// Of each object: the axes of its camera, rows one after the other, `[b, 9]`.
    axes: Tensor<2>,
}

/// What is known of points at once.
struct Place {
    /// From the middle of the column and row before to that after, from 0 to 1, `[n, 1]` each.
    share: [Tensor<2>; 2],
    /// Features of the four places around: upper left, upper right, lower left, lower right, `[n, c]`.
    around: [Tensor<2>; 4],
}

/// Points in homogeneous coordinates of the plane.
struct Projected {
    /// Columns and rows, `[n, 1]` each, not yet within the plane.
    place: [Tensor<2>; 2],
    /// Depth, `[n, 1]`, at least [`NEAREST`].
    depth: Tensor<2>,
    /// 1 where the depth is the point's own, 0 where it is too near.
    has_depth: Tensor<2>,
    /// The matrix of each point, `[n, 12]`.
    matrix: Tensor<2>,
}

impl PixelAligned {
    /// Of planes `[b, c, n, n]`; `index` takes places in pictures, from 0 to 1, to columns and rows (a factor and a shift).
    pub fn new(plane: Tensor<4>, index: [f64; 2], cameras: &[Camera], device: &Device) -> Self {
        let [objects, channels, side, _] = plane.dims();
        let rows = plane.permute([0, 2, 3, 1]).reshape([objects * side * side, channels]);
        let numbers = |of: &dyn Fn(&Camera) -> Vec<f32>, count: usize| {
            let values: Vec<f32> = cameras.iter().flat_map(of).collect();
            Tensor::<2>::from_data(TensorData::new(values, [cameras.len(), count]), device)
        };
        let projection = |camera: &Camera| -> Vec<f32> {
            let [factor, shift] = index;
            let size = [f64::from(camera.width), f64::from(camera.height)];
            let left = camera.intrinsics * camera.rotation;
            let right = camera.intrinsics * camera.translation;
            let row = |row: usize| left.row(row).extend(right[row]);
            let last = row(2);
            let rows = [0, 1].map(|axis| row(axis) * (factor / size[axis]) + last * shift);
            [rows[0], rows[1], last].iter().flat_map(|row| row.to_array()).map(|value| value as f32).collect()
        };
        let axes = |camera: &Camera| -> Vec<f32> {
            let rows = [0, 1, 2].map(|row| camera.rotation.row(row));
            rows.iter().flat_map(|row| row.to_array()).map(|value| value as f32).collect()
        };
        Self { rows, side, projections: numbers(&projection, 12), axes: numbers(&axes, 9) }
    }

    /// The same off the graph.
    pub fn inner(&self) -> Self {
        Self {
            rows: self.rows.clone().inner(),
            side: self.side,
            projections: as_inner(&self.projections),
            axes: as_inner(&self.axes),
        }
    }

    /// Features `[n, c]` of points `[n, 3]` of objects `[n]`; beyond the picture's edge, those at the edge.
    pub fn at(&self, points: &Tensor<2>, object: &Tensor<1, Int>) -> Tensor<2> {
        let place = self.place(&self.project(points, object), object);
        place.features()
    }

    /// The same for training by many points, which are constants: on the CPU in less time, and the same but for rounding.
    pub fn at_constants(&self, points: &Tensor<2>, object: &Tensor<1, Int>) -> Tensor<2> {
        if is_on_host(&self.rows) { looked_up::looked_up(self, points, object) } else { self.at(points, object) }
    }

    /// The same, object by object, off the tensors.
    pub fn picture_planes(&self) -> Vec<PicturePlane> {
        let channels = self.rows.dims()[1];
        let features: Vec<f32> = self.rows.clone().into_data().iter::<f32>().collect();
        let axes: Vec<f32> = self.axes.clone().into_data().iter::<f32>().collect();
        let planes = features.chunks(self.side * self.side * channels).zip(self.host_projections());
        let planes = planes.zip(axes.chunks(9)).map(|((features, projection), axes)| PicturePlane {
            features: Arc::from(features),
            channels,
            projection,
            axes: [0, 3, 6].map(|row| Vec3::from_slice(&axes[row..])),
        });
        planes.collect()
    }

    /// Features `[n, c]` and their derivatives along directions `[n, 3]`.
    pub fn tangents(
        &self,
        points: &Tensor<2>,
        object: &Tensor<1, Int>,
        directions: &[Tensor<2>],
    ) -> (Tensor<2>, Vec<Tensor<2>>) {
        let projected = self.project(points, object);
        let place = self.place(&projected, object);
        let [x, y] = place.share.clone();
        let [a, b, c, d] = place.around.clone();
        // Along columns and along rows.
        let by_x = (b.clone() - a.clone()) * (y.clone().neg() + 1.0) + (d.clone() - c.clone()) * y;
        let by_y = (c - a) * (x.clone().neg() + 1.0) + (d - b) * x;
        let inside = [0, 1].map(|axis| {
            let at = projected.place[axis].clone();
            at.clone().greater_elem(0.0).float() * at.lower_elem((self.side - 1) as f64).float()
        });
        let along = |direction: &Tensor<2>| {
            let moved = [0, 1, 2].map(|row| dot(&projected.matrix, row, direction));
            let [dx, dy] = [0, 1].map(|axis| {
                let nearer = projected.place[axis].clone() * moved[2].clone() * projected.has_depth.clone();
                let at = moved[axis].clone() - nearer;
                at / projected.depth.clone() * inside[axis].clone()
            });
            by_x.clone() * dx + by_y.clone() * dy
        };
        (place.features(), directions.iter().map(along).collect())
    }

    /// Points or directions `[n, 3]` in the axes of their objects' cameras.
    pub fn in_camera_axes(&self, points: &Tensor<2>, object: &Tensor<1, Int>) -> Tensor<2> {
        let axes = self.axes.clone().select(0, object.clone());
        let row = |row: usize| (axes.clone().narrow(1, 3 * row, 3) * points.clone()).sum_dim(1);
        Tensor::cat(vec![row(0), row(1), row(2)], 1)
    }

    fn project(&self, points: &Tensor<2>, object: &Tensor<1, Int>) -> Projected {
        let matrix = self.projections.clone().select(0, object.clone());
        let [x, y, depth] = [0, 1, 2].map(|row| dot(&matrix, row, points) + matrix.clone().narrow(1, 4 * row + 3, 1));
        let has_depth = depth.clone().greater_elem(NEAREST).float();
        let depth = depth.clamp_min(NEAREST);
        Projected { place: [x / depth.clone(), y / depth.clone()], depth, has_depth, matrix }
    }

    fn place(&self, projected: &Projected, object: &Tensor<1, Int>) -> Place {
        let last = (self.side - 1) as f64;
        let [x, y] = projected.place.clone().map(|at| at.clamp(0.0, last));
        // The last but one is the last that has another after it.
        let [left, up] = [&x, &y].map(|at| at.clone().detach().floor().clamp(0.0, (last - 1.0).max(0.0)));
        let share = [x - left.clone(), y - up.clone()];
        let side = self.side as i64;
        let first = object.clone() * (side * side) + (up * side as f64 + left).int().squeeze_dim(1);
        let next = if self.side > 1 { [1, side, side + 1] } else { [0; 3] };
        let row = |shift: i64| self.rows.clone().select(0, first.clone() + shift);
        Place { share, around: [row(0), row(next[0]), row(next[1]), row(next[2])] }
    }
}

impl Place {
    fn features(&self) -> Tensor<2> {
        let [x, y] = self.share.clone();
        let [a, b, c, d] = self.around.clone();
        let upper = a.clone() + (b - a) * x.clone();
        let lower = c.clone() + (d - c) * x;
        upper.clone() + (lower - upper) * y
    }
}

/// Row `row` of 3x4 matrices `[n, 12]`, without the last column, times vectors `[n, 3]`: `[n, 1]`.
fn dot(matrix: &Tensor<2>, row: usize, vectors: &Tensor<2>) -> Tensor<2> {
    (matrix.clone().narrow(1, 4 * row, 3) * vectors.clone()).sum_dim(1)
}

fn as_inner(constant: &Tensor<2>) -> Tensor<2> {
    if constant.device().is_autodiff() { constant.clone().inner() } else { constant.clone() }
}
