//! Training on a dataset of objects from start to end, and what it leaves for its user.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use dvr_core::dataset::ObjectDataset;
use dvr_core::{Similarity, Split};
use dvr_model::EncoderConfig;
use dvr_render::extract::ExtractSettings;
use dvr_render::{FieldShader, MeshShader};
use image::RgbImage;
use image::imageops::{FilterType, resize};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::fields_task::FieldsTask;
use super::mirror::{Mirror, Symmetry};
use super::model::{FieldsModel, render_settings, skip_grid};
use super::object_model::ObjectModel;
use super::systems::model::SystemModel;
use super::systems::task::SystemTask;
use super::task::ObjectsTask;
use super::trainer::TaskTrainer;
use crate::error::{Error, Result};
use crate::export::preview::{preview_row, sheet};
use crate::methods::method::{Method, ObjectsTraining};
use crate::methods::method_of;
use crate::methods::record::{CommonSettings, MethodRecord};
use crate::observer::Observer;
use crate::run::best::Best;
use crate::run::checkpoint::{CHECKPOINT_VERSION, Checkpoint, CheckpointHeader};
use crate::run::folder::RunFolder;
use crate::run::options::{RunOptions, RunOutcome};
use crate::run::training_loop::TrainingLoop;

/// The figures of a finished run: `metrics.json`. (What unseen objects say of it is the business of evaluation.)
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectsMetrics {
    /// The dataset's folder.
    pub dataset: std::path::PathBuf,
    /// What the shape was learned from.
    pub supervision: String,
    /// Seed.
    pub seed: u64,
    /// Objects trained on.
    pub objects: usize,
    /// Optimiser steps of the run, all sessions.
    pub steps: usize,
    /// The step whose model stands for the run.
    pub model_step: usize,
    /// Numbers that encoder and decoder consist of.
    pub parameters: usize,
    /// Wall seconds of training, all sessions.
    pub training_seconds: f64,
    /// The validation by which that step was chosen: on other views of objects that were not trained on.
    pub validation: Option<Best>,
    /// `category/name` of the objects that could not be used, with the reason.
    pub broken: Vec<(String, String)>,
}

/// What training on a dataset left.
#[derive(Clone, Debug)]
pub struct TrainedObjects {
    /// The model that stands for the run.
    pub model: ObjectModel,
    /// How the run went.
    pub outcome: RunOutcome,
    /// Objects trained on.
    pub objects: usize,
    /// `category/name` of the objects that could not be used, with the reason.
    pub broken: Vec<(String, String)>,
}

/// Rows of the preview sheet, and the most pixels a picture is wide.
const PREVIEW: (usize, u32) = (6, 128);

/// Cells along an edge at which voxels are shown as a surface.
const PREVIEW_CELLS: usize = 64;

/// Colour of shapes that have none, sRGB.
const PREVIEW_GREY: [f32; 3] = [0.6; 3];

/// Samples across the cube where a field is shown.
const SAMPLES: usize = 128;

/// The method with the settings that its dataset decides: how many objects have codes, and in which mirror they are alike. Done
/// again, it changes nothing.
///
/// # Errors
/// When the method cannot learn from objects, or its settings do not go together; when a run with codes is to go on with
/// another number of objects.
pub fn resolved_for_dataset(
    dataset: &ObjectDataset,
    method: &dyn Method,
    resume_from: Option<&Checkpoint>,
    observer: &mut dyn Observer,
) -> Result<Box<dyn Method>> {
    method.check()?;
    let training = method.objects().ok_or_else(|| Error::NeedsScene { method: method.name().to_owned() })?;
    let mut found = Map::new();
    if let EncoderConfig::Codes { .. } = training.encoder() {
        let now = dataset.of_split(Split::Train).len();
        if let Some(checkpoint) = resume_from
            && let Some(before) = codes_of(&checkpoint.header.method)?
            && before != now
        {
            return Err(Error::OtherObjects { before, now });
        }
        found.insert("encoder".to_owned(), value_of(&EncoderConfig::Codes { objects: now })?);
    }
    if let ObjectsTraining::Fields(config) = training
        && (config.mirror == Mirror::Auto || config.symmetry == Symmetry::Auto)
    {
        observer.phase("looking for the objects' mirror", 1);
        let (mirror, symmetry) = config.found_mirror(dataset);
        found.insert("mirror".to_owned(), value_of(&mirror)?);
        found.insert("symmetry".to_owned(), value_of(&symmetry)?);
        observer.progress(1, "");
    }
    method.with_overrides(&Value::Object(found))
}

fn value_of(setting: &impl Serialize) -> Result<Value> {
    serde_json::to_value(setting).map_err(|e| Error::BadConfig { problem: e.to_string() })
}

/// Learns the objects of a dataset from where `resume_from` left them, or from the start.
///
/// The step that explains the silhouettes of validation objects best stands for the run: shapes are what it is for, and
/// silhouettes are known under every supervision.
///
/// # Errors
/// When the dataset has no training objects, or too many broken ones; when a file cannot be written; when the loss
/// diverges.
pub fn train_objects(
    dataset: &Arc<ObjectDataset>,
    method: &dyn Method,
    resume_from: Option<&Checkpoint>,
    options: &RunOptions,
    observer: &mut dyn Observer,
) -> Result<TrainedObjects> {
    let method = &*resolved_for_dataset(dataset, method, resume_from, observer)?;
    let training = method.objects().ok_or_else(|| Error::NeedsScene { method: method.name().to_owned() })?;
    let start = Instant::now();
    observer.phase("reading validation objects", 1);
    let header = CheckpointHeader {
        version: CHECKPOINT_VERSION,
        method: method.record()?,
        common: method.common(),
        step: 0,
        seconds: 0.0,
        best: None,
        scene: dataset.root().to_owned(),
        reading: options.reading.clone(),
        object_to_world: Similarity::default(),
        views: None,
        cameras: BTreeMap::new(),
        refine_cameras: 0,
        exposures: Default::default(),
        lengths: Vec::new(),
        support: None,
        notes: Vec::new(),
    };
    let training_loop = TrainingLoop::new(method, header, options, start);
    let run = Learning { dataset, training_loop, options, resume_from };
    match training {
        ObjectsTraining::Fields(config) => {
            let model =
                |bytes: &[u8]| FieldsModel::from_bytes(config.clone(), bytes, &options.device).map(ObjectModel::Fields);
            run.learn::<FieldsTask>(config.clone(), config.pretrained.as_deref(), model, observer)
        }
        ObjectsTraining::System(config) => {
            let model =
                |bytes: &[u8]| SystemModel::from_bytes(config.clone(), bytes, &options.device).map(ObjectModel::System);
            run.learn::<SystemTask>(config.clone(), config.pretrained.as_deref(), model, observer)
        }
    }
}

/// What a run takes its steps with, whatever it learns.
struct Learning<'a> {
    dataset: &'a Arc<ObjectDataset>,
    training_loop: TrainingLoop<'a>,
    options: &'a RunOptions,
    resume_from: Option<&'a Checkpoint>,
}

impl Learning<'_> {
    /// Takes a task through all of its steps; `model` makes what stands for the run of its bytes.
    fn learn<T: ObjectsTask>(
        self,
        config: T::Config,
        pretrained: Option<&Path>,
        model: impl FnOnce(&[u8]) -> Result<ObjectModel>,
        observer: &mut dyn Observer,
    ) -> Result<TrainedObjects> {
        let Self { dataset, training_loop, options, resume_from } = self;
        let others = options.data_parallel.clone();
        let mut learner = TaskTrainer::<T>::new(dataset.clone(), config, options.device.clone())?.data_parallel(others);
        if let (Some(path), None) = (pretrained, resume_from) {
            learner.start_from(path)?;
        }
        observer.progress(1, "");
        let outcome = training_loop.run(&mut learner, resume_from, observer)?;
        let model = model(&outcome.model)?;
        Ok(TrainedObjects { model, outcome, objects: learner.objects(), broken: learner.broken() })
    }
}

/// How many codes a model of many objects has, where it has some.
fn codes_of(record: &MethodRecord) -> Result<Option<usize>> {
    let method = method_of(record)?;
    Ok(match method.objects().map(ObjectsTraining::encoder) {
        Some(EncoderConfig::Codes { objects }) => Some(*objects),
        _ => None,
    })
}

/// Writes preview sheet and figures into the run's folder: rows of an unseen object's picture, one of its views, and
/// that view as the model has it, with depth and normals.
///
/// # Errors
/// When a file cannot be written.
pub fn finish_objects(
    dataset: &ObjectDataset,
    result: &TrainedObjects,
    folder: &RunFolder,
    observer: &mut dyn Observer,
) -> Result<ObjectsMetrics> {
    let TrainedObjects { model, outcome, .. } = result;
    let CommonSettings { supervision, seed, .. } = outcome.header.common;
    let shown = if model.image_size().is_some() { Split::Val } else { Split::Train };
    let objects = dataset.of_split(shown);
    let count = PREVIEW.0.min(objects.len());
    observer.phase("preview and figures", count.max(1));
    let mut rows = Vec::new();
    for i in 0..count {
        let row = i * objects.len() / count;
        // A broken object was reported in training.
        rows.extend(row_of(model, dataset, objects[row], row).ok());
        observer.progress(i + 1, "");
    }
    if !rows.is_empty() {
        dvr_core::files::write_rgb_png(&folder.preview(), &sheet(&rows))?;
    }
    let metrics = ObjectsMetrics {
        dataset: dataset.root().to_owned(),
        supervision: supervision.to_string(),
        seed,
        objects: result.objects,
        steps: outcome.steps,
        model_step: outcome.header.step,
        parameters: model.parameters(),
        training_seconds: outcome.seconds,
        validation: outcome.header.best,
        broken: result.broken.clone(),
    };
    let json = serde_json::to_string_pretty(&metrics).map_err(|e| Error::NotStored { problem: e.to_string() })?;
    dvr_core::files::write_bytes_atomically(&folder.metrics_json(), json.as_bytes())?;
    Ok(metrics)
}

/// One row of the preview: what the encoder sees, and a view half a turn of the views further.
fn row_of(model: &ObjectModel, dataset: &ObjectDataset, object: usize, row: usize) -> Result<Vec<RgbImage>> {
    let view = dataset.read_view(object, dataset.views(object)? / 2)?;
    let picture = model.image_size().map(|size| dataset.read_input(object, 0, size as u32)).transpose()?;
    let mut pictures = Vec::new();
    if let Some(picture) = &picture {
        let width = view.image.width().min(PREVIEW.1);
        pictures.push(resize(&picture.image, width, width, FilterType::Triangle));
    }
    match model {
        ObjectModel::Fields(model) => {
            let field = match &picture {
                Some(picture) => model.field_of_picture(picture),
                None => model.field_of_row(row),
            };
            let skip = skip_grid(&field);
            let shader = FieldShader::new(&field, render_settings(SAMPLES), Some(&skip));
            pictures.extend(preview_row(&shader, &view, PREVIEW.1));
        }
        ObjectModel::System(model) => {
            let extraction = ExtractSettings { resolution: PREVIEW_CELLS, ..ExtractSettings::default() };
            let shape = model.shape(picture.as_ref(), row as i64, &extraction);
            let mut mesh = shape.drawn().into_owned();
            mesh.colors = Some(vec![PREVIEW_GREY; mesh.vertices.len()]);
            pictures.extend(preview_row(&MeshShader::new(&mesh), &view, PREVIEW.1));
        }
    }
    Ok(pictures)
}
