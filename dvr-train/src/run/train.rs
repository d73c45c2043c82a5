//! A training run from start to end, on one scene.

use std::time::Instant;

use dvr_core::dataset::write_transforms;
use dvr_core::{Camera, Scene, View, ViewSplit};

use super::checkpoint::{CHECKPOINT_VERSION, Checkpoint, CheckpointHeader};
use super::options::{RunOptions, Trained};
use super::training_loop::TrainingLoop;
use crate::cameras::{RefinedCameras, refine_cameras};
use crate::error::{Error, Result};
use crate::methods::method::{Method, Start};
use crate::observer::Observer;

/// Reconstructs a scene from where `resume_from` left it, or from the start.
///
/// Cameras that are refined, now or before the checkpoint, are put into `scene`.
///
/// # Errors
/// When the scene has too few views or lacks what the method learns from, a file cannot be written, or the loss
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
    let scene = &*scene;
    let start = Instant::now();
    let common = method.common();
    let views = ViewSplit::new(scene, common.hold_out_every)?;
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
        held_out: views.held_out.iter().map(|view| view.name.clone()).collect(),
        cameras,
        notes,
    };
    let mut learner = method.start(Start {
        scene,
        views,
        device: options.device.clone(),
        data_parallel: options.data_parallel.clone(),
        is_resumed: resume_from.is_some(),
        interrupted: options.interrupted,
        observer: &mut *observer,
    })?;
    let truth = scene.ground_truth.surface.as_ref().filter(|_| options.follow_shape);
    let training = TrainingLoop::new(method, header, options, start).following(truth);
    let outcome = training.run(learner.as_mut(), resume_from, observer)?;
    Ok(Trained { model: method.load(&outcome.model, &options.device)?, outcome })
}

/// Moves the cameras to where they fit together, and writes them down where that helped.
fn refine(
    scene: &mut Scene,
    method: &dyn Method,
    options: &RunOptions,
    observer: &mut dyn Observer,
) -> Result<RefinedCameras> {
    let config = method.camera_refinement();
    let refined = refine_cameras(scene, &config, options.refine_cameras, options.interrupted, observer)?;
    let refined = refined.ok_or(Error::InterruptedEarly)?;
    if !refined.cameras.is_empty() {
        let in_world = |view: &View| (view.name.clone(), view.camera.into_world(&scene.object_to_world));
        let cameras: Vec<(String, Camera)> = scene.views.iter().map(in_world).collect();
        write_transforms(&options.folder.cameras(), cameras.iter().map(|(name, camera)| (name.as_str(), camera)))?;
    }
    Ok(refined)
}
