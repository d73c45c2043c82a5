//! A finished field on grids, kept on a device to be rendered.

use burn::tensor::Device;
use cubecl::prelude::*;
use dvr_core::voxel::VoxelGrid;

use super::dense::dense;
use super::launch::{groups, units};
use super::look::{self, RAY_COLUMNS, SHADED_COLUMNS};
use super::occupancy;
use super::traversal::{RegionLaunch, region};
use crate::active::ActiveNodes;
use crate::field::GridField;
use crate::occupancy::SurfaceCells;
use dvr_gpu::DeviceError;
use dvr_gpu::rows_at_once;
use dvr_gpu::{Buffer, Buffers};

/// An occupancy logit and three channels of colour, each interpolated between the nodes of a grid, on a device. Rays
/// meet its surface exactly, as they do in training.
///
/// Each answer is waited for. Questions of any size are asked in pieces.
pub struct GpuGridView {
    buffers: Buffers,
    values: Buffer,
    marks: Buffer,
    colors: Buffer,
    /// The box of cells that the surface is in.
    region: [[u32; 3]; 2],
    nodes: [u32; 2],
    half_extent: [f32; 2],
}

impl GpuGridView {
    /// Brings a field to a device.
    ///
    /// # Errors
    /// When it is no GPU, or the field is too large for it.
    pub fn new(device: &Device, field: &GridField) -> Result<Self, DeviceError> {
        let buffers = Buffers::on(device)?;
        let grids = [field.shape_grid(), field.color().grid()];
        let nodes = grids[0].nodes();
        let values = dense(&buffers, field.shape())?;
        let inside = occupancy::signs_of(&buffers, &values, nodes)?;
        let marks = occupancy::marks_of(&buffers, nodes)?;
        occupancy::update(&buffers, &inside, &marks, nodes);
        let colors = dense(&buffers, field.color())?;
        // Found out now, not at the first question.
        buffers.check(
            "rays to look at it",
            (RAY_COLUMNS + SHADED_COLUMNS) * rows_at_once(4 * (RAY_COLUMNS + SHADED_COLUMNS) as u64),
        )?;
        Ok(Self {
            values,
            colors,
            marks,
            region: region(field.occupancy().range(), &ActiveNodes::none(grids[0])),
            nodes: grids.map(|grid| grid.nodes() as u32),
            half_extent: grids.map(VoxelGrid::half_extent),
            buffers,
        })
    }

    /// What each ray (origin, direction) sees: ray depth, sRGB colour and outward normal; the depth is below zero where
    /// that is nothing.
    ///
    /// # Errors
    /// When the device fails.
    pub fn shade(&self, rays: &[[f32; RAY_COLUMNS]]) -> Result<Vec<[f32; SHADED_COLUMNS]>, DeviceError> {
        self.in_pieces("rays", rays, |client, groups, cube, rays, shaded, count| {
            look::shade::launch(
                client,
                groups,
                cube,
                rays,
                self.values.clone().into_buffer_arg(),
                self.marks.clone().into_buffer_arg(),
                self.colors.clone().into_buffer_arg(),
                shaded,
                RegionLaunch::of(self.nodes[0], self.half_extent[0], self.region),
                self.nodes[1],
                self.half_extent[1],
                count,
            );
        })
    }

    /// Occupancy logits at points.
    ///
    /// # Errors
    /// When the device fails.
    pub fn logits(&self, points: &[[f32; 3]]) -> Result<Vec<f32>, DeviceError> {
        Ok(self.values_at::<1>(points)?.into_flattened())
    }

    /// Gradients of the occupancy logit at points.
    ///
    /// # Errors
    /// When the device fails.
    pub fn gradients(&self, points: &[[f32; 3]]) -> Result<Vec<[f32; 3]>, DeviceError> {
        self.values_at(points)
    }

    /// sRGB colours at points, each with the direction that it is seen along; zero for no direction in particular.
    ///
    /// # Errors
    /// When the device fails.
    pub fn colors(&self, points: &[[f32; RAY_COLUMNS]]) -> Result<Vec<[f32; 3]>, DeviceError> {
        self.in_pieces("points", points, |client, groups, cube, points, found, count| {
            let colors = self.colors.clone().into_buffer_arg();
            look::colors_at::launch(
                client,
                groups,
                cube,
                points,
                colors,
                found,
                self.nodes[1],
                self.half_extent[1],
                count,
            );
        })
    }

    /// Logits, or with three columns their gradients.
    fn values_at<const C: usize>(&self, points: &[[f32; 3]]) -> Result<Vec<[f32; C]>, DeviceError> {
        self.in_pieces("points", points, |client, groups, cube, points, found, count| {
            let values = self.values.clone().into_buffer_arg();
            look::values_at::launch(
                client,
                groups,
                cube,
                points,
                values,
                found,
                self.nodes[0],
                self.half_extent[0],
                count,
                C == 3,
            );
        })
    }

    /// Asks in pieces: `launch` is given a piece's rows of `I` numbers, room for rows of `O`, and their number.
    fn in_pieces<const I: usize, const O: usize>(
        &self,
        what: &'static str,
        rows: &[[f32; I]],
        launch: impl Fn(&Client, CubeCount, CubeDim, BufferArg, BufferArg, u32),
    ) -> Result<Vec<[f32; O]>, DeviceError> {
        let client = &self.buffers.client;
        let mut answers = Vec::with_capacity(rows.len());
        for piece in rows.chunks(rows_at_once(4 * (I + O) as u64)) {
            let asked = self.buffers.floats(what, piece.as_flattened().to_vec())?;
            let found = self.buffers.zero_floats(what, O * piece.len())?;
            let (groups, cube) = (groups(client, piece.len()), units());
            launch(client, groups, cube, asked.into_buffer_arg(), found.clone().into_buffer_arg(), piece.len() as u32);
            let words = self.buffers.read(&[&found])?.into_iter().flatten();
            let numbers: Vec<f32> = words.map(f32::from_bits).collect();
            answers.extend_from_slice(numbers.as_chunks().0);
        }
        Ok(answers)
    }
}
