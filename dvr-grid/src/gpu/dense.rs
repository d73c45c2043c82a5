//! Values in bricks at all nodes of a grid, on a device: what is not stored is interpolated there.

#![allow(missing_docs)]

use cubecl::prelude::*;
use dvr_gpu::{Buffer, Buffers, DeviceError};

use super::launch::{groups, units};
use crate::bricks::BrickValues;

/// The numbers of all nodes, x fastest, those of a node side by side. Of a grid that is interpolated from a coarser one
/// only what its active nodes have is brought, whatever its size.
///
/// # Errors
/// When there is no room for them.
pub(crate) fn dense<const C: usize>(buffers: &Buffers, values: &BrickValues<C>) -> Result<Buffer, DeviceError> {
    const WHAT: &str = "values of nodes";
    let Some(coarser) = values.coarser() else { return buffers.floats(WHAT, values.to_dense()) };
    let coarse = dense(buffers, coarser)?;
    let (nodes, count) = (values.grid().nodes() as u32, values.grid().len());
    let all = buffers.zero_floats(WHAT, C * count)?;
    let (active, numbers) = values.active_nodes();
    let client = &buffers.client;
    prolong::launch(
        client,
        groups(client, count),
        units(),
        coarse.into_buffer_arg(),
        all.clone().into_buffer_arg(),
        nodes,
        C,
    );
    let moved = active.len();
    write::launch(
        client,
        groups(client, moved),
        units(),
        buffers.words("active nodes", active)?.into_buffer_arg(),
        buffers.floats(WHAT, numbers)?.into_buffer_arg(),
        all.clone().into_buffer_arg(),
        moved as u32,
        C,
    );
    Ok(all)
}

/// From a grid to one of twice the cells and `nodes` nodes along an edge: along y and z first, as
/// [`BrickValues::between`] rounds.
#[cube(launch)]
fn prolong(coarse: &[f32], fine: &mut [f32], nodes: u32, #[comptime] channels: usize) {
    let node = ABSOLUTE_POS as u32;
    if node < nodes * nodes * nodes {
        let around = Around::of(node, nodes);
        #[unroll]
        for c in 0..channels {
            fine[node as usize * channels + c] = around.interpolated(coarse, c, channels);
        }
    }
}

/// Writes numbers at some nodes.
#[cube(launch)]
fn write(active: &[u32], numbers: &[f32], all: &mut [f32], count: u32, #[comptime] channels: usize) {
    let slot = ABSOLUTE_POS;
    if slot < count as usize {
        #[unroll]
        for c in 0..channels {
            all[active[slot] as usize * channels + c] = numbers[slot * channels + c];
        }
    }
}

/// Reads the numbers of some nodes.
#[cube(launch)]
pub(crate) fn read(active: &[u32], all: &[f32], numbers: &mut [f32], count: u32, #[comptime] channels: usize) {
    let slot = ABSOLUTE_POS;
    if slot < count as usize {
        #[unroll]
        for c in 0..channels {
            numbers[slot * channels + c] = all[active[slot] as usize * channels + c];
        }
    }
}

/// The nodes of a coarse grid that a node of one of twice the cells is interpolated from: rows along x, by whether they
/// are after it along y and z, and the nodes before and after it in them; the same one twice where one lies there.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Around {
    row00: u32,
    row10: u32,
    row01: u32,
    row11: u32,
    x0: u32,
    x1: u32,
}

#[cube]
impl Around {
    /// Around a node of a grid of `nodes` nodes along an edge.
    pub fn of(node: u32, nodes: u32) -> Around {
        let coarse = nodes / 2u32 + 1u32;
        let (x, y, z) = (node % nodes, node / nodes % nodes, node / (nodes * nodes));
        let (x0, x1) = (x / 2u32, x - x / 2u32);
        let (y0, y1) = (y / 2u32, y - y / 2u32);
        let (z0, z1) = (z / 2u32, z - z / 2u32);
        Around {
            row00: (z0 * coarse + y0) * coarse,
            row10: (z0 * coarse + y1) * coarse,
            row01: (z1 * coarse + y0) * coarse,
            row11: (z1 * coarse + y1) * coarse,
            x0,
            x1,
        }
    }

    /// One of the numbers there, interpolated.
    pub fn interpolated(&self, coarse: &[f32], channel: usize, #[comptime] channels: usize) -> f32 {
        let low = self.beside(coarse, self.x0, channel, channels);
        let high = self.beside(coarse, self.x1, channel, channels);
        0.5f32 * (low + high)
    }

    fn beside(&self, coarse: &[f32], x: u32, channel: usize, #[comptime] channels: usize) -> f32 {
        0.25f32
            * (coarse[(self.row00 + x) as usize * channels + channel]
                + coarse[(self.row10 + x) as usize * channels + channel]
                + coarse[(self.row01 + x) as usize * channels + channel]
                + coarse[(self.row11 + x) as usize * channels + channel])
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use dvr_core::voxel::VoxelGrid;
    use dvr_test_support::test_with;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::active::ActiveNodes;

    /// Numbers at all nodes, stage after stage on a grid of twice the cells, are those of the CPU to the bit.
    fn compare<const C: usize>(buffers: &Buffers, rng: &mut ChaCha8Rng) {
        let grid = VoxelGrid::new(6, 0.5);
        let numbers: Vec<f32> = (0..C * grid.len()).map(|_| rng.random::<f32>() - 0.5).collect();
        let mut values = BrickValues::<C>::of_grid(&grid, &numbers);
        for nodes in [11, 21, 41] {
            let grid = VoxelGrid::new(nodes, 0.5);
            let active = ActiveNodes::new(&grid, |node| (grid.position(node).length() - 0.3).abs() < 0.1);
            let moved: Vec<f32> = (0..C * active.count()).map(|_| rng.random()).collect();
            values = BrickValues::refined(&active, Arc::new(values)).with_active(&active, &moved);
            let words = buffers.read(&[&dense(buffers, &values).unwrap()]).unwrap().remove(0);
            let found: Vec<f32> = words.into_iter().map(f32::from_bits).collect();
            assert!(found == values.to_dense(), "{nodes} nodes of {C} numbers");
        }
    }

    #[test_with(gpu)]
    fn all_nodes_have_what_the_bricks_say() {
        let buffers = Buffers::on(&dvr_test_support::gpu(dvr_gpu::open(0)).device).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        compare::<1>(&buffers, &mut rng);
        compare::<3>(&buffers, &mut rng);
    }
}
