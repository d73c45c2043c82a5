//! `dvr eval` on a dataset of many objects: a model or a baseline, and joining what was measured in parts.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use anyhow::{Context, Result, bail};
use clap::ValueEnum;
use dvr_core::dataset::ObjectDataset;
use dvr_train::{
    Checkpoint, Evaluation, MeanShapes, Measurement, NearestPicture, ObjectModel, Observer, Predictor, Results, Shard,
    Summary, merge_results, to_markdown, write_summaries,
};

use super::dataset_of_run::options_of_run;
use super::{OBJECT_RESOLUTION, mesh_options};
use crate::EXIT_INTERRUPTED;
use crate::args::{Baseline, EvalArgs, SplitArg};
use crate::interrupt::{self, INTERRUPTED};
use crate::memory;
use crate::progress::Progress;

/// Measures a run.
pub fn of_run(args: &EvalArgs, run: &Path, checkpoint: &Checkpoint) -> Result<ExitCode> {
    let device = args.backend.backend.device()?;
    memory::limit(&device, args.reading.memory);
    let model = ObjectModel::load(checkpoint, &device)?;
    let root = args.data.as_ref().unwrap_or(&checkpoint.header.scene);
    let mut options = options_of_run(checkpoint)?;
    let given = &args.objects.reading;
    if !given.categories.is_empty() {
        options.categories.clone_from(&given.categories);
    }
    options.inputs = given.inputs.clone().or(options.inputs);
    let dataset = ObjectDataset::open(root, options)
        .with_context(|| format!("the run's dataset, {} (--data says where it is now)", root.display()))?;
    let folder = if run.is_dir() { run.to_owned() } else { run.parent().unwrap_or(Path::new(".")).to_owned() };
    let split = args.objects.split.unwrap_or(SplitArg::Test);
    let split_name = split.to_possible_value().map_or(String::new(), |value| value.get_name().to_owned());
    let out = args.objects.out.clone().unwrap_or_else(|| folder.join(format!("eval_{split_name}")));
    let name = folder.canonicalize().ok().and_then(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
    let predictor = Predictor::Model(Box::new(model));
    measure(args, &dataset, &predictor, name.unwrap_or_else(|| "run".to_owned()), checkpoint.header.step, &out)
}

/// Measures a baseline, or joins files.
pub fn without_run(args: &EvalArgs) -> Result<ExitCode> {
    let Some(out) = &args.objects.out else { bail!("no folder for the results was given: add --out DIR") };
    if !args.objects.merge.is_empty() {
        return merge(&args.objects.merge, out);
    }
    let (Some(baseline), Some(root)) = (args.objects.baseline, &args.data) else {
        bail!("give a run to measure, or --baseline with --data, or --merge")
    };
    let dataset = ObjectDataset::open(root, args.objects.reading.options(&args.reading))?;
    let training = dataset.of_split(dvr_core::Split::Train).len();
    let mut progress = Progress::new();
    progress.phase("reading training objects", training);
    let mut notes = Vec::new();
    let problem = |object: usize, problem: String| {
        let object = &dataset.objects()[object];
        notes.push(format!("{}/{} is left out: {problem}", object.category, object.name));
    };
    let (predictor, name) = match baseline {
        Baseline::MeanShape => {
            let means = MeanShapes::read(&dataset, |done| progress.progress(done, ""), problem)?;
            (Predictor::MeanShape(means), "mean shape")
        }
        Baseline::NearestPicture => {
            let shown = std::sync::Mutex::new(&mut progress);
            let show = |done| {
                if let Ok(mut progress) = shown.lock() {
                    progress.progress(done, "");
                }
            };
            (Predictor::NearestPicture(NearestPicture::read(&dataset, show, problem)?), "nearest picture")
        }
    };
    super::print_notes(&notes);
    measure(args, &dataset, &predictor, name.to_owned(), 0, out)
}

/// Measures a predictor, writes and prints the tables.
fn measure(
    args: &EvalArgs,
    dataset: &ObjectDataset,
    predictor: &Predictor,
    name: String,
    steps: usize,
    out: &Path,
) -> Result<ExitCode> {
    let objects = &args.objects;
    let split = objects.split.unwrap_or(SplitArg::Test).split();
    if dataset.of_split(split).is_empty() {
        bail!("{} has no objects in its {split:?} split; choose another with --split", dataset.root().display());
    }
    let shard = objects.shard.unwrap_or(Shard::WHOLE);
    let extraction = mesh_options(&args.meshing, OBJECT_RESOLUTION).extraction;
    let measurement = Measurement::new(name, steps, split, args.seed, extraction.resolution, objects.object_views);
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let whole = shard == Shard::WHOLE;
    let file =
        if whole { "objects.jsonl".to_owned() } else { format!("objects-{}-of-{}.jsonl", shard.number, shard.of) };
    let path = out.join(file);
    let mut results = Results::open(&path, measurement.clone())?;
    interrupt::catch()?;
    let evaluation = Evaluation { dataset, predictor, split, shard, extraction: &extraction };
    let broken = evaluation.run(&mut results, &INTERRUPTED, &mut Progress::new())?;
    if INTERRUPTED.load(Ordering::Relaxed) {
        eprintln!("stopped; {} objects are in {}. The same command goes on", results.scores.len(), path.display());
        return Ok(ExitCode::from(EXIT_INTERRUPTED));
    }
    if !broken.is_empty() {
        println!("{} object(s) could not be measured", broken.len());
    }
    if results.scores.is_empty() {
        bail!("no object could be measured. A model of learned codes knows its training objects alone: --split train");
    }
    let summary = [Summary::new(measurement, &results.scores)];
    println!("{}", to_markdown(&summary));
    if whole {
        write_summaries(out, &summary)?;
        println!("wrote {}", out.join("summary.{json,csv,md}").display());
    } else {
        println!("wrote {}; join the parts with: dvr eval --merge FILES --out DIR", path.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// Joins shards, and puts predictors side by side.
fn merge(files: &[PathBuf], out: &Path) -> Result<ExitCode> {
    let summaries = merge_results(files)?;
    println!("{}", to_markdown(&summaries));
    write_summaries(out, &summaries)?;
    println!("wrote {}", out.join("summary.{json,csv,md}").display());
    Ok(ExitCode::SUCCESS)
}
