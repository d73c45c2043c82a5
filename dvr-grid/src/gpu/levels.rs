//! The levels of a grid on the device.

use crate::constants::{BETA1, BETA2};
use burn::tensor::IntDType;
use cubecl::calculate_cube_count_elemwise;
use cubecl::prelude::*;

use super::gather::UNITS;
use super::rays::NONE;
use super::{GpuLevels, pyramid};
use dvr_gpu::DeviceError;
use dvr_gpu::{Buffer, Buffers};

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

/// Nested grids of `channels` numbers a node.
pub(crate) struct MultiResGrid {
    channels: usize,
    /// Coarse to fine.
    levels: Vec<Level>,
    /// Sums of ray_gradients at the finest level's slots, two for each number.
    pub ray_gradients: Buffer,
    steps: i32,
}

impl MultiResGrid {
    /// Takes levels up.
    pub fn new(buffers: &Buffers, channels: usize, given: GpuLevels) -> Result<Self, DeviceError> {
        let GpuLevels { levels: given_levels, state, mut base, mut values } = given;
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
        let ray_gradients = buffers.zeros("sums of ray_gradients", 2 * channels * finest, IntDType::I32)?;
        let levels = Self { channels, levels, ray_gradients, steps };
        levels.descend(&buffers.client, None);
        Ok(levels)
    }

    pub fn finest(&self) -> &Level {
        &self.levels[self.levels.len() - 1]
    }

    /// One step of Adam against the finest level's gradient, and the sums again.
    pub fn step(&mut self, client: &Client, rates: &[f32]) {
        for i in (1..self.levels.len()).rev() {
            let (coarse, fine) = (&self.levels[i - 1], &self.levels[i]);
            pyramid::restrict::launch(
                client,
                groups(client, coarse.count),
                CubeDim::new_1d(UNITS as u32),
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
        self.descend(client, Some(rates));
    }

    /// Moves the parameters by these step sizes, if any, and sums the levels.
    fn descend(&self, client: &Client, rates: Option<&[f32]>) {
        let unbiased = |beta: f32| 1.0 - beta.powi(self.steps);
        for (i, level) in self.levels.iter().enumerate() {
            let rate = rates.and_then(|rates| rates.get(i)).map_or(0.0, |rate| rate / unbiased(BETA1));
            let scale = if rates.is_some() { 1.0 / unbiased(BETA2) } else { 0.0 };
            // The coarsest is given its own slots' base: nothing that it writes to.
            let coarser = if i == 0 { &level.base } else { &self.levels[i - 1].sums };
            pyramid::descend::launch(
                client,
                groups(client, level.count),
                CubeDim::new_1d(UNITS as u32),
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

/// Groups for so many work-items.
pub(crate) fn groups(client: &Client, count: usize) -> CubeCount {
    calculate_cube_count_elemwise(client, count.max(1), CubeDim::new_1d(UNITS as u32))
}
