//! Cameras that are slightly wrong: found anew together with the shape.
//!
//! In turns, a coarse field is trained on the cameras as they are, and every camera is moved to where this field
//! explains its outline and its photograph best. A field of many views takes after each of them only a little, so a
//! camera that disagrees with the others comes back to them. What photographs cannot tell - where the whole stands, how
//! it is turned, how large it is - stays as the files have it: after each turn the cameras are moved together to where
//! they are, in the mean, nearest to the given ones.

mod photograph;
mod pose;

use std::collections::BTreeMap;

use dvr_core::{Camera, Cancellation, Scene, Similarity, Split, ViewSplit};
use dvr_grid::GridField;
use rayon::prelude::*;

use crate::error::Result;
use crate::observer::Observer;
use dvr_grid::{Capacity, DisagreeingViews, GridConfig, GridTrainer};
use photograph::SmoothPhotograph;
use pose::{Aligned, Marks, align};

/// Steps of each stage of a field that cameras are compared with.
const STEPS: usize = 150;

/// Steps at the end of a training whose loss counts.
const COMPARED_STEPS: usize = 50;

/// Cells along an edge of these fields: in the first rounds, when cameras are far off, and then.
const CELLS: [usize; 2] = [32, 64];

/// Rounds on the coarser of the two.
const COARSE_ROUNDS: usize = 3;

/// One view in so many may be wrong about the hull that a field starts from: with wrong cameras, the hull of all is too
/// small.
const DISAGREEING: usize = 6;

/// A round that moves what is seen by less than this, in pixels, is the last.
const SETTLED: f64 = 0.03;

/// The loss of a field on the moved cameras must be less than this share of that on the given ones, or these are kept:
/// moved cameras are off by the noise of their own estimation.
const WORTH: f64 = 0.95;

/// Photographs are blurred by this share of a cell as it appears in them: in the first rounds, when texture may be off
/// by more than its own length, and then.
const BLUR: [f64; 2] = [1.0, 0.4];

/// What became of the cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct RefinedCameras {
    /// The cameras in object space, by view; empty where those of the files fit as well.
    pub cameras: BTreeMap<String, Camera>,
    /// Root mean square of how far surface points moved in the pictures, in pixels, be it kept or not.
    pub moved_pixels: f64,
    /// Loss of a coarse field on the cameras as given, and on the moved ones.
    pub loss: [f64; 2],
    /// Rounds of training and moving.
    pub rounds: usize,
}

impl RefinedCameras {
    /// What to tell people.
    pub fn note(&self) -> String {
        let Self { moved_pixels, rounds, loss, .. } = self;
        let losses =
            format!("a coarse field's loss was {:.3} on the given cameras, {:.3} on the moved ones", loss[0], loss[1]);
        if self.cameras.is_empty() {
            format!("cameras as given fit no worse than moved ones, and stay ({rounds} rounds; {losses})")
        } else {
            format!("the cameras were moved by {moved_pixels:.2} pixels in the mean ({rounds} rounds; {losses})")
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

/// Moves the cameras of all views of `scene` to where they fit together, in at most so many rounds.
///
/// Fields are trained as `config` says, on training views alone. Views for validation and for testing are moved too, to be
/// comparable, but nothing is learned from them, and when the cameras have settled does not depend on them.
///
/// # Errors
/// When the scene has too few views, a view has no mask, or the masks show no object; [`crate::Error::Cancelled`] where
/// somebody wants it to end. The scene is then as it was.
pub fn refine_cameras(
    scene: &mut Scene,
    config: &GridConfig,
    rounds: usize,
    cancellation: &Cancellation,
    observer: &mut dyn Observer,
) -> Result<RefinedCameras> {
    scene.require_masks()?;
    let given: Vec<Camera> = scene.views.iter().map(|view| view.camera.clone()).collect();
    let refined = moved_cameras(scene, config, rounds, cancellation, observer, &given);
    refined.inspect_err(|_| restore(scene, &given))
}

/// As [`refine_cameras`], but for an error, after which the cameras are somewhere.
fn moved_cameras(
    scene: &mut Scene,
    config: &GridConfig,
    rounds: usize,
    cancellation: &Cancellation,
    observer: &mut dyn Observer,
    given: &[Camera],
) -> Result<RefinedCameras> {
    let marks: Vec<Marks> = scene.views.par_iter().map(Marks::new).collect();
    let is_training: Vec<bool> = scene.views.iter().map(|view| view.split == Split::Train).collect();
    observer.phase("refining the cameras", rounds);
    let mut moved = 0.0;
    let mut done = 0;
    while done < rounds {
        let phase = usize::from(done >= COARSE_ROUNDS);
        let Coarse { field, .. } = coarse(scene, config, CELLS[phase], cancellation)?;
        let spacing = f64::from(field.shape_grid().spacing());
        let aligned: Vec<Aligned> = (scene.views.par_iter().zip(given).zip(&marks))
            .map(|((view, given), marks)| {
                cancellation.check()?;
                let cell = spacing * magnification(&view.camera);
                let photo = SmoothPhotograph::new(&view.image, (BLUR[phase] * cell) as f32);
                Ok(align(&view.camera, given, marks, &photo, &field, cell))
            })
            .collect::<Result<_>>()?;
        // Where the whole stands, how it is turned and how large it is stays as given; where that is not determined,
        // all stays.
        let in_training = |i: &usize| is_training[*i];
        let gauge = Similarity::between_cameras(
            (0..aligned.len()).filter(in_training).map(|i| &aligned[i].camera),
            (0..given.len()).filter(in_training).map(|i| &given[i]),
        )
        .unwrap_or_default();
        let cameras: Vec<Camera> = aligned.iter().map(|aligned| aligned.camera.into_world(&gauge)).collect();
        let before: Vec<Camera> = scene.views.iter().map(|view| view.camera.clone()).collect();
        // Photographs that nothing is learned from have no say in when the cameras have settled.
        let moved_from = |before: &[Camera]| {
            displacement((0..aligned.len()).filter(in_training).map(|i| (&before[i], &cameras[i], &aligned[i])), &gauge)
        };
        let step = moved_from(&before);
        moved = moved_from(given);
        scene.views.iter_mut().zip(cameras).for_each(|(view, camera)| view.camera = camera);
        done += 1;
        observer.progress(done, &format!("{moved:.2} pixels off where they were"));
        if step < SETTLED && done > COARSE_ROUNDS {
            break;
        }
    }
    let refined: Vec<Camera> = scene.views.iter().map(|view| view.camera.clone()).collect();
    let with_refined = coarse(scene, config, CELLS[1], cancellation)?;
    restore(scene, given);
    let with_given = coarse(scene, config, CELLS[1], cancellation)?;
    let mut cameras = BTreeMap::new();
    if with_refined.loss < WORTH * with_given.loss {
        restore(scene, &refined);
        cameras = scene.views.iter().map(|view| (view.name.clone(), view.camera.clone())).collect();
    }
    let loss = [with_given.loss, with_refined.loss];
    let refined = RefinedCameras { cameras, moved_pixels: moved, loss, rounds: done };
    observer.note(&refined.note());
    Ok(refined)
}

fn restore(scene: &mut Scene, given: &[Camera]) {
    scene.views.iter_mut().zip(given).for_each(|(view, camera)| view.camera = camera.clone());
}

/// A field that was trained shortly.
struct Coarse {
    field: GridField,
    /// Mean loss of its last steps: how well views, masks and cameras fit together.
    loss: f64,
}

/// Trains a field of so many cells.
fn coarse(scene: &Scene, config: &GridConfig, cells: usize, cancellation: &Cancellation) -> Result<Coarse> {
    let config = GridConfig {
        capacity: Capacity::Cells(cells),
        first_cells: config.first_cells.min(cells),
        steps: STEPS,
        disagreeing_views: DisagreeingViews::OneIn(DISAGREEING),
        // Photographs match at the right depth where cameras are right.
        plane_sweep_pixels: 0,
        ..config.clone()
    };
    let mut trainer = GridTrainer::start(ViewSplit::of(scene)?.train, Vec::new(), config, cancellation)?;
    let mut losses = Vec::new();
    while trainer.steps_done() < trainer.total_steps() {
        cancellation.check()?;
        losses.push(trainer.step()?.loss);
    }
    let last = &losses[losses.len().saturating_sub(COMPARED_STEPS)..];
    Ok(Coarse { field: trainer.field()?, loss: last.iter().sum::<f64>() / last.len().max(1) as f64 })
}

/// Pixels of an object unit at the object's distance.
fn magnification(camera: &Camera) -> f64 {
    camera.intrinsics.x_axis.x / camera.center().length().max(0.1)
}

/// Root mean square of how far the surface points that each view sees move in its picture as its camera changes from
/// the first to the second, in pixels.
fn displacement<'a>(views: impl Iterator<Item = (&'a Camera, &'a Camera, &'a Aligned)>, gauge: &Similarity) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for (before, after, aligned) in views {
        for point in &aligned.points {
            let point = gauge.transform_point(*point);
            sum += (before.project(point).0 - after.project(point).0).length_squared();
            count += 1;
        }
    }
    (sum / count.max(1) as f64).sqrt()
}
