//! Whole shapes of many objects: what the systems learn by.

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};
use dvr_core::PointCloud;
use dvr_core::dataset::ObjectDataset;
use dvr_core::voxel::VoxelGrid;
use dvr_model::{Encoder, GraphDecoder, ShapeDecoder, ShapeModel, SphereDecoder, VoxelDecoder};
use dvr_render::ViewMetrics;
use glam::Vec3;

use super::config::SystemConfig;
use super::losses::chamfer::chamfer;
use super::losses::deformation::deformation_loss;
use super::losses::mesh_shape::Connections;
use super::losses::ray_consistency::{ray_consistency, voxel_grid};
use super::losses::soft_silhouette::silhouette_loss;
use super::losses::voxel_cross_entropy::voxel_cross_entropy;
use super::model::SystemModel;
use super::targets::{SystemBatch, SystemDrawer, SystemObject, Target};
use crate::error::Result;
use crate::learners::objective::StepLoss;
use crate::learners::step_report::StepSettings;
use crate::objects::fields_task::CAMERA_WEIGHT;
use crate::objects::model::{cameras_of, image_tensor, rows_tensor};
use crate::objects::object_drawer::ObjectDrawer;
use crate::objects::task::{ObjectBatch, ObjectsTask, TaskSettings};
use crate::objects::trainer::TaskTrainer;
use crate::objects::validate::{ValidationView, mean_metrics};

/// A system in training.
pub type SystemTrainer = TaskTrainer<SystemTask>;

/// A network that makes a whole shape of each object.
pub struct SystemTask {
    config: SystemConfig,
    drawer: SystemDrawer,
    terms: Terms,
}

/// What losses need besides model and batch.
struct Terms {
    grid: VoxelGrid,
    connections: Connections,
    stages: Vec<Connections>,
    sharpness: f64,
    laplacian: f64,
    flatness: f64,
}

impl ObjectsTask for SystemTask {
    type Config = SystemConfig;
    type Network = ShapeModel;
    type Batch = SystemBatch;

    fn new(dataset: Arc<ObjectDataset>, config: SystemConfig) -> Result<Self> {
        let terms = Terms {
            grid: voxel_grid(VoxelDecoder::RESOLUTION),
            connections: Connections::new(SphereDecoder::sphere()),
            stages: GraphDecoder::meshes().iter().map(Connections::new).collect(),
            sharpness: config.sharpness,
            laplacian: config.laplacian,
            flatness: config.flatness,
        };
        Ok(Self { drawer: SystemDrawer::new(dataset, config.clone())?, terms, config })
    }

    fn config(&self) -> &SystemConfig {
        &self.config
    }

    fn settings(&self) -> TaskSettings {
        let SystemConfig { seed, steps, validate_objects, .. } = self.config;
        TaskSettings { seed, steps, validate_objects, image_size: self.config.encoder.image_size() }
    }

    fn objects(&self) -> &ObjectDrawer {
        self.drawer.objects()
    }

    fn network(&self, device: &Device) -> ShapeModel {
        self.config.model().init(device)
    }

    fn encoder(network: &mut ShapeModel) -> &mut Encoder {
        &mut network.encoder
    }

    fn draw(&self, step: usize) -> Result<SystemBatch> {
        self.drawer.draw(step)
    }

    fn step_settings(&self, steps_done: usize) -> StepSettings {
        StepSettings {
            step: steps_done + 1,
            is_last: steps_done + 1 == self.config.steps,
            learning_rate: self.config.learning_rate_at(steps_done),
            samples: 0,
        }
    }

    fn loss(&self, network: &ShapeModel, batch: SystemBatch, _: usize, device: &Device) -> StepLoss {
        loss_of(network, batch, &self.terms, device)
    }

    /// By silhouettes of meshes; points have none.
    fn validate(
        &self,
        network: ShapeModel,
        views: &[ValidationView],
        pixels: usize,
        _: &Device,
    ) -> Option<ViewMetrics> {
        let model = SystemModel::of(self.config.clone(), network);
        mean_metrics(views, |view| model.view_metrics(view, pixels / views.len()))
    }
}

impl ObjectBatch for SystemBatch {
    fn objects(&self) -> usize {
        self.objects.len()
    }

    fn weight(&self) -> usize {
        self.objects.len()
    }

    fn take_first(&mut self, count: usize) -> Self {
        Self { objects: self.objects.drain(..count).collect(), places: self.places.clone() }
    }
}

/// The loss of some objects: a picture of each is encoded, and the shape that is made of it compared with what is known.
fn loss_of(model: &ShapeModel, batch: SystemBatch, terms: &Terms, device: &Device) -> StepLoss {
    let SystemBatch { objects: batch, places } = batch;
    let inputs: Vec<_> = batch.iter().filter_map(|object| object.input.as_ref()).collect();
    let rows: Vec<i64> = batch.iter().map(|object| object.row).collect();
    let images = Tensor::from_inner(image_tensor(&inputs, device));
    if let ShapeDecoder::Graph(_) = &model.decoder {
        let cameras = cameras_of(&inputs);
        let Some((stages, camera_error)) = model.deformed(images, cameras.as_deref()) else { return nothing(device) };
        let loss = deformation_loss(&stages, &clouds(&batch), &terms.stages);
        return loss.with_term("camera", camera_error.map(|error| error * CAMERA_WEIGHT));
    }
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
        // It has no codes.
        ShapeDecoder::Graph(_) => nothing(device),
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

fn nothing(device: &Device) -> StepLoss {
    StepLoss { total: Tensor::zeros([1], &device.clone().autodiff()), terms: Vec::new(), mask_iou: f64::NAN }
}

/// The true points of each object, where it is learned from them.
fn clouds(batch: &[SystemObject]) -> Vec<&PointCloud> {
    batch.iter().filter_map(cloud_of).collect()
}

fn cloud_of(object: &SystemObject) -> Option<&PointCloud> {
    match &object.target {
        Target::Points(cloud) => Some(cloud),
        Target::Voxels(_) | Target::Silhouettes(_) | Target::Rays(_) => None,
    }
}

fn points(batch: &[SystemObject]) -> Vec<&[Vec3]> {
    clouds(batch).into_iter().map(|cloud| cloud.points.as_slice()).collect()
}

/// Intersection over union of voxels that are more likely filled than not, and the true ones.
fn voxel_iou(logits: &Tensor<4>, truth: &[&[bool]]) -> f64 {
    let logits: Vec<f32> = logits.clone().inner().into_data().iter::<f32>().collect();
    let pairs = || logits.iter().map(|logit| *logit >= 0.0).zip(truth.iter().flat_map(|t| t.iter().copied()));
    let either = pairs().filter(|(a, b)| *a || *b).count();
    pairs().filter(|(a, b)| *a && *b).count() as f64 / either.max(1) as f64
}
