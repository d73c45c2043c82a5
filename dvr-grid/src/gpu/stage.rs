//! What stays on the device from one growth of the grids to the next, and the kernels that need no rays.

use burn::tensor::IntDType;
use cubecl::prelude::*;

use super::gather::{self, UNITS};
use super::levels::{MultiResGrid, groups};
use super::walk::RegionLaunch;
use super::{GpuLevels, GpuStepInput, occupancy};
use dvr_gpu::DeviceError;
use dvr_gpu::{Buffer, Buffers};

/// What holds from one growth of the grids to the next.
pub(crate) struct Stage {
    pub half_extent: f32,
    /// The box of cells that the surface may be in.
    region: [[u32; 3]; 2],
    pub shape: MultiResGrid,
    pub color: MultiResGrid,
    /// Which nodes are not negative, and which cells rays look at: a bit each.
    inside: Buffer,
    pub marks: Buffer,
    /// Slopes of the smoothness, and its sum in each group of work-items.
    slopes: Buffer,
    pub smoothness: Buffer,
    /// The largest numbers of the last step's ray_gradients as bits, and how many nodes are near the surface.
    pub most: Buffer,
}

impl Stage {
    /// Takes levels of shape and colour up.
    pub fn new(buffers: &Buffers, half_extent: f32, shape: GpuLevels, color: GpuLevels) -> Result<Self, DeviceError> {
        let nodes = shape.levels.last().map_or(2, |(nodes, _)| *nodes);
        let active = shape.levels.last().map_or(&[][..], |(_, active)| active);
        let region = region(nodes, active, &shape.values);
        let (words, slots) = (nodes.div_ceil(32), active.len());
        let inside = buffers.words("signs of nodes", bits(nodes, &shape.values))?;
        let stage = Self {
            half_extent,
            region,
            shape: MultiResGrid::new(buffers, 1, shape)?,
            color: MultiResGrid::new(buffers, 3, color)?,
            inside,
            marks: buffers.zeros("marks of cells", words * (nodes - 1) * (nodes - 1), IntDType::U32)?,
            slopes: buffers.zero_floats("slopes of the smoothness", slots)?,
            smoothness: buffers.zero_floats("sums of the smoothness", slots.div_ceil(UNITS))?,
            most: buffers.zeros("bounds", 3, IntDType::U32)?,
        };
        stage.mark(buffers);
        Ok(stage)
    }

    /// Where rays look for the surface.
    pub fn region_arg(&self) -> RegionLaunch {
        let [[low_x, low_y, low_z], [high_x, high_y, high_z]] = self.region;
        let nodes = self.shape.finest().nodes;
        RegionLaunch::new(nodes, self.half_extent, low_x, low_y, low_z, high_x, high_y, high_z)
    }

    /// From sums of ray_gradients to gradients, with what does not come from rays.
    pub fn gather(&self, buffers: &Buffers, step: &GpuStepInput, knee: f32, steps: f32) {
        let (client, cube) = (&buffers.client, CubeDim::new_1d(UNITS as u32));
        let (shape, color) = (self.shape.finest(), self.color.finest());
        let spacing = 2.0 * self.half_extent / (shape.nodes - 1) as f32;
        gather::gather_shape::launch(
            client,
            groups(client, shape.count),
            cube,
            shape.active.clone().into_buffer_arg(),
            shape.sums.clone().into_buffer_arg(),
            self.shape.ray_gradients.clone().into_buffer_arg(),
            self.most.clone().into_buffer_arg(),
            shape.gradient.clone().into_buffer_arg(),
            self.slopes.clone().into_buffer_arg(),
            self.smoothness.clone().into_buffer_arg(),
            shape.count as u32,
            shape.nodes,
            spacing,
            knee,
            steps,
        );
        if step.smoothness > 0.0 {
            gather::spread::launch(
                client,
                groups(client, shape.count),
                cube,
                shape.active.clone().into_buffer_arg(),
                shape.slots.clone().into_buffer_arg(),
                self.slopes.clone().into_buffer_arg(),
                self.most.clone().into_buffer_arg(),
                shape.gradient.clone().into_buffer_arg(),
                shape.count as u32,
                shape.nodes,
                spacing,
                step.smoothness,
            );
        }
        let ([red, green, blue], weight) = step.rest;
        gather::gather_color::launch(
            client,
            groups(client, color.count),
            cube,
            color.active.clone().into_buffer_arg(),
            color.sums.clone().into_buffer_arg(),
            self.color.ray_gradients.clone().into_buffer_arg(),
            self.most.clone().into_buffer_arg(),
            color.gradient.clone().into_buffer_arg(),
            color.count as u32,
            red,
            green,
            blue,
            weight,
            steps,
        );
    }

    /// Marks the cells of the values that there are now.
    pub fn mark(&self, buffers: &Buffers) {
        let (client, cube, shape) = (&buffers.client, CubeDim::new_1d(UNITS as u32), self.shape.finest());
        occupancy::sign::launch(
            client,
            groups(client, shape.count),
            cube,
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
            cube,
            self.inside.clone().into_buffer_arg(),
            self.marks.clone().into_buffer_arg(),
            shape.nodes,
        );
    }
}

/// The smallest box of cells that holds all that can ever be inside: from the first up to but without the second
/// corner.
pub(crate) fn region(nodes: usize, active: &[u32], values: &[f32]) -> [[u32; 3]; 2] {
    let (mut low, mut high) = ([u32::MAX; 3], [0; 3]);
    let (edge, last) = (nodes as u32, nodes as u32 - 1);
    let inside = (0..).zip(values).filter(|(_, value)| **value >= 0.0).map(|(node, _)| node);
    for node in inside.chain(active.iter().copied()) {
        let coordinates = [node % edge, node / edge % edge, node / (edge * edge)];
        for axis in 0..3 {
            // The cells on either side of a node.
            low[axis] = low[axis].min(coordinates[axis].saturating_sub(1));
            high[axis] = high[axis].max((coordinates[axis] + 1).min(last));
        }
    }
    if high == [0; 3] { [[0; 3]; 2] } else { [low, high] }
}

/// Whether each node is not negative, a bit each, in rows of whole words.
pub(crate) fn bits(nodes: usize, values: &[f32]) -> Vec<u32> {
    let rows = values.chunks(nodes).flat_map(|row| row.chunks(32));
    rows.map(|run| run.iter().zip(0..).fold(0, |word, (value, bit)| word | u32::from(*value >= 0.0) << bit)).collect()
}
