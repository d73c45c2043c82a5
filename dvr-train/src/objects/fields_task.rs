//! Fields of many objects: what DVR and Occupancy Networks learn by.

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};
use dvr_core::dataset::ObjectDataset;
use dvr_model::{Conditioned, Encoder, ImageModel, Seen};
use dvr_render::{Query, ViewMetrics};
use glam::Vec3;

use super::config::ObjectsConfig;
use super::draw::{BatchDrawer, KnownPoints, ObjectsBatch, Targets};
use super::model::{cameras_of, image_tensor, rows_tensor, with_surface_at};
use super::object_drawer::ObjectDrawer;
use super::task::{ObjectBatch, ObjectsTask, TaskSettings};
use super::validate::{ValidationView, validate};
use crate::error::Result;
use crate::learners::batch::PixelBatch;
use crate::learners::losses;
use crate::learners::objective::{StepLoss, step_loss};
use crate::learners::step_report::StepSettings;

/// A network that makes a field of each object.
pub struct FieldsTask {
    config: ObjectsConfig,
    drawer: BatchDrawer,
}

impl ObjectsTask for FieldsTask {
    type Config = ObjectsConfig;
    type Network = ImageModel;
    type Batch = ObjectsBatch;

    fn new(dataset: Arc<ObjectDataset>, config: ObjectsConfig) -> Result<Self> {
        Ok(Self { drawer: BatchDrawer::new(dataset, config.clone())?, config })
    }

    fn config(&self) -> &ObjectsConfig {
        &self.config
    }

    fn settings(&self) -> TaskSettings {
        TaskSettings {
            seed: self.config.train.seed,
            steps: self.config.train.steps,
            validate_objects: self.config.validate_objects,
            image_size: self.config.encoder.image_size(),
        }
    }

    fn objects(&self) -> &ObjectDrawer {
        self.drawer.objects()
    }

    fn network(&self, device: &Device) -> ImageModel {
        self.config.image_model().init(device)
    }

    fn encoder(network: &mut ImageModel) -> &mut Encoder {
        &mut network.encoder
    }

    fn draw(&self, step: usize) -> Result<ObjectsBatch> {
        self.drawer.draw(step)
    }

    fn step_settings(&self, steps_done: usize) -> StepSettings {
        StepSettings::of(&self.config.train, steps_done)
    }

    fn loss(&self, network: &ImageModel, batch: ObjectsBatch, steps_done: usize, device: &Device) -> StepLoss {
        objects_loss(network, batch, &self.config, steps_done, device)
    }

    fn validate(
        &self,
        network: ImageModel,
        views: &[ValidationView],
        pixels: usize,
        device: &Device,
    ) -> Option<ViewMetrics> {
        let network = with_surface_at(network, self.config.surface_logit());
        validate(&network, views, pixels, &self.config, device)
    }
}

impl ObjectBatch for ObjectsBatch {
    fn objects(&self) -> usize {
        self.rows.len()
    }

    fn weight(&self) -> usize {
        self.targets.len()
    }

    fn take_first(&mut self, count: usize) -> Self {
        Self::take_first(self, count)
    }
}

/// Weight of what encoders guess of cameras: the guess is for pictures without one, and shapes come first.
pub(crate) const CAMERA_WEIGHT: f64 = 0.1;

/// The loss of some objects after so many steps: a picture of each is encoded, and what their fields show compared with
/// the targets.
fn objects_loss(
    model: &ImageModel,
    batch: ObjectsBatch,
    config: &ObjectsConfig,
    steps_done: usize,
    device: &Device,
) -> StepLoss {
    let inputs: Vec<_> = batch.inputs.iter().collect();
    let images = Tensor::from_inner(image_tensor(&inputs, device));
    let rows = Tensor::from_inner(rows_tensor(&batch.rows, device));
    let Seen { field, camera_error } = model.see(images, rows, cameras_of(&inputs).as_deref());
    let frozen = field.without_gradients();
    let loss = match batch.targets {
        Targets::Pixels { pixels, owner, noise, hull } => {
            let objective = config.objective();
            let batch = PixelBatch::of_pixels(pixels, objective.sampling().patch_pixels(), None, device);
            let loss = step_loss(&field, &frozen, &batch.with_objects(owner), &noise, &objective, steps_done);
            let of_hull = (!hull.points.is_empty())
                .then(|| occupancy_loss(&field, &hull, &device.clone().autodiff()).total * config.hull_occupancy);
            loss.with_term("hull", of_hull)
        }
        Targets::Points(points) => occupancy_loss(&field, &points, &device.clone().autodiff()),
    };
    loss.with_term("camera", camera_error.map(|error| error * CAMERA_WEIGHT))
}

/// The Occupancy Network objective, a mean over points, in the form of the other targets; the IoU is that of the
/// points.
fn occupancy_loss(field: &Conditioned, known: &KnownPoints, device: &Device) -> StepLoss {
    let KnownPoints { points, inside, owner } = known;
    let n = points.len();
    let flat: Vec<f32> = points.iter().flat_map(Vec3::to_array).collect();
    let sign: Vec<f32> = inside.iter().map(|&inside| if inside { 1.0 } else { -1.0 }).collect();
    let points = Tensor::from_data(TensorData::new(flat, [n, 3]), device);
    let query = Query { object: Some(rows_tensor(owner, device)), ..Query::new(points) };
    let logit = field.occupancy_logit_of_points(&query);
    let predicted: Vec<bool> = logit.clone().inner().into_data().iter::<f32>().map(|logit| logit >= 0.0).collect();
    let count = |holds: fn(bool, bool) -> bool| predicted.iter().zip(inside).filter(|&(&a, &b)| holds(a, b)).count();
    let (both, either) = (count(|a, b| a && b), count(|a, b| a || b));
    let total = losses::known_occupancy(logit, Tensor::from_data(TensorData::new(sign, [n]), device)) / n as f64;
    let mask_iou = if either == 0 { 1.0 } else { both as f64 / either as f64 };
    StepLoss { terms: vec![("occupancy", total.clone())], total, mask_iou }
}
