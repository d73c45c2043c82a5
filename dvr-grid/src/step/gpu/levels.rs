//! The levels of a grid on the device: the counterpart of `multires::levels`.

#![allow(missing_docs)]

use crate::constants::{BETA1, BETA2};
use burn::tensor::IntDType;
use cubecl::prelude::*;
use dvr_gpu::{Buffer, Buffers, DeviceError};

use super::pyramid;
use crate::gpu::dense::{dense, read};
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
        let channels = C;
        // Of the active nodes alone, in their order. Where nothing has been learned yet, that is zero.
        let mut base = given.base();
        let state = if given.is_touched() { given.state() } else { Vec::new() };
        let given_levels: Vec<(usize, Vec<u32>)> =
            given.node_sets().map(|set| (set.grid().nodes(), set.iter().map(|node| node as u32).collect())).collect();
        let steps = state.first().copied().unwrap_or_default() as i32;
        let (mut levels, mut rest) = (Vec::new(), state.get(1..).unwrap_or_default());
        let last = given_levels.len().saturating_sub(1);
        for (i, (nodes, active)) in given_levels.into_iter().enumerate() {
            let (count, total) = (active.len(), nodes.pow(3));
            let length = channels * count;
            let mut next = |what| {
                let (own, others) = rest.split_at(length.min(rest.len()));
                rest = others;
                if own.is_empty() { buffers.zero_floats(what, length) } else { buffers.floats(what, own.to_vec()) }
            };
            let (parameters, first, second) = (next("parameters")?, next("first moments")?, next("second moments")?);
            let is_finest = i == last;
            let active = buffers.words("active nodes", active)?;
            levels.push(Level {
                nodes: nodes as u32,
                count,
                slots: slots_of(buffers, &active, count, total)?,
                active,
                gradient: buffers.zero_floats("a gradient", length)?,
                sums: match is_finest {
                    true => dense(buffers, given.values())?,
                    false => buffers.zero_floats("values of nodes", channels * total)?,
                },
                base: match is_finest {
                    true => buffers.floats("a base", std::mem::take(&mut base))?,
                    false => buffers.zero_floats("a base", length)?,
                },
                parameters,
                first,
                second,
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

    /// The values at the active nodes of the finest level, in their order.
    pub fn values(&self, buffers: &Buffers) -> Result<Vec<f32>, DeviceError> {
        let Level { active, sums, count, .. } = self.finest();
        let found = buffers.zero_floats("values of active nodes", self.channels * count)?;
        read::launch(
            &buffers.client,
            groups(&buffers.client, *count),
            units(),
            active.clone().into_buffer_arg(),
            sums.clone().into_buffer_arg(),
            found.clone().into_buffer_arg(),
            *count as u32,
            self.channels,
        );
        let words = buffers.read(&[&found])?.into_iter().flatten().take(self.channels * count);
        Ok(words.map(f32::from_bits).collect())
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

/// The slot of each of `total` nodes, [`NONE`] of those that are not active.
fn slots_of(buffers: &Buffers, active: &Buffer, count: usize, total: usize) -> Result<Buffer, DeviceError> {
    let (client, slots) = (&buffers.client, buffers.zeros("slots of nodes", total, IntDType::U32)?);
    no_slots::launch(client, groups(client, total), units(), slots.clone().into_buffer_arg(), total as u32);
    write_slots::launch(
        client,
        groups(client, count),
        units(),
        active.clone().into_buffer_arg(),
        slots.clone().into_buffer_arg(),
        count as u32,
    );
    Ok(slots)
}

#[cube(launch)]
fn no_slots(slots: &mut [u32], total: u32) {
    if ABSOLUTE_POS < total as usize {
        slots[ABSOLUTE_POS] = NONE;
    }
}

#[cube(launch)]
fn write_slots(active: &[u32], slots: &mut [u32], count: u32) {
    if ABSOLUTE_POS < count as usize {
        slots[active[ABSOLUTE_POS] as usize] = ABSOLUTE_POS as u32;
    }
}
