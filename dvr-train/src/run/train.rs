//! A training run from start to end, on one scene.

use std::collections::BTreeMap;
use std::time::Instant;

use dvr_core::dataset::write_transforms;
use dvr_core::{Camera, Exposure, Scene, Split, View, ViewNames, ViewSplit};

use super::checkpoint::{CHECKPOINT_VERSION, Checkpoint, CheckpointHeader};
use super::options::{RunOptions, Trained};
use super::training_loop::TrainingLoop;
use crate::cameras::{RefinedCameras, refine_cameras};
use crate::error::{Error, Result};
use crate::methods::method::{Method, Start};
use crate::observer::Observer;

/// Reconstructs a scene from where `resume_from` left it, or from the start.
///
/// Cameras that are refined, now or before the checkpoint, and exposures that the method found are put into `scene`, and
/// [`View::split`] says from then on what each view is for. A resumed run goes on with the views that it began with.
///
/// # Errors
/// When the scene has too few views, or not those that a resumed run began with; when it lacks what the method learns from, a file cannot be written, or the loss
/// diverges.
pub fn train(
    scene: &mut Scene,
    method: &dyn Method,
    resume_from: Option<&Checkpoint>,
    options: &RunOptions,
    observer: &mut dyn Observer,
) -> Result<Trained> {
    method.check()?;
    method.check_scene(scene)?;
    let common = method.common();
    let names = match resume_from.and_then(|checkpoint| checkpoint.header.views.as_ref()) {
        Some(names) => go_on_with(scene, names)?,
        None => options.views.clone().unwrap_or_else(|| scene.hold_out(common.hold_out_every)),
    };
    let (mut cameras, mut notes) = Default::default();
    match resume_from {
        Some(checkpoint) => {
            RefinedCameras::apply(&checkpoint.header.cameras, scene);
            (cameras, notes) = (checkpoint.header.cameras.clone(), checkpoint.header.notes.clone());
        }
        None if options.refine_cameras > 0 => {
            let refined = refine(scene, method, options, observer)?;
            notes.push(refined.note());
            cameras = refined.cameras;
        }
        None => {}
    }
    // A checkpoint's are the learner's to take up.
    Exposure::apply(&BTreeMap::new(), scene);
    let start = Instant::now();
    let ViewSplit { train, validation, .. } = ViewSplit::of(scene)?;
    let kept_lengths = || resume_from.map(|checkpoint| checkpoint.header.lengths.clone());
    let header = CheckpointHeader {
        version: CHECKPOINT_VERSION,
        method: method.record()?,
        common,
        step: 0,
        seconds: 0.0,
        best: None,
        scene: scene.source.clone(),
        reading: options.reading.clone(),
        object_to_world: scene.object_to_world,
        views: Some(names),
        cameras,
        refine_cameras: resume_from.map_or(options.refine_cameras, |checkpoint| checkpoint.header.refine_cameras),
        exposures: BTreeMap::new(),
        lengths: options.lengths.clone().or_else(kept_lengths).unwrap_or_default(),
        support: resume_from.map_or(options.support, |checkpoint| checkpoint.header.support),
        notes,
    };
    let mut learner = method.start(Start {
        scene: &*scene,
        train,
        validation,
        device: options.device.clone(),
        data_parallel: options.data_parallel.clone(),
        is_resumed: resume_from.is_some(),
        cancellation: &options.cancellation,
        observer: &mut *observer,
    })?;
    let truth = scene.ground_truth.surface.as_ref().filter(|_| options.follow_shape);
    let training = TrainingLoop::new(method, header, options, start).following(truth);
    let outcome = training.run(learner.as_mut(), resume_from, observer)?;
    drop(learner);
    Exposure::apply(&outcome.header.exposures, scene);
    Ok(Trained { model: method.load(&outcome.model, &options.device)?, outcome })
}

/// Divides the scene as a run did when it began.
///
/// # Errors
/// When views came since then, or views that the run learned from or chose by are gone: without them it would not be the
/// same run. A view for testing may be gone; the scene's warnings then say so.
fn go_on_with(scene: &mut Scene, names: &ViewNames) -> Result<ViewNames> {
    names.apply(scene)?;
    let gone = [Split::Train, Split::Val].map(|split| names.missing(scene, split)).concat();
    if gone.is_empty() { Ok(names.clone()) } else { Err(Error::ViewsGone { views: gone }) }
}

/// Moves the cameras to where they fit together, and writes them down where that helped.
fn refine(
    scene: &mut Scene,
    method: &dyn Method,
    options: &RunOptions,
    observer: &mut dyn Observer,
) -> Result<RefinedCameras> {
    let config = method.camera_refinement();
    let refined = refine_cameras(scene, &config, options.refine_cameras, &options.cancellation, observer)?;
    if !refined.cameras.is_empty() {
        let in_world = |view: &View| (view.name.clone(), view.camera.into_world(&scene.object_to_world));
        let cameras: Vec<(String, Camera)> = scene.views.iter().map(in_world).collect();
        let cameras = cameras.iter().map(|(name, camera)| (name.as_str(), camera));
        write_transforms(&options.folder.cameras(), cameras, None)?;
    }
    Ok(refined)
}
