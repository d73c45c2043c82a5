//! The levels of a grid on the device: the counterpart of `multires::levels`.

use crate::constants::{BETA1, BETA2};
use burn::tensor::IntDType;
use cubecl::prelude::*;
use dvr_gpu::{Buffer, Buffers, DeviceError};

use super::pyramid;
use crate::gpu::launch::{NONE, groups, units};
use crate::multires::MultiResGrid;

/// Parameters of one grid. What is kept for the active nodes alone lies in their order, in *slots*.
pub(crate) struct Level {
    /// Nodes along an edge.
    pub nodes: u32,
    /// Active nodes.
    pub count: usize,
    pub active: Buffer,
    /// The slot of each node, [`NONE`] where it is not active.
    pub slots: Buffer,
    pub gradient: Buffer,
    /// Sum of this level, the coarser ones and the base, at all nodes.
    pub sums: Buffer,
    base: Buffer,
    parameters: Buffer,
    first: Buffer,
    second: Buffer,
}

/// Nested grids of `channels` numbers per node.
pub(crate) struct GpuGrid {
    channels: usize,
    /// Coarse to fine.
    levels: Vec<Level>,
    /// Sums of ray gradients at the finest level's slots, two for each number.
    pub ray_sums: Buffer,
    steps: i32,
}

impl GpuGrid {
    /// Brings levels to the device.
    pub fn new<const C: usize>(buffers: &Buffers, given: &MultiResGrid<C>) -> Result<Self, DeviceError> {
        let (channels, state) = (C, given.state());
        // Of the active nodes alone, in their order.
        let mut base = given.base();
        let mut values = given.values().to_dense();
        let given_levels: Vec<(usize, Vec<u32>)> =
            given.node_sets().map(|set| (set.grid().nodes(), set.iter().map(|node| node as u32).collect())).collect();
        let steps = state.first().copied().unwrap_or_default() as i32;
        let (mut levels, mut rest) = (Vec::new(), state.get(1..).unwrap_or_default());
        let last = given_levels.len().saturating_sub(1);
        for (i, (nodes, active)) in given_levels.into_iter().enumerate() {
            let (count, total) = (active.len(), nodes.pow(3));
            let mut slots = vec![NONE; total];
            active.iter().zip(0..).for_each(|(&node, slot)| slots[node as usize] = slot);
            let length = channels * count;
            let mut next = || {
                let (own, others) = rest.split_at(length.min(rest.len()));
                rest = others;
                own.to_vec()
            };
            let (parameters, first, second) = (next(), next(), next());
            let is_finest = i == last;
            levels.push(Level {
                nodes: nodes as u32,
                count,
                active: buffers.words("active nodes", active)?,
                slots: buffers.words("slots of nodes", slots)?,
                gradient: buffers.zero_floats("a gradient", length)?,
                sums: match is_finest {
                    true => buffers.floats("values of nodes", std::mem::take(&mut values))?,
                    false => buffers.zero_floats("values of nodes", channels * total)?,
                },
                base: match is_finest {
                    true => buffers.floats("a base", std::mem::take(&mut base))?,
                    false => buffers.zero_floats("a base", length)?,
                },
                parameters: buffers.floats("parameters", parameters)?,
                first: buffers.floats("first moments", first)?,
                second: buffers.floats("second moments", second)?,
            });
        }
        let finest = levels.last().map_or(0, |level| level.count);
        let ray_sums = buffers.zeros("sums of ray gradients", 2 * channels * finest, IntDType::I32)?;
        let levels = Self { channels, levels, ray_sums, steps };
        levels.descend(&buffers.client, None);
        Ok(levels)
    }

    pub fn finest(&self) -> &Level {
        &self.levels[self.levels.len() - 1]
    }

    /// One step of Adam against the finest level's gradient, and the sums again.
    pub fn step(&mut self, client: &Client, rates: impl Fn(usize) -> f32) {
        for i in (1..self.levels.len()).rev() {
            let (coarse, fine) = (&self.levels[i - 1], &self.levels[i]);
            pyramid::restrict::launch(
                client,
                groups(client, coarse.count),
                units(),
                coarse.active.clone().into_buffer_arg(),
                fine.slots.clone().into_buffer_arg(),
                fine.gradient.clone().into_buffer_arg(),
                coarse.gradient.clone().into_buffer_arg(),
                coarse.count as u32,
                coarse.nodes,
                self.channels,
            );
        }
        self.steps += 1;
        self.descend(client, Some(&rates));
    }

    /// Moves the parameters by these step sizes, if any, and sums the levels.
    fn descend(&self, client: &Client, rates: Option<&dyn Fn(usize) -> f32>) {
        let unbiased = |beta: f32| 1.0 - beta.powi(self.steps);
        for (i, level) in self.levels.iter().enumerate() {
            let rate = rates.map_or(0.0, |rates| rates(i) / unbiased(BETA1));
            let scale = if rates.is_some() { 1.0 / unbiased(BETA2) } else { 0.0 };
            // The coarsest is given its own slots' base: nothing that it writes to.
            let coarser = if i == 0 { &level.base } else { &self.levels[i - 1].sums };
            pyramid::descend::launch(
                client,
                groups(client, level.count),
                units(),
                level.active.clone().into_buffer_arg(),
                level.gradient.clone().into_buffer_arg(),
                level.base.clone().into_buffer_arg(),
                coarser.clone().into_buffer_arg(),
                level.parameters.clone().into_buffer_arg(),
                level.first.clone().into_buffer_arg(),
                level.second.clone().into_buffer_arg(),
                level.sums.clone().into_buffer_arg(),
                level.count as u32,
                level.nodes,
                u32::from(i > 0),
                u32::from(rates.is_some()),
                rate,
                scale,
                self.channels,
            );
        }
    }

    /// Steps done, then parameters and moments of each level, coarse to fine, in one row.
    pub fn state(&self, buffers: &Buffers) -> Result<Vec<f32>, DeviceError> {
        let parts: Vec<&Buffer> =
            self.levels.iter().flat_map(|level| [&level.parameters, &level.first, &level.second]).collect();
        let mut state = vec![self.steps as f32];
        for (words, level) in buffers.read(&parts)?.into_iter().zip(self.levels.iter().flat_map(|level| [level; 3])) {
            state.extend(words.into_iter().take(self.channels * level.count).map(f32::from_bits));
        }
        Ok(state)
    }
}
