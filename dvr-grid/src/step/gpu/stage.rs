//! What stays on the device from one growth of the grids to the next, and the kernels that need no rays.

use burn::tensor::IntDType;
use cubecl::prelude::*;

use dvr_gpu::{Buffer, Buffers, DeviceError};

use super::levels::GpuGrid;
use super::{gather, smoothness};
use crate::bricks::BrickOccupancy;
use crate::color::CHANNELS;
use crate::color::gpu::ChannelsLaunch;
use crate::gpu::launch::{UNITS, groups, units};
use crate::gpu::occupancy;
use crate::gpu::traversal::{RegionLaunch, region};
use crate::multires::Grids;
use crate::occupancy::SurfaceCells;

/// What holds from one growth of the grids to the next.
pub(crate) struct Stage {
    pub half_extent: f32,
    /// The box of cells that the surface may be in.
    region: [[u32; 3]; 2],
    pub shape: GpuGrid,
    pub color: GpuGrid,
    /// Which nodes are not negative, and which cells rays look at: a bit each.
    inside: Buffer,
    pub occupied: Buffer,
    /// Slopes of the smoothness, and its sum in each group of work-items.
    slopes: Buffer,
    pub smoothness: Buffer,
    /// The largest numbers of the last step's ray gradients as bits, and how many nodes are near the surface.
    pub most: Buffer,
}

impl Stage {
    /// Brings shape and colour to the device.
    pub fn new(buffers: &Buffers, grids: &Grids) -> Result<Self, DeviceError> {
        let Grids { shape, color } = grids;
        let (nodes, half_extent) = (shape.grid().nodes(), shape.grid().half_extent());
        let marked = BrickOccupancy::new(shape.values()).range();
        let region = region(marked, shape.active());
        let slots = shape.active().count();
        let (shape, color) = (GpuGrid::new(buffers, shape)?, GpuGrid::new(buffers, color)?);
        let stage = Self {
            half_extent,
            region,
            inside: occupancy::signs_of(buffers, &shape.finest().sums, nodes)?,
            occupied: occupancy::marks_of(buffers, nodes)?,
            shape,
            color,
            slopes: buffers.zero_floats("slopes of the smoothness", slots)?,
            smoothness: buffers.zero_floats("sums of the smoothness", slots.div_ceil(UNITS))?,
            most: buffers.zeros("bounds", 3, IntDType::U32)?,
        };
        stage.update_occupancy(buffers);
        Ok(stage)
    }

    /// Where rays look for the surface.
    pub fn region_arg(&self) -> RegionLaunch {
        RegionLaunch::of(self.shape.finest().nodes, self.half_extent, self.region)
    }

    /// From sums of ray gradients to gradients at the nodes. `rest` is the colour that nodes tend to, and how strongly;
    /// `steps` see [`gather`].
    pub fn gather(&self, client: &Client, rest: ([f32; CHANNELS], f32), steps: f32) {
        let (shape, color) = (self.shape.finest(), self.color.finest());
        gather::gather_shape::launch(
            client,
            groups(client, shape.count),
            units(),
            self.shape.ray_sums.clone().into_buffer_arg(),
            self.most.clone().into_buffer_arg(),
            shape.gradient.clone().into_buffer_arg(),
            shape.count as u32,
            steps,
        );
        let (rest, weight) = rest;
        gather::gather_color::launch(
            client,
            groups(client, color.count),
            units(),
            color.active.clone().into_buffer_arg(),
            color.sums.clone().into_buffer_arg(),
            self.color.ray_sums.clone().into_buffer_arg(),
            self.most.clone().into_buffer_arg(),
            color.gradient.clone().into_buffer_arg(),
            color.count as u32,
            ChannelsLaunch::of(rest),
            weight,
            steps,
        );
    }

    /// Adds the gradient of the smoothness.
    pub fn smooth(&self, client: &Client, weight: f32, knee: f32) {
        let shape = self.shape.finest();
        let spacing = 2.0 * self.half_extent / (shape.nodes - 1) as f32;
        smoothness::slopes::launch(
            client,
            groups(client, shape.count),
            units(),
            shape.active.clone().into_buffer_arg(),
            shape.sums.clone().into_buffer_arg(),
            self.most.clone().into_buffer_arg(),
            self.slopes.clone().into_buffer_arg(),
            self.smoothness.clone().into_buffer_arg(),
            shape.count as u32,
            shape.nodes,
            spacing,
            knee,
        );
        smoothness::add_gradient::launch(
            client,
            groups(client, shape.count),
            units(),
            shape.active.clone().into_buffer_arg(),
            shape.slots.clone().into_buffer_arg(),
            self.slopes.clone().into_buffer_arg(),
            self.most.clone().into_buffer_arg(),
            shape.gradient.clone().into_buffer_arg(),
            shape.count as u32,
            shape.nodes,
            spacing,
            weight,
        );
    }

    /// Brings the occupancy bitmask up to date with the values.
    pub fn update_occupancy(&self, buffers: &Buffers) {
        let (client, shape) = (&buffers.client, self.shape.finest());
        occupancy::sign::launch(
            client,
            groups(client, shape.count),
            units(),
            shape.active.clone().into_buffer_arg(),
            shape.sums.clone().into_buffer_arg(),
            self.inside.clone().into_buffer_arg(),
            shape.count as u32,
            shape.nodes,
        );
        occupancy::update(buffers, &self.inside, &self.occupied, shape.nodes as usize);
    }
}
