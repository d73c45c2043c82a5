//! Training on a dataset of objects from start to end, and what it leaves for its user.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use burn::module::Module;
use dvr_core::dataset::ObjectDataset;
use dvr_core::{Similarity, Split};
use dvr_model::EncoderConfig;
use dvr_render::FieldShader;
use image::RgbImage;
use image::imageops::{FilterType, resize};
use serde::{Deserialize, Serialize};

use super::config::ObjectsConfig;
use super::model::{ObjectModel, render_settings, skip_grid};
use super::trainer::ObjectsTrainer;
use crate::error::{Error, Result};
use crate::export::preview::{preview_row, sheet};
use crate::methods::method::Method;
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

/// Samples across the cube where a field is shown.
const SAMPLES: usize = 128;

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
    method.check()?;
    let mut config = method.objects().cloned().ok_or_else(|| Error::NeedsScene { method: method.name().to_owned() })?;
    let mut record = method.record()?;
    let start = Instant::now();
    if let EncoderConfig::Codes { objects } = &mut config.encoder {
        *objects = dataset.of_split(Split::Train).len();
        let now = *objects;
        if let Some(checkpoint) = resume_from
            && let Some(ObjectsConfig { encoder: EncoderConfig::Codes { objects: before }, .. }) =
                ObjectsConfig::of_record(&checkpoint.header.method)?
            && before != now
        {
            return Err(Error::OtherObjects { before, now });
        }
        record.config = config.to_value()?;
    }
    observer.phase("reading validation objects", 1);
    let mut learner = ObjectsTrainer::new(dataset.clone(), config.clone(), options.device.clone())?
        .data_parallel(options.data_parallel.clone());
    if let (Some(path), None) = (&config.pretrained, resume_from) {
        learner.start_from(path)?;
    }
    observer.progress(1, "");
    let header = CheckpointHeader {
        version: CHECKPOINT_VERSION,
        method: record,
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
    let outcome = TrainingLoop::new(method, header, options, start).run(&mut learner, resume_from, observer)?;
    Ok(TrainedObjects {
        model: ObjectModel::from_bytes(config, &outcome.model, &options.device)?,
        outcome,
        objects: learner.objects(),
        broken: learner.broken(),
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
    let config = model.config();
    let shown = if config.encoder.image_size().is_some() { Split::Val } else { Split::Train };
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
        supervision: config.train.supervision.to_string(),
        seed: config.train.seed,
        objects: result.objects,
        steps: outcome.steps,
        model_step: outcome.header.step,
        parameters: model.model().num_params(),
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
    let mut pictures = Vec::new();
    let field = match model.image_size() {
        Some(size) => {
            let picture = dataset.read_input(object, 0, size as u32)?;
            let width = view.image.width().min(PREVIEW.1);
            pictures.push(resize(&picture, width, width, FilterType::Triangle));
            model.field_of_picture(&picture)
        }
        None => model.field_of_row(row),
    };
    let skip = skip_grid(&field);
    pictures.extend(preview_row(&FieldShader::new(&field, render_settings(SAMPLES), Some(&skip)), &view, PREVIEW.1));
    Ok(pictures)
}
