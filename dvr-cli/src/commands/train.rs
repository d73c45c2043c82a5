//! `dvr train`: the whole job.

use std::process::ExitCode;

use anyhow::{Result, bail};
use cpu_time::ProcessTime;
use dvr_core::dataset::{Format, is_object_dataset};
use dvr_core::{Scene, Split};
use dvr_report::SourceRun;
use dvr_train::{
    Checkpoint, Error, Method, Observer, RunFolder, RunMetrics, RunOptions, Stop, ViewMetrics, ViewSplit, finish,
    method_of, train,
};

use super::method_of_args::method_of_args;
use super::run_start::{interrupted, prepare, run_options};
use super::shape_table::print_shape;
use super::{SCENE_RESOLUTION, SceneReading, mesh_options, print_notes, refinement_notes, scene_of_run, train_objects};
use crate::EXIT_INTERRUPTED;
use crate::args::TrainArgs;
use crate::commands::report::write_report;
use crate::memory::limit_training;
use crate::progress::Progress;

/// Reconstructs a scene, or learns from a dataset, as the path and the arguments say.
pub fn run(args: &TrainArgs) -> Result<ExitCode> {
    let is_dataset = match &args.scene {
        Some(path) if args.reading.format.is_none_or(|format| format == Format::DVR) => is_object_dataset(path)?,
        _ => false,
    };
    if args.print_config {
        println!("{}", method_of_args(args, is_dataset)?.record()?.pretty());
        return Ok(ExitCode::SUCCESS);
    }
    let Some(out) = &args.out else { bail!("no output folder was given: add --out DIR") };
    let folder = RunFolder::new(out);
    let resumed = args.resume.then(|| Checkpoint::load(&folder.last())).transpose()?;
    let method = match &resumed {
        Some(checkpoint) => method_of(&checkpoint.header.method)?,
        None => method_of_args(args, is_dataset)?,
    };
    match method.objects() {
        Some(config) => train_objects::run(args, &folder, method.as_ref(), config, resumed.as_ref()),
        None => train_scene(args, &folder, method.as_ref(), resumed.as_ref()),
    }
}

/// Trains, then writes mesh, preview and figures.
fn train_scene(
    args: &TrainArgs,
    folder: &RunFolder,
    method: &dyn Method,
    resumed: Option<&Checkpoint>,
) -> Result<ExitCode> {
    let device = args.backend().training_device(method)?;
    limit_training(&device, args.reading.memory, method)?;
    let (mut scene, reading) = read(args, resumed)?;
    scene.require_masks()?;
    method.check_scene(&scene)?;
    describe(&scene, method)?;
    prepare(folder, args, method)?;
    let options = RunOptions {
        refine_cameras: args.refine_cameras.unwrap_or(0),
        follow_shape: args.follow_shape,
        ..run_options(args, folder, reading, device)?
    };
    if args.follow_shape && scene.ground_truth.surface.is_none() {
        eprintln!("note: the scene's true surface is not known, and --follow-shape has nothing to compare with");
    }
    let mut progress = Progress::new();
    let cpu = ProcessTime::now();
    let trained = match train(&mut scene, method, resumed, &options, &mut progress) {
        Err(early @ Error::InterruptedEarly) => {
            eprintln!("{early}");
            return Ok(ExitCode::from(EXIT_INTERRUPTED));
        }
        trained => trained?,
    };
    let cpu_seconds = cpu.elapsed().as_secs_f64();
    if trained.outcome.stop == Stop::Interrupted {
        return Ok(interrupted(&trained.outcome, folder));
    }
    let meshing = mesh_options(&args.meshing, SCENE_RESOLUTION);
    let metrics = finish(&scene, method, &trained, folder, &meshing, &mut progress)?.metrics;
    if !args.no_report {
        progress.phase("report", 1);
        let run = SourceRun { folder: folder.clone(), header: trained.outcome.header, scene: Some(&scene) };
        write_report(&[run], &folder.report())?;
        progress.progress(1, "");
    }
    report(&metrics, folder, cpu_seconds);
    if metrics.mesh.is_none() {
        bail!("there is no mesh: the field has no surface. Check masks and cameras with `dvr info`");
    }
    Ok(ExitCode::SUCCESS)
}

/// The scene, and how it was read.
fn read(args: &TrainArgs, resumed: Option<&Checkpoint>) -> Result<(Scene, serde_json::Value)> {
    if let Some(checkpoint) = resumed {
        let scene = scene_of_run(checkpoint, args.scene.as_ref(), args.reading.memory)?;
        return Ok((scene, checkpoint.header.reading.clone()));
    }
    let Some(path) = &args.scene else { bail!("no scene was given") };
    let reading = SceneReading::of_arguments(&args.reading);
    let (scene, refined) = reading.read(path)?;
    print_notes(&refinement_notes(&refined));
    Ok((scene, serde_json::to_value(reading)?))
}

/// What is about to happen, in three lines.
fn describe(scene: &Scene, method: &dyn Method) -> Result<()> {
    let split = ViewSplit::new(scene, method.common().hold_out_every)?;
    let size = scene.views.first().map_or((0, 0), |view| view.image.dimensions());
    eprintln!(
        "{} ({}): {} views of {}x{} ({} to train on, {} held out, {} for testing), supervision {}",
        scene.name,
        scene.format,
        scene.views.len(),
        size.0,
        size.1,
        split.train.len(),
        split.held_out.len(),
        scene.views_of(Split::Test).count(),
        method.common().supervision,
    );
    print_notes(&scene.warnings);
    Ok(())
}

/// The results, for people.
fn report(metrics: &RunMetrics, folder: &RunFolder, cpu_seconds: f64) {
    print_notes(&metrics.warnings);
    let RunMetrics { steps, training_seconds, seed, .. } = metrics;
    println!("trained {steps} steps in {training_seconds:.1} s ({cpu_seconds:.1} CPU s), seed {seed}");
    if metrics.model_step != metrics.steps {
        println!("the model of step {} stands for the run: its held-out views are the best", metrics.model_step);
    }
    for (what, view_metrics) in [("field", &metrics.held_out), ("mesh", &metrics.held_out_mesh)] {
        if let Some(ViewMetrics { psnr, mask_iou, pixels }) = view_metrics {
            println!("held-out views, {what:<5}: PSNR {psnr:.2} dB, silhouette IoU {mask_iou:.3} ({pixels} pixels)");
        }
    }
    print_shape(&metrics.shape);
    if let Some([vertices, faces]) = metrics.mesh {
        println!("mesh: {vertices} vertices, {faces} faces");
    }
    let files = [
        folder.mesh_ply(),
        folder.mesh_glb(),
        folder.scene_file(),
        folder.cameras(),
        folder.preview(),
        folder.metrics_json(),
        folder.report(),
    ];
    for path in files.iter().filter(|path| path.exists()) {
        println!("wrote {}", path.display());
    }
}
