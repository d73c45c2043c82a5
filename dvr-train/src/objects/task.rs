//! What differs from one way to learn many objects to another; the rest is [`TaskTrainer`](super::trainer::TaskTrainer).

use std::sync::Arc;

use burn::module::Module;
use burn::tensor::Device;
use dvr_core::dataset::ObjectDataset;
use dvr_model::Encoder;
use dvr_render::ViewMetrics;

use super::object_drawer::ObjectDrawer;
use super::validate::ValidationView;
use crate::error::Result;
use crate::learners::objective::StepLoss;
use crate::learners::step_report::StepSettings;

/// A network, what is drawn for it, and its loss.
pub trait ObjectsTask: Send + Sync + Sized + 'static {
    /// Everything that determines it, besides the dataset.
    type Config;
    /// What learns.
    type Network: Module;
    /// What a step learns from.
    type Batch: ObjectBatch;

    /// # Errors
    /// When the dataset has no training objects.
    fn new(dataset: Arc<ObjectDataset>, config: Self::Config) -> Result<Self>;

    /// The configuration.
    fn config(&self) -> &Self::Config;

    /// What the trainer needs of it.
    fn settings(&self) -> TaskSettings;

    /// The training objects.
    fn objects(&self) -> &ObjectDrawer;

    /// A network with fresh parameters.
    fn network(&self, device: &Device) -> Self::Network;

    /// The part of it that may start from a file.
    fn encoder(network: &mut Self::Network) -> &mut Encoder;

    /// What a step, counted from 1, learns from. It depends on the seed, the step and the files, and on nothing else.
    ///
    /// # Errors
    /// When many objects in a row are broken.
    fn draw(&self, step: usize) -> Result<Self::Batch>;

    /// Step size and schedule after so many steps.
    fn step_settings(&self, steps_done: usize) -> StepSettings;

    /// The loss after so many steps; `device` is without autodiff.
    fn loss(&self, network: &Self::Network, batch: Self::Batch, steps_done: usize, device: &Device) -> StepLoss;

    /// How well a network without gradient tracking explains validation views, on about so many pixels in all.
    fn validate(
        &self,
        network: Self::Network,
        views: &[ValidationView],
        pixels: usize,
        device: &Device,
    ) -> Option<ViewMetrics>;
}

/// What the trainer needs of a configuration.
#[derive(Clone, Copy, Debug)]
pub struct TaskSettings {
    /// Seed of all random choices.
    pub seed: u64,
    /// Optimiser steps.
    pub steps: usize,
    /// Objects that a validation looks at.
    pub validate_objects: usize,
    /// Side of the encoder's pictures; `None` where it sees none.
    pub image_size: Option<usize>,
}

/// What a step learns from, which devices may share.
pub trait ObjectBatch: Send + 'static {
    /// How many objects there are.
    fn objects(&self) -> usize;

    /// How much the loss is a mean over: pixels, points or objects.
    fn weight(&self) -> usize;

    /// The first `count` objects; the others stay.
    #[must_use]
    fn take_first(&mut self, count: usize) -> Self;
}
