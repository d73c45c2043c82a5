//! Encoder and decoder in training, together: the state and its one step.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use burn::module::Module;
use burn::optim::ModuleOptimizer;
use burn::tensor::{Device, Tensor, TensorData};
use dvr_core::dataset::ObjectDataset;
use dvr_model::{Conditioned, ImageModel, load_pretrained};
use dvr_render::{Field, Query};
use glam::Vec3;

use super::config::ObjectsConfig;
use super::draw::{BatchDrawer, ObjectsBatch, Targets};
use super::loader::Loader;
use super::model::{image_tensor, rows_tensor, with_surface_at};
use super::validate::{ValidationView, read_validation_views, validate};
use crate::error::{Error, Result};
use crate::learners::adam::adam;
use crate::learners::batch::PixelBatch;
use crate::learners::data_parallel::{DataParallel, Part, shares};
use crate::learners::learner::{Learner, LearnerState};
use crate::learners::losses;
use crate::learners::module_state::{module_bytes, module_state, restore_module, restore_optimizer};
use crate::learners::objective::{StepLoss, step_loss};
use crate::learners::step_report::{StepReport, StepSettings};
use dvr_render::ViewMetrics;

/// A model of many objects in training.
pub struct ObjectsTrainer {
    config: ObjectsConfig,
    dataset: Arc<ObjectDataset>,
    devices: DataParallel,
    drawer: Arc<BatchDrawer>,
    /// Started by the first step, so that a resumed run draws no batch in vain.
    loader: Option<Loader<ObjectsBatch>>,
    validation_views: Vec<ValidationView>,
    broken_validation: BTreeMap<usize, String>,
    /// The broken objects that have been reported.
    reported: BTreeSet<usize>,
    model: ImageModel,
    optimizer: ModuleOptimizer,
    step: usize,
    last: Option<StepReport>,
}

impl ObjectsTrainer {
    /// A model with fresh parameters; `device` is without autodiff. The validation objects are read here.
    ///
    /// # Errors
    /// When the dataset has no training objects.
    pub fn new(dataset: Arc<ObjectDataset>, config: ObjectsConfig, device: Device) -> Result<Self> {
        device.seed(config.train.seed);
        let model = config.image_model().init(&device.clone().autodiff());
        let drawer = Arc::new(BatchDrawer::new(dataset.clone(), config.clone())?);
        let mut broken_validation = BTreeMap::new();
        let (count, size, seed) = (config.validate_objects, config.encoder.image_size(), config.train.seed);
        let validation_views = read_validation_views(&dataset, count, size, seed, |object, problem| {
            broken_validation.insert(object, problem);
        });
        Ok(Self {
            config,
            dataset,
            devices: DataParallel::one(device),
            drawer,
            loader: None,
            validation_views,
            broken_validation,
            reported: BTreeSet::new(),
            model,
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
    pub fn config(&self) -> &ObjectsConfig {
        &self.config
    }

    /// Takes the features of the encoder from a file.
    ///
    /// # Errors
    /// When it holds no ResNet-18, or the encoder is none.
    pub fn start_from(&mut self, path: &Path) -> Result<()> {
        let device = self.devices.first().clone().autodiff();
        let encoder = load_pretrained(self.model.encoder.clone(), path, &device);
        self.model.encoder =
            encoder.map_err(|e| Error::Pretrained { path: path.to_owned(), problem: e.to_string() })?;
        Ok(())
    }

    /// How many objects are trained on.
    pub fn objects(&self) -> usize {
        self.drawer.objects().objects()
    }

    /// `category/name` of the objects that could not be used so far, with the reason.
    pub fn broken(&self) -> Vec<(String, String)> {
        self.all_broken().into_iter().map(|(object, problem)| (self.title(object), problem)).collect()
    }

    fn all_broken(&self) -> BTreeMap<usize, String> {
        let mut broken = self.drawer.objects().broken();
        broken.extend(self.broken_validation.clone());
        broken
    }

    fn title(&self, object: usize) -> String {
        let object = &self.dataset.objects()[object];
        format!("{}/{}", object.category, object.name)
    }
}

/// The loss of some objects after so many steps: a picture of each is encoded, and what their fields show compared with
/// the targets.
fn objects_loss(
    model: &ImageModel,
    batch: ObjectsBatch,
    config: &ObjectsConfig,
    steps_done: usize,
    device: &Device,
) -> StepLoss {
    let images = image_tensor(&batch.inputs.iter().collect::<Vec<_>>(), device);
    let rows = rows_tensor(&batch.rows, device);
    let codes = model.codes(Tensor::from_inner(images), Tensor::from_inner(rows));
    let frozen = model.decoder.valid().with_codes(codes.clone().inner());
    let field = model.field(codes);
    match batch.targets {
        Targets::Pixels { pixels, owner, noise } => {
            let config = config.objective();
            let batch = PixelBatch::of_pixels(pixels, config.sampling().patch_pixels(), None, device);
            step_loss(&field, &frozen, &batch.with_objects(owner), &noise, &config, steps_done)
        }
        Targets::Points { points, inside, owner } => {
            occupancy_loss(&field, &points, &inside, &owner, &device.clone().autodiff())
        }
    }
}

/// The Occupancy Network objective, a mean over points, in the form of the other targets; the IoU is that of the
/// points.
fn occupancy_loss(field: &Conditioned, points: &[Vec3], inside: &[bool], owner: &[i64], device: &Device) -> StepLoss {
    let n = points.len();
    let flat: Vec<f32> = points.iter().flat_map(Vec3::to_array).collect();
    let sign: Vec<f32> = inside.iter().map(|&inside| if inside { 1.0 } else { -1.0 }).collect();
    let points = Tensor::from_data(TensorData::new(flat, [n, 3]), device);
    let query = Query { object: Some(rows_tensor(owner, device)), ..Query::new(points) };
    let logit = field.occupancy_logit(&query);
    let predicted: Vec<bool> = logit.clone().inner().into_data().iter::<f32>().map(|logit| logit >= 0.0).collect();
    let count = |holds: fn(bool, bool) -> bool| predicted.iter().zip(inside).filter(|&(&a, &b)| holds(a, b)).count();
    let (both, either) = (count(|a, b| a && b), count(|a, b| a || b));
    let total = losses::known_occupancy(logit, Tensor::from_data(TensorData::new(sign, [n]), device)) / n as f64;
    let mask_iou = if either == 0 { 1.0 } else { both as f64 / either as f64 };
    StepLoss { terms: vec![("occupancy", total.clone())], total, mask_iou }
}

impl Learner for ObjectsTrainer {
    /// One step: draw objects, encode a picture of each, compare what their fields show with the targets.
    ///
    /// All randomness comes from the seed and the step's number: a resumed run draws what an unbroken one would.
    fn step(&mut self) -> Result<StepReport> {
        let drawer = &self.drawer;
        let start = || {
            let drawer = drawer.clone();
            Loader::start(move |step| drawer.draw(step), self.step + 1)
        };
        let loader = self.loader.get_or_insert_with(start);
        let mut batch = loader.next_batch()?;
        let whole = batch.targets.len();
        let parts = shares(batch.rows.len(), self.devices.len()).map(|objects| {
            let work = batch.take_first(objects.len());
            Part { weight: work.targets.len() as f64 / whole as f64, work }
        });
        let parts = parts.collect();
        let (config, step) = (&self.config, self.step);
        let learn = |model: &ImageModel, batch, device: &Device| objects_loss(model, batch, config, step, device);
        let (loss, gradients) = self.devices.learn(&self.model, parts, learn);

        let report = StepReport::of(&loss, StepSettings::of(&self.config.train, self.step), self.last.as_ref())?;
        if let Some(gradients) = gradients {
            self.model = self.optimizer.step(report.learning_rate, self.model.clone(), gradients);
        }
        self.step += 1;
        self.last = Some(report.clone());
        Ok(report)
    }

    fn steps_done(&self) -> usize {
        self.step
    }

    fn total_steps(&self) -> usize {
        self.config.train.steps
    }

    fn validate(&self, pixels: usize) -> Option<ViewMetrics> {
        let model = with_surface_at(self.model.valid(), self.config.surface_logit());
        validate(&model, &self.validation_views, pixels, self.devices.first())
    }

    fn model(&self) -> Result<Vec<u8>> {
        module_bytes(self.model.clone())
    }

    fn state(&self) -> Result<LearnerState> {
        module_state(self.model.clone(), &self.optimizer)
    }

    fn resume(&mut self, state: &LearnerState, steps: usize) -> Result<()> {
        self.model = restore_module(&state.model, self.model.clone())?;
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
