//! What stays on the device from one growth of the grids to the next, and the kernels that need no rays.

use burn::tensor::IntDType;
use cubecl::prelude::*;

use dvr_gpu::{Buffer, Buffers, DeviceError};

use super::levels::GpuGrid;
use super::{gather, smoothness};
use crate::color::CHANNELS;
use crate::color::gpu::ChannelsLaunch;
use crate::gpu::launch::{UNITS, groups, units};
use crate::gpu::occupancy::{self, bits};
use crate::gpu::traversal::{RegionLaunch, region};
use crate::multires::Grids;

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
        let nodes = shape.grid().nodes();
        let active: Vec<u32> = shape.active().iter().map(|node| node as u32).collect();
        let values = shape.values().to_dense();
        let region = region(nodes, &active, &values);
        let (words, slots) = (nodes.div_ceil(32), active.len());
        let inside = buffers.words("signs of nodes", bits(nodes, &values))?;
        let stage = Self {
            half_extent: shape.grid().half_extent(),
            region,
            shape: GpuGrid::new(buffers, shape)?,
            color: GpuGrid::new(buffers, color)?,
            inside,
            occupied: buffers.zeros("occupied cells", words * (nodes - 1) * (nodes - 1), IntDType::U32)?,
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
        let cells = shape.nodes as usize - 1;
        occupancy::mark::launch(
            client,
            groups(client, shape.nodes.div_ceil(32) as usize * cells * cells),
            units(),
            self.inside.clone().into_buffer_arg(),
            self.occupied.clone().into_buffer_arg(),
            shape.nodes,
        );
    }
}
