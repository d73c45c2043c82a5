//! `dvr train` on a dataset of many objects.

use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Result, bail};
use cpu_time::ProcessTime;
use dvr_core::dataset::{ObjectDataset, ReadOptions};
use dvr_core::{Cancellation, Split};
use dvr_report::SourceRun;
use dvr_train::{
    Method, ObjectsMetrics, ObjectsTraining, RunFolder, Stop, finish_objects, resolved_for_dataset, train_objects,
};

use super::dataset_of_run::options_of_run;
use super::run_start::{RunStart, interrupted, run_options};
use crate::args::{SceneArgs, TrainArgs};
use crate::commands::report::write_report;
use crate::memory::{check_objects, limit_training};
use crate::progress::Progress;

/// Trains, then writes preview and figures.
pub fn run(
    args: &TrainArgs,
    mut start: RunStart,
    method: &dyn Method,
    training: ObjectsTraining<'_>,
    cancellation: &Cancellation,
) -> Result<ExitCode> {
    let device = args.backend().device()?;
    limit_training(&device, args.reading.memory, method)?;
    check_objects(method, &device, args.reading.memory)?;
    refuse_scene_options(&args.reading)?;
    let (root, options) = match &start.resumed {
        Some(checkpoint) => {
            let path = args.scene.clone().unwrap_or_else(|| checkpoint.header.scene.clone());
            (path, options_of_run(checkpoint)?)
        }
        None => {
            let Some(path) = args.scene.clone() else { bail!("no dataset was given") };
            let mut options = args.objects.options(&args.reading);
            // Features are found by the camera of the picture.
            options.inputs_are_views = training.encoder().local_channels().is_some();
            if options.inputs_are_views && options.inputs.is_some() {
                bail!(
                    "--inputs: the encoders of kinds `local` and `local-bn` see the views, whose cameras are known; leave --inputs out"
                );
            }
            (path, options)
        }
    };
    let dataset = Arc::new(ObjectDataset::open(&root, options.clone())?);
    describe(&dataset, method, training);
    let mut progress = Progress::new();
    let method = &*resolved_for_dataset(&dataset, method, start.resumed.as_ref(), &mut progress)?;
    let _writing = start.prepare(method)?;
    let (folder, resumed) = (&start.folder, start.resumed.as_ref());
    let options = run_options(args, folder, serde_json::to_value(options)?, device, cancellation)?;
    let cpu = ProcessTime::now();
    let result = train_objects(&dataset, method, resumed, &options, &mut progress)?;
    let cpu_seconds = cpu.elapsed().as_secs_f64();
    if result.outcome.stop == Stop::Interrupted {
        return Ok(interrupted(&result.outcome, folder));
    }
    let metrics = finish_objects(&dataset, &result, folder, &mut progress)?;
    if !args.no_report {
        let run = SourceRun { folder: folder.clone(), header: result.outcome.header.clone(), scene: None };
        write_report(&[run], &folder.report())?;
    }
    report(&metrics, matches!(training, ObjectsTraining::Fields(_)), folder, cpu_seconds);
    Ok(ExitCode::SUCCESS)
}

/// Refuses what has a meaning for a single scene only.
fn refuse_scene_options(reading: &SceneArgs) -> Result<()> {
    let given = reading.read_options();
    let shared = ReadOptions {
        format: given.format,
        visual_hull_depth: given.visual_hull_depth,
        max_memory: given.max_memory,
        ..ReadOptions::default()
    };
    if given != shared || reading.no_mask_refinement {
        bail!(
            "--downscale, --background, --no-mask-refinement, --views, --ignore, --normalise and --box are for single scenes; \
             objects of a dataset are read as they are"
        );
    }
    Ok(())
}

/// What is about to happen.
fn describe(dataset: &ObjectDataset, method: &dyn Method, training: ObjectsTraining<'_>) {
    let count = |split| dataset.of_split(split).len();
    let mut categories: Vec<&str> = dataset.objects().iter().map(|object| object.category.as_str()).collect();
    categories.sort_unstable();
    categories.dedup();
    eprintln!(
        "{}: a dataset of many objects, so one model learns them all: {} to train on, {} to validate, {} for testing, in {} \
         categories; supervision {}{}",
        dataset.root().display(),
        count(Split::Train),
        count(Split::Val),
        count(Split::Test),
        categories.len(),
        method.common().supervision,
        if training.is_of_one_view() { ", one view of each object" } else { "" },
    );
}

/// The results, for people.
fn report(metrics: &ObjectsMetrics, has_colors: bool, folder: &RunFolder, cpu_seconds: f64) {
    println!(
        "trained {} steps in {:.1} s ({cpu_seconds:.1} CPU s), seed {}; {} objects, {} parameters",
        metrics.steps, metrics.training_seconds, metrics.seed, metrics.objects, metrics.parameters
    );
    if let Some(best) = metrics.validation {
        let psnr = if has_colors { format!(", PSNR {:.2} dB", best.psnr) } else { String::new() };
        println!(
            "validation objects: silhouette IoU {:.3}{psnr} at step {}, which stands for the run",
            best.mask_iou, best.step
        );
    }
    if !metrics.broken.is_empty() {
        println!("{} object(s) could not be used and were left out; metrics.json names them", metrics.broken.len());
    }
    for path in [folder.preview(), folder.metrics_json(), folder.report()].iter().filter(|path| path.exists()) {
        println!("wrote {}", path.display());
    }
    println!("next: dvr eval {} --split test", folder.root().display());
}
