//! The kernels of a step, one after the other, and the memory that they share.

use burn::tensor::{Device, IntDType};
use dvr_gpu::{Buffer, Buffers, DeviceError};

use super::slope_rule::SlopeRuleArgsLaunch;
use super::stage::Stage;
use super::{agreement, gather, rays};
use crate::color;
use crate::gpu::launch::{groups, units};
use crate::gpu::views::{ViewRecord, table};
use crate::losses::LossSums;
use crate::multires::Grids;
use crate::step::backend::{COLOR_REST, StepInput};
use crate::step::record::{NUMBERS, RayRecord};

/// Buffers that the kernel of rays is given, and one for its numbers.
const BINDINGS: u32 = 11;

/// All photographs, as kernels read them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Photographs {
    /// One after the other.
    pub views: Vec<ViewRecord>,
    /// Their pixels, row by row: red, green and blue from the lowest byte on, and 1 in the highest where the object is
    /// shown.
    pub pixels: Vec<u32>,
    /// Their pixels' z-depths, `f32::MAX` where nothing was measured (devices need not know infinities); empty without
    /// depth maps.
    pub z_depths: Vec<f32>,
}

/// Photographs, rays and grids on a device.
pub(crate) struct Kernels {
    buffers: Buffers,
    views: Buffer,
    pixels: Buffer,
    z_depths: Buffer,
    /// Rays to come, some words each.
    picks: Buffer,
    /// Other views that each is compared with.
    compared: usize,
    records: Buffer,
    rays: usize,
    stage: Option<Stage>,
}

impl Kernels {
    /// Brings photographs to a device.
    ///
    /// # Errors
    /// When it is no GPU, or they are too large for it.
    pub fn new(device: &Device, photographs: Photographs) -> Result<Self, DeviceError> {
        let buffers = Buffers::on(device)?;
        let bindings = buffers.client.properties().hardware.max_bindings;
        if bindings < BINDINGS {
            return Err(DeviceError::TooFewBindings { bindings });
        }
        Ok(Self {
            views: table(&buffers, photographs.views)?,
            pixels: buffers.words("the photographs", photographs.pixels)?,
            z_depths: buffers.floats("the depth maps", photographs.z_depths)?,
            picks: buffers.words("rays", Vec::new())?,
            compared: 0,
            records: buffers.zero_floats("ray gradients", 0)?,
            rays: 0,
            stage: None,
            buffers,
        })
    }

    /// Replaces the photographs.
    ///
    /// # Errors
    /// When they are too large for the device.
    pub fn show(&mut self, photographs: Photographs) -> Result<(), DeviceError> {
        let Photographs { views, pixels, z_depths } = photographs;
        self.views = table(&self.buffers, views)?;
        self.pixels = self.buffers.words("the photographs", pixels)?;
        self.z_depths = self.buffers.floats("the depth maps", z_depths)?;
        Ok(())
    }

    /// Replaces the table of views: the same views, exposed otherwise.
    ///
    /// # Errors
    /// When there is no room for it.
    pub fn expose(&mut self, views: Vec<ViewRecord>) -> Result<(), DeviceError> {
        self.views = table(&self.buffers, views)?;
        Ok(())
    }

    /// Brings grids to the device.
    ///
    /// # Errors
    /// When they are too large for it.
    pub fn upload(&mut self, grids: &Grids) -> Result<(), DeviceError> {
        // The memory of the stage before is free before this one is brought.
        self.stage = None;
        self.stage = Some(Stage::new(&self.buffers, grids)?);
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

    /// Makes room for the records of this many rays.
    ///
    /// # Errors
    /// When there is none.
    pub fn reserve(&mut self, rays: usize) -> Result<(), DeviceError> {
        if self.rays != rays {
            self.records = self.buffers.zero_floats("ray gradients", rays * NUMBERS)?;
            self.rays = rays;
        }
        Ok(())
    }

    /// One step, with the rays that begin at `first` of those that were brought. Nothing is waited for.
    ///
    /// # Errors
    /// When there is no room for the rays.
    pub fn step(&mut self, input: &StepInput, first: usize) -> Result<(), DeviceError> {
        let (losses, count) = (&input.config.losses, input.config.rays);
        self.reserve(count)?;
        let most = self.buffers.zeros("bounds", 3, IntDType::U32)?;
        let Some(stage) = &mut self.stage else { return Ok(()) };
        stage.most = most;
        self.follow(input, first);
        let Some(stage) = &mut self.stage else { return Ok(()) };
        let client = &self.buffers.client;
        stage.gather(client, (color::constant(input.mean_color), COLOR_REST), part_steps(count));
        if losses.smoothness.weight > 0.0 {
            stage.smooth(client, input.smoothness_weight(), losses.smoothness.knee as f32);
        }
        stage.shape.step(client, |level| input.shape_rate(level));
        stage.color.step(client, |level| input.color_rate(level));
        stage.update_occupancy(&self.buffers);
        Ok(())
    }

    /// From rays to sums of ray gradients at the nodes.
    fn follow(&self, input: &StepInput, first: usize) {
        let Some(stage) = &self.stage else { return };
        let (client, count) = (&self.buffers.client, input.config.rays);
        let (shape, color) = (stage.shape.finest(), stage.color.finest());
        rays::follow::launch(
            client,
            groups(client, count),
            units(),
            self.picks.clone().into_buffer_arg(),
            self.views.clone().into_buffer_arg(),
            self.pixels.clone().into_buffer_arg(),
            self.z_depths.clone().into_buffer_arg(),
            shape.sums.clone().into_buffer_arg(),
            shape.slots.clone().into_buffer_arg(),
            stage.occupied.clone().into_buffer_arg(),
            color.sums.clone().into_buffer_arg(),
            self.records.clone().into_buffer_arg(),
            stage.most.clone().into_buffer_arg(),
            stage.region_arg(),
            rays::RayArgsLaunch {
                slope_rule: SlopeRuleArgsLaunch::of(input.slope_rule),
                color_nodes: color.nodes,
                first: first as u32,
                count: count as u32,
                compared: self.compared as u32,
            },
            input.config.losses.launch(),
        );
        gather::scatter::launch(
            client,
            groups(client, count),
            units(),
            self.records.clone().into_buffer_arg(),
            stage.most.clone().into_buffer_arg(),
            shape.slots.clone().into_buffer_arg(),
            color.slots.clone().into_buffer_arg(),
            stage.shape.ray_sums.clone().into_buffer_arg(),
            stage.color.ray_sums.clone().into_buffer_arg(),
            count as u32,
            shape.nodes,
            color.nodes,
            stage.half_extent,
            part_steps(count),
        );
    }

    /// The losses of the last step: waits for it.
    ///
    /// # Errors
    /// When the device fails.
    pub fn sums(&self) -> Result<LossSums, DeviceError> {
        let mut sums = LossSums::default();
        let Some(stage) = &self.stage else { return Ok(sums) };
        let mut read = self.buffers.read(&[&self.records, &stage.smoothness, &stage.most])?.into_iter();
        let mut next = || read.next().unwrap_or_default();
        let (records, smoothness, most) = (next(), next(), next());
        records_of(&records).iter().for_each(|record| record.add_to(&mut sums));
        let near = most.get(2).copied().unwrap_or_default();
        if near > 0 {
            let sum: f64 = smoothness.into_iter().map(|bits| f64::from(f32::from_bits(bits))).sum();
            sums.smoothness = f64::from((sum / f64::from(near)) as f32);
        }
        Ok(sums)
    }

    /// The values of the shape at the active nodes of its finest level, in their order.
    ///
    /// # Errors
    /// When the device fails.
    pub fn shape_values(&self) -> Result<Vec<f32>, DeviceError> {
        let Some(stage) = &self.stage else { return Ok(Vec::new()) };
        stage.shape.values(&self.buffers)
    }

    /// How far other views differ in colour at the hits of rays, of those that have any to compare: see [`agreement::differences`], also on
    /// `picks`.
    ///
    /// # Errors
    /// When the device fails, or has no room.
    pub fn differences(&self, picks: Vec<u32>, compared: usize) -> Result<impl Iterator<Item = f32>, DeviceError> {
        let (client, count) = (&self.buffers.client, picks.len() / (2 + compared));
        let found = self.buffers.zero_floats("differences of views", count)?;
        if let Some(stage) = &self.stage {
            agreement::differences::launch(
                client,
                groups(client, count),
                units(),
                self.buffers.words("rays", picks)?.into_buffer_arg(),
                self.views.clone().into_buffer_arg(),
                self.pixels.clone().into_buffer_arg(),
                stage.shape.finest().sums.clone().into_buffer_arg(),
                stage.occupied.clone().into_buffer_arg(),
                found.clone().into_buffer_arg(),
                stage.region_arg(),
                compared as u32,
                count as u32,
            );
        }
        let found = self.buffers.read(&[&found])?.remove(0).into_iter().map(f32::from_bits);
        Ok(found.filter(|&difference| difference >= 0.0))
    }

    /// Parameters and moments of shape and colour, as `MultiResGrid::state` lays them out.
    ///
    /// # Errors
    /// When the device fails.
    pub fn states(&self) -> Result<[Vec<f32>; 2], DeviceError> {
        let Some(stage) = &self.stage else { return Ok(Default::default()) };
        Ok([stage.shape.state(&self.buffers)?, stage.color.state(&self.buffers)?])
    }
}

/// What tests look at.
#[cfg(test)]
impl Kernels {
    /// How often the device was waited for so far.
    pub fn reads(&self) -> usize {
        self.buffers.reads()
    }

    /// The records of the last step's rays.
    pub fn records(&self) -> Result<Vec<RayRecord>, DeviceError> {
        let read = self.buffers.read(&[&self.records])?;
        Ok(read.first().map_or_else(Vec::new, |words| records_of(words).to_vec()))
    }

    /// The gradients at the active nodes of the finest levels of shape and colour, of the last step.
    pub fn gradients(&self) -> Result<[Vec<f32>; 2], DeviceError> {
        let Some(stage) = &self.stage else { return Ok(Default::default()) };
        let read = self.buffers.read(&[&stage.shape.finest().gradient, &stage.color.finest().gradient])?;
        let mut floats = read.into_iter().map(|words| words.into_iter().map(f32::from_bits).collect());
        Ok([floats.next().unwrap_or_default(), floats.next().unwrap_or_default()])
    }
}

/// Words as records.
fn records_of(words: &[u32]) -> &[RayRecord] {
    bytemuck::cast_slice(&words[..words.len() / NUMBERS * NUMBERS])
}

/// How many units a number is cut into so that this many of them add up without overflow: see [`gather`].
fn part_steps(count: usize) -> f32 {
    let bits = 30u32.saturating_sub(count.next_power_of_two().ilog2()).min(20);
    (1u32 << bits) as f32
}
