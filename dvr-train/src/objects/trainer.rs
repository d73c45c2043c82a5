//! A model of many objects in training: the state and its one step, whatever is learned.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use burn::module::Module;
use burn::optim::ModuleOptimizer;
use burn::tensor::Device;
use dvr_core::dataset::ObjectDataset;
use dvr_model::{load_pretrained, seeded};
use dvr_render::ViewMetrics;

use super::fields_task::FieldsTask;
use super::loader::Loader;
use super::task::{ObjectBatch, ObjectsTask, TaskSettings};
use super::validate::{ValidationView, read_validation_views};
use crate::error::{Error, Result};
use crate::learners::adam::adam;
use crate::learners::data_parallel::{DataParallel, Part, shares};
use crate::learners::learner::{Learner, LearnerState};
use crate::learners::module_state::{module_bytes, module_state, restore_module, restore_optimizer};
use crate::learners::step_report::StepReport;

/// A model of many objects' fields in training.
pub type ObjectsTrainer = TaskTrainer<FieldsTask>;

/// A model of many objects in training.
pub struct TaskTrainer<T: ObjectsTask> {
    task: Arc<T>,
    dataset: Arc<ObjectDataset>,
    devices: DataParallel,
    /// Started by the first step, so that a resumed run draws no batch in vain.
    loader: Option<Loader<T::Batch>>,
    validation_views: Vec<ValidationView>,
    broken_validation: BTreeMap<usize, String>,
    /// The broken objects that have been reported.
    reported: BTreeSet<usize>,
    network: T::Network,
    optimizer: ModuleOptimizer,
    step: usize,
    last: Option<StepReport>,
}

impl<T: ObjectsTask> TaskTrainer<T> {
    /// A model with fresh parameters; `device` is without autodiff. The validation objects are read here.
    ///
    /// # Errors
    /// When the dataset has no training objects.
    pub fn new(dataset: Arc<ObjectDataset>, config: T::Config, device: Device) -> Result<Self> {
        let task = Arc::new(T::new(dataset.clone(), config)?);
        let TaskSettings { seed, validate_objects, image_size, .. } = task.settings();
        let network = seeded(&device, seed, || task.network(&device.clone().autodiff()));
        let mut broken_validation = BTreeMap::new();
        let validation_views =
            read_validation_views(&dataset, validate_objects, image_size, seed, |object, problem| {
                broken_validation.insert(object, problem);
            });
        Ok(Self {
            task,
            dataset,
            devices: DataParallel::one(device),
            loader: None,
            validation_views,
            broken_validation,
            reported: BTreeSet::new(),
            network,
            optimizer: adam(),
            step: 0,
            last: None,
        })
    }

    /// Shares each step with other devices, which are without autodiff too: every one takes as many of its objects.
    /// Batch normalisation takes each device's objects by themselves, and remembers those of the first.
    #[must_use]
    pub fn data_parallel(self, devices: impl IntoIterator<Item = Device>) -> Self {
        Self { devices: self.devices.with(devices), ..self }
    }

    /// The configuration.
    pub fn config(&self) -> &T::Config {
        self.task.config()
    }

    /// Takes the features of the encoder from a file.
    ///
    /// # Errors
    /// When it holds no ResNet-18, or the encoder is none.
    pub fn start_from(&mut self, path: &Path) -> Result<()> {
        let device = self.devices.first().clone().autodiff();
        let own = T::encoder(&mut self.network);
        let encoder = load_pretrained(own.clone(), path, &device);
        *own = encoder.map_err(|e| Error::Pretrained { path: path.to_owned(), problem: e.to_string() })?;
        Ok(())
    }

    /// How many objects are trained on.
    pub fn objects(&self) -> usize {
        self.task.objects().objects()
    }

    /// `category/name` of the objects that could not be used so far, with the reason.
    pub fn broken(&self) -> Vec<(String, String)> {
        self.all_broken().into_iter().map(|(object, problem)| (self.title(object), problem)).collect()
    }

    fn all_broken(&self) -> BTreeMap<usize, String> {
        let mut broken = self.task.objects().broken();
        broken.extend(self.broken_validation.clone());
        broken
    }

    fn title(&self, object: usize) -> String {
        let object = &self.dataset.objects()[object];
        format!("{}/{}", object.category, object.name)
    }
}

impl<T: ObjectsTask> Learner for TaskTrainer<T> {
    /// One step: draw objects, encode a picture of each, compare what is made of it with what is known.
    ///
    /// All randomness comes from the seed and the step's number: a resumed run draws what an unbroken one would.
    fn step(&mut self) -> Result<StepReport> {
        let (task, step) = (&self.task, self.step);
        let start = || {
            let task = task.clone();
            Loader::start(move |step| task.draw(step), step + 1)
        };
        let mut batch = self.loader.get_or_insert_with(start).next_batch()?;
        let whole = batch.weight();
        let parts = shares(batch.objects(), self.devices.len()).map(|objects| {
            let work = batch.take_first(objects.len());
            Part { weight: work.weight() as f64 / whole as f64, work }
        });
        let parts = parts.collect();
        let learn = |network: &T::Network, batch, device: &Device| task.loss(network, batch, step, device);
        let (loss, gradients) = self.devices.learn(&self.network, parts, learn);
        let report = StepReport::of(&loss, task.step_settings(step), self.last.as_ref())?;
        if let Some(gradients) = gradients {
            self.network = self.optimizer.step(report.learning_rate, self.network.clone(), gradients);
        }
        self.step += 1;
        self.last = Some(report.clone());
        Ok(report)
    }

    fn steps_done(&self) -> usize {
        self.step
    }

    fn total_steps(&self) -> usize {
        self.task.settings().steps
    }

    fn validate(&self, pixels: usize) -> Option<ViewMetrics> {
        self.task.validate(self.network.valid(), &self.validation_views, pixels, self.devices.first())
    }

    fn model(&self) -> Result<Vec<u8>> {
        module_bytes(self.network.clone())
    }

    fn state(&self) -> Result<LearnerState> {
        module_state(self.network.clone(), &self.optimizer)
    }

    fn resume(&mut self, state: &LearnerState, steps: usize) -> Result<()> {
        self.network = restore_module(&state.model, self.network.clone())?;
        self.optimizer = restore_optimizer(&state.training, self.optimizer.clone())?;
        (self.step, self.loader, self.last) = (steps, None, None);
        Ok(())
    }

    /// Each broken object, once.
    fn notes(&mut self) -> Vec<String> {
        let broken = self.all_broken();
        let new: Vec<_> = broken.into_iter().filter(|(object, _)| self.reported.insert(*object)).collect();
        new.into_iter().map(|(object, problem)| format!("{} is left out: {problem}", self.title(object))).collect()
    }
}
