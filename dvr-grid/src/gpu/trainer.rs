//! The kernels of a step, one after the other.

use burn::backend::DispatchDevice;
use burn::tensor::{Device, IntDType};
use cubecl::prelude::*;

use super::gather::{self, UNITS};
use super::levels::groups;
use super::photo::VIEW_COLUMNS;
use super::rays::{self, RAY_GRADIENT_COLUMNS};
use super::stage::Stage;
use super::weights::WeightsLaunch;
use super::{GpuLevels, GpuLossSums, GpuLosses, GpuStepInput, Photographs};
use dvr_gpu::DeviceError;
use dvr_gpu::{Buffer, Buffers};

/// Pieces of memory that the kernel of rays is given, and one for its numbers.
const BINDINGS: u32 = 11;

/// A field on grids in training on a device.
pub struct GpuStep {
    buffers: Buffers,
    losses: GpuLosses,
    views: Buffer,
    pixels: Buffer,
    z_depths: Buffer,
    /// Rays to come, some words each.
    picks: Buffer,
    /// Other views that each is compared with.
    compared: usize,
    ray_gradients: Buffer,
    rays: usize,
    stage: Option<Stage>,
}

impl GpuStep {
    /// Brings photographs to a device.
    ///
    /// # Errors
    /// When it is no graphics processor, or they are too many for it.
    pub fn new(device: &Device, photographs: &Photographs, losses: GpuLosses) -> Result<Self, DeviceError> {
        let DispatchDevice::Cube(cube) = device.clone().inner().as_dispatch().clone() else {
            return Err(DeviceError::NoGpu);
        };
        let buffers = Buffers::new(cube.client(), cube);
        let bindings = buffers.client.properties().hardware.max_bindings;
        if bindings < BINDINGS {
            return Err(DeviceError::TooFewBindings { bindings });
        }
        let mut table = Vec::with_capacity(photographs.views.len() * VIEW_COLUMNS);
        let mut first = 0u32;
        for view in &photographs.views {
            let numbers = [&view.center[..], &view.to_direction, &view.projection, &view.offset].concat();
            table.extend(numbers.into_iter().map(f32::to_bits));
            let [width, height] = view.size;
            table.extend([width, height, first]);
            first += width * height;
        }
        Ok(Self {
            losses,
            views: buffers.words("the table of views", table)?,
            pixels: buffers.words("the photographs", photographs.pixels.clone())?,
            z_depths: buffers.floats("the depth maps", photographs.z_depths.clone())?,
            picks: buffers.words("rays", Vec::new())?,
            compared: 0,
            ray_gradients: buffers.zero_floats("ray_gradients", 0)?,
            rays: 0,
            stage: None,
            buffers,
        })
    }

    /// Takes up levels of shape and colour over `[-half_extent, half_extent]^3`.
    ///
    /// # Errors
    /// When they are too large for the device.
    pub fn enter(&mut self, half_extent: f32, shape: GpuLevels, color: GpuLevels) -> Result<(), DeviceError> {
        // What the stage before took is free before this one is brought.
        self.stage = None;
        self.stage = Some(Stage::new(&self.buffers, half_extent, shape, color)?);
        Ok(())
    }

    /// Brings rays for the steps to come: for each its view, its pixel, and `compared` other views, `u32::MAX` for
    /// none.
    ///
    /// # Errors
    /// When they are too many for the device.
    pub fn draw(&mut self, picks: Vec<u32>, compared: usize) -> Result<(), DeviceError> {
        self.picks = self.buffers.words("rays", picks)?;
        self.compared = compared;
        Ok(())
    }

    /// One step. Nothing is waited for.
    ///
    /// # Errors
    /// When there is no room for so many rays.
    pub fn step(&mut self, step: &GpuStepInput) -> Result<(), DeviceError> {
        let Some(stage) = &mut self.stage else { return Ok(()) };
        let buffers = &self.buffers;
        if self.rays != step.rays {
            self.ray_gradients = buffers.zero_floats("ray_gradients", step.rays * RAY_GRADIENT_COLUMNS)?;
            self.rays = step.rays;
        }
        stage.most = buffers.zeros("bounds", 3, IntDType::U32)?;
        let (client, losses, count) = (&buffers.client, &self.losses, step.rays);
        let cube = CubeDim::new_1d(UNITS as u32);
        let (shape, color) = (stage.shape.finest(), stage.color.finest());
        rays::follow::launch(
            client,
            groups(client, count),
            cube,
            self.picks.clone().into_buffer_arg(),
            self.views.clone().into_buffer_arg(),
            self.pixels.clone().into_buffer_arg(),
            self.z_depths.clone().into_buffer_arg(),
            shape.sums.clone().into_buffer_arg(),
            shape.slots.clone().into_buffer_arg(),
            stage.marks.clone().into_buffer_arg(),
            color.sums.clone().into_buffer_arg(),
            self.ray_gradients.clone().into_buffer_arg(),
            stage.most.clone().into_buffer_arg(),
            stage.region_arg(),
            color.nodes,
            weights_arg(losses, self.compared),
            step.first as u32,
            count as u32,
            self.compared as u32,
        );
        let steps = part_steps(count);
        gather::scatter::launch(
            client,
            groups(client, count),
            cube,
            self.ray_gradients.clone().into_buffer_arg(),
            stage.most.clone().into_buffer_arg(),
            shape.slots.clone().into_buffer_arg(),
            color.slots.clone().into_buffer_arg(),
            stage.shape.ray_gradients.clone().into_buffer_arg(),
            stage.color.ray_gradients.clone().into_buffer_arg(),
            count as u32,
            shape.nodes,
            color.nodes,
            stage.half_extent,
            steps,
        );
        stage.gather(buffers, step, losses.smoothness_knee, steps);
        let [shape_rates, color_rates] = step.rates;
        stage.shape.step(client, shape_rates);
        stage.color.step(client, color_rates);
        stage.mark(buffers);
        Ok(())
    }

    /// The ray_gradients and losses of the last step: waits for it.
    ///
    /// # Errors
    /// When the device fails.
    pub fn sums(&self) -> Result<GpuLossSums, DeviceError> {
        let Some(stage) = &self.stage else { return Ok(GpuLossSums { ray_gradients: Vec::new(), smoothness: 0.0 }) };
        let mut read = self.buffers.read(&[&self.ray_gradients, &stage.smoothness, &stage.most])?.into_iter();
        let mut next = || read.next().unwrap_or_default();
        let (ray_gradients, smoothness, most) = (next(), next(), next());
        let near = most.get(2).copied().unwrap_or_default();
        let sum: f64 = smoothness.into_iter().map(|bits| f64::from(f32::from_bits(bits))).sum();
        let smoothness = if near == 0 { 0.0 } else { (sum / f64::from(near)) as f32 };
        Ok(GpuLossSums { ray_gradients: ray_gradients.into_iter().map(f32::from_bits).collect(), smoothness })
    }

    /// How often the device was waited for so far.
    #[cfg(test)]
    pub fn reads(&self) -> usize {
        self.buffers.reads()
    }

    /// The gradients at the active nodes of the finest levels of shape and colour, of the last step.
    ///
    /// # Errors
    /// When the device fails.
    #[cfg(test)]
    pub fn gradients(&self) -> Result<[Vec<f32>; 2], DeviceError> {
        let Some(stage) = &self.stage else { return Ok(Default::default()) };
        let read = self.buffers.read(&[&stage.shape.finest().gradient, &stage.color.finest().gradient])?;
        let mut floats = read.into_iter().map(|words| words.into_iter().map(f32::from_bits).collect());
        Ok([floats.next().unwrap_or_default(), floats.next().unwrap_or_default()])
    }

    /// What the levels of shape and colour have become, as [`GpuLevels::state`] is laid out.
    ///
    /// # Errors
    /// When the device fails.
    pub fn states(&self) -> Result<[Vec<f32>; 2], DeviceError> {
        let Some(stage) = &self.stage else { return Ok(Default::default()) };
        Ok([stage.shape.state(&self.buffers)?, stage.color.state(&self.buffers)?])
    }
}

fn weights_arg(losses: &GpuLosses, compared: usize) -> WeightsLaunch {
    WeightsLaunch::new(
        losses.color,
        losses.texture,
        losses.photo_consistency,
        losses.photo_consistency_limit,
        losses.patch_ncc,
        losses.patch_ncc_min,
        losses.patch_stride,
        losses.depth,
        losses.mask,
        losses.sharpness,
        losses.grazing,
        compared.max(1) as f32,
    )
}

/// How many units a number is cut into so that so many of them add up without overflow: see [`gather`].
fn part_steps(count: usize) -> f32 {
    let bits = 30u32.saturating_sub(count.next_power_of_two().ilog2()).min(20);
    (1u32 << bits) as f32
}
