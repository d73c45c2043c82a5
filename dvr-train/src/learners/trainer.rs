//! The training loop's state and its one step. Where runs are stored and reported is the business of `run`.

use burn::module::Module;
use burn::optim::ModuleOptimizer;
use burn::tensor::Device;
use dvr_core::{Ray, UnitCube, View};
use dvr_render::{Crossing, Rays, SkipGrid};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::config::TrainConfig;
use crate::error::Result;
use crate::learners::adam::adam;
use crate::learners::batch::{PixelBatch, Pixels};
use crate::learners::data_parallel::{DataParallel, Part, shares};
use crate::learners::objective::{StepNoise, sparse_depth_loss, step_loss};
use crate::learners::sparse::SparseTargets;
use crate::learners::step_report::{StepReport, StepSettings};

/// What a step looks at.
struct Work {
    pixels: Pixels,
    noise: StepNoise,
    /// Rays that end at known z-depths.
    sparse: (Vec<Ray>, Vec<f32>),
}

impl Work {
    /// The first `count` rays, and as large a share of the others; what remains stays.
    fn take_first(&mut self, count: usize) -> Self {
        let (rays, z_depth) = &mut self.sparse;
        let known = rays.len() * count / self.pixels.len().max(1);
        Self {
            sparse: (rays.drain(..known).collect(), z_depth.drain(..known).collect()),
            pixels: self.pixels.take_first(count),
            noise: self.noise.take_first(count),
        }
    }
}

/// A field in training.
pub struct Trainer<'a, F> {
    config: TrainConfig,
    train: Vec<&'a View>,
    validation: Vec<&'a View>,
    devices: DataParallel,
    bound: Option<SkipGrid>,
    sparse: SparseTargets,
    field: F,
    optimizer: ModuleOptimizer,
    step: usize,
    last: Option<StepReport>,
}

/// The random stream of a purpose: stream `k` is step `k`, counted from 1.
pub(crate) fn step_rng(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}

impl<'a, F: Crossing + Module> Trainer<'a, F> {
    /// Takes a field on `device.autodiff()`, the views to learn from, and those that validate; `device` itself is without
    /// autodiff.
    pub fn new(field: F, train: Vec<&'a View>, validation: Vec<&'a View>, config: TrainConfig, device: Device) -> Self {
        let sparse = SparseTargets::default();
        let devices = DataParallel::one(device);
        let optimizer = adam();
        Self { config, train, validation, devices, bound: None, sparse, field, optimizer, step: 0, last: None }
    }

    /// Shares each step with other devices, which are without autodiff too: every one takes as many of its rays.
    #[must_use]
    pub fn data_parallel(self, devices: impl IntoIterator<Item = Device>) -> Self {
        Self { devices: self.devices.with(devices), ..self }
    }

    /// Searches rays only where the object can be (see [`PixelBatch::of_pixels`]).
    #[must_use]
    pub fn with_bound(self, bound: Option<SkipGrid>) -> Self {
        Self { bound, ..self }
    }

    /// Also compares depths with sparse points, where the configuration gives them a weight.
    #[must_use]
    pub fn with_sparse_targets(self, sparse: SparseTargets) -> Self {
        Self { sparse, ..self }
    }

    /// The configuration.
    pub fn config(&self) -> &TrainConfig {
        &self.config
    }

    /// The views that validate.
    pub fn validation(&self) -> &[&'a View] {
        &self.validation
    }

    /// Where the object can be, if that was said.
    pub fn bound(&self) -> Option<&SkipGrid> {
        self.bound.as_ref()
    }

    /// Steps done so far.
    pub fn steps_done(&self) -> usize {
        self.step
    }

    /// The field without gradient tracking, for rendering and extraction.
    pub fn frozen(&self) -> F {
        self.field.valid()
    }

    /// One step of the method: draw pixels, march, compare, follow the gradient.
    ///
    /// All randomness comes from the seed and the step's number: a resumed run draws what an unbroken one would.
    ///
    /// # Errors
    /// When the loss is not finite. The field is then left as it was before the step; on a GPU, where the loss is not
    /// read in every step, as the steps since the last reading have left it.
    pub fn step(&mut self) -> Result<StepReport> {
        let config = &self.config;
        let mut rng = step_rng(config.seed, self.step as u64 + 1);
        let mut work = self.draw(&mut rng);
        let (rays, patch) = (work.pixels.len(), config.sampling().patch_pixels());
        let parts = shares(rays / patch, self.devices.len()).map(|patches| {
            let count = patches.len() * patch;
            Part { weight: count as f64 / rays as f64, work: work.take_first(count) }
        });
        let learn = |field: &F, Work { pixels, noise, sparse }: Work, device: &Device| {
            let batch = PixelBatch::of_pixels(pixels, patch, self.bound.as_ref(), device);
            let frozen = field.valid();
            let mut loss = step_loss(field, &frozen, &batch, &noise, config, self.step);
            let (rays, z_depth) = sparse;
            if !rays.is_empty() {
                let rays = Rays::new(&rays, UnitCube::default(), device);
                if let Some(sparse) = sparse_depth_loss(field, &frozen, &rays, &z_depth, config, self.step) {
                    loss.total = loss.total + sparse.clone();
                    loss.terms.push(("sparse_depth", sparse));
                }
            }
            loss
        };
        let (loss, gradients) = self.devices.learn(&self.field, parts.collect(), learn);

        let report = StepReport::of(&loss, StepSettings::of(config, self.step), self.last.as_ref())?;
        if let Some(gradients) = gradients {
            self.field = self.optimizer.step(report.learning_rate, self.field.clone(), gradients);
        }
        self.step += 1;
        self.last = Some(report.clone());
        Ok(report)
    }

    /// What the next step looks at.
    fn draw(&self, rng: &mut ChaCha8Rng) -> Work {
        let config = &self.config;
        let mut pixels = Pixels::default();
        pixels.draw(&self.train, config.sampling(), rng);
        let noise = StepNoise::draw(config, pixels.len(), rng);
        let sparse_points = if config.losses.sparse_depth > 0.0 { config.losses.sparse_points } else { 0 };
        Work { pixels, noise, sparse: self.sparse.draw(sparse_points, rng) }
    }

    /// The field, on its tape, and the optimiser.
    pub fn parts(&self) -> (&F, &ModuleOptimizer) {
        (&self.field, &self.optimizer)
    }

    /// Takes up a field and an optimiser as they were after so many steps.
    pub fn restore(&mut self, field: F, optimizer: ModuleOptimizer, steps: usize) {
        (self.field, self.optimizer, self.step, self.last) = (field, optimizer, steps, None);
    }
}
