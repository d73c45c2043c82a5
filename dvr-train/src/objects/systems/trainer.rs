//! A system in training: the state and its one step.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use burn::module::Module;
use burn::optim::ModuleOptimizer;
use burn::tensor::{Device, Tensor, TensorData};
use dvr_core::dataset::ObjectDataset;
use dvr_core::voxel::VoxelGrid;
use dvr_model::{ShapeDecoder, ShapeModel, SphereDecoder, VoxelDecoder, load_pretrained};
use dvr_render::ViewMetrics;

use super::config::SystemConfig;
use super::losses::chamfer::chamfer;
use super::losses::mesh_shape::Connections;
use super::losses::ray_consistency::{ray_consistency, voxel_grid};
use super::losses::soft_silhouette::silhouette_loss;
use super::losses::voxel_cross_entropy::voxel_cross_entropy;
use super::model::SystemModel;
use super::targets::{SystemBatch, SystemDrawer, SystemObject, Target};
use crate::error::{Error, Result};
use crate::learners::adam::adam;
use crate::learners::data_parallel::{DataParallel, Part, shares};
use crate::learners::learner::{Learner, LearnerState};
use crate::learners::module_state::{module_bytes, module_state, restore_module, restore_optimizer};
use crate::learners::objective::StepLoss;
use crate::learners::step_report::{StepReport, StepSettings};
use crate::objects::loader::Loader;
use crate::objects::model::{image_tensor, rows_tensor};
use crate::objects::validate::{ValidationView, mean_metrics, read_validation_views};

/// A system in training.
pub struct SystemTrainer {
    config: SystemConfig,
    dataset: Arc<ObjectDataset>,
    devices: DataParallel,
    drawer: Arc<SystemDrawer>,
    /// Started by the first step, so that a resumed run draws no batch in vain.
    loader: Option<Loader<SystemBatch>>,
    validation_views: Vec<ValidationView>,
    broken_validation: BTreeMap<usize, String>,
    /// The broken objects that have been reported.
    reported: BTreeSet<usize>,
    terms: Terms,
    model: ShapeModel,
    optimizer: ModuleOptimizer,
    step: usize,
    last: Option<StepReport>,
}

/// What losses need besides model and batch.
struct Terms {
    grid: VoxelGrid,
    connections: Connections,
    sharpness: f64,
    laplacian: f64,
    flatness: f64,
}

impl SystemTrainer {
    /// A model with fresh parameters; `device` is without autodiff. The validation objects are read here.
    ///
    /// # Errors
    /// When the dataset has no training objects.
    pub fn new(dataset: Arc<ObjectDataset>, config: SystemConfig, device: Device) -> Result<Self> {
        device.seed(config.seed);
        let model = config.model().init(&device.clone().autodiff());
        let drawer = Arc::new(SystemDrawer::new(dataset.clone(), config.clone())?);
        let mut broken_validation = BTreeMap::new();
        let (count, size) = (config.validate_objects, config.encoder.image_size());
        let validation_views = read_validation_views(&dataset, count, size, config.seed, |object, problem| {
            broken_validation.insert(object, problem);
        });
        let terms = Terms {
            grid: voxel_grid(VoxelDecoder::RESOLUTION),
            connections: Connections::new(SphereDecoder::sphere()),
            sharpness: config.sharpness,
            laplacian: config.laplacian,
            flatness: config.flatness,
        };
        Ok(Self {
            config,
            dataset,
            devices: DataParallel::one(device),
            drawer,
            loader: None,
            validation_views,
            broken_validation,
            reported: BTreeSet::new(),
            terms,
            model,
            optimizer: adam(),
            step: 0,
            last: None,
        })
    }

    /// Shares each step with other devices; see [`ObjectsTrainer::data_parallel`](crate::ObjectsTrainer::data_parallel).
    #[must_use]
    pub fn data_parallel(self, devices: impl IntoIterator<Item = Device>) -> Self {
        Self { devices: self.devices.with(devices), ..self }
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

/// The loss of some objects: a picture of each is encoded, and the shape that is made of it compared with what is known.
fn loss_of(model: &ShapeModel, batch: SystemBatch, terms: &Terms, device: &Device) -> StepLoss {
    let SystemBatch { objects: batch, places } = batch;
    let inputs: Vec<_> = batch.iter().filter_map(|object| object.input.as_ref()).collect();
    let rows: Vec<i64> = batch.iter().map(|object| object.row).collect();
    let images = Tensor::from_inner(image_tensor(&inputs, device));
    let codes = model.codes(images, Tensor::from_inner(rows_tensor(&rows, device)));
    match &model.decoder {
        ShapeDecoder::Voxels(decoder) => {
            let logits = decoder.forward(codes);
            let (mut voxels, mut rays) = (Vec::new(), Vec::new());
            for object in &batch {
                match &object.target {
                    Target::Voxels(of_object) => voxels.push(of_object.as_slice()),
                    Target::Rays(of_object) => rays.push(of_object.clone()),
                    Target::Points(_) | Target::Silhouettes(_) => {}
                }
            }
            if rays.is_empty() {
                let iou = voxel_iou(&logits, &voxels);
                one_term("voxels", voxel_cross_entropy(&logits, &voxels), iou)
            } else {
                one_term("ray_consistency", ray_consistency(&logits, &rays, &terms.grid), f64::NAN)
            }
        }
        ShapeDecoder::Points(decoder) => {
            one_term("chamfer", chamfer(&decoder.forward(codes), &points(&batch)), f64::NAN)
        }
        ShapeDecoder::Patches(decoder) => {
            let truth = points(&batch);
            let each = places.len() / decoder.patches();
            let places = TensorData::new(places.concat(), [decoder.patches(), each, 2]);
            let places = Tensor::<3>::from_data(places, device);
            let made = decoder.forward(codes, Tensor::from_inner(places));
            one_term("chamfer", chamfer(&made, &truth), f64::NAN)
        }
        ShapeDecoder::Sphere(decoder) => {
            let vertices = decoder.forward(codes);
            let views: Vec<_> = batch
                .into_iter()
                .map(|object| match object.target {
                    Target::Silhouettes(views) => views,
                    _ => Vec::new(),
                })
                .collect();
            let faces = &SphereDecoder::sphere().faces;
            let (silhouettes, iou) = silhouette_loss(&vertices, faces, &views, terms.sharpness);
            let all = vec![
                ("silhouettes", silhouettes),
                ("laplacian", terms.connections.laplacian(&vertices) * terms.laplacian),
                ("flatness", terms.connections.flatness(&vertices) * terms.flatness),
            ];
            let total = all.iter().map(|(_, term)| term.clone()).reduce(|a, b| a + b);
            let total = total.unwrap_or_else(|| Tensor::zeros([1], device));
            StepLoss { total, terms: all, mask_iou: iou }
        }
    }
}

fn one_term(name: &'static str, term: Tensor<1>, iou: f64) -> StepLoss {
    StepLoss { total: term.clone(), terms: vec![(name, term)], mask_iou: iou }
}

/// The true points of each object.
fn points(batch: &[SystemObject]) -> Vec<Vec<glam::Vec3>> {
    let points = |object: &SystemObject| match &object.target {
        Target::Points(points) => points.clone(),
        _ => Vec::new(),
    };
    batch.iter().map(points).collect()
}

/// Intersection over union of voxels that are more likely filled than not, and the true ones.
fn voxel_iou(logits: &Tensor<4>, truth: &[&[bool]]) -> f64 {
    let logits: Vec<f32> = logits.clone().inner().into_data().iter::<f32>().collect();
    let pairs = || logits.iter().map(|logit| *logit >= 0.0).zip(truth.iter().flat_map(|t| t.iter().copied()));
    let either = pairs().filter(|(a, b)| *a || *b).count();
    pairs().filter(|(a, b)| *a && *b).count() as f64 / either.max(1) as f64
}

impl Learner for SystemTrainer {
    /// One step: draw objects, encode a picture of each, compare their shapes with what is known.
    ///
    /// All randomness comes from the seed and the step's number: a resumed run draws what an unbroken one would.
    fn step(&mut self) -> Result<StepReport> {
        let drawer = &self.drawer;
        let start = || {
            let drawer = drawer.clone();
            Loader::start(move |step| drawer.draw(step), self.step + 1)
        };
        let mut batch = self.loader.get_or_insert_with(start).next_batch()?;
        let whole = batch.objects.len();
        let parts = shares(whole, self.devices.len()).map(|objects| {
            let work = batch.take_first(objects.len());
            Part { weight: work.objects.len() as f64 / whole as f64, work }
        });
        let parts = parts.collect();
        let terms = &self.terms;
        let learn = |model: &ShapeModel, batch, device: &Device| loss_of(model, batch, terms, device);
        let (loss, gradients) = self.devices.learn(&self.model, parts, learn);
        let settings = StepSettings {
            step: self.step + 1,
            is_last: self.step + 1 == self.config.steps,
            learning_rate: self.config.learning_rate_at(self.step),
            samples: 0,
        };
        let report = StepReport::of(&loss, settings, self.last.as_ref())?;
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
        self.config.steps
    }

    /// By silhouettes of meshes; points have none.
    fn validate(&self, pixels: usize) -> Option<ViewMetrics> {
        let model = SystemModel::of(self.config.clone(), self.model.valid());
        mean_metrics(&self.validation_views, |view| model.view_metrics(view, pixels / self.validation_views.len()))
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
