//! `dvr eval` on a dataset of many objects: a model or a baseline, and joining what was measured in parts.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use clap::ValueEnum;
use dvr_core::dataset::ObjectDataset;
use dvr_core::files::{FolderKind, OutputFolder};
use dvr_core::record::{Digest, RecordKey};
use dvr_core::{Cancellation, Split};
use dvr_train::{
    Checkpoint, Evaluation, MeanShapes, Measurement, NearestPicture, ObjectModel, Observer, Predictor, Results, Shard,
    Summary, merge_results, to_markdown, write_summaries,
};
use serde_json::json;

use super::dataset_of_run::options_of_run;
use super::provenance::record_key;
use super::{OBJECT_RESOLUTION, mesh_options};
use crate::EXIT_INTERRUPTED;
use crate::args::{Baseline, EvalArgs, SplitArg};
use crate::memory;
use crate::progress::Progress;

/// The tables.
const SUMMARIES: [&str; 3] = ["summary.json", "summary.csv", "summary.md"];

/// What is measured.
struct Subject {
    predictor: Predictor,
    name: String,
    steps: usize,
    /// Of its parameters, or of what it has read.
    digest: Digest,
    /// What computes it.
    device: String,
}

/// Measures a run.
pub fn of_run(args: &EvalArgs, run: &Path, checkpoint: &Checkpoint, cancellation: &Cancellation) -> Result<ExitCode> {
    let device = args.backend.backend.device()?;
    memory::limit(&device, args.reading.memory);
    let mut model = ObjectModel::load(checkpoint, &device)?;
    let threshold = args.objects.threshold;
    if let Some(threshold) = threshold {
        model = model.with_threshold(threshold)?;
    }
    let symmetry = args.objects.symmetry;
    if let Some(symmetry) = symmetry {
        model = model.with_symmetry(symmetry.is_on())?;
    }
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
    let at = threshold.map_or_else(String::new, |threshold| format!("_at_{threshold}"));
    let at = at + &symmetry.map_or_else(String::new, |symmetry| format!("_symmetry_{}", symmetry.name()));
    let out = args.objects.out.clone().unwrap_or_else(|| folder.join(format!("eval_{split_name}{at}")));
    let name = folder.canonicalize().ok().and_then(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
    let name = name.unwrap_or_else(|| "run".to_owned());
    let mut config = serde_json::to_value(&checkpoint.header.method)?;
    if let Some(threshold) = threshold {
        config = json!({"method": config, "threshold": threshold});
    }
    if let Some(symmetry) = symmetry {
        config = json!({"method": config, "symmetry": symmetry.name()});
    }
    let of = threshold.map_or(name.clone(), |threshold| format!("{name}, surface at {threshold}"));
    let of = symmetry.map_or(of.clone(), |symmetry| format!("{of}, symmetry {}", symmetry.name()));
    let subject = Subject {
        digest: Digest::of_all([&Digest::of_bytes(&checkpoint.state.model), &Digest::of_json(&config)]),
        predictor: Predictor::Model(Box::new(model)),
        name: of,
        steps: checkpoint.header.step,
        device: args.backend.backend.described(),
    };
    measure(args, &dataset, &subject, &out, cancellation)
}

/// Measures a baseline, or joins files.
pub fn without_run(args: &EvalArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let Some(out) = &args.objects.out else { bail!("no folder for the results was given: add --out DIR") };
    if !args.objects.merge.is_empty() {
        return merge(&args.objects.merge, out);
    }
    let (Some(baseline), Some(root)) = (args.objects.baseline, &args.data) else {
        bail!("give a run to measure, or --baseline with --data, or --merge")
    };
    let dataset = ObjectDataset::open(root, args.objects.reading.options(&args.reading))?;
    let training = dataset.of_split(Split::Train).len();
    let mut progress = Progress::new();
    progress.phase("reading training objects", training);
    let mut notes = Vec::new();
    let problem = |object: usize, problem: String| {
        let object = &dataset.objects()[object];
        notes.push(format!("{}/{} is left out: {problem}", object.category, object.name));
    };
    let (predictor, name, digest) = match baseline {
        Baseline::MeanShape => {
            let means = MeanShapes::read(&dataset, |done| progress.progress(done, ""), problem)?;
            let digest = means.digest();
            (Predictor::MeanShape(means), "mean shape", digest)
        }
        Baseline::NearestPicture => {
            let shown = std::sync::Mutex::new(&mut progress);
            let show = |done| {
                if let Ok(mut progress) = shown.lock() {
                    progress.progress(done, "");
                }
            };
            let nearest = NearestPicture::read(&dataset, show, problem)?;
            let digest = nearest.digest();
            (Predictor::NearestPicture(nearest), "nearest picture", digest)
        }
    };
    super::print_notes(&notes);
    let subject = Subject { predictor, name: name.to_owned(), steps: 0, digest, device: "cpu".to_owned() };
    measure(args, &dataset, &subject, out, cancellation)
}

/// Measures a predictor, writes and prints the tables.
fn measure(
    args: &EvalArgs,
    dataset: &ObjectDataset,
    subject: &Subject,
    out: &Path,
    cancellation: &Cancellation,
) -> Result<ExitCode> {
    let objects = &args.objects;
    let split = objects.split.unwrap_or(SplitArg::Test).split();
    if dataset.of_split(split).is_empty() {
        bail!("{} has no objects in its {split:?} split; choose another with --split", dataset.root().display());
    }
    let shard = objects.shard.unwrap_or(Shard::WHOLE);
    let extraction = mesh_options(&args.meshing, OBJECT_RESOLUTION, cancellation).extraction;
    let (name, resolution) = (subject.name.clone(), extraction.resolution);
    let measurement = Measurement::new(name, subject.steps, split, args.seed, resolution, objects.object_views);
    let key = key(args, subject, &measurement)?;
    let whole = shard == Shard::WHOLE;
    let file =
        if whole { "objects.jsonl".to_owned() } else { format!("objects-{}-of-{}.jsonl", shard.number, shard.of) };
    let predictor = &subject.predictor;
    let kept_in = objects.keep_shapes.then_some(out);
    let evaluation = Evaluation { dataset, predictor, split, shard, extraction: &extraction, key: &key, kept_in };
    let shapes = if objects.keep_shapes { evaluation.shape_files() } else { Vec::new() };
    let files: Vec<&str> = SUMMARIES.into_iter().chain([&*file]).chain(shapes.iter().map(String::as_str)).collect();
    OutputFolder::share(out, FolderKind::Evaluation, &files)?;
    let path = out.join(&file);
    let mut results = Results::open(&path, measurement.clone())?;
    evaluation.run(&mut results, cancellation, &mut Progress::new())?;
    if cancellation.is_cancelled() {
        eprintln!("stopped; {} objects are in {}. The same command goes on", results.scores.len(), path.display());
        return Ok(ExitCode::from(EXIT_INTERRUPTED));
    }
    if !results.unmeasured.is_empty() {
        println!("{} object(s) could not be measured", results.unmeasured.len());
    }
    if results.scores.is_empty() {
        bail!("no object could be measured{}", hint(predictor, split));
    }
    let summary = [Summary::new(measurement, &results.scores, &results.unmeasured)];
    println!("{}", to_markdown(&summary));
    if whole {
        write_summaries(out, &summary)?;
        println!("wrote {}", out.join("summary.{json,csv,md}").display());
    } else {
        println!("wrote {}; join the parts with: dvr eval --merge FILES --out DIR", path.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// The key of a row, but for its object.
fn key(args: &EvalArgs, subject: &Subject, measurement: &Measurement) -> Result<RecordKey> {
    let meshing = mesh_options(&args.meshing, OBJECT_RESOLUTION, &Cancellation::default());
    let settings = json!({
        "predictor": subject.digest, "measurement": measurement, "extraction": format!("{:?}", meshing.extraction),
    });
    record_key(Digest::of_bytes(&[]), &settings, &subject.device)
}

/// Why a model measures nothing, where that is known.
fn hint(predictor: &Predictor, split: Split) -> &'static str {
    match predictor {
        Predictor::Model(model) if model.image_size().is_none() && split != Split::Train => {
            ". A model of learned codes knows its training objects alone: --split train"
        }
        _ => "",
    }
}

/// Joins shards, and puts predictors side by side.
fn merge(files: &[PathBuf], out: &Path) -> Result<ExitCode> {
    let summaries = merge_results(files)?;
    OutputFolder::share(out, FolderKind::Evaluation, &SUMMARIES)?;
    println!("{}", to_markdown(&summaries));
    write_summaries(out, &summaries)?;
    println!("wrote {}", out.join("summary.{json,csv,md}").display());
    Ok(ExitCode::SUCCESS)
}
