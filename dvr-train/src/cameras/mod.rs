//! Cameras that are slightly wrong: found anew together with the shape.
//!
//! In turns, a coarse field is trained on the cameras as they are, and every camera is moved to where this field explains its outline
//! and its photograph best. A field of many views takes after each of them only a little, so a camera that disagrees
//! with the others comes back to them. What photographs cannot tell - where the whole stands, how it is turned, how large it is - stays
//! as the files have it: after each turn the cameras are moved together to where they are, in the mean, nearest to the given ones.

mod photograph;
mod pose;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use dvr_core::{Camera, Scene, Similarity};
use glam::DVec3;
use rayon::prelude::*;

use crate::error::Result;
use crate::fast::{Capacity, DisagreeingViews, FastConfig, FastTrainer};
use crate::learner::Learner;
use crate::run::Observer;
use crate::trainer::ViewSplit;
use photograph::SmoothPhotograph;
use pose::{Aligned, Marks, align};

/// Steps of each stage of a field that cameras are compared with.
const STEPS: usize = 150;

/// Cells along an edge of these fields: in the first rounds, when cameras are far off, and then.
const CELLS: [usize; 2] = [32, 64];

/// Rounds on the coarser of the two.
const COARSE_ROUNDS: usize = 3;

/// One view in so many may be wrong about the hull that a field starts from: with wrong cameras, the hull of all is too small.
const DISAGREEING: usize = 6;

/// A round that moves what is seen by less than this, in pixels, is the last.
const SETTLED: f64 = 0.03;

/// Cameras that turn out to be right within this, in pixels, stay as the files have them.
const RIGHT: f64 = 0.2;

/// Photographs are blurred by this share of a cell as it appears in them.
const BLUR: f64 = 0.4;

/// What became of the cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct RefinedCameras {
    /// The cameras in object space, by view; empty where those of the files are right.
    pub cameras: BTreeMap<String, Camera>,
    /// Root mean square of how far surface points moved in the pictures, in pixels.
    pub moved_pixels: f64,
    /// Rounds of training and moving.
    pub rounds: usize,
}

impl RefinedCameras {
    /// What to tell people.
    pub fn note(&self) -> String {
        let Self { moved_pixels, rounds, .. } = self;
        if self.cameras.is_empty() {
            format!("the cameras are right within {moved_pixels:.2} pixels ({rounds} rounds), and stay as they are")
        } else {
            format!("the cameras were moved by {moved_pixels:.2} pixels in the mean ({rounds} rounds)")
        }
    }

    /// Puts the cameras into a scene that was read from the same files.
    pub fn apply(cameras: &BTreeMap<String, Camera>, scene: &mut Scene) {
        for view in &mut scene.views {
            if let Some(camera) = cameras.get(&view.name) {
                view.camera = camera.clone();
            }
        }
    }
}

/// Moves the cameras of all views of `scene` to where they fit together, in at most so many rounds; `None` where it was interrupted,
/// and the scene is as it was.
///
/// Fields are trained as `config` says, on training views alone. Views that are held out or for testing are moved too, to be
/// comparable, but teach nothing.
///
/// # Errors
/// When the scene has too few views or its masks show no object.
pub fn refine_cameras(
    scene: &mut Scene,
    config: &FastConfig,
    rounds: usize,
    interrupted: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Option<RefinedCameras>> {
    let given: Vec<Camera> = scene.views.iter().map(|view| view.camera.clone()).collect();
    let marks: Vec<Marks> = scene.views.par_iter().map(Marks::new).collect();
    let teaching: Vec<bool> = {
        let views = ViewSplit::new(scene, config.hold_out_every)?;
        scene.views.iter().map(|view| views.train.iter().any(|train| std::ptr::eq(*train, view))).collect()
    };
    observer.phase("refining the cameras", rounds);
    let mut moved = 0.0;
    let mut done = 0;
    while done < rounds {
        let cells = CELLS[usize::from(done >= COARSE_ROUNDS)];
        let Some(field) = coarse_field(scene, config, cells, interrupted)? else {
            restore(scene, &given);
            return Ok(None);
        };
        let spacing = f64::from(field.shape().lattice.spacing());
        let aligned: Vec<Aligned> = (scene.views.par_iter().zip(&given).zip(&marks))
            .map(|((view, given), marks)| {
                let photo = SmoothPhotograph::new(&view.image, (BLUR * spacing * magnification(&view.camera)) as f32);
                align(&view.camera, given, marks, &photo, &field)
            })
            .collect();
        let gauge = gauge(&aligned, &given, &teaching);
        let cameras: Vec<Camera> = aligned.iter().map(|aligned| aligned.camera.into_world(&gauge)).collect();
        let before: Vec<Camera> = scene.views.iter().map(|view| view.camera.clone()).collect();
        let step = displacement(&before, &cameras, &aligned, &gauge);
        moved = displacement(&given, &cameras, &aligned, &gauge);
        scene.views.iter_mut().zip(cameras).for_each(|(view, camera)| view.camera = camera);
        done += 1;
        observer.progress(done, &format!("{moved:.2} pixels off where they were"));
        if step < SETTLED && done > COARSE_ROUNDS {
            break;
        }
    }
    let mut cameras = BTreeMap::new();
    if moved < RIGHT {
        restore(scene, &given);
    } else {
        cameras = scene.views.iter().map(|view| (view.name.clone(), view.camera.clone())).collect();
    }
    let refined = RefinedCameras { cameras, moved_pixels: moved, rounds: done };
    observer.note(&refined.note());
    Ok(Some(refined))
}

fn restore(scene: &mut Scene, given: &[Camera]) {
    scene.views.iter_mut().zip(given).for_each(|(view, camera)| view.camera = camera.clone());
}

/// A field of so many cells, trained shortly; `None` where it was interrupted.
fn coarse_field(
    scene: &Scene,
    config: &FastConfig,
    cells: usize,
    interrupted: &AtomicBool,
) -> Result<Option<dvr_model::LatticeField>> {
    let config = FastConfig {
        capacity: Capacity::Cells(cells),
        first_cells: config.first_cells.min(cells),
        steps: STEPS,
        disagreeing_views: DisagreeingViews::OneIn(DISAGREEING),
        ..config.clone()
    };
    let mut trainer = FastTrainer::new(ViewSplit::new(scene, config.hold_out_every)?, config)?;
    while trainer.steps_done() < trainer.total_steps() {
        if interrupted.load(Ordering::Relaxed) {
            return Ok(None);
        }
        trainer.step()?;
    }
    Ok(Some(trainer.field()))
}

/// Pixels of an object unit at the object's distance.
fn magnification(camera: &Camera) -> f64 {
    camera.intrinsics.x_axis.x / camera.center().length().max(0.1)
}

/// Takes the space in which the moved cameras live to where they are nearest to the given ones: where they stand, and what they look
/// at. The identity where that is not determined.
fn gauge(aligned: &[Aligned], given: &[Camera], teaching: &[bool]) -> Similarity {
    let anchors = |camera: &Camera| [camera.center(), camera.center() + camera.center().length() * camera.forward()];
    let chosen = || aligned.iter().zip(given).zip(teaching).filter(|(_, teaching)| **teaching);
    let from: Vec<DVec3> = chosen().flat_map(|((aligned, _), _)| anchors(&aligned.camera)).collect();
    let to: Vec<DVec3> = chosen().flat_map(|((_, given), _)| anchors(given)).collect();
    Similarity::between(&from, &to).unwrap_or_default()
}

/// Root mean square of how far the surface points that each view sees move in its picture as its camera changes, in pixels.
fn displacement(before: &[Camera], after: &[Camera], aligned: &[Aligned], gauge: &Similarity) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for ((before, after), aligned) in before.iter().zip(after).zip(aligned) {
        for point in &aligned.points {
            let point = gauge.transform_point(*point);
            sum += (before.project(point).0 - after.project(point).0).length_squared();
            count += 1;
        }
    }
    (sum / count.max(1) as f64).sqrt()
}
